"""Runs for a page: state, numbers, curves and pictures, read as a run grows.

A page requests them once a second, so only new data are read. Nothing is written. All answers are JSON.
"""

import json
import shutil
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded
from rigctl.base.numbers import NS_PER_S, utc_text
from rigctl.calibrations.kinds import kind_of, record_of
from rigctl.errors import ConfigError, DataError
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
from rigctl.session.status import STATUS_FILE, LiveStatus, read_status, session_state
from rigctl.web.pictures import MAPS, Picture, RunPictures, last_cycle, newest_by_name

T = TypeVar("T")
Look = dict[str, Any]
# After this time without a request, no further frames are read.
_LOOKED_S = 10.0
# A session that has written nothing for this long is stale.
_STALE_S = 30.0
_EVENTS = 30
_KEPT_READERS = 64
_MOST_FILES = 200
_BYTES_PER_MB, _MS_PER_S, _PERCENT = 1e6, 1e3, 100.0
_REPORT, _COMPARISON, _SUMMARY = "report.html", "comparison.json", "summary.html"
_GOING = ("live", "holding", "waiting", "stale")
_AT_REST = ("finished", "stopped", "interrupted")
_ADVICE = {
    "stale": "A process holds the run and has written nothing since: look at its terminal.",
    "stopped": "Stopped. Continue with rigctl resume {run}",
    "interrupted": "Interrupted. Continue with rigctl resume {run}",
}
# A comparison: time of writing [ns], folder, name of its run, verdict.
_Comparison = tuple[int, Path, str, str]
_NOTHING_KNOWN: Look = {
    "run": "",  # name of the folder
    # "waiting" (no frame yet, or the next round has not begun), "live", "holding", "stale" (a process holds the run but
    # has written nothing for long), "finished", "stopped" or "interrupted"
    "state": "waiting",
    "since_utc": "",  # start of that state
    "advice": "",
    "session": "",  # name of the session
    "frames": 0,  # stored frames, and planned ones
    "frames_planned": None,
    "remaining_s": None,
    "end_utc": "",
    "step": "",  # kind, round, cycle and angle of the last frame
    "sun_zenith_deg": None,  # at the last frame, as the next two
    "sun_azimuth_deg": None,
    "camera_temperature_c": None,
    "disk_free_mb": 0.0,
    "is_simulated": False,
    # newest frame of each angle, then dark and flat: name, sequence, utc, exposure_ms, clipped (saturated share)
    "newest": [],
    "maps_of": "",  # cycle of the maps
    "events": [],  # newest first: utc, event, facts
    "problems": [],  # files that cannot be read or are damaged
}
NO_CURVES: Look = {
    # one entry a cycle:
    "time_s": [],  # start, seconds since 1970 (UTC)
    "sun_zenith_deg": [],
    "sum_rule": [],  # (I0 + I90) / (I45 + I135) of the whole picture
    "drift_percent_per_min": [],
    "regions": [],  # name, dolp, dolp_std, aolp_deg, aolp_std_deg, light_dn_per_s of the picture and each region
    "frames_read": 0,  # True until all frames are read
    "frames_there": 0,
    "left_out": "",  # excluded frames, which are not in the curves, and the reason
}


