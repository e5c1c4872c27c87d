"""The steps of a session in their order, and what they need of time and disk."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from rigctl.errors import ConfigError
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
# Places of a cell; how far a calibrated axis may be from the one that it is meant to be.
_PLACES = 4
_HALF_TURN_DEG, _EIGHTH_DEG, _MEANT_DEG, _AXIS_DECIMALS = 180.0, 45.0, 5.0, 3


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
    part : int or None
        Which place of the cell its pixels are of, from 0, where the camera has polarizers on its pixels: steps of parts
        0 to 3 that follow each other are one exposure.
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
    part: int | None = None

    @property
    def begins_exposure(self) -> bool:
        """An exposure is made for it; other parts of a cell come with the one before."""
        return not self.part


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
    part: int | None = None


def plan_steps(
    session: SessionFile,
    round_times_ns: Sequence[int | None] = (None,),
    *,
    cell_deg: tuple[float, ...] | None = None,
) -> tuple[Step, ...]:
    """Return the frames of a session in the order in which they are taken.

    Parameters
    ----------
    session : SessionFile
        What to take in a round.
    round_times_ns : sequence of int or None
        When each round is due [ns since 1970 UTC]; None is at once.
    cell_deg : tuple of float or None
        Axes of the polarizers on the camera's pixels: each exposure gives a frame behind each of them.

    Raises
    ------
    ConfigError
        A take asks for what a cell does not have: other angles, or the first one once more.
    """
    takes = session.take if cell_deg is None else [_take_of_cell(take, cell_deg) for take in session.take]
    frames = [
        (number, due_ns, frame)
        for number, due_ns in enumerate(round_times_ns)
        for take in takes
        if number % take.every_rounds == 0
        for frame in _frames_of(take, _darks_of(session, number), first_cycle=number // take.every_rounds * take.cycles)
    ]
    if cell_deg is not None:
        targets_deg = tuple(map(nominal_deg, cell_deg))
        frames = [(number, due_ns, part) for number, due_ns, frame in frames for part in _parts(frame, targets_deg)]
    return tuple(
        Step(sequence=sequence, round=number, due_ns=due_ns, **vars(frame))
        for sequence, (number, due_ns, frame) in enumerate(frames)
    )


def exposures_of(steps: Sequence[Step]) -> Iterator[tuple[Step, ...]]:
    """Give the steps of each exposure: one, or the four parts of a cell."""
    begins = [place for place, step in enumerate(steps) if step.begins_exposure]
    for begin, end in pairwise([*begins, len(steps)]):
        yield tuple(steps[begin:end])


def nominal_deg(axis_deg: float) -> float:
    """Return the multiple of 45 deg that a calibrated axis is meant to be, in [0, 180), or the axis itself."""
    nominal = round(axis_deg / _EIGHTH_DEG) * _EIGHTH_DEG
    return nominal % _HALF_TURN_DEG if abs(axis_deg - nominal) <= _MEANT_DEG else axis_deg


def _take_of_cell(take: Take, cell_deg: tuple[float, ...]) -> Take:
    """Return a take as exposures: the angles are those of the cell, whatever their order."""
    axes = {round(nominal_deg(axis), _AXIS_DECIMALS) for axis in cell_deg}
    asked = {round(nominal_deg(angle % _HALF_TURN_DEG), _AXIS_DECIMALS) for angle in take.angles_deg or ()}
    if take.angles_deg is not None and asked != axes:
        known = ", ".join(f"{axis:g}" for axis in cell_deg)
        raise ConfigError(
            f"angles_deg of a take: the camera's pixels stand behind {known} deg, all of them in each exposure; leave "
            "angles_deg out"
        )
    if take.closing_repeat:
        raise ConfigError("closing_repeat: all angles are of one exposure here, so that no drift comes between them")
    # One exposure a cycle, at whatever angle: the cell puts its own in.
    return take.model_copy(update={"angles_deg": [0.0], "order": "cycles"})


def _parts(frame: _PlannedFrame, targets_deg: tuple[float, ...]) -> Iterator[_PlannedFrame]:
    """Give the frames of an exposure behind each place of a cell."""
    last = len(targets_deg) - 1
    for part, target_deg in enumerate(targets_deg):
        yield replace(frame, polarizer_angle_deg=target_deg, part=part, ends_cycle=frame.ends_cycle and part == last)


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
        Of a picture of the camera; None: of the simulated camera.
    """
    moves = sum(
        1
        for before, step in zip((None, *steps), steps, strict=False)
        if _turns(step, None if before is None else before.polarizer_angle_deg)
    )
    exposed_s = sum(planned_exposure_s(step) for step in steps if step.begins_exposure)
    duration = (0.0 if rig.stage is None else _HOME_S) + moves * _MOVE_S + exposed_s + len(steps) * _STORE_S
    if pixels is None and rig.simulation is not None:
        pixels = rig.simulation.camera.width * rig.simulation.camera.height
    if pixels is None:
        return Need(duration_s=duration, disk_bytes=None)
    of_frame = pixels // _PLACES if rig.camera.mosaic_deg is not None and rig.camera.interpolation == "none" else pixels
    return Need(duration_s=duration, disk_bytes=len(steps) * (2 * of_frame + BYTES_BESIDE_PIXELS))


def _turns(step: Step, angle_deg: float | None) -> bool:
    """Return whether the stage turns for a step; a cell of polarizers needs none."""
    return step.part is None and step.polarizer_angle_deg not in (None, angle_deg)


def planned_exposure_s(step: Step) -> float:
    """Return the exposure of a step [s]; an assumed one where it is metered later."""
    return _METERED_S * step.exposure_factor if step.exposure_s is None else step.exposure_s


def step_times_ns(steps: Sequence[Step], *, start_ns: int) -> tuple[int, ...]:
    """Return about when each step will be taken [ns since 1970 UTC], each round not before it is due."""
    times: list[int] = []
    turned = any(step.part is None for step in steps)
    free_ns = start_ns + (round(_HOME_S * NS_PER_S) if turned else 0)
    angle: float | None = None
    for step in steps:
        if not step.begins_exposure:
            times.append(times[-1])
            free_ns += round(_STORE_S * NS_PER_S)
            continue
        begin_ns = free_ns if step.due_ns is None else max(free_ns, step.due_ns)
        if _turns(step, angle):
            begin_ns, angle = begin_ns + round(_MOVE_S * NS_PER_S), step.polarizer_angle_deg
        times.append(begin_ns)
        free_ns = begin_ns + round((planned_exposure_s(step) + _STORE_S) * NS_PER_S)
    return tuple(times)
