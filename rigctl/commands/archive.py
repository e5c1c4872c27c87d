"""``rigctl archive``: an index of many runs, and questions to it."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.commands import archive_runs
from rigctl.console.terminal import print_json, print_json_list, progress, results

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Index an archive of runs, find runs in it, do a job over all of them, and see how the rig fared.\n\n"
    "Example: rigctl archive index runs",
)
for _command in (archive_runs.compare, archive_runs.stokes, archive_runs.verify, archive_runs.recalibrate):
    app.command()(_command)

_Root = Annotated[Path, typer.Argument(metavar="ROOT", help="Folder with runs at any depth below it.")]
_Json = Annotated[bool, typer.Option("--json", help="Answer in JSON.")]


@app.command()
def index(root: _Root, as_json: _Json = False) -> None:
    """Make or update the index, ROOT/.rigctl-index.sqlite: of each run time, sun, devices, state, verdict, regions.

    Run folders remain the truth, and are not changed: the index can be removed and made anew. Only runs that changed
    are read again. Verdicts and regions come from the comparison.json files that lie below ROOT, the newest of a run.

    Example: rigctl archive index runs
    """
    from dataclasses import asdict

    from rigctl.jobs.archive import index_archive

    found = index_archive(root)
    if as_json:
        print_json({"schema_version": 1, **asdict(found)})
        return
    results().print(
        f"{found.runs} runs: {found.new} new, {found.changed} changed, {found.gone} gone, {found.damaged} damaged; "
        f"{found.comparisons} comparisons"
    )


@app.command("find")
def find_command(
    root: _Root,
    expression: Annotated[str, typer.Argument(metavar="EXPR", help="Comparisons joined by and, or, not.")],
    as_csv: Annotated[bool, typer.Option("--csv", help="Answer in CSV, all columns.")] = False,
    as_json: _Json = False,
) -> None:
    """Print the runs and regions of which an expression holds.

    < <= > >= = != compare a column with a number or a text in quotes; and, or, not and brackets join. Columns are in
    docs/how-to/archives.md. A run without a comparison has no region, and no comparison of a region holds of it.

    Example: rigctl archive find runs "sun_zenith < 40 and region = 'asphalt' and verdict = 'disagree'"
    """
    from rigctl.archive.report import found_table
    from rigctl.errors import ConfigError
    from rigctl.jobs.archive import find_runs
    from rigctl.report.data_files import csv_rows
    from rigctl.report.table import terminal_table

    if as_csv and as_json:
        raise ConfigError("--csv and --json: give one of them")
    found = find_runs(root, expression)
    if as_json:
        print_json_list(found.rows)
    elif as_csv:
        typer.echo(csv_rows(found_table(found.rows)).decode(), nl=False)
    else:
        results().print(terminal_table(found_table(found.rows)))
        progress().print(f"{len(found.rows)} rows of {len(found.runs)} runs")


@app.command()
def health(root: _Root, as_json: _Json = False) -> None:
    """Print how the rig fared from run to run: stage, lost frames, dark level, gain, axis, clock; what changed when.

    The runs themselves are read, not the index; of each one dark frame is opened. A number far off those of the other
    runs of its device is named.

    Example: rigctl archive health runs
    """
    from rigctl.archive.report import health_table
    from rigctl.jobs.archive import archive_health
    from rigctl.report.table import terminal_table

    found = archive_health(root)
    if as_json:
        print_json(found.as_json())
        return
    console = results()
    console.print(terminal_table(health_table(found.runs)))
    for change in found.changes:
        console.print(
            f"{change.utc[:16]}Z  {change.run}: {change.what}: {change.before} -> {change.after}", markup=False
        )
    for one in found.outlying:
        console.print(f"stands out: {one.run}: {one.what} = {one.value:.6g}, usually {one.usual:.6g}", markup=False)
    for name, problem in found.unread.items():
        console.print(f"not read: {name}: {problem}", markup=False)
