"""Geometries per second of the polarimetric BRDF on one core, beside what numpy needs at the very least.

Run: python benchmarks/pbrdf_speed.py [--geometries N] [--peer PYTHON]

--peer names the Python of an environment with pySCATMECH or mitsuba in it (python -m venv DIR; DIR/bin/pip install
pySCATMECH mitsuba): they evaluate the same table in their own process, and what they find is set beside F.

The limit is the time to take one sine or cosine ten times and one exponential, and to copy nine numbers, for each
geometry, which is what the half-angle form begins and ends with.
"""

import argparse
import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

# Before numpy is imported: its libraries read this once.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from model.surface.pbrdf import Lobe, Surface, mueller, reflectance_table

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
# Other programs take one geometry a call; they get fewer of them.
PEER_GEOMETRIES = 100_000
PEER_SURFACE = Surface(n=1.5, slope_rms=0.15)
# Below this F00 is the far tail of the lobe, which single precision does not hold.
PEER_LEAST_F00 = 1e-6


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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--geometries", type=int, default=1_000_000, metavar="N")
    parser.add_argument("--peer", metavar="PYTHON")
    options = parser.parse_args()
    speed(options.geometries)
    if options.peer is None:
        print("other programs: give --peer PYTHON with pySCATMECH or mitsuba installed")
        return
    beside_peers(options.peer)


def speed(count: int) -> None:
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


def beside_peers(python: str) -> None:
    rng = np.random.default_rng(2)
    theta_i, theta_r = rng.uniform(0.0, np.radians(85.0), (2, PEER_GEOMETRIES))
    phi = rng.uniform(-np.pi, np.pi, PEER_GEOMETRIES)
    own_per_s = PEER_GEOMETRIES / best_seconds(lambda: mueller(theta_i, theta_r, phi, surface=PEER_SURFACE))
    with tempfile.TemporaryDirectory() as folder:
        table, out = Path(folder) / "table.npz", Path(folder) / "out.npz"
        np.savez(table, theta_i=theta_i, theta_r=theta_r, phi=phi, n=PEER_SURFACE.n, slope_rms=PEER_SURFACE.slope_rms)
        subprocess.run([python, Path(__file__).with_name("pbrdf_peer.py"), table, out], check=True)
        found = dict(np.load(out))
    print(f"{PEER_GEOMETRIES} geometries up to 85 deg, n = 1.5, slope 0.15, lobe alone")
    print(f"{'rigctl':32s} {own_per_s / 1e6:7.2f} M/s")
    for name, shadowing in (("SCATMECH", "v-cavity"), ("Mitsuba", "smith")):
        if f"{name}_f" not in found:
            print(f"{name:32s} not installed for {python}")
            continue
        own = mueller(theta_i, theta_r, phi, surface=replace(PEER_SURFACE, shadowing=shadowing))
        per_s, deviation = float(found[f"{name}_per_s"]), largest_deviation(own, found[f"{name}_f"])
        print(
            f"{name:32s} {per_s / 1e6:7.2f} M/s   rigctl is {own_per_s / per_s:.0f} x as fast; "
            f"largest deviation {deviation:.1e} of F00 ({shadowing})"
        )


def largest_deviation(own: np.ndarray, other: np.ndarray) -> float:
    """Largest difference of any element (or of F00, where the other has that alone) in units of F00."""
    intensity = own[:, 0, 0]
    mine = own if other.ndim == 3 else intensity
    shown = intensity > PEER_LEAST_F00
    difference = np.abs(mine - other).reshape(intensity.size, -1).max(axis=1)
    return float(np.max(difference[shown] / intensity[shown]))


def _table(lobe: Lobe) -> None:
    reflectance_table.cache_clear()
    reflectance_table(lobe)


if __name__ == "__main__":
    main()
