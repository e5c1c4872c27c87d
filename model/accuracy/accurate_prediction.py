"""Record of a prediction to a tolerance."""

from collections.abc import Mapping
from dataclasses import dataclass

from model.accuracy.estimates.error_budget import Budget
from model.accuracy.estimates.light_error import LightError
from model.accuracy.evaluation.chain import ChainResult
from model.accuracy.evaluation.quantities import Reading
from model.accuracy.planning.numerical_settings import Plan

# Stage beside those of an evaluation.
ESTIMATES = "error estimates"


@dataclass(frozen=True, kw_only=True, eq=False)
class AccuratePrediction:
    """A prediction with its estimated numerical errors.

    Attributes
    ----------
    result
        What was found.
    tolerance
        That was asked for.
    plan
        Level of each setting.
    budget
        Estimated errors by setting and in sum, in the units of the tolerance.
    light
        Setting to region to the estimated error of its light.
    not_guaranteed
        Reading to the reason why its error may exceed the tolerance; all others keep it.
    stage_s
        Time of each stage over all rounds, that of the error estimates beside them [s].
    rounds
        How often the chain was evaluated.
    expected_s
        Time that an evaluation of the plan is likely to take [s].
    estimated_only
        Whether no error is promised of light of which no convergence is known: they are estimates.
    """

    result: ChainResult
    tolerance: float
    plan: Plan
    budget: Budget
    light: Mapping[str, Mapping[str, LightError]]
    not_guaranteed: Mapping[Reading, str]
    stage_s: Mapping[str, float]
    rounds: int
    expected_s: float
    estimated_only: bool = False
