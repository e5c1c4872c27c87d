"""References of the matrix: another solver, random draws; of the statistics alone, extended precision."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.special import chdtri

from model.processing.detection import rx_p_detection, rx_p_miss
from model.processing.dolp import moments
from rigctl.errors import ConfigError
from rigctl.verbs.predict import predict
from tests.hard_cases.cases import HardCase
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
_LARGEST_CONDITION = 1e10
_DRAWS, _P_FALSE_ALARM = 2_000_000, 1e-3
# What sasktran2 does not do: it does not see nearer than 1 deg to the horizon, and needs a level for 0.01 of depth.
_NO_SOLVER = {
    "view 89.9 deg": "none: sasktran2 is wrong nearer than 1 deg to the horizon; see the round earth",
    "view 89.99 deg": "none: sasktran2 is wrong nearer than 1 deg to the horizon; see the round earth",
    "aerosol of depth 50": "none: sasktran2 refuses the 5000 levels that it needs",
}
# Below it a double has fewer digits, or none.
_LEAST = 1e-300


def reference_of(case: HardCase, folder: Path) -> str:
    """Return what else says what a prediction is: another solver of the sky, or draws from the law of the pixels.

    Parameters
    ----------
    case
        Which.
    folder
        With its files.
    """
    if case.name in _NO_SOLVER:
        return _NO_SOLVER[case.name]
    by_solver = "material" in case.text
    try:
        found = predict(folder / "scene.toml", engine="sasktran2" if by_solver else "own", calibrations="none")
    except ConfigError:
        return "refused by what the file says"
    numbers = found.predictions["black"].quantities
    if by_solver:
        snr = numbers.get("dolp_snr", {}).get("mean")
        return f"DoLP {numbers['dolp']['mean']:.5g}{'' if snr is None else f', SNR {snr:.4g}'} by sasktran2"
    stated = f"DoLP {case.dolp:g} as stated"
    if "mean" not in numbers.get("dolp_snr", {}):
        return stated
    laws = [found.predictions[name].stokes_dn for name in ("black", "white")]
    return f"{stated}; {_by_draws(*((law.mean, law.cov) for law in laws))} by {_DRAWS:.0e} draws"


def _by_draws(target: tuple[np.ndarray, np.ndarray], background: tuple[np.ndarray, np.ndarray]) -> str:
    """SNR of DoLP, and the share of draws that a detector with the background's moments finds."""
    mean, cov = target
    sizes, axes = np.linalg.eigh(cov)
    drawn = np.random.default_rng(23).standard_normal((_DRAWS, 3)) * np.sqrt(np.maximum(sizes, 0.0))
    stokes = mean + drawn @ axes.T
    dolp = np.hypot(stokes[:, 1], stokes[:, 2]) / stokes[:, 0]
    text = f"SNR {dolp.mean() / dolp.std():.4g}"
    if np.linalg.eigvalsh(background[1])[0] <= 0.0 or np.linalg.cond(background[1]) > _LARGEST_CONDITION:
        return text
    off = stokes - background[0]
    distance = np.einsum("ni,ij,nj->n", off, np.linalg.inv(background[1]), off)
    return f"{text}, P_D {np.mean(distance > chdtri(3.0, _P_FALSE_ALARM)):.3g}"


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
