"""The RX detector: thresholds, detection probability and ROC, with known or estimated background.

With m and S the mean and the unbiased covariance of n background pixels, D = (x - m)' S^-1 (x - m). Given x - m,
the ratio of the quadratic form with the true covariance to that with S is an independent chi-square variable of
n - dim degrees of freedom over n - 1 (Wishart). So {D > t} is {Q - t/(n - 1) chi-square > 0}, where Q is the form
of a target whose covariance is larger by background_cov/n: one quadratic form again, whatever the covariances.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import checked_pair, require_covariance
from model.numerics import betainccinv, betaincinv
from model.processing import quadratic_forms as chi_square
from model.processing.quadratic_forms import TailProbabilities, tail_probabilities

FloatArray = NDArray[np.float64]

_TOLERANCE = 1e-10


def rx_p_detection(
    p_false_alarm: ArrayLike,
    target_mean: ArrayLike,
    target_cov: ArrayLike,
    background_mean: ArrayLike,
    background_cov: ArrayLike,
    *,
    tolerance: float = _TOLERANCE,
) -> FloatArray:
    """Return the probability that the RX statistic of a target exceeds the threshold for a false alarm probability.

    Parameters
    ----------
    p_false_alarm
        In [0, 1]; its shape broadcasts with the leading axes of the moments.
    target_mean, background_mean
        Stokes vectors or intensities of N channels, shape (..., n), all of one unit.
    target_cov
        Covariance of the target, noise included, shape (..., n, n); may be singular. Zero is a target without spread,
        with the result 0 or 1.
    background_cov
        Covariance of the background, noise included, shape (..., n, n).
    tolerance
        Relative tolerance of the integrated tail, 1e-12 to 0.01.

    Returns
    -------
    ndarray
        P_D, with relative accuracy where it is small (see `rx_p_miss` for values close to 1).

    Raises
    ------
    ValueError
        If an argument is out of its range, or the background covariance is singular to 1e-12.

    Notes
    -----
    Exact for Gaussian classes. A curve may lie below the diagonal: RX misses targets of less spread than the background
    and close to its mean. Differs from [MK14]: there 1e5 vectors are drawn.

    References
    ----------
    [MK14] eq. (30); definition.
    """
    distribution = _detection_distribution(target_mean, target_cov, background_mean, background_cov)
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

    It is 1 - P_D, with relative accuracy where P_D is close to 1. Arguments, errors and limits are those of
    `rx_p_detection`.

    References
    ----------
    [MK14] eq. (30); definition.
    """
    distribution = _detection_distribution(target_mean, target_cov, background_mean, background_cov)
    return _tails(_threshold(p_false_alarm, distribution), distribution, tolerance).lower


