"""Figures of a scene: its sky, what its materials reflect, and what the light of its regions is made of."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from numpy.typing import NDArray

from model.scene.field import FieldLight, Source
from rigctl.reports.figures.figure_style import (
    MEASURED,
    PREDICTED,
    legend_beside,
    legend_of_all,
    png,
    say_beneath,
    subplots,
)
from rigctl.reports.tables.light_tables import PARTS, title_lines
from rigctl.scene.reflected_light import ReflectedMaps, SurfaceSheet
from rigctl.scene.sky_map import SkyMap, SkyOfKind

FloatArray = NDArray[np.float64]

# Darker than this nothing is seen; a sky without polarization still needs a scale.
_LEAST = 1e-12
_MOST_COLUMNS = 4
_UNPOLARISED, _POLARISED, _SPECULAR = PREDICTED, MEASURED, "0.45"
# Decades of F00 below its largest value that are shown.
_DECADES_OF_HEMISPHERE, _DECADES_OF_CURVE = 4.0, 8.0
_MARGIN = 1.2
_LEAST_DEGREE = 0.01
# What adds up to the light at the aperture, with its colour.
_SUMMANDS: dict[Source, str] = {"reflected_sun": "#e69f00", "reflected_sky": "#56b4e9", "path": "#999999"}
_COMPONENTS = ("S0", "S1", "S2")


def sky_picture(sky: SkyMap, *, title: Sequence[str] = (), beneath: Sequence[str] = ()) -> bytes:
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
    figure.suptitle("\n".join([*title, *title_lines(sky)]), fontsize=10)
    say_beneath(figure, beneath)
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


def surface_picture(sheet: SurfaceSheet, maps: ReflectedMaps) -> bytes:
    """Return F00 and DoLP in the principal plane, and reflectance against the angle of incidence."""
    figure = Figure(figsize=(12.5, 3.9), layout="constrained")
    intensity, polarization, reflectance = figure.subplots(1, 3)
    stokes = maps.curve_stokes
    intensity.semilogy(maps.curve_deg, _positive(stokes[:, 0]), color=_UNPOLARISED)
    intensity.set_ylim(*_shown_range(stokes[:, 0], _DECADES_OF_CURVE))
    intensity.set_ylabel("F00 [1/sr]")
    polarization.plot(maps.curve_deg, _degree(stokes), color=_UNPOLARISED)
    polarization.set_ylabel("DoLP of unpolarised light")
    polarization.set_ylim(-0.02, 1.02)
    for ax in (intensity, polarization):
        _mark_sun(ax, sheet.sun_zenith_deg)
    _draw_reflectance(reflectance, sheet)
    figure.suptitle(_title(sheet))
    return png(figure)


def hemisphere_picture(sheet: SurfaceSheet, maps: ReflectedMaps) -> bytes:
    """Return F00 and DoLP over all directions of the camera, seen from above, the sun's azimuth at the top."""
    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    azimuth_rad, stokes = np.deg2rad(maps.azimuth_deg), maps.hemisphere_stokes
    brightness, degree = _positive(stokes[..., 0]), _degree(stokes)
    panels = (
        (brightness, LogNorm(*_shown_range(stokes[..., 0], _DECADES_OF_HEMISPHERE)), "F00 [1/sr]", "viridis"),
        (degree, Normalize(0.0, np.nanmax(degree, initial=_LEAST_DEGREE)), "DoLP of unpolarised light", "magma"),
    )
    axes = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
    for ax, (values, norm, label, cmap) in zip(axes, panels, strict=True):
        shown = ax.pcolormesh(azimuth_rad, maps.zenith_deg, values, norm=norm, cmap=cmap, shading="gouraud")
        _finish_hemisphere(ax, sheet.sun_zenith_deg)
        figure.colorbar(shown, ax=ax, label=label, shrink=0.8, extend="min" if isinstance(norm, LogNorm) else "neither")
    figure.suptitle(_title(sheet))
    return png(figure)


