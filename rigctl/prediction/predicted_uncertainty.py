"""Standard uncertainties that the inputs of a scene file give the numbers predicted from it, without a run."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigctl.prediction.propagated_inputs import NumberKey, correlated_pairs, curved_inputs, propagate_numbers
from rigctl.scene.scene_inputs import only_uncertain

if TYPE_CHECKING:
    from model.prediction import RegionPrediction
    from rigctl.prediction.scene_prediction import ScenePredictor

FloatArray = NDArray[np.float64]
# A change of so little of a number, or of one, is that of rounding.
_ROUNDING = 1e-12
# Region, quantity and statistic to a number.
Nested = dict[str, dict[str, dict[str, float]]]


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedUncertainty:
    """Standard uncertainties of predicted numbers.

    Attributes
    ----------
    std_errors : mapping
        Region, quantity and statistic to the standard uncertainty by all inputs.
    inputs : tuple of str
        Those that have an uncertainty.
    effects : mapping
        Region, quantity and statistic to the change by one standard uncertainty of each of these alone, shape (k,).
    remarks : tuple of str
        What was curved, or stood at a limit.
    correlations : tuple of (input, input, correlation)
        Inputs whose errors go together, the closest first; the effects are of each alone.
    """

    std_errors: Nested
    inputs: tuple[str, ...]
    effects: dict[NumberKey, FloatArray]
    remarks: tuple[str, ...]
    correlations: tuple[tuple[str, str, float], ...] = ()

    def ranked(self, region: str, quantity: str) -> list[tuple[str, float]]:
        """Return inputs with what one standard uncertainty of each changes of a mean, the largest first."""
        found = self.effects.get(NumberKey(region, quantity, "mean"), np.zeros(len(self.inputs)))
        return [(self.inputs[k], float(found[k])) for k in np.argsort(-np.abs(found), kind="stable") if found[k] != 0.0]


def predicted_uncertainty(
    predictor: "ScenePredictor", predictions: Mapping[str, "RegionPrediction"]
) -> PredictedUncertainty:
    """Return what the uncertain inputs make of predictions.

    Parameters
    ----------
    predictor : ScenePredictor
        The scene, with what is stated of its inputs.
    predictions : mapping
        Region to prediction, with the inputs at their values.

    Raises
    ------
    ConfigError
        The model has no prediction on either side of an input.
    DataError
        Within the uncertainty of an input a number does not exist.

    References
    ----------
    `model.processing.agreement.propagate`.
    """
    numbers = {
        NumberKey(region, quantity, statistic): value
        for region, prediction in predictions.items()
        for quantity, statistics in prediction.quantities.items()
        for statistic, value in statistics.items()
    }
    inputs, uncertain = predictor.inputs, only_uncertain(predictor.inputs)
    found = propagate_numbers(numbers, inputs, lambda values: predictor.predictions_of(inputs.at(values)))
    errors = np.sqrt(np.maximum(np.diag(found.cov), 0.0)).tolist()
    nested: Nested = {}
    for key, error in zip(numbers, errors, strict=True):
        nested.setdefault(key.region, {}).setdefault(key.quantity, {})[key.statistic] = error
    return PredictedUncertainty(
        std_errors=nested,
        inputs=uncertain.names,
        effects={
            key: _without_rounding(effects, number)
            for (key, number), effects in zip(numbers.items(), found.effects, strict=True)
        },
        remarks=tuple(curved_inputs(found, uncertain)),
        correlations=tuple(correlated_pairs(uncertain)),
    )


def _without_rounding(effects: FloatArray, value: float) -> FloatArray:
    return np.where(np.abs(effects) > _ROUNDING * max(abs(value), 1.0), effects, 0.0)
