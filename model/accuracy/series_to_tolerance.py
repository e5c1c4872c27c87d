"""Predictions of neighbouring scenes to a tolerance: plans, rules and error estimates are shared between them."""

import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from enum import Enum, auto
from itertools import product

from model.accuracy.estimates.companions import companions, from_glint_rad, is_harder
from model.accuracy.evaluation.chain import STAGES, ChainResult, Clock, evaluate_all
from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.neighbours import MARGIN, Judged, finest_plan, keeps, numbers_of, propagated_errors, told_errors
from model.accuracy.planning.lattice import Cell, Index, lattice
from model.accuracy.planning.numerical_settings import Plan, settings_at
from model.accuracy.predict_to_tolerance import (
    ESTIMATES,
    SMALLEST,
    SPHERES,
    AccuratePrediction,
    plan_beside,
    plan_for_many,
    predict,
)
from model.accuracy.series_effects import SeriesEffects, TakenEffects
from model.accuracy.series_prediction import SeriesCase, SeriesPrediction, as_judged
from model.effects.names import ALL, Effect
from model.scene.field_light import known_rules
from model.scene.lit_scene import LitScene

# Cases that stand for others are predicted to this share of the tolerance, so that the margin has room below it.
_OF_TOLERANCE = 0.65
# Errors below this share of the tolerance need not have a smooth course, nor companions of an error.
_SMALL, _NEGLIGIBLE = 0.2, 0.05
# Of so many cells the middle of one is judged, to see whether its errors are what its corners tell.
_SPOT_CHECKED = 4
# Judging a case costs as much as evaluating so many; of what a division could save so much is certain.
_JUDGING, _DEAR = 5.0, 4.0
# Nearer to a glint than its corners by this, a case of a cell is judged, and divides it [rad].
_NEARER_RAD = 0.02
# Effects are planned of so many cases, and of all others only if these left something out.
_PLANNED = 2
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
        As `model.accuracy.predict_to_tolerance.predict` takes them.

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
    store = LightStore() if store is None else store
    taken = effects if isinstance(effects, SeriesEffects) else SeriesEffects(acting=effects)
    return _Series(scenes, sizes, tolerance, taken, estimated_only, store, clock).predicted()


class _Refused(Enum):
    """Why a case cannot be had by its neighbours: it is harder than they are, or too little is known of its errors."""

    HARDER, UNSURE = auto(), auto()


_HARDER, _UNSURE = _Refused.HARDER, _Refused.UNSURE


