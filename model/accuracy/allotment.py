"""Which level of each knob: the least time for which the errors that are to be expected sum to no more than allowed."""

from collections.abc import Mapping

from model.accuracy.knobs import HEMISPHERE, KNOBS, LAYERS, SKY_GRID, STREAMS, TILES, WAVELENGTHS, Plan
from model.lit_scene import LitScene

# Seconds, on one core: a wavelength solved with the least of all, its sky read on the smallest grid, one line of sight.
_SOLVED_S, _READ_S, _SEEN_S = 0.012, 0.006, 0.003
# What the readings of a solution cost more with its streams and layers than the solution itself: less.
_READING = 0.6


def expected_s(scene: LitScene, plan: Plan) -> float:
    """Return the time that a plan is likely to take [s].

    Parameters
    ----------
    scene
        To be evaluated.
    plan
        Level of each knob.
    """
    effort = {name: knob.levels[plan[name]].effort for name, knob in KNOBS.items()}
    solver = effort[STREAMS] * effort[LAYERS]
    sky = _SOLVED_S * solver + _READ_S * effort[SKY_GRID] * float(solver**_READING)
    lines = sum(1.0 if region.part is None else effort[TILES] for region in scene.regions if region.surface is not None)
    return effort[WAVELENGTHS] * sky + _SEEN_S * lines * effort[HEMISPHERE]


def expected_error(plan: Plan, scales: Mapping[str, float]) -> float:
    """Return the sum of the errors that are to be expected.

    Parameters
    ----------
    plan
        Level of each knob.
    scales
        By what the likely error of each knob is to be multiplied.
    """
    return sum(scales[name] * knob.levels[plan[name]].error for name, knob in KNOBS.items())


def allot(scene: LitScene, scales: Mapping[str, float], allowed: float, *, start: Plan | None = None) -> dict[str, int]:
    """Return the cheapest plan whose expected errors sum to no more than is allowed, or the finest of all.

    Parameters
    ----------
    scene
        To be evaluated.
    scales
        By what the likely error of each knob is to be multiplied in this scene.
    allowed
        Sum of errors.
    start
        Levels not to go below; None for the lowest.

    Notes
    -----
    From the lowest levels that knob is raised, again and again, which takes off most error per second. For errors that
    fall as powers of the time this ends where each error times its power is in proportion to its time.

    References
    ----------
    Definition: steepest descent.
    """
    plan = dict.fromkeys(KNOBS, 0) if start is None else dict(start)
    while expected_error(plan, scales) > allowed:
        open_knobs = [name for name, knob in KNOBS.items() if plan[name] + 1 < len(knob.levels)]
        if not open_knobs:
            return plan
        best = max(open_knobs, key=lambda name: _gain(scene, plan, name, scales))
        plan[best] += 1
    return plan


def _gain(scene: LitScene, plan: Plan, name: str, scales: Mapping[str, float]) -> float:
    """Error that one level more takes off, per second."""
    levels = KNOBS[name].levels
    less = scales[name] * (levels[plan[name]].error - levels[plan[name] + 1].error)
    raised = {**plan, name: plan[name] + 1}
    return less / max(expected_s(scene, raised) - expected_s(scene, plan), 1e-6)
