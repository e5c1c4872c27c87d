"""Distribution of DoLP given S0 > 0 for Gaussian Stokes parameters: cdf, density, quantiles.

Not approximated: to rounding at any signal-to-noise ratio, in either tail, for singular covariances too.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.dolp_distribution.degenerate import (
    in_a_plane_through_zero,
    line_tails,
    on_a_line,
    plane_tails,
)
from model.processing.dolp_distribution.frame import DolpFrame, dolp_frame
from model.processing.dolp_distribution.tails import Tails, tails

FloatArray = NDArray[np.float64]

# Pairs at once: the arrays then stay in the cache.
_CHUNK = 32


def cdf(x: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> FloatArray:
    """Return Pr(DoLP <= x | S0 > 0).

    Parameters
    ----------
    x
        Degree of linear polarization; broadcast against the leading axes of the other arguments.
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3), positive semi-definite; singular is allowed.

    Returns
    -------
    ndarray
        Probability; a small one has full relative precision. 0 for x < 0.

    Raises
    ------
    ValueError
        If the arguments are no mean and covariance, x is not a number, or S0 > 0 has no probability.

    Notes
    -----
    Naive DoLP, as computed from Stokes parameters: values above 1 have probability.

    References
    ----------
    Definition; derivation in `model.processing.dolp_distribution.cone`.
    """
    return distribution_tails(x, stokes_mean, stokes_cov).lower


def probability_above(x: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> FloatArray:
    """Return Pr(DoLP > x | S0 > 0).

    Parameters
    ----------
    x
        Degree of linear polarization; broadcast against the leading axes of the other arguments.
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3), positive semi-definite.

    Returns
    -------
    ndarray
        Probability; a small one has full relative precision. 1 for x < 0.

    Raises
    ------
    ValueError
        As for `cdf`.
    """
    return distribution_tails(x, stokes_mean, stokes_cov).upper


def pdf(x: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> FloatArray:
    """Return the probability density of DoLP given S0 > 0.

    Parameters
    ----------
    x
        Degree of linear polarization; broadcast against the leading axes of the other arguments.
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3), positive semi-definite.

    Returns
    -------
    ndarray
        Density per unit of DoLP; infinite where DoLP takes one value with a positive probability.

    Raises
    ------
    ValueError
        As for `cdf`.

    References
    ----------
    Same distribution as L. Montier et al., A&A 574 (2015) A135, doi:10.1051/0004-6361/201322271, for S0 > 0.
    """
    return distribution_tails(x, stokes_mean, stokes_cov).density


def distribution_tails(x: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> Tails:
    """Return lower tail, upper tail and density of DoLP given S0 > 0, together.

    Parameters
    ----------
    x
        Degree of linear polarization; broadcast against the leading axes of the other arguments.
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3), positive semi-definite.

    Returns
    -------
    Tails
        Arrays of the broadcast shape.

    Raises
    ------
    ValueError
        As for `cdf`.
    """
    frame, index, values, shape = paired(x, stokes_mean, stokes_cov, name="x")
    if np.any(np.isnan(values)):
        raise ValueError(f"x has {np.sum(np.isnan(values))} values that are not a number")
    found = pair_tails(frame[index], values)
    return Tails(
        lower=found.lower.reshape(shape)[()],
        upper=found.upper.reshape(shape)[()],
        density=found.density.reshape(shape)[()],
    )


def paired(
    values: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike, *, name: str
) -> tuple[DolpFrame, NDArray[np.int64], FloatArray, tuple[int, ...]]:
    """Return frames, the frame of each value, the values flattened, and the broadcast shape.

    Parameters
    ----------
    values
        Broadcast against the leading axes of the other arguments.
    stokes_mean, stokes_cov
        Shapes (..., 3) and (..., 3, 3).
    name
        What the caller calls `values`, for the message.

    Returns
    -------
    frame, index, values, shape
        Distribution number index[k] goes with value number k.

    Raises
    ------
    ValueError
        If shapes do not fit, or the arguments are no mean and covariance.
    """
    frame, lead_shape = dolp_frame(stokes_mean, stokes_cov)
    array = np.asarray(values, dtype=np.float64)
    try:
        shape = np.broadcast_shapes(array.shape, lead_shape)
    except ValueError as error:
        raise ValueError(
            f"{name} of shape {array.shape} and distributions of shape {lead_shape} do not broadcast"
        ) from error
    index = np.broadcast_to(np.arange(len(frame)).reshape(lead_shape), shape).ravel()
    return frame, index, np.broadcast_to(array, shape).ravel().copy(), shape


def pair_tails(frame: DolpFrame, x: FloatArray) -> Tails:
    """Return both tails and the density for pairs of any distribution and any value.

    Parameters
    ----------
    frame
        M distributions.
    x
        DoLP, shape (M,), any number.

    Returns
    -------
    Tails
        Given S0 > 0.
    """
    lower = np.where(x > 0.0, 1.0, 0.0)
    density = np.zeros_like(x)
    result = Tails(lower=lower, upper=1.0 - lower, density=density)
    inner = (x > 0.0) & np.isfinite(x)
    line, plane = on_a_line(frame), in_a_plane_through_zero(frame)
    _fill(result, frame, x, inner & line, line_tails)
    _fill(result, frame, x, inner & plane, plane_tails)
    _fill(result, frame, x, inner & ~line & ~plane, tails)
    return result


def _fill(
    result: Tails,
    frame: DolpFrame,
    x: FloatArray,
    chosen: NDArray[np.bool_],
    distribution: Callable[[DolpFrame, FloatArray], Tails],
) -> None:
    index = np.flatnonzero(chosen)
    for start in range(0, index.size, _CHUNK):
        part = index[start : start + _CHUNK]
        found = distribution(frame[part], x[part])
        result.lower[part], result.upper[part], result.density[part] = found.lower, found.upper, found.density
