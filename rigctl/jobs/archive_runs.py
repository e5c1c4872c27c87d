"""The jobs of single runs over all runs of an archive that match: on dask, resumed, a row for each."""

import hashlib
import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from rigctl.archive.over_runs import RunRow, inputs_hash, read_rows, write_rows
from rigctl.archive.report import write_archive_rows
from rigctl.base.destination import Origin, results_of
from rigctl.base.durable import sha256_of
from rigctl.calibrations.store import KINDS, NONE
from rigctl.console.failures import EXIT_DATA, EXIT_DISAGREES, EXIT_INCOMPLETE, EXIT_OWN_FAULT
from rigctl.console.json_text import Json
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import load_regions
from rigctl.files.scene_file import load_scene
from rigctl.jobs.archive import matching_runs
from rigctl.jobs.archive_work import FAILED, PACKAGES, ArchiveRequest, RunTask, rows_of
from rigctl.mapped import client_of, code_version, compute_all, held_folder, slots_of
from rigctl.measure.calibrations import store_of_run
from rigctl.runs.folder import read_run
from rigctl.study import scene_digest
from rigctl.verbs.options import calibrations_of

# Small runs are done together, so that handing them out costs little.
_MOST_RUNS, _ROUNDS = 16, 8
Outcome = Literal["whole", "stopped"]


@dataclass(frozen=True, kw_only=True)
class ArchiveResult:
    """Rows of an archive.

    Attributes
    ----------
    rows : tuple of RunRow
        Of the runs that were tried, in the order of their names.
    runs : int
        How many match.
    done_before : int
        Of how many an earlier command had made the row.
    outcome : {"whole", "stopped"}
        Whether all were tried.
    damaged : tuple of str
        Files of an earlier command that could not be read.
    """

    rows: tuple[RunRow, ...]
    runs: int
    done_before: int
    outcome: Outcome
    damaged: tuple[str, ...]

    @property
    def verdicts(self) -> Mapping[str, int]:
        """How many runs have which verdict, the most frequent first."""
        return dict(Counter(row.verdict for row in self.rows).most_common())

    def as_json(self, out: Path) -> dict[str, Json]:
        """Return the answer of a job over an archive."""
        return {
            "schema_version": 1,
            "out": str(out),
            "outcome": self.outcome,
            "runs": self.runs,
            "done": len(self.rows),
            "done_before": self.done_before,
            "verdicts": self.verdicts,
            "rows": [asdict(row) for row in self.rows],
        }

    @property
    def exit_code(self) -> int:
        """75 where it was stopped; 5 where a run disagrees; else 4 where one failed or is unfit, 75 if unfinished."""
        codes = {row.exit_code for row in self.rows}
        if self.outcome == "stopped":
            return EXIT_INCOMPLETE
        if EXIT_DISAGREES in codes:
            return EXIT_DISAGREES
        return EXIT_DATA if codes - {0, EXIT_INCOMPLETE} else max(codes, default=0)


def run_over_archive(
    request: ArchiveRequest, *, tell: Callable[[int, int], None] = lambda _done, _runs: None
) -> ArchiveResult:
    """Return the rows of a job over an archive, done as far as they were not before, once its files are written.

    Parameters
    ----------
    request : ArchiveRequest
        The job; paths in it may be relative.
    tell : callable
        Takes how many runs are done, and how many there are, as they come.

    Raises
    ------
    ConfigError
        There is no such archive, a file that all runs need is wrong, or dask or a scheduler is not there.
    DataError
        The folder is in use, or the scheduler went away: what was done is kept.
    """
    request = _absolute(request)
    settings = _settings_text(request)
    names = matching_runs(request.root, request.where)
    with held_folder(request.out):
        stores = _Stores(request)
        hashes = {name: inputs_hash(request.root / name, f"{settings}{name}\0{stores.of_run(name)}") for name in names}
        kept = read_rows(request.out)
        left = [name for name in names if not _is_done(kept.rows.get(hashes[name]))]
        outcome = _done(request, left, hashes, lambda new: tell(len(names) - len(left) + new, len(names)))
        rows = read_rows(request.out).rows
        found = ArchiveResult(
            rows=tuple(rows[hashes[name]] for name in names if hashes[name] in rows),
            runs=len(names),
            done_before=len(names) - len(left),
            outcome=outcome,
            damaged=kept.damaged,
        )
        # What a person made there was refused by the command; an earlier table of this folder makes room.
        with results_of(Origin(command=f"archive {request.verb}", digest=""), force=True):
            write_archive_rows(
                found.rows, request.verb, request.out, runs=found.runs, alpha=request.options.get("alpha", 1e-3)
            )
    return found


