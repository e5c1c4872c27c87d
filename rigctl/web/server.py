"""The server of a page: addresses, tokens, rights, and a bounded number of connections of bounded duration.

There are two tokens: one to look, one to act. A browser exchanges the token of the address for a cookie.
"""

import asyncio
import ipaddress
import os
import secrets
import socket
import ssl
import stat
import threading
from collections.abc import Awaitable, Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Annotated, Any, Literal, ParamSpec, Self, TypeVar, cast
from urllib.parse import parse_qs, parse_qsl, urlencode, urlsplit

import cv2
import h11
import numpy as np
import uvicorn
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, TypeAdapter, with_config
from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.console import warn
from rigctl.errors import ConfigError

Right = Literal["look", "act"]
Token = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{20,100}$")]
P = ParamSpec("P")
T = TypeVar("T")
MOST_BODY_BYTES = 1_000_000
MOST_CONNECTIONS = 256
# Time that a connection may stay even if others need its place, and time for an answer after that.
STAY_S, _ANSWER_S = 0.4, 2.0
# Time from the opening of a connection, or from an answer, to the end of the next request's head.
HEAD_S = 10.0
# Time from accepting a connection to the end of its TLS handshake.
HANDSHAKE_S = 5.0
_REQUEST_TIMEOUT_S = 20.0
_TOKEN_BYTES = 18
# Scripts, styles and pictures come from this server; pictures of the camera come through the socket.
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
# Connections that wait to be accepted; further ones have to try again a second later.
_BACKLOG = 4096
_LOOK_S = 0.02
_SHUTDOWN_S = 2
# An address reserved for documentation, which no network has.
_ELSEWHERE = "192.0.2.1"
_QUESTION_BYTES = 4096
_MOST_PORT = 65535
# A lower priority than that of a session.
_NICENESS = 10
_SHOWN = 100
_QUIET = 2
_HALVES = {(False, False): " ", (True, False): "▀", (False, True): "▄", (True, True): "█"}


@dataclass(frozen=True, kw_only=True)
class Place:
    """Address of a page on this machine."""

    host: str = "127.0.0.1"  #: Address of this machine; only this machine can reach 127.0.0.1.
    port: int = 0  #: 0 for any free port.
    certificate: Path | None = None  #: Files of a TLS certificate and its key; without them the page is plain HTTP.
    key: Path | None = None


def place_of(listen: str, certificate: Path | None = None, key: Path | None = None) -> Place:
    """Return the address of a page from text such as 127.0.0.1:8765; raise ConfigError if it is wrong."""
    host, _, port = listen.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isdecimal() or int(port) > _MOST_PORT:
        raise ConfigError(f"--listen {listen}: must be an address and a port, such as 127.0.0.1:8765")
    if (certificate is None) != (key is None):
        raise ConfigError("--certificate and --key belong together")
    return Place(host=host, port=int(port), certificate=certificate, key=key)


@dataclass(frozen=True, kw_only=True)
class Addresses:
    """Addresses of a page: one to look, one to look and act."""

    look_url: str
    act_url: str | None

    @property
    def is_for_others(self) -> bool:
        """True if other machines can open the page."""
        return not is_loopback(urlsplit(self.look_url).hostname or "")


class PageServer:
    """Listens for a page from its creation on. As a context manager it answers in a thread of its own.

    Tokens and port are kept in the file `kept`, so that an open page connects again after a restart of the server.
    """

    def __init__(
        self, app: ASGIApp, place: Place, *, can_act: bool, kept: Path | None = None, is_new: bool = False
    ) -> None:
        before = None if kept is None else _kept_access(kept)
        self._listening = _listening(place, usual_port=0 if before is None else before.port)
        port = int(self._listening.getsockname()[1])
        is_secure = place.certificate is not None
        access = replace(Access() if before is None or is_new else before, port=port)
        guard = Guard(app, access, hosts=names_of_this_machine(place.host), port=port, is_secure=is_secure)
        try:
            self._server = BoundedServer(_config(guard), None if place.certificate is None else _tls(place))
            if kept is not None and access != before:
                _keep_access(kept, access)
        except ConfigError:
            self._listening.close()
            raise
        base = f"http{'s' if is_secure else ''}://{_shown(place.host)}:{port}/?token="
        self.addresses = Addresses(look_url=base + access.look, act_url=base + access.act if can_act else None)
        if self.addresses.is_for_others and not is_secure:
            warn(
                "the page is not encrypted: others on this network can read its tokens. Give --certificate and --key "
                "to rigctl serve, or stay on 127.0.0.1 and use ssh -L"
            )

    def run(self) -> None:
        """Answer until Ctrl-C, at low priority."""
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


