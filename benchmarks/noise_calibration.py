"""Time of a noise calibration beside the package emva1288 on the same frames, and memory against frames.

    python -m benchmarks.noise_calibration DESCRIPTOR --peer PYTHON

PYTHON is an interpreter of its own with ``numpy<2 scipy<1.14 emva1288==1.0.2``; without it only our time is taken.
"""

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.frame_statistics import level_statistics
from rigctl.noise.calibrate_files import calibrate_frames
from rigctl.noise.noise_frames import emva_frames

RUNS = 5
SHAPE = (2048, 2448)
FRAMES = (4, 40)

PEER = """
import sys, time, logging
logging.disable(logging.CRITICAL)
from emva1288.process import Data1288, LoadImageData, ParseEmvaDescriptorFile, Results1288
start = time.perf_counter()
images = LoadImageData(ParseEmvaDescriptorFile(sys.argv[1]).images)
results = Results1288(Data1288(images.data).data)
values = [results.K, results.sigma_d, results.PRNU1288, results.DSNU1288, results.u_I_mean, results.LE_max]
print(time.perf_counter() - start)
"""


def ours_s(descriptor: Path) -> float:
    start = time.perf_counter()
    calibrate_frames(emva_frames(descriptor))
    return time.perf_counter() - start


def peer_s(python: Path, descriptor: Path) -> float:
    done = subprocess.run(
        [str(python), "-W", "ignore", "-c", PEER, str(descriptor)], check=True, capture_output=True, text=True
    )
    return float(done.stdout.split()[-1])


def best(timed: Callable[[], float]) -> float:
    return min(timed() for _ in range(RUNS))


def stream(n_frames: int) -> Iterator[NDArray[np.uint16]]:
    draws = np.random.default_rng(1)
    for _ in range(n_frames):
        yield draws.integers(1000, 1100, SHAPE, dtype=np.uint16)


def peak_mb(n_frames: int) -> float:
    """Peak memory of a process of its own that takes one level of so many frames of 5 Mpixel."""
    code = f"from benchmarks.noise_calibration import take; take({n_frames})"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return float(done.stdout)


def take(n_frames: int) -> None:
    level_statistics(stream(n_frames), kind="flat", exposure_s=None)
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("descriptor", type=Path)
    parser.add_argument("--peer", type=Path)
    arguments = parser.parse_args()
    ours = best(lambda: ours_s(arguments.descriptor))
    print(f"rigctl, reading and all numbers: {ours:.2f} s (best of {RUNS})")
    if arguments.peer:
        theirs = best(lambda: peer_s(arguments.peer, arguments.descriptor))
        print(f"emva1288, reading and its numbers: {theirs:.2f} s; ratio {theirs / ours:.2f}")
    for n_frames in FRAMES:
        print(f"{n_frames} frames of {SHAPE[1]} x {SHAPE[0]} at one level: peak {peak_mb(n_frames):.0f} MB")


if __name__ == "__main__":
    main()
