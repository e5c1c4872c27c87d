"""The sky of a scene in four panels, as [MK14] Fig. 2."""

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from numpy.typing import NDArray

from rigctl.reports.figures.figure_style import png
from rigctl.reports.tables.sky_tables import title_lines
from rigctl.scene.sky_map import SkyMap, SkyOfKind

FloatArray = NDArray[np.float64]

# Darker than this nothing is seen; a sky without polarization still needs a scale.
_LEAST = 1e-12
_MOST_COLUMNS = 4


def sky_picture(sky: SkyMap) -> bytes:
    """Return S0, S1, S2 and DoLP over the sky as a map: north at the top, east at the right, the horizon outside."""
    figure = Figure(figsize=(11.0, 9.6), layout="constrained")
    axes = figure.subplots(2, 2, subplot_kw={"projection": "polar"}).ravel()
    s0, s1, s2 = np.moveaxis(sky.stokes, -1, 0)
    panels = (
        (s0, Normalize(0.0, _largest(s0)), "S0 [W m-2 sr-1]", "viridis"),
        (s1, _even(s1), "S1 [W m-2 sr-1], horizontal - vertical", "RdBu_r"),
        (s2, _even(s2), "S2 [W m-2 sr-1], +45 - (-45) deg", "RdBu_r"),
        (sky.dolp, Normalize(0.0, _largest(sky.dolp)), "DoLP", "magma"),
    )
    azimuth_rad = np.deg2rad(sky.azimuth_deg)
    for ax, (values, norm, label, cmap) in zip(axes, panels, strict=True):
        shown = ax.pcolormesh(azimuth_rad, sky.zenith_deg, values, norm=norm, cmap=cmap, shading="gouraud")
        _finish(ax, sky)
        figure.colorbar(shown, ax=ax, label=label, shrink=0.8)
    figure.suptitle("\n".join(title_lines(sky)), fontsize=10)
    return png(figure)


def kinds_picture(found: tuple[SkyOfKind, ...]) -> bytes:
    """Return the degree of polarization of the sky for each kind of aerosol, on one scale."""
    columns = min(len(found), _MOST_COLUMNS)
    rows = -(-len(found) // columns)
    figure = Figure(figsize=(3.6 * columns + 1.2, 4.1 * rows + 0.6), layout="constrained")
    grid = figure.subplots(rows, columns, subplot_kw={"projection": "polar"}, squeeze=False).ravel()
    norm = Normalize(0.0, max(_largest(one.sky.dolp) for one in found))
    for ax in grid[len(found) :]:
        ax.set_axis_off()
    for ax, one in zip(grid, found, strict=False):
        sky = one.sky
        azimuth_rad = np.deg2rad(sky.azimuth_deg)
        shown = ax.pcolormesh(azimuth_rad, sky.zenith_deg, sky.dolp, norm=norm, cmap="magma", shading="gouraud")
        _finish(ax, sky)
        mark = " (the file)" if one.is_chosen else ""
        ax.set_title(f"{one.label}{mark}\nlargest DoLP {sky.largest_dolp[0]:.3f}", fontsize=9)
    figure.colorbar(shown, ax=grid.tolist(), label="DoLP", shrink=0.6)
    figure.suptitle("\n".join(title_lines(found[0].sky)[:2]), fontsize=10)
    return png(figure)


def _finish(ax: PolarAxes, sky: SkyMap) -> None:
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    ax.set_rlim(0.0, 90.0)
    ax.set_rticks([30.0, 60.0], ["30°", "60°"], fontsize=8)
    ax.set_thetagrids(np.arange(0, 360, 45), ["N", "45", "E", "135", "S", "225", "W", "315"], fontsize=8)
    ax.grid(color="0.5", alpha=0.4, linewidth=0.6)
    ax.plot(
        np.deg2rad(sky.sun_azimuth_deg),
        sky.sun_zenith_deg,
        marker="*",
        markersize=14,
        color="#ffd400",
        markeredgecolor="black",
    )


def _largest(values: FloatArray) -> float:
    return max(float(np.max(values)), _LEAST)


def _even(values: FloatArray) -> Normalize:
    limit = _largest(np.abs(values))
    return Normalize(-limit, limit)
