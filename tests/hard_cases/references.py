"""Numbers of the statistics beside references in extended precision: high SNR, singular laws, deep tails."""

from collections.abc import Iterator

import numpy as np

from model.processing.detection import rx_p_detection, rx_p_miss
from model.processing.dolp import moments
from tests.model.processing.dolp_reference import dolp_cases
from tests.model.processing.rx_reference import CASES, column
from tests.model.processing.rx_reference import moments as rx_moments

_DOLP_HEAD = """## Moments of DoLP beside 170-bit quadrature

| SNR of S0 | DoLP | law | mean | its error | deviation | its error, relative |
|---|---|---|---|---|---|---|"""
_RX_HEAD = """
## Probabilities of detection beside 170-bit quadrature by two unrelated methods

The smallest of each case that a double can hold, of either tail.

| case | tail | reference | ours | relative error |
|---|---|---|---|---|"""
# Below it a double has fewer digits, or none.
_LEAST = 1e-300


def reference_lines() -> Iterator[str]:
    """Yield the lines of both tables."""
    yield _DOLP_HEAD
    yield from map(_of_dolp, dolp_cases(with_moments=True))
    yield _RX_HEAD
    for case in CASES.values():
        yield from _of_rx(case)


def _of_dolp(case: dict[str, object]) -> str:
    found = moments(np.array(case["stokes"]), np.array(case["cov"]), tolerance=1e-12)
    mean, std = float(str(case["mean"])), float(str(case["std"]))
    return (
        f"| {case['snr0']:g} | {case['p']:g} | {case['kind']} | {mean:.15g} | {abs(float(found.mean) - mean):.1e} "
        f"| {std:.15g} | {abs(float(found.std) / std - 1.0):.1e} |"
    )


def _of_rx(case: dict[str, object]) -> Iterator[str]:
    target_mean, target_cov, mean, cov = rx_moments(case)
    pfa = column(case, "pfa")
    for name, function in (("pd", rx_p_detection), ("pmiss", rx_p_miss)):
        truth = column(case, name)
        there = np.flatnonzero(truth > _LEAST)
        if there.size == 0:
            continue
        least = int(there[np.argmin(truth[there])])
        ours = float(np.asarray(function(pfa[least], target_mean, target_cov, mean, cov)))
        tail = "P_D" if name == "pd" else "1 - P_D"
        apart = abs(ours / truth[least] - 1.0)
        yield f"| {case['name']} | {tail} | {truth[least]:.12e} | {ours:.12e} | {apart:.1e} |"
