"""The steps of a session in their order, and what they need of time and disk."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rigctl.files.choices import FrameKind
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import DarkSection, SessionFile, Take
from rigctl.numbers.utc_time import NS_PER_S

# A FITS header of one frame and its line in the manifest [bytes].
BYTES_BESIDE_PIXELS = 5760 + 1024
# What a move of the stage and the disk take, for the estimate only: an ELL14 turns 45 deg in 0.2 s and answers in
# 0.1 s; a frame of 1 MB is on the disk in 0.02 s [s].
_MOVE_S = 0.4
_STORE_S = 0.02
_HOME_S = 2.0
# What a metered exposure is taken for, before it is metered [s].
_METERED_S = 0.01


@dataclass(frozen=True, kw_only=True)
class Step:
    """One frame that is to be taken.

    Attributes
    ----------
    sequence : int
        Its place in the session, from 0.
    kind : {"scene", "dark", "flat"}
        What stands before the camera.
    cycle : int
        Which time its take goes through the angles, from 0; counted on through the rounds of a schedule.
    polarizer_angle_deg : float or None
        Where the polarizer's axis is to point; None leaves it where it is.
    exposure_s : float or None
        Integration time [s]; None takes what was metered in this round.
    exposure_factor : float
        What a metered exposure is multiplied by.
    round : int
        Which round of the schedule, from 0.
    due_ns : int or None
        When its round begins [ns since 1970 UTC]; None is at once.
    ends_cycle : bool
        The last frame of a cycle: then its angles can be set against each other.
    """

    sequence: int
    kind: FrameKind
    cycle: int
    polarizer_angle_deg: float | None
    exposure_s: float | None
    exposure_factor: float = 1.0
    round: int = 0
    due_ns: int | None = None
    ends_cycle: bool = False


@dataclass(frozen=True, kw_only=True)
class Need:
    """Time and disk of a session, estimated.

    Attributes
    ----------
    duration_s : float
        Exposures, moves and storing; not what a person at the rig takes [s].
    disk_bytes : int or None
        None where the size of a frame is not known before the camera is opened.
    """

    duration_s: float
    disk_bytes: int | None


@dataclass(frozen=True, kw_only=True)
class _PlannedFrame:
    kind: FrameKind
    cycle: int
    polarizer_angle_deg: float | None
    exposure_s: float | None
    exposure_factor: float
    ends_cycle: bool = False


def plan_steps(session: SessionFile, round_times_ns: Sequence[int | None] = (None,)) -> tuple[Step, ...]:
    """Return the frames of a session in the order in which they are taken.

    Parameters
    ----------
    session : SessionFile
        What to take in a round.
    round_times_ns : sequence of int or None
        When each round is due [ns since 1970 UTC]; None is at once.
    """
    frames = [
        (number, due_ns, frame)
        for number, due_ns in enumerate(round_times_ns)
        for take in session.take
        if number % take.every_rounds == 0
        for frame in _frames_of(take, _darks_of(session, number), first_cycle=number // take.every_rounds * take.cycles)
    ]
    return tuple(
        Step(sequence=sequence, round=number, due_ns=due_ns, **vars(frame))
        for sequence, (number, due_ns, frame) in enumerate(frames)
    )


def _darks_of(session: SessionFile, number: int) -> DarkSection | None:
    darks = session.darks
    return None if darks is None or number % darks.every_rounds else darks


def _frames_of(take: Take, darks: DarkSection | None, *, first_cycle: int) -> Iterator[_PlannedFrame]:
    for exposure_s in take.exposures_s:
        if take.order == "grouped":
            yield from _dark_frames(take, darks, exposure_s, 0)
            yield from _grouped_frames(take, exposure_s, first_cycle)
        else:
            for cycle in range(take.cycles):
                yield from _dark_frames(take, darks, exposure_s, cycle)
                yield from _cycle_frames(take, exposure_s, first_cycle + cycle)
        yield from _dark_frames(take, darks, exposure_s, 0)


def _dark_frames(
    take: Take, darks: DarkSection | None, exposure_s: float | None, cycle: int
) -> Iterator[_PlannedFrame]:
    if darks is None or take.kind != "scene" or cycle % darks.every_cycles:
        return
    for factor in take.exposure_factors:
        for frame in range(darks.frames):
            yield _PlannedFrame(
                kind="dark",
                cycle=frame,
                polarizer_angle_deg=None,
                exposure_s=_times(exposure_s, factor),
                exposure_factor=factor,
            )


def _cycle_frames(take: Take, exposure_s: float | None, cycle: int) -> Iterator[_PlannedFrame]:
    angles = take.polarizer_angles_deg
    if take.order == "palindrome" and cycle % 2:
        angles = angles[::-1]
    if take.closing_repeat:
        angles = (*angles, angles[0])
    last = (len(angles) - 1, len(take.exposure_factors) - 1)
    for place, angle in enumerate(angles):
        for k, factor in enumerate(take.exposure_factors):
            yield _planned(take, cycle, angle, exposure_s, factor, ends_cycle=(place, k) == last)


def _grouped_frames(take: Take, exposure_s: float | None, first_cycle: int) -> Iterator[_PlannedFrame]:
    for angle in take.polarizer_angles_deg:
        for cycle in range(take.cycles):
            for factor in take.exposure_factors:
                yield _planned(take, first_cycle + cycle, angle, exposure_s, factor, ends_cycle=False)


def _planned(
    take: Take, cycle: int, angle: float | None, exposure_s: float | None, factor: float, *, ends_cycle: bool
) -> _PlannedFrame:
    return _PlannedFrame(
        kind=take.kind,
        cycle=cycle,
        polarizer_angle_deg=angle,
        exposure_s=_times(exposure_s, factor),
        exposure_factor=factor,
        ends_cycle=ends_cycle and take.kind == "scene",
    )


def _times(exposure_s: float | None, factor: float) -> float | None:
    return None if exposure_s is None else exposure_s * factor


def estimate(steps: tuple[Step, ...], rig: RigFile, *, pixels: int | None = None) -> Need:
    """Return what steps need of time and disk.

    Parameters
    ----------
    steps : tuple of Step
        What is taken.
    rig : RigFile
        With which rig; a simulated camera's pictures are of known size.
    pixels : int or None
        Of a picture; None: of the simulated camera.
    """
    moves = sum(
        1
        for before, step in zip((None, *steps), steps, strict=False)
        if step.polarizer_angle_deg is not None
        and (before is None or before.polarizer_angle_deg != step.polarizer_angle_deg)
    )
    duration = _HOME_S + moves * _MOVE_S + sum(planned_exposure_s(step) + _STORE_S for step in steps)
    if pixels is None and rig.simulation is not None:
        pixels = rig.simulation.camera.width * rig.simulation.camera.height
    if pixels is None:
        return Need(duration_s=duration, disk_bytes=None)
    return Need(duration_s=duration, disk_bytes=len(steps) * (2 * pixels + BYTES_BESIDE_PIXELS))


def planned_exposure_s(step: Step) -> float:
    """Return the exposure of a step [s]; an assumed one where it is metered later."""
    return _METERED_S * step.exposure_factor if step.exposure_s is None else step.exposure_s


def step_times_ns(steps: Sequence[Step], *, start_ns: int) -> tuple[int, ...]:
    """Return about when each step will be taken [ns since 1970 UTC], each round not before it is due."""
    times: list[int] = []
    free_ns = start_ns + round(_HOME_S * NS_PER_S)
    angle: float | None = None
    for step in steps:
        begin_ns = free_ns if step.due_ns is None else max(free_ns, step.due_ns)
        if step.polarizer_angle_deg not in (None, angle):
            begin_ns, angle = begin_ns + round(_MOVE_S * NS_PER_S), step.polarizer_angle_deg
        times.append(begin_ns)
        free_ns = begin_ns + round((planned_exposure_s(step) + _STORE_S) * NS_PER_S)
    return tuple(times)
