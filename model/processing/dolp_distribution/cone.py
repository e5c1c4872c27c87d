"""Probability that Gaussian Stokes parameters lie in the cone DoLP <= x, S0 > 0, and its density in x.

Seen from the apex S = 0, a direction at angle theta from the mean carries a probability that depends on theta
alone once space is whitened. With Hc(theta), the chance of a direction farther off than theta, the probability
of any region of directions is a line integral along its border (Stokes's theorem on the sphere of directions):

    Pr(cone) = [mean inside] - 1/(2 pi) integral of Hc dphi,       phi = azimuth about the direction of the mean,
    Hc(theta) = Phi(-kappa) + cos(theta) exp(-(kappa sin(theta))^2 / 2) Phi(kappa cos(theta)),

kappa being the Mahalanobis distance of the apex. The border of the cone is v(beta) = (a, b cos beta, b sin beta)
with x = b / a, so everything is one periodic integral over beta, for one nappe of the cone, at any signal-to-noise
ratio, and for singular covariances. Where the border runs close to the mean, the complement 1 - Hc is used.
All differences that cancel at high signal-to-noise ratio are formed before squaring.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.processing.dolp_distribution.frame import DolpFrame
from model.quadrature import gauss_legendre
from model.special_functions import erfcx, ndtr

FloatArray = NDArray[np.float64]

_SQRT_2PI = np.sqrt(2.0 * np.pi)
# Beyond this the apex is never reached, and the distance itself no longer matters.
_FAR = 1e8


@dataclass(frozen=True, kw_only=True)
class Border:
    """Borders of M cones: one frame and one ratio b / a each.

    Parameters
    ----------
    frame
        M distributions.
    a, b
        Shape (M,), >= 0, not both zero: the border is the directions (a, b cos beta, b sin beta).
    """

    frame: DolpFrame
    a: FloatArray
    b: FloatArray

    def __getitem__(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> "Border":
        return Border(frame=self.frame[index], a=self.a[index], b=self.b[index])

    @property
    def gap(self) -> FloatArray:
        """Signed distance b mean_0 - a |mean of (S1, S2)|: positive where the mean is inside."""
        return np.asarray(self.b * self.frame.mean_0 - self.a * self.frame.polarized)


@dataclass(frozen=True, kw_only=True)
class Directions:
    """Quantities of the integrands at directions on borders, shape (K, n).

    Parameters
    ----------
    exponent
        Half of the squared Mahalanobis distance from the mean to the line along the direction.
    cosine
        Cosine of the whitened angle between direction and mean.
    size
        Length of the whitened direction times sigma_0 radius_2.
    turning
        dphi / dbeta.
    kappa, mean_size, depth
        Shape (K, 1): distance of the apex, at most 1e8; the same times sigma_0 radius_2; sigma_0 radius_2.
    """

    exponent: FloatArray
    cosine: FloatArray
    size: FloatArray
    turning: FloatArray
    kappa: FloatArray
    mean_size: FloatArray
    depth: FloatArray


def directions(border: Border, offset: FloatArray) -> Directions:
    """Return the whitened geometry at points of the borders.

    Parameters
    ----------
    border
        K borders.
    offset
        beta minus the polarization angle (doubled) of the mean, shape (K, n) [rad].

    Returns
    -------
    Directions
        At each point.
    """
    f, a, b = border.frame, border.a[:, None], border.b[:, None]
    cross_1, cross_2 = _cross_product(border, offset)
    inner, tilt_1, tilt_2 = _common_fluctuation(border, offset, cross_1, cross_2)
    squared = inner**2 + (f.radius_1[:, None] * cross_1) ** 2 + (f.radius_2[:, None] * cross_2) ** 2
    thinness = (f.radius_2 / f.radius_1)[:, None]
    depth = (f.sigma_0 * f.radius_2)[:, None]
    along_0, along_1, along_2 = a * f.radius_2[:, None], tilt_1 * thinness, tilt_2
    mean_0 = (f.mean_0 * f.radius_2)[:, None]
    mean_1, mean_2 = f.excess_1[:, None] * thinness, f.excess_2[:, None]
    size = np.sqrt(along_0**2 + along_1**2 + along_2**2)
    mean_size = np.sqrt(mean_0**2 + mean_1**2 + mean_2**2)
    cosine = (along_0 * mean_0 + along_1 * mean_1 + along_2 * mean_2) / (size * mean_size)
    radius = f.radius_1[:, None]
    swing = b * (border.gap[:, None] + 2.0 * a * f.polarized[:, None] * np.sin(0.5 * offset) ** 2)
    return Directions(
        exponent=squared / (2.0 * (radius * size) ** 2),
        cosine=np.clip(cosine, -1.0, 1.0),
        size=size,
        turning=radius * mean_size * swing / np.where(squared > 0.0, squared, 1.0),
        kappa=np.minimum(mean_size / np.maximum(depth, 1e-290), _FAR),
        mean_size=mean_size,
        depth=depth,
    )


def beyond(d: Directions) -> FloatArray:
    """Return Hc: the chance of a direction farther from the mean's than this one.

    Parameters
    ----------
    d
        Directions.

    Returns
    -------
    ndarray
        Shape (K, n), in [0, 1].
    """
    reach = d.kappa * d.cosine
    front = ndtr(-d.kappa) + d.cosine * np.exp(-d.exponent) * ndtr(reach)
    # Behind the apex the two terms cancel; with Mills ratios they do so without underflow.
    mills = erfcx(d.kappa / np.sqrt(2.0)) - np.abs(d.cosine) * erfcx(np.abs(reach) / np.sqrt(2.0))
    back = 0.5 * np.exp(-0.5 * d.kappa**2) * mills
    return np.where(d.cosine >= 0.0, front, back)


def within(d: Directions) -> FloatArray:
    """Return H = 1 - Hc, with full relative precision close to the mean's direction.

    Parameters
    ----------
    d
        Directions.

    Returns
    -------
    ndarray
        Shape (K, n), in [0, 1].
    """
    sine_squared = np.minimum(2.0 * d.exponent / d.kappa**2, 1.0)
    close = (d.cosine > 0.5) & (sine_squared < 0.75)
    cosine = np.sqrt(1.0 - np.where(close, sine_squared, 0.0))
    lost = _lost(sine_squared, d, close)
    gap = np.where(close, 2.0 * d.exponent / (d.kappa * (1.0 + cosine)), 0.0)
    near = ndtr(d.kappa) * lost + (1.0 - lost) * _normal_slice(d.kappa, gap)
    return np.where(close, near, 1.0 - beyond(d))


def density(border: Border, d: Directions) -> FloatArray:
    """Return the joint density of DoLP and beta, with S0 > 0 (not divided by its probability).

    Parameters
    ----------
    border
        K borders.
    d
        Their directions.

    Returns
    -------
    ndarray
        Shape (K, n). For a = 1: density in x = b; for b = 1: density in a = 1 / DoLP.
    """
    reach = d.kappa * d.cosine
    decay = np.exp(-0.5 * d.kappa**2)
    weight = d.depth**2 + (d.mean_size * d.cosine) ** 2
    front = weight * np.exp(-d.exponent) * _SQRT_2PI * ndtr(reach) + d.depth * d.mean_size * d.cosine * decay
    mills = np.sqrt(0.5 * np.pi) * erfcx(np.abs(reach) / np.sqrt(2.0))
    back = decay * d.depth**2 * ((1.0 + reach**2) * mills - np.abs(reach))
    radial = np.where(d.cosine >= 0.0, front, back) / (d.size**3 * _SQRT_2PI**3)
    return np.asarray((border.b / border.frame.radius_1)[:, None] * radial)


def nearness(d: Directions) -> FloatArray:
    """Return minus the logarithm of the scale of the integrand: half the squared distance to the mean.

    Parameters
    ----------
    d
        Directions.

    Returns
    -------
    ndarray
        Shape (K, n); behind the apex its own distance.
    """
    return np.where(d.cosine > 0.0, d.exponent, 0.5 * d.kappa**2)


def _cross_product(border: Border, offset: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the components 1 and 2 of direction x mean, from the gap so that nothing cancels."""
    f = border.frame
    angle = np.arctan2(f.mean_2, f.mean_1)[:, None]
    gap, pull = border.gap[:, None], (2.0 * border.a * f.polarized)[:, None] * np.sin(0.5 * offset)
    beta, middle = angle + offset, angle + 0.5 * offset
    return gap * np.sin(beta) + pull * np.cos(middle), pull * np.sin(middle) - gap * np.cos(beta)


