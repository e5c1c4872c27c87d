"""A fitted surface as JSON and as tables for the terminal."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from model.surface.materials import properties
from rigctl.comparison.surface_fit import FittedMaterial
from rigctl.reports.table import Table, text_columns


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


def fit_tables(content: dict[str, Any]) -> Iterable[Table[Any]]:
    """Return the parameters and the observations of `fit_json` as tables."""
    yield Table(
        title=f"95 % interval: {content['interval_method']}",
        columns=text_columns("parameter", "value", "± std", "from", "to"),
        rows=tuple(_parameter_rows(content)),
    )
    yield Table(
        title="normalised Stokes parameters in the camera's axes",
        columns=text_columns("region", "S1/S0 measured", "fitted", "S2/S0 measured", "fitted", "chi-square"),
        rows=tuple(_observation_cells(seen) for seen in content["observations"]),
    )


def _parameter_rows(content: dict[str, Any]) -> Iterable[tuple[str, ...]]:
    for name, found in content["parameters"].items():
        numbers = (found["value"], found["std_error"], *found["interval_95"])
        yield name, *("unknown" if number is None else f"{number:.5g}" for number in numbers)
    for name, held in content["held"].items():
        yield name, f"{held['value']:.5g}", "held, assumed" if held["assumed"] else "held", "", ""


def _observation_cells(seen: dict[str, Any]) -> tuple[str, ...]:
    cells = (
        text
        for mean, error, model in zip(seen["measured"], seen["std_error"], seen["fitted"], strict=True)
        for text in (f"{mean:+.4f} ± {error:.1g}", f"{model:+.4f}")
    )
    return f"{seen['run']}: {seen['region']}", *cells, f"{seen['chi_square']:.3g}"


def _parameter(fitted: FittedMaterial, index: int) -> dict[str, Any]:
    return {
        "value": float(fitted.fit.values[index]),
        "std_error": _finite(float(fitted.fit.information.standard_uncertainty[index])),
        "interval_95": [_finite(end) for end in fitted.intervals[index]],
    }


def _finite(number: float) -> float | None:
    return number if np.isfinite(number) else None