@with_config(ConfigDict(extra="forbid"))
@dataclass(frozen=True, kw_only=True)
class Access:
    """Tokens and port of a page, which are kept in a file."""

    #: Tokens to look and to act.
    look: Token = field(default_factory=lambda: secrets.token_urlsafe(_TOKEN_BYTES))
    act: Token = field(default_factory=lambda: secrets.token_urlsafe(_TOKEN_BYTES))
    port: Annotated[int, Field(ge=0, le=_MOST_PORT)] = 0  #: The last port, to which the cookie belongs.

    def right_of(self, token: str) -> Right | None:
        """Return the right of a token; None for an unknown one."""
        given = token.encode("utf-8", errors="replace")
        if secrets.compare_digest(given, self.act.encode("ascii")):
            return "act"
        return "look" if secrets.compare_digest(given, self.look.encode("ascii")) else None


_ACCESS = TypeAdapter(Access)


class Guard:
    """Checks requests: each needs a token, a name of this host, and the origin of this page."""

    def __init__(self, app: ASGIApp, access: Access, *, hosts: Iterable[str], port: int, is_secure: bool) -> None:
        self._app, self._access = app, access
        self._hosts = frozenset(host.lower() for host in hosts)
        self._cookie = f"rigctl-{port}"
        self._scheme = "https" if is_secure else "http"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        right, refusal = self._judged(scope, headers)
        if refusal is not None:
            await _refuse(refusal, scope, receive, send)
            return
        if scope["type"] == "http" and scope["method"] == "GET" and self._access.right_of(_query_token(scope)):
            await self._with_cookie(scope)(scope, receive, _with_safe_headers(send))
            return
        scope.setdefault("state", {})["right"] = right
        if scope["type"] == "websocket":
            await self._app(scope, receive, send)
        else:
            await self._app(scope, _in_time(receive), _with_safe_headers(_in_time(send)))

    def _judged(self, scope: Scope, headers: Headers) -> tuple[Right | None, tuple[int, str] | None]:
        host = headers.get("host", "")
        if not self._is_our_host(host):
            return None, (421, "the host name is not one of this machine; type the address as it was printed")
        right = self._right(scope, headers)
        if right is None:
            return None, (401, "no valid token: open the address that rigctl printed")
        origin = headers.get("origin")
        is_plain_look = scope["type"] == "http" and scope["method"] in ("GET", "HEAD")
        if origin is not None and not is_plain_look and origin.lower() != f"{self._scheme}://{host.lower()}":
            return None, (403, "request from another page")
        if not is_plain_look and scope["type"] == "http" and right != "act":
            return None, (403, "this token may look, not act")
        if _body_bytes(headers) > MOST_BODY_BYTES:
            return None, (413, f"more than {MOST_BODY_BYTES} bytes")
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
        """Exchange the token of an address for a cookie, so that the browser's history does not show it."""
        rest = urlencode([(key, value) for key, value in parse_qsl(scope["query_string"].decode()) if key != "token"])
        # One slash: two would lead to another host.
        where = "/" + scope["path"].lstrip("/\\") + (f"?{rest}" if rest else "")
        response = RedirectResponse(where, status_code=303)
        response.set_cookie(
            self._cookie, _query_token(scope), httponly=True, samesite="strict", secure=self._scheme == "https"
        )
        return response


def names_of_this_machine(listen: str) -> tuple[str, ...]:
    """Return the host names that a page at an address answers to."""
    own = socket.gethostname()
    return ("localhost", listen) if is_loopback(listen) else ("localhost", listen, own, f"{own}.local")


