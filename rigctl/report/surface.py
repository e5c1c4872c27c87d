"""Tables, figures and JSON of a material: its properties, and the light that it reflects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.surface.materials import properties
from rigctl.report.document import Column, Table
from rigctl.report.drawing import MEASURED, PREDICTED, legend_beside, png
from rigctl.scene.reflected_light import CURVE_DEG, RINGS_DEG, ROUND_DEG

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.projections.polar import PolarAxes

    from model.surface.materials import Material, Property
    from rigctl.console import Json
    from rigctl.scene.reflected_light import Reflectance, ReflectedLight, SurfaceSheet


FloatArray = NDArray[np.float64]


def surface_json(sheet: SurfaceSheet) -> dict[str, Json]:
    """Return properties and reflected light of a material as JSON holds them."""
    found = asdict(replace(sheet, surface=replace(sheet.surface, table=None), properties={}))
    found["properties"] = [
        {
            "name": name,
            "value": given.values[0],
            "std": given.standard_uncertainty,
            "assumed": given.assumed,
            "confidence": given.confidence,
            "source": given.source,
        }
        for name, given in sheet.properties.items()
    ]
    table = sheet.surface.table
    return found if table is None else found | {"table": table.source}


def surface_tables(sheet: SurfaceSheet) -> Iterable[Table[Any]]:
    """Return the properties of a material, its reflected light in the principal plane, and its reflectance."""
    yield _properties(sheet)
    yield _principal_plane(sheet)
    yield _reflectance(sheet)


def _properties(sheet: SurfaceSheet) -> Table[tuple[str, Property]]:
    surface = sheet.surface
    columns: tuple[Column[tuple[str, Property]], ...] = (
        Column(title="property", text=lambda row: row[0], left=True, unbroken=True),
        Column(title="value", text=lambda row: f"{row[1].values[0]:.5g}", unbroken=True),
        Column(title="± std", text=lambda row: f"{row[1].standard_uncertainty:.2g}", unbroken=True),
        Column(title="basis", text=lambda row: _basis(row[1]), left=True, unbroken=True),
        Column(title="confidence", text=lambda row: row[1].confidence, left=True, unbroken=True),
        Column(title="source", text=lambda row: row[1].source, left=True),
    )
    title = (
        f"{sheet.material} at {sheet.wavelength_nm:g} nm, shadowing {surface.shadowing}, "
        f"diffuse {'none' if surface.dhr is None else surface.diffuse}"
        if surface.table is None
        else f"{sheet.material} at {sheet.wavelength_nm:g} nm, as measured"
    )
    return Table(title=title, columns=columns, rows=tuple(sheet.properties.items()))


def materials_table(found: Mapping[str, Material]) -> Table[tuple[str, str, Property]]:
    """Return all properties of materials with uncertainty, basis and source; spectra by their first and last value."""
    columns: tuple[Column[tuple[str, str, Property]], ...] = (
        Column(title="material", text=lambda row: row[0], left=True, unbroken=True),
        Column(title="property", text=lambda row: row[1], left=True, unbroken=True),
        Column(title="value", text=lambda row: _ends(row[2]), unbroken=True),
        Column(title="± std", text=lambda row: f"{row[2].standard_uncertainty:.2g}", unbroken=True),
        Column(title="basis", text=lambda row: _basis(row[2]), left=True, unbroken=True),
        Column(title="source", text=lambda row: row[2].source, left=True),
    )
    rows = tuple((name, key, given) for name, one in found.items() for key, given in properties(one).items())
    return Table(columns=columns, rows=rows)


def materials_json(found: Mapping[str, Material]) -> dict[str, Json]:
    """Return the properties of materials as JSON holds them."""
    return {name: {key: asdict(given) for key, given in properties(one).items()} for name, one in found.items()}


def _ends(given: Property) -> str:
    first, last = given.values[0], given.values[-1]
    return f"{first:.4g}" if len(given.values) == 1 else f"{first:.4g}..{last:.4g}"


def _principal_plane(sheet: SurfaceSheet) -> Table[ReflectedLight]:
    columns: tuple[Column[ReflectedLight], ...] = (
        Column(title="camera [deg]", text=lambda light: f"{light.camera_zenith_deg:+.0f}"),
        Column(title="F00 [1/sr]", text=lambda light: f"{light.f00_per_sr:.5g}"),
        Column(title="S1/S0", text=lambda light: _or_dash(light.s1n, "+z.4f")),
        Column(title="DoLP", text=lambda light: _or_dash(light.dolp)),
    )
    title = (
        f"principal plane, sun at {sheet.sun_zenith_deg:g} deg, unpolarized light; "
        "camera zenith: positive towards the glint, negative on the sun's side"
    )
    return Table(title=title, columns=columns, rows=sheet.principal_plane)


def most_polarized(sheets: Sequence[SurfaceSheet]) -> str:
    """Return a sentence: which material polarizes most, and at which camera zenith angle."""
    sheet, light = max(((sheet, _peak(sheet)) for sheet in sheets), key=lambda one: one[1].dolp or 0.0)
    polarizes = "polarizes most: DoLP" if len(sheets) > 1 else "polarizes up to DoLP"
    at = f"a camera zenith of {light.camera_zenith_deg:+.0f} deg"
    return f"{sheet.material} {polarizes} {_or_dash(light.dolp, '.3f')} at {at}"


def overview_table(sheets: Sequence[SurfaceSheet]) -> Table[SurfaceSheet]:
    """Return a row for each material: light near the mirror direction, highest DoLP, and reflectance."""
    columns: tuple[Column[SurfaceSheet], ...] = (
        Column(title="material", text=lambda sheet: sheet.material, left=True, unbroken=True),
        Column(title="F00 [1/sr]", text=lambda sheet: f"{_mirror(sheet).f00_per_sr:.4g}"),
        Column(title="DoLP", text=lambda sheet: _or_dash(_mirror(sheet).dolp)),
        Column(title="most DoLP", text=lambda sheet: _or_dash(_peak(sheet).dolp)),
        Column(title="at [deg]", text=lambda sheet: f"{_peak(sheet).camera_zenith_deg:+.0f}"),
        Column(title="DHR", text=lambda sheet: f"{_at_sun(sheet).total:.4f}"),
    )
    first = sheets[0]
    where = "F00, DoLP nearest the mirror; + is towards the glint"
    title = f"sun {first.sun_zenith_deg:g} deg, {first.wavelength_nm:g} nm; {where}"
    return Table(title=title, columns=columns, rows=tuple(sheets))


def _peak(sheet: SurfaceSheet) -> ReflectedLight:
    return max(_seen(sheet), key=lambda light: light.dolp or 0.0)


def _seen(sheet: SurfaceSheet) -> list[ReflectedLight]:
    """Return the light that is bright enough for a camera; the tail of a lobe is polarized but dark."""
    most = max(light.f00_per_sr for light in sheet.principal_plane)
    return [light for light in sheet.principal_plane if light.f00_per_sr >= _LEAST_SEEN * most]


def _mirror(sheet: SurfaceSheet) -> ReflectedLight:
    return min(sheet.principal_plane, key=lambda light: abs(light.camera_zenith_deg - sheet.sun_zenith_deg))


def _at_sun(sheet: SurfaceSheet) -> Reflectance:
    return min(sheet.reflectance, key=lambda given: abs(given.zenith_deg - sheet.sun_zenith_deg))


def _reflectance(sheet: SurfaceSheet) -> Table[Reflectance]:
    columns: tuple[Column[Reflectance], ...] = (
        Column(title="sun [deg]", text=lambda given: f"{given.zenith_deg:.0f}"),
        Column(title="DHR", text=lambda given: f"{given.total:.4f}"),
        Column(title="specular", text=lambda given: f"{given.specular:.4f}"),
        Column(title="horizontal", text=lambda given: f"{given.horizontal:.4f}"),
        Column(title="vertical", text=lambda given: f"{given.vertical:.4f}"),
        Column(title="error", text=lambda given: f"{given.error:.0e}"),
    )
    title = (
        "directional-hemispherical reflectance (DHR) by angle of incidence: unpolarized light, its specular part, and "
        "light polarized horizontally and vertically"
    )
    return Table(title=title, columns=columns, rows=sheet.reflectance)


def _basis(given: Property) -> str:
    return "assumed" if given.assumed else "measured"


def _or_dash(number: float | None, form: str = ".4f") -> str:
    return "-" if number is None else format(number, form)


_UNPOLARISED, _POLARISED, _SPECULAR = PREDICTED, MEASURED, "0.45"
# Decades of F00 below its largest value that are shown.
_DECADES_OF_HEMISPHERE, _DECADES_OF_CURVE = 4.0, 8.0
# Share of the brightest light that a camera of 12 bits resolves.
_LEAST_SEEN = 2.0**-12
_MARGIN = 1.2
_LEAST_DEGREE = 0.01


def surface_picture(sheet: SurfaceSheet, stokes: FloatArray) -> bytes:
    """Return F00 and DoLP in the principal plane, and reflectance against the angle of incidence."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.5, 3.9), layout="constrained")
    intensity, polarization, reflectance = figure.subplots(1, 3)
    intensity.semilogy(CURVE_DEG, _positive(stokes[:, 0]), color=_UNPOLARISED)
    intensity.set_ylim(*_shown_range(stokes[:, 0], _DECADES_OF_CURVE))
    intensity.set_ylabel("F00 [1/sr]")
    polarization.plot(CURVE_DEG, _degree(stokes), color=_UNPOLARISED)
    polarization.set_ylabel("DoLP of unpolarized light")
    polarization.set_ylim(-0.02, 1.02)
    for ax in (intensity, polarization):
        _mark_sun(ax, sheet.sun_zenith_deg)
    _draw_reflectance(reflectance, sheet)
    figure.suptitle(_title(sheet))
    return png(figure)