@dataclass(frozen=True, kw_only=True)
class RxRoc:
    """A receiver operating characteristic of the RX detector.

    `p_false_alarm`, `threshold`, `p_detection` and `p_miss` have one shape; `error` is the estimated relative error of
    the integrated probability (the upper tail at and above the mean of D, else the lower). `auc` is the area under the
    whole curve, `auc_error` the estimated relative error of the smaller of it and 1 - `auc`; both have the leading
    shape of the class moments. `background_condition` is the condition number of the background covariance. `warnings`
    lists limits of the result, usually none.
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
    distribution = _detection_distribution(target_mean, target_cov, background_mean, background_cov)
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


@dataclass(frozen=True, kw_only=True)
class SampleRxRoc:
    """A receiver operating characteristic of the RX detector with estimated background.

    Probabilities are those over target, noise and training pixels alike. `error` is the estimated relative error of the
    integrated probability; `warnings` lists limits of the result.
    """

    p_false_alarm: FloatArray
    threshold: FloatArray
    p_detection: FloatArray
    p_miss: FloatArray
    error: FloatArray
    warnings: tuple[str, ...]


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
        Relative tolerance of the integrated tail, 1e-12 to 0.01.

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
    tails, condition = _tails_detection_sample(p_false_alarm, moments, n_pixels, pixel_in_sample, tolerance)
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


CONDITION_LIMIT = 1e12
_CONDITION_WARNING = 1e8
_ALIKE = 0.5  # largest entry of the whitened difference of covariances for a decomposition of the difference
_NO_SPREAD = 1e-30  # relative weight below which a component is a constant


def background_condition(background_cov: FloatArray) -> FloatArray:
    """Return the condition number of each covariance."""
    require_covariance(background_cov, name="background_cov")
    values = np.linalg.eigvalsh(background_cov)
    smallest, largest = values[..., 0], values[..., -1]
    bad = ~(smallest * CONDITION_LIMIT > largest)
    if np.any(bad):
        raise ValueError(
            f"background_cov is singular to double precision: its eigenvalues span {np.min(smallest[bad]):.3g} to "
            f"{np.max(largest[bad]):.3g}; allowed is a condition number of at most {CONDITION_LIMIT:g}. Leave out "
            "channels that are combinations of others, or add the noise that they really have"
        )
    return np.asarray(largest / smallest, dtype=np.float64)


def condition_warnings(condition: FloatArray) -> tuple[str, ...]:
    """Return a warning if the condition of the background limits the result."""
    worst = float(np.max(condition, initial=1.0))
    if worst <= _CONDITION_WARNING:
        return ()
    moved = worst * np.finfo(float).eps
    said = f"background_cov has condition number {worst:.2g}: rounding of the arguments may change P_D by {moved:.1g}"
    return (said,)


def sample_threshold(
    p_false_alarm: ArrayLike, n_pixels: int, dim: int = 3, *, pixel_in_sample: bool = False
) -> FloatArray:
    """Return the threshold that the RX statistic of a background pixel exceeds with the given probability.

    Parameters
    ----------
    p_false_alarm
        Any shape, in [0, 1].
    n_pixels
        Pixels for the estimates of mean and unbiased covariance; more than `dim`, or `dim` + 1 if they include the
        tested pixel.
    dim
        Number of components of the vector.
    pixel_in_sample
        Whether the n pixels include the tested one, as for a whole picture as its own background.

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


@dataclass(frozen=True, kw_only=True)
class _DetectionDistribution:
    """D = constant + sum_j weights_j (z_j + offsets_j)^2, z standard normal, and the condition of the background.

    `weights` and `offsets` have shape (..., n), `constant` and `condition` the leading shape.
    """

    weights: FloatArray
    offsets: FloatArray
    constant: FloatArray
    condition: FloatArray


def _detection_distribution(
    target_mean: ArrayLike, target_cov: ArrayLike, background_mean: ArrayLike, background_cov: ArrayLike
) -> _DetectionDistribution:
    """Return the distribution of D = (x - m_b)' S_b^-1 (x - m_b) for x ~ N(m_t, S_t).

    For similar covariances the difference is decomposed, so that a target equal to its background has weights of
    exactly 1; otherwise singular values of a factor keep small weights accurate.

    [MK14] eq. (30); definition.
    """
    mean_t, cov_t = checked_pair(target_mean, target_cov)
    mean_b, cov_b = checked_pair(background_mean, background_cov)
    if mean_t.shape[-1] != mean_b.shape[-1]:
        raise ValueError(
            f"target_mean has {mean_t.shape[-1]} components and background_mean {mean_b.shape[-1]}; "
            "allowed is the same number"
        )
    require_covariance(cov_t, name="target_cov")
    condition = background_condition(cov_b)
    scale = np.sqrt(np.diagonal(cov_b, axis1=-2, axis2=-1))
    area = scale[..., :, None] * scale[..., None, :]
    root = np.linalg.cholesky(cov_b / area)
    shift = np.linalg.solve(root, ((mean_t - mean_b) / scale)[..., None])
    weights, axes = _principal_axes(root, cov_t / area, (cov_t - cov_b) / area)
    along = np.sum(axes * shift, axis=-2)
    return _distribution(weights, along, condition)


