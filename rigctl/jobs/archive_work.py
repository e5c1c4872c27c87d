"""What a worker does with runs of an archive: the job of a single run, and the row that comes of it."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from rigctl.archive.index import facts_of
from rigctl.archive.over_runs import RegionNumbers, RunRow, Verb
from rigctl.base.destination import Origin, results_of
from rigctl.base.durable import sha256_of
from rigctl.compare.compare import Comparison
from rigctl.console.failures import EXIT_DATA, EXIT_DISAGREES, EXIT_INCOMPLETE, failure_of
from rigctl.errors import ConfigError
from rigctl.files.regions import Region, load_regions
from rigctl.files.scene_file import load_scene
from rigctl.mapped import Engine, code_version
from rigctl.measure.calibrations import CalibrationPaths, PickedCalibrations
from rigctl.measure.diagnose import recalibrated
from rigctl.measure.measure import Measurement
from rigctl.report.comparison import write_comparison, write_comparison_numbers
from rigctl.report.data_files import json_file
from rigctl.report.numbers import SCHEMA_VERSION
from rigctl.report.output import write_folder
from rigctl.runs.check import used_run
from rigctl.runs.folder import Run
from rigctl.verbs.compare import compare_run
from rigctl.verbs.options import CompareOptions, calibrations_of
from rigctl.verbs.stokes import StokesResult, stokes_of
from rigctl.verbs.verify import verification_of

RUNS_FOLDER = "runs"
FAILED = "failed"
# Of what the rows hang on.
PACKAGES = ("model", "calibration", "rigctl")
_TOLD_DIGITS = 8
_VERIFIED = {"whole": 0, "unfinished": EXIT_INCOMPLETE, "damaged": EXIT_DATA}


@dataclass(frozen=True, kw_only=True)
class ArchiveRequest:
    """A job that is to be done on every run of an archive that matches.

    Attributes
    ----------
    verb : {"compare", "stokes", "verify", "recalibrate"}
        The job.
    root, out : Path
        The archive, and the folder of the results.
    engine : Engine
        Where it is done.
    where : str or None
        Expression as of `rigctl archive find`; None is every run.
    scene, regions : Path or None
        Files, as far as the job takes them.
    options : CompareOptions
        Calibrations and all else, as the verb of a single run takes them.
    full : bool
        Write for each run all that the command of a single run writes.
    """

    verb: Verb
    root: Path
    out: Path
    engine: Engine
    where: str | None = None
    scene: Path | None = None
    regions: Path | None = None
    options: CompareOptions = field(default_factory=CompareOptions)
    full: bool = False


@dataclass(frozen=True, kw_only=True)
class RunTask:
    """Runs that one worker does together: their names below the root, and all that is asked of them."""

    names: tuple[str, ...]
    request: ArchiveRequest
    code: str


def rows_of(task: RunTask) -> tuple[RunRow, ...]:
    """Return the rows of runs; one that fails is told, and ends no other.

    Raises
    ------
    ConfigError
        This program is of another version than the client.
    """
    if task.code != code_version(PACKAGES):
        raise ConfigError(f"a worker has rigctl {code_version(PACKAGES)}, the client {task.code}: install the same")
    return tuple(_row(name, task.request) for name in task.names)


def _row(name: str, request: ArchiveRequest) -> RunRow:
    run, start_s = request.root / name, time.perf_counter()
    try:
        with results_of(Origin(command=f"archive {request.verb}", digest=""), force=True):
            made = _WORK[request.verb](name, run, request)
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


def _of_comparison(name: str, run: Path, request: ArchiveRequest) -> RunRow:
    out = _own_folder(name, request)
    comparison = compare_run(run, scene=request.scene, regions=request.regions, **request.options)
    (write_comparison if request.full else write_comparison_numbers)(comparison, out)
    if comparison.agrees is None:
        reasons = tuple(dict.fromkeys(one.reason for one in comparison.regions.values() if one.reason))
    else:
        reasons = comparison.diagnosis.points_to if comparison.agrees is False else ()
    return RunRow(
        run=name,
        exit_code={True: 0, False: EXIT_DISAGREES, None: EXIT_DATA}[comparison.agrees],
        verdict=comparison.verdict,
        reason="; ".join(reasons),
        calibrations=_told(comparison.picked),
        regions=_compared_regions(comparison, comparison.measurement),
    )


def _compared_regions(comparison: Comparison, measurement: Measurement) -> tuple[RegionNumbers, ...]:
    means = {(row.region, row.quantity): row for row in comparison.rows if row.statistic == "mean"}
    found = []
    for region in _measured_regions(measurement):
        row = means.get((region.region, "dolp"))
        judged = comparison.regions.get(region.region)
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


def _of_stokes(name: str, run: Path, request: ArchiveRequest) -> RunRow:
    found = _stokes(used_run(run), request, calibrations_of(request.options))
    if request.full:
        found.write(_own_folder(name, request))
    return _stokes_row(name, found)


def _stokes(run: Run, request: ArchiveRequest, paths: CalibrationPaths) -> StokesResult:
    return stokes_of(run, _regions(request), paths, correct=tuple(request.options.get("correct", ())))


def _stokes_row(name: str, found: StokesResult) -> RunRow:
    flagged = tuple(check.name for check in found.checks if check.verdict == "flagged")
    return RunRow(
        run=name,
        exit_code=EXIT_DATA if found.refused else 0,
        verdict="refused" if found.refused else "flagged" if flagged else "sound",
        reason="; ".join(found.refused or dict.fromkeys(flagged)),
        calibrations=_told(found.picked),
        regions=_measured_regions(found.measurement),
    )


def _of_recalibration(name: str, run: Path, request: ArchiveRequest) -> RunRow:
    """Measure a run with no calibration of any file, and with those that are named or picked today."""
    taken = used_run(run)
    before = stokes_of(taken, _regions(request), CalibrationPaths())
    today, picked = recalibrated(taken, calibrations_of(request.options))
    paths = replace(picked.paths, picks=False, store=None)
    found = _stokes(today, request, paths)
    if request.full:
        found.write(_own_folder(name, request))
    else:
        numbers = {"schema_version": SCHEMA_VERSION, **found.as_json(), **picked.as_json()}
        write_folder(_own_folder(name, request), {"stokes.json": json_file(numbers)})
    row = _stokes_row(name, found)
    old = {region.region: region for region in _measured_regions(before.measurement)}
    changed = tuple(
        region
        if region.region not in old
        else replace(region, dolp_before=old[region.region].dolp, aolp_before_deg=old[region.region].aolp_deg)
        for region in row.regions
    )
    return replace(row, calibrations=_told(picked), regions=changed)


def _of_verification(name: str, run: Path, _: ArchiveRequest) -> RunRow:
    found = verification_of(run)
    said = [*(f"{one.file}: {one.problem}" for one in found.bad), *(found.gaps if found.state != "whole" else ())]
    return RunRow(run=name, exit_code=_VERIFIED[found.state], verdict=found.state, reason=said[0] if said else "")


_WORK: dict[Verb, Callable[[str, Path, ArchiveRequest], RunRow]] = {
    "compare": _of_comparison,
    "stokes": _of_stokes,
    "verify": _of_verification,
    "recalibrate": _of_recalibration,
}


def _own_folder(name: str, request: ArchiveRequest) -> Path:
    return request.out / RUNS_FOLDER / name


def _regions(request: ArchiveRequest) -> list[Region]:
    if request.regions is not None:
        return load_regions(request.regions)
    return [] if request.scene is None else list(load_scene(request.scene).regions)


def _told(picked: PickedCalibrations | None) -> str:
    """Return the calibrations of a row: kind, file and the beginning of its hash."""
    files = {} if picked is None else picked.paths.files
    return "; ".join(f"{kind} {path.name} {sha256_of(path)[:_TOLD_DIGITS]}" for kind, path in files.items())