def surfaces_picture(sheets: Sequence[SurfaceSheet]) -> bytes:
    """Return F00 and DoLP of several materials in the principal plane, where a camera sees light."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.5, 3.9), layout="constrained")
    intensity, polarization = figure.subplots(1, 2)
    for sheet in sheets:
        seen = _seen(sheet)
        at = [light.camera_zenith_deg for light in seen]
        intensity.semilogy(at, [light.f00_per_sr for light in seen], ".-", label=sheet.material)
        polarization.plot(at, [light.dolp for light in seen], ".-")
    intensity.set_ylabel("F00 [1/sr]")
    polarization.set_ylabel("DoLP of unpolarized light")
    polarization.set_ylim(-0.02, 1.02)
    for ax in (intensity, polarization):
        _mark_sun(ax, sheets[0].sun_zenith_deg)
    legend_beside(intensity)
    figure.suptitle(f"{sheets[0].wavelength_nm:g} nm, sun at {sheets[0].sun_zenith_deg:g} deg")
    return png(figure)


def hemisphere_picture(sheet: SurfaceSheet, stokes: FloatArray) -> bytes:
    """Return F00 and DoLP over all directions of the camera, seen from above, the sun's azimuth at the top."""
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    azimuth_rad = np.deg2rad(ROUND_DEG)
    brightness, degree = _positive(stokes[..., 0]), _degree(stokes)
    panels = (
        (brightness, LogNorm(*_shown_range(stokes[..., 0], _DECADES_OF_HEMISPHERE)), "F00 [1/sr]", "viridis"),
        (degree, Normalize(0.0, np.nanmax(degree, initial=_LEAST_DEGREE)), "DoLP of unpolarized light", "magma"),
    )
    axes = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
    for ax, (values, norm, label, cmap) in zip(axes, panels, strict=True):
        shown = ax.pcolormesh(azimuth_rad, RINGS_DEG, values, norm=norm, cmap=cmap, shading="gouraud")
        _finish_hemisphere(ax, sheet.sun_zenith_deg)
        figure.colorbar(shown, ax=ax, label=label, shrink=0.8, extend="min" if isinstance(norm, LogNorm) else "neither")
    figure.suptitle(_title(sheet))
    return png(figure)


