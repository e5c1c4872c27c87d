"""Predictions of many neighbouring scenes to a tolerance, with plans and error estimates shared between them."""

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import cached_property
from itertools import pairwise, product
from math import ceil, exp

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import (
    STAGES,
    ChainResult,
    Clock,
    LightStore,
    Reading,
    Readings,
    Value,
    evaluate_all,
    readings,
)
from model.accuracy.errors import LightError, LitCase, error_budgets
from model.accuracy.plan import ROC, TILES, Plan, last_degree, settings_at
from model.accuracy.predict import (
    ESTIMATES,
    SMALLEST,
    SPHERES,
    AccuratePrediction,
    first_plan,
    plan_beside,
    predict_together,
)
from model.effects.names import ALL, LIGHT, Effect, EffectPlan, EffectRule
from model.numerics import ndtri
from model.scene.field import known_rules
from model.scene.panel import View
from model.scene.scene import LitRegion, LitScene
from model.stokes import angle_between_rad, direction

# Lattice over a grid of cases: cells whose corners are looked at closely, divided where that is too coarse

Index = tuple[int, ...]

# Steps of the grid between corners, by the number of its axes: corners are so few that looking at them closely is a
# fifth of the work, or less.
_STEPS = {1: 34, 2: 8}
_STEPS_OF_MORE = 4


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Part of a grid."""

    low: Index
    high: Index

    @property
    def corners(self) -> tuple[Index, ...]:
        """All corners, each once."""
        return tuple(dict.fromkeys(product(*zip(self.low, self.high, strict=True))))

    @property
    def places(self) -> Iterator[Index]:
        """All cases, its corners among them."""
        return product(*(range(low, high + 1) for low, high in zip(self.low, self.high, strict=True)))

    @property
    def middle(self) -> Index:
        """The case in its middle."""
        return tuple((low + high) // 2 for low, high in zip(self.low, self.high, strict=True))

    @property
    def is_divisible(self) -> bool:
        """True if there are cases between its corners."""
        return any(high - low > 1 for low, high in zip(self.low, self.high, strict=True))

    def holds(self, place: Index) -> bool:
        """Return whether a case belongs to it."""
        return all(low <= one <= high for low, one, high in zip(self.low, place, self.high, strict=True))

    def divided(self, place: Index) -> tuple["Cell", ...]:
        """Return the parts that have a case of this one as a corner; along an axis at whose end it is, none is cut."""
        parts = [
            ((low, one), (one, high)) if low < one < high else ((low, high),)
            for low, one, high in zip(self.low, place, self.high, strict=True)
        ]
        return tuple(Cell(low=tuple(a for a, _ in ends), high=tuple(b for _, b in ends)) for ends in product(*parts))


def lattice(shape: Index) -> tuple[Cell, ...]:
    """Return the cells of a grid."""
    steps = _STEPS.get(sum(size > 1 for size in shape), _STEPS_OF_MORE)

    def ends(size: int) -> list[tuple[int, int]]:
        last = size - 1
        pieces = max(1, ceil(last / steps))
        places = [round(k * last / pieces) for k in range(pieces + 1)]
        return list(pairwise(places))

    return tuple(
        Cell(low=tuple(a for a, _ in each), high=tuple(b for _, b in each))
        for each in product(*(ends(size) for size in shape))
    )


# Companions of an evaluation: what it tells for nothing of how hard its scene is, beside a neighbouring one

FloatArray = NDArray[np.float64]

# Companions by their name: "sky grid", and the regions with a field.
Companions = Mapping[str, float]
_SKY_GRID = "sky grid"
# Setting to region to the error of its light.
LightErrors = Mapping[str, Mapping[str, LightError]]
_DARK = 1e-300
# Farther than this from the sun's mirror direction neither glint nor aureole is in a lobe of such slopes, in rms slopes
# beside it.
_NEAR_RAD, _SLOPES = float(np.radians(15.0)), 4.0


def companions(scene: LitScene, result: ChainResult) -> dict[str, float]:
    """Return numbers that grow with the error of a setting: of the sky's grid, and of the tiles of each field.

    They are no errors. Where one is larger than in a neighbouring scene of which errors are known, the scene is harder
    than that.
    """
    found = {}
    if result.illumination is not None:
        found[_SKY_GRID] = result.illumination.diffuse_radiance.relative_error
    for name, light in result.lights.items():
        if len(light.lights) > 1:
            found[name] = last_degree(np.stack([getattr(one, scene.source) for one in light.lights]))
    return found


def is_harder(own: Companions, others: Sequence[Companions], *, margin: float, negligible: float) -> bool:
    """Return whether a scene is harder than all neighbours of which the errors are known."""
    return any(
        number > max(negligible, margin * max(one.get(name, 0.0) for one in others)) for name, number in own.items()
    )


def carried_errors(
    neighbours: Sequence[tuple[ChainResult, LightErrors]], result: ChainResult, *, margin: float
) -> dict[str, dict[str, LightError]]:
    """Return the errors of the light of a scene by those of its neighbours, in proportion to S0."""
    settings = neighbours[0][1]
    found: dict[str, dict[str, LightError]] = {setting: {} for setting in settings}
    for name, light in result.lights.items():
        s0 = abs(float(light.mean()[0]))
        others = [(s0 / max(abs(float(one.lights[name].mean()[0])), _DARK), errors) for one, errors in neighbours]
        for setting in settings:
            there = [
                errors[setting][name].scaled(margin * factor) for factor, errors in others if name in errors[setting]
            ]
            if there:
                found[setting][name] = max(there, key=lambda one: one.largest)
    return found


def from_glint_rad(scene: LitScene) -> float:
    """Return how far the sun is from being mirrored to the camera by a region, the least of all; pi where it is far.

    At the mirror direction the lobe has the beam over the field and the aureole before it: what was found on either
    side does not tell of it.
    """
    if scene.air is None or scene.view is None:
        return float(np.pi)
    sun = direction(zenith_rad=scene.air.sun_zenith_rad, azimuth_rad=scene.sun_azimuth_rad)
    found = [_from_glint_rad(region, scene.view, sun) for region in scene.regions if region.surface is not None]
    return min(found, default=float(np.pi))


def _from_glint_rad(region: LitRegion, view: View, sun: FloatArray) -> float:
    if region.surface is None or region.tilt is None:
        return float(np.pi)
    camera = direction(zenith_rad=view.zenith_rad, azimuth_rad=view.azimuth_rad)
    mirrored = 2.0 * float(region.tilt.normal @ camera) * region.tilt.normal - camera
    part = region.part
    edge = 0.0
    if part is not None:
        edge = max(abs(one) for one in (part.left_rad, part.right_rad, part.bottom_rad, part.top_rad))
    apart = max(float(angle_between_rad(mirrored, sun)) - edge, 0.0)
    return apart if apart < _NEAR_RAD + _SLOPES * region.surface.slope_rms else float(np.pi)


# Effects that a series of neighbouring scenes leaves out: decided for those that are judged, shared between them


@dataclass(frozen=True, kw_only=True)
class TakenEffects:
    """Effects that act in one scene of a series."""

    acting: frozenset[Effect] = ALL
    left_out: frozenset[Effect] = frozenset()
    spent: float = 0.0


@dataclass(frozen=True, kw_only=True)
class SeriesEffects:
    """How the effects of a series are decided.

    Attributes
    ----------
    acting
        Those that are not left out by request.
    rule
        By bounds, or none is left out.
    planned
        Gives the plan of a scene by this rule; None for the rule "all".

    Notes
    -----
    Only effects of the light are left out, which cost time; those behind the lens cost microseconds.
    """

    acting: frozenset[Effect] = ALL
    rule: EffectRule = "all"
    planned: Callable[[LitScene], EffectPlan] | None = None

    def of(self, scene: LitScene) -> TakenEffects:
        """Return the effects of a scene by a plan of its own."""
        if self.planned is None or self.rule == "all":
            return TakenEffects(acting=self.acting)
        plan = self.planned(scene)
        there = {one.effect for one in plan.decisions if one.bound.largest > 0.0}
        left_out = (LIGHT & self.acting & there) - plan.active
        return self._without(left_out, spent=plan.spent.largest if left_out else 0.0)

    def between(self, scene: LitScene, neighbours: Sequence[TakenEffects]) -> TakenEffects:
        """Return the effects of a scene between others: what all of these leave out.

        Parameters
        ----------
        scene
            To be evaluated.
        neighbours
            As `of` or this gave them.

        Notes
        -----
        Bounds are those of the scene itself, for they are promises.
        """
        left_out = frozenset.intersection(*(one.left_out for one in neighbours))
        if not left_out:
            return TakenEffects(acting=self.acting)
        own = self.of(scene)
        return self._without(left_out & own.left_out, spent=own.spent)

    def _without(self, left_out: frozenset[Effect], *, spent: float) -> TakenEffects:
        return TakenEffects(acting=self.acting - left_out, left_out=left_out, spent=spent if left_out else 0.0)


# Errors of a scene by those of its neighbours: as these have them, or by the errors of their light

# What a scene between judged ones is taken to be off by, over the largest of their errors.
MARGIN = 1.5
# Numbers between 0 and 1. Where one changes by less than this share of how fast it changes elsewhere, it tells nothing.
_PROBABILITIES, _TELLING = frozenset({"p_detection", "auc"}), 0.03
# Below this density a probability does not change by more, whatever the deviate does.
_SATURATED = 1e-5


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """A scene with error estimates of its own."""

    found: AccuratePrediction
    effects: TakenEffects
    companions: Companions

    @cached_property
    def numbers(self) -> Readings:
        """All its numbers."""
        return numbers_of(self.found.result)


def told_errors(neighbours: Sequence[Judged], numbers: Readings) -> dict[Reading, float]:
    """Return the errors of a scene as those of its neighbours tell, of readings of which they do."""
    told = {}
    for key, number in numbers.items():
        errors = [error for one in neighbours for error in _carried(key, number, one)]
        if errors and all(key in one.found.budget.total for one in neighbours):
            told[key] = MARGIN * max(errors)
    return told


def propagated_errors(
    neighbours: Sequence[Judged], cases: Sequence[tuple[LitScene, ChainResult]], *, tolerance: float
) -> list[dict[Reading, float]]:
    """Return the errors of scenes by those of the light of their neighbours, carried to the numbers of each."""
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


# Records of the predictions of a series of neighbouring scenes to a tolerance


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


# Evaluation of scenes of a series: judged, each with error estimates of its own, or by what its neighbours tell

# Cases that stand for others are predicted to this share of the tolerance, so that the margin has room below it.
_OF_TOLERANCE = 0.65
# Cases that begin together, with the plan of the one that needs most, aim at this share of that: a sky and tiles that
# many share cost less than judging more cases for want of room.
_OF_AIM_TOGETHER = 0.5
# Effects are planned of so many cases, and of all others only if these left something out.
_PLANNED = 2


class SeriesEvaluation:
    """Cases of a series that are judged or evaluated by their neighbours, and the time that was taken."""

    def __init__(
        self,
        scenes: Mapping[Index, LitScene],
        *,
        tolerance: float,
        effects: SeriesEffects,
        estimated_only: bool,
        store: LightStore,
        clock: Clock,
    ) -> None:
        """Set the scenes by their places; the rest as `model.accuracy.series.predict_series` has it."""
        self._scenes, self._tolerance, self._effects = scenes, tolerance, effects
        self._estimated_only, self._store, self._clock = estimated_only, store, clock
        self._under_sky = Counter(map(sky, scenes.values()))
        self._planned: list[TakenEffects] = []
        self.judged: dict[Index, Judged] = {}
        self.taken = dict.fromkeys((*STAGES, ESTIMATES), 0.0)

    def judge(self, place: Index) -> Judged:
        """Return a case that is judged, now if it was not before."""
        return self.judge_all((place,))[0]

    def judge_all(
        self, places: Iterable[Index], plan: Plan | None = None, *, share: float = _OF_TOLERANCE
    ) -> list[Judged]:
        """Return cases that are judged: predicted with their errors, which are held against the whole tolerance."""
        places = list(places)
        groups: dict[tuple[object, float | None, TakenEffects], list[Index]] = defaultdict(list)
        for place in dict.fromkeys(places):
            if place not in self.judged:
                scene = self._scenes[place]
                groups[sky(scene), scene.sensor_height_m, self._effects_of(scene)].append(place)
        for (_, _, effects), alike in groups.items():
            self._judge_alike(alike, effects, plan, share)
        return [self.judged[place] for place in places]

    def between(
        self, places: Sequence[Index], effects: frozenset[Effect], corners: Sequence[Judged]
    ) -> dict[Index, ChainResult]:
        """Return what the plan, the rules and the statistics of their neighbours find of cases."""
        lights = [corner.found.result.lights for corner in corners]
        same = all(corner.effects.acting == effects for corner in corners)
        scenes = [self._scenes[place] for place in places]
        tolerance, plan = min(one.found.tolerance for one in corners), finest_plan([one.found.plan for one in corners])
        found = evaluate_all(
            scenes,
            settings_at(plan, tolerance, face_m=scenes[0].sensor_height_m),
            effects=effects,
            rules={name: known_rules([one[name] for one in lights]) for name in lights[0]} if same else {},
            store=self._store,
            clock=self._clock,
        )
        for one in found:
            self._count(one.stage_s)
        return dict(zip(places, found, strict=True))

    def carried_errors(
        self, results: Mapping[Index, ChainResult], corners: Sequence[Judged]
    ) -> dict[Index, dict[Reading, float]]:
        """Return the errors of cases by those of the light of their neighbours."""
        begun, cases = self._clock(), [(self._scenes[place], result) for place, result in results.items()]
        errors = propagated_errors(corners, cases, tolerance=self._tolerance)
        self._count({ESTIMATES: self._clock() - begun})
        return dict(zip(results, errors, strict=True))

    def effects_between(self, place: Index, corners: Sequence[Judged]) -> TakenEffects:
        """Return the effects of a case between judged ones."""
        return self._effects.between(self._scenes[place], [corner.effects for corner in corners])

    def _count(self, stage_s: Mapping[str, float]) -> None:
        for stage, seconds in stage_s.items():
            self.taken[stage] += seconds

    def _effects_of(self, scene: LitScene) -> TakenEffects:
        """Return the effects of a scene: planned where that may pay."""
        if len(self._planned) >= _PLANNED and not any(one.left_out for one in self._planned):
            return TakenEffects(acting=self._effects.acting)
        start = self._clock()
        self._planned.append(self._effects.of(scene))
        self._count({ESTIMATES: self._clock() - start})
        return self._planned[-1]

    def _judge_alike(self, places: Sequence[Index], effects: TakenEffects, plan: Plan | None, share: float) -> None:
        scenes = [self._scenes[place] for place in places]
        allowed = self._tolerance - effects.spent
        aim = max(share * allowed, SMALLEST)
        found = predict_together(
            scenes,
            tolerance=aim,
            start=self._plan(places, effects, aim) if plan is None else plan,
            effects=effects.acting,
            estimated_only=self._estimated_only,
            store=self._store,
            clock=self._clock,
        )
        for place, scene, one in zip(places, scenes, found, strict=True):
            errors = one.budget.total
            missing = {k: why for k, why in one.not_guaranteed.items() if why == SPHERES or not errors[k] <= allowed}
            self._count(one.stage_s)
            self.judged[place] = Judged(
                found=replace(one, not_guaranteed=missing),
                effects=effects,
                companions=companions(scene, one.result),
            )

    def _plan(self, places: Sequence[Index], effects: TakenEffects, aim: float) -> dict[str, int]:
        """Return the finest of the plans that cases beside judged ones begin with; a first one where there is none."""
        if not self.judged:
            scene = self._scenes[places[0]]
            under_sky = self._under_sky[sky(scene)]
            return first_plan(scene, tolerance=aim, store=self._store, effects=effects.acting, under_sky=under_sky)
        beside = aim if len(places) == 1 else _OF_AIM_TOGETHER * aim
        plans = [
            plan_beside(
                self._scenes[place], self._nearest(place), tolerance=beside, store=self._store, effects=effects.acting
            )
            for place in places
        ]
        return finest_plan(plans)

    def _nearest(self, place: Index) -> AccuratePrediction:
        """Return the judged case that is nearest to a place."""
        steps = {one: sum(abs(a - b) for a, b in zip(one, place, strict=True)) for one in self.judged}
        return self.judged[min(steps, key=lambda one: steps[one])].found


def sky(scene: LitScene) -> object:
    """Return what is equal for scenes under one sky."""
    return None if scene.air is None else scene.air.key


# Predictions of neighbouring scenes to a tolerance: plans, rules and error estimates are shared between them

# Errors below this share of the tolerance need not have a smooth course, nor companions of an error.
_SMALL, _NEGLIGIBLE = 0.2, 0.05
# Of so many cells the middle of one is judged, to see whether its errors are what its corners tell.
_SPOT_CHECKED = 4
# Judging a case costs as much as evaluating so many; of what a division could save so much is certain.
_JUDGING, _DEAR = 5.0, 4.0
# Nearer to a glint than its corners by this, a case of a cell is judged, and divides it [rad].
_NEARER_RAD = 0.02
_BY_NEIGHBOUR = "is not promised of a neighbouring case, and its own error was not estimated"


def predict_series(
    scenes: Sequence[LitScene],
    *,
    tolerance: float,
    shape: Index | None = None,
    effects: frozenset[Effect] | SeriesEffects = ALL,
    estimated_only: bool = False,
    store: LightStore | None = None,
    clock: Clock = time.perf_counter,
) -> SeriesPrediction:
    """Return predictions of neighbouring scenes whose numerical error is no more than a tolerance.

    Parameters
    ----------
    scenes
        One or more; in an order in which they change smoothly, as along a sweep; of a grid the last axis fastest.
    shape
        Cases along each axis of a grid; None for one axis.
    effects
        That act, or how that is decided for each scene.
    tolerance, estimated_only, store, clock
        As `model.accuracy.predict.predict` takes them.

    Raises
    ------
    ValueError
        The tolerance, or a number of a scene, is outside its range.

    Notes
    -----
    The corners of a coarse lattice are judged: predicted with error estimates of their own, to 0.65 of the tolerance. A
    case between them takes the finest of their plans and rules; its errors are taken to be 1.5 times the largest of
    theirs. Where that is above the tolerance, or it has numbers that they have not, the errors of their light are
    carried to its own numbers, with the same margin; where these are too large too, or its own evaluation tells more of
    the error of the sky's grid or of the tiles than any of theirs, it is judged itself.

    The course is checked: a cell is divided at a case that is nearer to the sun's mirror direction than its corners. Of
    every fourth cell the middle is judged; where its errors are larger than the corners tell, that cell is divided and
    the middles of all others are judged.
    """
    sizes = (len(scenes),) if shape is None else shape
    places = dict(zip(product(*(range(size) for size in sizes)), scenes, strict=True))
    evaluation = SeriesEvaluation(
        places,
        tolerance=tolerance,
        effects=effects if isinstance(effects, SeriesEffects) else SeriesEffects(acting=effects),
        estimated_only=estimated_only,
        store=LightStore() if store is None else store,
        clock=clock,
    )
    return _Series(places, sizes, tolerance, evaluation).predicted()


class _Refused(Enum):
    """Why a case cannot be had by its neighbours: it is harder than they are, or too little is known of its errors."""

    HARDER, UNSURE = auto(), auto()


class _Series:
    """A series while it is predicted."""

    def __init__(
        self, scenes: Mapping[Index, LitScene], shape: Index, tolerance: float, evaluation: SeriesEvaluation
    ) -> None:
        self._scenes, self._shape, self._tolerance, self._evaluation = scenes, shape, tolerance, evaluation
        self._found: dict[Index, SeriesCase] = {}
        self._spots: list[bool] = []

    def predicted(self) -> SeriesPrediction:
        """Judge some, then take the others by their neighbours."""
        whole = lattice(self._shape)
        # The first alone, for its errors tell by what plan the others begin.
        self._evaluation.judge(whole[0].low)
        self._evaluation.judge_all(self._looked_at(whole))
        cells = [leaf for cell in whole for leaf in self._checked(cell)]
        for cell in self._spot_checked(cells):
            self._fill(cell)
        return SeriesPrediction(
            cases=tuple(self._found[place] for place in self._scenes),
            tolerance=self._tolerance,
            stage_s=self._evaluation.taken,
            spot_checks=len(self._spots),
            spot_checks_held=sum(self._spots),
            estimated_only=any(one.found.estimated_only for one in self._evaluation.judged.values()),
        )

    def _looked_at(self, cells: Iterable[Cell]) -> Iterator[Index]:
        """Yield the corners of cells, and the cases at a glint."""
        for cell in cells:
            yield from cell.corners
            if cell.is_divisible and (glint := self._glint(cell)) is not None:
                yield glint

    def _by_sky(self, places: Iterable[Index]) -> list[Index]:
        """Return cases so ordered that those under one sky follow one another, and none is made twice."""
        skies: dict[object, list[Index]] = {}
        for place in places:
            skies.setdefault(sky(self._scenes[place]), []).append(place)
        return [place for under_one in skies.values() for place in under_one]

    def _checked(self, cell: Cell) -> Iterator[Cell]:
        """Judge the corners of a cell; divide it at a glint, and where one corner makes all that is inside dear."""
        corners = self._evaluation.judge_all(cell.corners)
        if not cell.is_divisible:
            yield cell
        elif (glint := self._glint(cell)) is not None:
            yield from self._divided(cell, glint)
        elif self._is_dear(cell, corners):
            yield from self._divided(cell, cell.middle)
        else:
            yield cell

    def _divided(self, cell: Cell, place: Index) -> Iterator[Cell]:
        self._evaluation.judge(place)
        for part in cell.divided(place):
            yield from self._checked(part)

    def _glint(self, cell: Cell) -> Index | None:
        """Return the case of a cell that is nearest to a glint; None where a corner is."""
        nearest = min(from_glint_rad(self._scenes[place]) for place in cell.corners)
        inside = min(cell.places, key=lambda place: from_glint_rad(self._scenes[place]))
        return inside if from_glint_rad(self._scenes[inside]) < nearest - _NEARER_RAD else None

    def _is_dear(self, cell: Cell, corners: Sequence[Judged]) -> bool:
        """Return whether so many cases would take the plan of one dear corner that judging one more costs less."""
        times = [corner.found.expected_s for corner in corners]
        inside = len(list(cell.places)) - len(corners)
        return inside * (max(times) - min(times)) > _DEAR * _JUDGING * max(times)

    def _spot_checked(self, cells: Sequence[Cell]) -> Iterator[Cell]:
        """Judge the middle of some cells; where one is not as its corners tell divide it, and look at all others."""
        open_cells = [cell for cell in cells if cell.is_divisible]
        looked_at = self._are_as_told(open_cells[::_SPOT_CHECKED])
        if not all(looked_at.values()):
            looked_at |= self._are_as_told([cell for cell in open_cells if cell not in looked_at])
        for cell in cells:
            if looked_at.get(cell, True):
                yield cell
            else:
                yield from self._divided(cell, cell.middle)

    def _are_as_told(self, cells: Sequence[Cell]) -> dict[Cell, bool]:
        """Return whether the errors in the middle of each cell are within what its corners tell."""
        corners = {cell: self._evaluation.judge_all(cell.corners) for cell in cells}
        by_plan: dict[tuple[tuple[str, int], ...], list[Index]] = {}
        for cell in cells:
            if cell.middle not in cell.corners:
                plan = finest_plan([one.found.plan for one in corners[cell]])
                by_plan.setdefault(tuple(plan.items()), []).append(cell.middle)
        for levels, middles in by_plan.items():
            self._evaluation.judge_all(middles, dict(levels))
        told = dict.fromkeys(cells, True)
        for cell in cells:
            if cell.middle not in cell.corners:
                told[cell] = self._holds(self._evaluation.judge(cell.middle), corners[cell])
                self._spots.append(told[cell])
        return told

    def _holds(self, judged: Judged, corners: Sequence[Judged]) -> bool:
        """Return whether the errors of a case are within what its neighbours tell."""
        told = told_errors(corners, judged.numbers)
        small, errors = _SMALL * self._tolerance, judged.found.budget.total
        return all(errors[key] <= max(error, small) for key, error in told.items())

    def _fill(self, cell: Cell) -> None:
        """Predict all cases of a cell; where its corners do not do, judge one of them, and fill the parts."""
        corners = self._evaluation.judge_all(cell.corners)
        judged = self._evaluation.judged
        self._found |= {place: as_judged(judged[place]) for place in cell.places if place in judged}
        left = [place for place in self._by_sky(cell.places) if place not in self._found]
        between = self._between(left, corners)
        self._found |= {place: one for place, one in between.items() if isinstance(one, SeriesCase)}
        refused = {place: one for place, one in between.items() if isinstance(one, _Refused)}
        is_grid = len([size for size in self._shape if size > 1]) > 1
        # They stand for no others.
        last = [place for place, one in refused.items() if one is _Refused.HARDER or is_grid]
        self._found |= zip(last, map(as_judged, self._evaluation.judge_all(last, share=1.0)), strict=True)
        if unsure := [place for place in refused if place not in self._found]:
            inside = _inside(cell, unsure[0])
            if not self._holds(self._evaluation.judge(inside), corners):
                # Its neighbours told too little: what was taken by them is looked at again.
                self._found = {place: one for place, one in self._found.items() if place not in left or one.is_judged}
            for part in cell.divided(inside):
                self._fill(part)

    def _between(self, places: Sequence[Index], corners: Sequence[Judged]) -> "dict[Index, SeriesCase | _Refused]":
        """Return cases by the plans and errors of their neighbours, or why these do not do."""
        effects = {place: self._evaluation.effects_between(place, corners) for place in places}
        found: dict[Index, SeriesCase | _Refused] = {}
        for alike in self._alike(places, effects):
            results = self._evaluation.between(alike, effects[alike[0]].acting, corners)
            found |= self._by_neighbours(results, effects, corners)
        return found

    def _alike(self, places: Sequence[Index], effects: Mapping[Index, TakenEffects]) -> Iterable[list[Index]]:
        """Return cases that can be evaluated together: of the same effects and height."""
        groups: dict[object, list[Index]] = {}
        for place in places:
            groups.setdefault((effects[place].acting, self._scenes[place].sensor_height_m), []).append(place)
        return groups.values()

    def _by_neighbours(
        self, results: Mapping[Index, ChainResult], effects: Mapping[Index, TakenEffects], corners: Sequence[Judged]
    ) -> "dict[Index, SeriesCase | _Refused]":
        """Return cases with the errors that their neighbours tell, or why these do not do."""
        unknown = {key for corner in corners for key in corner.found.not_guaranteed}
        numbers = {place: numbers_of(result) for place, result in results.items()}
        errors = {place: told_errors(corners, found) for place, found in numbers.items()}

        def is_kept(place: Index) -> bool:
            allowed = self._tolerance - effects[place].spent
            return keeps(errors[place], numbers[place], unknown, allowed)

        harder = {place for place, result in results.items() if self._is_harder(place, result, corners)}
        open_results = {place: one for place, one in results.items() if place not in harder and not is_kept(place)}
        errors |= self._evaluation.carried_errors(open_results, corners)
        plan = finest_plan([corner.found.plan for corner in corners])
        found: dict[Index, SeriesCase | _Refused] = dict.fromkeys(results, _Refused.UNSURE)
        found |= dict.fromkeys(harder, _Refused.HARDER)
        for place in results.keys() - harder:
            if is_kept(place):
                found[place] = SeriesCase(
                    result=results[place],
                    plan=plan,
                    errors=errors[place],
                    is_judged=False,
                    not_guaranteed={key: _BY_NEIGHBOUR for key in numbers[place] if key in unknown},
                    effects=effects[place],
                )
        return found

    def _is_harder(self, place: Index, result: ChainResult, corners: Sequence[Judged]) -> bool:
        """Return whether the evaluation of a case tells more of its errors than its corners have."""
        own, others = companions(self._scenes[place], result), [corner.companions for corner in corners]
        return is_harder(own, others, margin=MARGIN, negligible=_NEGLIGIBLE * self._tolerance)


def _inside(cell: Cell, place: Index) -> Index:
    """Return the middle of a cell, or a case of it where all that is between its corners lies along its edges."""
    return place if cell.middle in cell.corners else cell.middle
