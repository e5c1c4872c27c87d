"""The steps of a session in their order, and what they need of time and disk."""

from dataclasses import dataclass

from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile, Take
from rigctl.runs.run_folder import FrameKind

# A FITS header of one frame and its line in the manifest [bytes].
_BYTES_BESIDE_PIXELS = 5760 + 1024
# What a move of the stage and the disk take, for the estimate only: an ELL14 turns 45 deg in 0.2 s and answers in
# 0.1 s; a frame of 1 MB is on the disk in 0.02 s [s].
_MOVE_S = 0.4
_STORE_S = 0.02
_HOME_S = 2.0


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
        Which time its take goes through the angles, from 0.
    polarizer_angle_deg : float or None
        Where the polarizer's axis is to point; None leaves it where it is.
    exposure_s : float
        Integration time [s].
    """

    sequence: int
    kind: FrameKind
    cycle: int
    polarizer_angle_deg: float | None
    exposure_s: float


@dataclass(frozen=True, kw_only=True)
class Need:
    """What a session needs, estimated.

    Attributes
    ----------
    duration_s : float
        Exposures, moves and storing; not what a person at the rig takes [s].
    disk_bytes : int or None
        None where the size of a frame is not known before the camera is opened.
    """

    duration_s: float
    disk_bytes: int | None


def plan_steps(session: SessionFile) -> tuple[Step, ...]:
    """Return the frames of a session in the order in which they are taken."""
    frames = [frame for take in session.take for frame in _frames(take)]
    return tuple(
        Step(sequence=number, kind=kind, cycle=cycle, polarizer_angle_deg=angle, exposure_s=exposure)
        for number, (kind, cycle, angle, exposure) in enumerate(frames)
    )


def _frames(take: Take) -> list[tuple[FrameKind, int, float | None, float]]:
    return [
        (take.kind, cycle, angle, exposure)
        for exposure in take.exposures_s
        for cycle in range(take.cycles)
        for angle in take.polarizer_angles_deg
    ]


def estimate(steps: tuple[Step, ...], rig: RigFile) -> Need:
    """Return what steps need of time and disk."""
    moves = sum(
        1
        for before, step in zip((None, *steps), steps, strict=False)
        if step.polarizer_angle_deg is not None
        and (before is None or before.polarizer_angle_deg != step.polarizer_angle_deg)
    )
    duration = _HOME_S + moves * _MOVE_S + sum(step.exposure_s + _STORE_S for step in steps)
    if rig.simulation is None:
        return Need(duration_s=duration, disk_bytes=None)
    camera = rig.simulation.camera
    return Need(duration_s=duration, disk_bytes=len(steps) * (2 * camera.width * camera.height + _BYTES_BESIDE_PIXELS))
