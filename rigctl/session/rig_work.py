"""One rig at work: what stands before the camera, how it is set, where the polarizer is; one frame at a time."""

import numpy as np

from drivers.errors import DeviceTimeoutError
from drivers.interfaces import CameraSettings, Frame, Move
from rigctl.devices.rig import Rig
from rigctl.files.rig_file import RigFile
from rigctl.runs.run_folder import FrameKind
from rigctl.runs.run_writer import RunWriter
from rigctl.session.captured_frame import CapturedFrame
from rigctl.session.frame_counter import FrameCounter, is_triggered
from rigctl.session.interlock_violation import InterlockViolation
from rigctl.session.interlocks import homed_violation, settings_violation
from rigctl.simulated.frame_numbers import skip_to


class RigWork:
    """Remembers how the rig is set, so that nothing is set twice.

    Parameters
    ----------
    rig : Rig
        Open devices.
    rig_file : RigFile
        How the polarizer sits, the camera's gain and deadline.
    writer : RunWriter
        Where events go.
    next_number : int or None
        Number that a simulated camera is to give its next frame; None where it does not matter.

    Attributes
    ----------
    next_number : int or None
        Number of the next frame of a simulated camera.
    """

    def __init__(self, rig: Rig, rig_file: RigFile, writer: RunWriter, *, next_number: int | None = None) -> None:
        self._rig, self._rig_file, self._writer = rig, rig_file, writer
        self.next_number = next_number
        self._counter = FrameCounter(is_triggered=is_triggered(rig_file.camera.address))
        self._presented: FrameKind | None = None
        self._settings: CameraSettings | None = None
        self._settings_violation: InterlockViolation | None = None
        self._exposure_asked_s = 0.0
        self._move: Move | None = None
        self._angle_asked_deg: float | None = None

    def home(self) -> InterlockViolation | None:
        """Find the stage's reference; return a violation where the stage does not say that it has."""
        home = self._rig.stage.home()
        self._writer.event("homed", stage_angle_deg=home.angle_deg, stage_counts=home.counts)
        self.distrust()
        return homed_violation(self._rig.stage.status())

    def bring_camera_to(self, number: int) -> None:
        """Let a simulated camera's next frame have a number, unless it is beyond that already."""
        if self.next_number is None:
            return
        skip_to(self._rig.camera, number)
        self.next_number = number
        self._counter.forget()

    def present(self, kind: FrameKind) -> None:
        """Put something before the camera, unless it is there."""
        if kind == self._presented:
            return
        self._rig.present(kind)
        self._presented = kind
        self._writer.event("presented", kind=kind)

    def distrust(self) -> None:
        """Set camera and stage before the next frame, even if they were told so already."""
        self._angle_asked_deg = None
        self._settings = None

    def shoot(self, *, exposure_s: float, polarizer_angle_deg: float | None) -> CapturedFrame:
        """Return a frame at an exposure and an angle; None leaves the polarizer where it is.

        Raises
        ------
        DeviceError
            A device fails.
        """
        settings = self._configured(exposure_s)
        is_new_move = self._turn(polarizer_angle_deg)
        frame, counter_violation = self._frame(settings.exposure_s)
        full_dn = 2**frame.settings.bit_depth - 1
        return CapturedFrame(
            frame=frame,
            settings=settings,
            move=self._move,
            is_new_move=is_new_move,
            saturated_fraction=np.count_nonzero(frame.counts >= full_dn) / frame.counts.size,
            violations=tuple(
                violation for violation in (self._settings_violation, counter_violation) if violation is not None
            ),
        )

    def _frame(self, exposure_s: float) -> tuple[Frame, InterlockViolation | None]:
        try:
            frame = self._rig.camera.take_frame(timeout_s=exposure_s + self._rig_file.camera.timeout_s)
        except DeviceTimeoutError:
            self._counter.forget()  # the picture that did not come may have had a number
            raise
        if self.next_number is not None:
            self.next_number = frame.sequence + 1
        problem = self._counter.problem(frame.sequence)
        return frame, None if problem is None else InterlockViolation(name="counter", message=problem)

    def _configured(self, exposure_s: float) -> CameraSettings:
        if self._settings is None or exposure_s != self._exposure_asked_s:
            gain_db = self._rig_file.camera.gain_db
            settings = self._rig.camera.configure(exposure_s=exposure_s, gain_db=gain_db)
            self._settings_violation = settings_violation(exposure_s=exposure_s, gain_db=gain_db, read_back=settings)
            self._settings, self._exposure_asked_s = settings, exposure_s
        return self._settings

    def _turn(self, polarizer_angle_deg: float | None) -> bool:
        if polarizer_angle_deg is None or polarizer_angle_deg == self._angle_asked_deg:
            return False
        polarizer = self._rig_file.polarizer
        move = self._rig.stage.move_to(polarizer.sense * (polarizer_angle_deg - polarizer.offset_deg))
        for remark in move.remarks:
            self._writer.event("stage", remark=remark)
        self._move, self._angle_asked_deg = move, polarizer_angle_deg
        return True
