"""The RX detector with known background: threshold, detection probability, ROC and its area, exactly."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.detection_distribution import DetectionDistribution, condition_warnings, detection_distribution
from model.processing.quadratic_forms import chi_square
from model.processing.quadratic_forms.quadratic_form import TailProbabilities, tail_probabilities

FloatArray = NDArray[np.float64]

_TOLERANCE = 1e-10


@dataclass(frozen=True, kw_only=True)
class RxRoc:
    """A receiver operating characteristic of the RX detector.

    `p_false_alarm`, `threshold`, `p_detection` and `p_miss` have one shape; `error` is the estimated relative error
    of that of the two probabilities which was integrated (the upper tail at and above the mean of D, else the lower).
    `auc` is the area under the whole curve, `auc_error` the estimated relative error of the smaller of it and
    1 - `auc`; both have the leading shape of the class moments. `background_condition` is the condition number of the
    background covariance. `warnings` says what limits the result, and is empty as a rule.
    """

    p_false_alarm: FloatArray
    threshold: FloatArray
    p_detection: FloatArray
    p_miss: FloatArray
    error: FloatArray
    auc: FloatArray
    auc_error: FloatArray
    background_condition: FloatArray
    warnings: tuple[str, ...]


def rx_threshold(p_false_alarm: ArrayLike, dim: int = 3) -> FloatArray:
    """Return the threshold that the RX statistic of the background exceeds with the given probability.

    Parameters
    ----------
    p_false_alarm
        Any shape, in [0, 1]; 0 gives infinity, 1 gives 0.
    dim
        Number of components of the vector: 3 for Stokes, N for N intensity channels.

    Returns
    -------
    ndarray
        Threshold of D, no unit; accurate to rounding.

    Raises
    ------
    ValueError
        If a probability is not in [0, 1] or `dim` is below 1.

    Notes
    -----
    For three components p = erfc(sqrt(t/2)) + sqrt(2 t/pi) exp(-t/2). Differs from [MK14]: there it is drawn.

    References
    ----------
    [MK14] eq. (30); definition.
    """
    p = np.asarray(p_false_alarm, dtype=np.float64)
    if not np.all((p >= 0.0) & (p <= 1.0)):
        raise ValueError(f"p_false_alarm has values from {np.min(p)} to {np.max(p)}; allowed is 0 to 1")
    if dim < 1:
        raise ValueError(f"dim is {dim}; allowed is 1 or more")
    return chi_square.upper_quantile(p, dim)


def rx_p_detection(
    p_false_alarm: ArrayLike,
    target_mean: ArrayLike,
    target_cov: ArrayLike,
    background_mean: ArrayLike,
    background_cov: ArrayLike,
    *,
    tolerance: float = _TOLERANCE,
) -> FloatArray:
    """Return the probability that the RX statistic of a target exceeds the threshold of a false alarm probability.

    Parameters
    ----------
    p_false_alarm
        In [0, 1]; its shape broadcasts with the leading axes of the moments.
    target_mean, background_mean
        Stokes vectors or intensities of N channels, shape (..., n), all of one unit.
    target_cov
        Covariance of the target, noise included, shape (..., n, n); may be singular. Zero is a target without
        spread: the result is then 0 or 1.
    background_cov
        Covariance of the background, noise included, shape (..., n, n).
    tolerance
        Relative, of the tail that is integrated, 1e-12 to 0.01.

    Returns
    -------
    ndarray
        P_D, accurate relative to itself where it is small (see `rx_p_miss` for where it is close to 1).

    Raises
    ------
    ValueError
        If an argument is out of its range, or the background covariance is singular to 1e-12.

    Notes
    -----
    Exact for Gaussian classes. A curve may lie below the diagonal: a target less spread than its background and
    close to its mean is what RX misses. Differs from [MK14]: there 1e5 vectors are drawn.

    References
    ----------
    [MK14] eq. (30); definition.
    """
    distribution = detection_distribution(target_mean, target_cov, background_mean, background_cov)
    return _tails(_threshold(p_false_alarm, distribution), distribution, tolerance).upper


def rx_p_miss(
    p_false_alarm: ArrayLike,
    target_mean: ArrayLike,
    target_cov: ArrayLike,
    background_mean: ArrayLike,
    background_cov: ArrayLike,
    *,
    tolerance: float = _TOLERANCE,
) -> FloatArray:
    """Return the probability that the RX statistic of a target does not exceed the threshold.

    It is 1 - P_D, accurate relative to itself where P_D is close to 1. Arguments, errors and limits are those of
    `rx_p_detection`.

    References
    ----------
    [MK14] eq. (30); definition.
    """
    distribution = detection_distribution(target_mean, target_cov, background_mean, background_cov)
    return _tails(_threshold(p_false_alarm, distribution), distribution, tolerance).lower


def rx_roc(
    p_false_alarm: ArrayLike,
    target_mean: ArrayLike,
    target_cov: ArrayLike,
    background_mean: ArrayLike,
    background_cov: ArrayLike,
    *,
    tolerance: float = _TOLERANCE,
) -> RxRoc:
    """Return thresholds, detection and miss probabilities, and the area under the whole curve.

    Arguments, errors and limits are those of `rx_p_detection`. The area is the probability that the statistic of
    a target exceeds that of an independent background pixel, by the same integral.

    References
    ----------
    [MK14] eq. (30); the area: definition.
    """
    distribution = detection_distribution(target_mean, target_cov, background_mean, background_cov)
    threshold = _threshold(p_false_alarm, distribution)
    tails = _tails(threshold, distribution, tolerance)
    area = _area(distribution, tolerance)
    shape = tails.upper.shape
    return RxRoc(
        p_false_alarm=np.broadcast_to(np.asarray(p_false_alarm, dtype=np.float64), shape),
        threshold=np.broadcast_to(threshold, shape),
        p_detection=tails.upper,
        p_miss=tails.lower,
        error=tails.error,
        auc=area.upper,
        auc_error=area.error,
        background_condition=distribution.condition,
        warnings=condition_warnings(distribution.condition),
    )


def _threshold(p_false_alarm: ArrayLike, distribution: DetectionDistribution) -> FloatArray:
    return rx_threshold(p_false_alarm, distribution.weights.shape[-1])


def _tails(threshold: FloatArray, distribution: DetectionDistribution, tolerance: float) -> TailProbabilities:
    return tail_probabilities(
        threshold, distribution.weights, distribution.offsets, constant=distribution.constant, tolerance=tolerance
    )


def _area(distribution: DetectionDistribution, tolerance: float) -> TailProbabilities:
    """Return P(D of a target > chi-square of the background) and its complement."""
    dim = distribution.weights.shape[-1]
    background = np.full((*distribution.weights.shape[:-1], 1), -1.0)
    weights = np.concatenate([distribution.weights, background], axis=-1)
    offsets = np.concatenate([distribution.offsets, np.zeros_like(background)], axis=-1)
    degrees = np.append(np.ones(dim), float(dim))
    return tail_probabilities(
        0.0, weights, offsets, degrees=degrees, constant=distribution.constant, tolerance=tolerance
    )
