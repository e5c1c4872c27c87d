"""Status of a session: the file ``status.json`` in its run, the same as text, and the state by its events."""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, JsonValue, TypeAdapter, ValidationError, with_config

from model.processing.reconstruction import aolp_is_defined
from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.base.numbers import LARGEST
from rigctl.errors import RunFolderError
from rigctl.measure.faults import Fault
from rigctl.runs.records import ASKED_EVENT, NOTICE_EVENT, TALLY_EVENT, RunEvent, explain_invalid

STATUS_FILE = "status.json"
State = Literal["running", "holding", "waiting", "finished", "stopped", "interrupted"]
_STATES: dict[str, State] = {"hold": "holding", "waiting": "waiting"}
# Events that do not change the state of a session.
_ASIDE = ("interlock", ASKED_EVENT, TALLY_EVENT, NOTICE_EVENT, "disk is short")
_S_PER_MIN = 60.0
_SIGNS = "+/-"


class DarkSource(StrEnum):
    """Source of a dark level, as in the file."""

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
    """Polarization of the light of a region."""

    dolp: Estimate  #: Of the region's mean: naive, hence biased upward where it is of the size of its deviation.
    aolp_deg: float | None  #: Angle of polarization in [0, 180); None without polarization.
    light_dn_per_s: float  #: S0 of the region's mean, in counts a second.
    #: Deviation of the angle to first order; None where no noise is known, or there is no polarization.
    aolp_sigma_deg: float | None = None

    @property
    def has_angle(self) -> bool:
        """True if there is an angle, and its deviation is unknown or below 180 deg."""
        sigma_deg = 0.0 if self.aolp_sigma_deg is None else self.aolp_sigma_deg
        return self.aolp_deg is not None and bool(aolp_is_defined(math.radians(sigma_deg)))


@dataclass(frozen=True, kw_only=True)
class AngleNumbers:
    """The last frame at an angle: mean of the picture and of its regions [DN], share of saturated pixels."""

    mean_dn: float
    saturated_fraction: float
    exposure_ms: float
    regions_dn: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class RegionDrift:
    """Relative drift of the light in a region: per minute with its standard deviation, and over a time [s]."""

    region: str
    per_min: float
    sigma_per_min: float | None
    change: float
    over_s: float

    @property
    def sigma(self) -> float | None:
        """Standard deviation of `change`."""
        return None if self.sigma_per_min is None else self.sigma_per_min * self.over_s / _S_PER_MIN


@dataclass(frozen=True, kw_only=True)
class LiveDiagnosis:
    """Faults that the last complete cycle shows, the strongest first, or the reason why none can be found."""

    terms: tuple[Fault, ...]
    first: str | None
    reason: str


