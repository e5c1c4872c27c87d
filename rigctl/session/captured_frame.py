"""A frame as it came from the devices, and its record: what was asked for, and what devices, clocks and sun said."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import CameraSettings, Frame, Move
from model.processing.mosaic import planes
from rigctl.devices.rig import Rig
from rigctl.files.place import SiteSection
from rigctl.files.rig_file import CameraSection, RigFile
from rigctl.numbers.utc_time import utc_text
from rigctl.runs.frame_record import FrameRecord
from rigctl.session.planning.session_steps import Step
from rigctl.session.planning.sun_track import SunAngles


@dataclass(frozen=True, kw_only=True, eq=False)
class CapturedFrame:
    """A frame, and how it came about.

    Attributes
    ----------
    frame : Frame
        What the camera gave.
    settings : CameraSettings
        What the camera said that it was set to.
    move : Move or None
        The last move of the stage.
    is_new_move : bool
        It was made for this frame.
    asked : (float, float)
        Exposure [s] and gain [dB] that it was told.
    number_before : int or None
        The camera's number of the frame before, where it is known.
    is_triggered : bool
        The camera's numbers follow each other.
    """

    frame: Frame
    settings: CameraSettings
    move: Move | None
    is_new_move: bool
    asked: tuple[float, float]
    number_before: int | None = None
    is_triggered: bool = True

    @cached_property
    def saturated_fraction(self) -> float:
        """Share of saturated pixels."""
        counts, full_dn = self.frame.counts, 2**self.frame.settings.bit_depth - 1
        return np.count_nonzero(counts >= full_dn) / counts.size

    def parts(self, camera: CameraSection) -> tuple["CapturedFrame", ...]:
        """Return the frame behind each place of the cell of a camera with polarizers on its pixels; else the frame."""
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
    """Return all that is known of a frame before it is stored."""
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
        stage_model=None if stage is None else stage.model,
        stage_serial=None if stage is None else stage.serial_number,
        sun_azimuth_deg=None if sun is None else sun.azimuth_deg,
        sun_elevation_deg=None if sun is None else sun.elevation_deg,
        site_latitude_deg=None if site is None else site.latitude_deg,
        site_longitude_deg=None if site is None else site.longitude_deg,
        site_elevation_m=None if site is None else site.elevation_m,
        remarks=(*(() if move is None else move.remarks), *remarks),
    )


def _polarizer_angle_deg(step: Step, move: Move | None, rig_file: RigFile) -> float | None:
    """Return the axis that a frame was taken behind: that of its place in the cell, or by the stage's readback."""
    if step.part is not None and rig_file.cell_deg is not None:
        return rig_file.cell_deg[step.part]
    if move is None:
        return None
    polarizer = rig_file.polarizer
    return (polarizer.sense * move.position.angle_deg + polarizer.offset_deg) % 180.0
