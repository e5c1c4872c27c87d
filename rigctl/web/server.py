"""Serving a page: where it listens, and until when."""

import os
import socket
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

import uvicorn
from starlette.types import ASGIApp

from rigctl.errors import ConfigError
from rigctl.web.access import Access, Guard, is_loopback, names_of_this_machine
from rigctl.web.connections import HEAD_S, connection_class

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
    """Listens for a page from the moment it is made. A context manager: it answers in a thread of its own meanwhile.

    Parameters
    ----------
    app : ASGI application
        The page, without a guard.
    place : Place
        Where.
    can_act : bool
        Whether the page has hands.

    Raises
    ------
    ConfigError
        Nothing can listen there, or the certificate cannot be used.
    """

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
