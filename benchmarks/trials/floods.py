"""Floods of the page, in the clear and by TLS: somebody with a token is answered within two seconds all the same.

A process of its own keeps hundreds of connections at work against `rigctl serve` in one of eight ways; each begins anew
as soon as the page closes it. Meanwhile a page is asked for its state, by a new connection each time.
"""

import asyncio
import json
import math
import multiprocessing
import shutil
import ssl
import subprocess
import sys
import time
from contextlib import suppress
from http import HTTPStatus
from http.client import HTTPConnection, HTTPException, HTTPSConnection
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

from benchmarks.trials.harness import scratch

EXAMPLES = Path(__file__).parents[2] / "examples"
MOST_S = 2.0
_REQUEST_EACH_S = 0.2
_AGAIN_EACH_S = 0.3
_LONGEST_S = 30.0
_HEAD = "HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {token}\r\n"


class Flood(NamedTuple):
    """One way to keep connections at work."""

    first: str  #: Sent at once; some ways know the token.
    again: bytes = b""  #: Sent over and over.
    is_read: bool = True  #: Answers are taken.
    stays: bool = True  #: The connection stays open until the page closes it.
    is_clear: bool = False  #: In the clear even where the page speaks TLS.


FLOODS = {
    "half a handshake": Flood("\x16\x03\x01\x02\x00\x01", is_clear=True),
    "silent connections": Flood(""),
    "heads letter by letter": Flood("GET /?token=", again=b"x"),
    "guessed tokens": Flood("GET /api/state?token=guessed-guessed-guessed HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"),
    "bodies that dawdle": Flood(f"POST /api/regions {_HEAD}Content-Length: 900000\r\n\r\n", again=b"x" * 1000),
    "answers that nobody reads": Flood(f"GET /uPlot.iife.min.js {_HEAD}\r\n" * 20, is_read=False),
    "sockets": Flood(
        f"GET /ws {_HEAD}Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    ),
    "connect and leave": Flood("", stays=False),
}


def run_floods(*, seconds: float = 10.0, together: int = 400, only: str = "") -> bool:
    """Flood a page in each way; return whether every legitimate request was answered in time."""
    worst_s = 0.0
    print(f"{'flood':26} {'':6} {'connections':>11} {'requests':>8} {'slowest answer [s]':>18}")
    with scratch() as folder:
        _make_certificate(folder)
        for is_secure in (False, True):
            with subprocess.Popen(_serving(folder, is_secure=is_secure), stdout=subprocess.PIPE) as process:
                url = json.loads(process.stdout.readline() if process.stdout else b"")["act_url"]
                context = ssl.create_default_context(cafile=folder / "certificate.pem") if is_secure else None
                for name in FLOODS:
                    if only in name:
                        worst_s = max(worst_s, _flooded(name, url, context, seconds=seconds, together=together))
                process.terminate()
    print(f"floods: the slowest legitimate answer took {worst_s:.2f} s, allowed are {MOST_S:g} s")
    return worst_s <= MOST_S


def _make_certificate(folder: Path) -> None:
    words = "req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=127.0.0.1 -addext subjectAltName=IP:127.0.0.1"
    files = ("-out", str(folder / "certificate.pem"), "-keyout", str(folder / "key.pem"))
    subprocess.run(["openssl", *words.split(), *files], check=True, capture_output=True)


def _serving(folder: Path, *, is_secure: bool) -> list[str]:
    shutil.copy(EXAMPLES / "rig-sim.toml", folder)
    shutil.copy(EXAMPLES / "scene-panels.toml", folder)
    words = [sys.executable, "-m", "rigctl", "serve", str(folder / "rig-sim.toml"), "--json"]
    words += ["--sessions", str(folder), "--runs", str(folder / "runs")]
    secure = ["--certificate", str(folder / "certificate.pem"), "--key", str(folder / "key.pem")]
    return [*words, *(secure if is_secure else [])]


def _flooded(name: str, url: str, context: ssl.SSLContext | None, *, seconds: float, together: int) -> float:
    """Return how long the slowest legitimate answer took [s]; infinity where one did not come."""
    spawning = multiprocessing.get_context("fork")
    made = spawning.Value("l", 0)
    flood = spawning.Process(target=lambda: asyncio.run(_flood(name, url, context is not None, together, made)))
    flood.start()
    times_s = []
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        time.sleep(_REQUEST_EACH_S)
        times_s.append(_answer_s(url, context))
    flood.kill()
    flood.join()
    clear = "clear" if context is None else "TLS"
    print(f"{name:26} {clear:6} {made.value:11d} {len(times_s):8d} {max(times_s):18.2f}", flush=True)
    return max(times_s)


def _answer_s(url: str, context: ssl.SSLContext | None) -> float:
    """Return how long the answer to a legitimate request takes [s]."""
    place = urlsplit(url)
    host, port, patience_s = place.hostname or "", place.port, 5.0 * MOST_S
    if context is None:
        connection = HTTPConnection(host, port, timeout=patience_s)
    else:
        connection = HTTPSConnection(host, port, timeout=patience_s, context=context)
    began_s = time.monotonic()
    try:
        connection.request("GET", "/api/state", headers={"Authorization": f"Bearer {_token(url)}"})
        if connection.getresponse().status != HTTPStatus.OK:
            return math.inf
    except (OSError, HTTPException) as error:
        print(f"  {type(error).__name__}: {error}")
        return math.inf
    finally:
        connection.close()
    return time.monotonic() - began_s


async def _flood(name: str, url: str, is_secure: bool, together: int, made: "Synchronized[int]") -> None:
    """Keep so many connections at work for ever."""
    place, flood, context = urlsplit(url), FLOODS[name], ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE

    async def work() -> None:
        secure = context if is_secure and not flood.is_clear else None
        reader, writer = await asyncio.open_connection(place.hostname, place.port, ssl=secure)
        made.value += 1
        try:
            writer.write(flood.first.replace("{token}", _token(url)).encode("latin-1"))
            while flood.stays and not (flood.is_read and reader.at_eof()):
                if flood.is_read:
                    with suppress(TimeoutError):
                        await asyncio.wait_for(reader.read(65536), _AGAIN_EACH_S)
                else:
                    await asyncio.sleep(_AGAIN_EACH_S)
                writer.write(flood.again)
                await writer.drain()
        finally:
            writer.transport.abort()

    async def one() -> None:
        while True:
            with suppress(OSError, TimeoutError):
                await asyncio.wait_for(work(), _LONGEST_S)
            await asyncio.sleep(0.001)

    await asyncio.gather(*(one() for _ in range(together)))


def _token(url: str) -> str:
    return urlsplit(url).query.removeprefix("token=")
