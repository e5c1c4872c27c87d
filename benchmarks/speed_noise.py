"""A noise calibration from files to numbers, beside the package emva1288; memory of a large one."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from benchmarks.peers import answer, peer_python
from benchmarks.timing import Row

_SHAPE, _LARGE = (480, 640), (2048, 2448)
_BIT_DEPTH = 12
_GAIN_DN_PER_E, _READ_NOISE_DN, _BLACK_DN = 0.25, 2.5, 60.0
_PHOTONS_PER_S, _QUANTUM_EFFICIENCY, _PRNU, _DARK_E_PER_S = 3e6, 0.5, 0.005, 30.0
_LEVELS, _PAIR, _STACK = 25, 2, 20
_PEER = """
import sys, time, logging
logging.disable(logging.CRITICAL)
from emva1288.process import Data1288, LoadImageData, ParseEmvaDescriptorFile, Results1288
start = time.process_time()
results = Results1288(Data1288(LoadImageData(ParseEmvaDescriptorFile(sys.argv[1]).images).data).data)
values = [results.K, results.sigma_d, results.PRNU1288, results.DSNU1288, results.u_I_mean, results.LE_max]
print(time.process_time() - start)
"""
_OURS = """
import sys, time
from pathlib import Path
from rigctl.calibrations.noise_calibration import calibrate_frames
from rigctl.calibrations.noise_frames import emva_frames
start = time.process_time()
calibrate_frames(emva_frames(Path(sys.argv[1])))
print(time.process_time() - start)
"""
# `ru_maxrss` would include the peak of the parent process.
_PEAK = """
import re, sys
from pathlib import Path
from rigctl.cli import main
main(sys.argv[1:])
print(int(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1]) / 1024)
"""


def rows() -> Iterator[Row]:
    """Draw sets of frames and time their calibration."""
    with tempfile.TemporaryDirectory() as name:
        descriptor = _drawn_set(Path(name), _SHAPE, levels=_LEVELS, stack=_STACK)
        python = peer_python("emva1288")
        ours, theirs = [], []
        for _ in range(5):
            ours.append(float(_python(_OURS, str(descriptor))))
            if python is not None:
                theirs.append(float(answer(python, _PEER, str(descriptor)).split()[-1]))
        yield Row(
            work="noise calibration from 140 PNG files of 640 x 480", ours=min(ours),
            beside="emva1288" if theirs else "", theirs=min(theirs, default=None), most_ratio=0.5,
        )  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        descriptor = _drawn_set(folder, _LARGE, levels=10, stack=10)
        words = ("calibrate", "noise", "--emva", str(descriptor), "--out", str(folder / "noise.json"))
        peak = float(_python(_PEAK, *words).split()[-1])
        yield Row(work="memory of a noise calibration, 100 frames of 2448 x 2048", ours=peak, unit="MB", most=300.0)


def _python(program: str, *words: str) -> str:
    return subprocess.run([sys.executable, "-c", program, *words], check=True, capture_output=True, text=True).stdout


def _drawn_set(folder: Path, shape: tuple[int, int], *, levels: int, stack: int) -> Path:
    """Write a set of frames as the standard's data format has it; return its descriptor."""
    draws = np.random.default_rng(1288)
    response = 1.0 + _PRNU * draws.standard_normal(shape)
    lines = ["v 3.0", f"n {_BIT_DEPTH} {shape[1]} {shape[0]}"]
    exposures_s = [0.5e-3 * (place + 1) * 25 / levels for place in range(levels)]
    groups = [(exposure_s, _PAIR) for exposure_s in exposures_s] + [(exposures_s[levels // 2] + 1e-6, stack)]
    for tag, rate in (("b", _PHOTONS_PER_S), ("d", 0.0)):
        for exposure_s, n in groups:
            photons = rate * exposure_s
            lines.append(f"{tag} {1e9 * exposure_s:.0f}" + (f" {photons:.1f}" if tag == "b" else ""))
            mean_e = response * photons * _QUANTUM_EFFICIENCY + _DARK_E_PER_S * exposure_s
            for _ in range(n):
                noise_dn = np.sqrt(_GAIN_DN_PER_E**2 * mean_e + _READ_NOISE_DN**2)
                counts = _BLACK_DN + _GAIN_DN_PER_E * mean_e + noise_dn * draws.standard_normal(shape)
                name = f"{len(lines):04d}.png"
                cv2.imwrite(str(folder / name), np.clip(np.rint(counts), 0, 2**_BIT_DEPTH - 1).astype(np.uint16))
                lines.append(f"i {name}")
    descriptor = folder / "descriptor.txt"
    descriptor.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return descriptor
