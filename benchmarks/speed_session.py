"""What the program itself costs per frame, beside camera, stage, FITS encoding and the disk; and a GigE camera to disk.

Cost of a frame is the time of the session's thread between two frames, without waiting for the disk's queue, plus the
time of the writer's thread outside of encoding and of the disk, on the clock: medians over the frames, so that another
program's turn on the processor is not counted. Exposure and move take 10 ms each, all interlocks and three regions are
watched, and two pages of `rigctl serve` look on.
"""

import json
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
from urllib.parse import urlsplit

import numpy as np
from websockets.sync.client import connect

from benchmarks.gige_camera import gige_rows
from benchmarks.timing import Row
from drivers.interfaces import CameraSettings, DeviceIdentity, Frame, Move, StagePosition, StageStatus
from rigctl.files.place import SiteSection
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.rig.rig import Rig
from rigctl.runs import writer as run_writer
from rigctl.runs.folder import Journal
from rigctl.session.acquisition import FrameStore, WriterThread
from rigctl.session.take import take_session
from rigctl.web.pictures import MAPS

_FRAMES = 120
_WATCHERS = 2
_WORK_S = 0.01
_BEGIN_S = 1.0  # until a page has begun to ask
_MOST_MS = {(582, 782): 2.5, (2048, 2448): 6.0}
_RIG = {
    "name": "stand-in",
    "stage": {"driver": "ellx", "port": "/dev/null"},
    "polarizer": {"sense": 1, "offset_deg": 0.0},
    "camera": {"address": "none:"},
    "site": SiteSection(latitude_deg=43.0, longitude_deg=-77.0).model_dump(),
}


def rows() -> Iterator[Row]:
    """Time sessions of two sizes of picture, then a camera on the network."""
    for shape, most in _MOST_MS.items():
        with tempfile.TemporaryDirectory() as folder, _looked_at(Path(folder) / "run"):
            cost_ms = _cost_ms(Path(folder), shape)
        yield Row(
            work=f"program's own cost of a frame, {shape[1]} x {shape[0]}, {_WATCHERS} pages looking",
            ours=cost_ms, unit="ms", most=most,
        )  # fmt: skip
    yield from gige_rows()


class _Stopwatch:
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


class _StandIn:
    """A stage and a camera that take as long as told, and pictures that are there already."""

    def __init__(self, watch: _Stopwatch, shape: tuple[int, int]) -> None:
        self._watch, self._shape = watch, shape
        generator = np.random.default_rng(1)
        self._pictures = [generator.integers(100, 3000, shape).astype(np.uint16) for _ in range(4)]
        self._sequence, self._ended_s = 0, 0.0

    def home(self) -> StagePosition:
        return StagePosition(angle_deg=0.0, counts=0)

    def status(self) -> StageStatus:
        return StageStatus(moving=False, homed=True, code=0, meaning="ok")

    def move_to(self, angle_deg: float) -> Move:
        begin = time.perf_counter()
        time.sleep(_WORK_S)
        self._watch.spent_s["stage"].append(time.perf_counter() - begin)
        position = StagePosition(angle_deg=angle_deg, counts=0)
        return Move(target_deg=angle_deg, position=position, tries=1, duration_s=_WORK_S)

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        height, width = self._shape
        self._settings = CameraSettings(
            exposure_s=exposure_s, gain_db=gain_db, width=width, height=height, bit_depth=12
        )
        return self._settings

    def take_frame(self, *, timeout_s: float) -> Frame:
        if self._ended_s:
            self._watch.spent_s["between frames"].append(time.perf_counter() - self._ended_s)
        time.sleep(_WORK_S)
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


def _cost_ms(folder: Path, shape: tuple[int, int]) -> float:
    """Take a session and return the cost of a frame."""
    watch = _Stopwatch()
    device: Any = _StandIn(watch, shape)
    identity = DeviceIdentity(model="stand-in", serial_number="1", firmware="0")

    @contextmanager
    def opener() -> Iterator[Rig]:
        yield Rig(
            stage=device, camera=device, stage_identity=identity, camera_identity=identity, present=lambda _: None,
            origin="device",
        )  # fmt: skip

    regions = [
        {"name": f"panel{k}", "rectangle": {"x": 70 + 240 * k, "y": 190, "width": 150, "height": 130}} for k in range(3)
    ]
    session = SessionFile.model_validate(
        {
            "name": "overhead",
            "take": [{"kind": "scene", "exposure_ms": 1, "cycles": _FRAMES // 4}],
            "regions": regions,
            "interlocks": {"disk_free_mb": 0},
        }
    )
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
        take_session(RigFile.model_validate(_RIG), session, folder / "run", files={}, opener=opener)
    spent_s = {name: np.array(values) for name, values in watch.spent_s.items()}
    # Between two frames lie: the rest of the one, its way into the queue, the move of the next.
    session_s = spent_s["between frames"] - spent_s["stage"][1:] - spent_s["queue"][:-1]
    return 1e3 * (statistics.median(session_s) + statistics.median(spent_s["storing"]))


@contextmanager
def _looked_at(run: Path) -> Iterator[None]:
    """Let pages look at a run that is yet to come, from processes of their own."""
    watch = [sys.executable, "-m", "rigctl", "serve", str(run), "--json"]
    with subprocess.Popen(watch, stdout=subprocess.PIPE, text=True) as page:
        address = json.loads(page.stdout.readline() if page.stdout else "{}")["look_url"]
        look = [sys.executable, "-c", "import sys, benchmarks.speed_session as s; s.look(sys.argv[1])", address]
        pages = [subprocess.Popen(look) for _ in range(_WATCHERS)]
        time.sleep(_BEGIN_S)
        try:
            yield
        finally:
            for one in (*pages, page):
                one.terminate()
                one.wait()


def look(address: str) -> None:
    """Ask as the page asks, until ended: the state each second, and each picture that is new."""
    place = urlsplit(address)
    headers = {"Authorization": "Bearer " + place.query.removeprefix("token=")}
    known: dict[str, int] = {}
    with connect(f"ws://{place.netloc}/ws", additional_headers=headers, max_size=None) as socket:
        told_s = 0.0
        while True:
            if time.monotonic() - told_s > 1.0:
                socket.send(json.dumps({"want": "state"}))
                socket.recv()
                told_s = time.monotonic()
            is_new = False
            for name in ("45", *MAPS):
                socket.send(json.dumps({"want": "picture", "name": name, "after": known.get(name)}))
                head_and_picture = bytes(socket.recv(decode=False))
                head = json.loads(head_and_picture[4 : 4 + int.from_bytes(head_and_picture[:4], "big")])
                is_new |= head.get("sequence") != known.get(name)
                known[name] = head.get("sequence")
            time.sleep(0.0 if is_new else 0.25)
