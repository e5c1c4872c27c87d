"""The page over HTTP: who may look and act, routes, the socket, what it shows, and serving it.

Two tokens, for looking and for acting, are exchanged for a cookie. Connections are bounded in number and time; idle
ones are dropped when new ones come.
"""

import asyncio
import ipaddress
import json
import math
import os
import secrets
import socket
import threading
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from http.cookies import CookieError, SimpleCookie
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Protocol, Self
from urllib.parse import parse_qs, urlsplit

import cv2
import h11
import numpy as np
import uvicorn
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol

from drivers.errors import DeviceError
from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded
from rigctl.base.numbers import LARGEST
from rigctl.console.json_text import json_text
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import Region
from rigctl.runs.folder import MANIFEST_FILE
from rigctl.runs.records import EVENTS_FILE, SESSION_FILE, explain_invalid
from rigctl.version import VERSION
from rigctl.web.pictures import Picture
from rigctl.web.rig import LiveRig
from rigctl.web.what import Curves, LiveLook, RunReader, RunRow, Task, run_row

Right = Literal["look", "act"]
MOST_BODY_BYTES = 1_000_000
_REQUEST_TIMEOUT_S = 20.0
_TOKEN_BYTES = 18
# Scripts, styles and pictures come from here alone; pictures of the camera are made of what the socket brings.
_POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' blob: data:",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
_SAFE_HEADERS = (
    (b"content-security-policy", _POLICY.encode("ascii")),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)


@dataclass(frozen=True, kw_only=True)
class Access:
    """The two keys of a page."""

    #: Tokens: the first opens the page, the second opens it with hands.
    look: str = field(default_factory=lambda: secrets.token_urlsafe(_TOKEN_BYTES))
    act: str = field(default_factory=lambda: secrets.token_urlsafe(_TOKEN_BYTES))

    def right_of(self, token: str) -> Right | None:
        """Return what a token opens; None for one that is not ours."""
        given = token.encode("utf-8", errors="replace")
        if secrets.compare_digest(given, self.act.encode("ascii")):
            return "act"
        return "look" if secrets.compare_digest(given, self.look.encode("ascii")) else None


@dataclass(frozen=True, kw_only=True)
class _Refusal:
    status: int
    text: str