def _is_done(row: RunRow | None) -> bool:
    """Return whether a row stands; one that a fault of the program or of the machine ended is tried again."""
    return row is not None and row.exit_code != EXIT_OWN_FAULT


def _done(
    request: ArchiveRequest, left: Sequence[str], hashes: Mapping[str, str], tell: Callable[[int], None]
) -> Outcome:
    tell(0)
    if not left:
        return "whole"
    new = 0

    def keep(task: RunTask, rows: tuple[RunRow, ...]) -> None:
        nonlocal new
        write_rows(request.out, {hashes[row.run]: row for row in rows})
        new += len(task.names)
        tell(new)

    try:
        with client_of(request.engine, command=f"archive {request.verb}", packages=PACKAGES) as client:
            workers = slots_of(client)
            compute_all(client, rows_of, _tasks(left, request, workers), keep, parts=_parts, lost=_lost)
    except KeyboardInterrupt:
        return "stopped"
    return "whole"


def _tasks(names: Sequence[str], request: ArchiveRequest, workers: int) -> Iterator[RunTask]:
    most = max(1, min(_MOST_RUNS, math.ceil(len(names) / (workers * _ROUNDS))))
    for first in range(0, len(names), most):
        yield RunTask(names=tuple(names[first : first + most]), request=request, code=code_version(PACKAGES))


def _parts(task: RunTask) -> tuple[RunTask, ...]:
    return tuple(replace(task, names=(name,)) for name in task.names)


def _lost(task: RunTask, reason: str) -> tuple[RunRow, ...]:
    return tuple(RunRow(run=name, exit_code=EXIT_OWN_FAULT, verdict=FAILED, reason=reason) for name in task.names)


def _absolute(request: ArchiveRequest) -> ArchiveRequest:
    """Return a job whose files are found from any folder, once those that all runs need were found to be right."""
    for path in calibrations_of(request.options).files.values():
        if not path.is_file():
            raise ConfigError(f"{path}: there is no such calibration")
    options: Any = {
        name: value.absolute() if isinstance(value, Path) and value != NONE else value
        for name, value in request.options.items()
    }
    return replace(
        request,
        root=request.root.absolute(),
        out=request.out.absolute(),
        scene=None if request.scene is None else request.scene.absolute(),
        regions=None if request.regions is None else request.regions.absolute(),
        options=options,
    )


def _settings_text(request: ArchiveRequest) -> str:
    """Return all that the rows of a job follow from beside the runs; wrong files are refused here, once for all."""
    given = calibrations_of(request.options)
    named = {name for name, value in request.options.items() if isinstance(value, Path)}
    said = {name: value for name, value in request.options.items() if name not in named}
    said |= {
        "verb": request.verb,
        "code": code_version(PACKAGES),
        "scene": None if request.scene is None else scene_digest(load_scene(request.scene)),
        "regions": None
        if request.regions is None
        else [one.model_dump_json() for one in load_regions(request.regions)],
        "calibrations": {kind: sha256_of(path) for kind, path in given.files.items()},
        "picked": [given.picks, str(given.store), given.without, given.force_registration],
        "out": [str(request.out), request.full],
    }
    return json.dumps(said, sort_keys=True, default=str)


class _Stores:
    """What the stores hold from which calibrations of runs are picked; each store is looked at once."""

    def __init__(self, request: ArchiveRequest) -> None:
        self._given, self._root = calibrations_of(request.options), request.root
        self._is_asked = request.verb != "verify" and self._given.picks and not set(self._given.files) >= set(KINDS)
        self._seen: dict[Path, str] = {}

    def of_run(self, name: str) -> str:
        """Return a hash of what the store of a run holds; nothing where nothing is picked."""
        if not self._is_asked:
            return ""
        try:
            store = self._given.store or store_of_run(read_run(self._root / name))
        except DataError:
            return ""
        if store is not None and store not in self._seen:
            files = sorted(path for path in store.rglob("*") if path.is_file())
            facts = [f"{path} {path.stat().st_size} {path.stat().st_mtime_ns}" for path in files]
            self._seen[store] = hashlib.sha256("\n".join(facts).encode()).hexdigest()
        return "" if store is None else self._seen[store]
