"""Records of a run and their lines: frames, session, events, readings of sensors, annotations, simulated light.

Each line of a journal has its own checksum and the chain of all lines before it, which reveals changed, moved and
removed lines.
"""

import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, JsonValue, TypeAdapter, ValidationError, with_config

from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded
from rigctl.base.numbers import is_utc_text
from rigctl.errors import DataError, RunFolderError
from rigctl.files.choices import FrameKind, Interpolation
from rigctl.files.place import GeometrySection, SiteSection
from rigctl.files.rig_file import polarizer_axes_deg
from rigctl.files.toml import other_schema

SESSION_FILE = "session.json"
EVENTS_FILE = "events.jsonl"
SCHEMA_VERSION = 2
"""Version of the layout."""
UNKNOWN_LINK = ""
"""Beginning of a chain whose session file cannot be read."""
# Frames of one exposure of a camera with polarizers on its pixels, in cells of 2 x 2.
EXPOSURE_PARTS = 4
MOST_TEXT = 2000
METERED_EVENT = "metered"
HOST_CLOCK_EVENT = "host clock"
ASKED_EVENT = "asked"
NOTICE_EVENT = "notice not sent"
TALLY_EVENT = "camera tally"
"""Counts of a camera's pictures, at the end of each part of a session."""
MONITOR_EVENT = "monitor"
READINGS_EVENT = "monitor readings"
# Sources of the start of an exposure in words.
START_SOURCES = {
    "ptp": "by the camera's clock, which follows a PTP master",
    "camera clock": "by the camera's clock, compared with this machine's",
    "trigger": "between the trigger and the first packet",
    "arrival": "before the first packet came in",
    "driver": "by the time stamp of the video driver",
    "file": "by the last change of the file",
    "simulation": "as simulated",
}
PROVES = (
    "a simulated roof: the light of {scene} was computed by the same model that predicts it. This run tests "
    "processing, sensor and the chain of the program: stage, angles, darks, calibration, Stokes parameters, statistics "
    "and verdict. It cannot test the scene model (surfaces, sky, sun, air), which needs real frames"
)
_UTC_DIGITS = 19
_FRAMES_FACT = "frames_in_run"
_CHAIN_FACT = "manifest_chain_sha256"
_S_PER_H, _NEAR_S = 3600.0, 300.0
_SEAL = re.compile(rb', "line_sha256": "([0-9a-f]{64})", "chain_sha256": "([0-9a-f]{64})"\}$')
_NOT_FOLLOWING = "does not follow the line before it: lines were removed, inserted or moved"
_Number = Annotated[float, Field(allow_inf_nan=False)]


