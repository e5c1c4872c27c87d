"""The ROC of the RX detector by Monte Carlo, as [MK14] has it: an option and an oracle, not the way to make one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import covariance_factor
from model.processing.detection import rx_threshold
from model.processing.detection_distribution import background_condition

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DrawnRoc:
    """Detection probabilities counted among random vectors, shape of the false alarm probabilities.

    `standard_error` is that of `p_detection`, that of a drawn threshold included.
    """

    p_false_alarm: FloatArray
    threshold: FloatArray
    p_detection: FloatArray
    standard_error: FloatArray


def rx_draws(
    p_false_alarm: ArrayLike,
    target_mean: ArrayLike,
    target_cov: ArrayLike,
    background_mean: ArrayLike,
    background_cov: ArrayLike,
    *,
    draws: int,
    generator: np.random.Generator,
    draw_threshold: bool = False,
) -> DrawnRoc:
    """Return detection probabilities counted among random vectors, each with its standard error.

    Parameters
    ----------
    p_false_alarm
        Any shape, in (0, 1).
    target_mean, background_mean
        Shape (n,), one unit.
    target_cov, background_cov
        Shape (n, n), that unit squared.
    draws
        Number of target vectors, 2 or more; as many background vectors where the threshold is drawn.
    generator
        Source of the random numbers.
    draw_threshold
        False takes the threshold from its closed form, True from background vectors, as the paper does.

    Returns
    -------
    DrawnRoc
        Counted probabilities. A standard error stays above 1/(2 draws) where nothing or everything was detected.

    Raises
    ------
    ValueError
        If an argument is out of its range, or a drawn threshold would rest on less than one false alarm.

    Notes
    -----
    The exact curve (`detection.rx_roc`) is both faster and more accurate.

    References
    ----------
    [MK14] eq. (30), section IV-B.
    """
    p = np.asarray(p_false_alarm, dtype=np.float64)
    _require_draws(p, draws, draw_threshold)
    mean_b, cov_b = np.asarray(background_mean, dtype=np.float64), np.asarray(background_cov, dtype=np.float64)
    background_condition(cov_b)
    to_white = np.linalg.inv(np.linalg.cholesky(cov_b))
    shift = to_white @ (np.asarray(target_mean, dtype=np.float64) - mean_b)
    found = _statistics(shift, to_white @ covariance_factor(target_cov), draws, generator)
    if not draw_threshold:
        threshold = rx_threshold(p, mean_b.size)
        detected = _share_above(found, threshold)
        return _roc(p, threshold, detected, _binomial_error(detected, draws))
    alarms = _statistics(np.zeros_like(shift), np.eye(mean_b.size), draws, generator)
    threshold = _drawn_threshold(alarms, p)
    detected = _share_above(found, threshold)
    # one standard deviation of the false alarms up and down, carried over to the detections
    spread = np.sqrt(p * (1.0 - p) / draws)
    low, high = (_share_above(found, _drawn_threshold(alarms, p + side * spread)) for side in (-1.0, 1.0))
    return _roc(p, threshold, detected, np.hypot(_binomial_error(detected, draws), 0.5 * (high - low)))


def _require_draws(p: FloatArray, draws: int, draw_threshold: bool) -> None:
    if not np.all((p > 0.0) & (p < 1.0)):
        raise ValueError(f"p_false_alarm has values from {np.min(p)} to {np.max(p)}; allowed is above 0, below 1")
    if draws < 2:
        raise ValueError(f"draws is {draws}; allowed is 2 or more")
    if draw_threshold and np.min(p, initial=1.0) * draws < 1.0:
        raise ValueError(
            f"{draws} draws hold less than one false alarm at p_false_alarm {np.min(p):g}; allowed is 1/draws or more, "
            "or a threshold in closed form (draw_threshold=False)"
        )


def _statistics(shift: FloatArray, factor: FloatArray, draws: int, generator: np.random.Generator) -> FloatArray:
    """Return sorted values of |shift + factor z|^2."""
    vectors = factor @ generator.standard_normal((factor.shape[-1], draws))
    vectors += shift[:, None]
    return np.sort(np.einsum("ij,ij->j", vectors, vectors))


def _share_above(ordered: FloatArray, threshold: FloatArray) -> FloatArray:
    below = np.searchsorted(ordered, threshold, side="right")
    return np.asarray(1.0 - below / ordered.size, dtype=np.float64)


def _drawn_threshold(ordered: FloatArray, p: FloatArray) -> FloatArray:
    rank = np.clip(np.ceil((1.0 - p) * ordered.size).astype(np.intp) - 1, 0, ordered.size - 1)
    return np.asarray(ordered[rank], dtype=np.float64)


def _binomial_error(share: FloatArray, draws: int) -> FloatArray:
    """Return the standard error of a counted share; half a count stands for none, so that it is never zero."""
    safe = (share * draws + 0.5) / (draws + 1.0)
    return np.asarray(np.sqrt(safe * (1.0 - safe) / draws), dtype=np.float64)


def _roc(p: FloatArray, threshold: FloatArray, detected: FloatArray, error: FloatArray) -> DrawnRoc:
    return DrawnRoc(p_false_alarm=p, threshold=threshold, p_detection=detected, standard_error=error)
