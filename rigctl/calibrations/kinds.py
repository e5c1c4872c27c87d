"""Kinds of calibrations, the devices and settings of each, and the check that it fits frames.

A calibration belongs to the devices and settings of its frames, and holds for some time (`MadeFor`). Frames of another
camera or setting are refused (`require_fit`); a calibration that is old, or of another temperature, gives a warning. A
file with a value that is not finite or out of range is refused (`Measured`, `Bounded`).
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Annotated, Generic, Literal, TypeVar
from urllib.parse import parse_qsl

from pydantic import AfterValidator, Field

from rigctl.base.durable import open_plain
from rigctl.base.numbers import is_utc_text, utc_moment
from rigctl.console import Json
from rigctl.errors import DataError

if TYPE_CHECKING:
    from rigctl.calibrations.record import CalibrationRecord
    from rigctl.files.rig_file import RigFile
    from rigctl.runs.folder import Run
    from rigctl.runs.records import FrameRecord

# Larger than any quantity of a camera or a stage in any unit of a file; its square is finite.
_LARGEST = 1e12

Bounded = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]
NotNegative = Annotated[float, Field(ge=0, le=_LARGEST)]
Positive = Annotated[float, Field(gt=0, le=_LARGEST)]

_Number = TypeVar("_Number", bound=float)
_Item = TypeVar("_Item")


CalibrationKind = Literal["noise", "polarizer", "flat", "radiometric", "registration"]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Properties of a kind of calibration."""

    name: str  #: in sentences
    record: str  #: module of this package, and class that reads it as a `CalibrationRecord` does
    of_stage: bool  #: belongs to a stage too
    of_gain: bool  #: depends on gain, bit depth and binning
    valid_days: float  #: validity where the file states none; a choice


KINDS: Mapping[CalibrationKind, Kind] = {
    "noise": Kind(
        name="noise calibration", record="noise:NoiseParameters", of_stage=False, of_gain=True, valid_days=365.0
    ),
    # until the polarizer is taken out of its mount
    "polarizer": Kind(
        name="polarizer calibration",
        record="polarizer:PolarizerParameters",
        of_stage=True,
        of_gain=False,
        valid_days=180.0,
    ),
    # dust moves
    "flat": Kind(name="flat field", record="flat:FlatFields", of_stage=True, of_gain=True, valid_days=30.0),
    # lenses and filters gather dust
    "radiometric": Kind(
        name="radiometric calibration",
        record="radiometric:RadiometricResponse",
        of_stage=False,
        of_gain=True,
        valid_days=90.0,
    ),
    "registration": Kind(
        name="registration", record="registration:ImageRegistration", of_stage=True, of_gain=False, valid_days=180.0
    ),
}


# A file states its kind within this many characters.
_HEAD_BYTES = 1000
_KIND = re.compile(rb'"kind"\s*:\s*"([a-z]{3,20})"')


def record_of(kind: CalibrationKind) -> "type[CalibrationRecord]":
    """Return the class of a kind; it is imported only when needed, as that takes a tenth of a second."""
    module, _, name = KINDS[kind].record.partition(":")
    found: type[CalibrationRecord] = getattr(import_module(f"rigctl.calibrations.{module}"), name)
    return found


def kind_of(file: Path) -> CalibrationKind | None:
    """Return the kind of a calibration from the beginning of its file; None for any other file."""
    if file.suffix == ".npz":
        return "flat"
    try:
        with open_plain(file) as content:
            named = _KIND.search(content.read(_HEAD_BYTES))
    except OSError:
        return None
    return None if named is None else next((kind for kind in KINDS if kind == named[1].decode("ascii")), None)


@dataclass(frozen=True, kw_only=True)
class Measured(Generic[_Number]):
    """A number with the standard deviation of its error, in the unit that its name ends in."""

    value: _Number
    std_error: NotNegative


@dataclass(frozen=True, kw_only=True)
class MeasuredOverFrames(Generic[_Number]):
    """As `Measured`, with the number of frames."""

    value: _Number
    std_error: NotNegative
    n: Annotated[int, Field(ge=1)]