@with_config(ConfigDict(extra="forbid", strict=True, allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class FrameRecord:
    """Everything known about one frame. ``None`` means "not known" or "does not apply", never a default."""

    kind: FrameKind
    sequence: int  #: Place in the order of the run's frames, from 0; unique in the run.
    bit_depth: int  #: Bits per sample, right-justified.
    saturation_dn: float  #: A pixel at or above this many counts is saturated [DN].
    cycle: int | None = None  #: Number of the repeat of the set of angles, from 0.
    #: Requested transmission axis [deg], counter-clockwise from horizontal in the picture.
    polarizer_angle_target_deg: float | None = None
    #: Transmission axis by the stage's readback [deg], same sense, used for processing.
    polarizer_angle_deg: float | None = None
    stage_angle_target_deg: float | None = None  #: Target and readback of the stage [deg].
    stage_angle_deg: float | None = None
    stage_counts: int | None = None  #: The encoder's own counts.
    exposure_s: float | None = None  #: Integration time, of one read [s].
    #: Number of averaged reads of the camera; None is one. Counts are always those of one read.
    reads: Annotated[int, Field(ge=2)] | None = None
    real_counts: bool | None = None  #: Counts are in single precision, with fractions or below 0.
    gain_db: float | None = None  #: The camera's gain setting [dB].
    egain_e_per_dn: float | None = None  #: Electrons per DN, if stated [e-/DN].
    black_level_dn: float | None = None  #: Counts without light [DN], if known without dark frames.
    missing_dn: float | None = None  #: Value of missing pixels [DN].
    start_utc: str | None = None  #: Start and end of the exposure, as from ``rigctl.base.numbers.utc_text``.
    end_utc: str | None = None
    start_monotonic_ns: int | None = None  #: Start of the exposure on the host's monotonic clock [ns].
    #: By how much `start_utc` may be off at most, the host's clock taken for right (that of the PTP master, where the
    #: source is "ptp") [s].
    start_uncertainty_s: float | None = None
    #: Source of the start: "ptp", "camera clock", "trigger", "arrival", "driver", "file" or "simulation"
    #: (`drivers.interfaces.StartSource`).
    start_source: str | None = None
    camera_model: str | None = None  #: The devices.
    camera_serial: str | None = None
    filter_name: str | None = None  #: Filter in front of the sensor, by the rig file or the header of an imported file.
    stage_model: str | None = None
    stage_serial: str | None = None
    stage_tries: int | None = None  #: Number of commands of the move until the readback was within tolerance.
    settle_s: float | None = None  #: From the command of the move to the accepted readback [s].
    camera_frame: int | None = None  #: The camera's own frame counter.
    #: Equal for the parts of one exposure of a camera with polarizers on its pixels: the sequence number of the first.
    exposure_id: int | None = None
    #: Temperature by the camera, at most ten seconds before the exposure [deg C].
    camera_temperature_c: float | None = None
    round: int | None = None  #: Round of the schedule, from 0.
    #: Where the sun stood at the start of the exposure [deg]: azimuth clockwise from north, elevation without
    #: refraction.
    sun_azimuth_deg: float | None = None
    sun_elevation_deg: float | None = None
    site_latitude_deg: float | None = None  #: Where the rig stands [deg], north and east positive.
    site_longitude_deg: float | None = None
    site_elevation_m: float | None = None  #: How high above the sea it stands [m].
    source_file: str | None = None  #: Original file of an imported frame.
    remarks: tuple[str, ...] = ()
    file: str = ""  #: Path relative to the run folder, with ``/``. Filled in by the writer, as all that follow.
    height: int = 0  #: Rows and columns.
    width: int = 0
    saturated_fraction: float = 0.0  #: Share of pixels at or above ``saturation_dn``, 0 to 1.
    checksum: str = ""  #: ``sha256:`` and 64 hexadecimal digits, over the whole file.


FRAME_RECORD = TypeAdapter(FrameRecord)


def start_time_texts(frames: Iterable[FrameRecord]) -> tuple[str, ...]:
    """Return the uncertainty of the starts of exposures, one text for each source."""
    errors_s: dict[str, list[float | None]] = {}
    for frame in frames:
        if frame.start_source is not None:
            errors_s.setdefault(frame.start_source, []).append(frame.start_uncertainty_s)
    return tuple(
        f"{START_SOURCES.get(source, source)}: {len(found)} frames, {_largest_text(found)}"
        for source, found in errors_s.items()
    )


def start_error_text(error_s: float | None) -> str:
    """Return the largest error of a start in words."""
    if error_s is None:
        return "error not known"
    if error_s >= 1e-3:
        return f"off by {error_s * 1e3:.3g} ms at most"
    return f"off by {error_s * 1e6:.3g} us at most"


@dataclass(frozen=True, kw_only=True)
class SimulatedLight:
    """The light of a simulated roof."""

    scene: str  #: Name of its scene.
    #: The sun was that of the run's simulated clock at its site; otherwise that which the scene file states.
    is_clocked: bool
    #: That stated sun [deg]; None where the clock moves it, or the file states no azimuth.
    sun_zenith_deg: float | None = None
    sun_azimuth_deg: float | None = None
    distance_factor: float | None = None  #: Its irradiance over that at the mean distance.
    perturbed: str | None = None  #: Changes relative to the scene file, in words.
    remarks: tuple[str, ...] = ()  #: Differences in place and time between scene file and run.

    @property
    def caution(self) -> tuple[str, ...]:
        """Cautions for a report of such a run."""
        proves = PROVES.format(scene=self.scene)
        if self.perturbed is None:
            return (proves,)
        return (proves, f"the simulated roof was changed on purpose: {self.perturbed}")


@dataclass(frozen=True, kw_only=True)
class PolarizerAsTaken:
    """The polarizer by the rig file of a run; None is not stated."""

    sense: Literal[1, -1] | None = None
    offset_deg: Annotated[float, Field(allow_inf_nan=False)] | None = None
    offset_std_deg: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    extinction_ratio: Annotated[float, Field(gt=1, allow_inf_nan=False)] | None = None
    placeholder: bool = False


@dataclass(frozen=True, kw_only=True)
class CameraAsTaken:
    """The camera by the rig file of a run."""

    address: str = ""
    mosaic_deg: list[Annotated[float, Field(allow_inf_nan=False)]] | None = None
    interpolation: Interpolation = "none"


@dataclass(frozen=True, kw_only=True)
class RigAsTaken:
    """The rig file of a run."""

    name: str | None = None
    polarizer: PolarizerAsTaken | None = None
    camera: CameraAsTaken | None = None
    simulation: dict[str, JsonValue] | None = None
    site: SiteSection | None = None
    geometry: GeometrySection | None = None


@dataclass(frozen=True, kw_only=True)
class SessionAsTaken:
    """The session file of a run, likewise."""

    name: str | None = None
    site: SiteSection | None = None


@dataclass(frozen=True, kw_only=True)
class SessionNoise:
    """Numbers of the noise calibration of a session's live numbers, in the order of the run."""

    gain_dn_per_e: _Number
    read_noise_e: _Number
    black_level_dn: _Number
    dark_current_e_per_s: _Number


@dataclass(frozen=True, kw_only=True)
class SessionRecord:
    """Origin of a run."""

    origin: str | None = None  #: "simulated", "device" or "import"; None if not stated.
    rig: RigAsTaken | None = None  #: By its files; None for imported images.
    session: SessionAsTaken | None = None
    stage: dict[str, JsonValue] = field(default_factory=dict)  #: Identity reported by the device.
    camera: dict[str, JsonValue] = field(default_factory=dict)  #: Identity, facts and features.
    noise: SessionNoise | None = None  #: For its live numbers.
    rounds_ns: tuple[int | None, ...] = (None,)  #: Planned begin of each round [ns since 1970 UTC]; None is at once.
    until_ns: int | None = None  #: Planned end [ns since 1970 UTC].
    simulated_light: SimulatedLight | None = None  #: The light of a simulated roof.

    @property
    def polarizer(self) -> PolarizerAsTaken:
        """The polarizer of the rig file; empty for imported images."""
        return PolarizerAsTaken() if self.rig is None or self.rig.polarizer is None else self.rig.polarizer

    @property
    def camera_address(self) -> str:
        """Address of the camera; empty if not stated."""
        return "" if self.rig is None or self.rig.camera is None else self.rig.camera.address

    @property
    def cell_deg(self) -> tuple[float, ...] | None:
        """Axes of the polarizers on the camera's pixels; None for a camera without polarizers or if not stated."""
        polarizer = self.polarizer
        if self.rig is None or self.rig.camera is None or polarizer.sense is None or polarizer.offset_deg is None:
            return None
        return polarizer_axes_deg(self.rig.camera.mosaic_deg, sense=polarizer.sense, offset_deg=polarizer.offset_deg)

    @property
    def interpolation(self) -> Interpolation:
        """Interpolation of the mosaic; "none" also without a mosaic."""
        return "none" if self.rig is None or self.rig.camera is None else self.rig.camera.interpolation

    @property
    def simulated_scene(self) -> Path | None:
        """Original path of the scene file of a simulated run."""
        scene = None if self.rig is None or self.rig.simulation is None else self.rig.simulation.get("scene")
        return Path(scene) if isinstance(scene, str) else None

    @property
    def site(self) -> SiteSection | None:
        """Site of the rig, by its rig file or by its session file."""
        places = (place.site for place in (self.rig, self.session) if place is not None)
        return next((site for site in places if site is not None), None)

    @property
    def is_of_session(self) -> bool:
        """The run was taken by a session, and not imported."""
        return self.rig is not None and self.session is not None


_SESSION = TypeAdapter(SessionRecord)


@with_config(ConfigDict(extra="forbid", strict=True))
@dataclass(frozen=True, kw_only=True)
class RunDescription:
    """Content of the session file of a run."""

    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]  #: Version of the folder's layout.
    created_by: str  #: Program and version that made it.
    created_utc: str  #: When it was made.
    session: dict[str, JsonValue]  #: The resolved session; ``origin`` is "simulated", "device" or "import".
    #: ``sha256:`` and 64 hexadecimal digits over the rest of the file; None until it is written.
    checksum: str | None = None

    @property
    def record(self) -> SessionRecord:
        """The session as far as the program asks."""
        return _SESSION.validate_python(self.session)


_DESCRIPTION = TypeAdapter(RunDescription)


def encode_description(description: RunDescription) -> bytes:
    """Return the content of the file."""
    content = asdict(description) | {"checksum": _checksum(description)}
    return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode("ascii")


def first_link(description: RunDescription) -> str:
    """Return the first link of the chains of a run."""
    return description.checksum or _checksum(description)


def read_description(file: Path) -> RunDescription:
    """Read the session file of a run."""
    try:
        text = read_bounded(file, MOST_RECORD_BYTES)
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}") from error
    try:
        description = _DESCRIPTION.validate_json(text)
    except ValidationError as error:
        other = _other_layout(text)
        raise DataError(other if other is not None else explain_invalid(error)) from error
    if description.checksum != _checksum(description):
        raise DataError("damaged or edited: its checksum is another")
    try:
        _ = description.record
    except ValidationError as error:
        raise DataError(explain_invalid(error, within="session")) from error
    return description


