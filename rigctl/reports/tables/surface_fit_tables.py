"""A fitted surface as JSON and as tables for the terminal."""

from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np

from model.surface.materials import properties
from rigctl.comparison.surface_fit import FittedMaterial, FittedRegion
from rigctl.reports.table import Column, Table, text_columns
from rigctl.reports.writers.json_rows import finite


def fit_json(fitted: FittedMaterial) -> dict[str, Any]:
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


def _parameter(fitted: FittedMaterial, index: int) -> dict[str, Any]:
    return {
        "value": float(fitted.fit.values[index]),
        "std_error": finite(float(fitted.fit.information.standard_uncertainty[index])),
        "interval_95": [finite(float(end)) for end in fitted.intervals[index]],
    }
