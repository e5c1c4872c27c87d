"""What maps of S0, S1, S2, DoLP and AoLP cost, beside polanalyser and a copy of the frames, all in one run.

Usage: python -m benchmarks.maps [--peer PYTHON] [--rounds 30]

PYTHON is an interpreter that has polanalyser (`python -m benchmarks.page --make-peers` makes one): it computes the same
frames in a process of its own, in turn with ours. numba is left out where it is not installed (`rigctl[fast]`). Each
takes its turn round by round; of its times on the processor, of all its threads, the least counts, so that other work
on the machine counts little.
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
    start = time.process_time()
    stokes = polanalyser.calcStokes(frames, angles)
    polanalyser.cvtStokesToDoLP(stokes)
    polanalyser.cvtStokesToAoLP(stokes)
    print(time.process_time() - start, flush=True)
"""


def processor_s(work: Callable[[], object]) -> float:
    """Return the time of a call on the processor."""
    start_s = time.process_time()
    work()
    return time.process_time() - start_s


@contextmanager
def peer_call(python: str | None, shape: tuple[int, int]) -> Iterator[Callable[[], float] | None]:
    """Give what has the peer compute once, and returns its time on the processor; None without a peer."""
    if python is None:
        yield None
        return
    words = [python, "-c", _PEER, *map(str, shape)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        asked, answered = process.stdin, process.stdout
        if asked is None or answered is None:
            raise OSError("the peer's process has no streams")

        def call() -> float:
            asked.write("\n")
            asked.flush()
            return float(answered.readline())

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


def best_ms(height: int, width: int, *, rounds: int, peer: str | None) -> dict[str, float]:
    """Return the least time of each contender over the rounds [ms]; two rounds before warm caches up."""
    frames = np.random.default_rng(1).integers(500, 3500, (4, height, width), dtype=np.uint16)
    ours = contenders(frames)
    with peer_call(peer, (height, width)) as call:
        timed = {name: partial(processor_s, work) for name, work in ours.items()}
        if call is not None:
            timed["polanalyser"] = call
        times: dict[str, list[float]] = {name: [] for name in timed}
        for _ in range(rounds + 2):
            for name, once in timed.items():
                # Several in a row: a caller's loop finds its frames in the cache as well.
                times[name].append(1000.0 * min(once() for _ in range(_IN_A_ROW)))
    return {name: min(found[2:]) for name, found in times.items()}


def main() -> int:
    """Print times and ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer", metavar="PYTHON")
    parser.add_argument("--rounds", type=int, default=30)
    options = parser.parse_args()
    cpu = Path("/proc/cpuinfo")
    has = cpu.exists() and "avx512f" in cpu.read_text()
    print(f"Processor {'with' if has else 'without'} AVX-512; least of {options.rounds} rounds, on the processor.")
    for height, width in SIZES:
        times = best_ms(height, width, rounds=options.rounds, peer=options.peer)
        print(f"{width} x {height}")
        for name, time_ms in times.items():
            peer = f"{times['polanalyser'] / time_ms:6.1f} x peer" if "polanalyser" in times else ""
            print(f"{name:>18} {time_ms:8.2f} ms {time_ms / times['copy of float32']:6.1f} copies {peer}".rstrip())
    return 0


if __name__ == "__main__":
    sys.exit(main())