@dataclass(frozen=True, kw_only=True)
class RunEvent:
    """An event of a session."""

    id: int | None = None  #: Its place in the file, from 0.
    utc: str = ""  #: Time, as from ``rigctl.base.numbers.utc_text``.
    monotonic_ns: int | None = None  #: The same by the host's monotonic clock [ns].
    event: str  #: Its name, a word or two.
    facts: dict[str, JsonValue] = field(default_factory=dict)


_EVENT = TypeAdapter(RunEvent)


def read_events(path: Path) -> list[RunEvent]:
    """Return the events of a run folder, without an unfinished last line."""
    file = path / EVENTS_FILE
    journal = read_journal(path)
    problems = journal_problems(journal)
    if problems:
        raise RunFolderError(f"{file}: " + "; ".join(problems))
    return [_EVENT.validate_json(content) for content, _ in journal.lines]


def event_line(event: RunEvent) -> str:
    """Return an event as a line for people: time, name and facts."""
    return f"{event.utc[:_UTC_DIGITS]}Z  {event.event:<14}  {event_facts(event)}".rstrip()


def event_facts(event: RunEvent) -> str:
    """Return the facts of an event in words."""
    shown = {name: value for name, value in event.facts.items() if name not in (_FRAMES_FACT, _CHAIN_FACT)}
    return "; ".join(f"{name.replace('_', ' ')}: {_in_words(value)}" for name, value in shown.items())


