"""Consequences of an effect: from changes of mean and covariance of a region to bounds of a prediction."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model.effects.bound import EVERYTHING, Bound, Disturbance
from model.effects.radiance_bounds import RegionBounds, share_of
from model.processing.detection_distribution import CONDITION_LIMIT
from model.special_functions import erfc

FloatArray = NDArray[np.float64]

_ANYTHING = replace(EVERYTHING, detection=0.0)
# S0 falls this many deviations below its mean in one pixel of three million. Where that is nearer to zero than a
# quarter of the mean nothing is guaranteed: the pixels' DoLP then has hardly any moments.
_TAIL = 5.0
_LARGEST_TAIL = 0.75
# Polarised light so many deviations above its noise is as good as normal.
_CLEAR = 8.0
# Largest share of a covariance for which the bounds below are taken: beyond, they are of no use.
_LARGEST_SHARE = 0.3
# Largest density of the distance of a normal vector from a point, times the least of its deviations. It is the Gaussian
# surface of a ball: 0.59 about the mean, less elsewhere; a slab, the extreme of convex bodies known, has 0.80.
_SURFACE = 1.0
# Statistic of a background that is above in one pixel of 1e12.
_HARDLY, _PASSED = 60.0, 1e-12
# Means that are computed in two ways differ by rounding, a share of S0 of this size.
_ROUNDING = 1e-14


def bound_of(bounds: RegionBounds, found: Disturbance) -> Bound:
    """Return what a disturbance does to the numbers of one region at most; detection is left at 0.

    Parameters
    ----------
    bounds
        The region.
    found
        The disturbance.

    Notes
    -----
    Covariance: where the eigenvalues of the one covariance over the other lie within 1 - x and 1 + x, the likelihood
    ratio L of the two normal distributions has var L <= (1 - x^2)^(-3/2) - 1 =: c^2 (chi-square divergence), and by
    Cauchy and Schwarz the mean of the pixels' DoLP changes by at most c times its deviation, its variance by at most 2
    c + c^2 of itself (kurtosis up to 5). Deviations of what is linear change by at most x.

    A factor 1 + e common to a pixel's Stokes vector leaves its DoLP as it is with the rest of its fluctuation over 1 +
    e: a mixture of distributions, whose divergence is at most the mean of theirs, 6 <e^2>, as of a share of 2 rms(e).

    Mean: with |dS0| <= a S0 and |d(S1, S2)| <= b S0 ratios change by at most (b + a P) / (1 - a): of a factor 1 + a of
    all of the mean only the noise beside it tells, which is 1 + a times as large in proportion. The deviation of DoLP
    changes as its gradient does: by no more than (1.42 b / P + 2 a) / (1 - a - b / P) times the largest deviation of a
    Stokes parameter over the least, both without a factor common to each pixel; and where polarised light is not clear
    of its noise by no more than the change over the deviation, and the noise beside the factor.

    References
    ----------
    Definition; Cauchy-Schwarz with the chi-square divergence of two normal distributions.
    """
    if found.is_nothing:
        return Bound()
    share = found.share if found.share_of_dolp is None else found.share_of_dolp
    tail = _TAIL * np.sqrt(bounds.cov_high[0, 0]) / bounds.s0_low if bounds.is_known else np.inf
    if not (
        tail < _LARGEST_TAIL
        and found.s0 < 0.5
        and found.polarised < 0.5
        and share < _LARGEST_SHARE
        and found.share < 1.0
    ):
        return _ANYTHING
    shift = (found.s0 + found.polarised) / (1.0 - found.s0)
    turned = _turned(bounds, found)
    divergence = _divergence(share)
    low, high = deviation_limits(bounds)
    dolp_low = bounds.polarised_low / bounds.s0_high
    spread = _of_variance(divergence, share)
    if not spread < 0.5:
        return _ANYTHING
    spread += _of_gradient(bounds, found, turned=turned, low=low, dolp_low=dolp_low, tail=tail)
    if not spread < 0.5:
        return _ANYTHING
    snr = _of_mean(found, divergence, high=high, dolp_low=dolp_low, tail=tail)
    return Bound(
        radiance=_of_counts(bounds, found, shift),
        ratios=min(shift / (1.0 - tail) + divergence * high, _of_ratios(found, turned, share, high=high, tail=tail)),
        # An SNR to first order knows no common factor: it grows as the deviation falls.
        deviations=max((spread + snr + found.factor) / (1.0 - spread), (1.0 - found.share) ** -0.5 - 1.0, found.share),
    )


def detection_bound(
    target: RegionBounds, of_target: Disturbance, background: RegionBounds, of_background: Disturbance, *, eta: float
) -> float:
    """Return what disturbances of target and background do to a probability of detection at most.

    Parameters
    ----------
    target, of_target, background, of_background
        The regions and what is done to them.
    eta
        Largest threshold of the statistic.

    Notes
    -----
    Target: two distributions whose covariances differ by x have a total variation of at most c / 2, two whose means
    differ by h deviations at most 0.4 h. Background: another mean is a shift of the target; another covariance moves
    the ellipsoid of detection by at most x sqrt(eta) of its deviations, and a normal vector lies within such a shell
    with at most its width times the Gaussian surface of a ball over the least deviation of the target along it. Where
    the two differ in S0 by many deviations a target is missed so rarely, with and without, that nothing more changes,
    if the background keeps so much of its covariance that there is such a probability.

    References
    ----------
    [MK14] eq. (30); definition of total variation; Ball, Discrete Comput. Geom. 10 (1993) 411 for the surface.
    """
    if of_target.is_nothing and of_background.is_nothing:
        return 0.0
    if not (target.is_known and background.is_known):
        return np.inf
    missed = _missed(target, of_target, background, of_background, eta=eta)
    if max(of_target.share, of_background.share) >= _LARGEST_SHARE:
        return missed if missed < 1.0 and _lasts(background, of_background.share) else np.inf
    moved = _shift_in_deviations(of_target, target, target) + _shift_in_deviations(of_background, background, target)
    ratio = share_of(background.cov_high, target.noise_low) if of_background.share > 0.0 else 0.0
    shell = _SURFACE * np.sqrt(eta) * of_background.share * np.sqrt(ratio) if of_background.share > 0.0 else 0.0
    return float(min(0.4 * moved + 0.5 * _divergence(of_target.share) + shell, missed, 1.0))


def _missed(
    target: RegionBounds, of_target: Disturbance, background: RegionBounds, of_background: Disturbance, *, eta: float
) -> float:
    """Largest chance of a miss with or without an effect, by S0 alone; of thresholds that background hardly passes."""
    shifts = [
        region.s0_high * (found.s0 + found.factor)
        for region, found in ((target, of_target), (background, of_background))
    ]
    apart = max(target.s0_low - background.s0_high, background.s0_low - target.s0_high) - sum(shifts)
    of_background_s0, of_target_s0 = (
        np.sqrt(region.cov_high[0, 0] * (1.0 + found.share)) if np.isfinite(found.share) else np.inf
        for region, found in ((background, of_background), (target, of_target))
    )
    clear = apart - np.sqrt(max(eta, _HARDLY)) * of_background_s0
    if not (np.isfinite(clear) and clear > 0.0):
        return 1.0
    return float(erfc(clear / (np.sqrt(2.0) * of_target_s0))) + _PASSED if of_target_s0 > 0.0 else _PASSED


def _lasts(background: RegionBounds, share: float) -> bool:
    """Return whether a covariance that loses this share along any direction is still one that targets are told from."""
    if not (share < 1.0 and np.all(np.isfinite(background.cov_high))):
        return False
    least, most = np.linalg.eigvalsh(background.noise_low)[0], np.linalg.eigvalsh(background.cov_high)[-1]
    return bool((1.0 - share) * least * CONDITION_LIMIT > most)


def deviation_limits(bounds: RegionBounds) -> tuple[float, float]:
    """Return a lower and an upper limit of the deviation of a pixel's DoLP.

    Parameters
    ----------
    bounds
        Of the region, with light for certain.

    References
    ----------
    Definition; least and largest eigenvalue of the covariance, with S0 up to five deviations below its mean.
    """
    least = np.sqrt(max(float(np.linalg.eigvalsh(bounds.noise_low)[0]), 0.0)) / bounds.s0_high
    if not np.all(np.isfinite(bounds.cov_high)):
        return least, np.inf
    tail = _TAIL * np.sqrt(bounds.cov_high[0, 0]) / bounds.s0_low
    most = np.sqrt(2.0 * float(np.linalg.eigvalsh(bounds.own_high)[-1])) / bounds.s0_low / (1.0 - tail)
    return least, most


def _turned(bounds: RegionBounds, found: Disturbance) -> float:
    """Most that DoLP, S1/S0 and S2/S0 change: what is left of a change of the mean beside a factor common to it."""
    dolp_high = min(bounds.polarised_high / bounds.s0_low, 1.0)
    return (found.polarised + found.s0 * dolp_high) / (1.0 - found.s0)


def _of_ratios(found: Disturbance, turned: float, share: float, *, high: float, tail: float) -> float:
    """Change of the ratios of the mean, and of the mean of the pixels' DoLP."""
    # A factor common to the mean is one of the noise beside it.
    beside = share + (1.0 + found.s0) ** 2 - 1.0
    return turned / (1.0 - tail) + _divergence(beside) * high if beside < 1.0 else np.inf