def is_loopback(address: str) -> bool:
    """Return whether only this machine can reach an address."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address == "localhost"


class BoundedServer(uvicorn.Server):
    """Serves a bounded number of connections, each for a bounded time.

    If all places are taken, a new connection waits until the oldest has stayed for `stay_s`, and takes its place. So no
    client can block others, and no connection is closed before its request can be read.
    """

    def __init__(
        self,
        config: uvicorn.Config,
        tls: ssl.SSLContext | None = None,
        *,
        most: int = MOST_CONNECTIONS,
        stay_s: float = STAY_S,
        head_s: float = HEAD_S,
    ) -> None:
        super().__init__(config)
        self.tls, self.stay_s, self.head_s, self._most = tls, stay_s, head_s, most
        self.open_ones: set[Connection] = set()
        self.left = asyncio.Event()
        self._accepting: list[asyncio.Task[None]] = []

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to accept connections."""
        await super().startup(sockets=[])
        self._accepting = [asyncio.create_task(self._accept(one)) for one in sockets or ()]

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Accept no more connections, and close the open ones."""
        for task in self._accepting:
            task.cancel()
        await super().shutdown(sockets)

    async def _accept(self, listening: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        listening.setblocking(False)
        while True:
            try:
                accepted, _ = await loop.sock_accept(listening)
            except OSError:  # the client has gone already, or no file handle is free
                await asyncio.sleep(_LOOK_S)
                continue
            try:
                await self._has_room()
            except asyncio.CancelledError:
                accepted.close()
                raise
            Connection(self).begin(accepted)
            await asyncio.sleep(0.0)  # other connections are read in between

    async def _has_room(self) -> None:
        """Wait for a free place."""
        while len(self.open_ones) >= self._most:
            oldest = min(self.open_ones, key=Connection.stays_until_s)
            left_s = oldest.stays_until_s() - asyncio.get_running_loop().time()
            if left_s <= 0.0:
                oldest.leave()
                return
            self.left.clear()
            with suppress(TimeoutError):
                await asyncio.wait_for(self.left.wait(), left_s)


class Connection(H11Protocol):
    """A connection that is closed after a long wait, or when others need its place."""

    def __init__(self, server: BoundedServer) -> None:
        super().__init__(server.config, server.server_state, {})
        self._server = server
        self._beginning: asyncio.Task[None] | None = None
        self._watch: asyncio.TimerHandle | None = None
        #: Times of acceptance, of the end of the last answer, and of the beginning of the present one [s].
        self._born_s = self._silent_since_s = self._answer_since_s = self.loop.time()

    def begin(self, accepted: socket.socket) -> None:
        """Occupy a place, and make the TLS handshake if there is one."""
        self._server.open_ones.add(self)
        self._beginning = self.loop.create_task(self._connected(accepted))

    async def _connected(self, accepted: socket.socket) -> None:
        tls = self._server.tls
        try:
            await self.loop.connect_accepted_socket(
                lambda: self, accepted, ssl=tls, ssl_handshake_timeout=None if tls is None else HANDSHAKE_S
            )
        except OSError:  # ssl.SSLError and ConnectionError are such
            self._give_place()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin to wait for a request."""
        super().connection_made(cast(asyncio.Transport, transport))
        self._watch = self.loop.call_later(self._server.head_s, self._look_after)

    def connection_lost(self, exc: Exception | None) -> None:
        """Free its place."""
        self._give_place()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Receive a part of a request, and note when its answer begins."""
        was_answered = self._is_answered()
        super().data_received(data)
        if self._is_answered() and not was_answered:
            self._answer_since_s = self.loop.time()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Free its place; sockets are counted separately."""
        self._give_place()
        super().handle_websocket_upgrade(event)

    def on_response_complete(self) -> None:
        """Begin to wait for the next request. Of requests sent together only the first is answered."""
        self._silent_since_s = self.loop.time()
        if self.conn.trailing_data[0]:
            self.transport.close()
        super().on_response_complete()

    def stays_until_s(self) -> float:
        """Return the time until which it may stay if others need its place [s]."""
        return self._answer_since_s + _ANSWER_S if self._is_answered() else self._born_s + self._server.stay_s

    def leave(self) -> None:
        """Close it to free its place."""
        self._give_place()  # at once, because others may come before the connection is lost
        if self._beginning is not None and not self._beginning.done():
            self._beginning.cancel()
        else:
            self.transport.abort()

    def _is_answered(self) -> bool:
        """Return whether a request is complete but its answer is not."""
        return self.cycle is not None and not (self.cycle.response_complete or self.cycle.more_body)

    def _look_after(self) -> None:
        head_s = self._server.head_s
        left_s = head_s if self._is_answered() else self._silent_since_s + head_s - self.loop.time()
        if left_s <= 0.0:
            self.leave()
            return
        self._watch = self.loop.call_later(left_s, self._look_after)

    def _give_place(self) -> None:
        if self._watch is not None:
            self._watch.cancel()
        self._server.open_ones.discard(self)
        self._server.left.set()


