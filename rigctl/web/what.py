"""What a page may be shown of a run: frozen records that become JSON as they are, read as the run grows.

A page asks each second: only what is new is read, and nothing is written.
"""

import json
import re
import shutil
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, Protocol, TypeVar

from pydantic import ConfigDict, Field, JsonValue, with_config

from drivers.interfaces import Camera, RotationStage
from rigctl.base.durable import MOST_RECORD_BYTES, MOST_TEXT_BYTES, open_plain, read_bounded
from rigctl.base.numbers import LARGEST, NS_PER_S, utc_text
from rigctl.calibrations.flat import FlatFields
from rigctl.calibrations.made_for import KINDS, CalibrationKind
from rigctl.calibrations.noise import NoiseParameters
from rigctl.calibrations.polarizer import PolarizerParameters
from rigctl.calibrations.radiometric import RadiometricResponse
from rigctl.calibrations.registration import ImageRegistration
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import Interpolation
from rigctl.files.rig_file import PLACEHOLDER
from rigctl.files.session_file import PICTURE
from rigctl.runs.folder import MANIFEST_FILE, Run, RunTail, annotated, files_of, writing_process
from rigctl.runs.records import (
    EVENTS_FILE,
    READINGS_EVENT,
    SESSION_FILE,
    Annotation,
    FrameRecord,
    RunEvent,
    event_facts,
    excluded_frames,
    exclusions_text,
    read_events,
)
from rigctl.session.history import CycleLook, Means, cycle_history
from rigctl.session.numbers import PixelMean, RegionMeans
from rigctl.session.status import STATUS_FILE, State, read_status, session_state
from rigctl.web.pictures import MAPS, Picture, RunPictures, last_cycle, newest_by_name

Liveliness = Literal["waiting", "live", "holding", "stale", "finished", "stopped", "interrupted"]
TaskKind = Literal["rest", "preview", "polarimetry"]
T = TypeVar("T")
# Whoever looks asks again each second: after this, nobody does, and nothing more is read.
_LOOKED_S = 10.0
_PERCENT = 100.0
_MOST_FILES = 200
# A noise calibration does not name its kind.
_OF_NOISE = re.compile(rb'"gain_dn_per_e"\s*:')
_KIND = re.compile(rb'"kind"\s*:\s*"([a-z]{3,20})"')
_HEAD_BYTES = 20_000
_EVENTS = 30
_BYTES_PER_MB = 1e6
_MS_PER_S = 1e3
_STALE_S = 30.0
_LIVELINESS: dict[State, Liveliness] = {
    "running": "live",
    "holding": "holding",
    "waiting": "waiting",
    "finished": "finished",
    "stopped": "stopped",
    "interrupted": "interrupted",
}
_ADVICE: dict[Liveliness, str] = {
    "stale": "a process holds the run and has written nothing since: look at its terminal",
    "stopped": "stopped: resume with rigctl resume {run}",
    "interrupted": "interrupted: resume with rigctl resume {run}",
}
_KEPT_READERS = 64
_REPORT = "report.html"
_COMPARISON = "comparison.json"
_SUMMARY = "summary.html"
_AT_REST = ("finished", "stopped", "interrupted")
_Times = tuple[int, ...]
# What a comparison says of itself: when it was written [ns], its folder, its run and its verdict.
_Comparison = tuple[int, Path, str, str]
_READERS: Mapping[CalibrationKind, Callable[[Path, Run], tuple[object, tuple[str, ...]]]] = {
    "noise": NoiseParameters.read_fitting,
    "flat": FlatFields.read_fitting,
    "polarizer": PolarizerParameters.read_fitting,
    "radiometric": RadiometricResponse.read_fitting,
    "registration": ImageRegistration.read_fitting,
}


