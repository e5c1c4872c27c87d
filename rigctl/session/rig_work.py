"""Takes one frame at a time: the object before the camera, settings, the polarizer's angle, metering, the record."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import CameraSettings, CameraWithFacts, Frame, Move, StageStatus
from model.processing.mosaic import planes
from rigctl.base.numbers import utc_text
from rigctl.files.choices import FrameKind
from rigctl.files.place import SiteSection
from rigctl.files.rig_file import CameraSection, RigFile
from rigctl.files.session_file import MeteringSection
from rigctl.rig.rig import Rig, fields_text
from rigctl.runs.records import METERED_EVENT, FrameRecord
from rigctl.runs.writer import RunWriter
from rigctl.session.plan import Step, SunAngles, nominal_deg

# Above this share the count may be clipped, and shows only that the exposure is too long.
_CLIPPED = 0.98
_SHORTEN = 0.25
_LENGTHEN_AT_MOST = 30.0
_NEAR = 0.1
_MOST_ROUNDS = 12
_MS_PER_S = 1000.0
# Share of the largest count that the bright pixels reach, by polarizer angle [deg].
Shares = Mapping[float | None, float]
Probe = Callable[[float], Shares]


@dataclass(frozen=True, kw_only=True, eq=False)
class CapturedFrame:
    """A frame with the settings and the move with which it was taken."""

    frame: Frame
    settings: CameraSettings  #: Read back when it was set.
    move: Move | None  #: The last move of the stage.
    is_new_move: bool  #: It was made for this frame.
    asked: tuple[float, float]  #: Requested exposure [s] and gain [dB].
    kind: FrameKind  #: What stands before the camera.
    tolerance_deg: float  #: How far the readback of the stage may be off.
    number_before: int | None = None  #: The camera's number of the previous frame, if known.
    last_counts: NDArray[np.uint16] | None = None  #: Counts of the previous frame.
    is_triggered: bool = True  #: The camera's numbers follow each other.

    @cached_property
    def saturated_fraction(self) -> float:
        """Share of saturated pixels."""
        counts, full_dn = self.frame.counts, 2**self.frame.settings.bit_depth - 1
        return np.count_nonzero(counts >= full_dn) / counts.size if self.range_dn[1] >= full_dn else 0.0

    @cached_property
    def range_dn(self) -> tuple[float, float]:
        """The smallest and the largest count."""
        import cv2

        least, most, *_ = cv2.minMaxLoc(self.frame.counts)
        return least, most

    @property
    def is_flat(self) -> bool:
        """All pixels have one value."""
        return self.range_dn[0] == self.range_dn[1]

    @cached_property
    def is_blank(self) -> bool:
        """All pixels have one value that is neither saturated nor the 0 of a dark frame: no picture came."""
        counts = self.frame.counts
        if self.kind != "scene":
            return not counts.any()
        return self.is_flat and bool(counts.flat[0] < 2**self.settings.bit_depth - 1)

    def parts(self, camera: CameraSection) -> tuple["CapturedFrame", ...]:
        """Return the frame of each place of the cell of a camera with polarizers on its pixels; otherwise the frame."""
        if camera.mosaic_deg is None:
            return (self,)
        frame = self.frame
        pictures = planes(
            frame.counts, interpolation=camera.interpolation, saturation_dn=2**frame.settings.bit_depth - 1
        )
        return tuple(self._part(counts) for counts in pictures)

    def _part(self, counts: NDArray[np.uint16]) -> "CapturedFrame":
        height, width = counts.shape
        settings = replace(self.frame.settings, width=width, height=height)
        return replace(
            self,
            frame=replace(self.frame, counts=counts, settings=settings),
            settings=replace(self.settings, width=width, height=height),
        )


class RigWork:
    """A rig and its present settings; a setting that is already in place is not sent again."""

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
        """Search the stage's reference mark; return the status of the stage afterwards."""
        self.distrust()
        stage = self._rig.stage
        if stage is None:
            return None
        home = stage.home()
        self._writer.event("homed", stage_angle_deg=home.angle_deg, stage_counts=home.counts)
        return stage.status()

    def begin_step(self, sequence: int) -> None:
        """Tell the rig the number of the next step, or of the next exposure if steps are parts of one exposure."""
        if self._rig.begin_step(sequence):
            self._number = None

    def present(self, kind: FrameKind) -> None:
        """Place the object for frames of this kind before the camera, unless it is there already."""
        if kind == self._presented:
            return
        self._ask(kind)
        self._rig.present(kind)
        self._presented = kind
        self._writer.event("presented", kind=kind)

    def distrust(self) -> None:
        """Set camera and stage again before the next frame, even if nothing has changed."""
        self._angle_asked_deg = None
        self._settings = None

    def capture(self, *, exposure_s: float, polarizer_angle_deg: float | None) -> CapturedFrame:
        """Return a frame at an exposure and an angle; None leaves the polarizer where it is."""
        settings = self._configured(exposure_s)
        is_new_move = self._turn(polarizer_angle_deg)
        before, self._number = self._number, None  # a picture that does not arrive may have used a number
        try:
            frame = self._rig.camera.take_frame(timeout_s=settings.exposure_s + self._rig_file.camera.timeout_s)
        except DeviceError as error:
            self._rig.trace(f"camera failed: {type(error).__name__}: {error}")
            raise
        self._rig.trace(f"camera frame {frame.sequence}: {fields_text(frame.settings)}")
        self._number = frame.sequence
        return CapturedFrame(
            frame=frame,
            settings=settings,
            move=self._move,
            is_new_move=is_new_move,
            asked=(exposure_s, self._rig_file.camera.gain_db),
            kind=self._presented or "scene",
            tolerance_deg=0.0 if self._rig_file.stage is None else self._rig_file.stage.tolerance_deg,
            number_before=before,
            is_triggered=self._is_triggered,
        )

    def capture_parts(self, *, exposure_s: float) -> dict[float, CapturedFrame]:
        """Return one frame for each axis of a camera with polarizers on its pixels, all of one exposure."""
        captured = self.capture(exposure_s=exposure_s, polarizer_angle_deg=None)
        axes_deg = self._rig_file.cell_deg or ()
        return dict(zip(map(nominal_deg, axes_deg), captured.parts(self._rig_file.camera), strict=True))

    def _configured(self, exposure_s: float) -> CameraSettings:
        if self._settings is None or exposure_s != self._exposure_asked_s:
            gain_db = self._rig_file.camera.gain_db
            try:
                self._settings = self._rig.camera.configure(exposure_s=exposure_s, gain_db=gain_db)
            except DeviceError as error:
                self._rig.trace(f"camera failed: {type(error).__name__}: {error}")
                raise
            asked = f"exposure_s={exposure_s:g} gain_db={gain_db:g}"
            self._rig.trace(f"camera set {asked}: {fields_text(self._settings)}")
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


