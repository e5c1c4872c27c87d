"""Cost of an order of angles: unpolarized light that changes looks polarized, and too few axes tell nothing."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from model.processing.reconstruction import design, reconstruct
from rigctl.files.session_file import SessionFile
from rigctl.numbers.utc_time import NS_PER_S
from rigctl.session.planning.session_steps import Step, plan_steps, step_times_ns

_LEAST_ANGLES = 3
_ANGLE_DECIMALS = 3
_DRIFT_PER_S = 0.01 / 60.0


def false_dolp(steps: Sequence[Step]) -> float | None:
    """Return the DoLP that unpolarized light shows if it grows by 1 % a minute; None with fewer than three angles.

    Parameters
    ----------
    steps : sequence of Step
        Those of one round, or of one cycle: frames of an angle are averaged, as processing does.

    Notes
    -----
    The reconstruction of intensities (1 + drift * mean time of an angle) / 2.
    """
    times: dict[float, list[float]] = defaultdict(list)
    for step, time_ns in zip(steps, step_times_ns(steps, start_ns=0), strict=True):
        if step.kind == "scene" and step.polarizer_angle_deg is not None:
            times[step.polarizer_angle_deg % 180.0].append(time_ns / NS_PER_S)
    if len(times) < _LEAST_ANGLES:
        return None
    angles_deg = sorted(times)
    mean_s = np.array([np.mean(times[angle]) for angle in angles_deg])
    intensity = 0.5 * (1.0 + _DRIFT_PER_S * (mean_s - mean_s.mean()))
    s0, s1, s2 = reconstruct(design(np.deg2rad(angles_deg)), intensity)
    return float(np.hypot(s1, s2) / s0)


def grouping_cost(session: SessionFile) -> str | None:
    """Return in words what drift costs where frames are grouped by angle, or None where they are not."""
    grouped = [take for take in session.take if take.order == "grouped"]
    if not grouped:
        return None
    cost, instead = (
        false_dolp(plan_steps(session.model_copy(update={"take": takes, "darks": None})))
        for takes in (grouped, [take.model_copy(update={"order": "cycles"}) for take in grouped])
    )
    text = "order 'grouped': all frames of an angle come together, so that drift looks like polarization"
    if cost is None or instead is None:
        return text
    return (
        f"{text}: light that drifts by 1 % a minute shows a false DoLP of {cost:.2g}; in cycles it were {instead:.2g}"
    )


def missing_axes(steps: Sequence[Step]) -> str | None:
    """Return in words that a session cannot give a DoLP, or None where it can or takes no scene.

    Parameters
    ----------
    steps : sequence of Step
        Of a whole session.
    """
    targets = [step.polarizer_angle_deg for step in steps if step.kind == "scene"]
    axes = {round(target % 180.0, _ANGLE_DECIMALS) % 180.0 for target in targets if target is not None}
    if not axes or len(axes) >= _LEAST_ANGLES:
        return None
    return (
        f"scene frames have {len(axes)} polarizer axes ({', '.join(f'{axis:g}' for axis in sorted(axes))} deg; angles "
        f"180 deg apart are one): DoLP and AoLP need {_LEAST_ANGLES}, better 0, 90, 45, 135"
    )
