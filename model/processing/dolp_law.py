"""The distribution of DoLP: density, cumulative probability and quantiles.

Units are divided out, and the axes of (S1, S2) are turned to the principal axes of their covariance given S0. Then

    S0 = m0 + s z0,   S1 = m1 + c1 z0 + r1 z1,   S2 = m2 + c2 z0 + r2 z2

with independent standard normal z and r1 >= r2 >= 0, for singular covariances too.

Seen from the apex S = 0, a direction at angle theta from the mean carries a probability that depends on theta
alone once space is whitened. With Hc(theta), the chance of a direction farther off than theta, the probability
of any region of directions is a line integral along its border (Stokes's theorem on the sphere of directions):

    Pr(cone) = [mean inside] - 1/(2 pi) integral of Hc dphi,       phi = azimuth about the direction of the mean,
    Hc(theta) = Phi(-kappa) + cos(theta) exp(-(kappa sin(theta))^2 / 2) Phi(kappa cos(theta)),

kappa being the Mahalanobis distance of the apex. The border of the cone is v(beta) = (a, b cos beta, b sin beta)
with x = b / a, so everything is one periodic integral over beta, for one nappe of the cone, at any signal-to-noise
ratio, and for singular covariances. Where the border runs close to the mean, the complement 1 - Hc is used.
All differences that cancel at high signal-to-noise ratio are formed before squaring, some in twice the precision.

Where the Stokes parameters fluctuate in a plane through zero or on a line, their directions fill no area, and the line
integral has nothing to integrate. In the plane, DoLP is a function of a ratio of normal variables; on a line, of S0
alone.

Not approximated: to rounding at any signal-to-noise ratio, in either tail, for singular covariances too.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import checked_pair, require_covariance
from model.numerics import erfcx, gauss_legendre, integrate_panels, ndtr, ndtri

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]
IntArray = NDArray[np.int64]


def cdf(x: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> FloatArray:
    """Return Pr(DoLP <= x | S0 > 0).

    Naive DoLP, as computed from Stokes parameters: values above 1 have probability.

    Definition; derivation in `model.processing.dolp_law`.
    """
    return distribution_tails(x, stokes_mean, stokes_cov).lower


def probability_above(x: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> FloatArray:
    """Return Pr(DoLP > x | S0 > 0)."""
    return distribution_tails(x, stokes_mean, stokes_cov).upper


def pdf(x: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> FloatArray:
    """Return the probability density of DoLP given S0 > 0.

    Same distribution as L. Montier et al., A&A 574 (2015) A135, doi:10.1051/0004-6361/201322271, for S0 > 0.
    """
    return distribution_tails(x, stokes_mean, stokes_cov).density


@dataclass(frozen=True, kw_only=True)
class Tails:
    """Distribution of DoLP given S0 > 0 at M values, each of shape (M,)."""

    lower: FloatArray
    upper: FloatArray
    density: FloatArray


def distribution_tails(x: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> Tails:
    """Return lower tail, upper tail and density of DoLP given S0 > 0, together."""
    frame, index, values, shape = _paired(x, stokes_mean, stokes_cov, name="x")
    if np.any(np.isnan(values)):
        raise ValueError(f"x has {np.sum(np.isnan(values))} values that are not a number")
    found = _pair_tails(frame[index], values)
    return Tails(
        lower=found.lower.reshape(shape)[()],
        upper=found.upper.reshape(shape)[()],
        density=found.density.reshape(shape)[()],
    )


def quantile(p: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> FloatArray:
    """Return the value that DoLP, given S0 > 0, does not exceed with probability p.

    The search runs over the logarithm of DoLP, with the smaller tail.
    """
    frame, index, wanted, shape = _paired(p, stokes_mean, stokes_cov, name="p")
    if np.any(~((wanted >= 0.0) & (wanted <= 1.0))):
        raise ValueError(f"p runs from {np.min(wanted)} to {np.max(wanted)}; allowed is 0 to 1")
    result = np.where(wanted == 0.0, 0.0, np.inf)
    inner = (wanted > 0.0) & (wanted < 1.0)
    result[inner] = _solve(frame[index[inner]], wanted[inner])
    return np.asarray(result.reshape(shape)[()])


@dataclass(frozen=True, kw_only=True)
class DolpFrame:
    """Parameters of M Gaussian distributions, each of shape (M,), in units of `unit`."""

    mean_0: FloatArray
    mean_1: FloatArray
    mean_2: FloatArray
    sigma_0: FloatArray
    slope_1: FloatArray
    slope_2: FloatArray
    radius_1: FloatArray
    radius_2: FloatArray
    excess_1: FloatArray
    excess_2: FloatArray
    axis_rad: FloatArray
    unit: FloatArray

    def __len__(self) -> int:
        return int(self.mean_0.size)

    def __getitem__(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> "DolpFrame":
        return DolpFrame(**{name: getattr(self, name)[index] for name in self.__dataclass_fields__})

    @property
    def snr_0(self) -> FloatArray:
        """Mean over standard deviation of S0; infinite where S0 is known."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.mean_0 / self.sigma_0)

    @property
    def polarized(self) -> FloatArray:
        """Length of the mean of (S1, S2)."""
        return np.asarray(np.hypot(self.mean_1, self.mean_2))


