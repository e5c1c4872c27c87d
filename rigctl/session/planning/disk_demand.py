"""Demand of a session on the disk: bytes in all, and the period of frames where it is fastest."""

from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.session.planning.session_plan import plan_session
from rigctl.session.planning.session_steps import Step, planned_exposure_s

# So many frames may wait for the disk: a faster stretch that is shorter than twice this does no harm.
_QUEUE = 4
_STRETCH = 2 * _QUEUE
# The fastest stage here turns between two angles in so long [s].
_SHORTEST_MOVE_S = 0.2
# Reading out and sending a picture, at 1 Gbit/s and 782 x 582 [s].
_FAST_CAMERA_S = 0.007


@dataclass(frozen=True, kw_only=True)
class DiskDemand:
    """Demand on the disk.

    Attributes
    ----------
    frame_bytes : int
        Of one frame's file.
    period_s : float
        Mean time from frame to frame in the fastest stretch of eight frames [s].
    total_bytes : int or None
        Of all frames; None where no session is known.
    """

    frame_bytes: int
    period_s: float
    total_bytes: int | None = None


def demand_of(
    rig: RigFile, session: SessionFile, *, pixels: int, now_ns: int, camera_s: float | None = None
) -> DiskDemand:
    """Return what a session asks of the disk if it begins now.

    Parameters
    ----------
    rig, session
        What is taken, and with which devices.
    pixels : int
        Of a picture.
    now_ns : int
        Now [ns since 1970 UTC].
    camera_s : float or None
        What a picture takes beside its exposure [s]; None, not known: what a fast camera takes.

    Raises
    ------
    ConfigError
        The schedule has no round.
    """
    plan = plan_session(rig, session, now_ns=now_ns, pixels=pixels)
    total = plan.disk_bytes or 0
    beside_s = _FAST_CAMERA_S if camera_s is None else camera_s
    return DiskDemand(
        frame_bytes=total // len(plan.steps), period_s=_fastest_period_s(plan.steps, beside_s), total_bytes=total
    )


def _fastest_period_s(steps: Sequence[Step], camera_s: float) -> float:
    periods_s = [
        camera_s + planned_exposure_s(step) + (_SHORTEST_MOVE_S if _turns(before, step) else 0.0)
        if step.begins_exposure
        else 0.0
        for before, step in zip((None, *steps), steps, strict=False)
    ]
    length = min(_STRETCH, len(periods_s))
    stretches = (periods_s[start : start + length] for start in range(len(periods_s) - length + 1))
    return min(sum(stretch) for stretch in stretches) / length


def _turns(before: Step | None, step: Step) -> bool:
    is_other = before is not None and step.polarizer_angle_deg not in (None, before.polarizer_angle_deg)
    return is_other and step.part is None