def at_least(count: int) -> AfterValidator:
    """Return a validator that checks the items of a list, then their number."""

    def checked(items: tuple[_Item, ...]) -> tuple[_Item, ...]:
        if len(items) < count:
            raise ValueError(f"has {len(items)} items, must have at least {count}")
        return items

    return AfterValidator(checked)


def _checked_utc(text: str) -> str:
    if not is_utc_text(text):
        raise ValueError(f"is {text!r}, must be a time such as 2026-05-04T10:00:00Z")
    return text


UtcText = Annotated[str, AfterValidator(_checked_utc)]


_Fact = TypeVar("_Fact")
Count = Annotated[int, Field(ge=1)]


@dataclass(frozen=True, kw_only=True)
class MadeFor:
    """Devices, settings and time of frames; None where not known or not the same for all frames."""

    camera_model: str | None = None  #: devices
    camera_serial: str | None = None
    stage_model: str | None = None
    stage_serial: str | None = None
    gain_db: Bounded | None = None  #: The camera's gain setting [dB].
    bit_depth: Count | None = None  #: Bits of a sample.
    pixel_format: str | None = None  #: format of samples on the wire, such as Mono12Packed
    binning: Count | None = None  #: Pixels of the sensor per pixel of the picture, along each side.
    temperature_c: Bounded | None = None  #: Read from the camera; the mean over the frames [deg C].
    taken_utc: UtcText | None = None  #: Start of the last frame.
    valid_days: NotNegative | None = None  #: Validity that its maker stated.
    exposure_range_s: tuple[NotNegative, NotNegative] | None = None  #: Exposures of the frames [s].

    def as_json(self) -> dict[str, Json]:
        """Return the ``made_for`` of a calibration file."""
        return asdict(self)


def made_for(run: "Run", records: Sequence["FrameRecord"]) -> MadeFor:
    """Return devices, settings and time of some frames of a run."""
    options = _options(run.session.camera_address)
    temperatures = [one.camera_temperature_c for one in records if one.camera_temperature_c is not None]
    exposures_s = [one.exposure_s for one in records if one.exposure_s is not None]
    starts = [time for time in (record.start_utc for record in records) if time is not None and is_utc_text(time)]
    return MadeFor(
        camera_model=_shared(record.camera_model for record in records),
        camera_serial=_shared(record.camera_serial for record in records),
        stage_model=_shared(record.stage_model for record in records),
        stage_serial=_shared(record.stage_serial for record in records),
        gain_db=_shared(record.gain_db for record in records),
        bit_depth=_shared(record.bit_depth for record in records),
        pixel_format=options.get("pixel_format"),
        binning=_binning(options),
        temperature_c=fmean(temperatures) if temperatures else None,
        taken_utc=max(starts, default=None),
        exposure_range_s=(min(exposures_s), max(exposures_s)) if exposures_s else None,
    )


def made_for_rig(rig: "RigFile", *, now_utc: str) -> MadeFor:
    """Return devices and settings of the next frames of a rig, as far as its file states them."""
    options = _options(rig.camera.address)
    return MadeFor(
        camera_serial=rig.camera.serial_number,
        stage_serial=None if rig.stage is None else rig.stage.serial_number,
        gain_db=rig.camera.gain_db,
        pixel_format=options.get("pixel_format"),
        binning=_binning(options),
        taken_utc=now_utc,
    )


def made_for_of_file(kind: CalibrationKind, made_for: MadeFor | None, *, created_utc: str | None) -> MadeFor:
    """Return the devices, settings and time of a calibration; time of its file and validity of its kind by default."""
    found = MadeFor() if made_for is None else made_for
    if found.valid_days is None:
        found = replace(found, valid_days=KINDS[kind].valid_days)
    return found if found.taken_utc is not None else replace(found, taken_utc=created_utc)


def _options(address: str) -> dict[str, str]:
    """Return the options of a camera's address in the rig file: ``gige:NAME?pixel_format=Mono12&binning=2``."""
    return dict(parse_qsl(address.partition("?")[2]))


def _binning(options: Mapping[str, str]) -> int | None:
    text = options.get("binning", "")
    return int(text) if text.isdecimal() else None


def _shared(facts: Iterable[_Fact | None]) -> _Fact | None:
    different = set(facts)
    return different.pop() if len(different) == 1 else None


