"""Existence of the moments of DoLP, and what exists without them.

DoLP divides by S0. If S0 can come close to zero, the density of DoLP falls so slowly that the mean diverges
logarithmically and the variance like the inverse of a cut-off. Both depend on the cut-off by an amount that is
computed here; where it is below the tolerance, the moments exist for all purposes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.dolp_distribution.distribution import pair_tails
from model.processing.dolp_distribution.frame import DolpFrame, dolp_frame
from model.processing.dolp_distribution.quantile import quantile
from model.quadrature import integrate_panels
from model.special_functions import ndtr

FloatArray = NDArray[np.float64]

# Cut-offs between this share of the mean of S0 and the mean itself are taken to be equally good.
_CUT_OFF = 0.01
_PANEL_ENDS = (1e-10, 1e-4, 0.05, 0.5, 0.95, 1.0 - 1e-4, 1.0 - 1e-10)


@dataclass(frozen=True, kw_only=True)
class Ambiguity:
    """Change by the choice of a cut-off near S0 = 0, each of shape (M,).

    Parameters
    ----------
    mean
        Change of the mean of DoLP.
    square
        Change of the mean square.
    dark
        Pr(S0 <= 0).
    """

    mean: FloatArray
    square: FloatArray
    dark: FloatArray


@dataclass(frozen=True, kw_only=True)
class AlwaysExisting:
    """Statistics of DoLP that exist with or without moments.

    Parameters
    ----------
    prob_not_positive
        Pr(S0 <= 0): share of samples without a DoLP, shape (...).
    probabilities, quantiles
        Quantiles of DoLP given S0 > 0, shape (K,) and (..., K).
    clipped_mean, clipped_std
        Mean and standard deviation of min(DoLP, 1) given S0 > 0, shape (...).
    """

    prob_not_positive: FloatArray
    probabilities: FloatArray
    quantiles: FloatArray
    clipped_mean: FloatArray
    clipped_std: FloatArray


def ambiguity(frame: DolpFrame) -> Ambiguity:
    """Return how far the moments of DoLP depend on how S0 near zero is treated.

    Parameters
    ----------
    frame
        M distributions.

    Returns
    -------
    Ambiguity
        With f the density of S0 at zero and q the rms length of (S1, S2) there: f q ln(100) for the mean,
        100 f q^2 / mean of S0 for the mean square.
    """
    sigma = np.where(frame.sigma_0 > 0.0, frame.sigma_0, 1.0)
    snr = np.where(frame.sigma_0 > 0.0, frame.mean_0 / sigma, np.inf)
    at_zero = np.exp(-0.5 * np.minimum(snr**2, 1500.0)) / (sigma * np.sqrt(2.0 * np.pi))
    # (S1, S2) given S0 = 0 is the excess over a common factor, in units of sigma_0.
    square = (frame.excess_1**2 + frame.excess_2**2) / sigma**2 + frame.radius_1**2 + frame.radius_2**2
    bright = np.maximum(frame.mean_0, 1e-300)
    known = frame.sigma_0 == 0.0
    return Ambiguity(
        mean=np.where(known, 0.0, -at_zero * np.sqrt(square) * np.log(_CUT_OFF)),
        square=np.where(known, 0.0, at_zero * square / (_CUT_OFF * bright)),
        dark=np.where(known, 0.0, ndtr(-snr)),
    )


def always_existing(
    stokes_mean: ArrayLike,
    stokes_cov: ArrayLike,
    *,
    probabilities: ArrayLike = (0.001, 0.025, 0.16, 0.5, 0.84, 0.975, 0.999),
) -> AlwaysExisting:
    """Return Pr(S0 <= 0), quantiles of DoLP, and the moments of min(DoLP, 1), which always exist.

    Parameters
    ----------
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3), positive semi-definite.
    probabilities
        For which to give quantiles, shape (K,).

    Returns
    -------
    AlwaysExisting
        All but the first given S0 > 0.

    Raises
    ------
    ValueError
        If the arguments are no mean and covariance, or S0 > 0 has no probability.
    """
    frame, shape = dolp_frame(stokes_mean, stokes_cov)
    levels = np.asarray(probabilities, dtype=np.float64)
    mean, cov = np.asarray(stokes_mean)[..., None, :], np.asarray(stokes_cov)[..., None, :, :]
    clipped_mean, clipped_std = _clipped(frame, quantile(_PANEL_ENDS, mean, cov).reshape(-1, len(_PANEL_ENDS)))
    return AlwaysExisting(
        prob_not_positive=ndtr(-frame.snr_0).reshape(shape)[()],
        probabilities=levels,
        quantiles=quantile(levels, mean, cov),
        clipped_mean=clipped_mean.reshape(shape)[()],
        clipped_std=clipped_std.reshape(shape)[()],
    )


def _clipped(frame: DolpFrame, ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the moments of min(DoLP, 1) as integrals of its tails about its median."""
    inside = np.minimum(ends, 1.0)
    centre = inside[:, len(_PANEL_ENDS) // 2]
    cuts = np.concatenate([np.zeros((len(frame), 1)), inside, np.ones((len(frame), 1))], axis=1)

    def integrand(index: NDArray[np.int64], x: FloatArray) -> FloatArray:
        found = pair_tails(frame[np.repeat(index, x.shape[1])], x.ravel())
        away = x - centre[index][:, None]
        tail = np.where(away < 0.0, -found.lower.reshape(x.shape), found.upper.reshape(x.shape))
        return np.stack([tail, 2.0 * away * tail])

    cuts = np.sort(cuts, axis=1)
    found = integrate_panels(integrand, cuts=cuts, tolerance=1e-9, noise=np.full(len(frame), 1e-13))
    shift, square = found.value[:, 0], found.value[:, 1]
    return centre + shift, np.sqrt(np.maximum(square - shift**2, 0.0))
