"""Record of one frame: all that is known of it, as its line in the manifest and its own header hold it."""

from collections.abc import Iterable
from dataclasses import dataclass

from pydantic import ConfigDict, TypeAdapter, with_config

from rigctl.files.choices import FrameKind

# Frames of one exposure of a camera with polarizers on its pixels, a cell of 2 x 2.
EXPOSURE_PARTS = 4


@with_config(ConfigDict(extra="forbid", strict=True, allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class FrameRecord:
    """All that is known of one frame. ``None`` is "not known" or "does not apply", never a default.

    Attributes
    ----------
    kind : {"scene", "dark", "flat"}
        What the camera looked at.
    sequence : int
        Place in the order in which the frames of this run were taken, from 0; unique in the run.
    cycle : int or None
        Which repeat of the set of angles this is, from 0.
    polarizer_angle_target_deg : float or None
        Transmission axis that was asked for [deg], counter-clockwise from horizontal in the picture.
    polarizer_angle_deg : float or None
        Transmission axis by the stage's readback [deg], same sense. This one is for processing.
    stage_angle_target_deg, stage_angle_deg : float or None
        What the stage was told, and what its encoder said [deg].
    stage_counts : int or None
        The encoder's own counts.
    exposure_s : float or None
        Integration time [s].
    gain_db : float or None
        The camera's gain setting [dB].
    egain_e_per_dn : float or None
        Electrons per DN, where somebody states it [e-/DN].
    bit_depth : int
        Bits per sample, right-justified.
    black_level_dn : float or None
        Counts without light [DN], where known without dark frames.
    saturation_dn : float
        A pixel at or above this many counts is saturated [DN].
    missing_dn : float or None
        The value that marks pixels which were never received [DN].
    start_utc, end_utc : str or None
        Start and end of the exposure, as ``rigctl.numbers.utc_time.utc_text`` writes them.
    start_monotonic_ns : int or None
        Start of the exposure on the host's monotonic clock [ns].
    start_uncertainty_s : float or None
        By how much `start_utc` may be off at most, the host's clock taken for right (that of the PTP master, where the
        source is "ptp") [s].
    start_source : str or None
        What the start was found by: "ptp", "camera clock", "trigger", "arrival", "driver", "file" or "simulation"
        (`drivers.interfaces.StartSource`).
    camera_model, camera_serial, stage_model, stage_serial : str or None
        Which devices these were.
    stage_tries : int or None
        How many times the move was commanded until the readback was within tolerance.
    settle_s : float or None
        From the command of the move to the readback that was accepted [s].
    camera_frame : int or None
        The camera's own frame counter.
    exposure_id : int or None
        Frames that bear the same number are parts of one exposure, of a camera with polarizers on its pixels: the
        sequence number of the first of them.
    camera_temperature_c : float or None
        What the camera said of its temperature, ten seconds before the exposure at most [deg C].
    round : int or None
        Which round of a schedule this frame belongs to, from 0.
    sun_azimuth_deg, sun_elevation_deg : float or None
        Where the sun stood at the start of the exposure [deg]: azimuth clockwise from north, elevation without
        refraction.
    site_latitude_deg, site_longitude_deg : float or None
        Where the rig stands [deg], north and east positive.
    site_elevation_m : float or None
        How high above the sea it stands [m].
    source_file : str or None
        The file this frame was imported from.
    remarks : tuple of str
        What else one has to know.
    file : str
        Path relative to the run folder, with ``/``. Filled in by the writer, as all that follow.
    height, width : int
        Rows and columns.
    saturated_fraction : float
        Share of pixels at or above ``saturation_dn``, 0 to 1.
    checksum : str
        ``sha256:`` and 64 hexadecimal digits, over the whole file.
    """

    kind: FrameKind
    sequence: int
    bit_depth: int
    saturation_dn: float
    cycle: int | None = None
    polarizer_angle_target_deg: float | None = None
    polarizer_angle_deg: float | None = None
    stage_angle_target_deg: float | None = None
    stage_angle_deg: float | None = None
    stage_counts: int | None = None
    exposure_s: float | None = None
    gain_db: float | None = None
    egain_e_per_dn: float | None = None
    black_level_dn: float | None = None
    missing_dn: float | None = None
    start_utc: str | None = None
    end_utc: str | None = None
    start_monotonic_ns: int | None = None
    start_uncertainty_s: float | None = None
    start_source: str | None = None
    camera_model: str | None = None
    camera_serial: str | None = None
    stage_model: str | None = None
    stage_serial: str | None = None
    stage_tries: int | None = None
    settle_s: float | None = None
    camera_frame: int | None = None
    exposure_id: int | None = None
    camera_temperature_c: float | None = None
    round: int | None = None
    sun_azimuth_deg: float | None = None
    sun_elevation_deg: float | None = None
    site_latitude_deg: float | None = None
    site_longitude_deg: float | None = None
    site_elevation_m: float | None = None
    source_file: str | None = None
    remarks: tuple[str, ...] = ()
    file: str = ""
    height: int = 0
    width: int = 0
    saturated_fraction: float = 0.0
    checksum: str = ""


FRAME_RECORD = TypeAdapter(FrameRecord)

# How people are told what a start was found by.
START_SOURCES = {
    "ptp": "by the camera's clock, which follows a PTP master",
    "camera clock": "by the camera's clock, held against this machine's",
    "trigger": "between the trigger and the first packet",
    "arrival": "before the first packet came in",
    "driver": "by the time stamp of the video driver",
    "file": "by the last change of the file",
    "simulation": "as simulated",
}


def start_time_texts(frames: Iterable[FrameRecord]) -> tuple[str, ...]:
    """Return how well the starts of exposures are known, one text a source; nothing of frames that do not tell."""
    errors_s: dict[str, list[float | None]] = {}
    for frame in frames:
        if frame.start_source is not None:
            errors_s.setdefault(frame.start_source, []).append(frame.start_uncertainty_s)
    return tuple(
        f"{START_SOURCES.get(source, source)}: {len(found)} frames, {_largest_text(found)}"
        for source, found in errors_s.items()
    )


def start_error_text(error_s: float | None) -> str:
    """Return by how much a start may be off, for people."""
    if error_s is None:
        return "by how much it may be off is not known"
    if error_s >= 1e-3:
        return f"off by {error_s * 1e3:.3g} ms at most"
    return f"off by {error_s * 1e6:.3g} us at most"


def _largest_text(errors_s: list[float | None]) -> str:
    known = [error_s for error_s in errors_s if error_s is not None]
    missing = len(errors_s) - len(known)
    return start_error_text(max(known, default=None)) + (f" (not known of {missing})" if known and missing else "")
