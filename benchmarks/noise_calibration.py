"""Time of a noise calibration beside the package emva1288 on the same frames, and memory against frames.

    python -m benchmarks.noise_calibration [DESCRIPTOR] [--peer PYTHON]
    python -m benchmarks.noise_calibration --frames 1000

PYTHON is an interpreter of its own with ``numpy<2 scipy<1.14 emva1288==1.0.2``; without it only our time is taken.
Without a DESCRIPTOR the frames are drawn: 140 of 640 x 480 in PNG files, at 25 exposures, as many as `emva_ccd12` has.
With ``--frames`` a whole calibration from so many frames of 5 Mpixel, drawn as they are asked for, says its peak of
memory.
"""

import argparse
import resource
import subprocess
import tempfile
import time
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.sensor.levels import LevelKind
from rigctl.calibrations.made_for import MadeFor
from rigctl.calibrations.noise_calibration import calibrate_frames
from rigctl.calibrations.noise_frames import FrameGroup, FrameSet, FrameSource, emva_frames

ROUNDS = 7
SHAPE = (2048, 2448)
BIT_DEPTH = 12
GAIN_DN_PER_E, READ_NOISE_DN, BLACK_DN = 0.25, 2.5, 60.0
LEVELS, PAIR = 10, 2
# Of the set that is drawn: the last exposures saturate, as the standard wants it.
SET_SHAPE, SET_LEVELS, SET_STACK = (480, 640), 25, 20
PHOTONS_PER_S, QUANTUM_EFFICIENCY, PRNU, DARK_E_PER_S = 3e6, 0.5, 0.005, 30.0

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


def compare(descriptor: Path, peer: Path | None) -> None:
    """Take turns, so that both meet the same load of the machine."""
    ours, theirs = [], []
    for _ in range(ROUNDS):
        ours.append(ours_s(descriptor))
        if peer is not None:
            theirs.append(peer_s(peer, descriptor))
    print(f"rigctl, reading and all numbers: best {min(ours):.2f} s, median {np.median(ours):.2f} s")
    if theirs:
        print(f"emva1288, reading and its numbers: best {min(theirs):.2f} s, median {np.median(theirs):.2f} s")
        print(f"ratio of best {min(theirs) / min(ours):.2f}, of medians {np.median(theirs) / np.median(ours):.2f}")


def drawn_set(folder: Path) -> Path:
    """Write a set of frames as the standard's data format has it; return its descriptor."""
    draws = np.random.default_rng(1288)
    response = 1.0 + PRNU * draws.standard_normal(SET_SHAPE)
    lines = ["v 3.0", f"n {BIT_DEPTH} {SET_SHAPE[1]} {SET_SHAPE[0]}"]
    exposures_s = [0.5e-3 * (place + 1) for place in range(SET_LEVELS)]
    groups = [(exposure_s, PAIR) for exposure_s in exposures_s] + [(exposures_s[SET_LEVELS // 2] + 1e-6, SET_STACK)]
    for tag, rate in (("b", PHOTONS_PER_S), ("d", 0.0)):
        for exposure_s, n in groups:
            photons = rate * exposure_s
            lines.append(f"{tag} {1e9 * exposure_s:.0f}" + (f" {photons:.1f}" if tag == "b" else ""))
            mean_e = response * photons * QUANTUM_EFFICIENCY + DARK_E_PER_S * exposure_s
            for _ in range(n):
                counts = (
                    BLACK_DN + GAIN_DN_PER_E * draws.poisson(mean_e) + READ_NOISE_DN * draws.standard_normal(SET_SHAPE)
                )
                name = f"{len(lines):04d}.png"
                cv2.imwrite(str(folder / name), np.clip(np.rint(counts), 0, 2**BIT_DEPTH - 1).astype(np.uint16))
                lines.append(f"i {name}")
    descriptor = folder / "descriptor.txt"
    descriptor.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return descriptor


def frame(seed: int, signal_e: float) -> NDArray[np.uint16]:
    draws = np.random.default_rng(seed)
    noise_dn = np.sqrt(GAIN_DN_PER_E**2 * signal_e + READ_NOISE_DN**2)
    samples = draws.standard_normal(SHAPE, dtype=np.float32)
    samples *= np.float32(noise_dn)
    samples += np.float32(BLACK_DN + GAIN_DN_PER_E * signal_e)
    return np.rint(samples, out=samples).astype(np.uint16)


def drawn_frames(n_frames: int) -> FrameSet:
    """A pair of each kind at each of ten exposures, and all other frames in two stacks."""
    groups: list[FrameGroup] = []
    seed = 0
    kinds: tuple[tuple[LevelKind, float], ...] = (("dark", 0.0), ("flat", 1.2e6))
    stack = (n_frames - 2 * PAIR * (LEVELS - 1)) // 2
    for place in range(LEVELS):
        exposure_s = 1e-3 * (place + 1)
        n = stack if place == LEVELS // 2 else PAIR
        for kind, rate_e_per_s in kinds:
            loaders = tuple(partial(frame, seed + number, rate_e_per_s * exposure_s) for number in range(n))
            seed += n
            groups.append(FrameGroup(kind=kind, exposure_s=exposure_s, loaders=loaders))
    return FrameSet(
        groups=tuple(groups),
        bit_depth=BIT_DEPTH,
        made_for=MadeFor(bit_depth=BIT_DEPTH),
        source=FrameSource(kind="folder", path="drawn", sha256="", frames_sha256=""),
    )


def take(n_frames: int) -> None:
    start = time.perf_counter()
    found = calibrate_frames(drawn_frames(n_frames)).noise.gain_dn_per_e
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(
        f"{n_frames} frames of {SHAPE[1]} x {SHAPE[0]}: peak {peak_mb:.0f} MB, {time.perf_counter() - start:.0f} s "
        f"with drawing them; gain {found.value:.6f} +- {found.std_error:.6f} DN/e-"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("descriptor", type=Path, nargs="?")
    parser.add_argument("--peer", type=Path)
    parser.add_argument("--frames", type=int)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        compare(arguments.descriptor or drawn_set(Path(folder)), arguments.peer)
    if arguments.frames:
        take(arguments.frames)


if __name__ == "__main__":
    main()
