"""Predictions of scenes to a numerical tolerance, in about the least time.

`predict` takes one scene, the scenes of a sweep or grid, or scenes that are scattered over some numbers. Each scene
that is judged goes through the same loop: a plan of numerical settings is chosen by their likely errors and costs, the
chain is evaluated, the errors of its numbers are estimated, and the settings that count are raised until the errors
fit or finer settings do not exist.

Of many scenes only some are judged: the corners of a coarse lattice over the grid, and cases near a glint. A case
between them takes the finest of their plans, and its errors follow from theirs with a margin; where that does not keep
the tolerance the case is judged itself. A single scene is a lattice of one case. Of scattered cases those that lie
together make a cloud, whose outermost cases stand for the corners.
"""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
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
)
from model.accuracy.errors import LightError, LitCase, error_budgets, light_errors
from model.accuracy.plan import (
    LAYERS,
    ROC,
    STREAMS,
    TILES,
    WAVELENGTHS,
    Budget,
    Plan,
    expected_s,
    finer_plan,
    first_plan,
    kept_forecast,
    last_degree,
    optical_depth,
    plan_beside,
    seen,
    settings_at,
)
from model.atmosphere.layers import AerosolKind
from model.effects.effect import ALL, LIGHT, Effect, EffectPlan
from model.numerics import ndtri
from model.scene.field import known_rules
from model.scene.panel import View
from model.scene.scene import LitRegion, LitScene
from model.stokes import angle_between_rad, direction

FloatArray = NDArray[np.float64]
# Place of a case in a grid.
Index = tuple[int, ...]
# Setting to region to the error of its light.
LightErrors = Mapping[str, Mapping[str, LightError]]
# Gives the plan of effects of a scene.
EffectPlanner = Callable[[LitScene], EffectPlan]

# Stage next to those of an evaluation.
ESTIMATES = "error estimates"
# Tolerances that the levels are made for.
SMALLEST, LARGEST = 1e-6, 0.1
# Of deeper air the time of a solution grows with the square of the depth, and finer settings take minutes: one round
# with coarse ones is made, and the result says what it does not keep.
DEEPEST = 12.0
_ROUNDS = 6
_OF_DEEP = {STREAMS: 1, LAYERS: 0, WAVELENGTHS: 1}
_DEEP = "at an optical depth of {:.3g} finer settings take minutes and are not tried"
SPHERES = (
    "aerosol = spheres: no law is established for the error of a scattering matrix with a sharp forward peak; "
    "the estimate is given, and no promise; --estimated-only takes it as it is"
)
# Cases that stand for others are predicted to this share of the tolerance, so that the margin has room below it.
_OF_TOLERANCE = 0.65
# Cases that begin together, with the plan of the one that needs most, aim at this share of that: a sky and tiles that
# many share cost less than judging more cases for want of room.
_OF_AIM_TOGETHER = 0.5
# Effects are planned of so many cases, and of all others only if these left something out.
_PLANNED = 2
# Errors below this share of the tolerance need not have a smooth course, nor companions of an error.
_SMALL, _NEGLIGIBLE = 0.2, 0.05
# Of so many cells the middle of one is judged, to see whether its errors are what its corners tell.
_SPOT_CHECKED = 4
# Judging a case costs as much as evaluating so many; of what a division could save so much is certain.
_JUDGING, _DEAR = 5.0, 4.0
# Nearer to a glint than its corners by this, a case of a cell is judged, and divides it [rad].
_NEARER_RAD = 0.02
_BY_NEIGHBOUR = "is not promised of a neighbouring case, and its own error was not estimated"


