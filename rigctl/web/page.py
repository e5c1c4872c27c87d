"""The page: its routes and its socket.

`rigctl.web.server.Guard` checks every request first. A name in a request is looked up among the known names; it never
becomes a path.
"""

import asyncio
import json
import math
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from importlib.resources import files
from typing import Any, Protocol

from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from drivers.errors import DeviceError
from rigctl.console import json_text
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import Region
from rigctl.runs.records import explain_invalid
from rigctl.version import VERSION
from rigctl.web.pictures import Picture
from rigctl.web.rig import LiveLook
from rigctl.web.run_reader import NO_CURVES, Source
from rigctl.web.server import MOST_BODY_BYTES

MOST_SOCKETS = 32
_TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".txt": "text/plain"}
_FILES = {
    "/": "index.html",
    "/watch.js": "watch.js",
    "/rig.js": "rig.js",
    "/style.css": "style.css",
    "/uPlot.iife.min.js": "uPlot.iife.min.js",
    "/uPlot.min.css": "uPlot.min.css",
}
_MOST_QUESTION_BYTES = 1000
_PATIENCE_S = 20.0
_HEAD_BYTES = 4
_NOT_UNDERSTOOD, _OTHERS_NEED_ITS_PLACE = 1008, 1013
# A report may contain names from other people's files, so it may run no script and load nothing.
_DOCUMENT_POLICY = (
    "sandbox allow-popups; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'"
)
_LEAST_DOLP_TOP = 1e-3
# An action on the run of a request, with the body of the request; returns the answer.
Act = Callable[[str, bytes], dict[str, str]]