class RunReader:
    """Reads a run for all pages that show it. Thread-safe."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reading = threading.Lock()
        self._tail, self._history, self._pictures = RunTail(path), _MeansReader(), RunPictures()
        self._calibrations: tuple[object, list[Look]] = (None, [])

    def look(self) -> Look:
        """Return the state of the run; files that cannot be read are listed as problems."""
        if not self._path.is_dir():
            return _NOTHING_KNOWN | {"run": self._path.name, "advice": "There is no such folder yet."}
        problems: list[str] = []
        run = _or_problem(self._run, problems)
        events = _or_problem(lambda: read_events(self._path), problems) or []
        used = None if run is None else _or_problem(lambda: annotated(run), problems)
        process = _or_problem(lambda: writing_process(self._path), problems)
        status = _or_problem(lambda: read_status(self._path), problems)
        state = "waiting" if run is None else self._state(process, events)
        return {
            **_NOTHING_KNOWN,
            "run": self._path.name,
            "state": state,
            "since_utc": self._since_utc(state, events),
            "advice": self._advice(state, events),
            "disk_free_mb": shutil.disk_usage(self._path).free / _BYTES_PER_MB,
            "events": _last_events(events, () if used is None else used.annotations),
            **({} if run is None else _of_frames(run, used)),
            **({} if status is None else _of_plan(status, is_going=state in _GOING)),
            "problems": [*problems, *self._tail.problems, *filter(None, [self._history.problem])],
        }

    def row(self) -> Look:
        """Return the row of the run in a list of runs."""
        look, run = self.look(), _or_problem(self._run, [])
        elevation_deg = run.frames[0].sun_elevation_deg if run is not None and run.frames else None
        return {
            "run": look["run"],
            "state": look["state"],
            "begun_utc": "" if run is None else run.created_utc,
            "frames": look["frames"],
            "sun_zenith_deg": None if elevation_deg is None else 90.0 - elevation_deg,
        }

    def curves(self) -> Look:
        """Return the numbers of each cycle without excluded frames, for the frames read so far."""
        run = self._used_run()
        return NO_CURVES if run is None else self._history.curves(run)

    def calibrations(self) -> list[Look]:
        """Return the calibrations in the run folder and its parent, and whether they are valid for this run.

        Empty until the run has a scene frame.
        """
        run = _or_problem(self._run, [])
        if run is None or not any(frame.kind == "scene" for frame in run.frames):
            return []
        files = dict(sorted(_json_files(self._path.resolve().parents[:2])))
        key = tuple(files.items())
        if self._calibrations[0] != key:
            found = (_calibration(path, run) for path in files)
            known = sorted((one for one in found if one is not None), key=lambda one: (one["kind"], one["file"]))
            self._calibrations = (key, [*_unset_axis(run), *known])
        return self._calibrations[1]

    def newest_sequence(self, name: str) -> int | None:
        """Return the number of the newest picture of a name; None if there is none."""
        run = self._used_run() if name in MAPS else self._run()
        return None if run is None else self._pictures.newest_sequence(run, name)

    def picture(self, name: str, *, zebra: bool = True, dolp_top: float = 1.0) -> Picture | None:
        """Return the newest picture of an angle, or a map without excluded frames; None if there is none."""
        run = self._used_run() if name in MAPS else self._run()
        return None if run is None else self._pictures.picture(run, name, zebra=zebra, dolp_top=dolp_top)

    def _run(self) -> Run | None:
        with self._reading:
            return self._tail.run(self._tail.read())

    def _used_run(self) -> Run | None:
        run = self._run()
        return None if run is None else annotated(run)

    def _state(self, process: int | None, events: Sequence[RunEvent]) -> str:
        state = session_state(process, events)
        if state == "running":
            return "stale" if time.time() - self._written_s() > _STALE_S else "live"
        return state

    def _written_s(self) -> float:
        """Return when the session last wrote a file, by this machine's clock; 0 if it wrote none."""
        files = (self._path / name for name in (MANIFEST_FILE, EVENTS_FILE, STATUS_FILE))
        return max((file.stat().st_mtime for file in files if file.exists()), default=0.0)

    def _since_utc(self, state: str, events: Sequence[RunEvent]) -> str:
        if state in ("stale", "interrupted"):
            written_s = self._written_s()
            return utc_text(int(written_s * NS_PER_S)) if written_s else ""
        if state == "live":
            return events[0].utc if events else ""
        ends = [event.utc for event in events if event.event in ("hold", "waiting", "finished", "stopped")]
        return ends[-1] if ends else ""

    def _advice(self, state: str, events: Sequence[RunEvent]) -> str:
        reasons = [str(event.facts.get("reason", "")) for event in events if event.event == "hold"]
        if state == "holding" and reasons:
            words = "Held on request" if reasons[-1] == "requested" else reasons[-1]
            return f"{words}. Continue with rigctl resume {self._path}"
        return _ADVICE.get(state, "").format(run=self._path)


