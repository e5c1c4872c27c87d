"""Verbs over all runs of an archive: done on dask, stored one by one, resumed; one row for each run."""

import hashlib
import json
import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from rigctl.archive.index import facts_of, matching_runs
from rigctl.archive.report import archive_table, write_archive_rows
from rigctl.archive.rows import RegionNumbers, RunRow, Verb, inputs_hash, read_rows, write_rows
from rigctl.base.destination import Origin, results_of
from rigctl.base.durable import sha256_of
from rigctl.calibrations.kinds import KINDS
from rigctl.calibrations.store import NONE
from rigctl.comparison.compare import Comparison
from rigctl.console import EXIT_DATA, EXIT_DISAGREES, EXIT_INCOMPLETE, EXIT_OWN_FAULT, Json, failure_of
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import Region, load_regions
from rigctl.files.scene_file import load_scene
from rigctl.mapped import Engine, Outcome, code_version, held_folder, mapped
from rigctl.measure.diagnose import recalibrated
from rigctl.measure.frames import CalibrationPaths, SelectedCalibrations, store_of_run
from rigctl.measure.measure import Measurement
from rigctl.report.comparison import compared_json, comparison_files
from rigctl.report.files import write_folder
from rigctl.report.prediction import SCHEMA_VERSION
from rigctl.runs.check import run_to_measure
from rigctl.runs.folder import Run, read_run
from rigctl.study import scene_digest
from rigctl.verbs.compare import compare_run
from rigctl.verbs.options import CompareOptions, Part, Result, calibrations_of
from rigctl.verbs.stokes import StokesResult, stokes_of
from rigctl.verbs.verify import verification_of

RUNS_FOLDER = "runs"
FAILED = "failed"
PACKAGES = ("model", "calibration", "rigctl")  #: packages whose code determines the rows
_MOST_RUNS, _ROUNDS = 16, 8  # small runs are processed together to save overhead
_MOST_ROWS = 40  # rows that are printed
_DIGITS = 8  # digits of a hash in the table
_VERIFIED = {"whole": 0, "unfinished": EXIT_INCOMPLETE, "damaged": EXIT_DATA}


@dataclass(frozen=True, kw_only=True)
class ArchiveJob:
    """A verb to be applied to the runs of an archive that fulfil a condition."""

    verb: Verb
    root: Path
    out: Path
    engine: Engine
    where: str | None = None  #: condition as in `rigctl archive find`; None for all runs
    scene: Path | None = None
    regions: Path | None = None
    options: CompareOptions = field(default_factory=CompareOptions)  #: options of the verb for a single run
    full: bool = False  #: write all files of the verb for a single run


@dataclass(frozen=True, kw_only=True)
class RunTask:
    """Runs that a worker processes together: names below the root, and the job."""

    names: tuple[str, ...]
    job: ArchiveJob
    code: str


@dataclass(frozen=True, kw_only=True)
class ArchiveRows(Result):
    """Results of a verb for the runs of an archive."""

    verb: Verb
    out: Path
    rows: tuple[RunRow, ...]  #: one for each run that was tried, in the order of names
    runs: int  #: number of runs that fulfil the condition
    done_before: int  #: number of rows from earlier commands
    outcome: Outcome
    damaged: tuple[str, ...]  #: files of an earlier command that could not be read

    @property
    def verdicts(self) -> Mapping[str, int]:
        """Number of runs by verdict, the most frequent first."""
        return dict(Counter(row.verdict for row in self.rows).most_common())

    @property
    def exit_code(self) -> int:
        """75 if stopped, 5 if a run disagrees, 4 if one failed or is unfit, 75 if one is unfinished; otherwise 0."""
        codes = {row.exit_code for row in self.rows}
        if self.outcome == "stopped":
            return EXIT_INCOMPLETE
        if EXIT_DISAGREES in codes:
            return EXIT_DISAGREES
        return EXIT_DATA if codes - {0, EXIT_INCOMPLETE} else max(codes, default=0)

    def content(self) -> Iterable[Part]:
        """Return the number of runs by verdict, then the rows; of many runs only those that need attention."""
        counted = ", ".join(f"{times} {verdict}" for verdict, times in self.verdicts.items())
        yield f"{self.runs} runs, {self.done_before} of them done before: {counted or 'none matches'}"
        if self.outcome == "stopped":
            yield f"stopped: {len(self.rows)} of {self.runs} runs are done; the same command continues"
        shown = self.rows if len(self.rows) <= _MOST_ROWS else [row for row in self.rows if row.exit_code != 0]
        if shown:
            yield archive_table(shown[:_MOST_ROWS], self.verb)
        if len(shown) > _MOST_ROWS:
            yield f"and {len(shown) - _MOST_ROWS} more"

    def as_json(self) -> dict[str, Json]:
        """Return the rows, and the numbers of runs that match and were done before."""
        return {
            "schema_version": 1,
            "out": str(self.out),
            "outcome": self.outcome,
            "runs": self.runs,
            "done": len(self.rows),
            "done_before": self.done_before,
            "verdicts": self.verdicts,
            "rows": [asdict(row) for row in self.rows],
        }


