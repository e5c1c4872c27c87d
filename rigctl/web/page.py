"""The page over HTTP: its files, the state of a run, its pictures, and a socket that is asked for them."""

import asyncio
import json
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from importlib.resources import files
from typing import Any, Protocol

from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from rigctl.console.json_text import json_text
from rigctl.errors import ConfigError, DataError
from rigctl.version import VERSION
from rigctl.web.connections import Sockets
from rigctl.web.hands import Hands, hand_routes
from rigctl.web.pictures import Picture
from rigctl.web.run_look import Curves, RunRow
from rigctl.web.run_reader import RunReader

_TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".txt": "text/plain"}
_MOST_QUESTION_BYTES = 1000
_PATIENCE_S = 20.0
_POLL_S = 0.05
_HEAD_BYTES = 4
_NOT_UNDERSTOOD, _OTHERS_NEED_ITS_PLACE = 1008, 1013
# A report may hold names from files of others: no script of it runs, and it reaches nothing.
_DOCUMENT_POLICY = (
    "sandbox allow-popups; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'"
)
_LEAST_DOLP_TOP = 1e-3


class Source(Protocol):
    """What a page shows."""

    def rows(self) -> tuple[RunRow, ...] | None:
        """Return the runs of a folder; None where there is one run alone."""

    def reader(self, run: str) -> RunReader | None:
        """Return the run of a name; None where there is none of that name."""

    def document(self, run: str, name: str) -> bytes | None:
        """Return a page that lies beside a run; None where there is none of that name."""


def page_app(source: Source, hands: Hands | None = None) -> Starlette:
    """Return the page.

    Parameters
    ----------
    source : Source
        What it shows.
    hands : Hands or None
        What it may do; None only looks.

    Notes
    -----
    It expects `rigctl.web.access.Guard` before it. Every name in a request is looked up among those that are known;
    none becomes a path.
    """
    page = _Page(source, hands)
    routes = [
        *(Route(path, _file(name)) for path, name in _FILES.items()),
        Route("/api/state", page.state),
        Route("/api/frame/{name}", page.frame),
        Route("/api/document/{run}/{name}", page.document),
        WebSocketRoute("/ws", page.socket),
        *([] if hands is None else hand_routes(hands)),
    ]
    return Starlette(routes=routes)


_FILES = {
    "/": "index.html",
    "/watch.js": "watch.js",
    "/rig.js": "rig.js",
    "/style.css": "style.css",
    "/uPlot.iife.min.js": "uPlot.iife.min.js",
    "/uPlot.min.css": "uPlot.min.css",
}


def _file(name: str) -> Callable[[Request], Response]:
    kind = _TYPES[name[name.rindex(".") :]]
    content = files("rigctl").joinpath("data", "web", name).read_bytes()
    return lambda _: Response(content, media_type=kind)