# Names of everything that must be equal where both sides know it. A gain was read back, so it may differ slightly.
_CAMERA = {"camera serial number": "camera_serial"}
_SETTINGS = {"gain setting [dB]": "gain_db", "bit depth": "bit_depth", "binning": "binning"}
_STAGE = {"stage serial number": "stage_serial"}
_GAIN_STEP_DB = 0.05
# Dark current doubles every 6 to 8 K: beyond this difference it is wrong by half or more.
_TEMPERATURE_STEP_K = 5.0
# Beyond this ratio of exposures, dark current matters that the calibration hardly measured; a choice.
_LONGER = 10.0
_SECONDS_A_DAY = 86400.0


def require_fit(kind: CalibrationKind, calibration: MadeFor, used: MadeFor) -> tuple[str, ...]:
    """Return doubts about using a calibration for frames; DataError for other devices or settings."""
    what = KINDS[kind].name
    wrong = misfits(kind, calibration, used)
    if wrong:
        raise DataError(
            f"the {what} was made for other devices or settings: {'; '.join(wrong)}; give the calibration that belongs "
            "to them, or make one (rigctl calibrate)"
        )
    return tuple(_doubts(what, calibration, used))


def misfits(kind: CalibrationKind, calibration: MadeFor, used: MadeFor) -> tuple[str, ...]:
    """Return the devices and settings that differ from those of a calibration, as text."""
    facts = _CAMERA | (_SETTINGS if KINDS[kind].of_gain else {}) | (_STAGE if KINDS[kind].of_stage else {})
    return tuple(
        f"{name}: calibrated {getattr(calibration, key)}, used {getattr(used, key)}"
        for name, key in facts.items()
        if _differ(getattr(calibration, key), getattr(used, key))
    )


def age_days(calibration: MadeFor, used: MadeFor) -> float | None:
    """Return the days from a calibration to frames, below 0 if it came after them; None if not known."""
    if calibration.taken_utc is None or used.taken_utc is None:
        return None
    return (utc_moment(used.taken_utc) - utc_moment(calibration.taken_utc)).total_seconds() / _SECONDS_A_DAY


def is_too_old(calibration: MadeFor, used: MadeFor) -> bool:
    """Return whether the days between a calibration and frames exceed its validity."""
    days = age_days(calibration, used)
    return days is not None and calibration.valid_days is not None and abs(days) > calibration.valid_days


def temperature_step_k(calibration: MadeFor, used: MadeFor) -> float | None:
    """Return the temperature of frames less that of a calibration [K]; None if it is small or not known."""
    if calibration.temperature_c is None or used.temperature_c is None:
        return None
    step_k = used.temperature_c - calibration.temperature_c
    return step_k if abs(step_k) > _TEMPERATURE_STEP_K else None


def is_beyond_exposures(calibration: MadeFor, used: MadeFor) -> bool:
    """Return whether frames were exposed more than ten times as long as those of a calibration."""
    made, now = calibration.exposure_range_s, used.exposure_range_s
    return made is not None and now is not None and now[1] > _LONGER * made[1]


def _differ(one: object, other: object) -> bool:
    if one is None or other is None:
        return False
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) > _GAIN_STEP_DB
    return one != other


def _doubts(what: str, calibration: MadeFor, used: MadeFor) -> Iterable[str]:
    days = age_days(calibration, used)
    if days is not None and is_too_old(calibration, used):
        yield (
            f"{what}: made {abs(days):.0f} days from the frames, valid for {calibration.valid_days:g}: make a new one, "
            "or give --valid-days when you make one"
        )
    if temperature_step_k(calibration, used) is not None:
        yield (
            f"{what}: made at {calibration.temperature_c:.1f} deg C, used at {used.temperature_c:.1f} deg C; dark "
            "current doubles every 6 to 8 K: calibrate at the temperature of use"
        )
    if _differ(calibration.pixel_format, used.pixel_format):
        yield f"{what}: made with pixel format {calibration.pixel_format}, used with {used.pixel_format}"
    if is_beyond_exposures(calibration, used):
        longest_s = [1000.0 * one.exposure_range_s[1] for one in (calibration, used) if one.exposure_range_s]
        yield f"{what}: made with exposures up to {longest_s[0]:g} ms, used with {longest_s[1]:g} ms"
