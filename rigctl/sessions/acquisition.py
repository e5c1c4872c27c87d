"""Takes a session: turn, expose, store; each frame durable, and labelled with what the devices say of themselves."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drivers.errors import LimitError, ProtocolError
from drivers.interfaces import CameraSettings, Frame, Move
from rigctl.files.rig_file import RigFile
from rigctl.runs.run_folder import FrameRecord
from rigctl.runs.run_writer import RunWriter
from rigctl.sessions.plan import Step
from rigctl.sessions.rig import Rig
from rigctl.utc_time import utc_text

# A camera that takes another exposure than it was told, by more than its own clock's step, is not to be trusted.
_EXPOSURE_TOLERANCE = 0.01
Progress = Callable[[Step], None]


def acquire(rig: Rig, rig_file: RigFile, steps: tuple[Step, ...], writer: RunWriter, *, progress: Progress) -> None:
    """Take the frames of a session, one after the other.

    Parameters
    ----------
    rig : Rig
        Open devices.
    rig_file : RigFile
        How the polarizer sits, the camera's gain and deadline.
    steps : tuple of Step
        What to take.
    writer : RunWriter
        Where to.
    progress : callable
        Called with each step once its frame is on the disk.

    Raises
    ------
    DeviceError
        A device fails; what was taken until then is in the run.
    RunFolderError
        The disk is full or cannot be written.
    """
    session = _Acquisition(rig, rig_file, writer)
    home = rig.stage.home()
    writer.event("homed", stage_angle_deg=home.angle_deg, stage_counts=home.counts)
    for step in steps:
        session.take(step)
        progress(step)
    writer.event("finished", frames=len(steps))


class _Acquisition:
    """What is to be remembered from one step to the next: what stands before the camera, and how all is set."""

    def __init__(self, rig: Rig, rig_file: RigFile, writer: RunWriter) -> None:
        self._rig, self._rig_file, self._writer = rig, rig_file, writer
        self._presented: str | None = None
        self._settings: CameraSettings | None = None
        self._exposure_asked_s = 0.0
        self._move: Move | None = None
        self._angle_asked_deg: float | None = None
        self._last_counts: NDArray[np.uint16] | None = None

    def take(self, step: Step) -> None:
        """Take one frame and store it."""
        if step.kind != self._presented:
            self._rig.present(step.kind)
            self._presented = step.kind
            self._writer.event("presented", kind=step.kind)
        settings = self._configured(step.exposure_s)
        self._turn(step.polarizer_angle_deg)
        frame = self._rig.camera.take_frame(timeout_s=settings.exposure_s + self._rig_file.camera.timeout_s)
        self._refuse_repeated(frame)
        self._writer.write_frame(self._record(step, frame), frame.counts)

    def _configured(self, exposure_s: float) -> CameraSettings:
        if self._settings is None or exposure_s != self._exposure_asked_s:
            settings = self._rig.camera.configure(exposure_s=exposure_s, gain_db=self._rig_file.camera.gain_db)
            if abs(settings.exposure_s - exposure_s) > _EXPOSURE_TOLERANCE * exposure_s:
                raise LimitError(
                    f"camera: asked for an exposure of {exposure_s:g} s it says that it took {settings.exposure_s:g} s"
                )
            if settings.gain_db != self._rig_file.camera.gain_db:
                raise LimitError(
                    f"camera: asked for a gain of {self._rig_file.camera.gain_db:g} dB it says that it took "
                    f"{settings.gain_db:g} dB"
                )
            self._settings, self._exposure_asked_s = settings, exposure_s
        return self._settings

    def _turn(self, polarizer_angle_deg: float | None) -> None:
        if polarizer_angle_deg is None or polarizer_angle_deg == self._angle_asked_deg:
            return
        polarizer = self._rig_file.polarizer
        move = self._rig.stage.move_to(polarizer.sense * (polarizer_angle_deg - polarizer.offset_deg))
        for remark in move.remarks:
            self._writer.event("stage", remark=remark)
        self._move, self._angle_asked_deg = move, polarizer_angle_deg

    def _refuse_repeated(self, frame: Frame) -> None:
        """Refuse a picture that has the very noise of the last one: the polarizer has moved on since.

        A picture of one value everywhere (all saturated) has no noise to know it by.
        """
        has_noise = frame.counts.min() != frame.counts.max()
        if has_noise and self._last_counts is not None and np.array_equal(frame.counts, self._last_counts):
            raise ProtocolError(
                f"camera: frame {frame.sequence} is identical to the one before, down to the noise: it sent an old "
                "picture again. Restart the camera"
            )
        self._last_counts = frame.counts

    def _record(self, step: Step, frame: Frame) -> FrameRecord:
        rig, polarizer, move = self._rig, self._rig_file.polarizer, self._move
        return FrameRecord(
            kind=step.kind,
            sequence=step.sequence,
            cycle=step.cycle,
            polarizer_angle_target_deg=step.polarizer_angle_deg,
            polarizer_angle_deg=None
            if move is None
            else (polarizer.sense * move.position.angle_deg + polarizer.offset_deg) % 180.0,
            stage_angle_target_deg=None if move is None else move.target_deg,
            stage_angle_deg=None if move is None else move.position.angle_deg,
            stage_counts=None if move is None else move.position.counts,
            exposure_s=frame.settings.exposure_s,
            gain_db=frame.settings.gain_db,
            bit_depth=frame.settings.bit_depth,
            saturation_dn=float(2**frame.settings.bit_depth - 1),
            start_utc=utc_text(frame.start_utc_ns),
            end_utc=utc_text(frame.end_utc_ns),
            start_monotonic_ns=frame.start_monotonic_ns,
            camera_model=rig.camera_identity.model,
            camera_serial=rig.camera_identity.serial_number,
            stage_model=rig.stage_identity.model,
            stage_serial=rig.stage_identity.serial_number,
            remarks=() if move is None else move.remarks,
        )
