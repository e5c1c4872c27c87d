"""Who may look and who may act: tokens, the cookie they are exchanged for, and what a request must show of itself."""

import asyncio
import ipaddress
import secrets
import socket
from collections.abc import Iterable
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import Literal
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

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
    """The two keys of a page.

    Attributes
    ----------
    look, act : str
        Tokens: the first opens the page, the second opens it with hands.
    """

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
    """Stands before the page and lets through what shows a token, asks for this host and comes from its own page.

    Parameters
    ----------
    app : ASGI application
        The page. A request that comes through has its right, "look" or "act", in ``scope["state"]["right"]``.
    access : Access
        The tokens.
    hosts : iterable of str
        Names by which this machine may be asked. An address in numbers always may: who rebinds a name needs a name.
    port : int
        Where the page is; cookies are told apart by it.
    is_secure : bool
        The page is served by TLS.
    """

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
