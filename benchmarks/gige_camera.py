"""Frames of a simulated GigE camera, in a process of its own, taken one by one onto the disk."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator

import numpy as np

from benchmarks.timing import Row
from drivers.cameras.aravis import load_aravis
from drivers.cameras.gige import open_gige
from drivers.errors import NotConnectedError
from drivers.interfaces import CameraSettings, DeviceIdentity, Frame

ADDRESS = "127.0.0.1"
_WIDTH, _HEIGHT = 782, 582
_EXPOSURE_S = 0.001
_FRAMES = 200
_GIGABIT_PER_S = 1e9


class OnePicture:
    """A source that has its one picture ready; one pixel tells it from the last."""

    def __init__(self, width: int = _WIDTH, height: int = _HEIGHT) -> None:
        self._counts = np.random.default_rng(1).integers(0, 2048, (height, width), dtype=np.uint16)
        self.configure(exposure_s=_EXPOSURE_S, gain_db=0.0)

    def __enter__(self) -> "OnePicture":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        return DeviceIdentity(model="one picture", serial_number="1", firmware="none")

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        height, width = self._counts.shape
        self._settings = CameraSettings(
            exposure_s=exposure_s, gain_db=gain_db, width=width, height=height, bit_depth=12
        )
        return self._settings

    def take_frame(self, *, timeout_s: float) -> Frame:
        self._counts[0, 0] ^= 1
        return Frame(
            counts=self._counts,
            settings=self._settings,
            sequence=0,
            start_utc_ns=0,
            end_utc_ns=0,
            start_monotonic_ns=0,
        )

    def close(self) -> None:
        pass


def serve(width: int = _WIDTH, height: int = _HEIGHT) -> None:
    """Serve the camera until it is ended."""
    import signal

    from sim_devices.cameras.gige_server import serve_gige_camera

    with serve_gige_camera(OnePicture(width, height), address=ADDRESS):
        print("ready", flush=True)
        signal.pause()


def gige_rows() -> Iterator[Row]:
    """Time taking a frame, on the clock; nothing where libaravis is missing."""
    try:
        load_aravis()
    except NotConnectedError:
        return
    words = [sys.executable, "-c", "from benchmarks.gige_camera import serve; serve()"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            if process.stdout is None or process.stdout.readline() != "ready\n":
                raise OSError("the simulated camera did not start")
            taking_s = _taken_s()
        finally:
            process.kill()
    yield Row(
        work="a Mono12 frame of 782 x 582 from a simulated GigE camera, on the clock", ours=1e3 * taking_s, unit="ms",
        beside="exposure and its bytes at 1 Gbit/s",
        theirs=1e3 * (_EXPOSURE_S + 16.0 * _WIDTH * _HEIGHT / _GIGABIT_PER_S), most_ratio=2.0,
    )  # fmt: skip


def _taken_s() -> float:
    spent_s = []
    with open_gige(f"{ADDRESS}?pixel_format=Mono12") as camera, tempfile.TemporaryFile() as out:
        camera.configure(exposure_s=_EXPOSURE_S, gain_db=0.0)
        for _ in range(_FRAMES):
            start_s = time.perf_counter()
            frame = camera.take_frame(timeout_s=10.0)
            spent_s.append(time.perf_counter() - start_s)
            out.write(frame.counts.tobytes())
    return float(np.median(spent_s))