def run_over_archive(job: ArchiveJob, *, tell: Callable[[int, int], None] = lambda _done, _runs: None) -> ArchiveRows:
    """Do the rest of a job over an archive, write table and page, and return all rows.

    `tell` is called with the number of runs that are done, and the number of all. Raises ConfigError if the archive
    does not exist, a common file is wrong, or dask or a scheduler is missing; DataError if the folder is in use or
    the scheduler is lost (finished runs are kept).
    """
    job = _absolute(job)
    settings = _settings_text(job)
    names = matching_runs(job.root, job.where)
    with held_folder(job.out):
        stores = _Stores(job)
        hashes = {name: inputs_hash(job.root / name, f"{settings}{name}\0{stores.of_run(name)}") for name in names}
        kept, damaged = read_rows(job.out)
        left = [name for name in names if not _is_done(kept.get(hashes[name]))]
        outcome = mapped(
            job.engine,
            rows_of,
            lambda slots: _tasks(left, job, slots),
            lambda _, rows: write_rows(job.out, {hashes[row.run]: row for row in rows}),
            command=f"archive {job.verb}",
            packages=PACKAGES,
            size=lambda task: len(task.names),
            parts=lambda task: tuple(replace(task, names=(name,)) for name in task.names),
            lost=_lost,
            done=len(names) - len(left),
            total=len(names),
            tell=tell,
        )
        rows, _ = read_rows(job.out)
        found = ArchiveRows(
            verb=job.verb,
            out=job.out,
            rows=tuple(rows[hashes[name]] for name in names if hashes[name] in rows),
            runs=len(names),
            done_before=len(names) - len(left),
            outcome=outcome,
            damaged=damaged,
        )
        # The command has refused other people's files there, so this is an earlier table.
        with results_of(Origin(command=f"archive {job.verb}", digest=""), force=True):
            write_archive_rows(found.rows, job.verb, job.out, runs=found.runs, alpha=job.options.get("alpha", 1e-3))
    return found


def _is_done(row: RunRow | None) -> bool:
    """Return whether a row is final; runs that failed by a fault of program or machine are tried again."""
    return row is not None and row.exit_code != EXIT_OWN_FAULT


def _tasks(names: Sequence[str], job: ArchiveJob, slots: int) -> Iterator[RunTask]:
    most = max(1, min(_MOST_RUNS, math.ceil(len(names) / (slots * _ROUNDS))))
    for first in range(0, len(names), most):
        yield RunTask(names=tuple(names[first : first + most]), job=job, code=code_version(PACKAGES))


def _lost(task: RunTask, reason: str) -> tuple[RunRow, ...]:
    return tuple(RunRow(run=name, exit_code=EXIT_OWN_FAULT, verdict=FAILED, reason=reason) for name in task.names)


def _absolute(job: ArchiveJob) -> ArchiveJob:
    """Return a job with absolute paths; raise ConfigError if a calibration is missing."""
    for path in calibrations_of(job.options).files.values():
        if not path.is_file():
            raise ConfigError(f"{path}: there is no such calibration")
    options: Any = {
        name: value.absolute() if isinstance(value, Path) and value != NONE else value
        for name, value in job.options.items()
    }
    return replace(
        job,
        root=job.root.absolute(),
        out=job.out.absolute(),
        scene=None if job.scene is None else job.scene.absolute(),
        regions=None if job.regions is None else job.regions.absolute(),
        options=options,
    )


