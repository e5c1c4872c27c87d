"""``rigctl regions``: regions drawn on a picture, and found again by markers on the panels."""

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.terminal import print_json, progress, results
from rigctl.files.choices import Dictionary
from rigctl.reports.table import Table, text_columns
from rigctl.reports.writers.terminal_table import terminal_table

if TYPE_CHECKING:
    from rigctl.files.regions import RegionsFile

_HELP = """Draw regions on a picture of a run, and find them again by markers.

Example: rigctl regions draw runs/panels --out regions.toml
"""

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None, help=_HELP)

_S_PER_MINUTE = 60.0

RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")]
Given = Annotated[Path, typer.Argument(metavar="REGIONS.toml", help="Regions file.")]
Out = Annotated[Path, typer.Option(metavar="FILE", help="Regions file to write.")]
Family = Annotated[Dictionary, typer.Option(help="Family of the printed markers.")]


@app.command()
def draw(
    run: RunFolder,
    out: Out,
    start: Annotated[Path | None, typer.Option(metavar="FILE", help="Begin with the regions of this file.")] = None,
    port: Annotated[int, typer.Option(metavar="N", help="Port of the page; 0 for any.", min=0, max=65535)] = 0,
    minutes: Annotated[float, typer.Option(metavar="MIN", help="How long to wait for you.", min=0.01)] = 60.0,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
) -> None:
    """Draw regions on a picture of a run, in the page of `rigctl serve`, which this machine serves to itself.

    Markers of the family 4x4_50 that the picture shows are written down too: `rigctl regions find` follows them.

    Example: rigctl regions draw runs/panels --out regions.toml
    """
    from rigctl.jobs.regions import DrawRequest, draw_regions

    def opened(address: str) -> None:
        progress().print(f"draw on {address} (it listens to this machine only)", markup=False)
        if browser:
            webbrowser.open(address)

    request = DrawRequest(start=start, port=port, wait_s=minutes * _S_PER_MINUTE)
    _tell(out, draw_regions(run, request, out=out, opened=opened))


@app.command()
def mark(run: RunFolder, regions: Given, out: Out, dictionary: Family = Dictionary.FOUR_50) -> None:
    """Write down where the markers are in the picture that the regions were drawn on.

    Example: rigctl regions mark runs/noon regions.toml --out regions.toml
    """
    from rigctl.jobs.regions import mark_regions

    _tell(out, mark_regions(run, regions, dictionary=dictionary, out=out))


@app.command()
def find(
    run: RunFolder,
    regions: Given,
    out: Out,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Find regions again by their markers, after the camera has moved, and write them where they are now.

    Each outline grows its left-out border by twice the error that the markers leave.

    Example: rigctl regions find runs/evening regions.toml --out regions-evening.toml
    """
    from rigctl.jobs.regions import find_regions

    found = find_regions(run, regions, out=out)
    _tell(out, found.file)
    rows = [
        (one.region.name, one.markers, one.shift_px, one.std_error_px, one.region.edge_px) for one in found.followed
    ]
    names = ("region", "markers", "shift_px", "std_error_px", "edge_px")
    if as_json:
        print_json({"regions": [dict(zip(names, row, strict=True)) for row in rows]})
        return
    columns = text_columns(
        "region", "by markers", "moved by [pixel]", "std error [pixel]", "border left out [pixel]", left=(0, 1, 2, 3, 4)
    )
    texts = tuple(
        (name, ", ".join(map(str, markers)), f"{shift:.2f}", f"{error:.2f}", str(edge))
        for name, markers, shift, error, edge in rows
    )
    results().print(terminal_table(Table(columns=columns, rows=texts)))


def _tell(path: Path, file: "RegionsFile") -> None:
    markers = 0 if file.markers is None else len(file.markers.seen)
    progress().print(f"{path}: {len(file.regions)} regions, {markers} markers", markup=False)