class Source(Protocol):
    """The runs of a page."""

    def rows(self) -> list[Look] | None:
        """Return the rows of a list of runs; None if the page shows a single run."""

    def reader(self, run: str) -> RunReader | None:
        """Return the reader of a run; None if there is none of that name."""

    def document(self, run: str, name: str) -> bytes | None:
        """Return the summary of a run or a report about it; None if there is none of that name."""


class NoRuns:
    """The page of a camera, or of a picture, without runs."""

    def rows(self) -> list[Look]:
        """Return an empty list."""
        return []

    def reader(self, run: str) -> None:
        """Return None."""

    def document(self, run: str, name: str) -> None:
        """Return None."""


class OneRun:
    """One run, which need not exist yet."""

    def __init__(self, path: Path) -> None:
        self._path, self._reader = path, RunReader(path)

    def rows(self) -> None:
        """Return None: there is no list."""

    def reader(self, run: str) -> RunReader | None:
        """Return the reader of the run, also for an empty name."""
        return self._reader if run in ("", self._path.resolve().name) else None

    def document(self, run: str, name: str) -> bytes | None:
        """Return the summary of the run or a report about it."""
        return _document(self._path, name) if self.reader(run) is not None else None


class RunsOfFolder:
    """The runs of a folder, which is read again for each answer."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._readers: OrderedDict[str, RunReader] = OrderedDict()
        self._rows: dict[Path, tuple[tuple[int, ...], Look]] = {}
        self._comparisons = _Comparisons()

    def rows(self) -> list[Look]:
        """Return the runs, the newest first, with the verdict of the newest comparison and the pages about each."""
        compared = self._comparisons.by_run(self._path)
        rows = [self._row(path, compared.get(path.name, [])) for path in self._runs()]
        return sorted(rows, key=lambda row: (row["begun_utc"], row["run"]), reverse=True)

    def reader(self, run: str) -> RunReader | None:
        """Return the reader of the run of a name."""
        if run not in {path.name for path in self._runs()}:
            return None
        with self._lock:
            reader = self._readers.setdefault(run, RunReader(self._path / run))
            self._readers.move_to_end(run)
            while len(self._readers) > _KEPT_READERS:
                self._readers.popitem(last=False)
            return reader

    def document(self, run: str, name: str) -> bytes | None:
        """Return the summary of a run or a report about it."""
        return _document(self._path / run, name) if self.reader(run) is not None else None

    def _runs(self) -> list[Path]:
        try:
            return [path for path in sorted(self._path.iterdir()) if _is_run(path)]
        except OSError:
            return []

    def _row(self, path: Path, compared: list[_Comparison]) -> Look:
        times = _times(path)
        known_times, row = self._rows.get(path, ((), {}))
        if known_times != times or row["state"] not in _AT_REST:
            row = RunReader(path).row()
            self._rows[path] = (times, row)
        has_summary = path.with_name(f"{path.name}-{_SUMMARY}").is_file()
        pages = [*(["summary"] if has_summary else []), *(folder.name for _, folder, _, _ in compared)]
        return row | {"verdict": compared[-1][3] if compared else "", "pages": pages}


def source_at(path: Path) -> Source:
    """Return the runs of a path: a run, which need not exist yet, or those of a folder."""
    if path.is_file():
        raise ConfigError(f"{path}: is a file; name a run folder, or a folder of run folders")
    if path.is_dir() and not _is_run(path):
        return RunsOfFolder(path)
    if not path.resolve().parent.is_dir():
        raise ConfigError(f"{path}: its parent folder does not exist")
    return OneRun(path)


class _MeansReader:
    """Reads the mean counts of all frames for the curves in a thread of its own, the newest frame first."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._means: dict[int, dict[str, PixelMean]] = {}
        self._run: Run | None = None
        self._asked_s = 0.0
        self._thread: threading.Thread | None = None
        self.problem = ""  #: Reason why frames cannot be read; empty if they can.

    def curves(self, run: Run) -> Look:
        """Return the curves so far, and continue reading."""
        with self._lock:
            self._run, self._asked_s = run, time.monotonic()
            means: Means = dict(self._means)
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._work, name="history", daemon=True)
                self._thread.start()
        left_out = exclusions_text(excluded_frames(run.annotations)) if run.excluded else ""
        content = NO_CURVES | {"frames_there": len(run.frames), "left_out": left_out}
        if not run.session.is_of_session or self.problem:
            return content
        read = tuple(record for record in run.frames if record.sequence in means)
        return content | _curves(cycle_history(replace(run, frames=read), means).looks, read)

    def _work(self) -> None:
        regions: RegionMeans | None = None
        while True:
            with self._lock:
                run = self._run
                is_over = time.monotonic() - self._asked_s > _LOOKED_S
            if run is None or is_over or self.problem:
                return
            record = next((r for r in reversed(run.frames) if r.sequence not in self._means), None)
            if record is None:
                time.sleep(0.2)
                continue
            try:
                regions = regions or RegionMeans(files_of(run)[1].regions if run.session.is_of_session else ())
                means = regions.of(run.counts(record))
            except (DataError, ConfigError) as error:
                self.problem = str(error)
                return
            with self._lock:
                self._means[record.sequence] = means