def metered_exposures(events: Iterable[RunEvent]) -> tuple[tuple[int, float, int], ...]:
    """Return the metered exposures of a session: round, exposure [s], and the camera's number of the next picture.

    The number is 0 for a camera that does not count its pictures.
    """
    exposures = []
    for facts in (event.facts for event in events if event.event == METERED_EVENT):
        number, exposure_s, following = (facts.get(name) for name in ("round", "exposure_s", "next_camera_frame"))
        if not (isinstance(number, int) and isinstance(exposure_s, float) and isinstance(following or 0, int)):
            raise RunFolderError(f"{EVENTS_FILE}: a metered exposure lacks its round or exposure: {facts}")
        exposures.append((number, exposure_s, following if isinstance(following, int) else 0))
    return tuple(exposures)


def host_clock_text(events: Iterable[RunEvent]) -> str | None:
    """Return the error of the machine's clock when a session began, in words; None if it was not noted."""
    found = next((event for event in events if event.event == HOST_CLOCK_EVENT), None)
    if found is None:
        return None
    error_s = found.facts.get("utc_error_s")
    if not isinstance(error_s, float | int):
        return "this machine's clock was not synchronised, with an unknown error against UTC"
    return f"this machine's clock was within {error_s * 1e3:.3g} ms of UTC, according to its time service"


def pictures_lost(events: Iterable[RunEvent]) -> tuple[str, ...]:
    """Return the losses of pictures and packets between camera and program; empty if the camera counts none."""
    sums: Counter[str] = Counter()
    for event in events:
        if event.event == TALLY_EVENT:
            sums.update({name: int(count) for name, count in event.facts.items() if isinstance(count, int)})
    if not sums:
        return ()
    pictures = (
        f"Of the camera's pictures {sums['accepted']} were taken; {sums['damaged']} were damaged, {sums['too_old']} "
        f"began too early, {sums['never_came']} never came. The connection was restored {sums['reopened']} times."
    )
    if not sums["packets"]:
        return (pictures,)
    share = 100.0 * sums["packets_lost"] / sums["packets"]
    packets = (
        f"The network lost {share:.2g} % of their packets ({sums['packets_lost']} of {sums['packets']}); "
        f"{sums['packets_resent']} of these came when requested again."
    )
    return (pictures, packets)


