"""Accuracy against time of DoLP moments: every tier of the law beside Monte Carlo with 1e3 to 1e6 draws.

Usage: python -m benchmarks.dolp_accuracy_time
"""

import time
from collections.abc import Callable

import numpy as np

from model.processing import dolp

# Name, mean and covariance of (S0, S1, S2): polarization over noise of 50, 10, 3 and 0.5.
CASES = {
    "Q/sigma 50": ((1000.0, 400.0, 300.0), np.diag([50.0, 100.0, 100.0])),
    "Q/sigma 10": ((1000.0, 80.0, 60.0), np.diag([50.0, 100.0, 100.0])),
    "Q/sigma 3, correlated": (
        (1000.0, 24.0, 18.0),
        np.array([[50.0, 20.0, 0.0], [20.0, 100.0, 60.0], [0.0, 60.0, 90.0]]),
    ),
    "Q/sigma 0.5": ((1000.0, 4.0, 3.0), np.diag([50.0, 100.0, 100.0])),
}
REPEATS = 7
REGIONS = 400
PIXELS = 455_124


def best_s(function: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the shortest of some runs [s]: the machine is shared."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def drawn(mean: np.ndarray, cov: np.ndarray, draws: int, generator: np.random.Generator) -> tuple[float, float]:
    """Return mean and deviation of DoLP of drawn Stokes parameters."""
    s0, s1, s2 = generator.multivariate_normal(mean, cov, draws, method="cholesky").T
    values = np.hypot(s1, s2) / s0
    return float(values.mean()), float(values.std(ddof=1))


def main() -> None:
    """Print the tables."""
    generator = np.random.default_rng(1)
    print(f"{'case':24} {'way':22} {'time [ms]':>10} {'error of mean':>14} {'of deviation':>13}   (relative)")
    for name, (mean, cov) in CASES.items():
        mean, cov = np.array(mean), np.asarray(cov, dtype=float)
        truth = dolp.moments(mean, cov, tolerance=1e-12)
        _expansions(name, mean, cov, truth)
        for tolerance in (1e-2, 1e-4, 1e-6, 1e-9, 1e-12):
            found = dolp.moments(mean, cov, tolerance=tolerance)
            took = best_s(lambda m=mean, c=cov, t=tolerance: dolp.moments(m, c, tolerance=t))
            _print(name, f"{tolerance:g}: {found.method}", took, found.mean, found.std, truth)
        for draws in (1_000, 10_000, 100_000, 1_000_000):
            _draws(name, mean, cov, draws, generator, truth)
    _many()


def _expansions(name: str, mean: np.ndarray, cov: np.ndarray, truth: dolp.DolpMoments) -> None:
    for way, function in (("first order", dolp.first_order), ("second order", dolp.second_order)):
        found = function(mean, cov)
        took = best_s(lambda f=function: f(mean, cov))
        std = np.sqrt(found.variance) if found.variance > 0 else np.nan
        _print(name, way, took, found.mean, std, truth)


def _draws(
    name: str, mean: np.ndarray, cov: np.ndarray, draws: int, generator: np.random.Generator, truth: dolp.DolpMoments
) -> None:
    """Print the rms error over some repeats: a single one may be lucky."""
    runs = np.array([drawn(mean, cov, draws, generator) for _ in range(20 if draws < 1_000_000 else 5)])
    rms = np.sqrt(np.mean((runs / [truth.mean, truth.std] - 1.0) ** 2, axis=0))
    took = best_s(lambda: drawn(mean, cov, draws, generator), 3)
    print(f"{name:24} {f'{draws:g} draws (rms)':22} {1e3 * took:10.3f} {rms[0]:14.1e} {rms[1]:13.1e}")


def _print(name: str, way: str, took_s: float, mean: float, std: float, truth: dolp.DolpMoments) -> None:
    errors = abs(mean / truth.mean - 1.0), abs(std / truth.std - 1.0)
    print(f"{name:24} {way:22} {1e3 * took_s:10.3f} {errors[0]:14.1e} {errors[1]:13.1e}")


def _many() -> None:
    """Print what a region costs among many, and what a pixel costs in first order beside a copy of its numbers."""
    mean, cov = np.array(CASES["Q/sigma 3, correlated"][0]), CASES["Q/sigma 3, correlated"][1]
    means = mean * (1.0 + 1e-3 * np.arange(REGIONS)[:, None])
    took = best_s(lambda: dolp.moments(means, cov, tolerance=1e-9))
    print(f"\n{REGIONS} regions at once, 1e-9: {1e6 * took / REGIONS:.0f} us a region")
    pixels = np.broadcast_to(mean, (PIXELS, 3)).copy()
    first = best_s(lambda: dolp.first_order(pixels, cov), 3)
    both = np.zeros((PIXELS, 5))
    copy = best_s(lambda: both.copy(), 3)
    print(f"first order, {PIXELS} pixels of one covariance: {1e9 * first / PIXELS:.0f} ns a pixel,", end=" ")
    print(f"{first / copy:.0f} times a copy of what goes in and comes out")


if __name__ == "__main__":
    main()
