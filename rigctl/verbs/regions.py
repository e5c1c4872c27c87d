"""`rigctl regions`: regions that are drawn on a picture of a run, and found again by markers on the panels."""

import webbrowser
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, Unpack

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import Json, note
from rigctl.errors import DataError
from rigctl.files.choices import Dictionary
from rigctl.verbs.options import FilePath, Part, Result, RunOptions, RunPath, Writes

if TYPE_CHECKING:
    from rigctl.files.regions import RegionsFile
    from rigctl.outlines import FollowedRegion

_S_PER_MINUTE = 60.0

DrawnOn: TypeAlias = Annotated[FilePath, Writes(kind="file", edits="start")]
Followed: TypeAlias = Annotated[FilePath, Writes(kind="file", edits="regions")]


def draw(
    run: RunPath,
    /,
    *,
    out: DrawnOn,
    start: FilePath | None = None,
    port: Annotated[int, Parameter(validator=Number(gte=0, lte=65535))] = 0,
    minutes: Annotated[float, Parameter(validator=Number(gte=0.01))] = 60.0,
    no_browser: bool = False,
    **frames: Unpack[RunOptions],
) -> "WrittenRegions":
    """Draw regions on a picture of a run, on a page in the browser of this machine.

    Printed markers (ArUco 4x4_50) in the picture are stored too, for `rigctl regions find`.

    Example: rigctl regions draw runs/panels --out regions.toml

    Parameters
    ----------
    run : path or Run
        Run folder.
    out : path
        Regions file to write.
    start : path
        Regions file to start with.
    port : int
        Port of the page; 0 for any free port.
    minutes : float
        Time after which the command gives up [min].
    no_browser : bool
        Print the address without opening a browser.
    **frames
        Which frames are read, see `RunOptions`.
    """
    from rigctl.files.regions import Markers
    from rigctl.outlines import search_markers
    from rigctl.web.acts import RegionsPage

    picture = _picture(run, frames)
    drawn = [] if start is None else _read(start).regions
    title = f"draw regions on {Path(run).resolve().name}"
    page = RegionsPage(picture, drawn=drawn, title=title, file=Path(out).name, port=port)
    note(f"draw on {page.address} (it listens to this machine only)")
    if not no_browser:
        webbrowser.open(page.address)
    answer = page.wait(seconds=minutes * _S_PER_MINUTE)
    seen = search_markers(picture, "4x4_50")
    return _written(out, answer.model_copy(update={"markers": Markers(seen=seen) if seen else None}))


def mark(
    run: RunPath,
    regions: FilePath,
    /,
    *,
    out: Followed,
    dictionary: Dictionary = "4x4_50",
    **frames: Unpack[RunOptions],
) -> "WrittenRegions":
    """Add the markers in the picture to a regions file that was drawn on it.

    Example: rigctl regions mark runs/noon regions.toml --out regions.toml

    Parameters
    ----------
    run : path or Run
        Run folder.
    regions : path
        Regions file.
    out : path
        Regions file to write; it may be the same one.
    dictionary : Dictionary
        Family of the printed markers.
    **frames
        Which frames are read, see `RunOptions`.
    """
    from rigctl.files.regions import Markers
    from rigctl.outlines import search_markers

    drawn = _read(regions)
    seen = search_markers(_picture(run, frames), dictionary)
    if not seen:
        advice = "Print them large: 4x4 cells of six pixels at least"
        raise DataError(f"{Path(run)}: no marker of {dictionary} was found. {advice}")
    return _written(out, drawn.model_copy(update={"markers": Markers(dictionary=dictionary, seen=seen)}))


def find(run: RunPath, regions: FilePath, /, *, out: Followed, **frames: Unpack[RunOptions]) -> "FoundRegions":
    """Find regions again by their markers after the camera has moved, and write the new outlines.

    The border that is left out of each region grows by twice the error of the new position.

    Example: rigctl regions find runs/evening regions.toml --out regions-evening.toml

    Parameters
    ----------
    run : path or Run
        Run folder taken after the move.
    regions : path
        Regions file with markers, drawn before the move.
    out : path
        Regions file to write.
    **frames
        Which frames are read, see `RunOptions`.
    """
    from rigctl.files.regions import RegionsFile
    from rigctl.outlines import follow_markers, moved_markers, search_markers

    drawn = _read(regions)
    family = "4x4_50" if drawn.markers is None else drawn.markers.dictionary
    now = search_markers(_picture(run, frames), family)
    followed = tuple(follow_markers(drawn, now))
    file = RegionsFile(regions=[one.region for one in followed], markers=moved_markers(drawn, now))
    written = _written(out, file)
    note(str(written))
    return FoundRegions(path=Path(out), file=file, followed=followed)


@dataclass(frozen=True, kw_only=True)
class WrittenRegions(Result):
    """A regions file that was written."""

    path: Path
    file: "RegionsFile"

    def __str__(self) -> str:
        markers = 0 if self.file.markers is None else len(self.file.markers.seen)
        return f"{self.path}: {len(self.file.regions)} regions, {markers} markers"

    def content(self) -> Iterable[Part]:
        """Return the number of regions and markers that were written."""
        yield str(self)

    def as_json(self) -> dict[str, Json]:
        """Return the regions and the number of markers."""
        markers = 0 if self.file.markers is None else len(self.file.markers.seen)
        return {"path": str(self.path), "regions": [one.name for one in self.file.regions], "markers": markers}


@dataclass(frozen=True, kw_only=True)
class FoundRegions(Result):
    """Regions that were found again, with their shifts."""

    path: Path
    file: "RegionsFile"
    followed: "tuple[FollowedRegion, ...]"

    def content(self) -> Iterable[Part]:
        """Return one row for each region."""
        from rigctl.report.document import Table, text_columns

        titles = ("region", "by markers", "moved by [pixel]", "std error [pixel]", "border left out [pixel]")
        rows = tuple(
            (name, ", ".join(map(str, markers)), f"{shift:.2f}", f"{error:.2f}", str(edge))
            for name, markers, shift, error, edge in self._rows()
        )
        yield Table(columns=text_columns(*titles, left=tuple(range(len(titles)))), rows=rows)

    def as_json(self) -> dict[str, Json]:
        """Return one entry for each region."""
        names = ("region", "markers", "shift_px", "std_error_px", "edge_px")
        return {"regions": [dict(zip(names, row, strict=True)) for row in self._rows()]}

    def _rows(self) -> Iterable[tuple[Any, ...]]:
        for one in self.followed:
            yield one.region.name, one.markers, one.shift_px, one.std_error_px, one.region.edge_px


def _picture(run: RunPath, frames: RunOptions) -> Any:
    from rigctl.outlines import grey_picture
    from rigctl.runs.check import run_to_measure

    return grey_picture(run_to_measure(Path(run), **frames))


def _read(path: FilePath) -> "RegionsFile":
    from rigctl.files.regions import RegionsFile
    from rigctl.files.toml import load

    return load(Path(path), RegionsFile)


def _written(path: FilePath, file: "RegionsFile") -> WrittenRegions:
    from rigctl.base.durable import write_durably
    from rigctl.files.regions import regions_text

    write_durably(Path(path), regions_text(file).encode())
    return WrittenRegions(path=Path(path), file=file)