def _common_fluctuation(
    border: Border, offset: FloatArray, cross_1: FloatArray, cross_2: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the S0 component of L'(direction x mean), and the direction's deviation from the slopes.

    Where S0 is well known, both are formed from the excess, which is free of cancellation for a common factor.
    """
    f, a, b = border.frame, border.a[:, None], border.b[:, None]
    beta = np.arctan2(f.mean_2, f.mean_1)[:, None] + offset
    bright = (f.mean_0 > f.sigma_0)[:, None]
    mean_0 = np.where(bright, f.mean_0[:, None], 1.0)
    sigma, excess_1, excess_2 = f.sigma_0[:, None], f.excess_1[:, None], f.excess_2[:, None]
    slope_1, slope_2 = f.slope_1[:, None], f.slope_2[:, None]
    turned = -sigma * b * f.polarized[:, None] * np.sin(offset) + slope_1 * cross_1 + slope_2 * cross_2
    inner = np.where(bright, -(cross_1 * excess_1 + cross_2 * excess_2) / mean_0, turned)
    tilt_1 = np.where(bright, (a * excess_1 - sigma * cross_2) / mean_0, sigma * b * np.cos(beta) - a * slope_1)
    tilt_2 = np.where(bright, (a * excess_2 + sigma * cross_1) / mean_0, sigma * b * np.sin(beta) - a * slope_2)
    return inner, tilt_1, tilt_2


def _lost(sine_squared: FloatArray, d: Directions, close: NDArray[np.bool_]) -> FloatArray:
    """Return 1 - cos(theta) exp(-exponent)."""
    log_cosine = 0.5 * np.log1p(-np.where(close, sine_squared, 0.0))
    return np.asarray(-np.expm1(log_cosine - d.exponent))


def _normal_slice(upper: FloatArray, width: FloatArray) -> FloatArray:
    """Return the standard normal probability of the interval of given width that ends at `upper`."""
    nodes, weights = gauss_legendre(4)
    points = upper[..., None] - width[..., None] * nodes
    narrow = width * (np.exp(-0.5 * points**2) @ weights) / _SQRT_2PI
    return np.where(width < 0.1, narrow, ndtr(upper) - ndtr(upper - width))