def _draw_reflectance(ax: Axes, sheet: SurfaceSheet) -> None:
    zenith_deg = [given.zenith_deg for given in sheet.reflectance]
    for values, colour, style, label in (
        ([given.total for given in sheet.reflectance], _UNPOLARISED, "-", "unpolarized light"),
        ([given.horizontal for given in sheet.reflectance], _POLARISED, "--", "polarized horizontally"),
        ([given.vertical for given in sheet.reflectance], _POLARISED, ":", "polarized vertically"),
        ([given.specular for given in sheet.reflectance], _SPECULAR, "-.", "unpolarized, specular lobe alone"),
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
    """Return the ends of a logarithmic axis, also for a surface that is black or uniform."""
    highest = float(np.nanmax(intensity)) or 1.0
    return max(float(np.nanmin(intensity)), highest * 10.0**-decades) / _MARGIN, highest * _MARGIN


def _degree(stokes: FloatArray) -> FloatArray:
    """DoLP, NaN where nothing is reflected."""
    return np.asarray(np.hypot(stokes[..., 1], stokes[..., 2]) / _positive(stokes[..., 0]))


def _title(sheet: SurfaceSheet) -> str:
    assumed = [name for name, given in sheet.properties.items() if given.assumed]
    note = f"; assumed: {', '.join(assumed)}" if assumed else ""
    return f"{sheet.material} at {sheet.wavelength_nm:g} nm, sun at {sheet.sun_zenith_deg:g} deg{note}"
