"""`rigctl status`: state of a session, contents of its run, its log, and a page about it."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import Json, note, warn
from rigctl.errors import ConfigError
from rigctl.verbs.options import FilePath, Part, Result, RunOptions, RunPath, Writes

if TYPE_CHECKING:
    from rigctl.measure.diagnose import RunDiagnosis
    from rigctl.report.document import Column
    from rigctl.runs.folder import Run as RunRecord
    from rigctl.runs.records import Annotation, FrameRecord, RunEvent
    from rigctl.session.history import SessionHistory
    from rigctl.session.status import LiveStatus, State

_S_PER_MINUTE = 60
_BYTES_PER_MB = 1e6
_LAST_EVENTS = 5
_TO_SECONDS = 19  # characters of a UTC time without fractions of a second
_UNKNOWN = "-"
_ORIGINS = {"simulated": "simulated devices", "device": "real devices", "import": "imported images"}
_MOST_PIXELS = 1_500_000  # pixels of a frame; larger pictures are diagnosed from squares of pixels


def status(
    run: RunPath,
    /,
    *,
    contents: bool = False,
    log: bool = False,
    page: Annotated[FilePath | None, Writes(kind="file")] = None,
    only: str | None = None,
    last: Annotated[int | None, Parameter(validator=Number(gte=1))] = None,
    **frames: Unpack[RunOptions],
) -> "SessionStatus | RunContents | SessionLog | SessionPage":
    """Print the progress of a session, the contents of a run, or its log, during the session or later.

    Without an option, it prints frames, remaining time, counts and saturation by angle, sum rule, drift, and the DoLP
    of regions in the last cycle. If the session had a noise calibration (`--noise`), the expected deviations are next
    to them.

    Example: rigctl status runs/2026-05-04

    Example: rigctl status runs/2026-05-04 --log --only interlock

    Parameters
    ----------
    run : path or Run
        Run folder.
    contents : bool
        Print the contents: frames, angles, exposures, devices, time span and notes.
    log : bool
        Print the events with their times (UTC). Monitor readings are shown with ``--only "monitor readings"``.
    page : path
        File to write (.html or .pdf): contact sheet, counts and drift by angle, faults, sun, events.
    only : str
        With --log: only events of this name, such as interlock, round or note.
    last : int
        With --log: only the last N events.
    **frames
        With --contents and --page: which frames are read, see `RunOptions`.
    """
    from rigctl.runs.check import run_to_measure

    path = Path(run)
    if contents + log + (page is not None) > 1:
        raise ConfigError("--contents, --log, --page: give one of them")
    if not log and (only is not None or last is not None):
        raise ConfigError(f"{'--last' if only is None else '--only'}: is an option of --log")
    if contents:
        found = contents_of(run_to_measure(path, **frames))
        for doubt in found.doubts:
            warn(doubt)
        return found
    if log:
        return _log(path, only=only, last=last)
    if page is not None:
        return _page(path, Path(page), run_to_measure(path, **frames))
    return _status(path)


@dataclass(frozen=True, kw_only=True)
class SessionStatus(Result):
    """State of a session."""

    run: str
    state: "State"
    process: int | None  #: process that writes into the run
    frames: int  #: stored frames
    disk_free_mb: float
    live: "LiveStatus | None"  #: planned frames, remaining time and numbers, as last written by the session
    events: "tuple[RunEvent, ...]"  #: the last five

    def content(self) -> Iterable[Part]:
        """Return the state, the numbers of the last cycle and the last events."""
        from rigctl.runs.records import event_line
        from rigctl.session.status import live_lines

        live = self.live
        yield f"{self.run}: {self.state}{'' if self.process is None else f' (process {self.process})'}"
        yield f"frames        {self.frames} of {'unknown' if live is None else live.frames_planned}"
        yield f"disk          {self.disk_free_mb:.0f} MB free"
        if self.process is not None and live is not None and live.remaining_s is not None:
            minutes, seconds = divmod(round(live.remaining_s), _S_PER_MINUTE)
            yield f"remaining     {minutes} min {seconds} s, until {(live.end_utc or '')[:_TO_SECONDS]}Z"
        if live is not None and live.numbers is not None:
            yield from live_lines(live.numbers)
        yield from map(event_line, self.events)

    def as_json(self) -> dict[str, Json]:
        """Return the state, and under `live` the content of the session's status.json."""
        from rigctl.session.status import status_json

        return asdict(self) | {"live": None if self.live is None else status_json(self.live)}