def _of_variance(divergence: float, share: float) -> float:
    """Relative change of a deviation, half of what its variance changes by; infinite where that is too much."""
    variance = 2.0 * divergence + divergence**2 + share
    return 0.5 * variance / (1.0 - variance) if variance < 0.5 else np.inf


def _of_gradient(
    bounds: RegionBounds, found: Disturbance, *, turned: float, low: float, dolp_low: float, tail: float
) -> float:
    """Relative change of the deviations of DoLP, S1/S0 and S2/S0 by another mean."""
    if found.s0 == 0.0 and found.polarised == 0.0:
        return 0.0
    if low == 0.0 or dolp_low == 0.0:
        return np.inf
    # A factor common to a pixel's Stokes vector goes with the mean, and no gradient of a ratio sees it.
    most = np.sqrt(float(np.linalg.eigvalsh(bounds.own_high)[-1]))
    # The gradient (-P, u) / S, u a unit vector, turns by the change of polarised light over itself; P changes as much.
    of_direction = found.polarised / dolp_low
    if not of_direction + found.s0 < 1.0:
        return np.inf
    of_gradient = (np.sqrt(2.0) * of_direction + 2.0 * found.s0) / (1.0 - of_direction - found.s0)
    by_gradient = most / (low * bounds.s0_high) * of_gradient
    if (1.0 - tail) * bounds.polarised_low > _CLEAR * most:
        return float(by_gradient)
    scaled = (1.0 + found.s0) ** 2 - 1.0
    by_scale = _of_variance(_divergence(scaled), scaled) if scaled < _LARGEST_SHARE else np.inf
    return float(max(by_gradient, 1.5 * turned / low + by_scale))