class _Comparisons:
    """Finds the comparisons in a folder. A file is read again only if it has changed."""

    def __init__(self) -> None:
        self._known: dict[Path, tuple[int, _Comparison | None]] = {}

    def by_run(self, parent: Path) -> dict[str, list[_Comparison]]:
        """Return the comparisons in the subfolders by the name of their run, the oldest first."""
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


def _times(run: Path) -> tuple[int, ...]:
    """Return the times of the files from which a row is made; 0 for a missing file."""
    found = []
    for name in (SESSION_FILE, MANIFEST_FILE, EVENTS_FILE):
        try:
            found.append((run / name).stat().st_mtime_ns)
        except OSError:
            found.append(0)
    return tuple(found)


def _document(run: Path, name: str) -> bytes | None:
    """Return a page about a run, a file that needs no other."""
    if name == "summary":
        file = run.with_name(f"{run.name}-{_SUMMARY}")
    else:
        compared = _Comparisons().by_run(run.parent).get(run.resolve().name, [])
        folders = [folder for _, folder, _, _ in compared if folder.name == name]
        if not folders:
            return None
        file = folders[0] / _REPORT
    try:
        return read_bounded(file, MOST_RECORD_BYTES)
    except OSError:
        return None


def _folders(parent: Path) -> list[Path]:
    try:
        return [path for path in parent.iterdir() if path.is_dir()]
    except OSError:
        return []


def _read_comparison(folder: Path, time_ns: int) -> _Comparison | None:
    """Return a comparison; None if its file does not name its run."""
    try:
        content = json.loads(read_bounded(folder / _COMPARISON, MOST_RECORD_BYTES))
        run = Path(content["provenance"]["run"]["path"]).name
        verdict = str(content.get("verdict", "")).replace("_", " ")
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None
    return time_ns, folder, run, verdict


def _curves(looks: Sequence[CycleLook], frames: Sequence[FrameRecord]) -> Look:
    suns = {(frame.round, frame.cycle): frame.sun_elevation_deg for frame in frames}
    elevations = [suns.get((look.round, look.cycle)) for look in looks]
    names = sorted({name for look in looks for name in look.regions}, key=lambda name: (name == PICTURE, name))
    return {
        "time_s": [look.time_s for look in looks],
        "sun_zenith_deg": [None if elevation is None else 90.0 - elevation for elevation in elevations],
        "sum_rule": [None if look.sum_rule is None else look.sum_rule.value for look in looks],
        "drift_percent_per_min": [None if look.drift is None else _PERCENT * look.drift.per_min for look in looks],
        "regions": [_curve(name, looks) for name in names],
        "frames_read": len(frames),
    }


def _curve(name: str, looks: Sequence[CycleLook]) -> Look:
    found = [look.regions.get(name) for look in looks]
    return {
        "name": name,
        "dolp": [None if one is None else one.dolp.value for one in found],
        "dolp_std": [None if one is None else one.dolp.sigma for one in found],
        "aolp_deg": [None if one is None or not one.has_angle else one.aolp_deg for one in found],
        "aolp_std_deg": [None if one is None else one.aolp_sigma_deg for one in found],
        "light_dn_per_s": [None if one is None else one.light_dn_per_s for one in found],
    }