def _draw_reflectance(ax: Axes, sheet: SurfaceSheet) -> None:
    zenith_deg = [given.zenith_deg for given in sheet.reflectance]
    for values, colour, style, label in (
        ([given.total for given in sheet.reflectance], _UNPOLARISED, "-", "unpolarised light"),
        ([given.horizontal for given in sheet.reflectance], _POLARISED, "--", "polarised horizontally"),
        ([given.vertical for given in sheet.reflectance], _POLARISED, ":", "polarised vertically"),
        ([given.specular for given in sheet.reflectance], _SPECULAR, "-.", "unpolarised, specular lobe alone"),
    ):
        ax.plot(zenith_deg, values, style, color=colour, label=label)
    ax.axhline(1.0, color="0.7", linewidth=0.8)
    ax.set_ylim(0.0, 1.05 * max(1.0, *(given.total for given in sheet.reflectance)))
    ax.set_xlabel("angle of incidence [deg]")
    ax.set_ylabel("directional-hemispherical reflectance")
    legend_beside(ax)


def _mark_sun(ax: Axes, sun_zenith_deg: float) -> None:
    for angle, label in ((-sun_zenith_deg, "sun"), (sun_zenith_deg, "mirror direction")):
        ax.axvline(angle, color="0.6", linewidth=0.8, linestyle="--")
        ax.annotate(label, (angle, 0.02), xycoords=("data", "axes fraction"), rotation=90, fontsize=7, ha="right")
    ax.set_xlabel("camera zenith [deg], positive towards the glint")
    ax.set_xlim(-90.0, 90.0)


def _finish_hemisphere(ax: PolarAxes, sun_zenith_deg: float) -> None:
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    ax.set_rlim(0.0, 90.0)
    ax.set_rticks([30.0, 60.0], ["30°", "60°"], color="white", fontsize=8)
    ax.set_rlabel_position(100.0)
    phi_deg = np.arange(0, 360, 45)
    ax.set_thetagrids(phi_deg, [_phi_label(int(angle)) for angle in phi_deg], fontsize=8)
    ax.set_facecolor("0.85")  # where nothing is reflected
    ax.grid(color="white", alpha=0.35, linewidth=0.6)
    ax.plot(0.0, sun_zenith_deg, marker="*", markersize=13, color="#ffd400", markeredgecolor="black")


def _phi_label(clockwise_deg: int) -> str:
    phi_deg = -clockwise_deg if clockwise_deg < 180 else 360 - clockwise_deg
    return {0: "phi 0\n(sun)", 180: "180 (glint)"}.get(phi_deg, f"{phi_deg:+d}")


def _positive(intensity: FloatArray) -> FloatArray:
    return np.asarray(np.where(intensity > 0.0, intensity, np.nan))


def _shown_range(intensity: FloatArray, decades: float) -> tuple[float, float]:
    """Return the ends of a logarithmic axis, which a surface that is black or the same everywhere has too."""
    highest = float(np.max(intensity)) or 1.0
    return max(float(np.min(intensity)), highest * 10.0**-decades) / _MARGIN, highest * _MARGIN


def _degree(stokes: FloatArray) -> FloatArray:
    """DoLP, NaN where nothing is reflected."""
    return np.asarray(np.hypot(stokes[..., 1], stokes[..., 2]) / _positive(stokes[..., 0]))


def _title(sheet: SurfaceSheet) -> str:
    assumed = [given.name for given in sheet.properties if given.assumed]
    note = f"; assumed: {', '.join(assumed)}" if assumed else ""
    return f"{sheet.material} at {sheet.wavelength_nm:g} nm, sun at {sheet.sun_zenith_deg:g} deg{note}"


def light_figure(lights: Mapping[str, FieldLight]) -> bytes:
    """Return the parts of the light of each region as bars, a panel a Stokes parameter; the stroke is the total."""
    figure, axes = subplots(1, 3, size=(11.0, 1.4 + 0.5 * len(lights)))
    names = list(lights)
    for component, ax in enumerate(axes):
        values = {part: np.array([light.mean(part)[component] for light in lights.values()]) for part in _SUMMANDS}
        up, down = np.zeros(len(names)), np.zeros(len(names))
        for part, colour in _SUMMANDS.items():
            # Parts of opposite sign stand on opposite sides of zero.
            left = np.where(values[part] >= 0.0, up, down)
            ax.barh(names, values[part], left=left, color=colour, label=PARTS[part], height=0.6)
            up, down = up + np.maximum(values[part], 0.0), down + np.minimum(values[part], 0.0)
        ax.plot(up + down, names, linestyle="none", marker="|", markersize=16, color="black", label="total")
        ax.axvline(0.0, color="0.3", linewidth=0.8)
        ax.set_xlabel(f"{_COMPONENTS[component]} [W m-2 sr-1]")
        ax.invert_yaxis()
        ax.tick_params(labelleft=component == 0)
    legend_of_all(figure, axes[0], place="upper")
    return png(figure)