def _settings_text(job: ArchiveJob) -> str:
    """Return a text on which the rows depend besides the runs; wrong files are refused here, once for all runs."""
    given = calibrations_of(job.options)
    settings: dict[str, Any] = {name: one for name, one in job.options.items() if not isinstance(one, Path)}
    settings |= {
        "verb": job.verb,
        "code": code_version(PACKAGES),
        "scene": None if job.scene is None else scene_digest(load_scene(job.scene)),
        "regions": None if job.regions is None else [one.model_dump_json() for one in load_regions(job.regions)],
        "calibrations": {kind: path if path == NONE else sha256_of(path) for kind, path in given.named.items()},
        "selected": [given.uses_store, str(given.store), given.force_registration],
        "out": [str(job.out), job.full],
    }
    return json.dumps(settings, sort_keys=True, default=str)


class _Stores:
    """The stores of calibrations of runs; each is read once."""

    def __init__(self, job: ArchiveJob) -> None:
        self._given, self._root = calibrations_of(job.options), job.root
        self._is_asked = job.verb != "verify" and self._given.uses_store and not set(self._given.files) >= set(KINDS)
        self._seen: dict[Path, str] = {}

    def of_run(self, name: str) -> str:
        """Return a hash of the content of a run's store; empty if nothing is selected from it."""
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


# Work on a single run: the function of the verb, and the row of its result.


def rows_of(task: RunTask) -> tuple[RunRow, ...]:
    """Return the rows of runs, on a worker; a run that fails is a row with its reason.

    Raises ConfigError if the worker has another version of the program than the client.
    """
    if task.code != code_version(PACKAGES):
        raise ConfigError(f"a worker has rigctl {code_version(PACKAGES)}, the client {task.code}: install the same")
    return tuple(_row(name, task.job) for name in task.names)


def _row(name: str, job: ArchiveJob) -> RunRow:
    run, start_s = job.root / name, time.perf_counter()
    try:
        with results_of(Origin(command=f"archive {job.verb}", digest=""), force=True):
            made = _WORK[job.verb](name, run, job)
    except Exception as error:
        code, text = failure_of(error)
        made = RunRow(run=name, exit_code=code, verdict=FAILED, reason=text)
    facts = facts_of(run)
    utc, zenith = facts.get("utc"), facts.get("sun_zenith")
    return replace(
        made,
        reason=" ".join(made.reason.split()),
        utc=utc if isinstance(utc, str) else "",
        sun_zenith=zenith if isinstance(zenith, float) else None,
        seconds=time.perf_counter() - start_s,
    )


def _compared(name: str, run: Path, job: ArchiveJob) -> RunRow:
    comparison = compare_run(run, scene=job.scene, regions=job.regions, **job.options)
    files = comparison_files(comparison) if job.full else {"comparison.json": compared_json(comparison)}
    write_folder(_own_folder(name, job), files)
    if comparison.agrees is None:
        reasons = tuple(dict.fromkeys(one.reason for one in comparison.regions.values() if one.reason))
    else:
        reasons = comparison.points_to if comparison.agrees is False else ()
    return RunRow(
        run=name,
        exit_code={True: 0, False: EXIT_DISAGREES, None: EXIT_DATA}[comparison.agrees],
        verdict=comparison.verdict,
        reason="; ".join(reasons),
        calibrations=_calibrations_text(comparison.run.calibrations.selected),
        regions=_compared_regions(comparison),
    )


def _compared_regions(comparison: Comparison) -> tuple[RegionNumbers, ...]:
    means = {(row.region, row.quantity): row for row in comparison.rows if row.statistic == "mean"}
    found = []
    for region in _measured_regions(comparison.measurement):
        row, judged = means.get((region.region, "dolp")), comparison.regions.get(region.region)
        found.append(
            replace(
                region,
                verdict="" if judged is None else judged.verdict,
                dolp_predicted=None if row is None else row.predicted,
                dolp_z=None if row is None else row.z,
            )
        )
    return tuple(found)