class _Series:
    """A series while it is predicted: which cases are judged, and the time that was taken."""

    def __init__(
        self,
        scenes: Sequence[LitScene],
        shape: Index,
        tolerance: float,
        effects: SeriesEffects,
        estimated_only: bool,
        store: LightStore,
        clock: Clock,
    ) -> None:
        self._places = list(product(*(range(size) for size in shape)))
        self._scenes = dict(zip(self._places, scenes, strict=True))
        self._shape, self._tolerance, self._effects = shape, tolerance, effects
        self._estimated_only, self._store, self._clock = estimated_only, store, clock
        self._under_sky = Counter(map(_sky, scenes))
        self._judged: dict[Index, Judged] = {}
        self._found: dict[Index, SeriesCase] = {}
        self._spots: list[bool] = []
        self._taken = dict.fromkeys((*STAGES, ESTIMATES), 0.0)

    def predicted(self) -> SeriesPrediction:
        """Judge some, then take the others by their neighbours."""
        cells = [leaf for cell in lattice(self._shape) for leaf in self._checked(cell)]
        cells = list(self._spot_checked(cells))
        for cell in cells:
            self._fill(cell)
        return SeriesPrediction(
            cases=tuple(self._found[place] for place in self._places),
            tolerance=self._tolerance,
            stage_s=self._taken,
            spot_checks=len(self._spots),
            spot_checks_held=sum(self._spots),
            estimated_only=any(judged.found.estimated_only for judged in self._judged.values()),
        )

    def _by_sky(self, places: Iterable[Index]) -> list[Index]:
        """Return cases so ordered that those under one sky follow one another, and none is made twice."""
        skies: dict[object, list[Index]] = {}
        for place in places:
            skies.setdefault(_sky(self._scenes[place]), []).append(place)
        return [place for under_one in skies.values() for place in under_one]

    def _judge(self, place: Index, plan: Plan | None = None, *, share: float = _OF_TOLERANCE) -> Judged:
        """Predict a case with its errors, to a share of the tolerance; what is above it is held against the whole."""
        if place in self._judged:
            return self._judged[place]
        scene = self._scenes[place]
        start = self._clock()
        effects = self._effects.of(scene) if self._may_leave_out() else TakenEffects(acting=self._effects.acting)
        self._taken[ESTIMATES] += self._clock() - start
        allowed = self._tolerance - effects.spent
        aim, near = max(share * allowed, SMALLEST), self._nearest(place)
        if plan is None and near is None:
            under_sky = self._under_sky[_sky(scene)]
            plan = plan_for_many(scene, tolerance=aim, under_sky=under_sky, effects=effects.acting)
        elif plan is None and near is not None:
            plan = plan_beside(scene, near, tolerance=aim, effects=effects.acting)
        found = predict(
            scene,
            tolerance=aim,
            effects=effects.acting,
            estimated_only=self._estimated_only,
            start=plan,
            store=self._store,
            clock=self._clock,
        )
        errors = found.budget.total
        missing = {k: why for k, why in found.not_guaranteed.items() if why == SPHERES or not errors[k] <= allowed}
        self._count(found.stage_s)
        judged = Judged(
            found=replace(found, not_guaranteed=missing),
            effects=effects,
            companions=companions(scene, found.result),
        )
        self._judged[place] = judged
        return judged

    def _may_leave_out(self) -> bool:
        """Return whether a plan of effects may pay: not where the first two cases left nothing out."""
        taken = [one.effects for one in self._judged.values()]
        return len(taken) < _PLANNED or any(one.left_out for one in taken)

    def _nearest(self, place: Index) -> AccuratePrediction | None:
        """Return the judged case that is nearest to a place."""
        if not self._judged:
            return None
        steps = {one: sum(abs(a - b) for a, b in zip(one, place, strict=True)) for one in self._judged}
        return self._judged[min(steps, key=lambda one: steps[one])].found

    def _checked(self, cell: Cell) -> Iterator[Cell]:
        """Judge the corners of a cell; divide it at a glint, and where one corner makes all that is inside dear."""
        corners = [self._judge(place) for place in cell.corners]
        if not cell.is_divisible:
            yield cell
        elif (glint := self._glint(cell)) is not None:
            yield from self._divided(cell, glint)
        elif self._is_dear(cell, corners):
            yield from self._divided(cell, cell.middle)
        else:
            yield cell

    def _divided(self, cell: Cell, place: Index) -> Iterator[Cell]:
        self._judge(place)
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
        looked_at = {cell: self._is_as_told(cell) for cell in open_cells[::_SPOT_CHECKED]}
        if not all(looked_at.values()):
            looked_at |= {cell: self._is_as_told(cell) for cell in open_cells if cell not in looked_at}
        for cell in cells:
            if looked_at.get(cell, True):
                yield cell
            else:
                yield from self._divided(cell, cell.middle)

    def _is_as_told(self, cell: Cell) -> bool:
        """Return whether the errors in the middle of a cell are within what its corners tell."""
        place = cell.middle
        if place in cell.corners:
            return True
        corners = [self._judge(corner) for corner in cell.corners]
        held = self._holds(self._judge(place, finest_plan(corners)), corners)
        self._spots.append(held)
        return held

    def _holds(self, judged: Judged, corners: Sequence[Judged]) -> bool:
        """Return whether the errors of a case are within what its neighbours tell."""
        told = told_errors(corners, judged.numbers)
        small, errors = _SMALL * self._tolerance, judged.found.budget.total
        return all(errors[key] <= max(error, small) for key, error in told.items())

    def _fill(self, cell: Cell) -> None:
        """Predict all cases of a cell; where its corners do not do, judge one of them, and fill the parts."""
        corners = [self._judge(place) for place in cell.corners]
        for place in cell.places:
            if place in self._judged:
                self._found[place] = as_judged(self._judged[place])
        left = [place for place in self._by_sky(cell.places) if place not in self._found]
        unsure = []
        for place, between in self._between(left, corners):
            if isinstance(between, SeriesCase):
                self._found[place] = between
            elif between is _HARDER or len([size for size in self._shape if size > 1]) > 1:
                self._found[place] = as_judged(self._judge(place, share=1.0))
            else:
                unsure.append(place)
        if unsure:
            inside = _inside(cell, unsure[0])
            if not self._holds(self._judge(inside), corners):
                # Its neighbours told too little: what was taken by them is looked at again.
                self._found = {place: one for place, one in self._found.items() if place not in left or one.is_judged}
            for part in cell.divided(inside):
                self._fill(part)

    def _between(
        self, places: Sequence[Index], corners: Sequence[Judged]
    ) -> "Iterator[tuple[Index, SeriesCase | _Refused]]":
        """Yield cases by the plans and errors of their neighbours, or why these do not do."""
        acting = [corner.effects for corner in corners]
        effects = {place: self._effects.between(self._scenes[place], acting) for place in places}
        for alike in self._alike(places, effects):
            found = self._evaluated(alike, effects[alike[0]], corners)
            for place, result in zip(alike, found, strict=True):
                yield place, self._by_neighbours(self._scenes[place], result, effects[place], corners)

    def _alike(self, places: Sequence[Index], effects: Mapping[Index, TakenEffects]) -> Iterable[list[Index]]:
        """Return cases that can be evaluated together: of the same effects and height."""
        groups: dict[object, list[Index]] = {}
        for place in places:
            groups.setdefault((effects[place].acting, self._scenes[place].sensor_height_m), []).append(place)
        return groups.values()

    def _by_neighbours(
        self, scene: LitScene, result: ChainResult, effects: TakenEffects, corners: Sequence[Judged]
    ) -> "SeriesCase | _Refused":
        """Return a case with the errors that its neighbours tell, or why these do not do."""
        unknown, found = {key for corner in corners for key in corner.found.not_guaranteed}, numbers_of(result)
        errors, allowed = told_errors(corners, found), self._tolerance - effects.spent
        others, negligible = [corner.companions for corner in corners], _NEGLIGIBLE * self._tolerance
        if is_harder(companions(scene, result), others, margin=MARGIN, negligible=negligible):
            return _HARDER
        if not keeps(errors, found, unknown, allowed):
            begun = self._clock()
            errors = propagated_errors(corners, scene, result, tolerance=self._tolerance)
            self._taken[ESTIMATES] += self._clock() - begun
        if not keeps(errors, found, unknown, allowed):
            return _UNSURE
        return SeriesCase(
            result=result,
            plan=finest_plan(corners),
            errors=errors,
            is_judged=False,
            not_guaranteed={key: _BY_NEIGHBOUR for key in found if key in unknown},
            effects=effects,
        )

    def _evaluated(
        self, places: Sequence[Index], effects: TakenEffects, corners: Sequence[Judged]
    ) -> tuple[ChainResult, ...]:
        """Evaluate cases with the plan, the rules and the statistics of their neighbours."""
        lights = [corner.found.result.lights for corner in corners]
        same = all(corner.effects.acting == effects.acting for corner in corners)
        scenes, tolerance = [self._scenes[place] for place in places], min(one.found.tolerance for one in corners)
        found = evaluate_all(
            scenes,
            settings_at(finest_plan(corners), tolerance, face_m=scenes[0].sensor_height_m),
            effects=effects.acting,
            rules={name: known_rules([one[name] for one in lights]) for name in lights[0]} if same else {},
            store=self._store,
            clock=self._clock,
        )
        for one in found:
            self._count(one.stage_s)
        return found

    def _count(self, stage_s: Mapping[str, float]) -> None:
        for stage, seconds in stage_s.items():
            self._taken[stage] += seconds


def _sky(scene: LitScene) -> object:
    """Return what is equal for scenes under one sky."""
    return None if scene.air is None else scene.air.key


def _inside(cell: Cell, place: Index) -> Index:
    """Return the middle of a cell, or a case of it where all that is between its corners lies along its edges."""
    return place if cell.middle in cell.corners else cell.middle
