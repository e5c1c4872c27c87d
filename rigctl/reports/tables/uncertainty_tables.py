"""Effect of uncertain inputs on predicted numbers, as tables and as JSON."""

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

from model.prediction.prediction import RegionPrediction
from model.prediction.quantity_table import ORDERED
from rigctl.prediction.predicted_uncertainty import PredictedUncertainty
from rigctl.reports.table import Column, Table

# Of as many inputs as make the uncertainty; the rest is in the JSON.
_SHOWN = 6


def with_input_errors(
    predictions: dict[str, RegionPrediction], found: PredictedUncertainty
) -> dict[str, dict[str, dict[str, float]]]:
    """Return regions as JSON has those of a prediction, with a std_error_inputs beside each number."""
    return {
        region: {
            quantity: statistics
            | {f"{name}_std_error_inputs": found.std_errors[region][quantity][name] for name in statistics}
            for quantity, statistics in prediction.quantities.items()
        }
        for region, prediction in predictions.items()
    }


def input_effects_json(found: PredictedUncertainty) -> dict[str, Any]:
    """Return which input makes how much of the uncertainty, of the means that a user reads first."""
    effects = {
        region: {quantity: dict(found.ranked(region, quantity)) for quantity in ORDERED if quantity in quantities}
        for region, quantities in found.std_errors.items()
    }
    return {"uncertain_inputs": list(found.inputs), "input_effects": effects, "input_remarks": list(found.remarks)}


def input_effect_tables(found: PredictedUncertainty) -> Iterable[Table[str]]:
    """Return a table for each region: the inputs that move its DoLP most, by one standard uncertainty of each."""
    for region in found.std_errors:
        ranked = found.ranked(region, "dolp")[:_SHOWN]
        if not ranked:
            continue
        columns: tuple[Column[str], ...] = (
            Column(title="input", text=str, left=True),
            *(
                Column(title=title, text=partial(_effect, effects=dict(found.ranked(region, quantity))))
                for title, quantity in (("DoLP", "dolp"), ("s1", "s1n"), ("s2", "s2n"), ("S0 DN", "s0"))
            ),
        )
        yield Table(
            title=f"{region}: change by one standard uncertainty of an input, those first that move DoLP most",
            columns=columns,
            rows=tuple(name for name, _ in ranked),
        )


def _effect(name: str, effects: Mapping[str, float]) -> str:
    return f"{effects[name]:+.2g}" if name in effects else "0"