@dataclass(frozen=True, kw_only=True, eq=False)
class Predicted:
    """A prediction of one scene with its numerical errors."""

    scene: LitScene
    result: ChainResult
    tolerance: float  #: that the settings aim at
    plan: Plan  #: level of each setting
    budget: Budget  #: errors by setting and in sum, in the units of the tolerance; only the sum where not judged
    light: LightErrors = field(default_factory=dict)  #: errors of the light; empty where not judged
    not_guaranteed: Mapping[Reading, str] = field(default_factory=dict)  #: why an error may exceed the tolerance
    is_judged: bool = True  #: whether errors were estimated of this case, or bounded by those of its neighbours
    left_out: frozenset[Effect] = frozenset()  #: effects of the light that the plan of effects left out
    spent: float = 0.0  #: most that leaving them out may change
    stage_s: Mapping[str, float] = field(default_factory=dict)  #: time of each stage over all rounds [s]
    rounds: int = 1  #: evaluations of the chain
    expected_s: float = 0.0  #: time that an evaluation of the plan is likely to take [s]
    estimated_only: bool = False  #: whether light has errors of which no convergence is known

    @property
    def errors(self) -> Mapping[Reading, float]:
        """Error of each reading."""
        return self.budget.total

    @cached_property
    def numbers(self) -> Readings:
        """All numbers that a tolerance speaks of."""
        return self.result.readings

    def error_of(self, place: str, quantity: str, statistic: str) -> float | None:
        """Return the numerical error of a number in its own unit; None where none is known."""
        key = Reading(place, quantity, statistic)
        error = self.errors.get(key, np.inf)
        return error * self.numbers[key].scale if np.isfinite(error) else None

    @cached_property
    def companions(self) -> dict[str, float]:
        """Numbers that grow with the errors of the sky's grid and of the tiles."""
        return _companions(self.scene, self.result)


@dataclass(frozen=True, kw_only=True, eq=False)
class Predictions:
    """Predictions of scenes to a tolerance."""

    cases: tuple[Predicted, ...]  #: in the order of the scenes
    tolerance: float
    stage_s: Mapping[str, float]  #: time of each stage, and of the error estimates [s]
    spot_checks: int = 0  #: cases judged to see whether their errors are what their neighbours tell
    spot_checks_held: int = 0  #: of them those that held

    @property
    def estimated_only(self) -> bool:
        """Whether no error is promised of light of which no convergence is known."""
        return any(case.estimated_only for case in self.cases)

    @property
    def judged(self) -> int:
        """Number of cases whose errors were estimated themselves."""
        return sum(case.is_judged for case in self.cases)

    @property
    def share_of_estimates(self) -> float:
        """Share of the time that went into error estimates, 0 to 1."""
        total = sum(self.stage_s.values())
        return self.stage_s[ESTIMATES] / total if total > 0.0 else 0.0


def predict(
    scenes: Sequence[LitScene],
    *,
    tolerance: float,
    shape: Index | None = None,
    points: FloatArray | None = None,
    effects: frozenset[Effect] = ALL,
    planned: EffectPlanner | None = None,
    estimated_only: bool = False,
    store: LightStore | None = None,
    clock: Clock = time.perf_counter,
) -> Predictions:
    """Return predictions whose numerical error is no more than a tolerance, in about the least time.

    Parameters
    ----------
    scenes : sequence of LitScene
        One, or several in an order in which they change smoothly, as along a sweep; of a grid the last axis fastest.
    tolerance : float
        1e-6 to 0.1: absolute in DoLP, s1, s2, P_D and the area under its curve; relative in radiance, counts,
        deviations and SNR (S1 and S2 as shares of S0).
    shape : tuple of int or None
        Cases along each axis of a grid; None for one axis.
    points : (N, D) array or None
        The D numbers of each of N scattered scenes that change, in any order; in place of `shape`.
    effects : frozenset of Effect
        That act; what leaving one out costs is not counted here.
    planned : callable or None
        Gives the plan of effects of a scene: effects of the light that it leaves out do not act, and what that may
        change is taken from the tolerance. None leaves out none.
    estimated_only : bool
        Take the errors of aerosol of spheres as they are estimated, though nothing is promised of them.
    store : LightStore or None
        Keeps skies and lights between calls; None for a new one.
    clock : callable
        Seconds, rising.

    Raises
    ------
    ValueError
        The tolerance, or a number of a scene, is outside its range.

    Notes
    -----
    Where a reading would need finer settings than there are, or the convergence of its error is not known, the result
    says so in `not_guaranteed`.

    The corners of a coarse lattice are judged to 0.65 of the tolerance, a single scene to all of it. A case between
    corners takes the finest of their plans and rules; its errors are taken to be 1.5 times the largest of theirs. Where
    that is above the tolerance, or it has numbers that they have not, the errors of their light are carried to its own
    numbers, with the same margin; where these are too large too, or its own evaluation tells more of the error of the
    sky's grid or of the tiles than any of theirs, it is judged itself.

    The course is checked: a cell is divided at a case that is nearer to the sun's mirror direction than its corners. Of
    every fourth cell the middle is judged; where its errors are larger than the corners tell, that cell is divided and
    the middles of all others are judged.
    """
    if not SMALLEST <= tolerance <= LARGEST:
        raise ValueError(f"tolerance = {tolerance:g}, allowed is {SMALLEST:g} to {LARGEST:g}")
    sizes = (len(scenes),) if shape is None else shape
    places = list(product(*(range(size) for size in sizes)))
    whole = cloud(places, np.array(places, dtype=np.float64) if points is None else points)
    run = _Run(
        dict(zip(places, scenes, strict=True)),
        whole=whole,
        cells=lattice(sizes) if points is None else tuple(whole.leaves()),
        tolerance=tolerance,
        acting=effects,
        planned=planned,
        estimated_only=estimated_only,
        store=LightStore() if store is None else store,
        clock=clock,
    )
    return run.predicted()


