"""``rigctl archive compare|stokes|verify|recalibrate``: the jobs of single runs over a whole archive."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from rigctl.console.options import (
    CalibrationStore,
    Faults,
    FlatFile,
    ForceRegistration,
    PolarizerFile,
    RegistrationFile,
)
from rigctl.console.terminal import print_json, progress, results, warn
from rigctl.errors import ConfigError
from rigctl.files.choices import ScaleKind
from rigctl.report.table import terminal_table

if TYPE_CHECKING:
    from rigctl.archive.over_runs import Verb
    from rigctl.jobs.archive_runs import ArchiveResult
    from rigctl.jobs.archive_work import ArchiveRequest
    from rigctl.verbs.options import CompareOptions

_MOST_SHOWN = 40
_Root = Annotated[Path, typer.Argument(metavar="ROOT", help="Folder with runs at any depth below it.")]
_Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder for table and page, and for what is done so far.")]
_Where = Annotated[
    str | None, typer.Option(metavar="EXPR", help="Runs of which this holds, as in `archive find`. Default: all.")
]
_Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="A scheduler of dask, tcp://HOST:8786. Default: this machine.")
]
_Workers = Annotated[
    int | None, typer.Option(metavar="N", min=1, help="Processes on this machine. Default: one for each core.")
]
_Full = Annotated[
    bool, typer.Option("--full", help="Also write, to DIR/runs/RUN, all that the command of a single run writes.")
]
_Json = Annotated[bool, typer.Option("--json", help="Answer in JSON.")]
_Regions = Annotated[Path | None, typer.Option(metavar="FILE", help="Regions file.")]
_Scene = Annotated[Path | None, typer.Option(metavar="FILE", help="Scene file.")]
_Noise = Annotated[Path | None, typer.Option(metavar="FILE", help="Noise calibration. none: pick none.")]


def compare(
    root: _Root,
    *,
    scene: _Scene = None,
    out: _Out,
    regions: _Regions = None,
    where: _Where = None,
    noise: _Noise = None,
    scale: Annotated[ScaleKind, typer.Option(metavar="KIND", help="As of `rigctl compare`.")] = "absolute",
    radiometric: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Radiometric calibration, for --scale panel.")
    ] = None,
    register: RegistrationFile = None,
    force_registration: ForceRegistration = False,
    polarizer: PolarizerFile = None,
    flat: FlatFile = None,
    correct: Faults = None,
    store: CalibrationStore = None,
    alpha: Annotated[float, typer.Option(metavar="A", help="Chance of a false disagreement, of each run.")] = 1e-3,
    full: _Full = False,
    scheduler: _Scheduler = None,
    workers: _Workers = None,
    as_json: _Json = False,
) -> None:
    """Set every run that matches beside the model, as `rigctl compare` does one; write one table and one page.

    Each run has its own sun and its comparison.json in DIR/runs/RUN; with DIR below ROOT the index has the verdicts.
    A run that is damaged or unfit is a row with its reason. Ctrl-C stops (exit 75); the same command goes on.

    Exit: 0 all agree; 5 a run disagrees; 4 none does, and a run is unfit or cannot be judged; 75 stopped.

    Example: rigctl archive compare runs --scene scene.toml --where "sun_zenith < 60" --out runs/compared
    """
    from rigctl.verbs.compare import require_possible

    options = _options(noise, register, polarizer, flat, store, correct, force_registration=force_registration)
    options |= {"radiometric": radiometric, "alpha": alpha, "scale": scale}
    require_possible(scene, regions, options)
    _do("compare", root, out, options, (scene, regions), where, full, (scheduler, workers), as_json=as_json)


def stokes(
    root: _Root,
    *,
    out: _Out,
    regions: _Regions = None,
    where: _Where = None,
    noise: _Noise = None,
    register: RegistrationFile = None,
    force_registration: ForceRegistration = False,
    polarizer: PolarizerFile = None,
    flat: FlatFile = None,
    correct: Faults = None,
    store: CalibrationStore = None,
    full: _Full = False,
    scheduler: _Scheduler = None,
    workers: _Workers = None,
    as_json: _Json = False,
) -> None:
    """Measure every run that matches, as `rigctl stokes` does one: DoLP and AoLP of the regions, soundness.

    Images are written with --full only. A run that is damaged is a row with its reason. Ctrl-C stops (exit 75); the
    same command goes on, and does no run twice that did not change.

    Exit: 0 all sound; 4 a run is refused or unfit; 75 stopped.

    Example: rigctl archive stokes runs --regions regions.toml --out runs/measured
    """
    options = _options(noise, register, polarizer, flat, store, correct, force_registration=force_registration)
    _do("stokes", root, out, options, (None, regions), where, full, (scheduler, workers), as_json=as_json)


def verify(
    root: _Root,
    *,
    out: _Out,
    where: _Where = None,
    scheduler: _Scheduler = None,
    workers: _Workers = None,
    as_json: _Json = False,
) -> None:
    """Check every checksum of every run that matches, as `rigctl verify` does of one.

    A run is checked again where its journals, or sizes and times of its frames, have changed since; for all of them
    name another DIR.

    Exit: 0 all whole; 4 a run is damaged; 75 none is, and one is unfinished, or the check was stopped.

    Example: rigctl archive verify runs --out checked --workers 2
    """
    _do("verify", root, out, {}, (None, None), where, False, (scheduler, workers), as_json=as_json)


def recalibrate(
    root: _Root,
    *,
    out: _Out,
    regions: _Regions = None,
    scene: _Scene = None,
    where: _Where = None,
    noise: _Noise = None,
    register: RegistrationFile = None,
    force_registration: ForceRegistration = False,
    polarizer: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Polarizer calibration: axis and throughput of each angle. none: pick none."),
    ] = None,
    flat: FlatFile = None,
    store: CalibrationStore = None,
    full: _Full = False,
    scheduler: _Scheduler = None,
    workers: _Workers = None,
    as_json: _Json = False,
) -> None:
    """Measure every run that matches anew, with the calibrations that are named or that the store holds today.

    Beside each number stands what the run gives by itself: with the axis of its rig file and no calibration. Polarizer
    angles are computed again from the stage's by the axis of the polarizer calibration; throughput, flat field,
    registration and dark level are used as in `rigctl stokes`. The runs stay as they are; DIR/runs/RUN/stokes.json has
    the new numbers and the hashes of the calibrations.

    Exit: 0 all sound; 4 a run is refused or unfit; 75 stopped.

    Example: rigctl archive recalibrate runs --regions regions.toml --polarizer polarizer.json --out recalibrated
    """
    if regions is None and scene is None:
        raise ConfigError("give --regions FILE, or --scene FILE for its regions: numbers are of regions")
    options = _options(noise, register, polarizer, flat, store, None, force_registration=force_registration)
    _do("recalibrate", root, out, options, (scene, regions), where, full, (scheduler, workers), as_json=as_json)


def _options(
    noise: Path | None,
    register: Path | None,
    polarizer: Path | None,
    flat: Path | None,
    calibrations: Path | None,
    correct: str | None,
    *,
    force_registration: bool,
) -> "CompareOptions":
    from rigctl.measure.diagnose import correctable

    return {
        "noise": noise,
        "register": register,
        "polarizer": polarizer,
        "flat": flat,
        "calibrations": calibrations,
        "correct": cast(Any, () if correct is None else correctable(correct)),
        "force_registration": force_registration,
    }


def _do(
    verb: "Verb",
    root: Path,
    out: Path,
    options: "CompareOptions",
    files: tuple[Path | None, Path | None],
    where: str | None,
    full: bool,
    engine: tuple[str | None, int | None],
    *,
    as_json: bool,
) -> None:
    from rigctl.jobs.archive_work import ArchiveRequest
    from rigctl.mapped import Engine

    scheduler, workers = engine
    if scheduler is not None and workers is not None:
        raise ConfigError("--workers: is of this machine; a scheduler has its own")
    request = ArchiveRequest(
        verb=verb,
        root=root,
        out=out,
        engine=Engine(scheduler=scheduler, workers=workers or os.cpu_count() or 1),
        where=where,
        scene=files[0],
        regions=files[1],
        options=options,
        full=full,
    )
    found = _with_progress(request)
    for text in found.damaged:
        warn(f"{text}; its runs were done again")
    if as_json:
        print_json(found.as_json(out))
    else:
        _show(found, verb, out)
    if found.exit_code:
        raise typer.Exit(found.exit_code)


def _with_progress(request: "ArchiveRequest") -> "ArchiveResult":
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from rigctl.jobs.archive_runs import run_over_archive

    columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("left"))
    with Progress(*columns, console=progress(), transient=True) as bar:
        task = bar.add_task("", total=None)

        def told(done: int, runs: int) -> None:
            bar.update(task, completed=done, total=runs)

        return run_over_archive(request, tell=told)


def _show(found: "ArchiveResult", verb: "Verb", out: Path) -> None:
    from rigctl.archive.report import archive_table

    console = results()
    # Whole and sound runs of thousands are read in the table; here stands what is not.
    shown = found.rows if len(found.rows) <= _MOST_SHOWN else [row for row in found.rows if row.exit_code != 0]
    if shown:
        console.print(terminal_table(archive_table(shown[:_MOST_SHOWN], verb)))
    if len(shown) > _MOST_SHOWN:
        console.print(f"and {len(shown) - _MOST_SHOWN} more")
    counted = ", ".join(f"{times} {verdict}" for verdict, times in found.verdicts.items())
    console.print(
        f"{found.runs} runs, {found.done_before} of them done before: {counted or 'none matches'}", markup=False
    )
    if found.outcome == "stopped":
        progress().print(f"stopped: {len(found.rows)} of {found.runs} runs are done; the same command goes on")
    console.print(f"table and page: {out / 'archive.csv'}, {out / 'archive.html'}", markup=False)