def _status(path: Path) -> SessionStatus:
    import shutil

    from rigctl.runs.folder import read_contents, writing_process
    from rigctl.runs.records import read_events
    from rigctl.session.status import read_status, session_state

    contents, process, events = read_contents(path), writing_process(path), read_events(path)
    return SessionStatus(
        run=str(path),
        state=session_state(process, events),
        process=process,
        frames=len(contents.frames),
        disk_free_mb=shutil.disk_usage(path).free / _BYTES_PER_MB,
        live=read_status(path),
        events=tuple(events[-_LAST_EVENTS:]),
    )


@dataclass(frozen=True, kw_only=True)
class FrameGroup:
    """Frames of one kind that were taken with the same settings."""

    kind: str
    polarizer_angle_target_deg: float | None
    polarizer_angle_deg: tuple[float, float] | None  #: lowest and highest readback
    exposure_s: float | None
    gain_db: float | None
    frames: int
    cycles: int
    saturated_fraction: tuple[float, float]  #: share of a frame's pixels, lowest and highest


@dataclass(frozen=True, kw_only=True)
class RunContents(Result):
    """Contents of a run."""

    run: str
    origin: str  #: "simulated", "device", "import" or "not stated"
    created_by: str
    created_utc: str
    frames: int
    sizes: tuple[tuple[int, int], ...]  #: width, height
    bit_depths: tuple[int, ...]
    black_levels_dn: tuple[float, ...]
    saturations_dn: tuple[float, ...]
    missing_dn: tuple[float, ...]
    start_utc: str | None  #: first start of an exposure
    end_utc: str | None  #: last end of an exposure
    cameras: tuple[str, ...]  #: model and serial number
    stages: tuple[str, ...]
    groups: tuple[FrameGroup, ...]
    remarks: dict[str, int]  #: remarks, with the number of frames that have them
    events: dict[str, int]  #: events, with their number
    doubts: tuple[str, ...] = ()  #: warnings about the numbers
    start_times: tuple[str, ...] = ()  #: sources of the starts of exposures, and their errors
    host_clock: str | None = None  #: synchronisation of this machine's clock
    excluded: tuple[int, ...] = ()  #: excluded frames, which are not counted above
    annotations: "tuple[Annotation, ...]" = ()

    def content(self) -> Iterable[Part]:
        """Return the number of frames and their origin, devices, groups of frames, remarks and events."""
        from rigctl.report.document import Table

        size = _join(f"{width} x {height}" for width, height in self.sizes)
        yield f"{self.run}: {self.frames} frames of {size} pixels, {_ORIGINS.get(self.origin, self.origin)}"
        yield from (f"{title:<14}{text}" for title, text in self._facts())
        yield Table(columns=_group_columns(), rows=self.groups)
        yield from (f"note: {remark} ({frames} frames)" for remark, frames in self.remarks.items())
        if self.events:
            yield f"events: {', '.join(f'{event} ({times} x)' for event, times in self.events.items())}"
        yield from (annotation.line for annotation in self.annotations)

    def _facts(self) -> Iterable[tuple[str, str]]:
        yield "made by", f"{self.created_by}, {self.created_utc}"
        yield "bits", _join(map(str, self.bit_depths))
        yield "black [DN]", _join(f"{value:g}" for value in self.black_levels_dn)
        yield "full [DN]", _join(f"{value:g}" for value in self.saturations_dn)
        yield "missing [DN]", _join(f"{value:g}" for value in self.missing_dn)
        yield "time", f"{self.start_utc or _UNKNOWN} to {self.end_utc or _UNKNOWN}"
        for text in (*self.start_times, *filter(None, [self.host_clock])):
            yield "starts", text
        yield "camera", _join(self.cameras)
        yield "stage", _join(self.stages)

    def as_json(self) -> dict[str, Json]:
        """Return the fields."""
        return asdict(self)


