"""Prediction to a guaranteed tolerance: settings at least cost, errors estimated, settings raised until they fit."""

import time
from collections.abc import Mapping
from dataclasses import dataclass

from model.accuracy.estimates.error_budget import Budget, error_budget
from model.accuracy.estimates.light_error import LightError, light_errors
from model.accuracy.evaluation.chain import STAGES, ChainResult, Clock, evaluate
from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.evaluation.quantities import Reading
from model.accuracy.planning.budget_allocation import allocate, expected_s
from model.accuracy.planning.forecast import Forecast, forecast, optical_depth, seen, unused
from model.accuracy.planning.numerical_settings import (
    HEMISPHERE,
    LAYERS,
    NUMERICAL_SETTINGS,
    SKY_GRID,
    STREAMS,
    TILES,
    WAVELENGTHS,
    Plan,
    settings_at,
)
from model.atmosphere.transfer.phase import AerosolKind
from model.effects.names import ALL, Effect
from model.scene.lit_scene import LitScene

ESTIMATES = "error estimates"
# Tolerances that the levels are made for.
SMALLEST, LARGEST = 1e-6, 0.1
# Share of the tolerance that a plan aims at: first with the errors of the light, of which some numbers show several
# times as much, then with errors as they were estimated for each number.
_FIRST_AIM, _AIM = 0.6, 0.75
# A first plan is no coarser than this, or than a share of a large tolerance: a second one would cost more. Where it
# would have to be finer it is the coarsest: it costs little beside the one that follows, and tells it what counts.
_FIRST_COARSEST, _FIRST_FINEST, _OF_LARGE = 1e-2, 7e-4, 0.25
_ROUNDS = 6
# A scene alone is planned with so many times the likely error of its rules: a second round costs more than finer ones.
_LIKELY = {HEMISPHERE: 2.0}
_SOLVED = (STREAMS, LAYERS, WAVELENGTHS)
_OF_SKY = (*_SOLVED, SKY_GRID)
# A sky that so many scenes share is solved to this share of the tolerance.
_MANY, _SHARED_AIM = 10, 0.1
# Of deeper air the time of a solution grows with the square of the depth, and finer settings take minutes: one round
# with coarse ones is made, and what it does not keep is said.
DEEPEST = 12.0
_OF_DEEP = {STREAMS: 1, LAYERS: 0, WAVELENGTHS: 1}
_DEEP = "at an optical depth of {:.3g} finer settings take minutes and are not tried"
SPHERES = (
    "aerosol = spheres: no law is established for the error of a scattering matrix with a sharp forward peak; "
    "the estimate is given, and no promise; --estimated-only takes it as it is"
)


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
    if not SMALLEST <= tolerance <= LARGEST:
        raise ValueError(f"tolerance = {tolerance:g}, allowed is {SMALLEST:g} to {LARGEST:g}")
    lights = LightStore() if store is None else store
    taken = dict.fromkeys((*STAGES, ESTIMATES), 0.0)
    ahead = forecast(scene, effects)
    left_out = unused(effects)
    scales = {name: 0.0 if name in left_out else _LIKELY.get(name, 1.0) for name in NUMERICAL_SETTINGS}
    plan = allocate(scene, ahead, scales, _first_aim(tolerance)) if start is None else dict(start)
    most_rounds = _ROUNDS
    if (depth := optical_depth(scene)) > DEEPEST:
        plan, most_rounds = {name: min(level, _OF_DEEP.get(name, level)) for name, level in plan.items()}, 1
    for rounds in range(1, most_rounds + 1):
        settings = settings_at(plan, tolerance, face_m=scene.sensor_height_m)
        result = evaluate(scene, settings, effects=effects, store=lights, clock=clock)
        begun = clock()
        errors = light_errors(scene, plan, result, lights, tolerance=tolerance)
        budget = error_budget(scene, result, errors, tolerance=tolerance)
        taken[ESTIMATES] += clock() - begun
        for stage, seconds in result.stage_s.items():
            taken[stage] += seconds
        finer = _finer(scene, seen(ahead, scene, result), plan, budget, tolerance)
        if finer == plan or rounds == most_rounds:
            break
        plan = finer
    return AccuratePrediction(
        result=result,
        tolerance=tolerance,
        plan=plan,
        budget=budget,
        light=errors,
        not_guaranteed={
            key: f"{why}; {_DEEP.format(depth)}" if depth > DEEPEST else why
            for key, why in _not_guaranteed(scene, budget, tolerance, estimated_only=estimated_only).items()
        },
        stage_s=taken,
        rounds=rounds,
        expected_s=expected_s(scene, plan, ahead),
        estimated_only=estimated_only and _has_spheres(scene),
    )