@dataclass(frozen=True, kw_only=True)
class RunLook:
    """A run as it stands now."""

    run: str  #: Name of its folder.
    #: "waiting" (there is nothing yet, or the next round has not begun), "live", "holding", "stale" (a process holds
    #: the run and has written nothing for long), "finished", "stopped" or "interrupted".
    state: Liveliness
    since_utc: str = ""  #: Since when; empty where nobody knows.
    advice: str = ""  #: What to do; empty where there is nothing to do.
    session: str = ""  #: Its name.
    frames: int = 0  #: How many are durable, of how many.
    frames_planned: int | None = None
    remaining_s: float | None = None  #: What the session still takes [s].
    end_utc: str = ""  #: When it ends; empty where nobody knows.
    step: str = ""  #: The last frame in words: its kind, round, cycle and angle.
    sun_zenith_deg: float | None = None  #: At the last frame.
    sun_azimuth_deg: float | None = None
    camera_temperature_c: float | None = None
    disk_free_mb: float = 0.0  #: What is free on the disk of the run [MB].
    is_simulated: bool = False  #: No real device took part.
    #: The newest frame behind each angle, by angle; then dark and flat: name, sequence number, begin (UTC), exposure
    #: [ms], share of saturated pixels.
    newest: tuple[dict[str, JsonValue], ...] = ()
    maps_of: str = ""  #: Which cycle the maps show; empty where there are none yet.
    events: tuple[dict[str, str], ...] = ()  #: The last ones in words (utc, event, facts), the newest first.
    problems: tuple[str, ...] = ()  #: What cannot be read or is damaged.


@dataclass(frozen=True, kw_only=True)
class Curves:
    """What the cycles of a run show, one after the other."""

    time_s: tuple[float, ...] = ()  #: When each began, seconds since 1970 (UTC).
    sun_zenith_deg: tuple[float | None, ...] = ()  #: Zenith angle of the sun [deg].
    sum_rule: tuple[float | None, ...] = ()  #: (I0 + I90) / (I45 + I135) of the whole picture.
    drift_percent_per_min: tuple[float | None, ...] = ()  #: Of the light.
    #: The picture and the session's regions by name: DoLP, AoLP [deg], their standard deviations, and S0 [DN/s],
    #: cycle by cycle; None where they are not known.
    regions: tuple[dict[str, JsonValue], ...] = ()
    frames_read: int = 0  #: How far the frames have been read: the curves grow with them.
    frames_there: int = 0
    left_out: str = ""  #: Frames that people have excluded, and why: no curve has them. Empty where there are none.


@dataclass(frozen=True, kw_only=True)
class CalibrationLook:
    """A calibration that lies beside a run."""

    file: str  #: Its name, and "noise", "flat", "polarizer", "radiometric" or "registration".
    kind: str
    made_utc: str = ""  #: When its frames were taken; empty where it does not say.
    valid_days: float | None = None  #: For how long it holds [days].
    verdict: str  #: "holds", "doubtful" or "does not hold", for this run.
    words: str = ""  #: Why; empty where it holds.


@dataclass(frozen=True, kw_only=True)
class RunRow:
    """A run in the list of a folder."""

    run: str  #: Name of its folder: what its page is asked by.
    state: Liveliness  #: As in `RunLook`.
    begun_utc: str  #: When its folder was made.
    frames: int  #: How many it holds.
    sun_zenith_deg: float | None  #: At its first frame [deg].
    verdict: str = ""  #: Of the newest comparison beside it; empty where there is none.
    pages: tuple[str, ...] = ()  #: Summary and reports beside it: what they are asked by.


