"""Geometries per second of the polarimetric BRDF on one core, beside what numpy needs at the very least.

Run: python benchmarks/pbrdf_speed.py [geometries]

The limit is the time to take one sine or cosine ten times and one exponential, and to copy nine numbers, for each
geometry, which is what the half-angle form begins and ends with.
"""

import os
import sys
import time
from collections.abc import Callable

# Before numpy is imported: its libraries read this once.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from model.surface.lobe import Lobe
from model.surface.pbrdf import Surface, mueller
from model.surface.reflectance_table import reflectance_table

SURFACES = {
    "dielectric, lobe alone": Surface(n=1.5, slope_rms=0.15),
    "absorbing, lobe alone": Surface(n=1.4, k=0.4, slope_rms=0.15),
    "Smith correlated, lobe alone": Surface(n=1.5, slope_rms=0.15, shadowing="smith-correlated"),
    "white paint, Lambert": Surface(n=1.5, slope_rms=0.15, dhr=0.8, diffuse="lambert"),
    "white paint, coupled": Surface(n=1.5, slope_rms=0.15, dhr=0.8),
    "white paint, polarised": Surface(n=1.5, slope_rms=0.15, dhr=0.8, diffuse="polarised"),
    "asphalt, coupled": Surface(n=1.6, slope_rms=0.30, dhr=0.09),
}
ROUNDS = 3


def best_seconds(run: Callable[[], object]) -> float:
    seconds = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def numpy_limit(angles: np.ndarray, block: int = 8192) -> None:
    out, source = np.empty((angles.size, 9)), np.ones((block, 9))
    for start in range(0, angles.size, block):
        part = angles[start : start + block]
        for _ in range(5):
            np.sin(part)
            np.cos(part)
        np.exp(-part)
        out[start : start + block] = source[: part.size]


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    rng = np.random.default_rng(1)
    theta_i, theta_r = rng.uniform(0.0, 0.5 * np.pi, (2, count))
    phi = rng.uniform(-np.pi, np.pi, count)
    limit = best_seconds(lambda: numpy_limit(phi))
    print(f"{count} geometries, one core, best of {ROUNDS}")
    print(f"{'limit (transcendentals and copy)':32s} {count / limit / 1e6:7.2f} M/s")
    for name, surface in SURFACES.items():
        mueller(0.1, 0.2, 0.3, surface=surface)
        seconds = best_seconds(lambda surface=surface: mueller(theta_i, theta_r, phi, surface=surface))
        print(f"{name:32s} {count / seconds / 1e6:7.2f} M/s   {seconds / limit:5.2f} x limit")
    lobe = SURFACES["asphalt, coupled"].lobe
    print(f"{'series for E, once a lobe':32s} {1e3 * best_seconds(lambda: _table(lobe)):7.1f} ms")


def _table(lobe: Lobe) -> None:
    reflectance_table.cache_clear()
    reflectance_table(lobe)


if __name__ == "__main__":
    main()
