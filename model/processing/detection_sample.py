"""The RX detector whose background mean and covariance are estimated from n pixels: thresholds and ROC, exactly.

With m and S the mean and the unbiased covariance of n background pixels, D = (x - m)' S^-1 (x - m). Given x - m,
the ratio of the quadratic form with the true covariance to that with S is an independent chi-square variable of
n - dim degrees of freedom over n - 1 (Wishart). So {D > t} is {Q - t/(n - 1) chi-square > 0}, where Q is the form
of a target whose covariance is larger by background_cov/n: one quadratic form again, whatever the covariances.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.detection_distribution import condition_warnings, detection_distribution
from model.processing.quadratic_forms.quadratic_form import TailProbabilities, tail_probabilities
from model.special_functions import betainccinv, betaincinv

FloatArray = NDArray[np.float64]

_TOLERANCE = 1e-10


@dataclass(frozen=True, kw_only=True)
class SampleRxRoc:
    """A receiver operating characteristic of the RX detector with estimated background.

    Probabilities are those over target, noise and training pixels alike. `error` is the estimated relative error
    of that of the two probabilities which was integrated; `warnings` says what limits the result.
    """

    p_false_alarm: FloatArray
    threshold: FloatArray
    p_detection: FloatArray
    p_miss: FloatArray
    error: FloatArray
    warnings: tuple[str, ...]


def sample_threshold(
    p_false_alarm: ArrayLike, n_pixels: int, dim: int = 3, *, pixel_in_sample: bool = False
) -> FloatArray:
    """Return the threshold that the RX statistic of a background pixel exceeds with the given probability.

    Parameters
    ----------
    p_false_alarm
        Any shape, in [0, 1].
    n_pixels
        Pixels that mean and unbiased covariance were estimated from; more than `dim`, and more than `dim` + 1
        where the tested pixel is one of them.
    dim
        Number of components of the vector.
    pixel_in_sample
        Whether the tested pixel is one of the n, as it is when a whole picture is its own background.

    Returns
    -------
    ndarray
        Threshold of D. With the pixel in the sample it stays below (n - 1)^2/n, which D never exceeds.

    Raises
    ------
    ValueError
        If a probability is not in [0, 1], or there are too few pixels.

    References
    ----------
    Hotelling, Ann. Math. Stat. 2, 360 (1931), doi:10.1214/aoms/1177732979: n (n - dim) / (dim (n - 1)(n + 1)) D
    follows F(dim, n - dim); Gnanadesikan & Kettenring, Biometrics 28, 81 (1972), doi:10.2307/2528963: in the
    sample, n D/(n - 1)^2 follows Beta(dim/2, (n - dim - 1)/2).
    """
    p = np.asarray(p_false_alarm, dtype=np.float64)
    if not np.all((p >= 0.0) & (p <= 1.0)):
        raise ValueError(f"p_false_alarm has values from {np.min(p)} to {np.max(p)}; allowed is 0 to 1")
    first, second = _beta_orders(n_pixels, dim, pixel_in_sample)
    share = betainccinv(first, second, p)
    if pixel_in_sample:
        return np.asarray((n_pixels - 1) ** 2 / n_pixels * share, dtype=np.float64)
    with np.errstate(divide="ignore"):
        odds = share / betaincinv(second, first, p)
    return np.asarray((n_pixels - 1) * (n_pixels + 1) / n_pixels * odds, dtype=np.float64)


def sample_roc(
    p_false_alarm: ArrayLike,
    target_mean: ArrayLike,
    target_cov: ArrayLike,
    background_mean: ArrayLike,
    background_cov: ArrayLike,
    n_pixels: int,
    *,
    pixel_in_sample: bool = False,
    tolerance: float = _TOLERANCE,
) -> SampleRxRoc:
    """Return thresholds, detection and miss probabilities of a target, background estimated.

    Parameters
    ----------
    p_false_alarm
        In [0, 1]; its shape broadcasts with the leading axes of the moments. True rate for a background pixel.
    target_mean, target_cov, background_mean, background_cov
        True moments of the classes as for `detection.rx_p_detection`.
    n_pixels, pixel_in_sample
        As for `sample_threshold`. With the target pixel in the sample, the n - 1 others are background.
    tolerance
        Relative, of the tail that is integrated, 1e-12 to 0.01.

    Raises
    ------
    ValueError
        As `sample_threshold` and `detection.rx_p_detection`.

    Notes
    -----
    Exact for Gaussian classes with independent pixels, for unequal covariances too. D with the pixel in the
    sample is an increasing function of D from the n - 1 others, so both have one ROC.

    References
    ----------
    The Wishart property is Muirhead, Aspects of Multivariate Statistical Theory (1982),
    doi:10.1002/9780470316559, theorem 3.2.12.
    """
    moments = (target_mean, target_cov, background_mean, background_cov)
    tails, condition = _tails(p_false_alarm, moments, n_pixels, pixel_in_sample, tolerance)
    dim = np.shape(target_mean)[-1]
    threshold = sample_threshold(p_false_alarm, n_pixels, dim, pixel_in_sample=pixel_in_sample)
    shape = tails.upper.shape
    return SampleRxRoc(
        p_false_alarm=np.broadcast_to(np.asarray(p_false_alarm, dtype=np.float64), shape),
        threshold=np.broadcast_to(threshold, shape),
        p_detection=tails.upper,
        p_miss=tails.lower,
        error=tails.error,
        warnings=condition_warnings(condition),
    )


def _beta_orders(n_pixels: int, dim: int, pixel_in_sample: bool) -> tuple[float, float]:
    least = dim + 2 if pixel_in_sample else dim + 1
    if dim < 1 or n_pixels < least:
        where = "in" if pixel_in_sample else "outside"
        raise ValueError(
            f"n_pixels is {n_pixels} for vectors of {dim} components, tested pixel {where} the sample; allowed is "
            f"{least} or more: with fewer the estimated covariance is singular or the statistic constant"
        )
    spare = n_pixels - dim - (1 if pixel_in_sample else 0)
    return 0.5 * dim, 0.5 * spare


def _tails(
    p_false_alarm: ArrayLike,
    moments: tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike],
    n_pixels: int,
    pixel_in_sample: bool,
    tolerance: float,
) -> tuple[TailProbabilities, FloatArray]:
    """Return both tails of Q - t/(n - 1) chi-square at 0, and the condition of the background."""
    target_mean, target_cov, background_mean, background_cov = moments
    training = n_pixels - 1 if pixel_in_sample else n_pixels
    dim = np.shape(target_mean)[-1]
    threshold = sample_threshold(p_false_alarm, training, dim)
    seen = np.asarray(target_cov, dtype=np.float64) + np.asarray(background_cov, dtype=np.float64) / training
    distribution = detection_distribution(target_mean, seen, background_mean, background_cov)
    lead = np.broadcast_shapes(threshold.shape, distribution.constant.shape)
    scatter = np.broadcast_to(-threshold / (training - 1), lead)[..., None]
    weights = np.concatenate([np.broadcast_to(distribution.weights, (*lead, dim)), scatter], axis=-1)
    offsets = np.concatenate([np.broadcast_to(distribution.offsets, (*lead, dim)), np.zeros((*lead, 1))], axis=-1)
    degrees = np.append(np.ones(dim), float(training - dim))
    tails = tail_probabilities(
        0.0, weights, offsets, degrees=degrees, constant=distribution.constant, tolerance=tolerance
    )
    return tails, distribution.condition