def contents_of(run: "RunRecord") -> RunContents:
    """Return the contents of a run without opening its frames."""
    from rigctl.files.rig_file import unset_polarizer
    from rigctl.runs.records import host_clock_text, read_events, start_time_texts

    frames, events = run.frames, read_events(run.path)
    return RunContents(
        run=str(run.path),
        origin=run.session.origin or "not stated",
        created_by=run.created_by,
        created_utc=run.created_utc,
        frames=len(frames),
        sizes=tuple(sorted({(r.width, r.height) for r in frames})),
        bit_depths=tuple(sorted({r.bit_depth for r in frames})),
        black_levels_dn=_values(r.black_level_dn for r in frames),
        saturations_dn=_values(r.saturation_dn for r in frames),
        missing_dn=_values(r.missing_dn for r in frames),
        start_utc=min((r.start_utc for r in frames if r.start_utc), default=None),
        end_utc=max((r.end_utc for r in frames if r.end_utc), default=None),
        cameras=_devices((r.camera_model, r.camera_serial) for r in frames),
        stages=_devices((r.stage_model, r.stage_serial) for r in frames),
        groups=_groups(frames),
        remarks=dict(Counter(remark for r in frames for remark in r.remarks)),
        events=dict(Counter(event.event for event in events)),
        doubts=unset_polarizer(run.path, placeholder=run.session.polarizer.placeholder),
        start_times=start_time_texts(frames),
        host_clock=host_clock_text(events),
        excluded=tuple(record.sequence for record in run.excluded),
        annotations=run.annotations,
    )


def _values(values: Iterable[float | None]) -> tuple[float, ...]:
    return tuple(sorted({value for value in values if value is not None}))


def _devices(names: Iterable[tuple[str | None, str | None]]) -> tuple[str, ...]:
    return tuple(sorted({" ".join(filter(None, pair)) for pair in names if any(pair)}))


def _groups(frames: "Iterable[FrameRecord]") -> tuple[FrameGroup, ...]:
    members: dict[tuple[str, float | None, float | None, float | None], list[FrameRecord]] = {}
    for record in frames:
        key = (record.kind, record.polarizer_angle_target_deg, record.exposure_s, record.gain_db)
        members.setdefault(key, []).append(record)
    found = []
    for (kind, target_deg, exposure_s, gain_db), records in members.items():
        angles = [_near(r.polarizer_angle_deg, target_deg) for r in records if r.polarizer_angle_deg is not None]
        fractions = [r.saturated_fraction for r in records]
        group = FrameGroup(
            kind=kind,
            polarizer_angle_target_deg=target_deg,
            polarizer_angle_deg=(min(angles), max(angles)) if angles else None,
            exposure_s=exposure_s,
            gain_db=gain_db,
            frames=len(records),
            cycles=len({r.cycle for r in records if r.cycle is not None}),
            saturated_fraction=(min(fractions), max(fractions)),
        )
        found.append(group)
    return tuple(found)


def _near(readback_deg: float, target_deg: float | None) -> float:
    """Return a readback modulo 180 deg near its target: for a target of 0 deg, 179.999 deg is -0.001 deg."""
    from rigctl.base.numbers import wrapped

    return readback_deg if target_deg is None else target_deg + wrapped(readback_deg - target_deg, turn=180.0)


def _group_columns() -> "tuple[Column[FrameGroup], ...]":
    from rigctl.report.document import Column

    return (
        Column(title="kind", text=lambda group: group.kind, left=True),
        Column(title="angle [deg]", text=lambda group: _number(group.polarizer_angle_target_deg)),
        Column(title="readback [deg]", text=lambda group: _span(group.polarizer_angle_deg, digits=3), unbroken=True),
        Column(title="exposure [s]", text=lambda group: _number(group.exposure_s)),
        Column(title="gain [dB]", text=lambda group: _number(group.gain_db)),
        Column(title="frames", text=lambda group: str(group.frames)),
        Column(title="cycles", text=lambda group: str(group.cycles)),
        Column(title="saturated [%]", text=_saturated),
    )


def _saturated(group: FrameGroup) -> str:
    low, high = group.saturated_fraction
    return _span((100.0 * low, 100.0 * high), digits=2)


def _join(texts: Iterable[str]) -> str:
    return ", ".join(texts) or _UNKNOWN


