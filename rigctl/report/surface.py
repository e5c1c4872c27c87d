"""A material as tables and as JSON: what it reflects, and what was fitted to it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from model.surface.materials import properties
from rigctl.report.data_files import finite
from rigctl.report.table import Column, Table, text_columns

if TYPE_CHECKING:
    from model.surface.materials import Material, Property
    from rigctl.comparison.surface_fit import FittedMaterial, FittedRegion
    from rigctl.console.json_text import Json
    from rigctl.scene.reflected_light import PropertyValue, Reflectance, ReflectedLight, SurfaceSheet


def surface_json(sheet: SurfaceSheet) -> dict[str, Json]:
    """Return all that is said of a material as plain data."""
    return asdict(sheet)


def surface_tables(sheet: SurfaceSheet) -> Iterable[Table[Any]]:
    """Return what goes into a material, what it reflects in the principal plane, and how much in all."""
    yield _properties(sheet)
    yield _principal_plane(sheet)
    yield _reflectance(sheet)


def _properties(sheet: SurfaceSheet) -> Table[PropertyValue]:
    surface = sheet.surface
    columns: tuple[Column[PropertyValue], ...] = (
        Column(title="property", text=lambda given: given.name, left=True, unbroken=True),
        Column(title="value", text=lambda given: f"{given.value:.5g}", unbroken=True),
        Column(title="± std", text=lambda given: f"{given.std:.2g}", unbroken=True),
        Column(title="basis", text=_basis, left=True, unbroken=True),
        Column(title="confidence", text=lambda given: given.confidence, left=True, unbroken=True),
        Column(title="source", text=lambda given: given.source, left=True),
    )
    title = (
        f"{sheet.material} at {sheet.wavelength_nm:g} nm, shadowing {surface.shadowing}, "
        f"diffuse {'none' if surface.dhr is None else surface.diffuse}"
    )
    return Table(title=title, columns=columns, rows=sheet.properties)


def materials_table(found: Mapping[str, Material]) -> Table[tuple[str, str, Property]]:
    """Return every property of materials, with uncertainty, basis and source; tables over wavelength by their ends."""
    columns: tuple[Column[tuple[str, str, Property]], ...] = (
        Column(title="material", text=lambda row: row[0], left=True, unbroken=True),
        Column(title="property", text=lambda row: row[1], left=True, unbroken=True),
        Column(title="value", text=lambda row: _ends(row[2]), unbroken=True),
        Column(title="± std", text=lambda row: f"{row[2].standard_uncertainty:.2g}", unbroken=True),
        Column(title="basis", text=lambda row: "assumed" if row[2].assumed else "measured", left=True, unbroken=True),
        Column(title="source", text=lambda row: row[2].source, left=True),
    )
    rows = tuple((name, key, given) for name, one in found.items() for key, given in properties(one).items())
    return Table(columns=columns, rows=rows)


def materials_json(found: Mapping[str, Material]) -> dict[str, Json]:
    """Return the same as plain data."""
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
        f"principal plane, sun at {sheet.sun_zenith_deg:g} deg, unpolarised light; "
        "camera zenith: positive towards the glint, negative on the sun's side"
    )
    return Table(title=title, columns=columns, rows=sheet.principal_plane)


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
        "directional-hemispherical reflectance by angle of incidence: of unpolarised light, the specular lobe's part "
        "of it, and of light polarised horizontally and vertically"
    )
    return Table(title=title, columns=columns, rows=sheet.reflectance)


def _basis(given: PropertyValue) -> str:
    return "assumed" if given.assumed else "measured"


def _or_dash(number: float | None, form: str = ".4f") -> str:
    return "-" if number is None else format(number, form)


def fit_json(fitted: FittedMaterial) -> dict[str, Json]:
    """Return all that a fit found as plain data; intervals hold the truth in 95 % of such fits."""
    fit = fitted.fit
    return {
        "parameters": {name: _parameter(fitted, index) for index, name in enumerate(fit.names)},
        "interval_method": fitted.interval_method,
        "correlation": {"names": list(fit.names), "matrix": fit.information.correlation.tolist()},
        "held": {
            name: {"value": getattr(fit.surface, name), "assumed": given.assumed, "source": given.source}
            for name, given in properties(fitted.start).items()
            if name not in fit.names
        },
        "shadowing": fit.surface.shadowing,
        "diffuse": fit.surface.diffuse,
        "chi_square": fit.chi_square,
        "degrees_of_freedom": fit.degrees_of_freedom,
        "p_value": fit.p_value,
        "observations": [
            {
                "run": seen.run,
                "region": seen.region,
                "measured": seen.measured.mean.tolist(),
                "std_error": np.sqrt(np.diag(seen.measured.cov)).tolist(),
                "fitted": seen.fitted.tolist(),
                "chi_square": seen.chi_square,
            }
            for seen in fitted.regions
        ],
        "assumptions": list(fitted.assumptions),
        "findings": list(fit.findings),
    }


def fit_tables(fitted: FittedMaterial) -> Iterable[Table[Any]]:
    """Return the parameters of a surface, those fitted and those held, and the observations."""
    yield Table(
        title=f"95 % interval: {fitted.interval_method}",
        columns=text_columns("parameter", "value", "± std", "from", "to"),
        rows=(*_fitted_rows(fitted), *_held_rows(fitted)),
    )
    columns: tuple[Column[FittedRegion], ...] = (
        Column(title="region", text=lambda seen: f"{seen.run}: {seen.region}", left=True),
        Column(title="S1/S0 measured", text=partial(_measured, component=0)),
        Column(title="fitted", text=lambda seen: f"{seen.fitted[0]:+.4f}"),
        Column(title="S2/S0 measured", text=partial(_measured, component=1)),
        Column(title="fitted", text=lambda seen: f"{seen.fitted[1]:+.4f}"),
        Column(title="chi-square", text=lambda seen: f"{seen.chi_square:.3g}"),
    )
    yield Table(title="normalised Stokes parameters in the camera's axes", columns=columns, rows=tuple(fitted.regions))


def _fitted_rows(fitted: FittedMaterial) -> Iterable[tuple[str, ...]]:
    fit = fitted.fit
    for name, value, error, ends in zip(
        fit.names, fit.values, fit.information.standard_uncertainty, fitted.intervals, strict=True
    ):
        yield name, *(f"{number:.5g}" if np.isfinite(number) else "unknown" for number in (value, error, *ends))


def _held_rows(fitted: FittedMaterial) -> Iterable[tuple[str, ...]]:
    for name, given in properties(fitted.start).items():
        if name not in fitted.fit.names:
            value = f"{getattr(fitted.fit.surface, name):.5g}"
            yield name, value, "held, assumed" if given.assumed else "held", "", ""


def _measured(seen: FittedRegion, component: int) -> str:
    error = float(np.sqrt(seen.measured.cov[component, component]))
    return f"{seen.measured.mean[component]:+.4f} ± {error:.1g}"


def _parameter(fitted: FittedMaterial, index: int) -> dict[str, Json]:
    return {
        "value": float(fitted.fit.values[index]),
        "std_error": finite(float(fitted.fit.information.standard_uncertainty[index])),
        "interval_95": [finite(float(end)) for end in fitted.intervals[index]],
    }
