"""A page that shows the newest picture of a camera, for whoever turns the lens."""

import asyncio
import threading
from importlib.resources import files
from typing import Self

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from rigctl.web.server import PageServer, Place

_WAIT_S = 1.0


class PreviewPage:
    """Serves the page until its context is left, to whoever has its address.

    Parameters
    ----------
    place : Place
        Where it is.

    Raises
    ------
    ConfigError
        Nothing can listen there.
    """

    def __init__(self, place: Place) -> None:
        self._changed = threading.Condition()
        self._jpeg, self._text, self._number = b"", "", 0
        page = files("rigctl").joinpath("data", "web")
        self._html, self._script, self._style = (
            page.joinpath(name).read_bytes() for name in ("preview.html", "preview.js", "style.css")
        )
        routes = [
            Route("/", lambda _: Response(self._html, media_type="text/html")),
            Route("/preview.js", lambda _: Response(self._script, media_type="text/javascript")),
            Route("/style.css", lambda _: Response(self._style, media_type="text/css")),
            Route("/picture.jpg", self._picture),
        ]
        self._server = PageServer(Starlette(routes=routes), place, can_act=False)

    def __enter__(self) -> Self:
        self._server.__enter__()
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._server.__exit__(*exc_info)

    @property
    def address(self) -> str:
        """Address to type into the browser."""
        return self._server.addresses.look_url

    def show(self, jpeg: bytes, text: str = "") -> None:
        """Show this picture from now on, and its numbers in words."""
        with self._changed:
            self._jpeg, self._text, self._number = jpeg, text, self._number + 1
            self._changed.notify_all()

    async def _picture(self, request: Request) -> Response:
        """Answer with the newest picture, once it is another than the one that the page has, or a second is over."""
        text = request.query_params.get("after", "0")
        jpeg, told, number = await asyncio.to_thread(self._after, int(text) if text.isdecimal() else 0)
        return Response(jpeg, media_type="image/jpeg", headers={"x-number": str(number), "x-told": told})

    def _after(self, known: int) -> tuple[bytes, str, int]:
        with self._changed:
            self._changed.wait_for(lambda: self._number != known, timeout=_WAIT_S)
            return self._jpeg, self._text, self._number