def dolp_frame(stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> tuple[DolpFrame, tuple[int, ...]]:
    """Return the frames of Gaussian Stokes parameters, flattened, and the shape of their leading axes."""
    mean, cov = checked_pair(stokes_mean, stokes_cov)
    if mean.shape[-1] != 3:
        raise ValueError(f"stokes_mean has shape {mean.shape}; allowed is (..., 3), that is S0, S1, S2")
    require_covariance(cov, name="stokes_cov")
    shape = np.broadcast_shapes(mean.shape[:-1], cov.shape[:-2])
    flat_mean = np.broadcast_to(mean, (*shape, 3)).reshape(-1, 3)
    flat_cov = np.broadcast_to(cov, (*shape, 3, 3)).reshape(-1, 3, 3)
    dark = (flat_mean[:, 0] <= 0.0) & (flat_cov[:, 0, 0] <= 0.0)
    if np.any(dark):
        raise ValueError(f"S0 > 0 has no probability in {np.sum(dark)} places: mean <= 0 and no variance")
    return _framed(flat_mean, flat_cov), shape


def _pair_tails(frame: DolpFrame, x: FloatArray) -> Tails:
    """Return both tails and the density for pairs of any distribution and any value."""
    lower = np.where(x > 0.0, 1.0, 0.0)
    density = np.zeros_like(x)
    result = Tails(lower=lower, upper=1.0 - lower, density=density)
    inner = (x > 0.0) & np.isfinite(x)
    line, plane = _on_a_line(frame), _in_a_plane_through_zero(frame)
    _fill(result, frame, x, inner & line, _line_tails)
    _fill(result, frame, x, inner & plane, _plane_tails)
    _fill(result, frame, x, inner & ~line & ~plane, _tails)
    return result


@dataclass(frozen=True, kw_only=True)
class NormalRatio:
    """M ratios Y / X of independent normal variables, each parameter of shape (M,)."""

    mean_y: FloatArray
    sigma_y: FloatArray
    mean_x: FloatArray
    sigma_x: FloatArray


def _ratio_between(ratio: NormalRatio, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return Pr(lower < Y / X <= upper, X > 0), not divided by Pr(X > 0)."""
    distance, low, _ = _direction(ratio, lower)
    high = _direction(ratio, upper)[1]
    # Angles run from -pi to pi about the mean; the half plane X > 0 is one connected piece of them.
    high = np.where(high < low, high + 2.0 * np.pi, high)
    return _sector_probability(distance, low, high, _opening(ratio, lower, upper))


def ratio_density(ratio: NormalRatio, value: FloatArray) -> FloatArray:
    """Return the density of Y / X with X > 0, not divided by Pr(X > 0)."""
    distance, angle, jacobian = _direction(ratio, value)
    return np.asarray(_direction_density(distance, angle) * jacobian)


def ratio_positive(ratio: NormalRatio) -> FloatArray:
    """Return the probability of a positive denominator."""
    return np.asarray(ndtr(ratio.mean_x / _sigma_x(ratio)))


_MAX_STEPS = 400
# Error of the normal score at which a Newton step ends the search: what remains is of the order of its square.
_SETTLED = 1e-8
_LONGEST_STEP = 3.0


def _find_quantiles(
    distribution: Callable[[IntArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray]],
    *,
    p: FloatArray,
    start: FloatArray,
    reach: float,
) -> FloatArray:
    """Return the places at which increasing distributions reach given probabilities."""
    place, wanted = start.copy(), ndtri(p)
    low, high = np.full_like(p, -reach), np.full_like(p, reach)
    last = np.full_like(p, np.inf)
    active = np.arange(p.size)
    for _ in range(_MAX_STEPS):
        error, slope = _score_error(distribution(active, place[active]), wanted[active])
        low[active] = np.where(error < 0.0, place[active], low[active])
        high[active] = np.where(error < 0.0, high[active], place[active])
        open_ended = (low[active] == -reach) | (high[active] == reach)
        ends = low[active] - place[active], high[active] - place[active]
        last[active] = _step(error, slope, *ends, np.where(open_ended, np.inf, np.abs(last[active])))
        before = place[active]
        place[active] += last[active]
        stuck = np.abs(place[active] - before) <= 2e-16 * (1.0 + np.abs(before))
        settled = np.abs(error) * (1.0 + np.abs(wanted[active])) < _SETTLED
        unresolved = high[active] - low[active] <= 1e-15 * (1.0 + np.abs(place[active]))
        active = active[~(settled | stuck | unresolved)]
        if active.size == 0:
            return place
    raise ValueError(f"the search for {active.size} quantiles does not end; the first is p = {p[active[0]]:.17g}")


def _paired(
    values: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike, *, name: str
) -> tuple[DolpFrame, NDArray[np.int64], FloatArray, tuple[int, ...]]:
    """Return frames, the frame of each value, the values flattened, and the broadcast shape."""
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


_NO_LIGHT = 1e-60


def _framed(mean: FloatArray, cov: FloatArray) -> DolpFrame:
    unit = np.hypot(mean[:, 0], np.sqrt(np.maximum(cov[:, 0, 0], 0.0)))
    # A power of two, so that scaling rounds nothing.
    unit = np.exp2(np.round(np.log2(unit)))
    mu = mean / unit[:, None]
    sigma = 0.5 * (cov + np.swapaxes(cov, 1, 2)) / unit[:, None, None] ** 2
    sigma_0 = np.sqrt(np.maximum(sigma[:, 0, 0], 0.0))
    # A mean of exactly zero has no direction; any will do.
    mu[:, 0] = np.where(np.any(mu != 0.0, axis=1), mu[:, 0], _NO_LIGHT * sigma_0)
    radius_1, radius_2, axis = _principal(sigma)
    known = sigma_0 == 0.0
    divisor = np.where(known, 1.0, sigma_0)
    slopes = np.where(known[:, None], 0.0, sigma[:, 0, 1:] / divisor[:, None])
    excess = _excess(mu, sigma) / divisor[:, None]
    mean_1, mean_2 = _turned(mu[:, 1:], axis)
    slope_1, slope_2 = _turned(slopes, axis)
    excess_1, excess_2 = _turned(np.where(known[:, None], 0.0, excess), axis)
    return DolpFrame(
        mean_0=mu[:, 0],
        mean_1=mean_1,
        mean_2=mean_2,
        sigma_0=sigma_0,
        slope_1=slope_1,
        slope_2=slope_2,
        radius_1=radius_1,
        radius_2=radius_2,
        excess_1=excess_1,
        excess_2=excess_2,
        axis_rad=axis,
        unit=unit,
    )


def _principal(sigma: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return both standard deviations of (S1, S2) given S0, and the angle of the larger one.

    Schur complement and determinant cancel for correlated parameters and thin ellipses: they are taken in twice
    the working precision, so that the result is right for the covariance as given.
    """
    variance = np.where(sigma[:, 0, 0] > 0.0, sigma[:, 0, 0], 1.0)
    link_1, link_2 = sigma[:, 0, 1], sigma[:, 0, 2]
    first = product(variance, sigma[:, 1, 1]) - product(link_1, link_1)
    cross = product(variance, sigma[:, 1, 2]) - product(link_1, link_2)
    second = product(variance, sigma[:, 2, 2]) - product(link_2, link_2)
    determinant = (first * second - cross * cross).value / variance**2
    trace = (first + second).value / variance
    difference = (first - second).value / variance
    twice_cross = 2.0 * cross.value / variance
    larger = 0.5 * (trace + np.hypot(difference, twice_cross))
    safe = np.where(larger > 0.0, larger, 1.0)
    smaller = np.clip(determinant / safe, 0.0, np.maximum(larger, 0.0))
    axis = 0.5 * np.arctan2(twice_cross, difference)
    return np.sqrt(np.maximum(larger, 0.0)), np.sqrt(smaller), axis


@dataclass(frozen=True)
class DoubleDouble:
    """Unevaluated sum of two arrays of doubles, the second one below half an ulp of the first."""

    high: FloatArray
    low: FloatArray

    @property
    def value(self) -> FloatArray:
        """The sum, rounded to a double."""
        return np.asarray(self.high + self.low)

    def __add__(self, other: "DoubleDouble") -> "DoubleDouble":
        total, error = _two_sum(self.high, other.high)
        low_total, low_error = _two_sum(self.low, other.low)
        high, low = _quick_two_sum(total, error + low_total)
        return DoubleDouble(*_quick_two_sum(high, low + low_error))

    def __sub__(self, other: "DoubleDouble") -> "DoubleDouble":
        return self + DoubleDouble(-other.high, -other.low)

    def __mul__(self, other: "DoubleDouble") -> "DoubleDouble":
        exact = product(self.high, other.high)
        cross = self.high * other.low + self.low * other.high
        return DoubleDouble(*_quick_two_sum(exact.high, exact.low + cross))


def product(first: FloatArray, second: FloatArray) -> DoubleDouble:
    """Return the product of two arrays of doubles without rounding.

    T. J. Dekker, Numer. Math. 18 (1971) 224, doi:10.1007/BF01397083.
    """
    high = first * second
    first_high, first_low = _split(first)
    second_high, second_low = _split(second)
    error = first_high * second_high - high
    error = error + first_high * second_low + first_low * second_high
    return DoubleDouble(high, error + first_low * second_low)


def _two_sum(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    total = first + second
    shadow = total - first
    return total, (first - (total - shadow)) + (second - shadow)


def _quick_two_sum(larger: FloatArray, smaller: FloatArray) -> tuple[FloatArray, FloatArray]:
    total = larger + smaller
    return total, smaller - (total - larger)


# Splits a double into two halves of 26 bits.
_SPLITTER = 2.0**27 + 1.0


def _split(array: FloatArray) -> tuple[FloatArray, FloatArray]:
    scaled = _SPLITTER * array
    high = scaled - (scaled - array)
    return high, array - high


def _excess(mu: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return var(S0) mean_j - cov(S0, Sj) mean_0, with the cancellation done exactly."""
    variance, mean_0 = sigma[:, :1, 0], mu[:, :1]
    return np.asarray((product(variance, mu[:, 1:]) - product(sigma[:, 0, 1:], mean_0)).value)


def _turned(plane: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    cos, sin = np.cos(axis), np.sin(axis)
    return cos * plane[:, 0] + sin * plane[:, 1], cos * plane[:, 1] - sin * plane[:, 0]


@dataclass(frozen=True, kw_only=True)
class _Border:
    """Borders of M cones: one frame and one ratio b / a each."""

    frame: DolpFrame
    a: FloatArray
    b: FloatArray

    def __getitem__(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> "_Border":
        return _Border(frame=self.frame[index], a=self.a[index], b=self.b[index])

    @property
    def gap(self) -> FloatArray:
        """Signed distance b mean_0 - a |mean of (S1, S2)|: positive where the mean is inside."""
        return np.asarray(self.b * self.frame.mean_0 - self.a * self.frame.polarized)


@dataclass(frozen=True, kw_only=True)
class _Directions:
    """Quantities of the integrands at directions on borders, shape (K, n)."""

    exponent: FloatArray
    cosine: FloatArray
    size: FloatArray
    turning: FloatArray
    kappa: FloatArray
    mean_size: FloatArray
    depth: FloatArray


_SQRT_2PI = np.sqrt(2.0 * np.pi)


def _density(border: _Border, d: _Directions) -> FloatArray:
    """Return the joint density of DoLP and beta, with S0 > 0 (not divided by its probability)."""
    reach = d.kappa * d.cosine
    decay = np.exp(-0.5 * d.kappa**2)
    weight = d.depth**2 + (d.mean_size * d.cosine) ** 2
    front = weight * np.exp(-d.exponent) * _SQRT_2PI * ndtr(reach) + d.depth * d.mean_size * d.cosine * decay
    mills = np.sqrt(0.5 * np.pi) * erfcx(np.abs(reach) / np.sqrt(2.0))
    back = decay * d.depth**2 * ((1.0 + reach**2) * mills - np.abs(reach))
    radial = np.where(d.cosine >= 0.0, front, back) / (d.size**3 * _SQRT_2PI**3)
    return np.asarray((border.b / border.frame.radius_1)[:, None] * radial)


# Relative thickness below which a fluctuation is a line or a plane: what is left out is of the order of its square.
_THIN = 1e-8


def _on_a_line(frame: DolpFrame) -> Mask:
    """Return where only one combination of the Stokes parameters fluctuates, or none."""
    swing = np.hypot(frame.excess_1, frame.excess_2) / np.abs(np.where(frame.mean_0 == 0.0, 1.0, frame.mean_0))
    return np.asarray(frame.radius_1 <= _THIN * swing)


def _in_a_plane_through_zero(frame: DolpFrame) -> Mask:
    """Return where two combinations fluctuate, in a plane that holds zero light, or one with S0 known."""
    flat = frame.radius_2 <= _THIN * frame.radius_1
    through_zero = (np.abs(frame.excess_2) <= 10.0 * _THIN * frame.sigma_0 * frame.radius_1) & ~_known(frame)
    return np.asarray(flat & (through_zero | _known(frame)) & ~_on_a_line(frame))


def _known(frame: DolpFrame) -> Mask:
    """Return where S0 fluctuates so little that DoLP does not notice beside the fluctuation of S1 and S2."""
    with np.errstate(divide="ignore", invalid="ignore"):
        own = np.where(frame.sigma_0 > 0.0, frame.sigma_0 * frame.polarized / np.abs(frame.mean_0), 0.0)
    linked = np.hypot(frame.slope_1, frame.slope_2)
    return np.asarray((own + linked <= _THIN * frame.radius_1) & (frame.mean_0 > 10.0 * frame.sigma_0))


# Pairs at once: the arrays then stay in the cache.
_CHUNK = 32


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


def _line_tails(frame: DolpFrame, x: FloatArray) -> Tails:
    """Return both tails and the density of DoLP for fluctuations on a line."""
    limit_1, limit_2, pull_1, pull_2 = _line(frame)
    pull = np.hypot(pull_1, pull_2)
    fixed = pull == 0.0
    safe = np.where(fixed, 1.0, pull)
    along = (limit_1 * pull_1 + limit_2 * pull_2) / safe
    least = np.abs(limit_1 * pull_2 - limit_2 * pull_1) / safe
    half = np.sqrt(np.where(x > least, (x - least) * (x + least), 0.0))
    lit = ndtr(frame.snr_0)
    first, second = _s0_between(frame, (-along - half) / safe, (-along + half) / safe)
    lower = np.where(x >= least, first, 0.0)
    density = np.where(x > least, second * x / np.where(half > 0.0, half, 1.0) / safe, 0.0)
    step = np.hypot(limit_1, limit_2)
    lower = np.where(fixed, (x >= step) * lit, lower)
    upper = np.where(fixed, (x < step) * lit, np.where(x >= least, _s0_outside(frame, along, half, safe), lit))
    density = np.where(fixed, np.where(x == step, np.inf, 0.0), density)
    return Tails(lower=lower / lit, upper=upper / lit, density=density / lit)


def _line(frame: DolpFrame) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return k and g with (S1, S2) / S0 = k + g / S0 on the line."""
    known = frame.sigma_0 == 0.0
    sigma = np.where(known, 1.0, frame.sigma_0)
    k_1 = np.where(known, frame.mean_1 / np.where(known, frame.mean_0, 1.0), frame.slope_1 / sigma)
    k_2 = np.where(known, frame.mean_2 / np.where(known, frame.mean_0, 1.0), frame.slope_2 / sigma)
    g_1 = np.where(known, 0.0, frame.excess_1 / sigma)
    g_2 = np.where(known, 0.0, frame.excess_2 / sigma)
    return k_1, k_2, g_1, g_2


def _s0_between(frame: DolpFrame, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the probability of low <= 1 / S0 <= high with S0 > 0, and the sum of the densities of 1 / S0 there."""
    upper, lower = _score(frame, low), _score(frame, high)
    flip = lower > 0.0
    inside = ndtr(np.where(flip, -lower, upper)) - ndtr(np.where(flip, -upper, lower))
    return np.where(high > 0.0, inside, 0.0), _inverse_density(frame, low) + _inverse_density(frame, high)


def _score(frame: DolpFrame, inverse: FloatArray) -> FloatArray:
    """Return (1 / inverse - mean) / sigma of S0; plus infinity for an inverse of zero or less."""
    sigma = np.where(frame.sigma_0 == 0.0, 1.0, frame.sigma_0)
    some = inverse > 0.0
    safe = np.where(some, inverse, 1.0)
    return np.where(some, (1.0 - safe * frame.mean_0) / (safe * sigma), np.inf)


def _inverse_density(frame: DolpFrame, inverse: FloatArray) -> FloatArray:
    sigma = np.where(frame.sigma_0 == 0.0, 1.0, frame.sigma_0)
    score = _score(frame, inverse)
    bell = np.exp(-0.5 * np.minimum(score**2, 1500.0)) / np.sqrt(2.0 * np.pi)
    return np.where(inverse > 0.0, bell / (sigma * np.where(inverse > 0.0, inverse, 1.0) ** 2), 0.0)


def _s0_outside(frame: DolpFrame, along: FloatArray, half: FloatArray, pull: FloatArray) -> FloatArray:
    """Return the probability of S0 > 0 with 1 / S0 outside of the interval in which DoLP is small enough."""
    bright = ndtr(-_score(frame, (-along - half) / pull))
    high = (-along + half) / pull
    dim = ndtr(_score(frame, np.maximum(high, 0.0))) - ndtr(-frame.snr_0)
    return np.asarray(bright + dim)


def _plane_tails(frame: DolpFrame, x: FloatArray) -> Tails:
    """Return both tails and the density of DoLP for fluctuations in a plane through zero light."""
    known = _known(frame)
    sigma = np.where(known, 1.0, frame.sigma_0)
    shift = np.where(known, 0.0, frame.slope_1 / sigma)
    least = np.abs(np.where(known, frame.mean_2 / np.where(known, frame.mean_0, 1.0), frame.slope_2 / sigma))
    ratio = NormalRatio(
        mean_y=np.where(known, frame.mean_1, frame.excess_1 / sigma),
        sigma_y=frame.radius_1,
        mean_x=frame.mean_0,
        sigma_x=np.where(known, 0.0, frame.sigma_0),
    )
    possible = x >= least
    half = np.sqrt(np.where(possible, (x - least) * (x + least), 0.0))
    inside = _ratio_between(ratio, -shift - half, -shift + half)
    infinite = np.full_like(x, np.inf)
    below = _ratio_between(ratio, -infinite, -shift - half)
    above = _ratio_between(ratio, -shift + half, infinite)
    both = ratio_density(ratio, -shift - half) + ratio_density(ratio, -shift + half)
    with np.errstate(divide="ignore", invalid="ignore"):
        density = np.where(possible, both * np.where(half > 0.0, x / half, np.inf), 0.0)
    lit = ratio_positive(ratio)
    return Tails(lower=np.where(possible, inside, 0.0) / lit, upper=(below + above) / lit, density=density / lit)


def _direction(ratio: NormalRatio, value: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return distance of the whitened mean, angle of the direction (1, value) from it, and d angle / d value."""
    sigma_x = _sigma_x(ratio)
    mean_x, mean_y = ratio.mean_x / sigma_x, ratio.mean_y / ratio.sigma_y
    ahead, side = _components(ratio, value)
    infinite = np.isinf(value)
    finite = np.where(infinite, 0.0, value)
    # Cross product with the mean from the difference, so that nothing cancels at high signal to noise.
    apart = np.where(infinite, side * mean_x, (finite * ratio.mean_x - ratio.mean_y) / (sigma_x * ratio.sigma_y))
    along = ahead * mean_x + side * mean_y
    jacobian = 1.0 / (sigma_x * ratio.sigma_y * (ahead**2 + side**2))
    return np.hypot(mean_x, mean_y), np.arctan2(apart, along), jacobian


# A denominator this many standard deviations from zero is as good as known for the angle at the origin.
_FAR = 1e12


def _sigma_x(ratio: NormalRatio) -> FloatArray:
    return np.maximum(ratio.sigma_x, np.abs(ratio.mean_x) / _FAR)


def _components(ratio: NormalRatio, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the whitened direction of (1, value)."""
    infinite = np.isinf(value)
    ahead = np.where(infinite, 0.0, 1.0 / _sigma_x(ratio))
    return ahead, np.where(infinite, np.sign(value), np.where(infinite, 0.0, value) / ratio.sigma_y)


def _sector_probability(
    distance: FloatArray, lower_rad: FloatArray, upper_rad: FloatArray, opening_rad: FloatArray
) -> FloatArray:
    """Return the probability that the direction of a vector with unit covariance lies in a sector."""
    slender = opening_rad * (1.0 + distance) ** 2 < 0.1
    wide = ~slender
    result = np.empty_like(distance)
    result[slender] = _slender(distance[slender], lower_rad[slender], opening_rad[slender])
    result[wide] = _wide(distance[wide], lower_rad[wide], upper_rad[wide])
    return result


def _slender(distance: FloatArray, lower_rad: FloatArray, opening_rad: FloatArray) -> FloatArray:
    nodes, weights = gauss_legendre(10)
    angle = lower_rad[:, None] + np.multiply.outer(opening_rad, nodes)
    return np.asarray(opening_rad * (_direction_density(distance[:, None], angle) @ weights))


def _direction_density(distance: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Return the density of the direction of a vector with unit covariance.

    Definition (offset normal distribution).
    """
    along, across = distance * np.cos(angle_rad), distance * np.sin(angle_rad)
    density: FloatArray = np.exp(-0.5 * across**2) / np.sqrt(2.0 * np.pi)
    # For along < 0 the two terms of the front form cancel.
    front = np.exp(-0.5 * distance**2) / (2.0 * np.pi) + density * along * ndtr(along)
    back = 1.0 - np.abs(along) * np.sqrt(0.5 * np.pi) * erfcx(np.abs(along) / np.sqrt(2.0))
    return np.where(along >= 0.0, front, np.exp(-0.5 * distance**2) * back / (2.0 * np.pi))


_GROWTH = np.concatenate([[0.0, 0.5, 1.5, 4.0], 4.0 * 3.0 ** np.arange(1.0, 32.0)])


def _wide(distance: FloatArray, lower_rad: FloatArray, upper_rad: FloatArray) -> FloatArray:
    width = 1.0 / (1.0 + distance)
    marks = np.multiply.outer(width, np.concatenate([-_GROWTH[::-1], _GROWTH]))
    marks = np.concatenate([np.tile([[-np.pi, np.pi]], (width.size, 1)), marks], axis=1)
    # Far from the mean the density falls within 1 / distance^2 of the ends.
    fall = np.multiply.outer(width**2, _GROWTH)
    ends = np.concatenate([lower_rad[:, None] + fall, upper_rad[:, None] - fall], axis=1)
    cuts = np.clip(np.concatenate([marks, ends], axis=1), lower_rad[:, None], upper_rad[:, None])
    cuts = np.sort(np.concatenate([lower_rad[:, None], cuts, upper_rad[:, None]], axis=1), axis=1)
    found = integrate_panels(
        lambda index, angle: _direction_density(distance[index][:, None], angle)[None],
        cuts=cuts,
        tolerance=1e-13,
        noise=np.full(width.shape, 1e-15),
    )
    return np.asarray(found.value[:, 0])


def _opening(ratio: NormalRatio, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the angle between two directions; as a difference of angles it would lose a far tail."""
    ahead_low, side_low = _components(ratio, lower)
    ahead_high, side_high = _components(ratio, upper)
    finite = np.isfinite(lower) & np.isfinite(upper)
    difference = np.where(finite, upper, 0.0) - np.where(finite, lower, 0.0)
    cross = np.where(
        finite, difference / (_sigma_x(ratio) * ratio.sigma_y), ahead_low * side_high - side_low * ahead_high
    )
    return np.arctan2(cross, ahead_low * ahead_high + side_low * side_high)


# Below this share of what it is a difference of, a tail is integrated from the density instead (which is slower).
_CANCELLED_LOWER = 1e-3
_CANCELLED_UPPER = 1e-2


def _tails(frame: DolpFrame, x: FloatArray) -> Tails:
    """Return both tails and the density for pairs of a distribution and a value."""
    border = _Border(frame=frame, a=np.ones_like(x), b=x)
    turn, turn_size, density, close = _border_integrals(border)
    lower, upper = _from_turns(frame, border.gap > 0.0, turn, close)
    lit = ndtr(frame.snr_0)
    small = lower < _CANCELLED_LOWER * turn_size
    if np.any(small):
        lower[small] = _near_zero(frame[small], x[small])
    far = upper < _CANCELLED_UPPER * np.minimum(np.maximum(1.0 - lit, turn_size), 1.0)
    if np.any(far):
        upper[far] = _far_out(frame[far], x[far])
    return Tails(lower=lower / lit, upper=upper / lit, density=density / lit)


# From this distance (half its square) of the border from the mean on, the tail form is the smooth one.
_CLOSE = 0.5
_COARSE = np.linspace(-np.pi, np.pi, 33)
_GRADED = np.pi * 8.0 ** -np.arange(1.0, 16.0)
_HALF_WIDTHS = np.pi * 4.0 ** np.arange(-22.0, 1.0)
_CLOSELY_GRADED = np.pi * 1.5 ** -np.arange(1.0, 61.0)

_TOLERANCE = 1e-12


def _border_integrals(border: _Border) -> tuple[FloatArray, FloatArray, FloatArray, Mask]:
    """Return integrals along M borders: turn, size of its terms, density; and which borders run close to the mean."""
    place, width, lowest = _nearest_points(border)
    close = lowest < _CLOSE

    def integrand(index: NDArray[np.int64], offset: FloatArray) -> FloatArray:
        part = border[index]
        d = _directions(part, offset)
        return np.stack([_turn(d, close[index]), _density(part, d)])

    found = integrate_panels(integrand, cuts=_cuts(place, width), tolerance=_TOLERANCE, noise=_rounding_noise(border))
    turn, turn_size = found.value[:, 0] / (2.0 * np.pi), found.size[:, 0] / (2.0 * np.pi)
    return turn, turn_size, found.value[:, 1], close


# Height of the barrier between two peaks, as an exponent, below which they count as one.
_MERGED = 0.05
_STEPS = np.linspace(-1.0, 1.0, 9)
_REFINEMENTS = 10


def _nearest_points(border: _Border) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the two places of a border that come nearest to the mean, their widths, and the least half square.

    The second is looked for on a grid graded towards the first: where a thin ellipse touches the border from
    within, the two lie as close together as the ellipse is thin.
    """
    grid = _starting_grid(border)
    first, reach = _lowest(grid, _nearness(_directions(border, grid)))
    first = _refined(border, first, reach)
    away = np.sort(
        np.concatenate([_turned_back(grid - first[:, None]), _close_grid(len(border.frame))], axis=1), axis=1
    )
    values = _nearness(_directions(border, first[:, None] + away))
    second, reach = _lowest(away, np.where(_barrier(away, values) > values + _MERGED, values, np.inf))
    second = _refined(border, first + second, np.minimum(reach, 0.5 * np.abs(second)))
    place = np.stack([first, second], axis=1)
    at_place = _nearness(_directions(border, place))
    return place, _widths(border, place, at_place), np.min(at_place, axis=1)


def _starting_grid(border: _Border) -> FloatArray:
    """Return offsets over the full turn, graded towards every place where a narrow peak can be.

    That is the mean; the thin ends of the ellipse of (S1, S2) given S0; and where the long axis of the whole
    ellipsoid meets the border, for a covariance like a needle.
    """
    f = border.frame
    angle = np.arctan2(f.mean_2, f.mean_1)
    axis = [place - angle for place in _needle_ends(border)]
    centres = np.stack([np.zeros_like(angle), -angle, np.pi - angle, *axis], axis=1)
    graded = np.concatenate([-_GRADED, [0.0], _GRADED])
    around = (centres[:, :, None] + graded).reshape(angle.size, -1)
    uniform = np.broadcast_to(_COARSE, (angle.size, _COARSE.size))
    return np.sort(np.concatenate([_turned_back(around), uniform], axis=1), axis=1)


def _needle_ends(border: _Border) -> tuple[FloatArray, FloatArray]:
    """Return beta where the line through the mean along the largest fluctuation meets the cone, or passes closest."""
    f, zero = border.frame, np.zeros_like(border.a)
    columns = [f.sigma_0, zero, zero, f.slope_1, f.radius_1, zero, f.slope_2, zero, f.radius_2]
    factor = np.stack(columns, axis=-1).reshape(-1, 3, 3)
    along_0, along_1, along_2 = np.linalg.svd(factor)[0][:, :, 0].T
    a2, b2 = border.a**2, border.b**2
    square = a2 * (along_1**2 + along_2**2) - b2 * along_0**2
    half = a2 * (f.mean_1 * along_1 + f.mean_2 * along_2) - b2 * f.mean_0 * along_0
    constant = -border.gap * (border.a * f.polarized + border.b * f.mean_0)
    turn = -half - np.copysign(np.sqrt(np.maximum(half**2 - square * constant, 0.0)), half)
    steps = [_ratio(turn, square), _ratio(constant, turn)]
    first, second = (
        np.arctan2(f.mean_2 + step * along_2, f.mean_1 + step * along_1)
        + np.where(f.mean_0 + step * along_0 < 0.0, np.pi, 0.0)
        for step in steps
    )
    return first, second


def _ratio(above: FloatArray, below: FloatArray) -> FloatArray:
    """Return above / below; 0 where the quotient is not finite."""
    tiny = np.abs(below) <= 1e-150 * np.abs(above)
    return np.where(tiny, 0.0, above / np.where(tiny | (below == 0.0), 1.0, below))


def _turned_back(offset: FloatArray) -> FloatArray:
    """Return the same directions with offsets from -pi to pi; those in range keep their digits."""
    return np.where(np.abs(offset) > np.pi, np.remainder(offset + np.pi, 2.0 * np.pi) - np.pi, offset)


def _lowest(grid: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the place of the lowest value on a sorted grid, and its distance to the next points."""
    index, row = np.argmin(values, axis=1), np.arange(grid.shape[0])
    place = grid[row, index]
    after = grid[row, np.minimum(index + 1, grid.shape[1] - 1)] - place
    before = place - grid[row, np.maximum(index - 1, 0)]
    return place, np.maximum(after, before)


def _nearness(d: _Directions) -> FloatArray:
    """Return minus the logarithm of the scale of the integrand: half the squared distance to the mean."""
    return np.where(d.cosine > 0.0, d.exponent, 0.5 * d.kappa**2)


# Beyond this the apex is never reached, and the distance itself no longer matters.
_FAR_CONE = 1e8


def _directions(border: _Border, offset: FloatArray) -> _Directions:
    """Return the whitened geometry at points of the borders."""
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
    return _Directions(
        exponent=squared / (2.0 * (radius * size) ** 2),
        cosine=np.clip(cosine, -1.0, 1.0),
        size=size,
        turning=radius * mean_size * swing / np.where(squared > 0.0, squared, 1.0),
        kappa=np.minimum(mean_size / np.maximum(depth, 1e-290), _FAR_CONE),
        mean_size=mean_size,
        depth=depth,
    )


def _cross_product(border: _Border, offset: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the components 1 and 2 of direction x mean, from the gap so that nothing cancels."""
    f = border.frame
    angle = np.arctan2(f.mean_2, f.mean_1)[:, None]
    gap, pull = border.gap[:, None], (2.0 * border.a * f.polarized)[:, None] * np.sin(0.5 * offset)
    beta, middle = angle + offset, angle + 0.5 * offset
    return gap * np.sin(beta) + pull * np.cos(middle), pull * np.sin(middle) - gap * np.cos(beta)


def _common_fluctuation(
    border: _Border, offset: FloatArray, cross_1: FloatArray, cross_2: FloatArray
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


def _refined(border: _Border, place: FloatArray, reach: FloatArray) -> FloatArray:
    """Return the lowest place within reach, by grids of which each is four times finer."""
    row = np.arange(place.size)
    for _ in range(_REFINEMENTS):
        points = place[:, None] + reach[:, None] * _STEPS
        place = points[row, np.argmin(_nearness(_directions(border, points)), axis=1)]
        reach = 0.25 * reach
    return place


def _close_grid(borders: int) -> FloatArray:
    """Return offsets from a place, graded so closely that a second minimum at any distance is not jumped over."""
    return np.broadcast_to(
        np.concatenate([-_CLOSELY_GRADED, [0.0], _CLOSELY_GRADED]), (borders, 2 * _CLOSELY_GRADED.size + 1)
    )


def _barrier(away: FloatArray, values: FloatArray) -> FloatArray:
    """Return the highest value on the way from the place at 0 to each point of a sorted grid."""
    right = np.maximum.accumulate(np.where(away >= 0.0, values, -np.inf), axis=1)
    left = np.maximum.accumulate(np.where(away <= 0.0, values, -np.inf)[:, ::-1], axis=1)[:, ::-1]
    return np.where(away >= 0.0, right, left)


def _widths(border: _Border, place: FloatArray, lowest: FloatArray) -> FloatArray:
    """Return the smallest distance from each place at which the integrand has fallen by about e^-1/2."""
    signed = np.concatenate([_HALF_WIDTHS, -_HALF_WIDTHS])
    points = (place[:, :, None] + signed).reshape(len(border.frame), -1)
    values = _nearness(_directions(border, points)).reshape(*place.shape, 2, _HALF_WIDTHS.size)
    fallen = np.any(values > lowest[:, :, None, None] + 0.5, axis=2)
    fallen[..., -1] = True
    return np.asarray(_HALF_WIDTHS[np.argmax(fallen, axis=-1)])


def _turn(d: _Directions, close: NDArray[np.bool_]) -> FloatArray:
    probability = _beyond(d)
    probability[close] = _within(_rows(d, close))
    return np.asarray(probability * d.turning)


def _beyond(d: _Directions) -> FloatArray:
    """Return Hc: the chance of a direction farther from the mean's than this one."""
    reach = d.kappa * d.cosine
    front = ndtr(-d.kappa) + d.cosine * np.exp(-d.exponent) * ndtr(reach)
    # Behind the apex the two terms cancel; with Mills ratios they do so without underflow.
    mills = erfcx(d.kappa / np.sqrt(2.0)) - np.abs(d.cosine) * erfcx(np.abs(reach) / np.sqrt(2.0))
    back = 0.5 * np.exp(-0.5 * d.kappa**2) * mills
    return np.where(d.cosine >= 0.0, front, back)


def _within(d: _Directions) -> FloatArray:
    """Return H = 1 - Hc, with full relative precision close to the mean's direction."""
    sine_squared = np.minimum(2.0 * d.exponent / d.kappa**2, 1.0)
    close = (d.cosine > 0.5) & (sine_squared < 0.75)
    cosine = np.sqrt(1.0 - np.where(close, sine_squared, 0.0))
    lost = _lost(sine_squared, d, close)
    gap = np.where(close, 2.0 * d.exponent / (d.kappa * (1.0 + cosine)), 0.0)
    near = ndtr(d.kappa) * lost + (1.0 - lost) * _normal_slice(d.kappa, gap)
    return np.where(close, near, 1.0 - _beyond(d))


def _lost(sine_squared: FloatArray, d: _Directions, close: NDArray[np.bool_]) -> FloatArray:
    """Return 1 - cos(theta) exp(-exponent)."""
    log_cosine = 0.5 * np.log1p(-np.where(close, sine_squared, 0.0))
    return np.asarray(-np.expm1(log_cosine - d.exponent))


def _normal_slice(upper: FloatArray, width: FloatArray) -> FloatArray:
    """Return the standard normal probability of the interval of given width that ends at `upper`."""
    nodes, weights = gauss_legendre(4)
    points = upper[..., None] - width[..., None] * nodes
    narrow = width * (np.exp(-0.5 * points**2) @ weights) / _SQRT_2PI
    return np.where(width < 0.1, narrow, ndtr(upper) - ndtr(upper - width))


def _rows(d: _Directions, index: NDArray[np.bool_]) -> _Directions:
    return _Directions(**{name: getattr(d, name)[index] for name in d.__dataclass_fields__})


def _cuts(place: FloatArray, width: FloatArray) -> FloatArray:
    """Return panel ends: the full turn, graded by factors of 8 around both places."""
    growth = np.concatenate([[0.25, 1.0, 3.0], 8.0 ** np.arange(1.0, 17.0)])
    distance = np.minimum(width[:, :, None] * growth, np.pi)
    near = np.concatenate([place[:, :, None] - distance, place[:, :, None], place[:, :, None] + distance], axis=2)
    flat = near.reshape(place.shape[0], -1)
    uniform = np.broadcast_to(_COARSE[::8], (place.shape[0], _COARSE[::8].size))
    return np.sort(np.concatenate([_turned_back(flat), uniform], axis=1), axis=1)


def _rounding_noise(border: _Border) -> FloatArray:
    """Return the relative rounding error of the integrands: it grows with the thinness of the covariance."""
    f = border.frame
    span = (border.b * f.sigma_0 + border.a * np.hypot(f.slope_1, f.slope_2)) / np.hypot(border.a, border.b)
    ratio = span / np.maximum(f.radius_2, 1e-300)
    return np.asarray(1e-15 * (1.0 + np.minimum(ratio, 1e6)))


def _from_turns(frame: DolpFrame, inside: Mask, turn: FloatArray, close: Mask) -> tuple[FloatArray, FloatArray]:
    """Return the probabilities inside and outside of the cone, with S0 > 0."""
    lit, dark = ndtr(frame.snr_0), ndtr(-frame.snr_0)
    # With the complement, the line integral misses the pole opposite to the mean where that is in the cone.
    opposite = (frame.mean_0 < 0.0) & close & ~inside
    near = turn + opposite
    lower = np.where(close, near, np.where(inside, 1.0 - turn, -turn))
    outside = np.where(close, 1.0 - near, np.where(inside, turn, 1.0 + turn))
    upper = np.where(frame.mean_0 > 0.0, outside - dark, lit - lower)
    return lower, upper


def _near_zero(frame: DolpFrame, x: FloatArray) -> FloatArray:
    """Return the probability inside of a slender cone as the integral of a positive density."""
    return _density_integral(frame, x, lambda ratio: (np.ones_like(ratio), ratio))


def _far_out(frame: DolpFrame, x: FloatArray) -> FloatArray:
    """Return the probability beyond a wide cone, from the density of the inverse of DoLP."""
    return _density_integral(frame, 1.0 / x, lambda inverse: (inverse, np.ones_like(inverse)))


def _density_integral(
    frame: DolpFrame, end: FloatArray, sides: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
) -> FloatArray:
    """Return the integral of the density from 0 to an end, over DoLP or over its inverse."""

    def integrand(index: NDArray[np.int64], values: FloatArray) -> FloatArray:
        a, b = sides(values.ravel())
        border = _Border(frame=frame[np.repeat(index, values.shape[1])], a=a, b=b)
        return _border_integrals(border)[2].reshape(1, *values.shape)

    # At zero itself a direction of a singular covariance may have no density.
    cuts = np.stack([1e-15 * end, end], axis=1)
    found = integrate_panels(integrand, cuts=cuts, tolerance=1e-11, noise=np.full(end.shape, 1e-12), degree=12)
    return np.asarray(found.value[:, 0])


# The search runs over the logarithm of DoLP.
_LOG_RANGE = 700.0


def _solve(frame: DolpFrame, p: FloatArray) -> FloatArray:
    def distribution(index: NDArray[np.int64], log_x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        x = np.exp(log_x)
        found = _pair_tails(frame[index], x)
        return found.lower, found.upper, found.density * x

    return np.exp(_find_quantiles(distribution, p=p, start=np.log(_guess(frame, p)), reach=_LOG_RANGE))


def _score_error(found: tuple[FloatArray, FloatArray, FloatArray], wanted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return normal score of the distribution less the one wanted, and its slope."""
    lower, upper, density = found
    score = np.where(lower < upper, ndtri(lower), -ndtri(upper))
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        slope = np.sqrt(2.0 * np.pi) * np.exp(np.log(density) + 0.5 * score**2)
    return score - wanted, slope


def _step(
    error: FloatArray, slope: FloatArray, to_low: FloatArray, to_high: FloatArray, last: FloatArray
) -> FloatArray:
    """Return Newton's step where it stays within the bracket and halves the last one, else to the middle.

    Before the bracket has two ends that were tried, the middle is no more than 1 away.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        newton = -error / slope
    usable = (
        np.isfinite(newton)
        & np.isfinite(slope)
        & (newton >= to_low)
        & (newton <= to_high)
        & (np.abs(newton) <= 0.5 * last)
    )
    middle = 0.5 * (to_low + to_high)
    longest = np.where(np.isinf(last), 1.0, np.inf)
    toward = np.where(error < 0.0, np.minimum(0.5 * to_high, longest), np.maximum(0.5 * to_low, -longest))
    return np.where(usable, np.clip(newton, -_LONGEST_STEP, _LONGEST_STEP), np.where(np.isinf(last), toward, middle))


def _guess(frame: DolpFrame, p: FloatArray) -> FloatArray:
    """Return a first quantile: Q^2 at the mean of S0 as a scaled chi-square variable (Wilson and Hilferty)."""
    bright = np.maximum(frame.mean_0, frame.sigma_0)
    common_1, common_2 = frame.excess_1 / bright, frame.excess_2 / bright
    var_1, var_2 = common_1**2 + frame.radius_1**2, common_2**2 + frame.radius_2**2
    cross = common_1 * common_2
    trace = frame.polarized**2 + var_1 + var_2
    along = frame.mean_1**2 * var_1 + 2.0 * frame.mean_1 * frame.mean_2 * cross + frame.mean_2**2 * var_2
    spread = 2.0 * (var_1**2 + 2.0 * cross**2 + var_2**2) + 4.0 * along
    safe = np.where(trace > 0.0, trace, 1.0)
    narrow = spread / (9.0 * safe**2)
    root = 1.0 - narrow + ndtri(p) * np.sqrt(narrow)
    square = safe * np.maximum(root, 0.1 * np.maximum(np.minimum(p, 0.1), 1e-60)) ** 3
    return np.asarray(np.sqrt(square) / bright)