# Effects of the light that a plan leaves out though they are there, and the most that this may change.
_LeftOut = tuple[frozenset[Effect], float]
_NOTHING_LEFT_OUT: _LeftOut = (frozenset(), 0.0)

# What a scene between judged ones is taken to be off by, over the largest of their errors.
_MARGIN = 1.5
# Numbers between 0 and 1. Where one changes by less than this share of how fast it changes elsewhere, it tells nothing.
_PROBABILITIES, _TELLING = frozenset({"p_detection", "auc"}), 0.03
# Below this density a probability does not change by more, whatever the deviate does.
_SATURATED = 1e-5


class _Run:
    """Scenes while they are predicted: those that are judged, those that follow from their neighbours, and the time."""

    def __init__(
        self,
        scenes: Mapping[Index, LitScene],
        *,
        whole: Cloud,
        cells: Sequence[Cell | Cloud],
        tolerance: float,
        acting: frozenset[Effect],
        planned: EffectPlanner | None,
        estimated_only: bool,
        store: LightStore,
        clock: Clock,
    ) -> None:
        self._scenes, self._whole, self._cells, self._tolerance = scenes, whole, cells, tolerance
        self._acting, self._planned, self._estimated_only = acting, planned, estimated_only
        self._store, self._clock = store, clock
        # A single scene stands for no others.
        self._share = 1.0 if len(scenes) == 1 else _OF_TOLERANCE
        self._under_sky = Counter(map(_sky, scenes.values()))
        self._plans_of_effects: list[_LeftOut] = []
        self._judged: dict[Index, Predicted] = {}
        self._found: dict[Index, Predicted] = {}
        self._spots: list[bool] = []
        self._taken = dict.fromkeys((*STAGES, ESTIMATES), 0.0)

    def predicted(self) -> Predictions:
        """Judge some, then take the others by their neighbours."""
        # The first alone, for its errors tell by what plan the others begin.
        self._judge(self._cells[0].corners[0])
        self._judge_all(self._looked_at(self._cells))
        cells = [leaf for cell in self._cells for leaf in self._checked(cell)]
        for cell in self._spot_checked(cells):
            self._fill(cell)
        return Predictions(
            cases=tuple(self._found[place] for place in self._scenes),
            tolerance=self._tolerance,
            stage_s=self._taken,
            spot_checks=len(self._spots),
            spot_checks_held=sum(self._spots),
        )

    def _looked_at(self, cells: Iterable[Cell | Cloud]) -> Iterator[Index]:
        """Yield the corners of cells, and the cases at a glint."""
        for cell in cells:
            yield from cell.corners
            if cell.is_divisible and (glint := self._glint(cell)) is not None:
                yield glint

    def _by_sky(self, places: Iterable[Index]) -> list[Index]:
        """Return cases so ordered that those under one sky follow one another, and none is made twice."""
        skies: dict[object, list[Index]] = {}
        for place in places:
            skies.setdefault(_sky(self._scenes[place]), []).append(place)
        return [place for under_one in skies.values() for place in under_one]

    def _checked(self, cell: Cell | Cloud) -> Iterator[Cell | Cloud]:
        """Judge the corners of a cell; divide it at a glint, and where one corner makes all that is inside dear."""
        corners = self._judge_all(cell.corners)
        if not cell.is_divisible:
            yield cell
        elif (glint := self._glint(cell)) is not None:
            yield from self._divided(cell, glint)
        elif self._is_dear(cell, corners):
            yield from self._divided(cell, cell.middle)
        else:
            yield cell

    def _divided(self, cell: Cell | Cloud, place: Index) -> Iterator[Cell | Cloud]:
        self._judge(place)
        for part in cell.divided(place):
            yield from self._checked(part)

    def _glint(self, cell: Cell | Cloud) -> Index | None:
        """Return the case of a cell that is nearest to a glint; None where a corner is."""
        nearest = min(_from_glint_rad(self._scenes[place]) for place in cell.corners)
        inside = min(cell.places, key=lambda place: _from_glint_rad(self._scenes[place]))
        return inside if _from_glint_rad(self._scenes[inside]) < nearest - _NEARER_RAD else None

    def _is_dear(self, cell: Cell | Cloud, corners: Sequence[Predicted]) -> bool:
        """Return whether so many cases would take the plan of one dear corner that judging one more costs less."""
        times = [corner.expected_s for corner in corners]
        inside = len(list(cell.places)) - len(corners)
        return inside * (max(times) - min(times)) > _DEAR * _JUDGING * max(times)

    def _spot_checked(self, cells: Sequence[Cell | Cloud]) -> Iterator[Cell | Cloud]:
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

    def _are_as_told(self, cells: Sequence[Cell | Cloud]) -> dict[Cell | Cloud, bool]:
        """Return whether the errors in the middle of each cell are within what its corners tell."""
        corners = {cell: self._judge_all(cell.corners) for cell in cells}
        by_plan: dict[tuple[tuple[str, int], ...], list[Index]] = {}
        for cell in cells:
            if cell.middle not in cell.corners:
                plan = _finest_plan([one.plan for one in corners[cell]])
                by_plan.setdefault(tuple(plan.items()), []).append(cell.middle)
        for levels, middles in by_plan.items():
            self._judge_all(middles, dict(levels))
        told = dict.fromkeys(cells, True)
        for cell in cells:
            if cell.middle not in cell.corners:
                told[cell] = self._holds(self._judge(cell.middle), corners[cell])
                self._spots.append(told[cell])
        return told

    def _holds(self, judged: Predicted, corners: Sequence[Predicted]) -> bool:
        """Return whether the errors of a case are within what its neighbours tell."""
        told = told_errors(corners, judged.numbers)
        small, errors = _SMALL * self._tolerance, judged.errors
        return all(errors[key] <= max(error, small) for key, error in told.items())

    def _fill(self, cell: Cell | Cloud) -> None:
        """Predict all cases of a cell; where its corners do not do, judge one of them, and fill the parts."""
        corners = self._judge_all(cell.corners)
        self._found |= {place: self._judged[place] for place in cell.places if place in self._judged}
        left = [place for place in self._by_sky(cell.places) if place not in self._found]
        between, harder = self._between(left, corners)
        self._found |= between
        # They stand for no others.
        last = [place for place in left if place in harder]
        self._found |= zip(last, self._judge_all(last, share=1.0), strict=True)
        if unsure := [place for place in left if place not in self._found]:
            outermost = self._judge_all(self._whole.part(unsure).corners)
            if not all(self._holds(one, corners) for one in outermost):
                # Its neighbours told too little: what was taken by them is looked at again.
                self._found = {place: one for place, one in self._found.items() if place not in left or one.is_judged}
                unsure = [place for place in left if place not in self._found]
            self._fill(self._whole.part(unsure))

    def _between(
        self, places: Sequence[Index], corners: Sequence[Predicted]
    ) -> tuple[dict[Index, Predicted], set[Index]]:
        """Return cases by the plans and errors of their neighbours where these do, and cases harder than they are."""
        effects = {place: self._effects_between(place, corners) for place in places}
        groups: dict[object, list[Index]] = {}
        for place in places:
            groups.setdefault((effects[place][0], self._scenes[place].sensor_height_m), []).append(place)
        found: dict[Index, Predicted] = {}
        harder: set[Index] = set()
        for alike in groups.values():
            results = self._evaluated_between(alike, effects[alike[0]][0], corners)
            too_hard = {place for place, result in results.items() if self._is_harder(place, result, corners)}
            found |= self._by_neighbours(results, effects, corners, too_hard)
            harder |= too_hard
        return found, harder

    def _evaluated_between(
        self, places: Sequence[Index], left_out: frozenset[Effect], corners: Sequence[Predicted]
    ) -> dict[Index, ChainResult]:
        """Return what the plan, the rules and the statistics of their neighbours find of cases."""
        lights = [corner.result.lights for corner in corners]
        same = all(corner.left_out == left_out for corner in corners)
        scenes = [self._scenes[place] for place in places]
        tolerance, plan = min(one.tolerance for one in corners), _finest_plan([one.plan for one in corners])
        found = evaluate_all(
            scenes,
            settings_at(plan, tolerance, face_m=scenes[0].sensor_height_m),
            effects=self._acting - left_out,
            rules={name: known_rules([one[name] for one in lights]) for name in lights[0]} if same else {},
            store=self._store,
            clock=self._clock,
        )
        for one in found:
            self._count(one.stage_s)
        return dict(zip(places, found, strict=True))

    def _by_neighbours(
        self,
        results: Mapping[Index, ChainResult],
        effects: Mapping[Index, _LeftOut],
        corners: Sequence[Predicted],
        harder: Collection[Index],
    ) -> dict[Index, Predicted]:
        """Return the cases whose errors, as their neighbours tell them, keep the tolerance."""
        unknown = {key for corner in corners for key in corner.not_guaranteed}
        numbers = {place: result.readings for place, result in results.items()}
        errors = {place: told_errors(corners, found) for place, found in numbers.items()}

        def is_kept(place: Index, among: Iterable[Reading]) -> bool:
            return _keeps(errors[place], among, unknown, self._tolerance - effects[place][1])

        # Of some numbers the neighbours tell nothing; where what they tell is too much already it is left at that.
        unsure = [
            place
            for place, told in errors.items()
            if place not in harder and is_kept(place, told) and not is_kept(place, numbers[place])
        ]
        begun = self._clock()
        cases = [(self._scenes[place], results[place]) for place in unsure]
        errors |= zip(unsure, _propagated_errors(corners, cases, tolerance=self._tolerance), strict=True)
        self._count({ESTIMATES: self._clock() - begun})
        plan = _finest_plan([corner.plan for corner in corners])
        return {
            place: Predicted(
                scene=self._scenes[place],
                result=result,
                tolerance=min(corner.tolerance for corner in corners),
                plan=plan,
                budget=Budget(by_setting={}, total=errors[place]),
                is_judged=False,
                not_guaranteed={key: _BY_NEIGHBOUR for key in numbers[place] if key in unknown},
                left_out=effects[place][0],
                spent=effects[place][1],
            )
            for place, result in results.items()
            if place not in harder and is_kept(place, numbers[place])
        }

    def _is_harder(self, place: Index, result: ChainResult, corners: Sequence[Predicted]) -> bool:
        """Return whether the evaluation of a case tells more of its errors than its corners have."""
        own, others = _companions(self._scenes[place], result), [corner.companions for corner in corners]
        return _is_harder(own, others, margin=_MARGIN, negligible=_NEGLIGIBLE * self._tolerance)

    def _judge(self, place: Index) -> Predicted:
        """Return a case that is judged, now if it was not before."""
        return self._judge_all((place,))[0]

    def _judge_all(
        self, places: Iterable[Index], plan: Plan | None = None, *, share: float | None = None
    ) -> list[Predicted]:
        """Return cases that are judged: predicted with their errors, which are held against the whole tolerance."""
        places = list(places)
        groups: dict[tuple[object, float | None, _LeftOut], list[Index]] = defaultdict(list)
        for place in dict.fromkeys(places):
            if place not in self._judged:
                scene = self._scenes[place]
                groups[_sky(scene), scene.sensor_height_m, self._effects_of(scene)].append(place)
        for (_, _, (left_out, spent)), alike in groups.items():
            allowed = self._tolerance - spent
            aim = max((self._share if share is None else share) * allowed, SMALLEST)
            start = self._first_plan(alike, self._acting - left_out, aim) if plan is None else plan
            for place, one in zip(alike, self._to_tolerance(alike, start, left_out, aim, allowed), strict=True):
                self._judged[place] = replace(one, left_out=left_out, spent=spent)
                self._count(one.stage_s)
        return [self._judged[place] for place in places]

    def _to_tolerance(
        self, places: Sequence[Index], start: Plan, left_out: frozenset[Effect], aim: float, allowed: float
    ) -> Iterator[Predicted]:
        """Yield cases under one sky, the first evaluation and errors of all at once, then each refined on its own."""
        scenes, acting = [self._scenes[place] for place in places], self._acting - left_out
        depth, ahead = optical_depth(scenes[0]), kept_forecast(scenes[0], acting, self._store, tolerance=aim)
        is_deep = depth > DEEPEST
        plan = (
            {name: min(level, _OF_DEEP.get(name, level)) for name, level in start.items()} if is_deep else dict(start)
        )
        for scene, found in zip(scenes, self._evaluated(scenes, plan, acting, aim), strict=True):
            while found.rounds < (1 if is_deep else _ROUNDS):
                finer = finer_plan(scene, seen(ahead, scene, found.result), dict(found.plan), found.budget, aim)
                if finer == found.plan:
                    break
                (better,) = self._evaluated((scene,), finer, acting, aim)
                taken = {stage: seconds + found.stage_s[stage] for stage, seconds in better.stage_s.items()}
                found = replace(better, rounds=found.rounds + 1, stage_s=taken)
            why = _not_guaranteed(scene, found.budget, allowed, estimated_only=self._estimated_only)
            if is_deep:
                why = {key: f"{one}; {_DEEP.format(depth)}" for key, one in why.items()}
            yield replace(
                found,
                not_guaranteed=why,
                expected_s=expected_s(scene, dict(found.plan), ahead),
                estimated_only=self._estimated_only and _has_spheres(scene),
            )

    def _evaluated(
        self, scenes: Sequence[LitScene], plan: dict[str, int], acting: frozenset[Effect], tolerance: float
    ) -> list[Predicted]:
        """Return one evaluation of scenes with its errors."""
        settings = settings_at(plan, tolerance, face_m=scenes[0].sensor_height_m)
        results = evaluate_all(scenes, settings, effects=acting, store=self._store, clock=self._clock)
        begun, cases = self._clock(), list(zip(scenes, results, strict=True))
        lights = light_errors(cases, plan, self._store, tolerance=tolerance)
        lit = [LitCase(scene=scene, result=one, lights=of) for (scene, one), of in zip(cases, lights, strict=True)]
        budgets = error_budgets(lit, tolerance=tolerance)
        each_s = (self._clock() - begun) / len(scenes)
        return [
            Predicted(
                scene=scene,
                result=one,
                tolerance=tolerance,
                plan=plan,
                budget=budget,
                light=light,
                stage_s=one.stage_s | {ESTIMATES: each_s},
            )
            for (scene, one), light, budget in zip(cases, lights, budgets, strict=True)
        ]

    def _first_plan(self, places: Sequence[Index], acting: frozenset[Effect], aim: float) -> dict[str, int]:
        """Return the finest of the plans that cases next to judged ones begin with; a first one where there is none."""
        if not self._judged:
            scene = self._scenes[places[0]]
            under_sky = self._under_sky[_sky(scene)]
            return first_plan(scene, tolerance=aim, store=self._store, effects=acting, under_sky=under_sky)
        near = aim if len(places) == 1 else _OF_AIM_TOGETHER * aim
        plans = [
            plan_beside(
                self._scenes[place],
                one.plan,
                one.budget,
                sky=one.result.air_key,
                unsure=one.not_guaranteed,
                tolerance=near,
                store=self._store,
                effects=acting,
            )
            for place, one in ((place, self._nearest(place)) for place in places)
        ]
        return _finest_plan(plans)

    def _nearest(self, place: Index) -> Predicted:
        """Return the judged case that is nearest to a place."""
        steps = {one: sum(abs(a - b) for a, b in zip(one, place, strict=True)) for one in self._judged}
        return self._judged[min(steps, key=lambda one: steps[one])]

    def _effects_of(self, scene: LitScene) -> _LeftOut:
        """Return the effects of the light that a scene leaves out, planned where that may pay, and their sum."""
        if self._planned is None:
            return _NOTHING_LEFT_OUT
        if len(self._plans_of_effects) >= _PLANNED and not any(left_out for left_out, _ in self._plans_of_effects):
            return _NOTHING_LEFT_OUT
        start = self._clock()
        self._plans_of_effects.append(_left_out(self._planned(scene), self._acting))
        self._count({ESTIMATES: self._clock() - start})
        return self._plans_of_effects[-1]

    def _effects_between(self, place: Index, corners: Sequence[Predicted]) -> _LeftOut:
        """Return what a case between judged ones leaves out: what all of these do, within its own bounds."""
        left_out = frozenset.intersection(*(corner.left_out for corner in corners))
        if not left_out or self._planned is None:
            return _NOTHING_LEFT_OUT
        own, spent = _left_out(self._planned(self._scenes[place]), self._acting)
        return (left_out & own, spent) if left_out & own else _NOTHING_LEFT_OUT

    def _count(self, stage_s: Mapping[str, float]) -> None:
        for stage, seconds in stage_s.items():
            self._taken[stage] += seconds


