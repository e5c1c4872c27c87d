"""The file ``status.json`` of a run folder: how the session stands now, for whoever looks from another terminal."""

import json
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

from pydantic import ConfigDict, Field, JsonValue, TypeAdapter, ValidationError, with_config

from rigctl.errors import RunFolderError
from rigctl.files.choices import FrameKind
from rigctl.measurement.fault_terms import Fault
from rigctl.numbers.number_range import LARGEST
from rigctl.runs.run_description import explain_invalid
from rigctl.storage.bounded_file import MOST_TEXT_BYTES, read_bounded

STATUS_FILE = "status.json"


class DarkSource(StrEnum):
    """Where a dark level comes from, as the file has it."""

    FRAMES = "dark frames"
    CALIBRATION = "calibration"
    UNKNOWN = "not known: DoLP reads too low"


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A number and its standard deviation by the camera's noise; None without a calibration."""

    value: float
    sigma: float | None


@dataclass(frozen=True, kw_only=True)
class RegionPolarization:
    """Polarization of the light of a region.

    Attributes
    ----------
    dolp : Estimate
        Of the region's mean: naive, hence biased upward where it is of the size of its deviation.
    aolp_deg : float or None
        Angle of polarization in [0, 180); None without polarization.
    light_dn_per_s : float
        S0 of the region's mean, in counts a second.
    aolp_sigma_deg : float or None
        Deviation of the angle to first order; None where no noise is known, or there is no polarization.
    """

    dolp: Estimate
    aolp_deg: float | None
    light_dn_per_s: float
    aolp_sigma_deg: float | None = None


@dataclass(frozen=True, kw_only=True)
class AngleNumbers:
    """The last frame at an angle: mean of the picture and of its regions [DN], share of saturated pixels."""

    mean_dn: float
    saturated_fraction: float
    exposure_ms: float
    regions_dn: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class CyclePlace:
    """Which cycle the numbers are of."""

    round: int | None
    cycle: int | None
    exposure_ms: float


@dataclass(frozen=True, kw_only=True)
class DarkLevel:
    """What the camera counts in the dark [DN], 0 where it is not known."""

    source: DarkSource
    mean_dn: float


@dataclass(frozen=True, kw_only=True)
class RegionDrift:
    """Drift of the light in a region: a minute, with its standard deviation, and in all over a time [s]."""

    region: str
    per_min: float
    sigma_per_min: float | None
    change: float
    over_s: float


@dataclass(frozen=True, kw_only=True)
class LiveDiagnosis:
    """What the last whole cycle says of its faults: those found, the strongest first, or why nothing can be said."""

    terms: tuple[Fault, ...]
    first: str | None
    reason: str


@with_config(ConfigDict(allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class LiveContent:
    """What the frames show, of the last whole cycle; `angles` by the polarizer's angle as text."""

    angles: dict[str, AngleNumbers]
    cycle: CyclePlace | None = None
    dark: DarkLevel | None = None
    sum_rule: Estimate | None = None
    regions: dict[str, RegionPolarization]
    drift: RegionDrift | None
    diagnosis: LiveDiagnosis | None = None


@dataclass(frozen=True, kw_only=True)
class LastStep:
    """The frame that was stored last."""

    sequence: int
    kind: FrameKind
    cycle: int
    angle_deg: float | None


@with_config(ConfigDict(allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class StepProgress:
    """How far a session is: its last frame, and when it will end."""

    last: LastStep
    remaining_s: Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
    end_utc: str


@dataclass(frozen=True, kw_only=True)
class LiveStatus:
    """How a session stands.

    Attributes
    ----------
    session : str
        Its name.
    frames_planned, frames : int
        How many there will be, and are.
    written_utc : str
        When this was said.
    progress : StepProgress or None
        None before its first frame.
    numbers : LiveContent or None
        What the frames show; None until there is one.
    """

    session: str
    frames_planned: int
    frames: int
    written_utc: str = ""
    progress: StepProgress | None = None
    numbers: LiveContent | None = None


_STATUS, _PROGRESS, _NUMBERS = TypeAdapter(LiveStatus), TypeAdapter(StepProgress), TypeAdapter(LiveContent)


def status_json(status: LiveStatus) -> dict[str, JsonValue]:
    """Return a status as the file has it: the parts that are there, side by side."""
    content = asdict(status)
    parts = (content.pop("progress"), content.pop("numbers"))
    return content | {key: value for part in parts if part is not None for key, value in part.items()}


def write_status(run: Path, status: LiveStatus) -> None:
    """Replace the status, in one step and without waiting for the disk: it is of no worth after a power cut.

    Raises
    ------
    OSError
        It cannot be written.
    """
    beside = run / f".{STATUS_FILE}"
    beside.write_text(json.dumps(status_json(status), allow_nan=False) + "\n", encoding="ascii")
    beside.replace(run / STATUS_FILE)


def read_status(run: Path) -> LiveStatus | None:
    """Return the status, or None where the session never wrote one.

    Raises
    ------
    RunFolderError
        It cannot be read.
    """
    file = run / STATUS_FILE
    if not file.exists():
        return None
    try:
        content = read_bounded(file, MOST_TEXT_BYTES)
        head, keys = _STATUS.validate_json(content), set(json.loads(content))
        return replace(
            head,
            progress=_PROGRESS.validate_json(content) if "last" in keys else None,
            numbers=_NUMBERS.validate_json(content) if "angles" in keys else None,
        )
    except OSError as error:
        raise RunFolderError(f"{file}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        raise RunFolderError(f"{file}: is no status: {explain_invalid(error)}") from error
