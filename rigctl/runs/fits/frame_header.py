"""Header of a frame's file: all of its record, so that a lost manifest can be made again."""

from dataclasses import dataclass

from pydantic import ValidationError

from rigctl.errors import DataError
from rigctl.runs.fits.fits_card import CardValue
from rigctl.runs.fits.fits_frame import FitsFrame
from rigctl.runs.frame_record import FRAME_RECORD, FrameRecord
from rigctl.runs.run_description import explain_invalid
from rigctl.version import VERSION


@dataclass(frozen=True, kw_only=True)
class _Keyword:
    field: str
    name: str
    comment: str


_KEYWORDS = tuple(
    _Keyword(field=field, name=name, comment=comment)
    for field, name, comment in (
        ("kind", "IMAGETYP", "scene, dark or flat"),
        ("sequence", "SEQ", "place in the order of the run, from 0"),
        ("cycle", "CYCLE", "repeat of the set of angles, from 0"),
        ("start_utc", "DATE-OBS", "start of exposure, UTC"),
        ("end_utc", "DATE-END", "end of exposure, UTC"),
        ("start_monotonic_ns", "MONONS", "[ns] start of exposure, host clock"),
        ("start_uncertainty_s", "TIMSYER", "[s] by which DATE-OBS may be off at most"),
        ("start_source", "TIMESRC", "what DATE-OBS was found by"),
        ("exposure_s", "EXPTIME", "[s] exposure"),
        ("gain_db", "GAINDB", "[dB] setting of the camera"),
        ("egain_e_per_dn", "EGAIN", "[e-/DN] electrons per count"),
        ("bit_depth", "BITDEPTH", "bits per sample, right-justified"),
        ("black_level_dn", "BLKLEVEL", "[DN] counts without light"),
        ("saturation_dn", "SATURATE", "[DN] saturated at and above"),
        ("missing_dn", "MISSDN", "[DN] marks a pixel not received"),
        ("saturated_fraction", "SATFRAC", "share of saturated pixels"),
        ("polarizer_angle_target_deg", "POLANG", "[deg] transmission axis, commanded"),
        ("polarizer_angle_deg", "POLMEAS", "[deg] transmission axis, readback"),
        ("stage_angle_target_deg", "STGANG", "[deg] stage, commanded"),
        ("stage_angle_deg", "STGMEAS", "[deg] stage, readback"),
        ("stage_counts", "STGCNT", "stage, counts of the encoder"),
        ("camera_model", "CAMERA", "camera"),
        ("camera_serial", "CAMSN", "its serial number"),
        ("stage_model", "STAGE", "rotation stage"),
        ("stage_serial", "STAGESN", "its serial number"),
        ("stage_tries", "POLTRY", "commands of the move until within tolerance"),
        ("settle_s", "SETTLE", "[s] command of the move to accepted readback"),
        ("camera_frame", "CAMFRAME", "the camera's own frame counter"),
        ("exposure_id", "EXPOID", "frames of one exposure have the same"),
        ("camera_temperature_c", "CCD-TEMP", "[deg C] camera, as it says"),
        ("round", "ROUND", "round of the schedule, from 0"),
        ("sun_azimuth_deg", "SUNAZ", "[deg] sun, clockwise from north"),
        ("sun_elevation_deg", "SUNEL", "[deg] sun, no refraction"),
        ("site_latitude_deg", "SITELAT", "[deg] north positive"),
        ("site_longitude_deg", "SITELONG", "[deg] east positive"),
        ("site_elevation_m", "SITEELEV", "[m] above the sea"),
        ("source_file", "SRCFILE", "imported from"),
    )
)
_TIMES = ("start_utc", "end_utc")
_REMARK = "REMARK"
_MOST_REMARKS = 99


def header_cards(record: FrameRecord) -> dict[str, tuple[CardValue, str]]:
    """Return what the header of a frame is to say, by keyword: value and comment.

    Raises
    ------
    ValueError
        The record has more remarks than there are keywords for, or a time that is not marked as UTC.
    """
    if len(record.remarks) > _MOST_REMARKS:
        raise ValueError(f"remarks: {len(record.remarks)} given, at most {_MOST_REMARKS} fit a frame")
    for time in filter(None, (record.start_utc, record.end_utc)):
        if not time.endswith("Z"):
            raise ValueError(f"start_utc, end_utc: {time!r} must be UTC and end in Z, as utc_text writes it")
    cards: dict[str, tuple[CardValue, str]] = {"TIMESYS": ("UTC", "")}
    for keyword in _KEYWORDS:
        value = getattr(record, keyword.field)
        if value is not None:
            # A FITS date has no zone; TIMESYS says that it is UTC.
            stated = value.removesuffix("Z") if keyword.field in _TIMES else value
            cards[keyword.name] = (stated, keyword.comment)
    cards |= {f"{_REMARK}{i}": (text, "") for i, text in enumerate(record.remarks, start=1)}
    return cards | {"SWVER": (f"rigctl {VERSION}", "program")}


def record_from_header(frame: FitsFrame, *, file: str, checksum: str) -> FrameRecord:
    """Return the record that a frame's own header stands for.

    Parameters
    ----------
    frame : FitsFrame
        The frame as read.
    file, checksum : str
        What a file cannot say of itself: its path in the run and the checksum of the whole.

    Raises
    ------
    DataError
        The header lacks something, or has a value of the wrong kind.
    """
    values: dict[str, object] = {k.field: frame.values.get(k.name) for k in _KEYWORDS}
    for field in _TIMES:
        values[field] = f"{values[field]}Z" if values[field] is not None else None
    height, width = frame.counts.shape
    values |= {"height": height, "width": width, "file": file, "checksum": checksum}
    values["remarks"] = _remarks(frame.values)
    try:
        # The values are text still; each field's type reads its own.
        return FRAME_RECORD.validate_python(values, strict=False)
    except ValidationError as error:
        raise DataError(f"{file}: the header does not describe a frame: {explain_invalid(error)}") from error


def _remarks(values: dict[str, str | None]) -> tuple[str, ...]:
    names = (f"{_REMARK}{i}" for i in range(1, _MOST_REMARKS + 1))
    return tuple(values[name] or "" for name in names if name in values)
