"""Tables, figures and JSON of a scene's light: its parts by region, and the sky."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from model.stokes import aolp_rad, dolp
from rigctl.base.numbers import size
from rigctl.report.document import Column, Shown, Table, text_columns
from rigctl.report.drawing import (
    legend_of_all,
    png,
    say_beneath,
    subplots,
)
from rigctl.scene.sky_map import sky_difference

if TYPE_CHECKING:
    from matplotlib.colors import Normalize
    from matplotlib.projections.polar import PolarAxes

    from model.scene.field import FieldLight, Source
    from rigctl.console import Json
    from rigctl.prediction.predict import ScenePrediction
    from rigctl.scene.sky_map import SkyMap


FloatArray = NDArray[np.float64]

# Parts of the light, in their order.
PARTS: dict[Source, str] = {
    "reflected_sun": "reflected sun",
    "reflected_sky": "reflected sky",
    "path": "path",
    "reflected": "reflected (sun + sky)",
    "total": "total at the aperture",
}
SCHEMA_VERSION = 1


def light_json(found: ScenePrediction) -> dict[str, Json]:
    """Return geometry and light of a scene as JSON; nothing for a scene of stated radiances."""
    if not found.geometry:
        return {}
    return {"geometry": found.geometry, "light": {name: _light(light) for name, light in found.lights.items()}}


# Region, name of the part, Stokes vector, and S0 of the total.
_Part = tuple[str, str, FloatArray, float]


def _parts(region: str, light: FieldLight) -> tuple[_Part, ...]:
    total_s0 = float(light.mean("total")[0])
    return tuple((region, label, light.mean(part), total_s0) for part, label in PARTS.items())


def _stokes_cell(part: _Part, k: int) -> str:
    return stokes_cells(part[2], of=part[3])[k]


_PART_COLUMNS: tuple[Column[_Part], ...] = (
    Column(title="region", text=lambda part: part[0], left=True, shown=Shown.PAGE),
    Column(title="from", text=lambda part: part[1], left=True),
    *(
        Column(title=title, text=partial(_stokes_cell, k=k))
        for k, title in enumerate(("S0", "S1", "S2", "DoLP", "AoLP deg"))
    ),
    Column(title="share of S0", text=lambda part: f"{part[2][0] / part[3]:.1%}", shown=Shown.PAGE),
)


def light_tables(found: ScenePrediction) -> Iterable[Table[_Part]]:
    """Return a table of the parts of the light for each region."""
    for name, light in found.lights.items():
        title = (
            f"{name}: radiance at the aperture in W m-2 sr-1 in band, transmittance {light.transmittance:.4f}, "
            f"error of the hemisphere integral {size(light.error)}"
        )
        yield Table(title=title, columns=_PART_COLUMNS, rows=_parts(name, light))


def share_table(lights: Mapping[str, FieldLight]) -> Table[_Part]:
    """Return the parts of the light of regions, with their shares."""
    rows = tuple(part for name, light in lights.items() for part in _parts(name, light))
    return Table(columns=_PART_COLUMNS, rows=rows)


def phi_text(phi_deg: float) -> str:
    """Return phi above -180, to which rounding could take it."""
    text = f"{phi_deg:.2f}"
    return "180.00" if text == "-180.00" else text


def geometry_lines(found: ScenePrediction) -> Iterable[str]:
    """Yield the directions of sun and camera, the irradiances, and how the light varies over the field of view."""
    at = found.geometry
    if not at:
        return
    yield (
        f"sun: zenith {at['sun_zenith_deg']:.2f} deg, azimuth {at['sun_azimuth_deg']:.2f} deg; camera: zenith "
        f"{at['camera_zenith_deg']:.2f} deg, azimuth {at['camera_azimuth_deg']:.2f} deg; phi "
        f"{phi_text(at['phi_deg'])} deg"
    )
    yield _irradiance(at["direct_irradiance"], at["sky_irradiance"])
    for name, light in found.lights.items():
        if len(light.lights) > 1:
            yield f"{name}: {len(light.lights)} tiles of the field of view; light varies by {light.spread:.2%}"
        elif light.spread > 0.0:
            yield f"{name}: treated as a point, since light varies by only {light.spread:.2%} of S0 over it"


def _irradiance(direct: float, sky: float) -> str:
    return f"irradiance in band: beam {direct:.4g} W m-2 on a plane normal to it, sky {sky:.4g} W m-2 on level ground"


def _light(light: FieldLight) -> dict[str, Json]:
    parts = {part: light.mean(part).tolist() for part in PARTS}
    return parts | {
        "transmittance": light.transmittance,
        "error": light.error,
        "tiles": len(light.lights),
        "spread": light.spread,
    }


def stokes_cells(stokes: FloatArray, *, of: float) -> tuple[str, ...]:
    """Return S0, S1, S2, DoLP and AoLP in degrees as text; rounding of the S0 that the light is part of is 0."""
    numbers = tuple(f"{0.0 if abs(value) < 1e-12 * of else value:.4g}" for value in stokes)
    if not stokes[0] > 1e-12 * of:
        return (*numbers, "-", "-")
    degree = float(dolp(stokes))
    # 180 after rounding is 0.
    angle_deg = round(float(np.degrees(aolp_rad(stokes))), 1) % 180.0
    return (*numbers, f"{degree:.4f}", f"{angle_deg:.1f}" if degree > 1e-6 else "-")


def sky_lines(sky: SkyMap) -> tuple[str, ...]:
    """Return the sun, the irradiances and the largest DoLP of a sky, and remarks."""
    degree, zenith_deg, azimuth_deg = sky.largest_dolp
    return (
        f"sun: zenith {sky.sun_zenith_deg:.2f} deg, azimuth {sky.sun_azimuth_deg:.2f} deg",
        _irradiance(sky.direct_irradiance, sky.sky_irradiance),
        f"largest DoLP {degree:.3f} at zenith {zenith_deg:.0f} deg, azimuth {azimuth_deg:.0f} deg",
        *sky.remarks,
    )


def _title_lines(sky: SkyMap) -> tuple[str, ...]:
    """Return the heading of a figure."""
    return (f"{sky.name}: north at the top, azimuth clockwise, horizon outside", sky_lines(sky)[0], *sky.remarks[:1])


def sky_json(sky: SkyMap) -> dict[str, Json]:
    """Return a sky as JSON."""
    degree, zenith_deg, azimuth_deg = sky.largest_dolp
    return {
        "schema_version": SCHEMA_VERSION,
        "scene": sky.name,
        "sun": {"zenith_deg": sky.sun_zenith_deg, "azimuth_deg": sky.sun_azimuth_deg},
        "direct_irradiance": sky.direct_irradiance,
        "sky_irradiance": sky.sky_irradiance,
        "largest_dolp": {"dolp": degree, "zenith_deg": zenith_deg, "azimuth_deg": azimuth_deg},
        "relative_error": sky.relative_error,
        "zenith_deg": sky.zenith_deg.tolist(),
        "azimuth_deg": sky.azimuth_deg.tolist(),
        "stokes": sky.stokes.tolist(),
        "remarks": list(sky.remarks),
    }


def kinds_table(kinds: Mapping[str, SkyMap]) -> Table[tuple[str, ...]]:
    """Return a row for each kind of aerosol: irradiances, largest DoLP, and differences from the first, the file's."""
    chosen = next(iter(kinds.values()))
    rows = []
    for label, sky in kinds.items():
        degree, zenith_deg, azimuth_deg = sky.largest_dolp
        off = sky_difference(sky, chosen)
        light = f"{sky.direct_irradiance:.1f}", f"{sky.sky_irradiance:.1f}"
        place = f"{degree:.3f}", f"{zenith_deg:.0f}, {azimuth_deg:.0f}"
        differs = ("-", "-") if sky is chosen else (f"{off['s0_rms']:.1%}", f"{off['largest_dolp']:.3f}")
        rows.append((f"{label}{' *' if sky is chosen else ''}", *light, *place, *differs))
    titles = ("beam W m-2", "sky W m-2", "largest DoLP", "zenith, azimuth deg", "S0 differs, rms", "DoLP differs, max")
    columns = text_columns("aerosol", *titles)
    return Table(title=f"{chosen.name}; *: as in the file", columns=columns, rows=tuple(rows))