class RoundExposures:
    """Exposures of steps; each round is metered once."""

    def __init__(
        self,
        steps: Sequence[Step],
        work: RigWork,
        writer: RunWriter,
        *,
        metering: MeteringSection,
        metered_s: Mapping[int, float],
    ) -> None:
        self._steps, self._work, self._writer = steps, work, writer
        self._metering = metering
        self._metered_s = dict(metered_s)
        self._next_camera_frame: int | None = None

    def of(self, step: Step) -> float:
        """Return the exposure of a step [s]."""
        if step.exposure_s is not None:
            return step.exposure_s
        if step.round not in self._metered_s:
            self._metered_s[step.round] = self._metered(step.round)
        return self._metered_s[step.round] * step.exposure_factor

    def proposed_s(self, captured: CapturedFrame, polarizer_angle_deg: float | None) -> float | None:
        """Return a suitable exposure after a frame was far too bright [s]; None if none is found."""
        asked_ms = captured.asked[0] * _MS_PER_S
        shorter = {"first_exposure_ms": asked_ms * _SHORTEN, "longest_ms": asked_ms}
        try:
            exposure_s, shares, _ = meter(
                lambda tried_s: self._bright_shares(tried_s, [polarizer_angle_deg]),
                self._metering.model_copy(update=shorter),
            )
        except DeviceError:
            return None
        return exposure_s if max(shares.values()) <= _CLIPPED else None

    def _metered(self, number: int) -> float:
        angles = {s.polarizer_angle_deg for s in self._steps if s.round == number and s.kind == "scene"}
        ordered = sorted(angles, key=lambda angle: angle or 0.0)
        self._work.present("scene")
        exposure_s, shares, remark = meter(lambda tried_s: self._bright_shares(tried_s, ordered), self._metering)
        self._writer.event(
            METERED_EVENT,
            round=number,
            exposure_s=exposure_s,
            shares={str(angle): share for angle, share in shares.items()},
            remark=remark,
            next_camera_frame=self._next_camera_frame,
        )
        return exposure_s

    def _bright_shares(self, exposure_s: float, angles_deg: Sequence[float | None]) -> Shares:
        """Return the share of each angle; a mosaic camera needs one exposure for all."""
        if any(step.part is not None for step in self._steps):
            parts = self._work.capture_parts(exposure_s=exposure_s)
            return {angle_deg: self._share(captured) for angle_deg, captured in parts.items()}
        return {
            angle_deg: self._share(self._work.capture(exposure_s=exposure_s, polarizer_angle_deg=angle_deg))
            for angle_deg in angles_deg
        }

    def _share(self, captured: CapturedFrame) -> float:
        frame = captured.frame
        self._next_camera_frame = frame.sequence + 1
        full_dn = float(2**frame.settings.bit_depth - 1)
        return bright_share(frame.counts, quantile=self._metering.quantile, full_dn=full_dn)


