"""What the program itself costs per frame of 782 x 582, beside camera, stage, FITS encoding and the disk.

All interlocks and three regions of 150 x 130 pixels are watched.

Usage: python -m benchmarks.frame_overhead [--frames 200] [--folder DIR] [--watchers 2]

Overhead is the time of the session's thread between two frames, without waiting for the disk's queue, plus the time
of the writer's thread outside of encoding and of the disk: medians over the frames, so that another program's turn on
the processor is not counted. The target is below 5 ms. The same is measured while pages of `rigctl serve` look on: that
must cost the session nothing beyond the noise of the medians.
"""

import argparse
import json
import math
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import CameraSettings, DeviceIdentity, Frame, Move, StagePosition, StageStatus
from rigctl.files.place import SiteSection
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.rig.rig import Rig
from rigctl.runs import writer as run_writer
from rigctl.runs.folder import Journal
from rigctl.session import acquisition
from rigctl.session.acquisition import FrameStore, StoredFrame, WriterThread
from rigctl.session.take import take_session

TARGET_MS = 5.0
_MS = 1e3
# Until a page has begun to ask.
_BEGIN_S = 1.0
_SIGMAS = 3.0
_RIG = {
    "name": "stand-in",
    "stage": {"driver": "ellx", "port": "/dev/null"},
    "polarizer": {"sense": 1, "offset_deg": 0.0},
    "camera": {"address": "none:"},
    "site": SiteSection(latitude_deg=43.0, longitude_deg=-77.0).model_dump(),
}


class Stopwatch:
    """Notes how long functions take by themselves, without what other watched functions take within them."""

    def __init__(self) -> None:
        self.spent_s: dict[str, list[float]] = defaultdict(list)
        self._within = threading.local()

    def watched(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any, **keywords: Any) -> Any:
            outer_s, self._within.s = getattr(self._within, "s", 0.0), 0.0
            begin = time.perf_counter()
            try:
                return function(*arguments, **keywords)
            finally:
                spent_s = time.perf_counter() - begin
                self.spent_s[name].append(spent_s - self._within.s)
                self._within.s = outer_s + spent_s

        return timed


class StandIn:
    """A stage and a camera that take as long as told, and pictures that are there already."""

    def __init__(self, watch: Stopwatch, *, exposure_s: float, move_s: float) -> None:
        self._watch, self._exposure_s, self._move_s = watch, exposure_s, move_s
        generator = np.random.default_rng(1)
        self._pictures = [generator.integers(100, 3000, (582, 782)).astype(np.uint16) for _ in range(4)]
        self._sequence, self._ended_s = 0, 0.0

    def home(self) -> StagePosition:
        return StagePosition(angle_deg=0.0, counts=0)

    def status(self) -> StageStatus:
        return StageStatus(moving=False, homed=True, code=0, meaning="ok")

    def move_to(self, angle_deg: float) -> Move:
        begin = time.perf_counter()
        time.sleep(self._move_s)
        self._watch.spent_s["stage"].append(time.perf_counter() - begin)
        position = StagePosition(angle_deg=angle_deg, counts=0)
        return Move(target_deg=angle_deg, position=position, tries=1, duration_s=self._move_s)

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        self._settings = CameraSettings(exposure_s=exposure_s, gain_db=gain_db, width=782, height=582, bit_depth=12)
        return self._settings

    def take_frame(self, *, timeout_s: float) -> Frame:
        if self._ended_s:
            self._watch.spent_s["between frames"].append(time.perf_counter() - self._ended_s)
        time.sleep(self._exposure_s)
        self._sequence += 1
        now = time.time_ns()
        frame = Frame(
            counts=self._pictures[self._sequence % 4],
            settings=self._settings,
            sequence=self._sequence,
            start_utc_ns=now,
            end_utc_ns=now,
            start_monotonic_ns=time.monotonic_ns(),
        )
        self._ended_s = time.perf_counter()
        return frame