def closing_facts(*, frames: int, link: str | None) -> dict[str, JsonValue]:
    """Return the manifest's facts for the closing event: number of frames and chain."""
    return {} if link is None else {_FRAMES_FACT: frames, _CHAIN_FACT: link}


def closed_with(event: RunEvent) -> tuple[int, str] | None:
    """Return number of frames and chain of a closing event; None for any other event."""
    frames, link = event.facts.get(_FRAMES_FACT), event.facts.get(_CHAIN_FACT)
    return (frames, link) if isinstance(frames, int) and isinstance(link, str) else None


@dataclass(frozen=True, kw_only=True)
class MonitorReadings:
    """Readings of all sensors for one exposure."""

    sequence: int  #: Of the exposure's first frame.
    read_utc: str  #: When they were requested.
    readings: dict[str, float | None]  #: By the name in the rig file; None for a missing one.
    #: Reasons of missing readings that have changed since the last exposure.
    problems: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not is_utc_text(self.read_utc):
            raise ValueError(f"read_utc is {self.read_utc!r}; it must be a time in UTC")


@dataclass(frozen=True, kw_only=True)
class MonitorTrace:
    """Readings of one sensor over a run."""

    monitor: str  #: Its name in the rig file.
    device: str = ""  #: Its own name and unit; empty if it never answered.
    unit: str = ""
    follows_light: bool = False
    times_s: tuple[float, ...]  #: Seconds since 1970 (UTC).
    values: tuple[float, ...]
    missing: int  #: Exposures without a reading.
    problems: tuple[str, ...]  #: Reasons, each once.

    @property
    def change_per_hour(self) -> float | None:
        """Slope of a straight line through the readings; None for fewer than two times."""
        count = len(self.times_s)
        if count < 2 or self.times_s[-1] <= self.times_s[0]:
            return None
        mean_s, mean = sum(self.times_s) / count, sum(self.values) / count
        lever = sum((time - mean_s) ** 2 for time in self.times_s)
        slope = sum((t - mean_s) * (v - mean) for t, v in zip(self.times_s, self.values, strict=True)) / lever
        return slope * _S_PER_H

    def at(self, time_s: float) -> float | None:
        """Return the reading nearest to a time; None if there is none within five minutes."""
        nearest = min(range(len(self.times_s)), key=lambda k: abs(self.times_s[k] - time_s), default=None)
        if nearest is None or abs(self.times_s[nearest] - time_s) > _NEAR_S:
            return None
        return self.values[nearest]

    @property
    def line(self) -> str:
        """Range, mean, slope and missing readings in one line."""
        count = len(self.values)
        missing = f"; {self.missing} of {self.missing + count} readings missing" if self.missing else ""
        why = f" ({'; '.join(self.problems)})" if self.problems else ""
        if not count:
            return f"{self.monitor}: never answered{missing}{why}"
        slope = self.change_per_hour
        steep = "" if slope is None else f", {slope:+.3g} an hour"
        span = f"{min(self.values):.6g} to {max(self.values):.6g} {self.unit}, mean {sum(self.values) / count:.6g}"
        return f"{self.monitor} ({self.device}): {span}{steep}{missing}{why}"


_READINGS = TypeAdapter(MonitorReadings)


def monitor_traces(events: Iterable[RunEvent]) -> tuple[MonitorTrace, ...]:
    """Return the readings of each sensor of a session, in the order of their rig file."""
    facts: dict[str, Mapping[str, JsonValue]] = {}
    rows: list[MonitorReadings] = []
    try:
        for event in events:
            if event.event == MONITOR_EVENT:
                facts[str(event.facts.get("monitor"))] = event.facts
            elif event.event == READINGS_EVENT:
                rows.append(_READINGS.validate_python(event.facts))
    except ValidationError as error:
        raise RunFolderError(f"{EVENTS_FILE}: readings of a monitor: {explain_invalid(error)}") from error
    names = dict.fromkeys(name for row in rows for name in row.readings)
    return tuple(_trace(name, facts.get(name, {}), rows) for name in names)