def meter(probe: Probe, section: MeteringSection) -> tuple[float, Shares, str | None]:
    """Return the exposure for all angles [s], the share that it gives at each angle, and remarks.

    The brightest angle decides. Because of the black level, counts are not proportional to the exposure; the search
    ends when the share is within a tenth of its target, or the exposure is at a limit.
    """
    exposure_s = section.first_exposure_ms / _MS_PER_S
    for _ in range(_MOST_ROUNDS):
        shares = probe(exposure_s)
        wanted_s = _next_exposure_s(exposure_s, max(shares.values()), section)
        if abs(wanted_s - exposure_s) <= _NEAR * exposure_s:
            break
        exposure_s = wanted_s
    return exposure_s, shares, _remark(shares, section)


def record_of(
    step: Step,
    captured: CapturedFrame,
    *,
    rig: Rig,
    rig_file: RigFile,
    sun: SunAngles | None,
    site: SiteSection | None,
    camera_temperature_c: float | None,
    remarks: tuple[str, ...],
) -> FrameRecord:
    """Return the record of a frame before it is stored."""
    frame, move, stage = captured.frame, captured.move, rig.stage_identity
    return FrameRecord(
        kind=step.kind,
        sequence=step.sequence,
        cycle=step.cycle,
        round=None if step.due_ns is None else step.round,
        polarizer_angle_target_deg=step.polarizer_angle_deg,
        polarizer_angle_deg=_polarizer_angle_deg(step, move, rig_file),
        stage_angle_target_deg=None if move is None else move.target_deg,
        stage_angle_deg=None if move is None else move.position.angle_deg,
        stage_counts=None if move is None else move.position.counts,
        stage_tries=None if move is None else move.tries,
        settle_s=None if move is None else move.duration_s,
        exposure_s=frame.settings.exposure_s,
        gain_db=frame.settings.gain_db,
        bit_depth=frame.settings.bit_depth,
        saturation_dn=float(2**frame.settings.bit_depth - 1),
        start_utc=utc_text(frame.start_utc_ns),
        end_utc=utc_text(frame.end_utc_ns),
        start_monotonic_ns=frame.start_monotonic_ns,
        start_uncertainty_s=frame.start_uncertainty_s,
        start_source=frame.start_source,
        camera_frame=frame.sequence,
        exposure_id=None if step.part is None else step.sequence - step.part,
        camera_temperature_c=camera_temperature_c,
        camera_model=rig.camera_identity.model,
        camera_serial=rig.camera_identity.serial_number,
        filter_name=rig_file.camera.filter,
        stage_model=None if stage is None else stage.model,
        stage_serial=None if stage is None else stage.serial_number,
        sun_azimuth_deg=None if sun is None else sun.azimuth_deg,
        sun_elevation_deg=None if sun is None else sun.elevation_deg,
        site_latitude_deg=None if site is None else site.latitude_deg,
        site_longitude_deg=None if site is None else site.longitude_deg,
        site_elevation_m=None if site is None else site.elevation_m,
        remarks=(*(() if move is None else move.remarks), *remarks),
    )


def bright_share(counts: NDArray[np.uint16], *, quantile: float, full_dn: float) -> float:
    """Return a quantile of the pixels as a share of the largest count."""
    return float(np.quantile(counts, quantile, method="lower")) / full_dn


def _next_exposure_s(exposure_s: float, brightest: float, section: MeteringSection) -> float:
    factor = _SHORTEN if brightest > _CLIPPED else min(_LENGTHEN_AT_MOST, section.target / max(brightest, 1e-9))
    wanted_s = min(max(exposure_s * factor, section.shortest_ms / _MS_PER_S), section.longest_ms / _MS_PER_S)
    # Cameras count whole microseconds.
    return round(wanted_s, 6)


def _remark(shares: Shares, section: MeteringSection) -> str | None:
    if max(shares.values()) > _CLIPPED:
        return f"the brightest angle saturates at the shortest exposure, {section.shortest_ms:g} ms: stop down"
    if min(shares.values()) < section.least:
        text = f"the darkest angle reaches {min(shares.values()):.3f} of the range, wanted are {section.least:g}"
        return f"{text}: one exposure cannot serve all angles, give a bracket such as [1, 4]"
    return None


def _polarizer_angle_deg(step: Step, move: Move | None, rig_file: RigFile) -> float | None:
    """Return the polarizer axis of a frame: of its place in the cell, or by the stage's readback."""
    if step.part is not None and rig_file.cell_deg is not None:
        return rig_file.cell_deg[step.part]
    if move is None:
        return None
    polarizer = rig_file.polarizer
    return (polarizer.sense * move.position.angle_deg + polarizer.offset_deg) % 180.0