def measure(frames: int, folder: Path, *, exposure_s: float, move_s: float, threaded: bool) -> dict[str, float]:
    """Take a session; return milliseconds per frame by what they were spent on."""
    watch = Stopwatch()
    device: Any = StandIn(watch, exposure_s=exposure_s, move_s=move_s)

    @contextmanager
    def opener() -> Iterator[Rig]:
        identity = DeviceIdentity(model="stand-in", serial_number="1", firmware="0")
        yield Rig(
            stage=device,
            camera=device,
            stage_identity=identity,
            camera_identity=identity,
            present=lambda _: None,
            origin="device",
        )

    take = {"kind": "scene", "exposure_ms": 1, "cycles": frames // 4}
    regions = [
        {"name": f"panel{k}", "rectangle": {"x": 70 + 240 * k, "y": 190, "width": 150, "height": 130}} for k in range(3)
    ]
    session = SessionFile.model_validate(
        {"name": "overhead", "take": [take], "regions": regions, "interlocks": {"disk_free_mb": 0}}
    )
    with _watched(watch, threaded=threaded):
        take_session(RigFile.model_validate(_RIG), session, folder / "run", files={}, opener=opener)
    return _per_frame(watch, exposure_s, frames, threaded=threaded)


@contextmanager
def _watched(watch: Stopwatch, *, threaded: bool) -> Iterator[None]:
    places: list[tuple[Any, str, str]] = [
        (run_writer, "encode_frame", "encoding"),
        (run_writer, "write_durably", "frame on disk"),
        (Journal, "append", "line on disk"),
        (FrameStore, "store", "storing"),
        (WriterThread, "put", "queue"),
    ]
    with ExitStack() as patched:
        for owner, name, what in places:
            patched.enter_context(patch.object(owner, name, watch.watched(what, getattr(owner, name))))
        if not threaded:
            patched.enter_context(patch.object(acquisition, "WriterThread", _Inline))
        yield


class _Inline(WriterThread):
    """Stores each frame before the next is taken: what the thread is compared with."""

    def put(self, *frames: StoredFrame) -> None:
        self._store(frames)


@contextmanager
def looked_at(run: Path, watchers: int) -> Iterator[None]:
    """Let so many pages look at a run that is yet to come, from processes of their own."""
    if not watchers:
        yield
        return
    watch = [sys.executable, "-m", "rigctl", "serve", str(run), "--json"]
    with subprocess.Popen(watch, stdout=subprocess.PIPE, text=True) as page:
        address = json.loads(page.stdout.readline() if page.stdout else "{}")["look_url"]
        look = [sys.executable, "-m", "benchmarks.page_pictures", "--look", address]
        pages = [subprocess.Popen(look) for _ in range(watchers)]
        time.sleep(_BEGIN_S)
        try:
            yield
        finally:
            for one in (*pages, page):
                one.terminate()
                one.wait()


def _per_frame(watch: Stopwatch, exposure_s: float, frames: int, *, threaded: bool) -> dict[str, float]:
    spent_s = {name: np.array(values) for name, values in watch.spent_s.items()}

    def mean_ms(name: str) -> float:
        return float(spent_s[name].sum() / frames * _MS)

    whole = {"frame to frame, mean": mean_ms("between frames") + exposure_s * _MS}
    if not threaded:
        return whole
    # Between two frames lie: the rest of the one, its way into the queue, the move of the next.
    session_s = spent_s["between frames"] - spent_s["stage"][1:] - spent_s["queue"][:-1]
    session_ms, writer_ms = statistics.median(session_s) * _MS, statistics.median(spent_s["storing"]) * _MS
    error_ms = math.hypot(*(_median_error(values) * _MS for values in (session_s, spent_s["storing"])))
    return whole | {
        "encoding": statistics.median(spent_s["encoding"]) * _MS,
        "disk, mean": mean_ms("frame on disk") + mean_ms("line on disk"),
        "session's own": session_ms,
        "writer's own": writer_ms,
        "overhead": session_ms + writer_ms,
        "overhead's std error": error_ms,
    }


def _median_error(values: NDArray[np.float64]) -> float:
    """Return the standard error of a median, by the deviation of the middle half."""
    low, high = np.quantile(values, [0.25, 0.75])
    return 1.253 * float(high - low) / 1.349 / math.sqrt(values.size)


def main() -> int:
    """Print the cost per frame; return 1 where the program's own is above its target."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--folder", type=Path, default=None, help="On the disk that is to be measured.")
    parser.add_argument("--watchers", type=int, default=2)
    arguments = parser.parse_args()
    cases = {
        "writer's thread, exposure 30 ms, move 30 ms": (0.03, 0.03, True, 0),
        f"the same, {arguments.watchers} pages looking": (0.03, 0.03, True, arguments.watchers),
        "no thread, exposure 30 ms, move 30 ms": (0.03, 0.03, False, 0),
        "writer's thread, no exposure, no move": (0.0, 0.0, True, 0),
    }
    found: dict[str, dict[str, float]] = {}
    for title, (exposure_s, move_s, threaded, watchers) in cases.items():
        with tempfile.TemporaryDirectory(dir=arguments.folder) as folder, looked_at(Path(folder) / "run", watchers):
            found[title] = measure(
                arguments.frames, Path(folder), exposure_s=exposure_s, move_s=move_s, threaded=threaded
            )
        print(f"{title}, ms per frame:")
        for name, milliseconds in found[title].items():
            print(f"  {name:<26}{milliseconds:7.2f}")
    alone, looked, *_ = found.values()
    overhead, more = alone["overhead"], looked["overhead"] - alone["overhead"]
    noise = _SIGMAS * math.hypot(alone["overhead's std error"], looked["overhead's std error"])
    print(f"overhead {overhead:.2f} ms, target {TARGET_MS:g} ms: {'met' if overhead < TARGET_MS else 'MISSED'}")
    print(f"pages cost {more:+.2f} ms, noise {noise:.2f} ms: {'met' if more < noise else 'MISSED'}")
    return 0 if overhead < TARGET_MS and more < noise else 1


if __name__ == "__main__":
    sys.exit(main())
