"""The law of a count: a normal signal, rounded to a whole number and clipped at both ends of the range.

A camera adds photons, electrons of its readout and a black level, multiplies by its gain, rounds, and stores numbers
from 0 to full scale. Before rounding the sum is normal from about ten electrons on. This module alone treats rounding,
clipping and hits:

- `rounded_moments` predicts mean and variance of counts from those of the signal; functions named `*_error_rms` give
  the errors that rounding leaves in means and variances.
- `estimate_signal` estimates the signal from counts and tests the law.
- `hit_limit` tells which counts the law does not allow: cosmic rays, jumping pixels, defects. `find_hits` and
  `find_single_hits` search a region for them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.numerics import gammainc, ndtr, ndtri

FloatArray = NDArray[np.float64]

# Variance of a rounding error, uniform over one count.
ROUNDING_VAR_DN2 = 1.0 / 12.0
# Noise that dithers the rounding: the mean shifts by less than 2e-5 counts.
DITHERED_DN = 0.7
# Harmonics of the periodic error: the last is 1e-16 for noise of a third of a step, and 1/40 of the first without
# noise.
_HARMONICS, _MANY = np.arange(1.0, 9.0), np.arange(1.0, 41.0)


def rounded_moments(
    level_dn: ArrayLike, var_dn2: ArrayLike, spread_dn2: ArrayLike = 0.0, third_dn3: ArrayLike = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return the shift of the mean by rounding, and the variance of the rounded signal.

    Parameters
    ----------
    level_dn
        Mean before rounding, black level included, because its place between two whole numbers matters.
    var_dn2
        Variance from frame to frame.
    spread_dn2
        Variance of the level over the averaged pixels, which also dithers.
    third_dn3
        Third central moment from frame to frame, of photon noise the gain to the third times the electrons.

    Returns
    -------
    shift_dn, variance_dn2
        The variance from frame to frame, averaged over the pixels: `var_dn2` + 1/12 if noise dithers.

    References
    ----------
    Sripad and Snyder (1977), IEEE Trans. Acoust. Speech Signal Process. 25, 442: the error of rounding is a sawtooth,
    whose Fourier series has closed means for signals of known characteristic function: to third order here.
    """
    given = (level_dn, var_dn2, spread_dn2, third_dn3)
    level, var, spread, third = np.broadcast_arrays(*(np.asarray(x, np.float64) for x in given))
    k = _HARMONICS
    turn = 2.0 * np.pi * k * level[..., None] - (2.0 * np.pi * k) ** 3 * third[..., None] / 6.0
    fading = (-1.0) ** k * np.exp(-2.0 * (np.pi * k) ** 2 * (var + spread)[..., None])
    shift = np.sum(fading * np.sin(turn) / (np.pi * k), axis=-1)
    even = np.cos(turn) * (4.0 * var[..., None] + (np.pi * k) ** -2.0)
    harmonics = np.sum(fading * (even - 4.0 * np.pi * k * third[..., None] * np.sin(turn)), axis=-1)
    # Mean square of the pixels' shifts, from the first harmonic if they have a spread.
    own = np.exp(-4.0 * np.pi**2 * var) * (1.0 - np.exp(-8.0 * np.pi**2 * spread) * np.cos(2.0 * turn[..., 0]))
    squared = np.where(spread > 0.0, own / (2.0 * np.pi**2), shift**2)
    return shift, np.maximum(var + ROUNDING_VAR_DN2 + harmonics - squared, 0.0)


def rounding_error_rms(std_dn: ArrayLike) -> FloatArray:
    """Return the rms shift of a mean by rounding, over all places between two whole numbers.

    Widrow and Kollar, Quantization Noise (2008), chapter 4: the error is a sum of harmonics damped by noise.
    """
    damped = np.exp(-2.0 * (np.pi * _MANY * np.asarray(std_dn, dtype=np.float64)[..., None]) ** 2)
    return np.asarray(np.sqrt(0.5 * np.sum((damped / (np.pi * _MANY)) ** 2, axis=-1)))


