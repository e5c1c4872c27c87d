"""What uncertain inputs make of predicted numbers, as tables and as JSON."""

from collections.abc import Iterable
from typing import Any

from rich.table import Table

from model.prediction.prediction import RegionPrediction
from model.prediction.quantity_table import ORDERED
from rigctl.comparison.predicted_uncertainty import PredictedUncertainty

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


def input_effect_tables(found: PredictedUncertainty) -> Iterable[Table]:
    """Return a table for each region: the inputs that move its DoLP most, by one standard uncertainty of each."""
    for region in found.std_errors:
        ranked = found.ranked(region, "dolp")[:_SHOWN]
        if not ranked:
            continue
        table = Table(
            title=f"{region}: change by one standard uncertainty of an input, those first that move DoLP most",
            title_justify="left",
            box=None,
            pad_edge=False,
        )
        table.add_column("input")
        for column in ("DoLP", "s1", "s2", "S0 DN"):
            table.add_column(column, justify="right")
        others = {quantity: dict(found.ranked(region, quantity)) for quantity in ("s1n", "s2n", "s0")}
        for name, effect in ranked:
            table.add_row(
                name, f"{effect:+.2g}", *(f"{one[name]:+.2g}" if name in one else "0" for one in others.values())
            )
        yield table
