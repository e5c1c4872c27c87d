"""One rig at work: what stands before the camera, how it is set, where the polarizer is; one frame at a time."""

import numpy as np

from drivers.errors import LimitError
from drivers.interfaces import CameraSettings, Move
from rigctl.files.rig_file import RigFile
from rigctl.runs.run_folder import FrameKind
from rigctl.runs.run_writer import RunWriter
from rigctl.sessions.interlocks import settings_trip
from rigctl.sessions.rig import Rig
from rigctl.sessions.shot import Shot


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
    checks_settings : bool
        Whether a camera that takes other settings than it was told is refused.
    """

    def __init__(self, rig: Rig, rig_file: RigFile, writer: RunWriter, *, checks_settings: bool) -> None:
        self._rig, self._rig_file, self._writer = rig, rig_file, writer
        self._checks_settings = checks_settings
        self._presented: FrameKind | None = None
        self._settings: CameraSettings | None = None
        self._exposure_asked_s = 0.0
        self._move: Move | None = None
        self._angle_asked_deg: float | None = None

    def home(self) -> None:
        """Find the stage's reference."""
        home = self._rig.stage.home()
        self._writer.event("homed", stage_angle_deg=home.angle_deg, stage_counts=home.counts)

    def present(self, kind: FrameKind) -> None:
        """Put something before the camera, unless it is there."""
        if kind == self._presented:
            return
        self._rig.present(kind)
        self._presented = kind
        self._writer.event("presented", kind=kind)

    def distrust_angle(self) -> None:
        """Move the stage before the next frame, even if it was sent to that angle already."""
        self._angle_asked_deg = None

    def shoot(self, *, exposure_s: float, polarizer_angle_deg: float | None) -> Shot:
        """Return a frame at an exposure and an angle; None leaves the polarizer where it is.

        Raises
        ------
        DeviceError
            A device fails, or the camera does not take its settings.
        """
        settings = self._configured(exposure_s)
        is_new_move = self._turn(polarizer_angle_deg)
        frame = self._rig.camera.take_frame(timeout_s=settings.exposure_s + self._rig_file.camera.timeout_s)
        full_dn = 2**frame.settings.bit_depth - 1
        return Shot(
            frame=frame,
            settings=settings,
            move=self._move,
            is_new_move=is_new_move,
            saturated_fraction=np.count_nonzero(frame.counts >= full_dn) / frame.counts.size,
        )

    def _configured(self, exposure_s: float) -> CameraSettings:
        if self._settings is None or exposure_s != self._exposure_asked_s:
            gain_db = self._rig_file.camera.gain_db
            settings = self._rig.camera.configure(exposure_s=exposure_s, gain_db=gain_db)
            trip = settings_trip(exposure_s=exposure_s, gain_db=gain_db, read_back=settings)
            if trip is not None and self._checks_settings:
                raise LimitError(trip.message)
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
