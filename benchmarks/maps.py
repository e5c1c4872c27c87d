"""What maps of S0, S1, S2, DoLP and AoLP cost, beside polanalyser and a copy of the frames, all in one run.

`python benchmarks/maps.py`; polanalyser and numba are left out where they are not installed
(`pip install polanalyser matplotlib 'rigctl[fast]'`).
"""

import importlib.util
import sys
import time
from collections.abc import Callable

import numpy as np

from model.processing.maps import polarization_maps
from model.processing.reconstruction import design

SIZES = ((582, 782), (2048, 2448))
ANGLES_RAD = np.deg2rad([0.0, 45.0, 90.0, 135.0])


def milliseconds(work: Callable[[], object], repeats: int) -> float:
    """Return the median time of a call; the first two warm caches up."""
    times_s = []
    for _ in range(repeats + 2):
        start_s = time.perf_counter()
        work()
        times_s.append(time.perf_counter() - start_s)
    return 1000.0 * float(np.median(times_s[2:]))


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
    if importlib.util.find_spec("polanalyser") is not None:
        import polanalyser

        def peer() -> None:
            stokes = polanalyser.calcStokes(list(frames), ANGLES_RAD)
            polanalyser.cvtStokesToDoLP(stokes)
            polanalyser.cvtStokesToAoLP(stokes)

        found["polanalyser"] = peer
    return found


def main() -> int:
    """Print times and ratios."""
    generator = np.random.default_rng(1)
    for height, width in SIZES:
        frames = generator.integers(500, 3500, (4, height, width), dtype=np.uint16)
        repeats = 60 if height < 1000 else 12
        times = {name: milliseconds(work, repeats) for name, work in contenders(frames).items()}
        print(f"{width} x {height}")
        for name, time_ms in times.items():
            peer = f"{times['polanalyser'] / time_ms:6.1f} x peer" if "polanalyser" in times else ""
            print(f"{name:>18} {time_ms:8.2f} ms {time_ms / times['copy of float32']:6.1f} copies {peer}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
