"""Prediction to a guaranteed tolerance: settings are raised until the estimated errors fit."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from model.accuracy.chain import ChainResult, Clock, LightStore, Reading, evaluate_all
from model.accuracy.errors import Budget, LightError, LitCase, error_budgets, light_errors_of_all
from model.accuracy.plan import (
    HEMISPHERE,
    LAYERS,
    NUMERICAL_SETTINGS,
    SKY_GRID,
    STREAMS,
    TILES,
    WAVELENGTHS,
    Forecast,
    Plan,
    allocate,
    expected_s,
    forecast,
    optical_depth,
    seen,
    settings_at,
    unused,
)
from model.atmosphere.layers import AerosolKind
from model.effects.names import ALL, Effect
from model.scene.scene import LitScene

# Record of a prediction to a tolerance

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


# Choice of a plan to a tolerance: the first of a scene, one beside a scene that is known, and a finer one

# Share of the tolerance that a plan aims at: first with the errors of the light, of which some numbers show several
# times as much, then with errors as they were estimated for each number.
_FIRST_AIM, _AIM = 0.6, 0.75
# A first plan is no coarser than this, or than a share of a large tolerance: a second one would cost more. Where it
# would have to be finer it is the coarsest: it costs little beside the one that follows, and tells it what counts.
_FIRST_COARSEST, _FIRST_FINEST, _OF_LARGE = 1e-2, 7e-4, 0.25
# A scene alone is planned with so many times the likely error of its rules: a second round costs more than finer ones.
_LIKELY = {HEMISPHERE: 2.0}
_SOLVED = (STREAMS, LAYERS, WAVELENGTHS)
_OF_SKY = (*_SOLVED, SKY_GRID)
# A sky that so many scenes share is solved to this share of the tolerance.
_MANY, _SHARED_AIM = 10, 0.1


def kept_forecast(scene: LitScene, effects: frozenset[Effect], store: LightStore, *, under_sky: int = 1) -> Forecast:
    """Return the forecast of a scene, made once for all under its sky."""
    air = None if scene.air is None else scene.air.key
    return store.once(("forecast", air, effects, under_sky), lambda: forecast(scene, effects, under_sky=under_sky))


def first_plan(
    scene: LitScene, *, tolerance: float, store: LightStore, effects: frozenset[Effect] = ALL, under_sky: int = 1
) -> dict[str, int]:
    """Return the plan to begin with, of a scene of which nothing is known yet."""
    ahead, left_out = kept_forecast(scene, effects, store, under_sky=under_sky), unused(effects)
    are_many = under_sky >= _MANY
    likely = {} if are_many else _LIKELY
    scales = {name: 0.0 if name in left_out else likely.get(name, 1.0) for name in NUMERICAL_SETTINGS}
    plan = dict.fromkeys(NUMERICAL_SETTINGS, 0)
    if are_many:
        finer = allocate(scene, ahead, scales, _SHARED_AIM * tolerance)
        plan |= {name: finer[name] for name in _SOLVED}
    return allocate(scene, ahead, scales, _first_aim(tolerance), start=plan)


def _first_aim(tolerance: float) -> float:
    aim = _FIRST_AIM * tolerance
    return _FIRST_COARSEST if aim < _FIRST_FINEST else min(aim, max(_FIRST_COARSEST, _OF_LARGE * tolerance))


def plan_beside(
    scene: LitScene,
    neighbour: AccuratePrediction,
    *,
    tolerance: float,
    store: LightStore,
    effects: frozenset[Effect] = ALL,
) -> dict[str, int]:
    """Return the plan for a scene much like one that was predicted, were the errors of both as large.

    Definition: the likely errors of the scene, scaled as those of its neighbour were, for those readings that a
    setting, or all together, act on most.
    """
    ahead, left_out = kept_forecast(scene, effects, store), unused(effects)
    plan = _least_beside(scene, neighbour, left_out)
    kept = [key for key in neighbour.budget.total if key not in neighbour.not_guaranteed]
    if not kept:
        return allocate(scene, ahead, dict.fromkeys(plan, 1.0), _first_aim(tolerance), start=plan)
    several = (*(neighbour.budget.by_setting[name] for name in plan), neighbour.budget.total)
    for key in dict.fromkeys(max(kept, key=lambda one: errors.get(one, 0.0)) for errors in several):
        found = _scales(ahead, neighbour.plan, neighbour.budget, key)
        scales = {name: 0.0 if name in left_out else scale for name, scale in found.items()}
        raised = allocate(scene, ahead, scales, _AIM * tolerance, start=plan)
        if ahead.error(raised, scales) > _AIM * tolerance:
            # No levels keep this number: those of the neighbour do as well as the finest of all, which take minutes.
            raised = {name: max(level, neighbour.plan[name]) for name, level in plan.items()}
        plan = raised
    return plan


def _least_beside(scene: LitScene, neighbour: AccuratePrediction, left_out: frozenset[str]) -> dict[str, int]:
    """Levels below which a scene beside another is not tried: its tiles, and the settings of a sky that both have.

    The convergence of the tiles shows once they are seen, and too few of them cost a second evaluation; a sky that was
    solved costs nothing.
    """
    plan = dict.fromkeys(NUMERICAL_SETTINGS, 0)
    if TILES not in left_out:
        plan[TILES] = neighbour.plan[TILES]
    under = neighbour.result.air_key
    if under is not None and scene.air is not None and scene.air.key == under:
        plan |= {name: neighbour.plan[name] for name in _OF_SKY if name not in left_out}
    return plan


def finer_plan(
    scene: LitScene, ahead: Forecast, plan: dict[str, int], budget: Budget, tolerance: float
) -> dict[str, int]:
    """Return a finer plan for the readings that can be brought within the tolerance; the same one if there are none."""
    allowed, finer = _AIM * tolerance, plan
    for key in (key for key, error in budget.total.items() if error > tolerance):
        scales = _scales(ahead, plan, budget, key)
        raised = allocate(scene, ahead, scales, allowed, start=finer)
        if ahead.error(raised, scales) <= allowed:
            finer = raised
    return finer


def _scales(ahead: Forecast, plan: Plan, budget: Budget, key: Reading) -> dict[str, float]:
    """Factors from the likely errors of the settings to those that were estimated of a reading."""
    return {name: budget.by_setting[name].get(key, 0.0) / ahead.errors[name][level] for name, level in plan.items()}


# Prediction to a guaranteed tolerance: settings at least cost, errors estimated, settings raised until they fit

# Tolerances that the levels are made for.
SMALLEST, LARGEST = 1e-6, 0.1
_ROUNDS = 6
# Of deeper air the time of a solution grows with the square of the depth, and finer settings take minutes: one round
# with coarse ones is made, and what it does not keep is said.
DEEPEST = 12.0
_OF_DEEP = {STREAMS: 1, LAYERS: 0, WAVELENGTHS: 1}
_DEEP = "at an optical depth of {:.3g} finer settings take minutes and are not tried"
SPHERES = (
    "aerosol = spheres: no law is established for the error of a scattering matrix with a sharp forward peak; "
    "the estimate is given, and no promise; --estimated-only takes it as it is"
)


def predict(
    scene: LitScene,
    *,
    tolerance: float,
    effects: frozenset[Effect] = ALL,
    estimated_only: bool = False,
    start: Plan | None = None,
    store: LightStore | None = None,
    clock: Clock = time.perf_counter,
) -> AccuratePrediction:
    """Return a prediction whose numerical error is no more than a tolerance, in about the least time.

    Parameters
    ----------
    scene
        To be predicted.
    tolerance
        1e-6 to 0.1: absolute in DoLP, s1, s2, P_D and the area under its curve; relative in radiance, counts,
        deviations and SNR (S1 and S2 as shares of S0).
    effects
        That act; what leaving one out costs is not counted here.
    estimated_only
        Take the errors of aerosol of spheres as they are estimated, though nothing is promised of them.
    start
        Plan to begin with, as `plan_beside` or a neighbouring scene gives it; None for the scene's own.
    store
        Keeps skies and lights between calls; None for a new one.
    clock
        Seconds, rising.

    Raises
    ------
    ValueError
        The tolerance, or a number of the scene, is outside its range.

    Notes
    -----
    Where a reading would need finer settings than there are, or the convergence of its error is not known, the result
    says so in `not_guaranteed`.
    """
    lights = LightStore() if store is None else store
    if start is None:
        start = first_plan(scene, tolerance=tolerance, store=lights, effects=effects)
    return predict_together(
        (scene,),
        tolerance=tolerance,
        start=start,
        effects=effects,
        estimated_only=estimated_only,
        store=lights,
        clock=clock,
    )[0]


def predict_together(
    scenes: Sequence[LitScene],
    *,
    tolerance: float,
    start: Plan,
    store: LightStore,
    effects: frozenset[Effect] = ALL,
    estimated_only: bool = False,
    clock: Clock = time.perf_counter,
) -> tuple[AccuratePrediction, ...]:
    """Return what `predict` does for each of several scenes, with the first evaluation and errors of all at once."""
    if not SMALLEST <= tolerance <= LARGEST:
        raise ValueError(f"tolerance = {tolerance:g}, allowed is {SMALLEST:g} to {LARGEST:g}")
    is_deep = optical_depth(scenes[0]) > DEEPEST
    plan = {name: min(level, _OF_DEEP.get(name, level)) for name, level in start.items()} if is_deep else dict(start)
    ahead = kept_forecast(scenes[0], effects, store)

    def of(some: Sequence[LitScene], plan: dict[str, int]) -> list[_Round]:
        return _evaluated(some, plan, tolerance=tolerance, effects=effects, store=store, clock=clock)

    found = []
    for scene, first in zip(scenes, of(scenes, plan), strict=True):
        rounds = [first]
        while len(rounds) < (1 if is_deep else _ROUNDS):
            last = rounds[-1]
            finer = finer_plan(scene, seen(ahead, scene, last.result), last.plan, last.budget, tolerance)
            if finer == last.plan:
                break
            rounds += of((scene,), finer)
        expected = expected_s(scene, rounds[-1].plan, ahead)
        found.append(_accurate(scene, rounds, tolerance, expected, estimated_only=estimated_only))
    return tuple(found)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Round:
    """One evaluation of a scene with its errors, as `AccuratePrediction` has them, and the time of each stage [s]."""

    plan: dict[str, int]
    result: ChainResult
    light: Mapping[str, Mapping[str, LightError]]
    budget: Budget
    taken: Mapping[str, float]


def _accurate(
    scene: LitScene, rounds: Sequence[_Round], tolerance: float, expected: float, *, estimated_only: bool
) -> AccuratePrediction:
    last, depth = rounds[-1], optical_depth(scene)
    why = _not_guaranteed(scene, last.budget, tolerance, estimated_only=estimated_only)
    if depth > DEEPEST:
        why = {key: f"{one}; {_DEEP.format(depth)}" for key, one in why.items()}
    return AccuratePrediction(
        result=last.result,
        tolerance=tolerance,
        plan=last.plan,
        budget=last.budget,
        light=last.light,
        not_guaranteed=why,
        stage_s={stage: sum(one.taken[stage] for one in rounds) for stage in last.taken},
        rounds=len(rounds),
        expected_s=expected,
        estimated_only=estimated_only and _has_spheres(scene),
    )


def _evaluated(
    scenes: Sequence[LitScene],
    plan: dict[str, int],
    *,
    tolerance: float,
    effects: frozenset[Effect],
    store: LightStore,
    clock: Clock,
) -> list[_Round]:
    settings = settings_at(plan, tolerance, face_m=scenes[0].sensor_height_m)
    results = evaluate_all(scenes, settings, effects=effects, store=store, clock=clock)
    begun, cases = clock(), list(zip(scenes, results, strict=True))
    lights = light_errors_of_all(cases, plan, store, tolerance=tolerance)
    lit = [LitCase(scene=scene, result=one, lights=of) for (scene, one), of in zip(cases, lights, strict=True)]
    budgets = error_budgets(lit, tolerance=tolerance)
    each_s = (clock() - begun) / len(scenes)
    return [
        _Round(plan=plan, result=one, light=light, budget=budget, taken=one.stage_s | {ESTIMATES: each_s})
        for one, light, budget in zip(results, lights, budgets, strict=True)
    ]


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