def _of_mean(found: Disturbance, divergence: float, *, high: float, dolp_low: float, tail: float) -> float:
    """Relative change of the mean of the pixels' DoLP: by another distribution, and about another mean.

    The first is the divergence times the deviation over the mean, which is below 1 of any DoLP.
    """
    spread = min(divergence, divergence * high / (dolp_low * (1.0 - tail)) if dolp_low > 0.0 else np.inf)
    if found.s0 + found.polarised == 0.0:
        return spread
    if dolp_low == 0.0:
        return np.inf
    moved = found.s0 + (found.polarised + _ROUNDING) / dolp_low
    return float(moved / ((1.0 - found.s0) * (1.0 - tail)) + spread)


def _of_counts(bounds: RegionBounds, found: Disturbance, shift: float) -> float:
    """Change of the Stokes parameters over S0, and of counts each over itself."""
    moved = shift + found.counts
    if moved == 0.0:
        return found.factor
    darkest = float(np.min(bounds.signal_low))
    return moved * max(1.0, bounds.s0_high / darkest if darkest > 0.0 else np.inf) + found.factor


def _shift_in_deviations(found: Disturbance, moved: RegionBounds, seen: RegionBounds) -> float:
    """Shift of a mean in deviations of the target."""
    length = np.hypot(found.s0 + found.factor, found.polarised + found.factor) * moved.s0_high
    if length == 0.0:
        return 0.0
    least = float(np.linalg.eigvalsh(seen.noise_low)[0])
    return float(length / np.sqrt(least)) if least > 0.0 else np.inf


def _divergence(share: float) -> float:
    """Root of the chi-square divergence of normal distributions of three components; 0 gives 0 without rounding."""
    return float(np.sqrt(np.expm1(-1.5 * np.log1p(-(share**2)))))
