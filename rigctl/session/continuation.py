"""Rest of a session: the steps that have no frame yet, and what the earlier part has settled."""

from dataclasses import dataclass

from rigctl.errors import RunFolderError
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_events import metered_exposures, read_events
from rigctl.runs.run_folder import Run
from rigctl.session.planning.session_steps import Step

_ANGLE_TOLERANCE_DEG = 1e-6


@dataclass(frozen=True, kw_only=True)
class Continuation:
    """Rest of a session.

    Attributes
    ----------
    steps : tuple of Step
        Those that have no frame.
    metered_s : mapping
        Exposures that were metered, by round [s].
    is_finished : bool
        The session has noted its end.
    """

    steps: tuple[Step, ...]
    metered_s: dict[int, float]
    is_finished: bool


def continuation(run: Run, steps: tuple[Step, ...]) -> Continuation:
    """Return the rest of a session.

    Raises
    ------
    RunFolderError
        A frame of the run is not the one that its step asks for: the run holds something else.
    """
    planned = {step.sequence: step for step in steps}
    for record in run.frames:
        _require_planned(record, planned.get(record.sequence))
    taken = {record.sequence for record in run.frames}
    left = tuple(step for step in steps if step.sequence not in taken)
    events = read_events(run.path)
    return Continuation(
        steps=left,
        metered_s={one.round: one.exposure_s for one in metered_exposures(events)},
        is_finished=any(event.event == "finished" for event in events),
    )


def _require_planned(record: FrameRecord, step: Step | None) -> None:
    if step is not None and record.kind == step.kind and _is_same_angle(record, step):
        return
    wanted = "no such step" if step is None else f"{step.kind} at {step.polarizer_angle_deg} deg"
    raise RunFolderError(
        f"{record.file}: is {record.kind} at {record.polarizer_angle_target_deg} deg, and the plan has {wanted} in its "
        "place: this run was not made by this session"
    )


def _is_same_angle(record: FrameRecord, step: Step) -> bool:
    target = record.polarizer_angle_target_deg
    if target is None or step.polarizer_angle_deg is None:
        return target is step.polarizer_angle_deg
    return abs(target - step.polarizer_angle_deg) <= _ANGLE_TOLERANCE_DEG
