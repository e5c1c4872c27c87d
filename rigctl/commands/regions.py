"""``rigctl regions``: regions drawn on a picture, and found again by markers on the panels."""

import webbrowser
from pathlib import Path
from typing import Annotated

import cv2
import typer
from rich.table import Table

from rigctl.choices import Dictionary
from rigctl.config import load
from rigctl.durable_file import write_durably
from rigctl.errors import DataError
from rigctl.files.regions import Markers, RegionsFile
from rigctl.outlines.follow import follow_markers, moved_markers
from rigctl.outlines.markers import search_markers
from rigctl.outlines.picker import Picker
from rigctl.outlines.picture import grey_picture
from rigctl.outlines.regions_text import regions_text
from rigctl.runs.run_folder import read_run
from rigctl.terminal import print_json, progress, results

_HELP = """Draw regions on a picture of a run, and find them again by markers.

Example: rigctl regions draw runs/panels --out regions.toml
"""

app = typer.Typer(no_args_is_help=True, help=_HELP)

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
    """Draw regions on a picture of a run, in a page that this machine serves to itself.

    Markers of the family 4x4_50 that the picture shows are written down too: `rigctl regions find` follows them.

    Example: rigctl regions draw runs/panels --out regions.toml
    """
    picture = grey_picture(read_run(run))
    there = [] if start is None else load(start, RegionsFile).model_dump(mode="json", exclude_none=True)["regions"]
    picker = Picker(cv2.imencode(".png", picture)[1].tobytes(), drawn=there, title=str(run), port=port)
    progress().print(f"draw on {picker.address} (it listens to this machine only)", markup=False)
    if browser:
        webbrowser.open(picker.address)
    drawn = picker.wait(seconds=minutes * _S_PER_MINUTE)
    seen = search_markers(picture, Dictionary.FOUR_50)
    _write(out, drawn.model_copy(update={"markers": Markers(seen=seen) if seen else None}))


@app.command()
def mark(run: RunFolder, regions: Given, out: Out, dictionary: Family = Dictionary.FOUR_50) -> None:
    """Write down where the markers are in the picture that the regions were drawn on.

    Example: rigctl regions mark runs/noon regions.toml --out regions.toml
    """
    drawn = load(regions, RegionsFile)
    seen = search_markers(grey_picture(read_run(run)), dictionary)
    if not seen:
        raise DataError(f"{run}: no marker of {dictionary} is seen. Print them large: 4x4 cells of six pixels at least")
    _write(out, drawn.model_copy(update={"markers": Markers(dictionary=dictionary, seen=seen)}))


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
    drawn = load(regions, RegionsFile)
    family = Dictionary.FOUR_50 if drawn.markers is None else drawn.markers.dictionary
    now = search_markers(grey_picture(read_run(run)), family)
    found = follow_markers(drawn, now)
    _write(out, RegionsFile(regions=[one.region for one in found], markers=moved_markers(drawn, now)))
    rows = [(one.region.name, one.markers, one.shift_px, one.std_error_px, one.region.edge_px) for one in found]
    names = ("region", "markers", "shift_px", "std_error_px", "edge_px")
    if as_json:
        print_json({"regions": [dict(zip(names, row, strict=True)) for row in rows]})
        return
    table = Table("region", "by markers", "moved by [pixel]", "std error [pixel]", "border left out [pixel]")
    for name, markers, shift, error, edge in rows:
        table.add_row(name, ", ".join(map(str, markers)), f"{shift:.2f}", f"{error:.2f}", str(edge))
    results().print(table)


def _write(path: Path, file: RegionsFile) -> None:
    write_durably(path, regions_text(file).encode())
    markers = 0 if file.markers is None else len(file.markers.seen)
    progress().print(f"{path}: {len(file.regions)} regions, {markers} markers", markup=False)
