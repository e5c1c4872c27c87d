"""Distributions of s1 = S1 / S0 and s2 = S2 / S0 given S0 > 0: ratios of correlated normal variables, exactly."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.dolp_distribution import normal_ratio
from model.processing.dolp_distribution.frame import dolp_frame
from model.processing.dolp_distribution.normal_ratio import NormalRatio
from model.processing.dolp_distribution.quantile import find_quantiles

FloatArray = NDArray[np.float64]

# Share of a deviation that is rounding of a singular covariance.
_NO_FLUCTUATION = 3e-8
# Of the arsinh of the value over its scale: 1e130 scales.
_REACH = 300.0


@dataclass(frozen=True, kw_only=True)
class RatioDistribution:
    """Distribution of a normalised Stokes parameter given S0 > 0, each of the broadcast shape.

    Parameters
    ----------
    lower, upper
        Pr(s <= x | S0 > 0) and Pr(s > x | S0 > 0), each to relative precision.
    density
        Probability density at x.
    """

    lower: FloatArray
    upper: FloatArray
    density: FloatArray


def distribution(x: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike, *, component: int) -> RatioDistribution:
    """Return both tails and the density of S1 / S0 or S2 / S0 given S0 > 0.

    Parameters
    ----------
    x
        Value, finite; broadcast against the leading axes of the other arguments.
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3); the component must fluctuate apart from S0.
    component
        1 or 2.

    Returns
    -------
    RatioDistribution
        To rounding, at any signal-to-noise ratio.

    Raises
    ------
    ValueError
        If the arguments are no mean and covariance, x is not finite, the component is not 1 or 2 or has no
        fluctuation of its own, or S0 > 0 has no probability.

    Notes
    -----
    No mean exists: the density falls as 1 / x^2.

    References
    ----------
    G. Marsaglia, J. Stat. Softw. 16 (2006) 4, doi:10.18637/jss.v016.i04, for the unconditional ratio.
    """
    ratio, shift, lead_shape = _ratio(stokes_mean, stokes_cov, component)
    values = np.asarray(x, dtype=np.float64)
    if not np.all(np.isfinite(values)):
        raise ValueError("x has values that are not finite")
    shape = np.broadcast_shapes(values.shape, lead_shape)
    index = np.broadcast_to(np.arange(shift.size).reshape(lead_shape), shape).ravel()
    found = _distribution(_rows(ratio, index), np.broadcast_to(values, shape).ravel() - shift[index])
    return RatioDistribution(
        lower=found.lower.reshape(shape)[()],
        upper=found.upper.reshape(shape)[()],
        density=found.density.reshape(shape)[()],
    )


def quantile(p: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike, *, component: int) -> FloatArray:
    """Return the value that S1 / S0 or S2 / S0, given S0 > 0, does not exceed with probability p.

    Parameters
    ----------
    p
        Probability, above 0 and below 1; broadcast against the leading axes of the other arguments.
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3).
    component
        1 or 2.

    Returns
    -------
    ndarray
        Quantile.

    Raises
    ------
    ValueError
        If p is not between 0 and 1, or as for `distribution`.
    """
    ratio, shift, lead_shape = _ratio(stokes_mean, stokes_cov, component)
    wanted = np.asarray(p, dtype=np.float64)
    if np.any(~((wanted > 0.0) & (wanted < 1.0))):
        raise ValueError(f"p runs from {np.min(wanted)} to {np.max(wanted)}; allowed is above 0 and below 1")
    shape = np.broadcast_shapes(wanted.shape, lead_shape)
    index = np.broadcast_to(np.arange(shift.size).reshape(lead_shape), shape).ravel()
    found = _solve(_rows(ratio, index), np.broadcast_to(wanted, shape).ravel())
    return np.asarray((found + shift[index]).reshape(shape)[()])


def _ratio(
    stokes_mean: ArrayLike, stokes_cov: ArrayLike, component: int
) -> tuple[NormalRatio, FloatArray, tuple[int, ...]]:
    """Return the ratio of the part of a component that is independent of S0, and what the other part adds to it."""
    if component not in (1, 2):
        raise ValueError(f"component = {component}; allowed is 1 or 2")
    frame, shape = dolp_frame(stokes_mean, stokes_cov)
    axis = frame.axis_rad
    along, across = (np.cos(axis), -np.sin(axis)) if component == 1 else (np.sin(axis), np.cos(axis))
    known = frame.sigma_0 == 0.0
    sigma = np.where(known, 1.0, frame.sigma_0)
    own = np.hypot(along * frame.radius_1, across * frame.radius_2)
    slope = along * frame.slope_1 + across * frame.slope_2
    if np.any(own <= _NO_FLUCTUATION * np.hypot(own, slope)):
        raise ValueError(f"S{component} has no fluctuation apart from that of S0; its ratio to S0 has no density")
    excess = along * frame.excess_1 + across * frame.excess_2
    mean = along * frame.mean_1 + across * frame.mean_2
    ratio = NormalRatio(
        mean_y=np.where(known, mean, excess / sigma), sigma_y=own, mean_x=frame.mean_0, sigma_x=frame.sigma_0
    )
    return ratio, np.where(known, 0.0, slope / sigma), shape


def _rows(ratio: NormalRatio, index: NDArray[np.int64]) -> NormalRatio:
    return NormalRatio(**{name: getattr(ratio, name)[index] for name in ratio.__dataclass_fields__})


def _distribution(ratio: NormalRatio, value: FloatArray) -> RatioDistribution:
    infinite = np.full_like(value, np.inf)
    lit = normal_ratio.positive(ratio)
    return RatioDistribution(
        lower=normal_ratio.between(ratio, -infinite, value) / lit,
        upper=normal_ratio.between(ratio, value, infinite) / lit,
        density=normal_ratio.density(ratio, value) / lit,
    )


def _solve(ratio: NormalRatio, p: FloatArray) -> FloatArray:
    """Return quantiles by a search over the arsinh of the value."""
    scale = ratio.sigma_y / np.maximum(np.abs(ratio.mean_x), ratio.sigma_x)
    centre = ratio.mean_y / np.where(ratio.mean_x == 0.0, 1.0, ratio.mean_x)

    def distribution_at(index: NDArray[np.int64], place: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        found = _distribution(_rows(ratio, index), centre[index] + scale[index] * np.sinh(place))
        return found.lower, found.upper, found.density * scale[index] * np.cosh(place)

    return np.asarray(
        centre + scale * np.sinh(find_quantiles(distribution_at, p=p, start=np.zeros_like(p), reach=_REACH))
    )
