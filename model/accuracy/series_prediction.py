"""Records of the predictions of a series of neighbouring scenes to a tolerance."""

from collections.abc import Mapping
from dataclasses import dataclass

from model.accuracy.accurate_prediction import ESTIMATES
from model.accuracy.evaluation.chain import ChainResult
from model.accuracy.evaluation.quantities import Reading
from model.accuracy.neighbours import Judged
from model.accuracy.planning.numerical_settings import Plan
from model.accuracy.series_effects import TakenEffects


@dataclass(frozen=True, kw_only=True, eq=False)
class SeriesCase:
    """Prediction of one scene of a series.

    Attributes
    ----------
    result
        What was found.
    plan
        Level of each setting.
    errors
        Reading to its error in the units of a tolerance: estimated, or bounded by those of its neighbours.
    is_judged
        Whether the errors were estimated of this case itself.
    not_guaranteed
        Reading to the reason why its error may exceed the tolerance.
    effects
        Effects that were left out, and what that may change.
    """

    result: ChainResult
    plan: Plan
    errors: Mapping[Reading, float]
    is_judged: bool
    not_guaranteed: Mapping[Reading, str]
    effects: TakenEffects


@dataclass(frozen=True, kw_only=True, eq=False)
class SeriesPrediction:
    """Predictions of the scenes of a series.

    Attributes
    ----------
    cases
        In the order of the scenes.
    tolerance
        That was asked for.
    stage_s
        Time of each stage, and of the error estimates [s].
    spot_checks, spot_checks_held
        Cases that were judged to see whether their errors are what their neighbours tell, and of how many that held.
    estimated_only
        Whether no error is promised of light of which no convergence is known: they are estimates.
    """

    cases: tuple[SeriesCase, ...]
    tolerance: float
    stage_s: Mapping[str, float]
    spot_checks: int = 0
    spot_checks_held: int = 0
    estimated_only: bool = False

    @property
    def judged(self) -> int:
        """Number of cases whose errors were estimated themselves."""
        return sum(case.is_judged for case in self.cases)

    @property
    def share_of_estimates(self) -> float:
        """Share of the time that went into error estimates, 0 to 1."""
        total = sum(self.stage_s.values())
        return self.stage_s[ESTIMATES] / total if total > 0.0 else 0.0


def as_judged(judged: Judged) -> SeriesCase:
    """Return a case with error estimates of its own."""
    return SeriesCase(
        result=judged.found.result,
        plan=judged.found.plan,
        errors=judged.found.budget.total,
        is_judged=True,
        not_guaranteed=judged.found.not_guaranteed,
        effects=judged.effects,
    )