def _number(value: float | None) -> str:
    return _UNKNOWN if value is None else f"{value:g}"


def _span(values: tuple[float, float] | None, *, digits: int) -> str:
    if values is None:
        return _UNKNOWN
    low, high = (f"{value:.{digits}f}" for value in values)
    return low if low == high else f"{low} .. {high}"


@dataclass(frozen=True, kw_only=True)
class SessionLog(Result):
    """Events and notes of a session."""

    run: str
    entries: "Sequence[RunEvent | Annotation]"
    last: int | None = None  #: number of entries to show
    has_readings: bool = True  #: show the readings of monitors, too

    def content(self) -> Iterable[Part]:
        """Return one line for each event and note."""
        from rigctl.runs.records import READINGS_EVENT

        shown = [one for one in self.entries if self.has_readings or _name(one) != READINGS_EVENT]
        return map(_line, self._last(shown))

    def as_json(self) -> dict[str, Json]:
        """Return events and annotations."""
        from rigctl.runs.records import RunEvent

        entries = self._last(self.entries)
        events = [asdict(one) for one in entries if isinstance(one, RunEvent)]
        notes = [asdict(one) for one in entries if not isinstance(one, RunEvent)]
        return {"run": self.run, "events": events, "annotations": notes}

    def _last(self, entries: "Sequence[RunEvent | Annotation]") -> "Sequence[RunEvent | Annotation]":
        return entries if self.last is None else entries[-self.last :]


def _log(path: Path, *, only: str | None, last: int | None) -> SessionLog:
    from rigctl.runs.folder import read_annotations, read_contents
    from rigctl.runs.records import read_events

    read_contents(path)  # raises an error if it is not a run folder
    entries: list[RunEvent | Annotation] = [*read_events(path)]
    if notes := read_annotations(path):  # without notes the order of events stays, even if the clock was set back
        entries = sorted([*entries, *notes], key=lambda one: one.utc)
    if only is not None:
        entries = [one for one in entries if _name(one) == only]
    return SessionLog(run=str(path), entries=entries, last=last, has_readings=only is not None)


def _name(entry: "RunEvent | Annotation") -> str:
    from rigctl.runs.records import RunEvent

    return entry.event if isinstance(entry, RunEvent) else entry.kind


def _line(entry: "RunEvent | Annotation") -> str:
    from rigctl.runs.records import RunEvent, event_line

    return event_line(entry) if isinstance(entry, RunEvent) else entry.line


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionPage(Result):
    """The page about a session."""

    run: str
    page: Path
    history: "SessionHistory"
    diagnosis: "RunDiagnosis"
    doubts: tuple[str, ...]

    def content(self) -> Iterable[Part]:
        """Return the faults that the frames show."""
        return self.diagnosis.lines

    def as_json(self) -> dict[str, Json]:
        """Return counts of frames and events, faults, doubts and annotations."""
        from rigctl.report.measurement import annotations_of, diagnosis_json
        from rigctl.runs.records import left_out_texts

        run = self.history.run
        return {
            "run": self.run,
            "page": str(self.page),
            "frames": Counter[str](record.kind for record in run.frames),
            "events": Counter(event.event for event in self.history.events),
            "diagnosis": diagnosis_json(self.diagnosis),
            "doubts": self.doubts,
            **annotations_of(run, left_out_texts(run.annotations, run.excluded)),
        }


def _page(path: Path, page: Path, run: "RunRecord") -> SessionPage:
    from rigctl.base.durable import write_durably
    from rigctl.files.rig_file import unset_polarizer
    from rigctl.measure.diagnose import quick_diagnosis
    from rigctl.report.files import encoded
    from rigctl.report.run import run_report
    from rigctl.session.history import session_history

    history = session_history(run)
    diagnosis = quick_diagnosis(run, most_pixels=_MOST_PIXELS)
    write_durably(page, encoded(run_report(history, diagnosis), page.name))
    doubts = unset_polarizer(path, placeholder=run.session.polarizer.placeholder)
    for doubt in doubts:
        warn(doubt)
    note(f"page: {page}", below=True)
    return SessionPage(run=str(path), page=page, history=history, diagnosis=diagnosis, doubts=doubts)
