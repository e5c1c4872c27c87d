"""Drawing regions on a picture of a run, and finding them again by markers."""

import queue
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.errors import DataError
from rigctl.files.choices import Dictionary
from rigctl.files.config import describe, load
from rigctl.files.regions import Markers, Region, RegionsFile, regions_text
from rigctl.outlines.follow import FollowedRegion, follow_markers, moved_markers
from rigctl.outlines.markers import grey_picture, search_markers
from rigctl.runs.wholeness import used_run
from rigctl.storage.durable_file import write_durably
from rigctl.web.hands import Hands, region_acts
from rigctl.web.page import page_app
from rigctl.web.server import PageServer, Place
from rigctl.web.sources import NoRuns
from rigctl.web.still_picture import StillPicture


@dataclass(frozen=True, kw_only=True)
class DrawRequest:
    """A request to draw regions.

    Attributes
    ----------
    start : Path or None
        Regions file to begin with.
    port : int
        Of the page; 0 for any that is free.
    wait_s : float
        How long to wait for the person who draws [s].
    """

    start: Path | None = None
    port: int = 0
    wait_s: float = 3600.0


@dataclass(frozen=True, kw_only=True)
class FoundRegions:
    """Regions that were found again, each with how far it went, and the file that was written of them."""

    followed: tuple[FollowedRegion, ...]
    file: RegionsFile


def draw_regions(run: Path, request: DrawRequest, *, out: Path, opened: Callable[[str], None]) -> RegionsFile:
    """Return regions that a person drew on a picture of a run, with the markers that it shows.

    Parameters
    ----------
    run : Path
        Run folder.
    request : DrawRequest
        How.
    out : Path
        Regions file to write.
    opened : callable
        Told the address of the page, which only this machine can open.

    Raises
    ------
    DataError
        The run gives no picture, or nothing was drawn in time.
    """
    picture = grey_picture(used_run(run, ignore_exclusions=are_exclusions_ignored()))
    drawn = [] if request.start is None else _read(request.start).regions
    page = RegionsPage(
        picture, drawn=drawn, title=f"draw regions on {run.resolve().name}", file=out.name, port=request.port
    )
    opened(page.address)
    answer = page.wait(seconds=request.wait_s)
    seen = search_markers(picture, Dictionary.FOUR_50)
    return _written(out, answer.model_copy(update={"markers": Markers(seen=seen) if seen else None}))


class RegionsPage:
    """The page of `rigctl serve` at a picture alone, on this machine, until regions are sent.

    Parameters
    ----------
    picture : (H, W) array of uint8
        To draw on.
    drawn : list of Region
        Regions that are there already.
    title : str
        Heading of the page.
    file : str
        Name of the file that the regions are for.
    port : int
        0 for any that is free.

    Raises
    ------
    ConfigError
        The port is taken.
    """

    def __init__(
        self, picture: NDArray[np.uint8], *, drawn: list[Region], title: str, file: str, port: int = 0
    ) -> None:
        self._file, self._sent = file, queue.SimpleQueue[RegionsFile]()
        hands = Hands(
            view=StillPicture(picture),
            acts=region_acts(self._take),
            title=title,
            drawn=tuple(drawn),
            regions_file=file,
            is_once=True,
        )
        self._server = PageServer(page_app(NoRuns(), hands), Place(port=port), can_act=True)

    @property
    def address(self) -> str:
        """Where the page is."""
        return self._server.addresses.act_url or ""

    def wait(self, *, seconds: float) -> RegionsFile:
        """Return the regions that were drawn.

        Raises
        ------
        DataError
            Nothing was sent in time.
        """
        with self._server:
            try:
                return self._sent.get(timeout=seconds)
            except queue.Empty:
                minutes = seconds / 60.0
                raise DataError(f"no regions were sent from {self.address} within {minutes:g} minutes") from None

    def _take(self, body: bytes) -> str:
        self._sent.put(sent_regions(body))
        return self._file


def sent_regions(body: bytes) -> RegionsFile:
    """Return regions that a page sent as JSON.

    Raises
    ------
    DataError
        They are no regions.
    """
    try:
        return RegionsFile.model_validate_json(body)
    except ValidationError as error:
        raise DataError(describe(Path("regions"), error)) from error


def mark_regions(run: Path, regions: Path, *, dictionary: Dictionary, out: Path) -> RegionsFile:
    """Return regions with the markers of the picture that they were drawn on.

    Parameters
    ----------
    run, regions : Path
        Run folder and regions file.
    dictionary : Dictionary
        Family of the printed markers.
    out : Path
        Regions file to write.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, or no marker is seen.
    """
    drawn = _read(regions)
    seen = search_markers(grey_picture(used_run(run, ignore_exclusions=are_exclusions_ignored())), dictionary)
    if not seen:
        raise DataError(f"{run}: no marker of {dictionary} is seen. Print them large: 4x4 cells of six pixels at least")
    return _written(out, drawn.model_copy(update={"markers": Markers(dictionary=dictionary, seen=seen)}))


def find_regions(run: Path, regions: Path, *, out: Path) -> FoundRegions:
    """Return regions where their markers are now, after the camera has moved.

    Parameters
    ----------
    run, regions : Path
        Run folder of now, and regions file with the markers as they were.
    out : Path
        Regions file to write.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, or a region has lost its markers.
    """
    drawn = _read(regions)
    family = Dictionary.FOUR_50 if drawn.markers is None else drawn.markers.dictionary
    now = search_markers(grey_picture(used_run(run, ignore_exclusions=are_exclusions_ignored())), family)
    followed = tuple(follow_markers(drawn, now))
    file = RegionsFile(regions=[one.region for one in followed], markers=moved_markers(drawn, now))
    return FoundRegions(followed=followed, file=_written(out, file))


def _read(path: Path) -> RegionsFile:
    return load(path, RegionsFile)


def _written(path: Path, file: RegionsFile) -> RegionsFile:
    write_durably(path, regions_text(file).encode())
    return file