@dataclass(frozen=True, kw_only=True)
class Annotation:
    """A note of a person about a run, or an exclusion of frames."""

    utc: str  #: Time of a note or of the exclusion, as from `rigctl.base.numbers.utc_text`.
    by: str  #: Name of the person.
    #: An exclusion removes frames from every number, an inclusion undoes it.
    kind: Literal["note", "exclude", "include"]
    frames: tuple[Annotated[int, Field(ge=0)], ...] = ()  #: Their sequence numbers; a note need not have any.
    text: str = ""
    written_utc: str | None = None  #: When the line was written.

    def __post_init__(self) -> None:
        if not is_utc_text(self.utc):
            raise ValueError(f"utc is {self.utc!r}; it must be a time")
        if self.kind != "note" and not self.frames:
            raise ValueError(f"kind is {self.kind}, which needs frames")

    @property
    def facts(self) -> str:
        """The annotation in words, without its time."""
        frames = f"frames {frames_text(self.frames)}" if self.frames else ""
        return f"{': '.join(filter(None, (frames, self.text)))} ({self.by})"

    @property
    def line(self) -> str:
        """The annotation as a line for people."""
        return f"{self.utc[:_UTC_DIGITS]}Z  {self.kind:<14}  {self.facts}"


def left_out_texts(annotations: Sequence[Annotation], records: Iterable[FrameRecord]) -> tuple[str, ...]:
    """Return a line for each excluded frame with the reason."""
    excluded = excluded_frames(annotations)
    return tuple(
        f"frame {record.sequence}: excluded: {excluded[record.sequence].text} ({excluded[record.sequence].by})"
        for record in records
    )


def excluded_frames(annotations: Iterable[Annotation]) -> dict[int, Annotation]:
    """Return the excluded frames by sequence number, with the annotation that excludes each."""
    found: dict[int, Annotation] = {}
    for one in annotations:
        for frame in one.frames:
            if one.kind == "exclude":
                found[frame] = one
            elif one.kind == "include":
                found.pop(frame, None)
    return dict(sorted(found.items()))


def exclusions_text(excluded: Mapping[int, Annotation]) -> str:
    """Return the excluded frames by reason, in one line."""
    groups: dict[tuple[str, str], list[int]] = {}
    for frame, one in excluded.items():
        groups.setdefault((one.text, one.by), []).append(frame)
    return "; ".join(f"{frames_text(frames)}: {text} ({by})" for (text, by), frames in groups.items())


def frames_text(frames: Sequence[int]) -> str:
    """Return sequence numbers in short: ``12, 15-18``."""
    spans: list[list[int]] = []
    for frame in sorted(frames):
        if spans and frame == spans[-1][1] + 1:
            spans[-1][1] = frame
        else:
            spans.append([frame, frame])
    return ", ".join(f"{first}" if first == last else f"{first}-{last}" for first, last in spans)


@dataclass(frozen=True, kw_only=True)
class Lines:
    """Lines of a journal, as they are read."""

    #: In the order of the file: content without seal (empty if damaged), and the problem of the line or of its place.
    lines: tuple[tuple[bytes, str | None], ...]
    links: tuple[str, ...]  #: The chain after 0, 1, 2, ... lines.
    is_torn: bool  #: What follows the last line has no end: the writer was killed in the middle of it.

    @property
    def begins_elsewhere(self) -> bool:
        """True if the first line does not follow the beginning of the chain."""
        return bool(self.lines and self.links) and self.lines[0][1] == _NOT_FOLLOWING


def read_lines(data: bytes, first_link: str) -> Lines:
    """Return the lines of a journal with checked seals; `first_link` begins the chain."""
    whole, end, rest = data.rpartition(b"\n")
    raw = whole.split(b"\n") if end else []
    links = [first_link]
    lines = []
    for text in raw:
        line, link = _read_line(text, links[-1])
        lines.append(line)
        links.append(link)
    return Lines(lines=tuple(lines), links=tuple(links), is_torn=bool(rest))


def sealed(content: bytes, link: str) -> tuple[bytes, str]:
    """Return a line with its seal, and the chain after it."""
    own = hashlib.sha256(content).hexdigest()
    after = _link(link, own)
    return content[:-1] + f', "line_sha256": "{own}", "chain_sha256": "{after}"}}\n'.encode("ascii"), after


