"""The page docs/loss-of-significance.md: naive formulas beside ours, where the naive ones lose all digits.

Usage: python -m tests.hard_cases.loss_of_significance
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.polynomial.hermite_e import hermegauss

from model.processing.detection import rx_p_detection, rx_p_miss
from model.processing.dolp import moments
from model.processing.reconstruction import design
from tests.model.processing.rx_reference import CASES, column
from tests.model.processing.rx_reference import moments as rx_moments

PAGE = Path(__file__).parents[2] / "docs" / "loss-of-significance.md"
DOLP = 0.05
STOKES = np.array([1.0, 0.4, 0.2])

_HEAD = """# Where naive formulas lose all digits

Written by `python -m tests.hard_cases.loss_of_significance`; do not edit. Three places of the model have a textbook
formula that is right on paper and worthless in double precision. Beside each stands what `rigctl` computes.
"""
_VARIANCE = """## Deviation of DoLP: mean of the square minus square of the mean

DoLP 0.05, additive noise, both by the same quadrature rule of 10 nodes along each axis. The variance is the
difference of two numbers near 0.0025 and loses twice as many digits as the SNR has; ours (`model.processing.dolp`)
takes the mean of (P - p0)^2, with P - p0 as a quotient in which nothing cancels. First order is right here to
1/SNR^2, and stands for the truth from 1e6 on.

| SNR of S0 | naive | its error, relative | ours | first order |
|---|---|---|---|---|"""
_TAIL = """
## Probability of a miss: one minus the probability of detection

What is missed is less than the rounding of 1. Ours (`model.processing.detection.rx_p_miss`) integrates the smaller
tail on its own contour; the reference is 170-bit quadrature.

| case | naive: 1 - P_D | ours | reference |
|---|---|---|---|"""
_NORMAL = """
## Stokes parameters from angles that lie close: the normal equations

Four angles, so many degrees apart; S = (1, 0.4, 0.2) without noise. (M'M)^-1 M' has the square of the condition
number of M; ours (`model.processing.reconstruction`) decomposes M itself, and refuses beyond a condition number of
1e6, at which noise alone would be enlarged as much.

| step [deg] | condition number | error of S, naive | error of S, ours |
|---|---|---|---|"""


def naive_std(snr: float) -> float:
    """Return the deviation of DoLP as the root of E[P^2] - E[P]^2, by Gauss-Hermite quadrature."""
    node, weight = hermegauss(10)
    weight = weight / np.sum(weight)
    at = np.stack(np.meshgrid(node, node, node, indexing="ij"), axis=-1).reshape(-1, 3)
    share = np.einsum("i,j,k->ijk", weight, weight, weight).ravel()
    stokes = np.array([1.0, DOLP, 0.0]) + at * np.sqrt([1.0, 2.0, 2.0]) / snr
    dolp = np.hypot(stokes[:, 1], stokes[:, 2]) / stokes[:, 0]
    return float(np.sqrt(max(share @ dolp**2 - (share @ dolp) ** 2, 0.0)))


def our_std(snr: float) -> float:
    """Return the same as the program has it."""
    return float(moments(np.array([1.0, DOLP, 0.0]), np.diag([1.0, 2.0, 2.0]) / snr**2, tolerance=1e-12).std)


def first_order_std(snr: float) -> float:
    """Return the same to first order."""
    return float(np.sqrt(2.0 + DOLP**2) / snr)


def misses() -> Iterator[tuple[str, float, float, float]]:
    """Yield cases: name, 1 - P_D, our probability of a miss, and the reference."""
    for name in ("rx25", "rx04", "rx16"):
        case = CASES[name]
        known, pfa, truth = rx_moments(case), column(case, "pfa"), column(case, "pmiss")
        least = int(np.argmin(np.where(truth > 1e-300, truth, 1.0)))
        naive = 1.0 - float(np.asarray(rx_p_detection(pfa[least], *known)))
        yield case["name"], naive, float(np.asarray(rx_p_miss(pfa[least], *known))), float(truth[least])


def stokes_errors(step_deg: float) -> tuple[float, float, float | None]:
    """Return the condition number, and the largest error of S by the normal equations and by ours (None: refused)."""
    angles_rad = np.deg2rad(step_deg * np.arange(4.0))
    measured = 0.5 * np.stack([np.ones(4), np.cos(2.0 * angles_rad), np.sin(2.0 * angles_rad)], axis=1)
    counts = measured @ STOKES
    naive = np.linalg.solve(measured.T @ measured, measured.T @ counts)
    try:
        ours = float(np.max(np.abs(design(angles_rad, np.inf).inverse @ counts - STOKES)))
    except ValueError:
        return float(np.linalg.cond(measured)), float(np.max(np.abs(naive - STOKES))), None
    return float(np.linalg.cond(measured)), float(np.max(np.abs(naive - STOKES))), ours


def lines() -> Iterator[str]:
    """Yield the lines of the page."""
    yield _HEAD
    yield _VARIANCE
    for snr in (1e4, 1e5, 1e6, 1e8, 1e9):
        naive, ours = naive_std(snr), our_std(snr)
        apart, first = abs(naive / ours - 1.0), first_order_std(snr)
        yield f"| {snr:.0e} | {naive:.10e} | {apart:.0e} | {ours:.10e} | {first:.10e} |"
    yield _TAIL
    for name, naive, ours, truth in misses():
        yield f"| {name} | {naive:g} | {ours:.12e} | {truth:.12e} |"
    yield _NORMAL
    for step_deg in (10.0, 1.0, 0.1, 0.01, 0.001):
        condition, naive, by_us = stokes_errors(step_deg)
        yield f"| {step_deg:g} | {condition:.1e} | {naive:.0e} | {'refused' if by_us is None else f'{by_us:.0e}'} |"


def main() -> None:
    """Write the page."""
    PAGE.write_text("\n".join([*lines(), ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