def _left_out(plan: EffectPlan, acting: frozenset[Effect]) -> _LeftOut:
    there = {one.effect for one in plan.decisions if one.bound.largest > 0.0}
    found = (LIGHT & acting & there) - plan.active
    return (found, plan.spent.largest) if found else _NOTHING_LEFT_OUT


def _sky(scene: LitScene) -> object:
    """Return what is equal for scenes under one sky."""
    return None if scene.air is None else scene.air.key


def _not_guaranteed(scene: LitScene, budget: Budget, tolerance: float, *, estimated_only: bool) -> dict[Reading, str]:
    if _has_spheres(scene) and not estimated_only:
        return dict.fromkeys(budget.total, SPHERES)
    return {key: _why(budget, key) for key, error in budget.total.items() if not error <= tolerance}


def _why(budget: Budget, key: Reading) -> str:
    error, most = budget.total[key], max(budget.by_setting, key=lambda name: budget.by_setting[name].get(key, 0.0))
    if np.isfinite(error):
        return f"estimated error {error:.2g}, the most of it by {most}"
    return f"its error has no bound: it is 0, or may not exist, within the errors of the light by {most}"


def _has_spheres(scene: LitScene) -> bool:
    airs = [] if scene.air is None else [scene.air, scene.air.alternative]
    return any(air is not None and air.aerosol is AerosolKind.SPHERES and air.state is not None for air in airs)