class _Page:
    """Answers, each made in a thread of its own where it reads from the disk."""

    def __init__(self, source: Source, hands: Hands | None) -> None:
        self._source, self._hands, self._sockets = source, hands, Sockets()

    async def state(self, request: Request) -> Response:
        content = await asyncio.to_thread(self._state, request.query_params)
        if content is None:
            return _not_found()
        told = json_text(content | {"right": _right(request)}, indent=None)
        return Response(told, media_type="application/json")

    async def frame(self, request: Request) -> Response:
        found = await asyncio.to_thread(self._picture, {**request.query_params, "name": request.path_params["name"]})
        if found is None:
            return _not_found()
        sequence, picture = found
        return Response(picture.jpeg, media_type="image/jpeg", headers={"x-sequence": str(sequence)})

    async def document(self, request: Request) -> Response:
        wanted = request.path_params
        content = await asyncio.to_thread(self._source.document, wanted["run"], wanted["name"])
        headers = {"content-security-policy": _DOCUMENT_POLICY}
        return _not_found() if content is None else Response(content, media_type="text/html", headers=headers)

    async def socket(self, socket: WebSocket) -> None:
        """Answer question by question: whoever is slow asks less often and holds up nobody."""
        await socket.accept()
        with suppress(WebSocketDisconnect, TimeoutError, RuntimeError):
            try:
                with self._sockets.place():
                    await self._answers(socket)
            except asyncio.CancelledError:
                await socket.close(_OTHERS_NEED_ITS_PLACE)

    async def _answers(self, socket: WebSocket) -> None:
        while True:
            question = _question(await asyncio.wait_for(socket.receive_text(), _PATIENCE_S * 3))
            if question is None:
                await socket.close(_NOT_UNDERSTOOD)
                return
            self._sockets.has_asked()
            async with asyncio.timeout(_PATIENCE_S):
                await self._answer(socket, question)

    async def _answer(self, socket: WebSocket, question: Mapping[str, Any]) -> None:
        if question.get("want") == "picture":
            await socket.send_bytes(await self._newer_picture(question))
            return
        content = await asyncio.to_thread(self._state, question)
        answer = {"want": "state", "right": _right(socket), **(content or {"error": "there is no such run"})}
        await socket.send_text(json_text(answer, indent=None))

    async def _newer_picture(self, question: Mapping[str, Any]) -> bytes:
        """Return the newest picture behind a head of JSON; only the head where the one that is known is the newest."""
        head: dict[str, Any] = {"name": str(question.get("name", ""))}
        if question.get("of") == "rig" and self._hands is not None:
            head["rig"] = asdict(self._hands.view.look())
        try:
            found = await asyncio.to_thread(self._picture, question)
        except DataError as error:
            return _message(head | {"error": str(error)}, b"")
        if found is None:
            return _message(head | {"missing": True}, b"")
        sequence, picture = found
        head |= {"sequence": sequence, "histogram": picture.histogram, "clipped": picture.clipped}
        return _message(head, b"" if question.get("after") == sequence else picture.jpeg)

    def _state(self, question: Mapping[str, Any]) -> dict[str, Any] | None:
        name = str(question.get("run", ""))
        content: dict[str, Any] = {"rigctl": VERSION, **self._of_hands()}
        rows = self._source.rows()
        if rows is not None and not name:
            return content | {"runs": [asdict(row) for row in rows]}
        reader = self._source.reader(name)
        if reader is None:
            return None
        content |= asdict(reader.look()) | {"calibrations": [asdict(one) for one in reader.calibrations()]}
        try:
            curves = reader.curves()
            key = f"{curves.frames_read}/{curves.frames_there}/{len(curves.time_s)}/{curves.left_out}"
            is_known = question.get("curves") == key
            return content | {"curves": None if is_known else asdict(curves), "curves_key": key}
        except (DataError, ConfigError) as error:
            problems = [*content["problems"], *({str(error)} - set(content["problems"]))]
            return content | {"curves": asdict(Curves()), "curves_key": "none", "problems": problems}

    def _of_hands(self) -> dict[str, Any]:
        if self._hands is None:
            return {"hands": False}
        hands = self._hands
        return {
            "hands": True,
            "title": hands.title,
            "acts": list(hands.acts),
            "rig": asdict(hands.view.look()),
            "sessions": hands.session_names(),
            "drawn": [region.model_dump(mode="json", exclude_none=True) for region in hands.drawn],
            "regions_file": hands.regions_file,
            "is_once": hands.is_once,
        }

    def _picture(self, question: Mapping[str, Any]) -> tuple[int, Picture] | None:
        is_live = question.get("of") == "rig" and self._hands is not None
        reader = self._hands.view if is_live and self._hands else self._source.reader(str(question.get("run", "")))
        name = str(question.get("name", ""))
        sequence = None if reader is None else reader.newest_sequence(name)
        if reader is None or sequence is None:
            return None
        if question.get("after") == sequence:
            return sequence, Picture(jpeg=b"")
        picture = reader.picture(name, zebra=question.get("zebra") not in (False, "0"), dolp_top=_dolp_top(question))
        return None if picture is None else (sequence, picture)


def _dolp_top(question: Mapping[str, Any]) -> float:
    try:
        top = float(question.get("dolp_top", 1.0))
    except (TypeError, ValueError):
        return 1.0
    return top if math.isfinite(top) and _LEAST_DOLP_TOP <= top <= 1.0 else 1.0


def _question(text: str) -> dict[str, Any] | None:
    try:
        found = json.loads(text) if len(text) <= _MOST_QUESTION_BYTES else None
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _message(head: Mapping[str, Any], picture: bytes) -> bytes:
    """Return a picture behind its head: the head's length in 4 bytes, the head in JSON, the file."""
    text = json.dumps(head, allow_nan=False).encode("utf-8")
    return len(text).to_bytes(_HEAD_BYTES, "big") + text + picture


def _right(connection: HTTPConnection) -> str:
    right: str = connection.scope["state"]["right"]
    return right


def _not_found() -> Response:
    return JSONResponse({"error": "there is no such thing"}, status_code=404)
