"""Pictures a second that a page gets over its socket, and what making one costs, beside a plain JPEG of the same frame.

Run: python benchmarks/page_pictures.py
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
from websockets.sync.client import connect

from rigctl.web.pictures import CyclePictures, map_pictures, picture_of, smaller
from tests.rigctl.made_runs import at, make_run

SECONDS = 4.0
RNG = np.random.default_rng(1)


def frame(height: int, width: int) -> np.ndarray:
    return RNG.normal(1000.0, 20.0, (height, width)).round().astype(np.uint16)


def milliseconds(work, times: int = 20) -> float:
    work()
    spent = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        spent.append(time.perf_counter() - start)
    return 1e3 * float(np.median(spent))


def made(height: int, width: int) -> None:
    counts = frame(height, width)
    small = smaller(counts, most_width=800)
    cycle = CyclePictures(
        frames=np.stack([small] * 4), angles_rad=np.deg2rad([0.0, 45.0, 90.0, 135.0]), dark_dn=np.zeros(4),
        extinction_ratio=np.inf,
    )  # fmt: skip
    plain = milliseconds(lambda: cv2.imencode(".jpg", np.clip(small / 8.0, 0, 255).astype(np.uint8)))
    shown = milliseconds(lambda: picture_of(counts, saturation_dn=4095.0, most_width=800, zebra=True))
    maps = milliseconds(lambda: map_pictures(cycle, dolp_top=1.0))
    print(
        f"{width} x {height}: frame {shown:.1f} ms, three maps {maps:.1f} ms, plain JPEG of 800 columns {plain:.1f} ms"
    )


def pulled(folder: Path) -> None:
    frames = [(at(angle, cycle=0, exposure_s=0.01), frame(582, 782)) for angle in (0.0, 45.0, 90.0, 135.0)]
    make_run(folder / "run", frames)
    command = [sys.executable, "-m", "rigctl", "watch", str(folder / "run"), "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        place = urlsplit(json.loads(process.stdout.readline())["look_url"])
        headers = {"Authorization": "Bearer " + place.query.removeprefix("token=")}
        with connect(f"ws://{place.netloc}/ws", additional_headers=headers, max_size=None) as socket:
            spent, end = [], time.perf_counter() + SECONDS
            while time.perf_counter() < end:
                start = time.perf_counter()
                # Another scale each time, so that no picture is a remembered one.
                socket.send(json.dumps({"want": "picture", "name": "dolp", "dolp_top": 0.1 + 0.8 * RNG.random()}))
                socket.recv()
                spent.append(time.perf_counter() - start)
        process.terminate()
    p50, p95 = 1e3 * np.quantile(spent, [0.5, 0.95])
    print(f"maps of DoLP over the socket: {len(spent) / SECONDS:.0f} a second, median {p50:.1f} ms, p95 {p95:.1f} ms")


def main() -> None:
    made(582, 782)
    made(2048, 2448)
    with tempfile.TemporaryDirectory() as folder:
        pulled(Path(folder))


if __name__ == "__main__":
    main()