@with_config(ConfigDict(allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class LiveContent:
    """Numbers of the last complete cycle."""

    angles: dict[str, AngleNumbers]  #: By the polarizer's angle as text.
    cycle: dict[str, float | None] | None = None  #: Its `round`, `cycle` and `exposure_ms`.
    dark: dict[str, float | DarkSource] | None = None  #: Its `source` and `mean_dn`, 0 if it is not known.
    sum_rule: Estimate | None = None
    regions: dict[str, RegionPolarization]
    drift: RegionDrift | None
    diagnosis: LiveDiagnosis | None = None


@with_config(ConfigDict(allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class LiveStatus:
    """Content of ``status.json``."""

    session: str  #: Name of the session.
    frames_planned: int
    frames: int
    written_utc: str = ""
    #: The last stored frame: `sequence`, `kind`, `cycle`, `angle_deg`. None before the first frame, like the next three
    #: fields.
    last: dict[str, JsonValue] | None = None
    remaining_s: Annotated[float, Field(ge=-LARGEST, le=LARGEST)] | None = None
    end_utc: str | None = None
    numbers: LiveContent | None = None


_STATUS, _NUMBERS = TypeAdapter(LiveStatus), TypeAdapter(LiveContent)


def session_state(process: int | None, events: Sequence[RunEvent]) -> State:
    """Return the state of a session from its events and the process that writes into its run.

    With a process, the state is "running", "holding" or "waiting" (for a round). Without one it is "finished",
    "stopped" (on request) or "interrupted".
    """
    last = next((event.event for event in reversed(events) if event.event not in _ASIDE), "")
    if process is not None:
        return _STATES.get(last, "running")
    if last == "finished":
        return "finished"
    return "stopped" if last == "stopped" else "interrupted"


def status_json(status: LiveStatus) -> dict[str, JsonValue]:
    """Return the content of the file: without progress and numbers before the first frame."""
    content = asdict(status)
    numbers = content.pop("numbers") or {}
    return {key: value for key, value in content.items() if value is not None} | numbers


def write_status(run: Path, status: LiveStatus) -> None:
    """Replace the file in one step, without flushing it: after a power cut it has no value."""
    beside = run / f".{STATUS_FILE}"
    beside.write_text(json.dumps(status_json(status), allow_nan=False) + "\n", encoding="ascii")
    beside.replace(run / STATUS_FILE)


def read_status(run: Path) -> LiveStatus | None:
    """Return the status, or None if the session never wrote one."""
    file = run / STATUS_FILE
    if not file.exists():
        return None
    try:
        content = read_bounded(file, MOST_TEXT_BYTES)
        status = _STATUS.validate_json(content)
        has_numbers = "angles" in json.loads(content)
        return replace(status, numbers=_NUMBERS.validate_json(content)) if has_numbers else status
    except OSError as error:
        raise RunFolderError(f"{file}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        raise RunFolderError(f"{file}: is no status: {explain_invalid(error)}") from error


def live_lines(live: LiveContent) -> Iterator[str]:
    """Yield the lines of text on the last cycle of a session."""
    for angle, numbers in live.angles.items():
        yield f"{angle:>6} deg    {_of_angle(numbers)}"
    if live.sum_rule is not None:
        yield f"(I0 + I90) / (I45 + I135)  {_estimate(live.sum_rule)}"
    for name, found in live.regions.items():
        angle = f"{found.aolp_deg:.1f} deg" if found.has_angle else "undefined"
        yield f"DoLP of {name}  {_estimate(found.dolp)}, AoLP {angle}"
    if live.regions and live.dark is not None and live.dark["source"] == DarkSource.UNKNOWN:
        yield f"dark level {live.dark['source']}"
    if live.drift is not None:
        yield _drift(live.drift)
    if live.diagnosis is not None:
        yield from (f"the cycle shows {_fault(fault)}" for fault in live.diagnosis.terms)


def _fault(fault: Fault) -> str:
    place = "" if fault.angle_deg is None else f" at {fault.angle_deg:g} deg"
    size = f"{fault.value or 0.0:+.3g} {_SIGNS} {fault.std_error or 0.0:.2g} {fault.unit}"
    moves = "" if fault.dolp_shift is None else f", moves DoLP of the picture by {fault.dolp_shift:+.4f}"
    return f"{fault.name}{place}  {size}{moves}"


def _of_angle(numbers: AngleNumbers) -> str:
    text = f"mean {numbers.mean_dn:.1f} DN, saturated {100 * numbers.saturated_fraction:.2f} %"
    regions = ", ".join(f"{name} {mean_dn:.1f} DN" for name, mean_dn in numbers.regions_dn.items())
    return f"{text}, {regions}" if regions else text


def _estimate(found: Estimate) -> str:
    if found.sigma is None:
        return f"{found.value:.4f}"
    return f"{found.value:.5f} {_SIGNS} {found.sigma:.5f} (noise of one cycle)"


def _drift(drift: RegionDrift) -> str:
    error = "" if drift.sigma_per_min is None else f" {_SIGNS} {100 * drift.sigma_per_min:.2f}"
    return f"drift of {drift.region}  {100 * drift.per_min:+.2f}{error} % a minute, over {drift.over_s:.1f} s"
