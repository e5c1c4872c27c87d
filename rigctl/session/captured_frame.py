"""A frame as it came from the devices, and its record: what was asked for, and what devices, clocks and sun said."""

from dataclasses import dataclass

from drivers.interfaces import CameraSettings, Frame, Move
from rigctl.devices.rig import Rig
from rigctl.files.place import SiteSection
from rigctl.files.rig_file import RigFile
from rigctl.numbers.utc_time import utc_text
from rigctl.runs.frame_record import FrameRecord
from rigctl.session.interlocks import InterlockViolation
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
    saturated_fraction : float
        Share of saturated pixels.
    violations : tuple of InterlockViolation
        What was wrong with settings and frame counter.
    """

    frame: Frame
    settings: CameraSettings
    move: Move | None
    is_new_move: bool
    saturated_fraction: float
    violations: tuple[InterlockViolation, ...] = ()


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
    frame, move, polarizer = captured.frame, captured.move, rig_file.polarizer
    return FrameRecord(
        kind=step.kind,
        sequence=step.sequence,
        cycle=step.cycle,
        round=None if step.due_ns is None else step.round,
        polarizer_angle_target_deg=step.polarizer_angle_deg,
        polarizer_angle_deg=None
        if move is None
        else (polarizer.sense * move.position.angle_deg + polarizer.offset_deg) % 180.0,
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
        camera_frame=frame.sequence,
        camera_temperature_c=camera_temperature_c,
        camera_model=rig.camera_identity.model,
        camera_serial=rig.camera_identity.serial_number,
        stage_model=rig.stage_identity.model,
        stage_serial=rig.stage_identity.serial_number,
        sun_azimuth_deg=None if sun is None else sun.azimuth_deg,
        sun_elevation_deg=None if sun is None else sun.elevation_deg,
        site_latitude_deg=None if site is None else site.latitude_deg,
        site_longitude_deg=None if site is None else site.longitude_deg,
        site_elevation_m=None if site is None else site.elevation_m,
        remarks=(*(() if move is None else move.remarks), *remarks),
    )