class Guard:
    """Stands before the page and lets through what shows a token, asks for this host and comes from its own page."""

    def __init__(self, app: ASGIApp, access: Access, *, hosts: Iterable[str], port: int, is_secure: bool) -> None:
        self._app, self._access = app, access
        self._hosts = frozenset(host.lower() for host in hosts)
        self._cookie = f"rigctl-{port}"
        self._scheme = "https" if is_secure else "http"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one connection."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        right, refusal = self._judged(scope, headers)
        if refusal is not None:
            await _refuse(refusal, scope, receive, send)
            return
        if scope["type"] == "http" and _query_token(scope) and scope["method"] == "GET":
            await self._with_cookie(scope)(scope, receive, _with_safe_headers(send))
            return
        scope.setdefault("state", {})["right"] = right
        if scope["type"] == "websocket":
            await self._app(scope, receive, send)
        else:
            async with asyncio.timeout(_REQUEST_TIMEOUT_S):
                await self._app(scope, receive, _with_safe_headers(send))

    def _judged(self, scope: Scope, headers: Headers) -> tuple[Right | None, _Refusal | None]:
        host = headers.get("host", "")
        if not self._is_our_host(host):
            return None, _Refusal(
                status=421, text="not asked by a name of this machine; type the address as it was printed"
            )
        right = self._right(scope, headers)
        if right is None:
            return None, _Refusal(status=401, text="no valid token: open the address that rigctl printed")
        origin = headers.get("origin")
        is_plain_look = scope["type"] == "http" and scope["method"] in ("GET", "HEAD")
        if origin is not None and not is_plain_look and origin.lower() != f"{self._scheme}://{host.lower()}":
            return None, _Refusal(status=403, text="asked by the page of somebody else")
        if not is_plain_look and scope["type"] == "http" and right != "act":
            return None, _Refusal(status=403, text="this token may look, not act")
        if _body_bytes(headers) > MOST_BODY_BYTES:
            return None, _Refusal(status=413, text=f"more than {MOST_BODY_BYTES} bytes")
        return right, None

    def _is_our_host(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name.lower() in self._hosts
        return True

    def _right(self, scope: Scope, headers: Headers) -> Right | None:
        scheme, _, bearer = headers.get("authorization", "").partition(" ")
        given = [_query_token(scope), bearer.strip() if scheme.lower() in ("bearer", "token") else ""]
        given.append(_cookie(headers.get("cookie", ""), self._cookie))
        rights = [self._access.right_of(token) for token in given if token]
        return next((right for right in rights if right is not None), None)

    def _with_cookie(self, scope: Scope) -> Response:
        """Exchange the token of an address for a cookie, so that it stands in no history and no picture of the page."""
        response = RedirectResponse(scope["path"], status_code=303)
        response.set_cookie(
            self._cookie, _query_token(scope), httponly=True, samesite="strict", secure=self._scheme == "https"
        )
        return response


def names_of_this_machine(listen: str) -> tuple[str, ...]:
    """Return the names by which a page that listens at an address may be asked for."""
    own = socket.gethostname()
    return ("localhost", listen) if is_loopback(listen) else ("localhost", listen, own, f"{own}.local")


def is_loopback(address: str) -> bool:
    """Return whether this machine alone can reach an address."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address == "localhost"


def _query_token(scope: Scope) -> str:
    query: bytes = scope.get("query_string", b"")
    return parse_qs(query.decode("latin-1")).get("token", [""])[0]


def _cookie(header: str, name: str) -> str:
    try:
        jar = SimpleCookie(header)
    except CookieError:
        return ""
    return jar[name].value if name in jar else ""


def _body_bytes(headers: Headers) -> int:
    """Return how long a body says it is; one that does not say how long it is counts as too long."""
    if "chunked" in headers.get("transfer-encoding", "").lower():
        return MOST_BODY_BYTES + 1
    length = headers.get("content-length", "0")
    return int(length) if length.isdecimal() else MOST_BODY_BYTES + 1


def _with_safe_headers(send: Send) -> Send:
    async def safely(message: Message) -> None:
        if message["type"] == "http.response.start":
            given = list(message.get("headers", ()))
            stated = {name.lower() for name, _ in given}
            message = {**message, "headers": [*given, *(one for one in _SAFE_HEADERS if one[0] not in stated)]}
        await send(message)

    return safely


async def _refuse(refusal: _Refusal, scope: Scope, receive: Receive, send: Send) -> None:
    """Answer with a few words; a socket is answered like a page, before it opens."""
    response = PlainTextResponse(refusal.text + "\n", status_code=refusal.status, headers={"connection": "close"})
    await response(scope, receive, send if scope["type"] == "websocket" else _with_safe_headers(send))


MOST_CONNECTIONS = 128
MOST_SOCKETS = 32
# From the opening of a connection, or from an answer, to the end of the next request's head.
HEAD_S = 10.0


class Connection(H11Protocol):
    """A connection that is closed when it has waited for too long, or when others need its place."""

    open_ones: ClassVar[list["Connection"]]
    most: ClassVar[int]
    head_s: ClassVar[float]

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the place of another where all are taken."""
        if not isinstance(transport, asyncio.Transport):
            raise TypeError(f"a connection goes both ways, {transport!r} does not")
        super().connection_made(transport)
        self.silent_since_s = self.loop.time()
        self._watch = self.loop.call_later(self.head_s, self._look_after)
        self.open_ones.append(self)
        if len(self.open_ones) > self.most:
            silent = [one for one in self.open_ones if not one.is_answered()]
            min(silent, key=lambda one: one.silent_since_s).leave()

    def connection_lost(self, exc: Exception | None) -> None:
        """Give its place free."""
        self._give_place()
        super().connection_lost(exc)

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Give its place free: sockets are counted by themselves."""
        self._give_place()
        super().handle_websocket_upgrade(event)

    def on_response_complete(self) -> None:
        """Begin to wait for the next request."""
        self.silent_since_s = self.loop.time()
        super().on_response_complete()

    def is_answered(self) -> bool:
        """Return whether an answer is on its way."""
        return self.cycle is not None and not self.cycle.response_complete

    def leave(self) -> None:
        """Close it for the good of others."""
        self._give_place()  # now: others may come before it has heard of its end
        self.transport.abort()

    def _look_after(self) -> None:
        left_s = self.head_s if self.is_answered() else self.silent_since_s + self.head_s - self.loop.time()
        if left_s <= 0.0:
            self.leave()
            return
        self._watch = self.loop.call_later(left_s, self._look_after)

    def _give_place(self) -> None:
        self._watch.cancel()
        if self in self.open_ones:
            self.open_ones.remove(self)


def connection_class(*, most: int = MOST_CONNECTIONS, head_s: float = HEAD_S) -> type[Connection]:
    """Return what one server answers its connections by."""
    return type("OwnConnection", (Connection,), {"open_ones": [], "most": most, "head_s": head_s})


class Sockets:
    """The open sockets of a page. One too many, and the one that has asked nothing for longest is closed."""

    def __init__(self, most: int = MOST_SOCKETS) -> None:
        self._most = most
        self._asked_s: dict[asyncio.Task[object], float] = {}

    @contextmanager
    def place(self) -> Iterator[None]:
        """Have a place for as long as the context lasts; the task is cancelled when others need it."""
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
        """Note that the socket of this task has asked something."""
        self._noted()

    def _noted(self) -> "asyncio.Task[object]":
        task = asyncio.current_task()
        if task is None:
            raise RuntimeError("a socket is answered within a task")
        self._asked_s[task] = asyncio.get_running_loop().time()
        return task


_QUIET = 2
_HALVES = {(False, False): " ", (True, False): "▀", (False, True): "▄", (True, True): "█"}


def qr_text(text: str) -> str:
    """Return a text as a QR code, two rows of it a line: light on dark, as terminals are."""
    try:
        found = cv2.QRCodeEncoder.create().encode(text)
    except cv2.error as error:
        raise ValueError(f"{len(text)} characters are too many for a QR code") from error
    code = np.asarray(found, dtype=np.uint8)
    if code.size == 0:
        raise ValueError(f"{len(text)} characters are too many for a QR code")
    is_light = np.pad(_trimmed(code) > 0, _QUIET, constant_values=True)
    if len(is_light) % 2:
        is_light = np.pad(is_light, ((0, 1), (0, 0)), constant_values=True)
    pairs = zip(is_light[::2], is_light[1::2], strict=True)
    return "\n".join("".join(_HALVES[bool(a), bool(b)] for a, b in zip(*pair, strict=True)) for pair in pairs)


def _trimmed(code: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a code without its light rim, which differs from version to version of its maker."""
    rows, columns = np.nonzero(code == 0)
    return code[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]


_MS_PER_S = 1e3
Question = Literal["hold", "resume", "stop"]


@dataclass(frozen=True, kw_only=True)
class Asked:
    """A request that acts: the run that it names, and its body."""

    run: str
    body: bytes


Act = Callable[[Asked], dict[str, str]]


class View(Protocol):
    """What a page draws: the devices' picture, or one that was there before."""

    def look(self) -> LiveLook:
        """Return what is seen, in numbers."""

    def newest_sequence(self, name: str) -> int | None:
        """Return the number of the newest picture of a name; None where there is none."""

    def picture(self, name: str, *, zebra: bool = True, dolp_top: float = 1.0) -> Picture | None:
        """Return the newest picture of a name; None where there is none."""


class Sessions(Protocol):
    """Session files, and the sessions that run."""

    def names(self) -> tuple[str, ...]:
        """Return the names of the session files."""

    def plan(self, name: str) -> str:
        """Return what a session file will take, in words."""

    def start(self, name: str) -> str:
        """Start the session of a file in a process of its own; return the name of its run."""

    def ask(self, name: str, what: Question) -> None:
        """Ask something of the session of a run, by the run's name."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Hands:
    """What a page may do; it shows no more than belongs to its acts."""

    view: View  #: What it draws.
    #: What it may do, by name: those of `camera_acts`, `stage_acts`, `session_acts` and `region_acts` together.
    acts: Mapping[str, Act]
    title: str = ""  #: Heading of the page; empty where it heads the list of runs.
    session_names: Callable[[], tuple[str, ...]] = tuple  #: Returns the names of the session files.
    drawn: tuple[Region, ...] = ()  #: Regions that are there already.
    regions_file: str = "regions.toml"  #: Name of the file that regions are written to.
    is_once: bool = False  #: The page ends as soon as regions are written.


@with_config(ConfigDict(extra="forbid", allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class _Wanted:
    """A task as a page asks for it."""

    kind: Literal["rest", "preview", "polarimetry"]
    exposure_ms: Annotated[float, Field(gt=0.0, le=600_000.0)] = 10.0
    gain_db: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.0
    zoom: Annotated[int, Field(ge=1, le=64)] = 1
    angles_deg: Annotated[tuple[Annotated[float, Field(ge=-LARGEST, le=LARGEST)], ...], Field(max_length=64)] = (
        0.0,
        45.0,
        90.0,
        135.0,
    )


@with_config(ConfigDict(extra="forbid", allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class _Turn:
    angle_deg: Annotated[float, Field(ge=-360.0, le=360.0)]


@with_config(ConfigDict(extra="forbid"))
@dataclass(frozen=True, kw_only=True)
class _SessionName:
    session: Annotated[str, Field(max_length=200)]


_WANTED, _TURN, _SESSION = TypeAdapter(_Wanted), TypeAdapter(_Turn), TypeAdapter(_SessionName)


def camera_acts(rig: LiveRig) -> Mapping[str, Act]:
    """Return what is done with a camera: begin a task."""
    return {"task": lambda asked: _begin(rig, _WANTED.validate_json(asked.body))}


def stage_acts(rig: LiveRig) -> Mapping[str, Act]:
    """Return what is done with a polarizer that turns, and for its maps: turn it, take the dark level."""
    return {
        "turn": lambda asked: _turn(rig, _TURN.validate_json(asked.body)),
        "dark": lambda _: _take_dark(rig),
    }


def session_acts(sessions: Sessions, rig: LiveRig) -> Mapping[str, Act]:
    """Return what is done with sessions: ask them, show the plan of one, start one."""
    return {
        "hold": lambda asked: _ask(sessions, asked, "hold"),
        "resume": lambda asked: _ask(sessions, asked, "resume"),
        "stop": lambda asked: _ask(sessions, asked, "stop"),
        "plan": lambda asked: {"plan": sessions.plan(_SESSION.validate_json(asked.body).session)},
        "start": lambda asked: _start(sessions, rig, _SESSION.validate_json(asked.body).session),
    }


def region_acts(write: Callable[[bytes], str]) -> Mapping[str, Act]:
    """Return what is done with regions: `write` them, given as JSON, which returns the name of the file."""
    return {"regions": lambda asked: {"file": write(asked.body)}}


def hand_routes(hands: Hands) -> list[Route]:
    """Return the routes that act; `rigctl.web.server.Guard` lets only those with the right through."""
    return [Route(f"/api/{name}", _answering(act), methods=["POST"]) for name, act in hands.acts.items()]


def _ask(sessions: Sessions, asked: Asked, what: Question) -> dict[str, str]:
    sessions.ask(asked.run, what)
    return {"done": f"asked to {what}"}


def _begin(rig: LiveRig, wanted: _Wanted) -> dict[str, str]:
    rig.begin(
        Task(
            kind=wanted.kind,
            exposure_s=wanted.exposure_ms / _MS_PER_S,
            gain_db=wanted.gain_db,
            angles_deg=wanted.angles_deg,
            zoom=wanted.zoom,
        )
    )
    return {"done": wanted.kind}


def _turn(rig: LiveRig, wanted: _Turn) -> dict[str, str]:
    rig.turn(wanted.angle_deg)
    return {"done": "turning"}


def _take_dark(rig: LiveRig) -> dict[str, str]:
    rig.take_dark()
    return {"done": "dark level taken"}


def _start(sessions: Sessions, rig: LiveRig, name: str) -> dict[str, str]:
    """Start a session, once the devices are closed for it."""
    rig.begin(Task())
    return {"run": sessions.start(name)}


def _answering(act: Act) -> Callable[[Request], Awaitable[Response]]:
    """Return what does an act in a thread of its own and says what went wrong in words."""

    async def answer(request: Request) -> Response:
        body = await request.body()
        if len(body) > MOST_BODY_BYTES:
            return _problem(413, f"more than {MOST_BODY_BYTES} bytes")
        asked = Asked(run=request.query_params.get("run", ""), body=body)
        try:
            return JSONResponse(await asyncio.to_thread(act, asked))
        except ValidationError as error:
            return _problem(422, explain_invalid(error))
        except ConfigError as error:
            return _problem(422, str(error))
        except (DataError, DeviceError, OSError) as error:
            return _problem(409, str(error))

    return answer


def _problem(status: int, text: str) -> Response:
    return JSONResponse({"error": text}, status_code=status)


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

    It expects `rigctl.web.server.Guard` before it. Every name in a request is looked up among those that are known;
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


_KEPT_READERS = 64
_REPORT = "report.html"
_COMPARISON = "comparison.json"
_SUMMARY = "summary.html"
_AT_REST = ("finished", "stopped", "interrupted")
_Times = tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class _Comparison:
    """A folder that holds a comparison: of which run, what it found, and when it was written."""

    folder: Path
    run: str
    verdict: str
    time_ns: int


class NoRuns:
    """No run at all: the page of a camera, or of a picture, alone."""

    def rows(self) -> tuple[RunRow, ...]:
        """Return an empty list."""
        return ()

    def reader(self, run: str) -> None:
        """Return None."""

    def document(self, run: str, name: str) -> None:
        """Return None."""


class OneRun:
    """One run, which may come later."""

    def __init__(self, path: Path) -> None:
        self._path, self._reader = path, RunReader(path)

    def rows(self) -> None:
        """Return None: there is no list."""

    def reader(self, run: str) -> RunReader | None:
        """Return the run, by its name or by none."""
        return self._reader if run in ("", self._path.resolve().name) else None

    def document(self, run: str, name: str) -> bytes | None:
        """Return its summary or a report beside it."""
        return _document(self._path, name) if self.reader(run) is not None else None


class RunsOfFolder:
    """The runs of a folder, as they are at each look."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._readers: OrderedDict[str, RunReader] = OrderedDict()
        self._rows: dict[Path, tuple[_Times, RunRow]] = {}
        self._comparisons = _Comparisons()

    def rows(self) -> tuple[RunRow, ...]:
        """Return the runs, the newest first."""
        beside = self._comparisons.by_run(self._path)
        rows = [self._row(path, beside.get(path.name, [])) for path in self._runs()]
        return tuple(sorted(rows, key=lambda row: (row.begun_utc, row.run), reverse=True))

    def reader(self, run: str) -> RunReader | None:
        """Return the run of a name."""
        if run not in {path.name for path in self._runs()}:
            return None
        with self._lock:
            reader = self._readers.setdefault(run, RunReader(self._path / run))
            self._readers.move_to_end(run)
            while len(self._readers) > _KEPT_READERS:
                self._readers.popitem(last=False)
            return reader

    def document(self, run: str, name: str) -> bytes | None:
        """Return a run's summary or a report beside it."""
        return _document(self._path / run, name) if self.reader(run) is not None else None

    def _runs(self) -> list[Path]:
        try:
            return [path for path in sorted(self._path.iterdir()) if _is_run(path)]
        except OSError:
            return []

    def _row(self, path: Path, compared: list[_Comparison]) -> RunRow:
        times = _times(path)
        known = self._rows.get(path)
        row = known[1] if known is not None and known[0] == times and known[1].state in _AT_REST else run_row(path)
        self._rows[path] = (times, row)
        pages = (*(["summary"] if _summary(path) is not None else []), *(one.folder.name for one in compared))
        return replace(row, verdict=compared[-1].verdict if compared else "", pages=pages)


class _Comparisons:
    """Remembers which comparison is of which run, until its file changes."""

    def __init__(self) -> None:
        self._known: dict[Path, tuple[int, _Comparison | None]] = {}

    def by_run(self, parent: Path) -> dict[str, list[_Comparison]]:
        """Return the comparisons in the folders of a folder by the runs that they are of, the oldest first."""
        found: dict[str, list[_Comparison]] = {}
        for one in sorted(filter(None, map(self._of, _folders(parent))), key=lambda one: one.time_ns):
            found.setdefault(one.run, []).append(one)
        return found

    def _of(self, folder: Path) -> _Comparison | None:
        try:
            time_ns = (folder / _COMPARISON).stat().st_mtime_ns
        except OSError:
            return None
        if folder not in self._known or self._known[folder][0] != time_ns:
            self._known[folder] = (time_ns, _read_comparison(folder, time_ns))
        return self._known[folder][1]


def source_at(path: Path) -> Source:
    """Return what a page at a path shows: a run, also one that is yet to come, or the runs of a folder."""
    if path.is_file():
        raise ConfigError(f"{path}: is a file; name a run folder, or a folder of run folders")
    if path.is_dir() and not _is_run(path):
        return RunsOfFolder(path)
    if not path.resolve().parent.is_dir():
        raise ConfigError(f"{path}: there is no folder in which this run could come to be")
    return OneRun(path)


def _is_run(path: Path) -> bool:
    return (path / SESSION_FILE).is_file() or (path / MANIFEST_FILE).is_file()


def _times(run: Path) -> _Times:
    """Return when the files were written that a row is made of."""
    found = []
    for name in (SESSION_FILE, MANIFEST_FILE, EVENTS_FILE):
        try:
            found.append((run / name).stat().st_mtime_ns)
        except OSError:
            found.append(0)
    return tuple(found)


def _document(run: Path, name: str) -> bytes | None:
    """Return the page of a name beside a run; each is one file that needs no other."""
    if name == "summary":
        file = _summary(run)
    else:
        own = {one.folder.name: one.folder for one in _Comparisons().by_run(run.parent).get(run.resolve().name, [])}
        file = own[name] / _REPORT if name in own else None
    try:
        return None if file is None else read_bounded(file, MOST_RECORD_BYTES)
    except OSError:
        return None


def _summary(run: Path) -> Path | None:
    files = (run.with_name(f"{run.name}-{_SUMMARY}"), run / _SUMMARY)
    return next((file for file in files if file.is_file()), None)


def _folders(parent: Path) -> list[Path]:
    try:
        return [path for path in parent.iterdir() if path.is_dir()]
    except OSError:
        return []


def _read_comparison(folder: Path, time_ns: int) -> _Comparison | None:
    """Return what a comparison says of itself; None where it does not say of which run it is."""
    try:
        content = json.loads(read_bounded(folder / _COMPARISON, MOST_RECORD_BYTES))
        run = Path(content["provenance"]["run"]["path"]).name
        verdict = str(content.get("verdict", "")).replace("_", " ")
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None
    return _Comparison(folder=folder, run=run, verdict=verdict, time_ns=time_ns)


_BACKLOG = 256
_SHUTDOWN_S = 2
# An address kept for documentation: no network has it.
_ELSEWHERE = "192.0.2.1"
_QUESTION_BYTES = 4096
_MOST_PORT = 65535
# Below everything that a session does.
_NICENESS = 10


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a page is."""

    host: str = "127.0.0.1"  #: Address of this machine to listen at; 127.0.0.1 is for this machine alone.
    port: int = 0  #: 0: any that is free.
    certificate: Path | None = None  #: Files of a TLS certificate and its key; without them it is plain HTTP.
    key: Path | None = None


def place_of(listen: str, certificate: Path | None = None, key: Path | None = None) -> Place:
    """Return where a page is, from an address and port such as 127.0.0.1:8765; ConfigError if that is wrong."""
    host, _, port = listen.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isdecimal() or int(port) > _MOST_PORT:
        raise ConfigError(f"--listen {listen}: must be an address and a port, such as 127.0.0.1:8765")
    if (certificate is None) != (key is None):
        raise ConfigError("--certificate and --key belong together")
    return Place(host=host, port=int(port), certificate=certificate, key=key)


@dataclass(frozen=True, kw_only=True)
class Addresses:
    """What to type into a browser: the one may look, the other may act as well."""

    look_url: str
    act_url: str | None

    @property
    def is_for_others(self) -> bool:
        """Machines beside this one can open them."""
        return not is_loopback(urlsplit(self.look_url).hostname or "")


class PageServer:
    """Listens for a page from the moment it is made. A context manager: it answers in a thread of its own meanwhile."""

    def __init__(self, app: ASGIApp, place: Place, *, can_act: bool) -> None:
        self._listening = _listening(place)
        port = int(self._listening.getsockname()[1])
        is_secure = place.certificate is not None
        access = Access()
        guard = Guard(app, access, hosts=names_of_this_machine(place.host), port=port, is_secure=is_secure)
        try:
            self._server = uvicorn.Server(_config(guard, place))
        except ConfigError:
            self._listening.close()
            raise
        base = f"http{'s' if is_secure else ''}://{_shown(place.host)}:{port}/?token="
        self.addresses = Addresses(look_url=base + access.look, act_url=base + access.act if can_act else None)

    def run(self) -> None:
        """Answer until somebody presses Ctrl-C, at low priority."""
        os.nice(_NICENESS)
        with self._listening, suppress(KeyboardInterrupt):
            self._server.run(sockets=[self._listening])

    def __enter__(self) -> Self:
        self._thread = threading.Thread(target=self._server.run, args=([self._listening],), name="page", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._server.should_exit = True
        self._thread.join()
        self._listening.close()


_SHOWN = 100


def _config(app: ASGIApp, place: Place) -> uvicorn.Config:
    config = uvicorn.Config(
        app,
        log_level="critical",
        access_log=False,
        lifespan="off",
        http=connection_class(),
        server_header=False,
        timeout_keep_alive=int(HEAD_S),
        timeout_graceful_shutdown=_SHUTDOWN_S,
        ws_max_size=_QUESTION_BYTES,
        ws_per_message_deflate=False,  # a JPEG grows no smaller by it, and it takes three times what drawing one does
        h11_max_incomplete_event_size=_QUESTION_BYTES * 4,
        ssl_certfile=place.certificate,
        ssl_keyfile=place.key,
    )
    try:
        config.load()
    except OSError as error:  # ssl.SSLError is one
        raise ConfigError(f"--certificate {place.certificate}: cannot be used: {error.strerror or error}") from error
    return config


def _listening(place: Place) -> socket.socket:
    family = socket.AF_INET6 if ":" in place.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((place.host, place.port))
        listening.listen(_BACKLOG)
    except (OSError, ValueError) as error:  # a name that no network can have is a UnicodeError
        listening.close()
        reason = error.strerror if isinstance(error, OSError) else "is no address"
        raise ConfigError(
            f"--listen {place.host[:_SHOWN]}:{place.port}: {reason}; name another port, or 0 for any that is free"
        ) from error
    return listening


def _shown(host: str) -> str:
    """Return how an address stands in a browser; one that means all of this machine's by the one that others see."""
    if host in ("0.0.0.0", "::"):
        host = _seen_by_others()
    return f"[{host}]" if ":" in host else host


def _seen_by_others() -> str:
    """Return this machine's address on the way to other networks, else its name; nothing is sent to find out."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        try:
            asked.connect((_ELSEWHERE, 1))
        except OSError:
            return socket.gethostname()
        return str(asked.getsockname()[0])