def _json_files(folders: Sequence[Path]) -> Iterator[tuple[Path, int]]:
    """Return the files that may be calibrations, with their times."""
    for folder in folders:
        for path in sorted(folder.glob("*.json"))[:_MOST_FILES]:
            with suppress(OSError):  # a dangling link
                yield path, path.stat().st_mtime_ns


def _unset_axis(run: Run) -> list[Look]:
    """Return a row on an uncalibrated polarizer of the rig file; empty if it is calibrated."""
    return [_verdict("rig.toml", "axis of the polarizer", PLACEHOLDER)] if run.session.polarizer.placeholder else []


def _verdict(file: str, kind: str, words: str) -> Look:
    return {"file": file, "kind": kind, "made_utc": "", "valid_days": None, "verdict": "not valid", "words": words}


def _calibration(path: Path, run: Run) -> Look | None:
    """Return whether a calibration is valid for a run; None if the file is not a calibration."""
    kind = kind_of(path)
    if kind is None:
        return None
    look = _verdict(path.name, kind, "")
    try:
        made = record_of(kind).read(path).origin
        look |= {"made_utc": made.taken_utc or "", "valid_days": made.valid_days}
        _, doubts = record_of(kind).read_fitting(path, run)
    except DataError as error:
        return look | {"words": str(error).replace(str(path), path.name)}
    return look | {"verdict": "doubtful" if doubts else "valid", "words": "; ".join(doubts)}


def _or_problem(read: Callable[[], T], problems: list[str]) -> T | None:
    try:
        return read()
    except (DataError, OSError) as error:
        problems.append(str(error))
        return None


def _of_plan(status: LiveStatus, *, is_going: bool) -> Look:
    return {
        "session": status.session,
        "frames_planned": status.frames_planned,
        "remaining_s": status.remaining_s if is_going else None,
        "end_utc": (status.end_utc if is_going else None) or "",
    }


def _of_frames(run: Run, used: Run | None) -> Look:
    cycle = () if used is None else last_cycle(used.frames)
    content: Look = {
        "is_simulated": run.session.origin == "simulated",
        "frames": len(run.frames),
        "newest": [_newest(*named) for named in sorted(newest_by_name(run.frames).items(), key=_place)],
        "maps_of": _step(cycle[-1]) if cycle else "",
    }
    if not run.frames:
        return content
    last = run.frames[-1]
    return content | {
        "step": _step(last),
        "sun_zenith_deg": None if last.sun_elevation_deg is None else 90.0 - last.sun_elevation_deg,
        "sun_azimuth_deg": last.sun_azimuth_deg,
        "camera_temperature_c": last.camera_temperature_c,
    }


def _place(named: tuple[str, FrameRecord]) -> tuple[int, float, str]:
    """Return the place of a frame on the page: angles in their order, then dark and flat."""
    name, frame = named
    return (0 if frame.kind == "scene" else 1, frame.polarizer_angle_target_deg or 0.0, name)


def _newest(name: str, frame: FrameRecord) -> Look:
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
    words += [] if frame.polarizer_angle_deg is None else [f"{round(frame.polarizer_angle_deg, 2) % 180.0:.2f} deg"]
    return ", ".join(words)


def _last_events(events: Sequence[RunEvent], annotations: Sequence[Annotation]) -> list[Look]:
    """Return the last events and annotations, the newest first, without readings of monitors."""
    shown = [event for event in events if event.event != READINGS_EVENT][-_EVENTS:]
    rows = [{"utc": event.utc, "event": event.event, "facts": event_facts(event)} for event in shown]
    if annotations:  # without annotations the order of events stays, even if the clock was set back
        rows += [{"utc": one.utc, "event": one.kind, "facts": one.facts} for one in annotations[-_EVENTS:]]
        rows.sort(key=lambda row: row["utc"])
    return rows[: -_EVENTS - 1 : -1]