def variance_error_rms(var_dn2: FloatArray, spread_dn2: FloatArray) -> FloatArray:
    """Return the rms error of the variance from frame to frame beyond 1/12, over all places, by the first harmonic."""
    decay = np.exp(-2.0 * np.pi**2 * (var_dn2 + spread_dn2))
    return np.asarray((4.0 * var_dn2 + 1.0 / np.pi**2) * decay / np.sqrt(2.0))


def spread_error_rms(var_dn2: FloatArray, spread_dn2: FloatArray) -> FloatArray:
    """Return the rms error of the variance of the level over the pixels, over all places, by the first harmonic.

    The slope of the shift pushes unequal pixels together or apart: twice the covariance of level and shift, by Stein's
    lemma.
    """
    return np.asarray(np.sqrt(8.0) * spread_dn2 * np.exp(-2.0 * np.pi**2 * (var_dn2 + spread_dn2)))


_HALVINGS = 30


def least_variance(measured_dn2: FloatArray, spread_dn2: FloatArray) -> FloatArray:
    """Return the least variance before rounding that can give a measured one.

    With a mean half-way between two counts, small noise is measured too large by up to its rounding error, and would
    suggest a dither that does not exist. The largest measured variance grows with the noise; bisection finds the root.
    """
    low, high = np.zeros_like(measured_dn2), np.maximum(measured_dn2, 0.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        largest = middle + ROUNDING_VAR_DN2 + np.sqrt(2.0) * variance_error_rms(middle, spread_dn2)
        low, high = np.where(largest < measured_dn2, middle, low), np.where(largest < measured_dn2, high, middle)
    return low


@dataclass(frozen=True, kw_only=True, eq=False)
class SignalEstimate:
    """Mean of the signal behind counts, by maximum likelihood.

    Attributes
    ----------
    mean_dn, std_dn
        Of the signal before rounding and clipping.
    at_ends
        Share of the counts at each end of the range, shape (2,).
    misfit
        Chi-square of the shares of counts over their number, less the part due to chance; 0 for the law itself,
        infinite if counts lie at an end of the range that noise does not reach.
    is_tested
        True with more than three different counts; fewer always fit some standard deviation.
    stands_for
        Value for each count from the lower end to the upper: their mean over the counts is `mean_dn`, and their scatter
        gives its error.
    """

    mean_dn: float
    std_dn: float
    at_ends: FloatArray
    misfit: float
    is_tested: bool
    stands_for: FloatArray


_STEPS, _LEAST_COUNTS, _TINY = 60, 3, 1e-280


def estimate_signal(counts: NDArray[np.integer], *, highest: int, hit: float = 0.0) -> SignalEstimate | None:
    """Return mean and deviation of the normal signal behind counts; None if the counts do not determine them.

    Parameters
    ----------
    counts
        Of one level of light, any shape; for 0 and `highest` the signal lies there or beyond.
    highest
        Count at the upper end of the range, > 0.
    hit
        Share of the counts that are expected off the law because they were hit.

    Notes
    -----
    Fewer than three different counts do not determine a deviation. Normal texture only widens the law.
    """
    number = np.bincount(np.minimum(np.ravel(counts), highest), minlength=highest + 1).astype(np.float64)
    kinds = np.flatnonzero(number)
    if kinds.size < _LEAST_COUNTS:
        return None
    total, at = number.sum(), np.arange(highest + 1.0)
    mean = float(number @ at) / total
    std = max(float(np.sqrt(number @ (at - mean) ** 2 / total)), 0.2)
    for _ in range(_STEPS):
        share, scores = _law(mean, std, highest)
        information = np.einsum("k,ki,kj->ij", share, scores, scores)
        step = np.linalg.solve(information, number @ scores / total)
        step = np.clip(step, -0.5 * std, [0.5 * std, std])
        mean, std = mean + float(step[0]), std + float(step[1])
        if np.all(np.abs(step) < 1e-9 * std):
            break
    else:
        return None
    influence = np.linalg.solve(information, scores.T)[0]
    return SignalEstimate(
        mean_dn=mean,
        std_dn=std,
        at_ends=number[[0, -1]] / total,
        misfit=_misfit(number, total * share, total * hit),
        is_tested=kinds.size > _LEAST_COUNTS,
        stands_for=mean + influence,
    )


# Rarer counts are grouped; number of deviations of chi-square allowed for chance.
_LEAST_EXPECTED, _CHANCE, _UNLIKELY = 5.0, 4.0, 1e-5


def _misfit(number: FloatArray, expected: FloatArray, hit: float) -> float:
    often = expected >= _LEAST_EXPECTED
    for at_end, lawful in zip(number[[0, -1]], expected[[0, -1]], strict=True):
        # Not clipped by noise.
        if lawful < _LEAST_EXPECTED and at_end > 0.0 and float(gammainc(at_end, lawful)) < _UNLIKELY:
            return float(np.inf)
    apart = number[often] - expected[often]
    rare = float(np.sum(expected[~often])) + hit
    squares = float(np.sum(apart**2 / expected[often])) + (float(np.sum(number[~often])) - rare) ** 2 / max(
        rare, _LEAST_EXPECTED
    )
    freedom = max(float(often.sum()) - 2.0, 0.0)
    return max(squares - freedom - _CHANCE * float(np.sqrt(2.0 * freedom)), 0.0) / float(number.sum())


def _law(mean: float, std: float, highest: int) -> tuple[FloatArray, FloatArray]:
    """Return the share of each count, and the derivatives of its logarithm by mean and deviation, shape (K, 2)."""
    edges = np.concatenate([[-np.inf], np.arange(highest) + 0.5, [np.inf]])
    z = (edges - mean) / std
    # Differences of the smaller tails, without cancellation.
    low, high = np.where(z[:-1] > 0.0, -z[1:], z[:-1]), np.where(z[:-1] > 0.0, -z[:-1], z[1:])
    share = np.asarray(ndtr(high)) - np.asarray(ndtr(low))
    density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    weighted = np.where(np.isfinite(z), z, 0.0) * density
    safe = np.maximum(share, _TINY)[:, None]
    scores = np.stack([-np.diff(density), -np.diff(weighted)], axis=1) / (safe * std)
    # If the share underflows the count is an outlier with its own place.
    off = ((np.arange(highest + 1.0) - mean) / std)[:, None]
    return share, np.where(share[:, None] > _TINY, scores, np.concatenate([off, off**2 - 1.0], axis=1) / std)


# Beyond so many deviations a count is a hit: a normal law has one in 5e8.
HIT_SIGMA = 6.0
# Most counts are not hit: this share of them gives a first deviation, and those within the limit the next ones.
_BULK, _PASSES = 0.8, 3
# Least numbers for a deviation of their own, and how many levels of light have one.
_LEAST_OF_LEVEL, _MOST_LEVELS = 512, 8


def hit_limit(off: FloatArray, level: FloatArray | None = None, *, least: float = 0.0) -> float:
    """Return the least difference of a hit: six standard deviations of the noise in the brightest light.

    All pixels have the same limit. A limit that grew with the light would leave out more of the dark pixels, and so
    shift the mean.

    Parameters
    ----------
    off
        Differences of counts and their expected values, shape (..., P).
    level
        Light of each pixel, shape (P,), since noise grows with light. None: all pixels have the same light.
    least
        Smallest deviation that noise and rounding may have.
    """
    parts: Sequence[NDArray[np.intp] | slice] = (slice(None),)
    if level is not None:
        parts = np.array_split(np.argsort(level), min(max(off.size // _LEAST_OF_LEVEL, 1), _MOST_LEVELS))
    return HIT_SIGMA * max(least, *(_deviation_of_most(off[..., part]) for part in parts))


def _deviation_of_most(off: FloatArray) -> float:
    size = np.abs(off)
    std = float(np.quantile(size, _BULK)) / float(ndtri(0.5 + 0.5 * _BULK)) or float(np.sqrt(np.mean(size**2)))
    for _ in range(_PASSES):
        std = float(np.sqrt(np.mean(np.square(size[size <= HIT_SIGMA * std]))))
    return std


@dataclass(frozen=True, kw_only=True, eq=False)
class Hits:
    """Pixels of a region that something else than light has hit in single frames.

    Hits too small to be found stay: those hardly larger than the limit tell how many there are.
    """

    pixels: NDArray[np.bool_]  #: shape (P,)
    limits: FloatArray  #: smallest hit that is found at each angle, shape (N,)
    small: FloatArray  #: share of the counts of each angle that smaller ones have hit
    small_error: FloatArray  #: its standard error, by the Poisson law and for the law of their sizes

    # Means of sizes from 0 to the limit, and of their squares.

    @property
    def mean(self) -> FloatArray:
        """Mean of the small hits [unit of the pixels]."""
        return 0.5 * self.limits

    @property
    def square(self) -> FloatArray:
        """Mean square of the small hits."""
        return self.limits**2 / 3.0


# Noise that reaches far does so to both sides. A larger share of the counts is not hit: the scene moves.
_ONE_SIDED, _MOST_HIT = 4.0, 0.1
# A share of the limit is far. Where more than so many lie far below their neighbours, edges and texture do, and what
# lies above is no hit.
_FAR, _MOST_FAR = 0.5, 0.004
# Relative error of the guess that hits too small to be found are as many as those hardly larger.
_GUESS = 0.3
# Smallest deviation of counts by noise and rounding [counts].
_LEAST_STD_DN = 0.5


def find_hits(pixels: FloatArray, *, step: float = 1.0) -> Hits | None:
    """Find the pixels of a region that were hit in single frames, by comparing repeats. None: no hit can be shown.

    Parameters
    ----------
    pixels
        Cycles, angles, pixels, shape (C, N, P), C >= 2.
    step
        One count in the unit of the pixels.

    Notes
    -----
    A pixel of a frame is compared with the mean of its repeats, after the median of the region is subtracted from each
    frame. A cosmic ray or a pixel that jumps is above. Two repeats are equally far from their mean: there their sum
    decides.
    """
    cycles, angles, count = pixels.shape
    even = pixels - np.median(pixels, axis=2, keepdims=True)
    light = np.median(even.reshape(-1, count), axis=0)
    high, low = np.zeros((2, angles, count), dtype=np.bool_)
    size, limits = np.zeros((angles, count)), np.zeros(angles)
    for angle in range(angles):
        level = even[:, angle]
        off = (level - level.mean(axis=0)) * (cycles / (cycles - 1.0))
        limits[angle] = hit_limit(off, light, least=_LEAST_STD_DN * step)
        farthest = np.take_along_axis(off, np.argmax(np.abs(off), axis=0)[None], axis=0)[0]
        above = farthest > 0.0 if cycles > 2 else level.sum(axis=0) > 0.0
        size[angle] = np.abs(farthest)
        high[angle], low[angle] = (size[angle] > limits[angle]) & above, (size[angle] > limits[angle]) & ~above
    return _hits(high, low, size, limits, cycles)


def find_single_hits(residual: FloatArray, light: FloatArray, *, step: float = 1.0) -> Hits | None:
    """Find the pixels that were hit at one angle, by comparing neighbours. None: no hit can be shown.

    Parameters
    ----------
    residual
        Difference of each pixel and its neighbours, angles and pixels, shape (N, P), N >= 2.
    light
        Median of the neighbours, shape (N, P).
    step
        One count in the unit of the pixels.
    """
    limits = np.array([hit_limit(*both, least=_LEAST_STD_DN * step) for both in zip(residual, light, strict=True)])
    off = residual / limits[:, None]
    if np.mean(off < -_FAR) > _MOST_FAR:
        return None
    # Light that stands out does so behind most angles.
    single = np.sum(np.abs(off) > _FAR, axis=0) <= len(off) // 2
    return _hits((off > 1.0) & single, (off < -1.0) & single, residual, limits, 1)


def _hits(
    high: NDArray[np.bool_], low: NDArray[np.bool_], size: FloatArray, limits: FloatArray, cycles: int
) -> Hits | None:
    """Return hits; those up to twice the limit tell how many are below it, by an exponential law of their sizes."""
    above, below = int(high.sum()), int(low.sum())
    if above <= below + _ONE_SIDED * np.sqrt(above + below) or above > _MOST_HIT * cycles * high.size:
        return None
    small = np.sum(high & (size < 2.0 * limits[:, None]), axis=1)
    small = small / max(1.0 - float(small.sum()) / above, 0.5)
    counts = cycles * high.shape[1]
    return Hits(
        pixels=np.any(high | low, axis=0),
        limits=limits,
        small=small / counts,
        small_error=np.sqrt(small + (_GUESS * small) ** 2) / counts,
    )