def _first_aim(tolerance: float) -> float:
    aim = _FIRST_AIM * tolerance
    return _FIRST_COARSEST if aim < _FIRST_FINEST else min(aim, max(_FIRST_COARSEST, _OF_LARGE * tolerance))


def plan_for_many(
    scene: LitScene, *, tolerance: float, under_sky: int, effects: frozenset[Effect] = ALL
) -> dict[str, int]:
    """Return the plan for the first of several scenes, with a sky that will do for many under it.

    Parameters
    ----------
    scene, tolerance, effects
        As `predict` takes them.
    under_sky
        Scenes under its sky.

    Notes
    -----
    A sky that is made once costs less than one that is made again, finer, for the next of them.
    """
    ahead, left_out = forecast(scene, effects, under_sky=under_sky), unused(effects)
    few = under_sky < _MANY
    scales = {name: 0.0 if name in left_out else _LIKELY.get(name, 1.0) if few else 1.0 for name in NUMERICAL_SETTINGS}
    plan = dict.fromkeys(NUMERICAL_SETTINGS, 0)
    if not few:
        finer = allocate(scene, ahead, scales, _SHARED_AIM * tolerance)
        plan |= {name: finer[name] for name in _SOLVED}
    return allocate(scene, ahead, scales, _first_aim(tolerance), start=plan)


def plan_beside(
    scene: LitScene, neighbour: AccuratePrediction, *, tolerance: float, effects: frozenset[Effect] = ALL
) -> dict[str, int]:
    """Return the plan for a scene much like one that was predicted, were the errors of both as large.

    Parameters
    ----------
    scene, tolerance, effects
        As `predict` takes them.
    neighbour
        What was predicted, and the errors that were estimated.

    References
    ----------
    Definition: the likely errors of the scene, scaled as those of its neighbour were, for those readings that a
    setting, or all together, act on most.
    """
    ahead, left_out = forecast(scene, effects), unused(effects)
    plan = _least_beside(scene, neighbour, left_out)
    kept = [key for key in neighbour.budget.total if key not in neighbour.not_guaranteed]
    if not kept:
        return allocate(scene, ahead, dict.fromkeys(plan, 1.0), _first_aim(tolerance), start=plan)
    several = (*(neighbour.budget.by_setting[name] for name in plan), neighbour.budget.total)
    for key in dict.fromkeys(max(kept, key=lambda one: errors.get(one, 0.0)) for errors in several):
        found = _scales(ahead, neighbour.plan, neighbour.budget, key)
        scales = {name: 0.0 if name in left_out else scale for name, scale in found.items()}
        plan = allocate(scene, ahead, scales, _AIM * tolerance, start=plan)
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


def _finer(scene: LitScene, ahead: Forecast, plan: dict[str, int], budget: Budget, tolerance: float) -> dict[str, int]:
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


def _not_guaranteed(scene: LitScene, budget: Budget, tolerance: float, *, estimated_only: bool) -> dict[Reading, str]:
    if _has_spheres(scene) and not estimated_only:
        return dict.fromkeys(budget.total, SPHERES)
    return {
        key: f"estimated error {error:.2g}, the most of it by {_most(budget, key)}"
        for key, error in budget.total.items()
        if not error <= tolerance
    }


def _most(budget: Budget, key: Reading) -> str:
    return max(budget.by_setting, key=lambda setting: budget.by_setting[setting].get(key, 0.0))


def _has_spheres(scene: LitScene) -> bool:
    airs = [] if scene.air is None else [scene.air, scene.air.alternative]
    return any(air is not None and air.aerosol is AerosolKind.SPHERES and air.state is not None for air in airs)
