"""``rigctl study``: thousands of predictions on the cores of this machine or of a cluster."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.failures import EXIT_INCOMPLETE
from rigctl.console.json_text import Json
from rigctl.console.terminal import print_json, progress, results, warn
from rigctl.errors import ConfigError
from rigctl.report.table import terminal_table

if TYPE_CHECKING:
    from rigctl.jobs.study import StudyRequest, StudyResult

_MS_PER_S = 1000.0
_MOST_REASONS = 5


def command(
    study: Annotated[Path, typer.Argument(metavar="STUDY.toml", help="Study file.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for study.zarr, tables, and what is done so far.")],
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A scheduler of dask, tcp://HOST:8786. Default: this machine.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Processes on this machine. Default: one for each core.")
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option(metavar="T", help="Largest numerical error of every case, 1e-6 to 0.1.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Predict scenes with any of their numbers varied: grids, lists, draws; with Sobol or Morris, which input matters.

    Writes study.zarr, which xarray opens, study.parquet (a row for each case and region), detection.parquet where
    detection is wanted, and sensitivity.csv, .json, .png of kinds sobol and morris.

    What is done is kept as it comes. Ctrl-C stops (exit 75); the same command goes on, and does nothing twice. A case
    that fails is a row with its reason. Cases under one sky are computed together, which saves most of their time.

    Example: rigctl study examples/study-panels.toml --out panels-study --workers 2
    """
    from rigctl.jobs.study import StudyRequest
    from rigctl.mapped import Engine

    if scheduler is not None and workers is not None:
        raise ConfigError("--workers: is of this machine; a scheduler has its own")
    if tolerance is not None and not 1e-6 <= tolerance <= 0.1:
        raise ConfigError(f"--tolerance: is {tolerance:g}, allowed is 1e-6 to 0.1")
    engine = Engine(scheduler=scheduler, workers=workers or os.cpu_count() or 1)
    found = _computed(StudyRequest(study=study, out=out, engine=engine, tolerance=tolerance))
    for text in found.damaged:
        warn(f"{text}; its cases were computed again")
    if as_json:
        print_json(_json(found, out))
    else:
        _show(found, out)
    if found.outcome == "stopped":
        raise typer.Exit(EXIT_INCOMPLETE)


def _computed(request: "StudyRequest") -> "StudyResult":
    from rigctl.jobs.study import run_study
    from rigctl.mapped import count_shown

    with count_shown("cases") as tell:
        return run_study(request, tell=tell)


def _json(found: "StudyResult", out: Path) -> dict[str, Json]:
    return {
        "schema_version": 1,
        "out": str(out),
        "outcome": found.outcome,
        "cases": len(found.table.cases),
        "done_before": found.done_before,
        "failed": found.failed,
        "seconds_of_new_sky": found.seconds_of_new_sky,
        "seconds_of_same_sky": found.seconds_of_same_sky,
        "created_by": found.table.said["created_by"],
    }


def _show(found: "StudyResult", out: Path) -> None:
    from rigctl.study import morris_table, sobol_table

    if found.sobol:
        results().print(terminal_table(sobol_table(found.sobol)))
    if found.morris:
        results().print(terminal_table(morris_table(found.morris)))
    cases = len(found.table.cases)
    for line in _reasons(found):
        warn(line)
    if found.outcome == "stopped":
        progress().print(f"stopped: {cases - found.failed} of {cases} cases are done; the same command goes on")
        return
    results().print(f"{cases} cases, {found.done_before} of them done before, {found.failed} failed; in {out}")
    new, same = (_MS_PER_S * one for one in (found.seconds_of_new_sky, found.seconds_of_same_sky))
    skies = int(found.table.arrays.is_new_sky.sum())
    if skies:
        results().print(
            f"{skies} skies: {new:.3g} ms for a case with its sky, {same:.3g} ms for one under the same sky"
        )


def _reasons(found: "StudyResult") -> list[str]:
    """Return why cases failed, each reason once with how many."""
    from collections import Counter

    from rigctl.study import UNDONE

    counted = Counter(reason for reason in found.table.arrays.reasons if reason and reason != UNDONE)
    told = [f"{times} cases failed: {reason}" for reason, times in counted.most_common(_MOST_REASONS)]
    return told + ([f"and {len(counted) - _MOST_REASONS} other reasons"] if len(counted) > _MOST_REASONS else [])
