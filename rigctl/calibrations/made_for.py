"""Origin of a calibration: devices, settings, temperature and time, and for how long it holds."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from statistics import fmean
from typing import TYPE_CHECKING, Annotated, TypeVar
from urllib.parse import parse_qsl

from pydantic import Field

from rigctl.calibrations.checked_values import Bounded, NotNegative, UtcText
from rigctl.console.json_text import Json
from rigctl.numbers.utc_time import is_utc_text

if TYPE_CHECKING:
    from rigctl.files.rig_file import RigFile
    from rigctl.runs.frame_record import FrameRecord
    from rigctl.runs.run_folder import Run

_Fact = TypeVar("_Fact")
Count = Annotated[int, Field(ge=1)]


@dataclass(frozen=True, kw_only=True)
class MadeFor:
    """Devices, settings and time of frames; None is "not known", or differs from frame to frame.

    Attributes
    ----------
    camera_model, camera_serial, stage_model, stage_serial : str or None
        Which devices.
    gain_db : float or None
        The camera's gain setting [dB].
    bit_depth : int or None
        Bits of a sample.
    pixel_format : str or None
        How samples come over the wire, such as Mono12Packed.
    binning : int or None
        Pixels of the sensor that make one of the picture, along each side.
    temperature_c : float or None
        Of the camera, as it says itself; the mean over the frames [deg C].
    taken_utc : str or None
        Start of the last frame.
    valid_days : float or None
        For how long its maker trusts it.
    exposure_range_s : (shortest, longest) or None
        Exposures of the frames [s].
    """

    camera_model: str | None = None
    camera_serial: str | None = None
    stage_model: str | None = None
    stage_serial: str | None = None
    gain_db: Bounded | None = None
    bit_depth: Count | None = None
    pixel_format: str | None = None
    binning: Count | None = None
    temperature_c: Bounded | None = None
    taken_utc: UtcText | None = None
    valid_days: NotNegative | None = None
    exposure_range_s: tuple[NotNegative, NotNegative] | None = None

    def as_json(self) -> dict[str, Json]:
        """Return it as calibration files hold it, under ``made_for``."""
        return asdict(self)


def made_for(run: "Run", records: Sequence["FrameRecord"]) -> MadeFor:
    """Return what some frames of a run were made with.

    Parameters
    ----------
    run : Run
        Its session says how the camera was reached, where that is known.
    records : sequence of FrameRecord
        The frames in question.
    """
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
    """Return what frames of a rig will be taken with, as far as its file says so.

    Parameters
    ----------
    rig : RigFile
        The rig.
    now_utc : str
        When.
    """
    options = _options(rig.camera.address)
    return MadeFor(
        camera_serial=rig.camera.serial_number,
        stage_serial=None if rig.stage is None else rig.stage.serial_number,
        gain_db=rig.camera.gain_db,
        pixel_format=options.get("pixel_format"),
        binning=_binning(options),
        taken_utc=now_utc,
    )


@dataclass(frozen=True, kw_only=True)
class CameraOfVersion1:
    """The camera of a noise calibration of version 1, which has it in place of `MadeFor`."""

    model: str | None = None
    serial: str | None = None
    gain_db: Bounded | None = None
    bit_depth: Count | None = None

    def made_for(self) -> MadeFor:
        """Return what it says of devices and settings."""
        return MadeFor(
            camera_model=self.model, camera_serial=self.serial, gain_db=self.gain_db, bit_depth=self.bit_depth
        )


def made_for_of_file(made_for: MadeFor | None, *, created_utc: str | None, valid_days: float) -> MadeFor:
    """Return what a calibration was made for, completed by what is known of its file.

    Parameters
    ----------
    made_for : MadeFor or None
        As the file says it.
    created_utc : str or None
        When the file was written: taken where it does not say when the frames were.
    valid_days : float
        Taken where the file does not say for how long it holds [days].
    """
    found = MadeFor() if made_for is None else made_for
    if found.valid_days is None:
        found = replace(found, valid_days=valid_days)
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
