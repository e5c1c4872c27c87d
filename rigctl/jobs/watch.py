"""Watching a run, or the runs of a folder, in a browser."""

from collections.abc import Callable
from pathlib import Path

from rigctl.web.page import page_app
from rigctl.web.server import Addresses, PageServer, Place
from rigctl.web.sources import source_at


def watch(path: Path, place: Place, *, told: Callable[[Addresses], None]) -> None:
    """Serve a page that shows a run as it grows, until Ctrl-C. It reads and never writes.

    Parameters
    ----------
    path : Path
        Run folder, also one that is yet to come, or a folder of run folders.
    place : Place
        Where the page is.
    told : callable
        Told its addresses once it is there.

    Raises
    ------
    ConfigError
        No run can be there, or nothing can listen at that place.
    """
    server = PageServer(page_app(source_at(path)), place, can_act=False)
    told(server.addresses)
    server.run()
