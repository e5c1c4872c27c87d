"""How many Mono12 frames of 782 x 582 a second go from a simulated GigE camera to durable files, and where time goes.

The camera runs in a process of its own, with pictures that cost it nothing; camera and driver share this machine.
Usage: python benchmarks/gige_sustained.py [--frames 300] [--folder /tmp]
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from drivers.cameras.gige import open_gige
from drivers.interfaces import CameraSettings, DeviceIdentity, Frame

ADDRESS = "127.0.0.1"
WIDTH, HEIGHT = 782, 582
EXPOSURE_S = 0.001


class OnePicture:
    """A source that has its one picture ready; one pixel tells it from the last."""

    def __init__(self, width: int = WIDTH, height: int = HEIGHT) -> None:
        self._counts = np.random.default_rng(1).integers(0, 2048, (height, width), dtype=np.uint16)
        self.configure(exposure_s=EXPOSURE_S, gain_db=0.0)

    def __enter__(self) -> "OnePicture":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        return DeviceIdentity(model="one picture", serial_number="1", firmware="none")

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        self._settings = CameraSettings(
            exposure_s=exposure_s,
            gain_db=gain_db,
            width=self._counts.shape[1],
            height=self._counts.shape[0],
            bit_depth=12,
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


def serve(width: int = WIDTH, height: int = HEIGHT) -> None:
    """Serve the camera until it is ended."""
    import signal

    from sim_devices.cameras.gige_server import serve_gige_camera

    with serve_gige_camera(OnePicture(width, height), address=ADDRESS):
        print("ready", flush=True)
        signal.pause()


def measure(frames: int, folder: Path) -> None:
    """Take and store frames one by one, and print the shares of time."""
    taking_s, writing_s = [], []
    with open_gige(f"{ADDRESS}?pixel_format=Mono12") as camera, tempfile.TemporaryDirectory(dir=folder) as out:
        camera.configure(exposure_s=EXPOSURE_S, gain_db=0.0)
        cpu_s, start_s = time.process_time(), time.perf_counter()
        for index in range(frames):
            before_s = time.perf_counter()
            frame = camera.take_frame(timeout_s=10.0)
            taken_s = time.perf_counter()
            with (Path(out) / f"{index}.raw").open("wb") as file:
                file.write(frame.counts.tobytes())
                file.flush()
                os.fsync(file.fileno())
            taking_s.append(taken_s - before_s)
            writing_s.append(time.perf_counter() - taken_s)
        wall_s, cpu_s = time.perf_counter() - start_s, time.process_time() - cpu_s
    print(f"{frames / wall_s:.1f} frames/s; this process used {cpu_s / wall_s:.2f} of a core")
    print(f"a frame: taking {np.median(taking_s) * 1e3:.1f} ms, of which {EXPOSURE_S * 1e3:.0f} ms is exposure")
    print(f"         writing and fsync {np.median(writing_s) * 1e3:.1f} ms; {camera.tally()}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()))
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve()
        return 0
    with subprocess.Popen([sys.executable, __file__, "--serve"], stdout=subprocess.PIPE, text=True) as camera:
        try:
            if camera.stdout is not None and camera.stdout.readline() == "ready\n":
                measure(arguments.frames, arguments.folder)
                return 0
            return 1
        finally:
            camera.kill()


if __name__ == "__main__":
    sys.exit(main())
