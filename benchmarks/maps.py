"""What maps of S0, S1, S2, DoLP and AoLP cost, beside polanalyser and a copy of the frames, all in one run.

Usage: python -m benchmarks.maps [--peer PYTHON] [--rounds 10]

PYTHON is an interpreter that has polanalyser (`python -m benchmarks.page --make-peers` makes one): it computes the same
frames in a process of its own, in turn with ours. numba is left out where it is not installed (`rigctl[fast]`). Each
takes its turn round by round, and the least of its times counts: on the clock, and on the processor, of all its
threads, where other work on the machine counts less. The limit of `fast` is a compiled loop that reads as many frames
and fills as many planes but computes nothing, in one thread; that of numpy are the three calls that nothing replaces:
the product of matrices, the root and the arctangent.
"""

import argparse
import importlib.util
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from model.processing.maps import BLOCK_PIXELS, polarization_maps
from model.processing.reconstruction import design

SIZES = ((582, 782), (2048, 2448))
ANGLES_RAD = np.deg2rad([0.0, 45.0, 90.0, 135.0])


_IN_A_ROW = 5
# What the peer's process runs: a time of the processor for every line that it is sent.
_PEER = """
import sys, time
import numpy as np, polanalyser
height, width = map(int, sys.argv[1:])
frames = list(np.random.default_rng(1).integers(500, 3500, (4, height, width), dtype=np.uint16))
angles = np.deg2rad([0.0, 45.0, 90.0, 135.0])
for _ in sys.stdin:
    start = time.perf_counter(), time.process_time()
    stokes = polanalyser.calcStokes(frames, angles)
    polanalyser.cvtStokesToDoLP(stokes)
    polanalyser.cvtStokesToAoLP(stokes)
    print(time.perf_counter() - start[0], time.process_time() - start[1], flush=True)
"""


class Times(NamedTuple):
    """Time of a call on the clock and on the processor [s]."""

    clock_s: float
    processor_s: float


def timed(work: Callable[[], object]) -> Times:
    """Return the times of a call."""
    clock_s, processor_s = time.perf_counter(), time.process_time()
    work()
    return Times(time.perf_counter() - clock_s, time.process_time() - processor_s)


@contextmanager
def peer_call(python: str | None, shape: tuple[int, int]) -> Iterator[Callable[[], Times] | None]:
    """Give what has the peer compute once, and returns its times; None without a peer."""
    if python is None:
        yield None
        return
    words = [python, "-c", _PEER, *map(str, shape)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        asked, answered = process.stdin, process.stdout
        if asked is None or answered is None:
            raise OSError("the peer's process has no streams")

        def call() -> Times:
            asked.write("\n")
            asked.flush()
            return Times(*map(float, answered.readline().split()))

        yield call
        asked.close()


def contenders(frames: np.ndarray) -> dict[str, Callable[[], object]]:
    """Return what is timed, by name."""
    plan, single = design(ANGLES_RAD), frames.astype(np.float32)
    found: dict[str, Callable[[], object]] = {
        "copy of float32": single.copy,
        "numpy, float32": lambda: polarization_maps(single, plan),
        "numpy, uint16": lambda: polarization_maps(frames, plan),
    }
    if importlib.util.find_spec("numba") is not None:
        found["fast, float32"] = lambda: polarization_maps(single, plan, engine="fast")
        found["fast, uint16"] = lambda: polarization_maps(frames, plan, engine="fast")
    return found


def limits(frames: np.ndarray, single: np.ndarray) -> dict[str, Callable[[], object]]:
    """Return what each engine takes at least, by name."""
    pixels, inverse = frames[0].size, design(ANGLES_RAD).inverse.astype(np.float32)
    planes, valid = np.zeros((5, pixels), dtype=np.float32), np.zeros(pixels, dtype=np.bool_)

    def least_of_numpy() -> None:
        counts = single.reshape(4, -1)
        for start in range(0, pixels, BLOCK_PIXELS):
            s0, s1, s2, dolp, angle = planes[:, start : start + BLOCK_PIXELS]
            np.matmul(inverse, counts[:, start : start + BLOCK_PIXELS], out=planes[:3, start : start + BLOCK_PIXELS])
            np.sqrt(s0, out=dolp)
            np.arctan2(s2, s1, out=angle)

    found: dict[str, Callable[[], object]] = {"limit of numpy": least_of_numpy}
    if importlib.util.find_spec("numba") is not None:
        import numba

        bare = numba.njit(nogil=True)(_bare)
        found["limit, float32"] = lambda: bare(single.reshape(4, -1), planes, valid)
        found["limit, uint16"] = lambda: bare(frames.reshape(4, -1), planes, valid)
    return found


def _bare(counts: np.ndarray, planes: np.ndarray, valid: np.ndarray) -> None:
    """Read four frames and fill five planes and a mask."""
    a, b, c, d = counts[0], counts[1], counts[2], counts[3]
    s0, s1, s2, dolp, angle = planes[0], planes[1], planes[2], planes[3], planes[4]
    for i in range(valid.size):
        first, second, third = np.float32(a[i]), np.float32(b[i]), np.float32(c[i])
        s0[i], s1[i], s2[i] = first + second, first - second, third
        dolp[i], angle[i] = second, np.float32(d[i])
        valid[i] = first > third


def best(height: int, width: int, *, rounds: int, peer: str | None) -> dict[str, Times]:
    """Return the least times of each contender over the rounds; two rounds before warm caches up."""
    frames = np.random.default_rng(1).integers(500, 3500, (4, height, width), dtype=np.uint16)
    every = contenders(frames) | limits(frames, frames.astype(np.float32))
    with peer_call(peer, (height, width)) as call:
        calls: dict[str, Callable[[], Times]] = {name: partial(timed, work) for name, work in every.items()}
        if call is not None:
            calls["polanalyser"] = call
        times: dict[str, list[Times]] = {name: [] for name in calls}
        for _ in range(rounds + 2):
            for name, once in calls.items():
                # Several in a row: a caller's loop finds its frames in the cache as well.
                times[name] += [once() for _ in range(_IN_A_ROW)]
    return {name: Times(*map(min, zip(*found[2 * _IN_A_ROW :], strict=True))) for name, found in times.items()}


def main() -> int:
    """Print times and ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer", metavar="PYTHON")
    parser.add_argument("--rounds", type=int, default=10)
    options = parser.parse_args()
    cpu = Path("/proc/cpuinfo")
    has = cpu.exists() and "avx512f" in cpu.read_text()
    print(f"Processor {'with' if has else 'without'} AVX-512; the least of {options.rounds} rounds of {_IN_A_ROW}.")
    for height, width in SIZES:
        times = best(height, width, rounds=options.rounds, peer=options.peer)
        copy, peer = times["copy of float32"], times.get("polanalyser")
        print(f"\n{f'{width} x {height}':>16}   clock   copies  of peer   processor  copies  of peer")
        for name, one in times.items():
            shown = [
                f"{1000.0 * own:9.2f} ms {own / of_copy:6.1f} {'' if theirs is None else f'{theirs / own:7.1f} x':>9}"
                for own, of_copy, theirs in zip(one, copy, peer or (None, None), strict=True)
            ]
            print(f"{name:>16} {'  '.join(shown)}".rstrip())
    return 0


if __name__ == "__main__":
    sys.exit(main())
