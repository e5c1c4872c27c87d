"""Errors of a scene by those of its neighbours: as these have them, or by the errors of their light."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import exp

from model.accuracy.accurate_prediction import AccuratePrediction
from model.accuracy.estimates.companions import Companions, carried_errors
from model.accuracy.estimates.error_budget import LitCase, error_budgets
from model.accuracy.evaluation.chain import ChainResult
from model.accuracy.evaluation.quantities import Reading, Readings, Value, readings
from model.accuracy.planning.numerical_settings import ROC, TILES, Plan
from model.accuracy.series_effects import TakenEffects
from model.scene.lit_scene import LitScene
from model.special_functions import ndtri

# What a scene between judged ones is taken to be off by, over the largest of their errors.
MARGIN = 1.5
# Numbers between 0 and 1. Where one changes by less than this share of how fast it changes elsewhere, it tells nothing.
_PROBABILITIES, _TELLING = frozenset({"p_detection", "auc"}), 0.03
# Below this density a probability does not change by more, whatever the deviate does.
_SATURATED = 1e-5


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """A scene with error estimates of its own.

    Attributes
    ----------
    found
        Its prediction.
    effects
        That act.
    companions
        What its evaluation tells for nothing.
    """

    found: AccuratePrediction
    effects: TakenEffects
    companions: Companions

    @cached_property
    def numbers(self) -> Readings:
        """All its numbers."""
        return numbers_of(self.found.result)


def told_errors(neighbours: Sequence[Judged], numbers: Readings) -> dict[Reading, float]:
    """Return the errors of a scene as those of its neighbours tell, of readings of which they do.

    Parameters
    ----------
    neighbours
        One or more, between which it lies; it was evaluated with the finest of their plans.
    numbers
        Of the scene.
    """
    told = {}
    for key, number in numbers.items():
        errors = [error for one in neighbours for error in _carried(key, number, one)]
        if errors and all(key in one.found.budget.total for one in neighbours):
            told[key] = MARGIN * max(errors)
    return told


def propagated_errors(
    neighbours: Sequence[Judged], cases: Sequence[tuple[LitScene, ChainResult]], *, tolerance: float
) -> list[dict[Reading, float]]:
    """Return the errors of scenes by those of the light of their neighbours, carried to the numbers of each.

    Parameters
    ----------
    neighbours
        As in `told_errors`.
    cases
        What was evaluated by one plan, and what was found.
    tolerance
        That is asked for.
    """
    known = [(one.found.result, one.found.light) for one in neighbours]
    lit = [
        LitCase(scene=scene, result=result, lights=carried_errors(known, result, margin=MARGIN))
        for scene, result in cases
    ]
    budgets = error_budgets(lit, tolerance=tolerance, tiles=False) if lit else []
    found = []
    for (_, result), budget in zip(cases, budgets, strict=True):
        numbers = numbers_of(result)
        of_tiles = {
            key: [error for one in neighbours for error in _carried(key, number, one, TILES)]
            for key, number in numbers.items()
        }
        found.append({key: budget.total[key] + MARGIN * max(of_tiles[key], default=0.0) for key in numbers})
    return found


def finest_plan(plans: Sequence[Plan]) -> dict[str, int]:
    """Return the finest level of each setting."""
    return {name: max(plan[name] for plan in plans) for name in plans[0]}


def numbers_of(result: ChainResult) -> Readings:
    """Return all numbers of a result that a tolerance speaks of."""
    return readings(result.scenario, result.predictions, result.detections)


def keeps(
    errors: Mapping[Reading, float], found: Iterable[Reading], unknown: Collection[Reading], allowed: float
) -> bool:
    """Return whether errors are known of all numbers, and within what is allowed but for those not to be known."""
    return all(key in errors and (errors[key] <= allowed or key in unknown) for key in found)


def _carried(key: Reading, here: Value, neighbour: Judged, setting: str | None = None) -> Iterator[float]:
    """Yield an error as it is carried over from a neighbour; nothing where that tells too little of it.

    A probability rises from 0 to 1 within few cases, and has next to no error at either end. The normal deviate that
    has it has a smooth course, and so has its error, but for that of the ROC's own integral.
    """
    budget = neighbour.found.budget
    if key not in budget.total:
        return
    error = budget.total[key] if setting is None else budget.by_setting.get(setting, {}).get(key, 0.0)
    if key.quantity not in _PROBABILITIES:
        yield error
        return
    own, other = (_density(one.number) for one in (here, neighbour.numbers[key]))
    of_rule = budget.by_setting[ROC].get(key, 0.0) if setting is None else 0.0
    if own < _SATURATED:
        yield of_rule + own
    elif other > _TELLING * own:
        yield of_rule + (error - of_rule) * own / other


def _density(probability: float) -> float:
    """Return how fast a probability changes with its normal deviate, over the fastest."""
    return exp(-0.5 * float(ndtri(probability)) ** 2)
