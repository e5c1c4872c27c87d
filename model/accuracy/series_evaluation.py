"""Evaluation of scenes of a series: judged, each with error estimates of its own, or by what its neighbours tell."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from model.accuracy.accurate_prediction import ESTIMATES, AccuratePrediction
from model.accuracy.estimates.companions import companions
from model.accuracy.evaluation.chain import STAGES, ChainResult, Clock, evaluate_all
from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.evaluation.quantities import Reading
from model.accuracy.neighbours import Judged, finest_plan, propagated_errors
from model.accuracy.plan_choice import first_plan, plan_beside
from model.accuracy.planning.lattice import Index
from model.accuracy.planning.numerical_settings import Plan, settings_at
from model.accuracy.predict_to_tolerance import SMALLEST, SPHERES, predict_together
from model.accuracy.series_effects import SeriesEffects, TakenEffects
from model.effects.names import Effect
from model.scene.field_light import known_rules
from model.scene.lit_scene import LitScene

# Cases that stand for others are predicted to this share of the tolerance, so that the margin has room below it.
_OF_TOLERANCE = 0.65
# Cases that begin together, with the plan of the one that needs most, aim at this share of that: a sky and tiles that
# many share cost less than judging more cases for want of room.
_OF_AIM_TOGETHER = 0.5
# Effects are planned of so many cases, and of all others only if these left something out.
_PLANNED = 2


class SeriesEvaluation:
    """Cases of a series that are judged or evaluated by their neighbours, and the time that was taken.

    Attributes
    ----------
    judged
        Place to what was found.
    taken
        Stage to its time, that of the error estimates beside them [s].
    """

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
        """Set the scenes by their places; the rest as `model.accuracy.series_to_tolerance.predict_series` has it."""
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
        """Return cases that are judged: predicted with their errors, which are held against the whole tolerance.

        Parameters
        ----------
        places
            Of the cases; those under one sky with the same effects are evaluated together, by one plan.
        plan
            To begin with; None for one beside the nearest judged case.
        share
            Of the tolerance, to which those are predicted that were not judged before.
        """
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
        """Return what the plan, the rules and the statistics of their neighbours find of cases.

        Parameters
        ----------
        places
            Of the cases, from one height.
        effects
            That act.
        corners
            Judged cases, between which they lie.
        """
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
        """Return the errors of cases by those of the light of their neighbours.

        Parameters
        ----------
        results
            What was found of cases by their neighbours.
        corners
            These.
        """
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