def sealed_all(contents: Iterable[bytes], link: str) -> bytes:
    """Return the whole of a journal whose chain begins with a link."""
    lines = []
    for content in contents:
        line, link = sealed(content, link)
        lines.append(line)
    return b"".join(lines)


def journal_bytes(file: Path) -> bytes:
    """Return the bytes of a journal; none where there is no such file."""
    try:
        return read_bounded(file, MOST_RECORD_BYTES) if file.exists() else b""
    except OSError as error:
        raise RunFolderError(f"{file}: cannot be read: {error.strerror}") from error


def read_journal(path: Path) -> Lines:
    """Return the lines of a run folder's events with checked seals; none without the file."""
    data = journal_bytes(path / EVENTS_FILE)
    try:
        first = first_link(read_description(path / SESSION_FILE))
    except DataError:
        first = UNKNOWN_LINK
    return read_lines(data, first)


def journal_problems(journal: Lines) -> list[str]:
    """Return the problems of the events of a run, line by line."""
    problems = [f"line {number}: {text}" for number, (_, text) in enumerate(journal.lines, start=1) if text]
    for number, (content, _) in enumerate(journal.lines, start=1):
        try:
            if content:
                _EVENT.validate_json(content)
        except ValidationError as error:
            problems.append(f"line {number} is not an event: {explain_invalid(error)}")
    return problems


def sound_events(journal: Lines) -> list[tuple[bytes, RunEvent]]:
    """Return the valid lines, with their content."""
    found = []
    for content, _ in journal.lines:
        try:
            if content:
                found.append((content, _EVENT.validate_json(content)))
        except ValidationError:
            continue
    return found


def explain_invalid(error: ValidationError, *, within: str = "") -> str:
    """Return the problems of a record in one line: each field with its part and the reason."""
    outer = (within,) if within else ()
    return "; ".join(
        f"{'.'.join(map(str, (*outer, *item['loc'])))}: {item['msg']}".removeprefix(": ") for item in error.errors()
    )


def _largest_text(errors_s: list[float | None]) -> str:
    known = [error_s for error_s in errors_s if error_s is not None]
    missing = len(errors_s) - len(known)
    return start_error_text(max(known, default=None)) + (f" (not known of {missing})" if known and missing else "")


def _other_layout(text: bytes) -> str | None:
    """Return a message if a session file has another schema version; None if it has ours."""
    try:
        return other_schema(json.loads(text), RunDescription)
    except (ValueError, RecursionError):
        return None


def _checksum(description: RunDescription) -> str:
    content = asdict(description)
    del content["checksum"]
    return "sha256:" + hashlib.sha256(json.dumps(content, allow_nan=False).encode("ascii")).hexdigest()


def _in_words(value: object) -> str:
    if value is None:
        return "not known"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_in_words(one)}" for name, one in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(map(_in_words, value)) or "none"
    return str(value)


def _trace(name: str, facts: Mapping[str, JsonValue], rows: Iterable[MonitorReadings]) -> MonitorTrace:
    own = [row for row in rows if name in row.readings]
    timed = [(datetime.fromisoformat(row.read_utc).timestamp(), row.readings[name]) for row in own]
    known = [(time_s, value) for time_s, value in timed if value is not None]
    return MonitorTrace(
        monitor=name,
        device=str(facts.get("device", "")),
        unit=str(facts.get("unit", "")),
        follows_light=facts.get("follows_light") is True,
        times_s=tuple(time_s for time_s, _ in known),
        values=tuple(value for _, value in known),
        missing=len(timed) - len(known),
        problems=tuple(dict.fromkeys(row.problems[name] for row in own if name in row.problems)),
    )


def _read_line(text: bytes, link: str) -> tuple[tuple[bytes, str | None], str]:
    seal = _SEAL.search(text)
    if seal is None:
        return (b"", "has no seal, or a damaged one"), link
    content = text[: seal.start()] + b"}"
    own, after = seal[1].decode("ascii"), seal[2].decode("ascii")
    if hashlib.sha256(content).hexdigest() != own:
        return (b"", "damaged: its checksum is another"), after
    return (content, None if _link(link, own) == after else _NOT_FOLLOWING), after


def _link(before: str, own: str) -> str:
    return hashlib.sha256(f"{before} {own}".encode("ascii")).hexdigest()