def kinds_json(kinds: Mapping[str, SkyMap]) -> dict[str, Json]:
    """Return the kinds as JSON."""
    chosen = next(iter(kinds.values()))
    return {
        "schema_version": SCHEMA_VERSION,
        "scene": chosen.name,
        "kinds": [
            {"aerosol": label, "is_chosen": sky is chosen, "difference": sky_difference(sky, chosen), **sky_json(sky)}
            for label, sky in kinds.items()
        ],
    }


# Least end of a scale, for skies without polarization.
_LEAST = 1e-12
_MOST_COLUMNS = 4
# Parts of the light at the aperture, with colours.
_SUMMANDS: dict[Source, str] = {"reflected_sun": "#e69f00", "reflected_sky": "#56b4e9", "path": "#999999"}
_COMPONENTS = ("S0", "S1", "S2")


def sky_picture(sky: SkyMap, *, title: Sequence[str] = (), beneath: Sequence[str] = ()) -> bytes:
    """Return maps of S0, S1, S2 and DoLP over the sky: north at the top, east at the right, the horizon outside."""
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

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
    figure.suptitle("\n".join([*title, *_title_lines(sky)]), fontsize=10)
    say_beneath(figure, beneath)
    return png(figure)


def kinds_picture(kinds: Mapping[str, SkyMap]) -> bytes:
    """Return the degree of polarization of the sky for each kind of aerosol, on one scale."""
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    chosen = next(iter(kinds.values()))
    columns = min(len(kinds), _MOST_COLUMNS)
    rows = -(-len(kinds) // columns)
    figure = Figure(figsize=(3.6 * columns + 1.2, 4.1 * rows + 0.6), layout="constrained")
    grid = figure.subplots(rows, columns, subplot_kw={"projection": "polar"}, squeeze=False).ravel()
    norm = Normalize(0.0, max(_largest(sky.dolp) for sky in kinds.values()))
    for ax in grid[len(kinds) :]:
        ax.set_axis_off()
    for ax, (label, sky) in zip(grid, kinds.items(), strict=False):
        azimuth_rad = np.deg2rad(sky.azimuth_deg)
        shown = ax.pcolormesh(azimuth_rad, sky.zenith_deg, sky.dolp, norm=norm, cmap="magma", shading="gouraud")
        _finish(ax, sky)
        mark = " (the file)" if sky is chosen else ""
        ax.set_title(f"{label}{mark}\nlargest DoLP {sky.largest_dolp[0]:.3f}", fontsize=9)
    figure.colorbar(shown, ax=grid.tolist(), label="DoLP", shrink=0.6)
    figure.suptitle("\n".join(_title_lines(chosen)[:2]), fontsize=10)
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
    from matplotlib.colors import Normalize

    limit = _largest(np.abs(values))
    return Normalize(-limit, limit)


def light_figure(lights: Mapping[str, FieldLight]) -> bytes:
    """Return the parts of the light of each region as bars, one panel per Stokes parameter; the stroke is the total."""
    figure, axes = subplots(1, 3, size=(11.0, 1.4 + 0.5 * len(lights)))
    names = list(lights)
    for component, ax in enumerate(axes):
        values = {part: np.array([light.mean(part)[component] for light in lights.values()]) for part in _SUMMANDS}
        up, down = np.zeros(len(names)), np.zeros(len(names))
        for part, colour in _SUMMANDS.items():
            # Parts of opposite sign go to opposite sides of zero.
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
