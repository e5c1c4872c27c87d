"""What a page shows: one run, or the runs of a folder with what lies beside them."""

import json
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from pathlib import Path

from rigctl.errors import ConfigError
from rigctl.runs.run_description import SESSION_FILE
from rigctl.runs.run_events import EVENTS_FILE
from rigctl.runs.run_folder import MANIFEST_FILE
from rigctl.storage.bounded_file import MOST_RECORD_BYTES, read_bounded
from rigctl.web.page import Source
from rigctl.web.run_look import RunRow
from rigctl.web.run_reader import RunReader, run_row

_KEPT_READERS = 64
_REPORT = "report.html"
_COMPARISON = "comparison.json"
_SUMMARY = "summary.html"
_AT_REST = ("finished", "stopped", "interrupted")
_Times = tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class _Comparison:
    """A folder that holds a comparison: of which run, what it found, and when it was written."""

    folder: Path
    run: str
    verdict: str
    time_ns: int


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
    """One run, which may come later.

    Parameters
    ----------
    path : Path
        Its folder.
    """

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
    """The runs of a folder, as they are at each look.

    Parameters
    ----------
    path : Path
        The folder.
    """

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
        pages = (*(["summary"] if _summary(path) is not None else []), *(one.folder.name for one in compared))
        return replace(row, verdict=compared[-1].verdict if compared else "", pages=pages)


class _Comparisons:
    """Remembers which comparison is of which run, until its file changes."""

    def __init__(self) -> None:
        self._known: dict[Path, tuple[int, _Comparison | None]] = {}

    def by_run(self, parent: Path) -> dict[str, list[_Comparison]]:
        """Return the comparisons in the folders of a folder by the runs that they are of, the oldest first."""
        found: dict[str, list[_Comparison]] = {}
        for one in sorted(filter(None, map(self._of, _folders(parent))), key=lambda one: one.time_ns):
            found.setdefault(one.run, []).append(one)
        return found

    def _of(self, folder: Path) -> _Comparison | None:
        try:
            time_ns = (folder / _COMPARISON).stat().st_mtime_ns
        except OSError:
            return None
        if folder not in self._known or self._known[folder][0] != time_ns:
            self._known[folder] = (time_ns, _read_comparison(folder, time_ns))
        return self._known[folder][1]


def source_at(path: Path) -> Source:
    """Return what a page at a path shows: a run, also one that is yet to come, or the runs of a folder.

    Raises
    ------
    ConfigError
        Nothing can come there, or a file is there.
    """
    if path.is_file():
        raise ConfigError(f"{path}: is a file; name a run folder, or a folder of run folders")
    if path.is_dir() and not _is_run(path):
        return RunsOfFolder(path)
    if not path.resolve().parent.is_dir():
        raise ConfigError(f"{path}: there is no folder in which this run could come to be")
    return OneRun(path)


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
    if name == "summary":
        file = _summary(run)
    else:
        own = {one.folder.name: one.folder for one in _Comparisons().by_run(run.parent).get(run.resolve().name, [])}
        file = own[name] / _REPORT if name in own else None
    try:
        return None if file is None else read_bounded(file, MOST_RECORD_BYTES)
    except OSError:
        return None


def _summary(run: Path) -> Path | None:
    files = (run.with_name(f"{run.name}-{_SUMMARY}"), run / _SUMMARY)
    return next((file for file in files if file.is_file()), None)


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
    return _Comparison(folder=folder, run=run, verdict=verdict, time_ns=time_ns)
