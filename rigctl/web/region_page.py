"""A page on this machine on which a person draws regions on a picture."""

import asyncio
import json
import threading
import time
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from rigctl.errors import DataError
from rigctl.files.config import describe
from rigctl.files.regions import Region, RegionsFile
from rigctl.web.server import PageServer, Place

_FILES = {"/": "regions.html", "/regions.js": "regions.js", "/regions.css": "regions.css"}
_TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css"}


class RegionPage:
    """Listens on this machine alone, for whoever has its address, until regions are sent.

    Parameters
    ----------
    picture : bytes
        PNG to draw on.
    drawn : list of Region
        Regions that are there already.
    title : str
        What the picture is of.
    port : int
        0 for any that is free.

    Raises
    ------
    ConfigError
        The port is taken.
    """

    def __init__(self, picture: bytes, *, drawn: list[Region], title: str, port: int = 0) -> None:
        self._answered = threading.Event()
        self._answer: RegionsFile | None = None
        contents = {path: _content(name) for path, name in _FILES.items()}
        contents["/picture.png"] = (picture, "image/png")
        contents["/regions.json"] = (_as_json(title, drawn), "application/json")
        routes = [Route(path, _sending(*content)) for path, content in contents.items()]
        app = Starlette(routes=[*routes, Route("/regions", self._take, methods=["POST"])])
        self._server = PageServer(app, Place(port=port), can_act=True)

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
        deadline_s = time.monotonic() + seconds
        with self._server:
            self._answered.wait(timeout=max(0.0, deadline_s - time.monotonic()))
        if self._answer is None:
            raise DataError(f"no regions were sent from {self.address} within {seconds / 60.0:g} minutes")
        return self._answer

    async def _take(self, request: Request) -> Response:
        """Take regions as JSON; say what is wrong with them, or end the wait."""
        sent = await request.body()
        try:
            self._answer = await asyncio.to_thread(RegionsFile.model_validate_json, sent)
        except ValidationError as error:
            return PlainTextResponse(describe(Path("regions"), error), status_code=422)
        self._answered.set()
        return PlainTextResponse("saved")


def _sending(content: bytes, kind: str) -> Callable[[Request], Response]:
    return lambda _: Response(content, media_type=kind)


def _content(name: str) -> tuple[bytes, str]:
    content = files("rigctl").joinpath("data", "web", name).read_bytes()
    return content, _TYPES[name.rpartition(".")[2]]


def _as_json(title: str, drawn: list[Region]) -> bytes:
    regions = [region.model_dump(mode="json", exclude_none=True) for region in drawn]
    return json.dumps({"title": title, "regions": regions}).encode()
