"""Predictions of neighbouring scenes to a tolerance: plans and error estimates are shared along the series."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil

from model.accuracy.evaluation.chain import STAGES, ChainResult, Clock, evaluate
from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.evaluation.quantities import Reading, readings
from model.accuracy.planning.numerical_settings import Plan, settings_at
from model.accuracy.predict_to_tolerance import ESTIMATES, SMALLEST, SPHERES, AccuratePrediction, predict
from model.effects.names import ALL, Effect
from model.scene.lit_scene import LitScene

# An estimate costs twice an evaluation: of one case in so many it is a fifth of the time.
_SPACING = 12
# What a case between two that were judged is taken to be off by, over the larger of their errors.
_MARGIN = 1.5
# Cases that stand for others are predicted to this share of the tolerance, so that the margin has room below it.
_OF_TOLERANCE = 0.5
# Errors below this share of the tolerance need not have a smooth course.
_SMALL = 0.2
_BY_NEIGHBOUR = "is not promised of a neighbouring case, and its own error was not estimated"


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
    """

    result: ChainResult
    plan: Plan
    errors: Mapping[Reading, float]
    is_judged: bool
    not_guaranteed: Mapping[Reading, str]


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
    """

    cases: tuple[SeriesCase, ...]
    tolerance: float
    stage_s: Mapping[str, float]

    @property
    def judged(self) -> int:
        """Number of cases whose errors were estimated themselves."""
        return sum(case.is_judged for case in self.cases)

    @property
    def share_of_estimates(self) -> float:
        """Share of the time that went into error estimates, 0 to 1."""
        total = sum(self.stage_s.values())
        return self.stage_s[ESTIMATES] / total if total > 0.0 else 0.0


def predict_series(
    scenes: Sequence[LitScene],
    *,
    tolerance: float,
    effects: frozenset[Effect] = ALL,
    estimated_only: bool = False,
    store: LightStore | None = None,
    clock: Clock = time.perf_counter,
) -> SeriesPrediction:
    """Return predictions of neighbouring scenes whose numerical error is no more than a tolerance.

    Parameters
    ----------
    scenes
        One or more; in an order in which they change smoothly, as along a sweep.
    tolerance, effects, estimated_only, store, clock
        As `model.accuracy.predict_to_tolerance.predict` takes them.

    Raises
    ------
    ValueError
        The tolerance, or a number of a scene, is outside its range.

    Notes
    -----
    The ends and one case of twelve are judged: predicted with error estimates of their own, to half of the tolerance. A
    case between two of them
    takes the finer of their plans in each setting; its errors are taken to be 1.5 times the larger of theirs. Where
    that is above the tolerance, or it has numbers that they have not, it is judged itself. The course is checked:
    where two neighbours that were judged differ by more than that factor, the case in their middle is judged too.
    """
    return _Series(
        scenes, tolerance, effects, estimated_only, LightStore() if store is None else store, clock
    ).predicted()


class _Series:
    """A series while it is predicted: which cases are judged, and the time that was taken."""

    def __init__(
        self,
        scenes: Sequence[LitScene],
        tolerance: float,
        effects: frozenset[Effect],
        estimated_only: bool,
        store: LightStore,
        clock: Clock,
    ) -> None:
        self._scenes, self._tolerance, self._effects = scenes, tolerance, effects
        self._estimated_only, self._store, self._clock = estimated_only, store, clock
        self._judged: dict[int, AccuratePrediction] = {}
        self._taken = dict.fromkeys((*STAGES, ESTIMATES), 0.0)

    def predicted(self) -> SeriesPrediction:
        """Judge some, then take the others by their neighbours."""
        last = len(self._scenes) - 1
        places = [round(k * last / pieces) for pieces in [max(1, ceil(last / _SPACING))] for k in range(pieces + 1)]
        for left, right in zip(places, places[1:] or places, strict=False):
            self._check(left, right)
        cases = tuple(self._case(place) for place in range(last + 1))
        return SeriesPrediction(cases=cases, tolerance=self._tolerance, stage_s=self._taken)

    def _judge(self, place: int, *, share: float = _OF_TOLERANCE) -> AccuratePrediction:
        """Predict a case with its errors, to a share of the tolerance; what is above it is held against the whole."""
        if place not in self._judged:
            found = predict(
                self._scenes[place],
                tolerance=max(share * self._tolerance, SMALLEST),
                effects=self._effects,
                estimated_only=self._estimated_only,
                store=self._store,
                clock=self._clock,
            )
            errors = found.budget.total
            missing = {
                key: why
                for key, why in found.not_guaranteed.items()
                if why == SPHERES or not errors[key] <= self._tolerance
            }
            self._judged[place] = replace(found, not_guaranteed=missing)
            self._count(found.stage_s)
        return self._judged[place]

    def _check(self, left: int, right: int) -> None:
        """Judge both ends, and middles until the errors have a smooth course."""
        one, other = self._judge(left), self._judge(right)
        if right - left < 2 or self._is_smooth(one, other):
            return
        middle = (left + right) // 2
        self._check(left, middle)
        self._check(middle, right)

    def _is_smooth(self, one: AccuratePrediction, other: AccuratePrediction) -> bool:
        if one.budget.total.keys() != other.budget.total.keys():
            return False
        small = _SMALL * self._tolerance
        pairs = ((one.budget.total[key], other.budget.total[key]) for key in one.budget.total)
        # Of other plans there are other errors; then what counts is that both are far enough below the tolerance.
        same = dict(one.plan) == dict(other.plan)
        return all(not same or max(pair) <= _MARGIN * max(min(pair), small) for pair in pairs)

    def _case(self, place: int) -> SeriesCase:
        if place in self._judged:
            return _as_judged(self._judged[place])
        left = max(judged for judged in self._judged if judged < place)
        right = min(judged for judged in self._judged if judged > place)
        between = self._between(place, self._judged[left], self._judged[right])
        return _as_judged(self._judge(place, share=1.0)) if between is None else between

    def _between(self, place: int, one: AccuratePrediction, other: AccuratePrediction) -> SeriesCase | None:
        """Return a case by the plans and errors of its neighbours; None where these do not do."""
        unknown = {**other.not_guaranteed, **one.not_guaranteed}
        errors = {
            key: _MARGIN * max(error, other.budget.total.get(key, 0.0)) for key, error in one.budget.total.items()
        }
        if any(error > self._tolerance for key, error in errors.items() if key not in unknown):
            return None
        plan = {name: max(level, other.plan[name]) for name, level in one.plan.items()}
        scene = self._scenes[place]
        settings = settings_at(plan, self._tolerance, face_m=scene.sensor_height_m)
        result = evaluate(scene, settings, effects=self._effects, store=self._store, clock=self._clock)
        self._count(result.stage_s)
        found = readings(result.scenario, result.predictions, result.detections)
        if not found.keys() <= errors.keys():
            return None
        return SeriesCase(
            result=result,
            plan=plan,
            errors={key: errors[key] for key in found},
            is_judged=False,
            not_guaranteed={key: _BY_NEIGHBOUR for key in found if key in unknown},
        )

    def _count(self, stage_s: Mapping[str, float]) -> None:
        for stage, seconds in stage_s.items():
            self._taken[stage] += seconds


def _as_judged(found: AccuratePrediction) -> SeriesCase:
    return SeriesCase(
        result=found.result,
        plan=found.plan,
        errors=found.budget.total,
        is_judged=True,
        not_guaranteed=found.not_guaranteed,
    )
