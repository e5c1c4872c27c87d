"""The page for drawing regions on a picture, and the file that they are written to."""

import queue
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from rigctl.base.destination import replace_keeping
from rigctl.errors import DataError
from rigctl.files.regions import Markers, Region, RegionsFile, regions_text
from rigctl.files.toml import describe
from rigctl.outlines import search_markers, stretched
from rigctl.web.page import Actions, page_app, region_acts
from rigctl.web.rig import StillPicture
from rigctl.web.run_reader import NoRuns
from rigctl.web.server import PageServer, Place


class RegionsPage:
    """The page of `rigctl serve` with one picture, served to this machine until regions are sent."""

    def __init__(
        self, picture: NDArray[np.uint8], *, drawn: list[Region], title: str, file: str, port: int = 0
    ) -> None:
        self._file, self._sent = file, queue.SimpleQueue[RegionsFile]()
        actions = Actions(
            view=StillPicture(picture),
            acts=region_acts(self._take),
            title=title,
            drawn=lambda: drawn,
            regions_file=file,
            is_once=True,
        )
        self._server = PageServer(page_app(NoRuns(), actions), Place(port=port), can_act=True)

    @property
    def address(self) -> str:
        """Where the page is."""
        return self._server.addresses.act_url or ""

    def wait(self, *, seconds: float) -> RegionsFile:
        """Return the regions that were drawn; raise DataError if nothing is sent in time."""
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
    """Return regions that a page sent as JSON."""
    try:
        return RegionsFile.model_validate_json(body)
    except ValidationError as error:
        raise DataError(describe(Path("regions"), error)) from error


def write_regions(file: Path, body: bytes, picture: NDArray[np.uint16] | None) -> str:
    """Write regions that a page sent, with the markers that the picture shows; return the name of the file.

    An existing file is kept as ``.bak``, ``.bak2`` and so on. DataError refuses wrong regions.
    """
    regions = sent_regions(body)
    seen = [] if picture is None else search_markers(stretched(picture), "4x4_50")
    if seen and regions.markers is None:
        regions = regions.model_copy(update={"markers": Markers(seen=seen)})
    replace_keeping(file, regions_text(regions).encode())
    return file.name
