"""Estimators of the true degree of linear polarization behind a measured one, which noise makes too large."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import i0e

from model.processing.estimator_curves import share_curve, zero_threshold
from model.quadrature import gauss_legendre

FloatArray = NDArray[np.float64]

Estimator = Literal["naive", "asymptotic", "wardle_kronberg", "maximum_likelihood", "mean", "median", "mas"]
ESTIMATORS: tuple[Estimator, ...] = get_args(Estimator)

_REACH = 13.0  # standard deviations; the Rice distribution beyond holds less than 1e-36
_PANELS = 16
_NODES = 20


@dataclass(frozen=True, kw_only=True)
class EstimatorError:
    """Bias (mean estimate less truth) and rms error of an estimator, in units of the noise."""

    bias: FloatArray
    rms: FloatArray


def true_snr(measured_snr: ArrayLike, estimator: Estimator) -> FloatArray:
    """Return the estimate of the true DoLP over its noise from the measured DoLP over its noise.

    Parameters
    ----------
    measured_snr
        sqrt(S1^2 + S2^2) over the standard deviation of S1 and of S2; any shape, 0 or more.
    estimator
        "naive": as measured.
        "asymptotic": sqrt(r^2 - 1), 0 below r = 1.
        "wardle_kronberg": the true value whose most frequent measured value is r; 0 below 1.
        "maximum_likelihood": the true value that makes r most likely; 0 below sqrt(2).
        "mean", "median": the true value whose mean or median measured value is r; 0 below 1.2533 or 1.1774.
        "mas": r - (1 - exp(-r^2))/(2 r), smooth and above 0 for all r > 0.

    Returns
    -------
    ndarray
        Shape of `measured_snr`; error below 1e-9.

    Raises
    ------
    ValueError
        If a value is negative or not a number, or the estimator is unknown.

    Notes
    -----
    None is unbiased at low signal: `bias_and_rms` says by how much. From 5 on all but the naive one are.

    References
    ----------
    Serkowski, Acta Astron. 8, 135 (1958); Wardle & Kronberg, ApJ 194, 249 (1974), doi:10.1086/153240;
    Simmons & Stewart, A&A 142, 100 (1985); Plaszczynski et al., MNRAS 439, 4048 (2014),
    doi:10.1093/mnras/stu270.
    """
    measured = np.asarray(measured_snr, dtype=np.float64)
    if not np.all(measured >= 0.0):
        raise ValueError(f"measured_snr has values down to {np.min(measured)}; allowed is 0 or more")
    if estimator not in ESTIMATORS:
        raise ValueError(f"estimator is {estimator!r}; allowed is one of {', '.join(ESTIMATORS)}")
    if estimator == "naive":
        return measured.copy()
    if estimator == "mas":
        return _mas(measured)
    if estimator == "asymptotic":
        return np.sqrt(np.maximum(measured**2 - 1.0, 0.0))
    above = measured > zero_threshold(estimator)
    inverse = 1.0 / np.where(above, measured, np.inf) ** 2
    share = np.asarray(share_curve(estimator)(inverse), dtype=np.float64)
    return np.where(above, measured * np.sqrt(np.maximum(share, 0.0)), 0.0)


def bias_and_rms(estimator: Estimator, true_snr_values: ArrayLike) -> EstimatorError:
    """Return bias and rms error of an estimator against the true DoLP over its noise.

    Parameters
    ----------
    estimator
        See `true_snr`.
    true_snr_values
        Any shape, 0 or more: true DoLP over the standard deviation of S1/S0 and of S2/S0, equal and uncorrelated.

    Returns
    -------
    EstimatorError
        In units of that standard deviation; absolute error below 1e-9 (plus rounding of the true value).

    Raises
    ------
    ValueError
        If a value is negative or not finite, or the estimator is unknown.

    Notes
    -----
    Gauss-Legendre quadrature over the Rice distribution of the measured value, r = r_0 + x^2 above the value r_0 where
    the estimate leaves 0: most estimators rise there as the root of r - r_0.

    References
    ----------
    Rice, Bell Syst. Tech. J. 24, 46 (1945), doi:10.1002/j.1538-7305.1945.tb00453.x; definition.
    """
    truth = np.asarray(true_snr_values, dtype=np.float64)
    if not np.all((truth >= 0.0) & np.isfinite(truth)):
        raise ValueError(f"true_snr_values has values down to {np.min(truth)}; allowed is 0 or more, finite")
    flat = truth.reshape(-1, 1)
    kink = zero_threshold(estimator) if estimator in ESTIMATORS else 0.0
    low = np.maximum(flat - _REACH, 0.0)
    high = np.maximum(flat + _REACH, kink)
    start = np.maximum(low, kink)
    node, weight = _composite()
    root = np.sqrt(high - start) * node
    measured = start + root**2
    mass = 2.0 * root * np.sqrt(high - start) * weight * _rice_density(measured, flat)
    error = true_snr(measured, estimator) - flat
    unseen = _mass(low, np.minimum(np.maximum(kink, low), high), flat)
    bias = np.sum(mass * error, axis=1) - unseen * flat[:, 0]
    square = np.sum(mass * error**2, axis=1) + unseen * flat[:, 0] ** 2
    return EstimatorError(bias=bias.reshape(truth.shape), rms=np.sqrt(square).reshape(truth.shape))


def _mas(measured: FloatArray) -> FloatArray:
    safe = np.where(measured > 0.0, measured, 1.0)
    return np.where(measured > 0.0, measured + np.expm1(-(safe**2)) / (2.0 * safe), 0.0)


def _rice_density(measured: FloatArray, truth: FloatArray) -> FloatArray:
    density = measured * np.exp(-0.5 * (measured - truth) ** 2) * i0e(measured * truth)
    return np.asarray(density, dtype=np.float64)


def _mass(low: FloatArray, high: FloatArray, truth: FloatArray) -> FloatArray:
    node, weight = _composite()
    inside = low + (high - low) * node
    mass: FloatArray = np.sum((high - low) * weight * _rice_density(inside, truth), axis=1)
    return mass


def _composite() -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights of equal Gauss-Legendre panels on (0, 1)."""
    node, weight = gauss_legendre(_NODES)
    panels = np.arange(_PANELS)[:, None]
    return ((panels + node) / _PANELS).ravel(), np.tile(weight / _PANELS, _PANELS)
