"""Prediction to a guaranteed tolerance: settings at least cost, errors estimated, settings raised until they fit."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from model.accuracy.accurate_prediction import ESTIMATES, AccuratePrediction
from model.accuracy.estimates.error_budget import Budget, LitCase, error_budgets
from model.accuracy.estimates.light_error import LightError, light_errors_of_all
from model.accuracy.evaluation.chain import ChainResult, Clock, evaluate_all
from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.evaluation.quantities import Reading
from model.accuracy.plan_choice import finer_plan, first_plan, kept_forecast
from model.accuracy.planning.budget_allocation import expected_s
from model.accuracy.planning.forecast import optical_depth, seen
from model.accuracy.planning.numerical_settings import LAYERS, STREAMS, WAVELENGTHS, Plan, settings_at
from model.atmosphere.transfer.phase import AerosolKind
from model.effects.names import ALL, Effect
from model.scene.lit_scene import LitScene

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
    """Return what `predict` does for each of several scenes, with the first evaluation and the errors of all at once.

    Parameters
    ----------
    scenes
        Under one sky, from one height, with the same regions and pairs.
    tolerance, start, store, effects, estimated_only, clock
        As in `predict`.

    Raises
    ------
    ValueError
        As `predict`.
    """
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
