"""Choice of a plan to a tolerance: the first of a scene, one beside a scene that is known, and a finer one."""

from model.accuracy.accurate_prediction import AccuratePrediction
from model.accuracy.estimates.error_budget import Budget
from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.evaluation.quantities import Reading
from model.accuracy.planning.budget_allocation import allocate
from model.accuracy.planning.forecast import Forecast, forecast, unused
from model.accuracy.planning.numerical_settings import (
    HEMISPHERE,
    LAYERS,
    NUMERICAL_SETTINGS,
    SKY_GRID,
    STREAMS,
    TILES,
    WAVELENGTHS,
    Plan,
)
from model.effects.names import ALL, Effect
from model.scene.lit_scene import LitScene

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
    """Return the forecast of a scene, made once for all under its sky.

    Parameters
    ----------
    scene, effects, under_sky
        As `model.accuracy.planning.forecast.forecast` takes them.
    store
        Keeps it.
    """
    air = None if scene.air is None else scene.air.key
    return store.once(("forecast", air, effects, under_sky), lambda: forecast(scene, effects, under_sky=under_sky))


def first_plan(
    scene: LitScene, *, tolerance: float, store: LightStore, effects: frozenset[Effect] = ALL, under_sky: int = 1
) -> dict[str, int]:
    """Return the plan to begin with, of a scene of which nothing is known yet.

    Parameters
    ----------
    scene, tolerance, store, effects
        As `model.accuracy.predict_to_tolerance.predict` takes them.
    under_sky
        Scenes under its sky. Where they are many it is solved so that it will do for all of them: a sky that is made
        once costs less than one that is made again, finer, for the next of them.
    """
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

    Parameters
    ----------
    scene, tolerance, store, effects
        As `model.accuracy.predict_to_tolerance.predict` takes them.
    neighbour
        What was predicted, and the errors that were estimated.

    References
    ----------
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
    """Return a finer plan for the readings that can be brought within the tolerance; the same one if there are none.

    Parameters
    ----------
    scene, tolerance
        As `model.accuracy.predict_to_tolerance.predict` takes them.
    ahead
        Forecast, with what was seen of the scene.
    plan, budget
        That was evaluated, and the errors that were estimated.
    """
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
