"""A page on this machine on which a person draws regions on a picture."""

import json
import secrets
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, HTTPServer
from importlib.resources import files
from pathlib import Path

from pydantic import ValidationError

from rigctl.errors import DataError
from rigctl.files.config import describe
from rigctl.files.regions import Region, RegionsFile

_MOST_BYTES = 1_000_000
_POLL_S = 0.2


class Picker:
    """Serves the page to this machine alone, under an address that nobody can guess, until regions are sent.

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
    """

    def __init__(self, picture: bytes, *, drawn: list[Region], title: str, port: int = 0) -> None:
        self._token = secrets.token_urlsafe(12)
        page = files("rigctl").joinpath("data/picker.html").read_bytes()
        self._pages: dict[str, tuple[str, bytes]] = {
            "": ("text/html; charset=utf-8", page),
            "picture.png": ("image/png", picture),
            "regions.json": ("application/json", _as_json(title, drawn)),
        }
        self._answer: RegionsFile | None = None
        self._server = HTTPServer(("127.0.0.1", port), self._handler())
        self._server.timeout = _POLL_S

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self._server.server_port}/{self._token}/"

    def wait(self, *, seconds: float, clock_s: Callable[[], float] = time.monotonic) -> RegionsFile:
        """Return the regions that were drawn.

        Raises
        ------
        DataError
            Nothing was sent in time.
        """
        deadline_s = clock_s() + seconds
        try:
            while self._answer is None:
                if clock_s() > deadline_s:
                    raise DataError(f"no regions were sent from {self.address} within {seconds / 60.0:g} minutes")
                self._server.handle_request()
        finally:
            self._server.server_close()
        return self._answer

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        picker = self

        class Handler(BaseHTTPRequestHandler):
            timeout = 5.0

            def do_GET(self) -> None:
                found = picker.page(self.path)
                kind, body = ("text/plain", b"not found") if found is None else found
                self.reply(404 if found is None else 200, kind, body)

            def do_POST(self) -> None:
                size = int(self.headers.get("Content-Length", "0"))
                if picker.page(self.path) is None or not 0 < size <= _MOST_BYTES:
                    self.reply(400, "text/plain", b"not understood")
                    return
                problem = picker.take(self.rfile.read(size))
                self.reply(200 if problem is None else 422, "text/plain; charset=utf-8", (problem or "saved").encode())

            def reply(self, status: int, kind: str, body: bytes) -> None:
                self.send_response(status)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(body)))
                self.send_header("Cache-Control", "no-store")
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the library's name
                """Say nothing: the terminal belongs to the command."""

        return Handler

    def page(self, path: str) -> tuple[str, bytes] | None:
        """Return kind and content of what is asked for; None for an address that is not ours."""
        prefix = f"/{self._token}/"
        return self._pages.get(path.removeprefix(prefix)) if path.startswith(prefix) else None

    def take(self, sent: bytes) -> str | None:
        """Take regions as JSON; return what is wrong with them, or None."""
        try:
            self._answer = RegionsFile.model_validate_json(sent)
        except ValidationError as error:
            return describe(Path("regions"), error)
        return None


def _as_json(title: str, drawn: list[Region]) -> bytes:
    regions = [region.model_dump(mode="json", exclude_none=True) for region in drawn]
    return json.dumps({"title": title, "regions": regions}).encode()