class View(Protocol):
    """Source of the pictures of a page: the devices, or a still picture."""

    def look(self) -> LiveLook:
        """Return the numbers of the newest picture."""

    def newest_sequence(self, name: str) -> int | None:
        """Return the number of the newest picture of a name; None if there is none."""

    def picture(self, name: str, *, zebra: bool = True, dolp_top: float = 1.0) -> Picture | None:
        """Return the newest picture of a name; None if there is none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Actions:
    """The actions of a page, which shows controls for these only."""

    view: View
    #: Actions by name, such as those of `rigctl.web.acts`.
    acts: Mapping[str, Act]
    title: str = ""  #: Heading of the page; empty for a list of runs.
    session_names: Callable[[], tuple[str, ...]] = tuple  #: Returns the names of the session files.
    drawn: Callable[[], Sequence[Region]] = tuple  #: Returns existing regions.
    regions_file: str = "regions.toml"  #: Name of the file for regions.
    is_once: bool = False  #: The page ends as soon as regions are written.


def page_app(source: Source, actions: Actions | None = None) -> Starlette:
    """Return the page."""
    page = _Page(source, actions)
    routes = [
        *(Route(path, _file(name)) for path, name in _FILES.items()),
        Route("/api/state", page.state),
        Route("/api/frame/{name}", page.frame),
        Route("/api/document/{run}/{name}", page.document),
        WebSocketRoute("/ws", page.socket),
        *(
            Route(f"/api/{name}", _answering(act), methods=["POST"])
            for name, act in ({} if actions is None else actions.acts).items()
        ),
    ]
    return Starlette(routes=routes)


def _answering(act: Act) -> Callable[[Request], Awaitable[Response]]:
    """Return a route that runs an action in a thread of its own and answers errors as text."""

    async def answer(request: Request) -> Response:
        body = await request.body()
        if len(body) > MOST_BODY_BYTES:
            return _problem(413, f"more than {MOST_BODY_BYTES} bytes")
        try:
            return JSONResponse(await asyncio.to_thread(act, request.query_params.get("run", ""), body))
        except ValidationError as error:
            return _problem(422, explain_invalid(error))
        except ConfigError as error:
            return _problem(422, str(error))
        except (DataError, DeviceError, OSError) as error:
            return _problem(409, str(error))

    return answer


def _problem(status: int, text: str) -> Response:
    return JSONResponse({"error": text}, status_code=status)


def _file(name: str) -> Callable[[Request], Response]:
    kind = _TYPES[name[name.rindex(".") :]]
    content = files("rigctl").joinpath("data", "web", name).read_bytes()
    return lambda _: Response(content, media_type=kind)


class _Page:
    """The routes. Answers that read from the disk are made in threads."""

    def __init__(self, source: Source, actions: Actions | None) -> None:
        self._source, self._actions, self._sockets = source, actions, Sockets()
        self._began_ns = time.time_ns()

    async def state(self, request: Request) -> Response:
        content = await asyncio.to_thread(self._state, request.query_params)
        if content is None:
            return _not_found()
        text = json_text(content | {"right": _right(request)}, indent=None)
        return Response(text, media_type="application/json")

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
        """Answer one question after the other, so that a slow browser does not delay others."""
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
        """Return a JSON head and the newest picture, or only the head if the browser has that picture."""
        head: dict[str, Any] = {"name": str(question.get("name", ""))}
        if question.get("of") == "rig" and self._actions is not None:
            head["rig"] = asdict(self._actions.view.look())
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
        content: dict[str, Any] = {"rigctl": VERSION, "began": self._began_ns, **self._of_actions()}
        rows = self._source.rows()
        if rows is not None and not name:
            return content | {"runs": rows}
        reader = self._source.reader(name)
        if reader is None:
            return None
        content |= reader.look() | {"calibrations": reader.calibrations()}
        try:
            curves = reader.curves()
            key = "{frames_read}/{frames_there}/{cycles}/{left_out}".format(cycles=len(curves["time_s"]), **curves)
            is_known = question.get("curves") == key
            return content | {"curves": None if is_known else curves, "curves_key": key}
        except (DataError, ConfigError) as error:
            problems = [*content["problems"], *({str(error)} - set(content["problems"]))]
            return content | {"curves": NO_CURVES, "curves_key": "none", "problems": problems}

    def _of_actions(self) -> dict[str, Any]:
        if self._actions is None:
            return {"actions": False}
        actions = self._actions
        return {
            "actions": True,
            "title": actions.title,
            "acts": list(actions.acts),
            "rig": asdict(actions.view.look()),
            "sessions": actions.session_names(),
            "drawn": [region.model_dump(mode="json", exclude_none=True) for region in actions.drawn()],
            "regions_file": actions.regions_file,
            "is_once": actions.is_once,
        }

    def _picture(self, question: Mapping[str, Any]) -> tuple[int, Picture] | None:
        is_live = question.get("of") == "rig" and self._actions is not None
        reader = self._actions.view if is_live and self._actions else self._source.reader(str(question.get("run", "")))
        name = str(question.get("name", ""))
        sequence = None if reader is None else reader.newest_sequence(name)
        if reader is None or sequence is None:
            return None
        if question.get("after") == sequence:
            return sequence, Picture(jpeg=b"")
        picture = reader.picture(name, zebra=question.get("zebra") not in (False, "0"), dolp_top=_dolp_top(question))
        return None if picture is None else (sequence, picture)


class Sockets:
    """The open sockets of a page. If there are too many, the one that has been idle longest is closed."""

    def __init__(self, most: int = MOST_SOCKETS) -> None:
        self._most = most
        self._asked_s: dict[asyncio.Task[object], float] = {}

    @contextmanager
    def place(self) -> Iterator[None]:
        """Occupy a place while the context lasts; the task is cancelled if others need the place."""
        task = self._noted()
        while len(self._asked_s) > self._most:
            oldest = min(self._asked_s, key=lambda one: self._asked_s[one])
            del self._asked_s[oldest]
            oldest.cancel()
        try:
            yield
        finally:
            self._asked_s.pop(task, None)

    def has_asked(self) -> None:
        """Note that the socket of this task is active."""
        self._noted()

    def _noted(self) -> "asyncio.Task[object]":
        task = asyncio.current_task()
        if task is None:
            raise RuntimeError("a socket is answered within a task")
        self._asked_s[task] = asyncio.get_running_loop().time()
        return task


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
    """Return a message: the length of the head in 4 bytes, the head in JSON, the picture."""
    text = json.dumps(head, allow_nan=False).encode("utf-8")
    return len(text).to_bytes(_HEAD_BYTES, "big") + text + picture


def _right(connection: HTTPConnection) -> str:
    right: str = connection.scope["state"]["right"]
    return right


def _not_found() -> Response:
    return JSONResponse({"error": "not found"}, status_code=404)
