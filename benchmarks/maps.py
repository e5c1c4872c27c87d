"""What maps of S0, S1, S2, DoLP and AoLP cost, beside polanalyser and a copy of the frames, all in one run.

Usage: python -m benchmarks.maps [--peer PYTHON] [--rounds 10]

PYTHON is an interpreter that has polanalyser (`python -m benchmarks.page --make-peers` makes one): it computes the same
frames in a process of its own, in turn with ours. numba is left out where it is not installed (`rigctl[fast]`). Each
takes its turn round by round, and the least of its times counts: on the clock, and on the processor, of all its
threads, where other work on the machine counts less.
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

from model.processing.maps import polarization_maps
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


def best(height: int, width: int, *, rounds: int, peer: str | None) -> dict[str, Times]:
    """Return the least times of each contender over the rounds; two rounds before warm caches up."""
    frames = np.random.default_rng(1).integers(500, 3500, (4, height, width), dtype=np.uint16)
    with peer_call(peer, (height, width)) as call:
        calls = {name: partial(timed, work) for name, work in contenders(frames).items()}
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
