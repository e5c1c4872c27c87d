"""One rig at work: what stands before the camera, how it is set, where the polarizer is; one frame at a time."""

from collections.abc import Callable

from drivers.errors import DeviceTimeoutError
from drivers.interfaces import CameraSettings, CameraWithFacts, Frame, Move
from rigctl.devices.rig import Rig
from rigctl.files.choices import FrameKind
from rigctl.files.rig_file import RigFile
from rigctl.runs.run_writer import RunWriter
from rigctl.session.captured_frame import CapturedFrame
from rigctl.session.interlocks import InterlockViolation, homed_violation, settings_violation
from rigctl.session.planning.session_steps import nominal_deg


class FrameCounter:
    """The camera's own frame counter: a number that stands still is an old picture, a gap is a lost one.

    Parameters
    ----------
    is_triggered : bool
        Whether the numbers follow each other; a camera that runs by itself counts what nobody asked for, too.
    """

    def __init__(self, *, is_triggered: bool) -> None:
        self._is_triggered = is_triggered
        self._last: int | None = None

    def forget(self) -> None:
        """Take the next number as it comes."""
        self._last = None

    def problem(self, number: int) -> str | None:
        """Take in the number of a frame; return what is wrong with it."""
        last, self._last = self._last, number
        if last is None:
            return None
        if number <= last:
            return f"camera: its frame counter says {number} after {last}: it sent an old picture, or was restarted"
        missing = number - last - 1
        if missing and self._is_triggered:
            return f"camera: its frame counter says {number} after {last}: {missing} pictures were lost on their way"
        return None


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
    ask : callable
        Returns once somebody has put something before the camera, where hands are needed.
    """

    def __init__(self, rig: Rig, rig_file: RigFile, writer: RunWriter, ask: Callable[[FrameKind], None]) -> None:
        self._rig, self._rig_file, self._writer, self._ask = rig, rig_file, writer, ask
        camera = rig.camera
        self._counter = FrameCounter(is_triggered=isinstance(camera, CameraWithFacts) and camera.facts().triggered)
        self._presented: FrameKind | None = None
        self._settings: CameraSettings | None = None
        self._settings_violation: InterlockViolation | None = None
        self._exposure_asked_s = 0.0
        self._move: Move | None = None
        self._angle_asked_deg: float | None = None

    def home(self) -> InterlockViolation | None:
        """Find the stage's reference; return a violation where the stage does not say that it has."""
        self.distrust()
        stage = self._rig.stage
        if stage is None:
            return None
        home = stage.home()
        self._writer.event("homed", stage_angle_deg=home.angle_deg, stage_counts=home.counts)
        return homed_violation(stage.status())

    def begin_step(self, sequence: int) -> None:
        """Tell the rig which step comes next; where steps are parts of one exposure, which exposure."""
        if self._rig.begin_step(sequence):
            self._counter.forget()

    def present(self, kind: FrameKind) -> None:
        """Put something before the camera, unless it is there."""
        if kind == self._presented:
            return
        self._ask(kind)
        self._rig.present(kind)
        self._presented = kind
        self._writer.event("presented", kind=kind)

    def distrust(self) -> None:
        """Set camera and stage before the next frame, even if they were told so already."""
        self._angle_asked_deg = None
        self._settings = None

    def capture(self, *, exposure_s: float, polarizer_angle_deg: float | None) -> CapturedFrame:
        """Return a frame at an exposure and an angle; None leaves the polarizer where it is.

        Raises
        ------
        DeviceError
            A device fails.
        """
        settings = self._configured(exposure_s)
        is_new_move = self._turn(polarizer_angle_deg)
        frame, counter_violation = self._frame(settings.exposure_s)
        return CapturedFrame(
            frame=frame,
            settings=settings,
            move=self._move,
            is_new_move=is_new_move,
            violations=tuple(found for found in (self._settings_violation, counter_violation) if found is not None),
        )

    def capture_parts(self, *, exposure_s: float) -> dict[float, CapturedFrame]:
        """Return a frame behind each axis of the cell of a camera with polarizers on its pixels, of one exposure.

        Raises
        ------
        DeviceError
            The camera fails.
        """
        captured = self.capture(exposure_s=exposure_s, polarizer_angle_deg=None)
        axes_deg = self._rig_file.cell_deg or ()
        return dict(zip(map(nominal_deg, axes_deg), captured.parts(self._rig_file.camera), strict=True))

    def _frame(self, exposure_s: float) -> tuple[Frame, InterlockViolation | None]:
        try:
            frame = self._rig.camera.take_frame(timeout_s=exposure_s + self._rig_file.camera.timeout_s)
        except DeviceTimeoutError:
            self._counter.forget()  # the picture that did not come may have had a number
            raise
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
        stage = self._rig.stage
        if stage is None or polarizer_angle_deg is None or polarizer_angle_deg == self._angle_asked_deg:
            return False
        polarizer = self._rig_file.polarizer
        move = stage.move_to(polarizer.sense * (polarizer_angle_deg - polarizer.offset_deg))
        for remark in move.remarks:
            self._writer.event("stage", remark=remark)
        self._move, self._angle_asked_deg = move, polarizer_angle_deg
        return True
