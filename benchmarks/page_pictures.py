"""Pictures a second that a page gets over its socket, how late they are, and what each costs the processor.

Usage: python -m benchmarks.page_pictures [--seconds 4]

The page's own code answers, in a process of its own, and draws every picture anew: frames as they come from a camera,
and maps of four new frames each. Where the machine has other work, the processor's time tells the limit.
"""

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray
from websockets.sync.client import connect

from rigctl.web.pictures import MAP_WIDTH, MAPS, MOST_WIDTH, CyclePictures, Picture, map_pictures, picture_of, smaller
from rigctl.web.server import PageServer, Place, page_app

ANGLES_RAD = np.deg2rad([0.0, 45.0, 90.0, 135.0])
SIZES = {"782 x 582": (582, 782), "2448 x 2048": (2048, 2448)}
LEAST = {("782 x 582", "frame"): 30.0, ("2448 x 2048", "dolp"): 10.0}
MOST_P95_MS = 50.0


class Fresh:
    """Stands for a run whose every picture is a new one."""

    def __init__(self, height: int, width: int) -> None:
        rng = np.random.default_rng(1)
        self._frames: list[NDArray[np.uint16]] = [
            rng.normal(1000.0 + 100.0 * k, 20.0, (height, width)).round().astype(np.uint16) for k in range(4)
        ]
        self._sequence = 0

    def newest_sequence(self, _name: str) -> int:
        self._sequence += 1
        return self._sequence

    def picture(self, name: str, *, zebra: bool, dolp_top: float) -> Picture:
        if name not in MAPS:
            counts = self._frames[self._sequence % 4]
            return picture_of(counts, saturation_dn=4095.0, most_width=MOST_WIDTH, zebra=zebra)
        frames = np.stack([smaller(counts, most_width=MAP_WIDTH) for counts in self._frames])
        cycle = CyclePictures(frames=frames, angles_rad=ANGLES_RAD, dark_dn=np.zeros(4), extinction_ratio=np.inf)
        return map_pictures(cycle, dolp_top=dolp_top)[name]


class FreshSource:
    """The page's source of it."""

    def __init__(self, height: int, width: int) -> None:
        self._fresh = Fresh(height, width)

    def rows(self) -> None:
        return None

    def reader(self, _run: str) -> Fresh:
        return self._fresh

    def document(self, _run: str, _name: str) -> None:
        return None


def serve(size: str) -> None:
    """Serve a page of fresh pictures until the process is ended."""
    server = PageServer(page_app(FreshSource(*SIZES[size])), Place(), can_act=False)
    print(json.dumps({"look_url": server.addresses.look_url}), flush=True)
    server.run()


def pull(address: str, name: str, *, seconds: float) -> list[float]:
    """Return how long each picture took [s]."""
    place = urlsplit(address)
    headers = {"Authorization": "Bearer " + place.query.removeprefix("token=")}
    spent_s: list[float] = []
    with connect(f"ws://{place.netloc}/ws", additional_headers=headers, max_size=None) as socket:
        end_s = time.perf_counter() + seconds
        while time.perf_counter() < end_s:
            begin_s = time.perf_counter()
            socket.send(json.dumps({"want": "picture", "name": name}))
            socket.recv()
            spent_s.append(time.perf_counter() - begin_s)
    return spent_s


def look(address: str, *, until: threading.Event | None = None) -> None:
    """Ask as the page asks: the state each second, and each picture that is new."""
    place = urlsplit(address)
    headers = {"Authorization": "Bearer " + place.query.removeprefix("token=")}
    known: dict[str, int] = {}
    with connect(f"ws://{place.netloc}/ws", additional_headers=headers, max_size=None) as socket:
        told_s = 0.0
        while until is None or not until.is_set():
            if time.monotonic() - told_s > 1.0:
                socket.send(json.dumps({"want": "state"}))
                socket.recv()
                told_s = time.monotonic()
            is_new = False
            for name in ("45", *MAPS):
                socket.send(json.dumps({"want": "picture", "name": name, "after": known.get(name)}))
                answer = bytes(socket.recv(decode=False))
                head = json.loads(answer[4 : 4 + int.from_bytes(answer[:4], "big")])
                is_new |= head.get("sequence") != known.get(name)
                known[name] = head.get("sequence")
            time.sleep(0.0 if is_new else 0.25)


def processor_s(process: int) -> float:
    """Return the processor's time that a process has taken [s]."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measured(size: str, name: str, *, watchers: int, seconds: float) -> bool:
    """Print what a page gives to so many who look at once; return whether that is enough."""
    command = [sys.executable, "-m", "benchmarks.page_pictures", "--serve", size]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        address = json.loads(process.stdout.readline() if process.stdout else "{}")["look_url"]
        pull(address, name, seconds=0.3)
        before_s, spent_s = processor_s(process.pid), []
        threads = [
            threading.Thread(target=lambda: spent_s.extend(pull(address, name, seconds=seconds)))
            for _ in range(watchers)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        cost_ms = 1e3 * (processor_s(process.pid) - before_s) / len(spent_s)
        process.terminate()
    rate, (p50_ms, p95_ms) = len(spent_s) / seconds, 1e3 * np.quantile(spent_s, [0.5, 0.95])
    print(
        f"{size:<12} {name:<6} {watchers} looking: {rate:5.0f} a second, median {p50_ms:5.1f} ms, p95 {p95_ms:5.1f} ms"
        f", {cost_ms:5.1f} ms of processor each"
    )
    is_late = (size, name) == ("782 x 582", "frame") and watchers == 1 and p95_ms > MOST_P95_MS
    return rate >= LEAST.get((size, name), 0.0) and not is_late


def main() -> int:
    """Print pictures a second; return 1 where they are too few or too late."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--serve", choices=list(SIZES), help=argparse.SUPPRESS)
    parser.add_argument("--look", metavar="ADDRESS", help="Look at a page as a browser does, until ended.")
    arguments = parser.parse_args()
    if arguments.look:
        look(arguments.look)
    if arguments.serve:
        serve(arguments.serve)
        return 0
    cases = [(size, name, watchers) for size in SIZES for name in ("frame", "dolp") for watchers in (1, 2)]
    found = [measured(size, name, watchers=n, seconds=arguments.seconds) for size, name, n in cases]
    print("met" if all(found) else "MISSED")
    return 0 if all(found) else 1


if __name__ == "__main__":
    sys.exit(main())