def _measured_regions(measurement: Measurement) -> tuple[RegionNumbers, ...]:
    found = []
    for name, region in measurement.regions.items():
        dolp = region.quantities.get("dolp", {}).get("mean")
        aolp = region.quantities.get("aolp_deg", {}).get("mean")
        found.append(
            RegionNumbers(
                region=name,
                dolp=None if dolp is None else dolp.value,
                dolp_sigma=None if dolp is None else dolp.std_error,
                aolp_deg=None if aolp is None else aolp.value,
                aolp_sigma_deg=None if aolp is None else aolp.std_error,
            )
        )
    return tuple(found)


def _measured(name: str, run: Path, job: ArchiveJob) -> RunRow:
    found = stokes_of(_used(run, job), _regions(job), calibrations_of(job.options), correct=_correct(job))
    if job.full:
        found.write(_own_folder(name, job))
    return _stokes_row(name, found)


def _stokes_row(name: str, found: StokesResult) -> RunRow:
    flagged = tuple(check.name for check in found.checks if check.verdict == "flagged")
    return RunRow(
        run=name,
        exit_code=EXIT_DATA if found.refused else 0,
        verdict="refused" if found.refused else "flagged" if flagged else "sound",
        reason="; ".join(found.refused or dict.fromkeys(flagged)),
        calibrations=_calibrations_text(found.selected),
        regions=_measured_regions(found.measurement),
    )


def _recalibrated(name: str, run: Path, job: ArchiveJob) -> RunRow:
    """Measure a run without calibrations, and with those that are given or selected today."""
    taken = _used(run, job)
    before = stokes_of(taken, _regions(job), CalibrationPaths())
    today, selected = recalibrated(taken, calibrations_of(job.options))
    paths = replace(selected.paths, uses_store=False, store=None)
    found = stokes_of(today, _regions(job), paths, correct=_correct(job))
    if job.full:
        found.write(_own_folder(name, job))
    else:
        numbers = {"schema_version": SCHEMA_VERSION, **found.as_json(), **selected.as_json()}
        write_folder(_own_folder(name, job), {"stokes.json": numbers})
    row = _stokes_row(name, found)
    old = {region.region: region for region in _measured_regions(before.measurement)}
    changed = tuple(
        region
        if region.region not in old
        else replace(region, dolp_before=old[region.region].dolp, aolp_before_deg=old[region.region].aolp_deg)
        for region in row.regions
    )
    return replace(row, calibrations=_calibrations_text(selected), regions=changed)


def _verified(name: str, run: Path, _: ArchiveJob) -> RunRow:
    found = verification_of(run)
    texts = [*(f"{one.file}: {one.problem}" for one in found.bad), *(found.gaps if found.state != "whole" else ())]
    return RunRow(run=name, exit_code=_VERIFIED[found.state], verdict=found.state, reason=texts[0] if texts else "")


_WORK: Mapping[Verb, Callable[[str, Path, ArchiveJob], RunRow]] = {
    "compare": _compared,
    "stokes": _measured,
    "verify": _verified,
    "recalibrate": _recalibrated,
}


def _own_folder(name: str, job: ArchiveJob) -> Path:
    return job.out / RUNS_FOLDER / name


def _used(run: Path, job: ArchiveJob) -> Run:
    return run_to_measure(run, ignore_exclusions=job.options.get("ignore_exclusions", False))


def _correct(job: ArchiveJob) -> tuple[str, ...]:
    return tuple(job.options.get("correct", ()))


def _regions(job: ArchiveJob) -> list[Region]:
    if job.regions is not None:
        return load_regions(job.regions)
    return [] if job.scene is None else list(load_scene(job.scene).regions)


def _calibrations_text(selected: SelectedCalibrations | None) -> str:
    """Return the calibrations of a row: kind, file and the first digits of its hash."""
    files = {} if selected is None else selected.paths.files
    return "; ".join(f"{kind} {path.name} {sha256_of(path)[:_DIGITS]}" for kind, path in files.items())