def told_errors(neighbours: Sequence[Predicted], numbers: Readings) -> dict[Reading, float]:
    """Return the errors of a scene as those of its neighbours tell, of readings of which they do."""
    told = {}
    for key, number in numbers.items():
        errors = [error for one in neighbours for error in _carried(key, number, one)]
        if errors and all(key in one.budget.total for one in neighbours):
            told[key] = _MARGIN * max(errors)
    return told


def _carried(key: Reading, here: Value, neighbour: Predicted, setting: str | None = None) -> Iterator[float]:
    """Yield an error as it is carried over from a neighbour; nothing where that tells too little of it.

    A probability rises from 0 to 1 within few cases, and has next to no error at either end. The normal deviate that
    has it has a smooth course, and so has its error, but for that of the ROC's own integral.
    """
    budget = neighbour.budget
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


def _propagated_errors(
    neighbours: Sequence[Predicted], cases: Sequence[tuple[LitScene, ChainResult]], *, tolerance: float
) -> list[dict[Reading, float]]:
    """Return the errors of scenes by those of the light of their neighbours, carried to the numbers of each."""
    known = [(one.result, one.light) for one in neighbours]
    lit = [
        LitCase(scene=scene, result=result, lights=_carried_errors(known, result, margin=_MARGIN))
        for scene, result in cases
    ]
    budgets = error_budgets(lit, tolerance=tolerance, tiles=False) if lit else []
    found = []
    for (_, result), budget in zip(cases, budgets, strict=True):
        numbers = result.readings
        of_tiles = {
            key: [error for one in neighbours for error in _carried(key, number, one, TILES)]
            for key, number in numbers.items()
        }
        found.append({key: budget.total[key] + _MARGIN * max(of_tiles[key], default=0.0) for key in numbers})
    return found


