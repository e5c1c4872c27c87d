"""How many may be connected to a page and for how long, with a small server on this machine."""

import asyncio
import socket
import threading
from collections.abc import Iterator

import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from rigctl.web.page import Sockets
from rigctl.web.server import connection_class

ASK = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"
HEAD_S = 0.4


@pytest.fixture
def place() -> Iterator[tuple[str, int]]:
    """Serve a page to three connections at a time, each silent for 0.4 s at most."""
    app = Starlette(routes=[Route("/", lambda _: PlainTextResponse("here"))])
    http = connection_class(most=3, head_s=HEAD_S)
    server = uvicorn.Server(uvicorn.Config(app, log_level="critical", lifespan="off", http=http, ws="none"))
    with socket.create_server(("127.0.0.1", 0)) as listening:
        thread = threading.Thread(target=server.run, args=([listening],), daemon=True)
        thread.start()
        yield listening.getsockname()
        server.should_exit = True
        thread.join()


def answer(one: socket.socket) -> bytes:
    """Return what comes until the other side closes."""
    one.settimeout(10.0)
    told = b""
    try:
        while more := one.recv(4096):
            told += more
    except ConnectionError:
        pass
    return told


@pytest.mark.parametrize("begin", [b"", b"GET / HTTP/1.1\r\nHost: x\r\n"])
def test_one_too_many_closes_whoever_has_been_silent_for_longest(place: tuple[str, int], begin: bytes) -> None:
    silent = []
    for _ in range(3):
        silent.append(socket.create_connection(place))
        silent[-1].sendall(begin)
    with socket.create_connection(place) as fourth:
        fourth.sendall(ASK)
        assert b"here" in answer(fourth)
    assert answer(silent[0]) == b""
    for one in silent:
        one.close()


def test_who_does_not_end_a_request_is_closed_however_it_goes_on(place: tuple[str, int]) -> None:
    with socket.create_connection(place) as slow, socket.create_connection(place) as quick:
        slow.sendall(ASK[:10])
        quick.sendall(ASK)
        slow.sendall(ASK[10:12])
        assert answer(slow) == b""
        # After an answer the time begins anew, and ends too.
        assert answer(quick).endswith(b"here")


def test_of_too_many_sockets_the_one_that_asks_least_gives_its_place() -> None:
    async def whole() -> list[str]:
        sockets, told = Sockets(most=2), []

        async def one(name: str) -> None:
            try:
                with sockets.place():
                    await asyncio.sleep(0)
                    if name == "first":
                        sockets.has_asked()
                    await asyncio.sleep(30)
            except asyncio.CancelledError:
                told.append(name)

        tasks = [asyncio.create_task(one(name)) for name in ("first", "second")]
        for _ in range(3):
            await asyncio.sleep(0.01)
        tasks.append(asyncio.create_task(one("third")))
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        found = list(told)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return found

    assert asyncio.run(whole()) == ["second"]