@with_config(ConfigDict(extra="forbid", allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class Task:
    """What the devices shall do, as a page asks for it too."""

    #: "rest" closes the devices; "preview" takes picture after picture; "polarimetry" turns through the angles.
    kind: TaskKind
    exposure_ms: Annotated[float, Field(gt=0.0, le=600_000.0)] | None = None  #: None: found by the camera's pictures.
    gain_db: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.0
    zoom: Annotated[int, Field(ge=1, le=64)] = 1  #: The middle is shown and judged, so many times larger.
    #: Of the polarizer, for "polarimetry".
    angles_deg: Annotated[tuple[Annotated[float, Field(ge=-LARGEST, le=LARGEST)], ...], Field(max_length=64)] = (
        0.0,
        45.0,
        90.0,
        135.0,
    )


REST = Task(kind="rest")


@dataclass(frozen=True, kw_only=True)
class LiveLook:
    """What the devices do and see now."""

    task: TaskKind = "rest"  #: As in `Task`.
    exposure_ms: float = 10.0  #: As set [ms], [dB].
    gain_db: float = 0.0
    is_automatic: bool = True  #: The exposure follows the light.
    sequence: int = 0  #: Number of the newest picture, and of the newest maps; 0 where there is none.
    maps_sequence: int = 0
    angle_deg: float | None = None  #: Of the polarizer at the newest picture, by readback [deg].
    #: Of the newest picture and the largest since the task began; to be compared with itself only.
    sharpness: float = 0.0
    best_sharpness: float = 0.0
    brightest: float = 0.0  #: The 99.5 % quantile as a share of the range, and the share of saturated pixels.
    clipped: float = 0.0
    cycles_per_min: float | None = None  #: How fast the polarizer goes round.
    #: Level without light that the maps subtract [DN]; None where none was taken at this exposure: DoLP reads too low.
    dark_dn: float | None = None
    zoom: int = 1  #: As in `Task`.
    left: int = 0  #: The part of the camera's picture that is shown: its first column and row, and its size [pixel].
    top: int = 0
    width: int = 0
    height: int = 0
    problem: str = ""  #: What stopped the task; empty where nothing did.


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenDevices:
    """Devices that are open."""

    camera: Camera
    stage: RotationStage | None = None
    cell_deg: tuple[float, ...] | None = None  #: Axes of a cell of polarizers on the camera's pixels, row by row.
    interpolation: Interpolation = "none"  #: What is made of the pictures of such a camera.


class RunReader:
    """Reads one run for all who look at it. May be asked from several threads."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reading = threading.Lock()
        self._tail, self._history, self._pictures = RunTail(path), HistoryReader(), RunPictures()
        self._calibrations = CalibrationsBeside(path)

    def look(self) -> RunLook:
        """Return how the run stands; what cannot be read of it stands among its problems."""
        if not self._path.is_dir():
            return RunLook(run=self._path.name, state="waiting", advice="there is no such folder yet")
        problems: list[str] = []
        run = _or_problem(self._run, problems)
        events = _or_problem(lambda: read_events(self._path), problems) or []
        used = None if run is None else _or_problem(lambda: annotated(run), problems)
        noted = () if used is None else used.annotations
        process = _or_problem(lambda: writing_process(self._path), problems)
        state = session_state(process, [event.event for event in events])
        liveliness = _LIVELINESS[state] if run is not None else "waiting"
        look = RunLook(
            run=self._path.name,
            state=self._stale_or(liveliness),
            disk_free_mb=shutil.disk_usage(self._path).free / _BYTES_PER_MB,
            events=_happenings(events, noted),
        )
        look = replace(look, since_utc=self._since(look.state, events), advice=self._advice(look.state, events))
        look = look if run is None else _with_frames(look, run, used)
        look = self._with_plan(look, problems)
        return replace(look, problems=(*problems, *self._tail.problems, *filter(None, [self._history.problem])))

    def curves(self) -> Curves:
        """Return the numbers of its cycles, as far as its frames have been read, without those that are excluded."""
        run = self._used_run()
        return Curves() if run is None else self._history.curves(run)

    def calibrations(self) -> tuple[CalibrationLook, ...]:
        """Return the calibrations that lie beside it, and whether they hold for it."""
        run = _or_problem(self._run, [])
        return () if run is None else self._calibrations.of(run)

    def newest_sequence(self, name: str) -> int | None:
        """Return by which number a picture is told from a later one of that name; None where there is none."""
        run = self._used_run() if name in MAPS else self._run()
        return None if run is None else self._pictures.newest_sequence(run, name)

    def picture(self, name: str, *, zebra: bool = True, dolp_top: float = 1.0) -> Picture | None:
        """Return the newest picture of an angle, or a map without excluded frames; None where there is none."""
        run = self._used_run() if name in MAPS else self._run()
        return None if run is None else self._pictures.picture(run, name, zebra=zebra, dolp_top=dolp_top)

    def begun_utc(self) -> str:
        """Return when its folder was made; empty where it does not say."""
        run = _or_problem(self._run, [])
        return "" if run is None else run.created_utc

    def first_frame(self) -> FrameRecord | None:
        """Return its first frame; None where there is none."""
        run = _or_problem(self._run, [])
        return run.frames[0] if run is not None and run.frames else None

    def _run(self) -> Run | None:
        with self._reading:
            return self._tail.run(self._tail.read())

    def _used_run(self) -> Run | None:
        run = self._run()
        return None if run is None else annotated(run)

    def _stale_or(self, state: Liveliness) -> Liveliness:
        return "stale" if state == "live" and time.time() - self._written_s() > _STALE_S else state

    def _written_s(self) -> float:
        """Return when the session last wrote anything, by this machine's clock."""
        files = (self._path / name for name in (MANIFEST_FILE, EVENTS_FILE, STATUS_FILE))
        return max((file.stat().st_mtime for file in files if file.exists()), default=0.0)

    def _since(self, state: Liveliness, events: Sequence[RunEvent]) -> str:
        if state in ("stale", "interrupted"):
            return utc_text(int(self._written_s() * NS_PER_S)) if self._written_s() else ""
        ends = [event.utc for event in events if event.event in ("hold", "waiting", "finished", "stopped")]
        begins = [event.utc for event in events[:1]]
        return (ends if ends and state != "live" else [*begins, ""])[-1 if state != "live" else 0]

    def _advice(self, state: Liveliness, events: Sequence[RunEvent]) -> str:
        reasons = [str(event.facts.get("reason", "")) for event in events if event.event == "hold"]
        if state == "holding" and reasons:
            return f"{reasons[-1]}; then go on: rigctl resume {self._path}"
        return _ADVICE.get(state, "").format(run=self._path)

    def _with_plan(self, look: RunLook, problems: list[str]) -> RunLook:
        status = _or_problem(lambda: read_status(self._path), problems)
        if status is None:
            return look
        is_going = look.state in ("live", "holding", "waiting", "stale")
        return replace(
            look,
            session=status.session,
            frames_planned=status.frames_planned,
            remaining_s=status.progress.remaining_s if status.progress is not None and is_going else None,
            end_utc=status.progress.end_utc if status.progress is not None and is_going else "",
        )


def run_row(path: Path) -> RunRow:
    """Return a run as a row of a list, without what lies beside it."""
    reader = RunReader(path)
    look, begun_utc, first = reader.look(), reader.begun_utc(), reader.first_frame()
    elevation_deg = None if first is None else first.sun_elevation_deg
    return RunRow(
        run=path.name,
        state=look.state,
        begun_utc=begun_utc,
        frames=look.frames,
        sun_zenith_deg=None if elevation_deg is None else 90.0 - elevation_deg,
    )


class Source(Protocol):
    """What a page shows."""

    def rows(self) -> tuple[RunRow, ...] | None:
        """Return the runs of a folder; None where there is one run alone."""

    def reader(self, run: str) -> RunReader | None:
        """Return the run of a name; None where there is none of that name."""

    def document(self, run: str, name: str) -> bytes | None:
        """Return a page that lies beside a run; None where there is none of that name."""


class NoRuns:
    """No run at all: the page of a camera, or of a picture, alone."""

    def rows(self) -> tuple[RunRow, ...]:
        """Return an empty list."""
        return ()

    def reader(self, run: str) -> None:
        """Return None."""

    def document(self, run: str, name: str) -> None:
        """Return None."""


class OneRun:
    """One run, which may come later."""

    def __init__(self, path: Path) -> None:
        self._path, self._reader = path, RunReader(path)

    def rows(self) -> None:
        """Return None: there is no list."""

    def reader(self, run: str) -> RunReader | None:
        """Return the run, by its name or by none."""
        return self._reader if run in ("", self._path.resolve().name) else None

    def document(self, run: str, name: str) -> bytes | None:
        """Return its summary or a report beside it."""
        return _document(self._path, name) if self.reader(run) is not None else None


class RunsOfFolder:
    """The runs of a folder, as they are at each look."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._readers: OrderedDict[str, RunReader] = OrderedDict()
        self._rows: dict[Path, tuple[_Times, RunRow]] = {}
        self._comparisons = _Comparisons()

    def rows(self) -> tuple[RunRow, ...]:
        """Return the runs, the newest first."""
        beside = self._comparisons.by_run(self._path)
        rows = [self._row(path, beside.get(path.name, [])) for path in self._runs()]
        return tuple(sorted(rows, key=lambda row: (row.begun_utc, row.run), reverse=True))

    def reader(self, run: str) -> RunReader | None:
        """Return the run of a name."""
        if run not in {path.name for path in self._runs()}:
            return None
        with self._lock:
            reader = self._readers.setdefault(run, RunReader(self._path / run))
            self._readers.move_to_end(run)
            while len(self._readers) > _KEPT_READERS:
                self._readers.popitem(last=False)
            return reader

    def document(self, run: str, name: str) -> bytes | None:
        """Return a run's summary or a report beside it."""
        return _document(self._path / run, name) if self.reader(run) is not None else None

    def _runs(self) -> list[Path]:
        try:
            return [path for path in sorted(self._path.iterdir()) if _is_run(path)]
        except OSError:
            return []

    def _row(self, path: Path, compared: list[_Comparison]) -> RunRow:
        times = _times(path)
        known = self._rows.get(path)
        row = known[1] if known is not None and known[0] == times and known[1].state in _AT_REST else run_row(path)
        self._rows[path] = (times, row)
        pages = (
            *(["summary"] if path.with_name(f"{path.name}-{_SUMMARY}").is_file() else []),
            *(folder.name for _, folder, _, _ in compared),
        )
        return replace(row, verdict=compared[-1][3] if compared else "", pages=pages)


def source_at(path: Path) -> Source:
    """Return what a page at a path shows: a run, also one that is yet to come, or the runs of a folder."""
    if path.is_file():
        raise ConfigError(f"{path}: is a file; name a run folder, or a folder of run folders")
    if path.is_dir() and not _is_run(path):
        return RunsOfFolder(path)
    if not path.resolve().parent.is_dir():
        raise ConfigError(f"{path}: there is no folder in which this run could come to be")
    return OneRun(path)


class HistoryReader:
    """Takes the mean counts of every frame, the newest first, in a thread of its own."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._means: dict[int, dict[str, PixelMean]] = {}
        self._run: Run | None = None
        self._asked_s = 0.0
        self._thread: threading.Thread | None = None
        self._problem = ""

    @property
    def problem(self) -> str:
        """What cannot be read; empty where all can."""
        return self._problem

    def curves(self, run: Run) -> Curves:
        """Return the curves so far, and read on."""
        with self._lock:
            self._run, self._asked_s = run, time.monotonic()
            means: Means = dict(self._means)
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._work, name="history", daemon=True)
                self._thread.start()
        if not run.session.is_of_session or self._problem:
            return Curves(frames_there=len(run.frames), left_out=_left_out(run))
        read = tuple(record for record in run.frames if record.sequence in means)
        looks = cycle_history(replace(run, frames=read), means).looks
        return replace(_curves(looks, read, frames_there=len(run.frames)), left_out=_left_out(run))

    def _work(self) -> None:
        regions: RegionMeans | None = None
        while True:
            with self._lock:
                run = self._run
                is_over = time.monotonic() - self._asked_s > _LOOKED_S
            if run is None or is_over or self._problem:
                return
            record = next((r for r in reversed(run.frames) if r.sequence not in self._means), None)
            if record is None:
                time.sleep(0.2)
                continue
            try:
                regions = regions or RegionMeans(files_of(run)[1].regions if run.session.is_of_session else ())
                means = regions.of(run.counts(record))
            except (DataError, ConfigError) as error:
                self._problem = str(error)
                return
            with self._lock:
                self._means[record.sequence] = means


class CalibrationsBeside:
    """Remembers what was found of a run, until a file changes."""

    def __init__(self, run: Path) -> None:
        self._folders = (run.resolve().parent, run.resolve().parent.parent)
        self._known: tuple[object, tuple[CalibrationLook, ...]] = (None, ())

    def of(self, run: Run) -> tuple[CalibrationLook, ...]:
        """Return the calibrations, by kind and name; none until the run has a frame of the scene."""
        if not any(frame.kind == "scene" for frame in run.frames):
            return ()
        files = dict(sorted(_json_files(self._folders)))
        key = tuple(files.items())
        if self._known[0] != key:
            looks = (_look(path, run) for path in files)
            found = sorted((look for look in looks if look is not None), key=lambda look: (look.kind, look.file))
            self._known = (key, (*_of_rig(run), *found))
        return self._known[1]


class _Comparisons:
    """Remembers which comparison is of which run, until its file changes."""

    def __init__(self) -> None:
        self._known: dict[Path, tuple[int, _Comparison | None]] = {}

    def by_run(self, parent: Path) -> dict[str, list[_Comparison]]:
        """Return the comparisons in the folders of a folder by the runs that they are of, the oldest first."""
        found: dict[str, list[_Comparison]] = {}
        for one in sorted(filter(None, map(self._of, _folders(parent)))):
            found.setdefault(one[2], []).append(one)
        return found

    def _of(self, folder: Path) -> _Comparison | None:
        try:
            time_ns = (folder / _COMPARISON).stat().st_mtime_ns
        except OSError:
            return None
        if folder not in self._known or self._known[folder][0] != time_ns:
            self._known[folder] = (time_ns, _read_comparison(folder, time_ns))
        return self._known[folder][1]


def _is_run(path: Path) -> bool:
    return (path / SESSION_FILE).is_file() or (path / MANIFEST_FILE).is_file()


def _times(run: Path) -> _Times:
    """Return when the files were written that a row is made of."""
    found = []
    for name in (SESSION_FILE, MANIFEST_FILE, EVENTS_FILE):
        try:
            found.append((run / name).stat().st_mtime_ns)
        except OSError:
            found.append(0)
    return tuple(found)


def _document(run: Path, name: str) -> bytes | None:
    """Return the page of a name beside a run; each is one file that needs no other."""
    file: Path | None
    if name == "summary":
        file = run.with_name(f"{run.name}-{_SUMMARY}")
    else:
        beside = _Comparisons().by_run(run.parent).get(run.resolve().name, [])
        own = {folder.name: folder for _, folder, _, _ in beside}
        file = own[name] / _REPORT if name in own else None
    try:
        return None if file is None else read_bounded(file, MOST_RECORD_BYTES)
    except OSError:
        return None


def _folders(parent: Path) -> list[Path]:
    try:
        return [path for path in parent.iterdir() if path.is_dir()]
    except OSError:
        return []


def _read_comparison(folder: Path, time_ns: int) -> _Comparison | None:
    """Return what a comparison says of itself; None where it does not say of which run it is."""
    try:
        content = json.loads(read_bounded(folder / _COMPARISON, MOST_RECORD_BYTES))
        run = Path(content["provenance"]["run"]["path"]).name
        verdict = str(content.get("verdict", "")).replace("_", " ")
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None
    return time_ns, folder, run, verdict


def _left_out(run: Run) -> str:
    return exclusions_text(excluded_frames(run.annotations)) if run.excluded else ""


def _curves(looks: Sequence[CycleLook], frames: Sequence[FrameRecord], *, frames_there: int) -> Curves:
    suns = {(frame.round, frame.cycle): frame.sun_elevation_deg for frame in frames}
    elevations = [suns.get((look.round, look.cycle)) for look in looks]
    names = sorted({name for look in looks for name in look.regions}, key=lambda name: (name == PICTURE, name))
    return Curves(
        time_s=tuple(look.time_s for look in looks),
        sun_zenith_deg=tuple(None if elevation is None else 90.0 - elevation for elevation in elevations),
        sum_rule=tuple(None if look.sum_rule is None else look.sum_rule.value for look in looks),
        drift_percent_per_min=tuple(None if look.drift is None else _PERCENT * look.drift.per_min for look in looks),
        regions=tuple(_curve(name, looks) for name in names),
        frames_read=len(frames),
        frames_there=frames_there,
    )


def _curve(name: str, looks: Sequence[CycleLook]) -> dict[str, JsonValue]:
    seen = [look.regions.get(name) for look in looks]
    return {
        "name": name,
        "dolp": [None if one is None else one.dolp.value for one in seen],
        "dolp_std": [None if one is None else one.dolp.sigma for one in seen],
        "aolp_deg": [None if one is None or not one.has_angle else one.aolp_deg for one in seen],
        "aolp_std_deg": [None if one is None else one.aolp_sigma_deg for one in seen],
        "light_dn_per_s": [None if one is None else one.light_dn_per_s for one in seen],
    }


def _json_files(folders: tuple[Path, ...]) -> Iterator[tuple[Path, int]]:
    """Return the files that may be calibrations, with the time of each."""
    for folder in folders:
        for path in sorted(folder.glob("*.json"))[:_MOST_FILES]:
            with suppress(OSError):  # a link to nowhere
                yield path, path.stat().st_mtime_ns


def _of_rig(run: Run) -> tuple[CalibrationLook, ...]:
    """Return the axis of the polarizer, which the rig file has, where that is none yet."""
    if not run.session.polarizer.placeholder:
        return ()
    return (CalibrationLook(file="rig.toml", kind="axis of the polarizer", verdict="does not hold", words=PLACEHOLDER),)


def _look(path: Path, run: Run) -> CalibrationLook | None:
    """Return what a file is worth for a run; None where it is no calibration."""
    try:
        kind = _kind_of(path)
    except OSError:
        return None
    if kind is None:
        return None
    made_utc, valid_days = _made(path)
    look = CalibrationLook(
        file=path.name, kind=kind, made_utc=made_utc, valid_days=valid_days or KINDS[kind].valid_days, verdict="holds"
    )
    try:
        _, doubts = _READERS[kind](path, run)
    except DataError as error:
        return replace(look, verdict="does not hold", words=str(error).replace(str(path), path.name))
    return replace(look, verdict="doubtful", words="; ".join(doubts)) if doubts else look


def _kind_of(path: Path) -> CalibrationKind | None:
    with open_plain(path) as file:
        head = file.read(_HEAD_BYTES)
    named = _KIND.search(head)
    if named is None:
        return "noise" if _OF_NOISE.search(head) is not None else None
    return next((kind for kind in KINDS if kind == named[1].decode("ascii")), None)


def _made(path: Path) -> tuple[str, float | None]:
    """Return when a calibration was made and for how many days it says that it holds, as far as it says so."""
    try:
        content: JsonValue = json.loads(read_bounded(path, MOST_TEXT_BYTES))
    except (OSError, ValueError, RecursionError):
        return "", None
    if not isinstance(content, dict):
        return "", None
    made_for = content.get("made_for")
    made = made_for if isinstance(made_for, dict) else {}
    utc, days = made.get("taken_utc") or content.get("created_utc"), made.get("valid_days")
    is_number = isinstance(days, int | float) and not isinstance(days, bool)
    return str(utc or "")[:40], float(days) if is_number and isinstance(days, int | float) else None


def _or_problem(read: Callable[[], T], problems: list[str]) -> T | None:
    try:
        return read()
    except (DataError, OSError) as error:
        problems.append(str(error))
        return None


def _with_frames(look: RunLook, run: Run, used: Run | None) -> RunLook:
    frames = run.frames
    last = frames[-1] if frames else None
    cycle = () if used is None else last_cycle(used.frames)
    return replace(
        look,
        is_simulated=run.session.origin == "simulated",
        frames=len(frames),
        step="" if last is None else _step(last),
        sun_zenith_deg=None if last is None or last.sun_elevation_deg is None else 90.0 - last.sun_elevation_deg,
        sun_azimuth_deg=None if last is None else last.sun_azimuth_deg,
        camera_temperature_c=None if last is None else last.camera_temperature_c,
        newest=tuple(_newest_frame(name, frame) for name, frame in sorted(newest_by_name(frames).items(), key=_place)),
        maps_of=_step(cycle[-1]) if cycle else "",
    )


def _place(named: tuple[str, FrameRecord]) -> tuple[int, float, str]:
    name, frame = named
    angle_deg = frame.polarizer_angle_target_deg
    return (0 if frame.kind == "scene" else 1, 0.0 if angle_deg is None else angle_deg, name)


def _newest_frame(name: str, frame: FrameRecord) -> dict[str, JsonValue]:
    return {
        "name": name,
        "sequence": frame.sequence,
        "utc": frame.start_utc or "",
        "exposure_ms": None if frame.exposure_s is None else frame.exposure_s * _MS_PER_S,
        "clipped": frame.saturated_fraction,
    }


def _step(frame: FrameRecord) -> str:
    words: list[str] = [frame.kind]
    words += [] if frame.round is None else [f"round {frame.round + 1}"]
    words += [] if frame.cycle is None else [f"cycle {frame.cycle + 1}"]
    words += [] if frame.polarizer_angle_deg is None else [f"{frame.polarizer_angle_deg:.2f} deg"]
    return ", ".join(words)


def _happenings(events: Sequence[RunEvent], noted: Sequence[Annotation]) -> tuple[dict[str, str], ...]:
    """Return the last things that happened or were noted, the newest first."""
    happened = [event for event in events if event.event != READINGS_EVENT][-_EVENTS:]
    told = [{"utc": event.utc, "event": event.event, "facts": event_facts(event)} for event in happened]
    if noted:
        told += [{"utc": one.utc, "event": one.kind, "facts": one.facts} for one in noted[-_EVENTS:]]
        told.sort(key=lambda one: one["utc"])
    return tuple(reversed(told[-_EVENTS:]))