# Companions by their name: "sky grid", and the regions with a field.
Companions = Mapping[str, float]
_SKY_GRID = "sky grid"
_DARK = 1e-300
# Farther than this from the sun's mirror direction neither glint nor aureole is in a lobe of such slopes, in rms slopes
# beside it.
_NEAR_RAD, _SLOPES = float(np.radians(15.0)), 4.0


def _carried_errors(
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


def _finest_plan(plans: Sequence[Plan]) -> dict[str, int]:
    """Return the finest level of each setting."""
    return {name: max(plan[name] for plan in plans) for name in plans[0]}


def _keeps(
    errors: Mapping[Reading, float], found: Iterable[Reading], unknown: Collection[Reading], allowed: float
) -> bool:
    """Return whether errors are known of all numbers, and within what is allowed but for those not to be known."""
    return all(key in errors and (errors[key] <= allowed or key in unknown) for key in found)


def _companions(scene: LitScene, result: ChainResult) -> dict[str, float]:
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


def _is_harder(own: Companions, others: Sequence[Companions], *, margin: float, negligible: float) -> bool:
    """Return whether a scene is harder than all neighbours of which the errors are known."""
    return any(
        number > max(negligible, margin * max(one.get(name, 0.0) for one in others)) for name, number in own.items()
    )


def _from_glint_rad(scene: LitScene) -> float:
    """Return how far the sun is from being mirrored to the camera by a region, the least of all; pi where it is far.

    At the mirror direction the lobe has the beam over the field and the aureole before it: what was found on either
    side does not tell of it.
    """
    if scene.air is None or scene.view is None:
        return float(np.pi)
    sun = direction(zenith_rad=scene.air.sun_zenith_rad, azimuth_rad=scene.sun_azimuth_rad)
    found = [_region_from_glint_rad(region, scene.view, sun) for region in scene.regions if region.surface is not None]
    return min(found, default=float(np.pi))


def _region_from_glint_rad(region: LitRegion, view: View, sun: FloatArray) -> float:
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

    def divided(self, place: Index) -> tuple[Cell, ...]:
        """Return the parts that have a case of this one as a corner; along an axis at whose end it is, none is cut."""
        parts = [
            ((low, one), (one, high)) if low < one < high else ((low, high),)
            for low, one, high in zip(self.low, place, self.high, strict=True)
        ]
        return tuple(Cell(low=tuple(a for a, _ in ends), high=tuple(b for _, b in ends)) for ends in product(*parts))


# Scattered cases of a cloud, at most: its corners are an eighth of them, or less.
_IN_CLOUD = 64
# Of more numbers than this its corners are the ends of each; of fewer those of each diagonal.
_MOST_DIAGONALS = 3


@dataclass(frozen=True)
class Cloud:
    """Cases that lie near one another, scattered over some numbers."""

    members: tuple[Index, ...]
    points: Mapping[Index, FloatArray] = field(compare=False, repr=False)  #: of all cases, each number over its range

    def part(self, members: Iterable[Index]) -> Cloud:
        """Return a cloud of some of its cases."""
        return Cloud(tuple(members), self.points)

    @cached_property
    def corners(self) -> tuple[Index, ...]:
        """The outermost cases, each once."""
        own = self._own
        count = own.shape[1]
        ways = np.array(list(product((-1.0, 1.0), repeat=count))) if count <= _MOST_DIAGONALS else np.eye(count)
        ends = np.concatenate([(own @ ways.T).argmax(axis=0), (own @ ways.T).argmin(axis=0)])
        return tuple(dict.fromkeys(self.members[k] for k in ends))

    @property
    def places(self) -> tuple[Index, ...]:
        """All cases, its corners among them."""
        return self.members

    @property
    def middle(self) -> Index:
        """The case in its middle."""
        own = self._own
        return self.members[int(np.square(own - own.mean(axis=0)).sum(axis=1).argmin())]

    @property
    def is_divisible(self) -> bool:
        """True if there are cases between its corners."""
        return len(self.members) > len(self.corners)

    def divided(self, place: Index) -> tuple[Cloud, ...]:
        """Return its halves, both with this case."""
        parts = self._halves([one for one in self.members if one != place])
        return tuple(self.part((place, *half)) for half in parts if half)

    def leaves(self) -> Iterator[Cloud]:
        """Yield clouds that hold no more cases than one should."""
        if len(self.members) <= _IN_CLOUD:
            yield self
            return
        for half in self._halves(self.members):
            yield from self.part(half).leaves()

    def _halves(self, members: Sequence[Index]) -> tuple[tuple[Index, ...], tuple[Index, ...]]:
        """Return cases cut in two across the number that changes most."""
        axis = int(np.ptp(self._own, axis=0).argmax())
        ordered = sorted(members, key=lambda place: float(self.points[place][axis]))
        return tuple(ordered[: len(ordered) // 2]), tuple(ordered[len(ordered) // 2 :])

    @property
    def _own(self) -> FloatArray:
        return np.array([self.points[place] for place in self.members])


def cloud(places: Sequence[Index], points: FloatArray) -> Cloud:
    """Return cases with their numbers, each over its range, as one cloud."""
    span = np.ptp(points, axis=0)
    scaled = points[:, span > 0.0] / span[span > 0.0] if np.any(span > 0.0) else np.zeros((len(points), 1))
    return Cloud(tuple(places), dict(zip(places, scaled, strict=True)))


# Steps of the grid between corners, by the number of its axes: corners are so few that looking at them closely is a
# fifth of the work, or less.
_STEPS = {1: 34, 2: 8}
_STEPS_OF_MORE = 4


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
