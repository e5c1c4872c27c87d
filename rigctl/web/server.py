"""Serving a page: where it listens, and until when."""

import os
import socket
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import uvicorn
from starlette.types import ASGIApp

from rigctl.errors import ConfigError
from rigctl.web.access import Access, Guard, names_of_this_machine

_BACKLOG = 256
_KEEP_ALIVE_S = 10
_SHUTDOWN_S = 2
_QUESTION_BYTES = 4096
# Below everything that a session does.
_NICENESS = 10


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a page is.

    Attributes
    ----------
    host : str
        Address of this machine to listen at; 127.0.0.1 is for this machine alone.
    port : int
        0: any that is free.
    certificate, key : Path or None
        Files of a TLS certificate and its key; without them it is plain HTTP.
    """

    host: str = "127.0.0.1"
    port: int = 0
    certificate: Path | None = None
    key: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Addresses:
    """What to type into a browser: the one may look, the other may act as well."""

    look_url: str
    act_url: str | None


def serve_page(app: ASGIApp, place: Place, access: Access, *, can_act: bool, told: Callable[[Addresses], None]) -> None:
    """Serve a page until somebody presses Ctrl-C.

    Parameters
    ----------
    app : ASGI application
        The page, without a guard.
    place : Place
        Where.
    access : Access
        Its tokens.
    can_act : bool
        Whether the page has hands.
    told : callable
        Told the addresses once the page is there.

    Raises
    ------
    ConfigError
        Nothing can listen there, or the certificate cannot be used.
    """
    listening = _listening(place)
    port = int(listening.getsockname()[1])
    is_secure = place.certificate is not None
    guard = Guard(app, access, hosts=names_of_this_machine(place.host), port=port, is_secure=is_secure)
    config = uvicorn.Config(
        guard,
        log_level="critical",
        access_log=False,
        lifespan="off",
        server_header=False,
        timeout_keep_alive=_KEEP_ALIVE_S,
        timeout_graceful_shutdown=_SHUTDOWN_S,
        ws_max_size=_QUESTION_BYTES,
        h11_max_incomplete_event_size=_QUESTION_BYTES * 4,
        ssl_certfile=place.certificate,
        ssl_keyfile=place.key,
    )
    try:
        config.load()
    except OSError as error:  # ssl.SSLError is one
        raise ConfigError(f"--certificate {place.certificate}: cannot be used: {error.strerror or error}") from error
    base = f"http{'s' if is_secure else ''}://{_shown(place.host)}:{port}/?token="
    told(Addresses(look_url=base + access.look, act_url=base + access.act if can_act else None))
    os.nice(_NICENESS)
    with listening:
        try:
            uvicorn.Server(config).run(sockets=[listening])
        except KeyboardInterrupt:
            return


def _listening(place: Place) -> socket.socket:
    family = socket.AF_INET6 if ":" in place.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((place.host, place.port))
        listening.listen(_BACKLOG)
    except OSError as error:
        listening.close()
        raise ConfigError(
            f"--listen {place.host}:{place.port}: {error.strerror}; name another port, or 0 for any that is free"
        ) from error
    return listening


def _shown(host: str) -> str:
    """Return how an address stands in a browser; one that means all of this machine's by this machine's name."""
    if host in ("0.0.0.0", "::"):
        return socket.gethostname()
    return f"[{host}]" if ":" in host else host
