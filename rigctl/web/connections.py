"""How many may be connected to a page and for how long: whoever says nothing makes room for who does."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

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
    """Return what one server answers its connections by.

    Parameters
    ----------
    most : int
        How many may be open before they become sockets. One more, and the one that has said nothing for longest is
        closed.
    head_s : float
        How long one may be silent, or send bits of a request's head [s].
    """
    return type("OwnConnection", (Connection,), {"open_ones": [], "most": most, "head_s": head_s})


class Sockets:
    """The open sockets of a page. One too many, and the one that has asked nothing for longest is closed.

    Parameters
    ----------
    most : int
        How many may be open.
    """

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
