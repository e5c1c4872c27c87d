"""Predictions of neighbouring scenes to a tolerance: plans, rules and error estimates are shared between them."""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import Enum, auto
from itertools import product

from model.accuracy.estimates.companions import companions, from_glint_rad, is_harder
from model.accuracy.evaluation.chain import ChainResult, Clock
from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.neighbours import MARGIN, Judged, finest_plan, keeps, numbers_of, told_errors
from model.accuracy.planning.lattice import Cell, Index, lattice
from model.accuracy.series_effects import SeriesEffects, TakenEffects
from model.accuracy.series_evaluation import SeriesEvaluation, sky
from model.accuracy.series_prediction import SeriesCase, SeriesPrediction, as_judged
from model.effects.names import ALL, Effect
from model.scene.lit_scene import LitScene

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
