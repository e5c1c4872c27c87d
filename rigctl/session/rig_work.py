"""One rig at work: what stands before the camera, how it is set, where the polarizer is; one frame at a time."""

from collections.abc import Callable

from drivers.interfaces import CameraSettings, CameraWithFacts, Move, StageStatus
from rigctl.devices.rig import Rig
from rigctl.files.choices import FrameKind
from rigctl.files.rig_file import RigFile
from rigctl.runs.run_writer import RunWriter
from rigctl.session.captured_frame import CapturedFrame
from rigctl.session.planning.session_steps import nominal_deg


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
        self._is_triggered = isinstance(camera, CameraWithFacts) and camera.facts().triggered
        self._number: int | None = None
        self._presented: FrameKind | None = None
        self._settings: CameraSettings | None = None
        self._exposure_asked_s = 0.0
        self._move: Move | None = None
        self._angle_asked_deg: float | None = None

    def home(self) -> StageStatus | None:
        """Find the stage's reference; return what the stage says then."""
        self.distrust()
        stage = self._rig.stage
        if stage is None:
            return None
        home = stage.home()
        self._writer.event("homed", stage_angle_deg=home.angle_deg, stage_counts=home.counts)
        return stage.status()

    def begin_step(self, sequence: int) -> None:
        """Tell the rig which step comes next; where steps are parts of one exposure, which exposure."""
        if self._rig.begin_step(sequence):
            self._number = None

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
        before, self._number = self._number, None  # a picture that does not come may have a number
        frame = self._rig.camera.take_frame(timeout_s=settings.exposure_s + self._rig_file.camera.timeout_s)
        self._number = frame.sequence
        return CapturedFrame(
            frame=frame,
            settings=settings,
            move=self._move,
            is_new_move=is_new_move,
            asked=(exposure_s, self._rig_file.camera.gain_db),
            number_before=before,
            is_triggered=self._is_triggered,
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

    def _configured(self, exposure_s: float) -> CameraSettings:
        if self._settings is None or exposure_s != self._exposure_asked_s:
            self._settings = self._rig.camera.configure(exposure_s=exposure_s, gain_db=self._rig_file.camera.gain_db)
            self._exposure_asked_s = exposure_s
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
