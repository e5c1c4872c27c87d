"""How many may be connected to a page and for how long, in the clear and by TLS, on this machine."""

import asyncio
import shutil
import socket
import ssl
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from rigctl.web.page import Sockets
from rigctl.web.server import BoundedServer

ASK = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"
HEAD_S = 0.4


@contextmanager
def served(tls: ssl.SSLContext | None = None) -> Iterator[tuple[str, int]]:
    """Serve a page to three connections at a time, each silent for 0.4 s at most."""
    app = Starlette(routes=[Route("/", lambda request: PlainTextResponse(f"here by {request.url.scheme}"))])
    config = uvicorn.Config(app, log_level="critical", lifespan="off", ws="none")
    server = BoundedServer(config, tls, most=3, stay_s=0.1, head_s=HEAD_S)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        thread = threading.Thread(target=server.run, args=([listening],), daemon=True)
        thread.start()
        yield listening.getsockname()
        server.should_exit = True
        thread.join()


@pytest.fixture
def place() -> Iterator[tuple[str, int]]:
    with served() as found:
        yield found


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
def test_beyond_the_limit_the_oldest_connection_is_closed(place: tuple[str, int], begin: bytes) -> None:
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


def test_a_request_in_a_burst_of_silent_connections_is_answered(place: tuple[str, int]) -> None:
    silent = [socket.create_connection(place) for _ in range(20)]
    with socket.create_connection(place) as asking:
        asking.sendall(ASK)
        silent += [socket.create_connection(place) for _ in range(20)]
        assert b"here" in answer(asking)
    for one in silent:
        one.close()


def test_a_request_that_does_not_end_in_time_is_closed(place: tuple[str, int]) -> None:
    with socket.create_connection(place) as slow, socket.create_connection(place) as quick:
        slow.sendall(ASK[:10])
        quick.sendall(ASK)
        slow.sendall(ASK[10:12])
        assert answer(slow) == b""
        # After an answer the time begins anew, and ends too.
        assert answer(quick).endswith(b"here by http")


def test_of_requests_that_are_sent_together_only_the_first_is_answered(place: tuple[str, int]) -> None:
    with socket.create_connection(place) as greedy:
        greedy.sendall(ASK * 3)
        assert answer(greedy).count(b"here") == 1


@pytest.fixture
def certificate(tmp_path: Path) -> tuple[Path, Path]:
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl for a certificate")
    files = tmp_path / "certificate.pem", tmp_path / "key.pem"
    words = f"req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost -out {files[0]} -keyout {files[1]}"
    subprocess.run(["openssl", *words.split()], check=True, capture_output=True)
    return files


def test_unfinished_handshakes_are_counted_and_end_in_time(
    certificate: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigctl.web.server.HANDSHAKE_S", HEAD_S)
    secure = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    secure.load_cert_chain(*certificate)
    trusting = ssl.create_default_context(cafile=certificate[0])
    with served(secure) as place:
        half = []
        for _ in range(10):
            half.append(socket.create_connection(place))
            half[-1].sendall(b"\x16\x03\x01\x02\x00\x01")  # six bytes of a ClientHello
        # They are counted as they are accepted: all but three are closed for those that follow.
        assert [answer(one) for one in half[:7]] == [b""] * 7
        plain = socket.create_connection(place)
        with trusting.wrap_socket(plain, server_hostname="localhost") as whole:
            whole.sendall(ASK.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))
            assert answer(whole).endswith(b"here by https")
        # Nobody else comes, and the last ones are closed by the time that a handshake may take.
        assert answer(half[-1]) == b""
        for one in half:
            one.close()


def test_of_too_many_sockets_the_longest_silent_is_closed() -> None:
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