class _Socket(WebSocketsSansIOProtocol):
    """A socket that ends soon after it was closed, even if the client does not confirm."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self.close_timeout = STAY_S


def qr_text(text: str) -> str:
    """Return a text as a QR code, light on dark, two rows of the code per line."""
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
    """Return a code without its margin, which differs between versions of OpenCV."""
    rows, columns = np.nonzero(code == 0)
    return code[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]


def _config(app: ASGIApp) -> uvicorn.Config:
    return uvicorn.Config(
        app,
        log_level="critical",
        access_log=False,
        lifespan="off",
        ws=_Socket,
        server_header=False,
        timeout_keep_alive=int(HEAD_S),
        timeout_graceful_shutdown=_SHUTDOWN_S,
        ws_max_size=_QUESTION_BYTES,
        ws_per_message_deflate=False,  # compression does not shrink a JPEG, and takes three times as long as drawing it
        h11_max_incomplete_event_size=_QUESTION_BYTES * 4,
    )


def _tls(place: Place) -> ssl.SSLContext:
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    try:
        context.load_cert_chain(cast(Path, place.certificate), place.key)
    except OSError as error:  # ssl.SSLError is one
        raise ConfigError(f"--certificate {place.certificate}: cannot be used: {error.strerror or error}") from error
    return context


def _kept_access(file: Path) -> Access | None:
    """Return the stored tokens; None if there are none, or if other users could have read them."""
    try:
        facts = file.lstat()
        if not stat.S_ISREG(facts.st_mode) or facts.st_uid != os.getuid() or facts.st_mode & 0o077:
            return None
        return _ACCESS.validate_json(read_bounded(file, MOST_TEXT_BYTES))
    except (OSError, ValueError):
        return None


def _keep_access(file: Path, access: Access) -> None:
    """Store tokens for the next start, readable only by this user, if the folder can be written."""
    part = file.with_name(f"{file.name}.{os.getpid()}")
    with suppress(OSError):
        descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
        with os.fdopen(descriptor, "wb") as content:
            content.write(_ACCESS.dump_json(access))
        part.replace(file)


def _listening(place: Place, usual_port: int = 0) -> socket.socket:
    """Return a listening socket; if any port is allowed, at the usual port if it is free."""
    if usual_port and not place.port:
        with suppress(ConfigError):
            return _listening(replace(place, port=usual_port))
    family = socket.AF_INET6 if ":" in place.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((place.host, place.port))
        listening.listen(_BACKLOG)
    except (OSError, ValueError) as error:  # an impossible host name is a UnicodeError
        listening.close()
        reason = error.strerror if isinstance(error, OSError) else "is no address"
        raise ConfigError(
            f"--listen {place.host[:_SHOWN]}:{place.port}: {reason}; name another port, or 0 for any that is free"
        ) from error
    return listening


def _shown(host: str) -> str:
    """Return an address for a browser: for "all addresses", the one that other machines see."""
    if host in ("0.0.0.0", "::"):
        host = _seen_by_others()
    return f"[{host}]" if ":" in host else host


def _seen_by_others() -> str:
    """Return this machine's address towards other networks, otherwise its name. Nothing is sent for it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        try:
            asked.connect((_ELSEWHERE, 1))
        except OSError:
            return socket.gethostname()
        return str(asked.getsockname()[0])


def _in_time(part: Callable[P, Awaitable[T]]) -> Callable[P, Awaitable[T]]:
    """Give a part of the handling of a request a timeout."""

    async def bounded(*arguments: P.args, **keywords: P.kwargs) -> T:
        async with asyncio.timeout(_REQUEST_TIMEOUT_S):
            return await part(*arguments, **keywords)

    return bounded


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
    """Return the stated length of a body; a body without a length counts as too long."""
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


async def _refuse(refusal: tuple[int, str], scope: Scope, receive: Receive, send: Send) -> None:
    """Answer with a short text; a websocket is refused before it opens."""
    status, text = refusal
    response = PlainTextResponse(text + "\n", status_code=status, headers={"connection": "close"})
    await response(scope, receive, send if scope["type"] == "websocket" else _with_safe_headers(send))
