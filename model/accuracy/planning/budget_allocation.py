"""Allocation of the error budget: levels of the settings at least time whose expected errors sum to what is allowed."""

from collections.abc import Mapping

from model.accuracy.planning.forecast import Forecast
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
from model.scene.lit_scene import LitScene

# Seconds, on one core: a wavelength solved with the least of all, its sky read on the smallest grid, one line of sight.
_SOLVED_S, _READ_S, _SEEN_S = 0.008, 0.005, 0.0005
# In the time of so many lines of sight, out of many that are computed together, one alone is.
_LINES_OF_POINT = 12.0
# What the readings of a solution cost more with its streams and layers than the solution itself: less.
_READING = 0.6


def expected_s(scene: LitScene, plan: Plan, ahead: Forecast) -> float:
    """Return the time that a plan is likely to take, of a sky that several scenes share a share [s].

    Parameters
    ----------
    scene
        To be evaluated.
    plan
        Level of each setting.
    ahead
        What each level is likely to cost.
    """
    effort = {name: ahead.efforts[name][level] for name, level in plan.items()}
    solver = effort[STREAMS] * effort[LAYERS]
    sky = _SOLVED_S * solver + _READ_S * effort[SKY_GRID] * float(solver**_READING)
    seen = [region for region in scene.regions if region.surface is not None]
    lines = sum(_LINES_OF_POINT if region.part is None else effort[TILES] for region in seen)
    return effort[WAVELENGTHS] * sky / ahead.under_sky + _SEEN_S * lines * effort[HEMISPHERE]


def allocate(
    scene: LitScene, ahead: Forecast, scales: Mapping[str, float], allowed: float, *, start: Plan | None = None
) -> dict[str, int]:
    """Return the cheapest plan whose expected errors sum to no more than is allowed, or the finest of all.

    Parameters
    ----------
    scene
        To be evaluated.
    ahead
        Likely error and effort of each level.
    scales
        By what the likely error of each setting is to be multiplied.
    allowed
        Sum of errors.
    start
        Levels not to go below; None for the lowest.

    Notes
    -----
    From the lowest levels that setting is raised, again and again, and by as many levels, which takes off most error
    per second; in the end what the last steps made superfluous is taken back. For errors that fall as powers of the
    time this ends where each error times its power is in proportion to its time.

    References
    ----------
    Definition: steepest descent.
    """
    lowest = dict.fromkeys(NUMERICAL_SETTINGS, 0) if start is None else dict(start)
    plan = dict(lowest)
    while ahead.error(plan, scales) > allowed:
        raised = [
            {**plan, name: level}
            for name in NUMERICAL_SETTINGS
            for level in range(plan[name] + 1, len(NUMERICAL_SETTINGS[name].levels))
        ]
        if not raised:
            return plan
        plan = max(raised, key=lambda finer: _gain(scene, plan, finer, ahead, scales))
    return _without_the_superfluous(scene, ahead, scales, allowed, plan, lowest)


def _without_the_superfluous(
    scene: LitScene, ahead: Forecast, scales: Mapping[str, float], allowed: float, plan: dict[str, int], lowest: Plan
) -> dict[str, int]:
    """Lower settings, each time by the level that saves most time, while the errors stay within what is allowed."""
    while True:
        lowered = [{**plan, name: plan[name] - 1} for name in NUMERICAL_SETTINGS if plan[name] > lowest[name]]
        within = [coarser for coarser in lowered if ahead.error(coarser, scales) <= allowed]
        if not within:
            return plan
        plan = min(within, key=lambda coarser: expected_s(scene, coarser, ahead))


def _gain(scene: LitScene, plan: Plan, finer: Plan, ahead: Forecast, scales: Mapping[str, float]) -> float:
    """Error that a finer plan takes off, per second."""
    less = ahead.error(plan, scales) - ahead.error(finer, scales)
    return less / max(expected_s(scene, finer, ahead) - expected_s(scene, plan, ahead), 1e-6)