def _principal_axes(root: FloatArray, cov: FloatArray, difference: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return weights and axes (as columns) of root^-1 cov root^-T."""
    whitened = _whitened(root, difference)
    values, axes = np.linalg.eigh(whitened)
    alike = np.max(np.abs(whitened), axis=(-2, -1)) < _ALIKE
    if np.all(alike):
        return 1.0 + values, axes
    other_axes, singular, _ = np.linalg.svd(np.linalg.solve(root, _graded_factor(cov)))
    weights = np.where(alike[..., None], 1.0 + values, singular**2)
    return weights, np.where(alike[..., None, None], axes, other_axes)


def _whitened(root: FloatArray, matrix: FloatArray) -> FloatArray:
    half = np.linalg.solve(root, matrix)
    full = np.linalg.solve(root, np.swapaxes(half, -1, -2))
    return np.asarray(0.5 * (full + np.swapaxes(full, -1, -2)), dtype=np.float64)


def _graded_factor(cov: FloatArray) -> FloatArray:
    """Return F with F F' = cov, from the correlation matrix: rows of very different size keep their accuracy."""
    variance = np.diagonal(cov, axis1=-2, axis2=-1)
    deviation = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    values, vectors = np.linalg.eigh(cov / (deviation[..., :, None] * deviation[..., None, :]))
    root = np.sqrt(np.maximum(values, 0.0))
    return np.asarray(deviation[..., :, None] * vectors * root[..., None, :], dtype=np.float64)


def _distribution(weights: FloatArray, along: FloatArray, condition: FloatArray) -> _DetectionDistribution:
    largest = np.max(weights, axis=-1, keepdims=True)
    spread = weights > np.maximum(_NO_SPREAD * largest, np.finfo(float).tiny)
    kept = np.where(spread, weights, 0.0)
    offsets = np.where(spread, along / np.sqrt(np.where(spread, weights, 1.0)), 0.0)
    constant = np.sum(np.where(spread, 0.0, along**2), axis=-1)
    full = np.broadcast_shapes(kept.shape, offsets.shape)
    return _DetectionDistribution(
        weights=np.broadcast_to(kept, full),
        offsets=offsets,
        constant=constant,
        condition=np.broadcast_to(condition, full[:-1]),
    )


def _tails(threshold: FloatArray, distribution: _DetectionDistribution, tolerance: float) -> TailProbabilities:
    return tail_probabilities(
        threshold, distribution.weights, distribution.offsets, constant=distribution.constant, tolerance=tolerance
    )


def _threshold(p_false_alarm: ArrayLike, distribution: _DetectionDistribution) -> FloatArray:
    return rx_threshold(p_false_alarm, distribution.weights.shape[-1])


def _area(distribution: _DetectionDistribution, tolerance: float) -> TailProbabilities:
    """Return P(D of a target > chi-square of the background) and its complement."""
    dim = distribution.weights.shape[-1]
    background = np.full((*distribution.weights.shape[:-1], 1), -1.0)
    weights = np.concatenate([distribution.weights, background], axis=-1)
    offsets = np.concatenate([distribution.offsets, np.zeros_like(background)], axis=-1)
    degrees = np.append(np.ones(dim), float(dim))
    return tail_probabilities(
        0.0, weights, offsets, degrees=degrees, constant=distribution.constant, tolerance=tolerance
    )


def _tails_detection_sample(
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
    distribution = _detection_distribution(target_mean, seen, background_mean, background_cov)
    lead = np.broadcast_shapes(threshold.shape, distribution.constant.shape)
    scatter = np.broadcast_to(-threshold / (training - 1), lead)[..., None]
    weights = np.concatenate([np.broadcast_to(distribution.weights, (*lead, dim)), scatter], axis=-1)
    offsets = np.concatenate([np.broadcast_to(distribution.offsets, (*lead, dim)), np.zeros((*lead, 1))], axis=-1)
    degrees = np.append(np.ones(dim), float(training - dim))
    tails = tail_probabilities(
        0.0, weights, offsets, degrees=degrees, constant=distribution.constant, tolerance=tolerance
    )
    return tails, distribution.condition


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
