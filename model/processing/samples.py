"""Moments of the pixels of a region with standard errors: repeatability, texture and distribution.

Every standard error comes from the scatter of the pixels themselves, not from an assumed distribution. It holds for
pixels that are independent of each other; `effective_pixels` counts how many independent pixels a region is worth.

- `repeated` and `RunningPixels` take the cycles of a region. Means that differ from cycle to cycle by more than the
  noise of the pixels have an error of their own (`Repeatability`); light that drifts is divided out.
- `estimate_texture` gives the spread of the light over the pixels: the spread of the pixels less the noise.
- `check_dolp_distribution` compares the DoLP of pixels with the law that follows from their moments.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import Moments
from model.numerics import gammaincc
from model.processing import dolp
from model.stokes import dolp as degree_of_polarization

FloatArray = NDArray[np.float64]

# Share of the largest variance below which a component is rounding.
_NOTHING = 1e-12


def region_mean_moments(values: ArrayLike, inside: NDArray[np.bool_]) -> Moments:
    """Return the mean of vectors over the pixels of a region, which may be alike, with the covariance of that mean.

    Parameters
    ----------
    values
        One vector a pixel, shape (n, P), P >= 4; any unit.
    inside
        Where the pixels are, shape (H, W), P of them.

    Notes
    -----
    Light that varies alike in all channels, and each principal component of the rest, has its own number of
    independent pixels: texture makes neighbours alike in what channels share, and says nothing of what their ratios
    are left with.
    """
    array, inside = _checked(values, least=4), inside[_part_with(inside)]
    moments = mean_moments(array)
    total = float(moments.mean.sum())
    factor = array.sum(axis=0) / total if total > 0.0 else np.zeros(array.shape[1])
    rest = array - moments.mean[:, None] * (factor if total > 0.0 else 1.0)
    variances, vectors = np.linalg.eigh(np.atleast_2d(np.cov(rest)) / array.shape[1])
    cov = moments.cov + np.outer(moments.mean, moments.mean) * _excess(factor, inside)
    for component, vector, variance in zip(vectors.T @ rest, vectors.T, variances, strict=True):
        if variance > _NOTHING * variances[-1]:
            cov = cov + np.outer(vector, vector) * _excess(component, inside)
    return Moments(mean=moments.mean, cov=cov)


def mean_moments(values: ArrayLike) -> Moments:
    """Return the mean of vectors over pixels, with the covariance of that mean.

    Parameters
    ----------
    values
        One vector a pixel, shape (n, P) with P >= 2 pixels last; any unit.

    Returns
    -------
    Moments
        Mean, shape (n,), and its covariance: the pixels' sample covariance over P.
    """
    array = _checked(values, least=2)
    cov = np.atleast_2d(np.cov(array)) / array.shape[1]
    return Moments(mean=array.mean(axis=1), cov=cov)


@dataclass(frozen=True, kw_only=True)
class Sample:
    """A number found from a sample, with the standard error that the sample gives for it.

    `intervals` of 68 and 95 % are given where they are not one and two standard errors to either side; `freedom` is
    the number of degrees of freedom that the standard error itself rests on.
    """

    value: float
    std_error: float
    intervals: tuple[tuple[float, float], tuple[float, float]] | None = None
    freedom: float = np.inf


def deviation(values: ArrayLike) -> Sample:
    """Return the standard deviation of pixels and its standard error.

    Parameters
    ----------
    values
        Shape (P,), P >= 4; any unit.

    Returns
    -------
    Sample
        Deviation (P - 1 in its denominator); its error from the fourth central moment m4 of the same pixels,
        sqrt((m4 - m2^2) / P) / (2 sqrt(m2)), so that no distribution is assumed. Of equal values both are 0.

    References
    ----------
    Definition; delta method on the sample variance.
    """
    array = _checked(np.atleast_2d(np.asarray(values, dtype=np.float64)), least=4)[0]
    squared = (array - array.mean()) ** 2
    return _root_of_mean(squared, correction=array.size / (array.size - 1))


def mean_over_deviation(values: ArrayLike) -> Sample:
    """Return mean over deviation of pixels, a signal-to-noise ratio, and its standard error.

    Parameters
    ----------
    values
        Shape (P,), P >= 4, not all equal.

    Returns
    -------
    Sample
        R = m / s with variance (1 - R g + R^2 (k - 1) / 4) / P, where g is the skewness and k the kurtosis of the
        pixels: numerator and denominator share them.

    Raises
    ------
    ValueError
        All values are equal: the ratio does not exist.

    References
    ----------
    [MK14] eq. (29); delta method.
    """
    array = _checked(np.atleast_2d(np.asarray(values, dtype=np.float64)), least=4)[0]
    centred = array - array.mean()
    spread = float(np.sqrt(np.mean(centred**2)))
    if spread == 0.0:
        raise ValueError("values are all equal; a ratio of mean to deviation needs values that differ")
    ratio = float(array.mean()) / spread
    skewness = float(np.mean(centred**3)) / spread**3
    kurtosis = float(np.mean(centred**4)) / spread**4
    variance = (1.0 - ratio * skewness + ratio**2 * (kurtosis - 1.0) / 4.0) / array.size
    unbiased = ratio * np.sqrt((array.size - 1) / array.size)
    return Sample(value=float(unbiased), std_error=float(np.sqrt(max(variance, 0.0))))


# Regions up to this side are looked at lag by lag, larger ones by their blocks [pixels].
_MOST_LAGS = 256

# Side of the blocks whose means tell how many independent pixels there are [pixels].
_BLOCK_SIDE = 16
_LEAST_BLOCKS = 12


def effective_pixels(image: FloatArray, inside: NDArray[np.bool_]) -> float:
    """Return how many independent pixels a region is worth for a mean.

    Parameters
    ----------
    image
        What is averaged, shape (H, W).
    inside
        The region, shape (H, W), at least 4 pixels.

    Returns
    -------
    float
        The number of pixels where neighbours show no correlation; else the pixel variance over the variance of
        their mean, and at least 1. That variance is of correlations summed up to where they end; of the means of
        blocks of 16 x 16 pixels where the region is large, or where they do not end within it.

    Notes
    -----
    Texture, a lens's blur and interpolation make neighbours alike, and a standard error that counts each of them
    is too small. Of large regions correlation over more than a block is not seen.

    References
    ----------
    Batch means; truncated sum of autocovariances, the mean's own variance put back; definition.
    """
    part = _part_with(inside)
    image, inside = image[part], inside[part]
    count = int(inside.sum())
    if not _neighbours_are_alike(image, inside):
        return float(count)
    rows, columns = np.nonzero(inside)
    if max(np.ptp(rows), np.ptp(columns)) < _MOST_LAGS:
        cut = (slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1))
        worth, is_whole = _pixels_by_lags(image[cut], inside[cut])
        blocks = _block_means(image, inside)[0].size
        return worth if is_whole or blocks >= _LEAST_BLOCKS else min(worth, float(max(blocks, 1)))
    means, sizes = _block_means(image, inside)
    if means.size < _LEAST_BLOCKS:
        return float(max(means.size, 1))
    pixel_variance = float(np.var(image[inside]))
    block_variance = float(np.var(means, ddof=1))
    if block_variance == 0.0:
        return float(count)
    alike = max(block_variance * float(sizes.mean()) / pixel_variance, 1.0)
    return max(count / alike, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Repeatability:
    """Relative standard errors of the mean of all cycles."""

    own: float = 0.0  #: of each angle by itself; ratios of angles have it too
    common: float = 0.0  #: of all angles alike, as of light that wanders; ratios have none of it
    drift: float = 0.0  #: change of the light from one cycle to the next that was divided out; 0 if by chance
    drift_error: FloatArray | float = 0.0  #: error of each angle by that of the drift, shape (N,), or 0
    own_freedom: float = np.inf  #: degrees of freedom that `own` is known from: few where cycles are few
    common_freedom: float = np.inf

    def cov(self, mean: FloatArray) -> FloatArray:
        """Return the covariance of the means of the angles, shape (N, N)."""
        drifted = mean * self.drift_error
        return np.diag(np.square(mean * self.own)) + np.outer(mean, mean) * self.common**2 + np.outer(drifted, drifted)

    def freedom(self, rows: FloatArray, moments: Moments) -> FloatArray:
        """Return the degrees of freedom of errors of linear functions of the angles, rows of shape (K, N).

        Welch (1947), Biometrika 34, 28, and Satterthwaite (1946), Biometrics Bulletin 2, 110: by the fourth powers of
        the errors that are known from few cycles.
        """
        total = np.einsum("kn,nm,km->k", rows, moments.cov, rows)
        own = np.square(rows * moments.mean) @ np.full(moments.mean.size, self.own**2)
        common = np.square(rows @ moments.mean) * self.common**2 + np.square(rows @ (moments.mean * self.drift_error))
        few = own**2 / self.own_freedom + common**2 / self.common_freedom
        return np.asarray(np.divide(total**2, few, out=np.full(len(rows), np.inf), where=few > 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class RepeatedPixels:
    """Pixels of a region over all cycles."""

    cycles: int
    first: FloatArray  #: of the first cycle, shape (N, P)
    mean: FloatArray  #: over all cycles
    repeatability: Repeatability  #: of the means over the pixels
    #: Deviation of a pixel from cycle to cycle, of each channel and each Stokes parameter; none with one cycle. Noise
    #: that neighbours share is in their errors.
    temporal: tuple[Sample, ...]
    temporal_stokes: tuple[Sample, ...]


def repeated(
    pixels: FloatArray,
    inverse: FloatArray,
    *,
    inside: NDArray[np.bool_] | None = None,
    times: FloatArray | None = None,
    noise_inflation: float = 1.0,
) -> RepeatedPixels:
    """Return the pixels of a region over all cycles, all of which are held at once.

    Parameters
    ----------
    pixels
        Cycles, angles, pixels, shape (C, N, P), P >= 4; dark level subtracted.
    inverse
        From the angles to Stokes parameters, shape (3, N).
    inside
        Where the pixels are, shape (H, W), P of them, to find noise that neighbours share.
    times
        When each frame was taken, in cycles, shape (C, N), to divide out light that drifts.
    noise_inflation
        Least factor on the variance of the mean by noise that neighbours share.
    """
    running = RunningPixels(inverse, inside=inside, times=times, noise_inflation=noise_inflation)
    for cycle in pixels:
        running.add(cycle)
    return running.result()


class RunningPixels:
    """Takes the pixels of a region cycle by cycle, in memory that does not grow with the cycles.

    It keeps some 50 numbers a pixel at four angles, and the mean over the pixels of each cycle.
    """

    def __init__(
        self,
        inverse: FloatArray,
        *,
        inside: NDArray[np.bool_] | None = None,
        times: FloatArray | None = None,
        noise_inflation: float = 1.0,
    ) -> None:
        self._times = times
        self._inside = None if inside is None else inside[_part_with(inside)]
        self._noise_inflation = noise_inflation
        self._means: list[FloatArray] = []
        self._channels = _Running(np.vstack([np.eye(inverse.shape[1]), inverse]))
        self._squares: FloatArray | None = None

    def add(self, pixels: FloatArray) -> None:
        """Take the next cycle, shape (N, P)."""
        self._means.append(pixels.mean(axis=1))
        off = None if self._squares is None else pixels - self._channels.mean
        self._channels.add(pixels)
        if off is None or self._squares is None:
            self._squares = np.zeros_like(pixels)
        else:
            # Welford's: the sum of squares about a mean that moves.
            self._squares += off * (pixels - self._channels.mean)

    def result(self) -> RepeatedPixels:
        """Return the pixels over all cycles that were taken."""
        if self._squares is None:
            raise ValueError("there are no cycles")
        means, pixels = np.array(self._means), self._squares.shape[1]
        cycles = len(means)
        of_mean, of_deviation = self._shared_noise() if cycles > 1 else (1.0, 1.0)
        noise = self._squares.mean(axis=1) / max(cycles - 1, 1) / pixels * max(self._noise_inflation, of_mean)
        repeatability = _repeatability(means, noise, self._times)
        first, mean = self._channels.first, self._channels.mean
        if repeatability.drift and self._times is not None:
            light = 1.0 + repeatability.drift * (self._times - self._times.mean())
            first, mean = first / light[0][:, None], mean / light.mean(axis=0)[:, None]
        temporal = self._channels.temporal(cycles, of_deviation)
        return RepeatedPixels(
            cycles=cycles,
            first=first,
            mean=mean,
            repeatability=repeatability,
            temporal=temporal[: len(mean)],
            temporal_stokes=temporal[len(mean) :],
        )

    def _shared_noise(self) -> tuple[float, float]:
        """Return the factors of the variance of mean and deviation by noise that neighbours share."""
        if self._inside is None or self._squares is None:
            return 1.0, 1.0
        off = self._channels.first - self._channels.mean
        found = [np.sum(off / np.maximum(off.std(axis=1, keepdims=True), _NOTHING), axis=0), self._squares.sum(axis=0)]
        worth = []
        for values in found:
            image = np.zeros(self._inside.shape)
            image[self._inside] = values
            worth.append(effective_pixels(image, self._inside))
        return values.size / worth[0], values.size / worth[1]


@dataclass(frozen=True, kw_only=True)
class Texture:
    """Covariance of the light over a region's pixels, estimated; in the square of the pixels' unit."""

    cov: FloatArray  #: shape (n, n), positive semi-definite
    std_error: FloatArray  #: of each element, before any repair
    #: Largest eigenvalue over the trace: 1 where all components vary together, as for a common factor such as albedo;
    #: 1/n where they vary alike and independently. Not a number where there is no texture.
    rank_one_share: float
    #: Relative rms of a factor common to all components that explains the spread along the mean.
    common_factor_rms: float
    removed_variance: float  #: sum of the negative eigenvalues that were set to zero, as a positive number

    @property
    def remark(self) -> str:
        """Remark on the repair, in words; empty where there was none."""
        if self.removed_variance == 0.0:
            return ""
        return (
            f"the noise explains more than the whole spread in some direction: {self.removed_variance:.3g} of variance "
            "was set to zero there"
        )


def estimate_texture(
    pixels_of_mean: ArrayLike, noise_cov: ArrayLike, *, repeats: int, pattern_cov: ArrayLike
) -> Texture:
    """Return the texture of a region from the spread of the mean of its repeats.

    Parameters
    ----------
    pixels_of_mean
        Channels or Stokes parameters of each pixel in the mean of all repeats, shape (n, P), P >= 4; dark level
        subtracted.
    noise_cov
        Covariance that temporal noise gives one repeat, shape (n, n): diag(sigma_n^2), or W diag(sigma_n^2) W'.
    repeats
        Number of repeats in the mean, >= 1.
    pattern_cov
        Covariance of the sensor's fixed pattern at this signal, shape (n, n); zero where frames are flat-fielded or
        the pattern is to stay in.

    Returns
    -------
    Texture
        Sample covariance less noise_cov / repeats less pattern_cov, with negative eigenvalues set to zero.

    Raises
    ------
    ValueError
        Shapes do not fit, there are fewer than 4 pixels, or fewer than one repeat.

    Notes
    -----
    Standard errors come from the scatter of the products of deviations, (d_i d_j) over pixels, so they hold for any
    distribution of independent pixels; the error of the noise that is taken off is not in them. A region that served
    for this estimate does not test it: use another half or another run.

    References
    ----------
    [MK14] eq. (10), which leaves the estimate to its reference [56]; definition.
    """
    pixels = np.asarray(pixels_of_mean, dtype=np.float64)
    if pixels.ndim != 2 or pixels.shape[1] < 4 or repeats < 1:
        raise ValueError(f"pixels_of_mean has shape {pixels.shape}, repeats is {repeats}; needed are (n, P >= 4) and 1")
    off = pixels - pixels.mean(axis=1, keepdims=True)
    products = off[:, None, :] * off[None, :, :]
    sample = products.sum(axis=2) / (pixels.shape[1] - 1)
    raw = sample - np.asarray(noise_cov, dtype=np.float64) / repeats - np.asarray(pattern_cov, dtype=np.float64)
    values, vectors = np.linalg.eigh(0.5 * (raw + raw.T))
    kept = np.maximum(values, 0.0)
    cov = (vectors * kept) @ vectors.T
    mean = pixels.mean(axis=1)
    return Texture(
        cov=cov,
        std_error=products.std(axis=2, ddof=1) / np.sqrt(pixels.shape[1]),
        rank_one_share=float(kept[-1] / kept.sum()) if kept[-1] > 0.0 else float("nan"),
        common_factor_rms=float(np.sqrt(mean @ cov @ mean) / (mean @ mean)),
        removed_variance=float(-np.minimum(values, 0.0).sum()),
    )


@dataclass(frozen=True, kw_only=True)
class DistributionCheck:
    """One statistic of the pixels' DoLP, by the distribution and by the pixels, with the error of the difference."""

    predicted: float
    measured: float
    std_error: float


def check_dolp_distribution(
    frame_stokes: ArrayLike, mean_stokes: ArrayLike, added_cov: ArrayLike
) -> dict[str, DistributionCheck]:
    """Return mean, deviation and SNR of the pixels' DoLP, and those of the Gaussian distribution of their moments.

    Parameters
    ----------
    frame_stokes
        Stokes parameters of one cycle's pixels, shape (3, P), every S0 above 0; any unit.
    mean_stokes
        The same pixels in the mean of all cycles, shape (3, P); equal to `frame_stokes` where there is one cycle.
    added_cov
        What the noise of one cycle adds to the covariance of the mean of all, shape (3, 3); zero where there is one.

    Returns
    -------
    dict
        "mean", "std" and "snr".

    Raises
    ------
    ValueError
        The distribution has no moments: S0 is not bounded away from zero.

    Notes
    -----
    Both sides come from the same pixels, so the error of the difference is far smaller than that of either. It is
    taken from the scatter of each pixel's influence on the difference (infinitesimal jackknife).

    References
    ----------
    [MK14] eq. (21)-(29); Efron, B. (1982), "The Jackknife, the Bootstrap and Other Resampling Plans",
    doi:10.1137/1.9781611970319.
    """
    frame, mean = np.asarray(frame_stokes, dtype=np.float64), np.asarray(mean_stokes, dtype=np.float64)
    moments = _pack(mean.mean(axis=1), np.cov(mean, bias=True))
    added = np.asarray(added_cov, dtype=np.float64)
    distribution = _distribution(moments, added)
    influence_of_moments = _influence_on_moments(mean, moments).T @ _gradient(moments, added).T
    values = np.asarray(degree_of_polarization(frame.T))
    found = _statistics(float(values.mean()), float(values.std()))
    influence = _influence_on_statistics(values) - influence_of_moments
    errors = influence.std(axis=0) / np.sqrt(values.size)
    return {
        name: DistributionCheck(predicted=float(distribution[k]), measured=float(found[k]), std_error=float(errors[k]))
        for k, name in enumerate(("mean", "std", "snr"))
    }


def _checked(values: ArrayLike, *, least: int) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] < least:
        raise ValueError(f"values has shape {array.shape}; needed are at least {least} pixels on the last axis")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"values holds {int(np.sum(~np.isfinite(array)))} numbers that are not finite")
    return array


def _part_with(inside: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Return the part of a picture that holds a region; it begins where a block does."""
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    first = [int(places[0]) // _BLOCK_SIDE * _BLOCK_SIDE if places.size else 0 for places in (rows, columns)]
    last = [int(places[-1]) + 1 if places.size else 0 for places in (rows, columns)]
    return slice(first[0], last[0]), slice(first[1], last[1])


def _excess(values: FloatArray, inside: NDArray[np.bool_]) -> float:
    """Return by how much the variance of the mean is larger than that of pixels that are independent."""
    image = np.zeros(inside.shape)
    image[inside] = values
    alike = values.size / effective_pixels(image, inside)
    return (alike - 1.0) * float(np.var(values, ddof=1)) / values.size if alike > 1.0 else 0.0


# A correlation of neighbours is taken for one when it exceeds this many of its own standard errors; how far they reach.
_CORRELATION_SIGNIFICANCE, _REACHES_PX = 4.0, (1, 2, 4)


def _neighbours_are_alike(image: FloatArray, inside: NDArray[np.bool_]) -> bool:
    """Return whether neighbours are more alike than independent pixels, along rows, along columns, or around.

    Texture that is fainter than the noise shows in no pair, but in what many pairs have in common.
    """
    centred = np.where(inside, image - image[inside].mean(), 0.0)
    variance = float(np.sum(centred**2)) / inside.sum()
    if variance == 0.0:
        return False
    for along in ((slice(None), slice(1, None)), (slice(1, None), slice(None))):
        before = tuple(slice(None, -1) if part.start == 1 else part for part in along)
        pairs = int(np.sum(inside[along] & inside[before]))
        product = float(np.sum(centred[along] * centred[before]))
        if pairs > 0 and product / (pairs * variance) > _CORRELATION_SIGNIFICANCE / np.sqrt(pairs):
            return True
    sums, numbers = _running_sums(centred), _running_sums(inside)
    for reach in _REACHES_PX:
        # Each pair is counted twice; the product of a pixel with itself is taken off.
        twice = float(np.sum(_sums_around(numbers, reach), where=inside)) - int(inside.sum())
        together = float(np.vdot(centred, _sums_around(sums, reach))) - variance * int(inside.sum())
        if together > _CORRELATION_SIGNIFICANCE * variance * np.sqrt(2.0 * twice):
            return True
    return False


def _running_sums(image: FloatArray | NDArray[np.bool_]) -> FloatArray:
    """Return the sums of an image from its corner on, over a margin of the farthest reach and of one before it."""
    reach = max(_REACHES_PX)
    rows, columns = image.shape
    sums = np.zeros((rows + 2 * reach + 1, columns + 2 * reach + 1))
    sums[reach + 1 : -reach, reach + 1 : -reach] = image
    return np.asarray(sums.cumsum(axis=0, out=sums).cumsum(axis=1, out=sums))


def _sums_around(sums: FloatArray, reach: int) -> FloatArray:
    """Return the sum over the square of pixels up to so far away, of each pixel, from running sums."""
    margin, side = max(_REACHES_PX) - reach, 2 * reach + 1
    part = sums[margin : sums.shape[0] - margin, margin : sums.shape[1] - margin]
    return np.asarray(part[side:, side:] - part[:-side, side:] - part[side:, :-side] + part[:-side, :-side])


# Correlation that counts as none, and its own standard errors; share of all pairs that may be taken for correlated.
_NO_CORRELATION, _LAG_SIGNIFICANCE, _MOST_PAIRS = 0.02, 2.0, 0.25


def _pixels_by_lags(image: FloatArray, inside: NDArray[np.bool_]) -> tuple[float, bool]:
    """Return how many independent pixels a region is worth, and whether correlations end within it.

    Deviations from the region's own mean are less alike than those from the true one, by the variance of the mean.
    """
    count = int(inside.sum())
    centred = np.where(inside, image - image[inside].mean(), 0.0)
    variance = float(np.sum(centred**2)) / count
    products, pairs = _by_distance(centred), _by_distance(inside.astype(np.float64))
    product, share, of_mean, is_whole = products[0], pairs[0] / count**2, products[0] / count**2, False
    for here, held in zip(products[1:], pairs[1:], strict=True):
        alike = (here + of_mean * held) / (max(held, 1.0) * variance)
        is_whole = alike < max(_NO_CORRELATION, _LAG_SIGNIFICANCE * np.sqrt(2.0 / max(held, 1.0)))
        if is_whole or share + held / count**2 > _MOST_PAIRS:
            break
        product, share = product + here, share + held / count**2
        of_mean = product / count**2 / (1.0 - share)
    # A variance of few independent parts (1 / share) is itself not known: Student's distribution is wider by so much.
    of_mean /= 1.0 - 2.0 * min(share, _MOST_PAIRS)
    return (float(min(max(variance / of_mean, 1.0), count)) if of_mean > 0.0 else float(count)), is_whole


def _by_distance(image: FloatArray) -> FloatArray:
    """Return the sums of products of two pixels, by how many rows or columns they are apart, whichever is more."""
    shape = (2 * image.shape[0], 2 * image.shape[1])
    apart = [np.abs(np.fft.fftfreq(size, 1.0 / size)).astype(np.intp) for size in shape]
    products = np.fft.irfft2(np.abs(np.fft.rfft2(image, s=shape)) ** 2, s=shape)
    sums = np.bincount(np.maximum(apart[0][:, None], apart[1][None, :]).ravel(), products.ravel())
    return np.asarray(sums, dtype=np.float64)


def _block_means(image: FloatArray, inside: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Return mean and size of each block of the region that is at least half full."""
    rows, columns = np.nonzero(inside)
    blocks = (rows // _BLOCK_SIDE) * (image.shape[1] // _BLOCK_SIDE + 1) + columns // _BLOCK_SIDE
    sizes = np.bincount(blocks).astype(np.float64)
    sums = np.bincount(blocks, weights=image[rows, columns])
    full = sizes >= _BLOCK_SIDE**2 / 2
    return sums[full] / sizes[full], sizes[full]


def _root_of_mean(per_pixel: FloatArray, *, correction: float) -> Sample:
    """Return the root of the mean of per-pixel variances, its error by the delta method."""
    root = float(np.sqrt(per_pixel.mean() * correction))
    if root == 0.0:
        return Sample(value=0.0, std_error=0.0)
    error_of_mean = float(per_pixel.std(ddof=1)) / np.sqrt(per_pixel.size)
    return Sample(value=root, std_error=float(error_of_mean / (2.0 * root)))


# Chance that cycles which repeat themselves are taken for not doing so. What noise alone may give is not counted: it
# would widen the errors of means of few cycles by a third. An error found with a chance above the second is near its
# limit, not known from few cycles only: with Student's law one sound run in fifteen could not show light 0.2 % off.
_BY_CHANCE, _HARDLY_BY_CHANCE = 0.05, 1e-3
# Least drift, in its standard errors, and least number of cycles to distinguish it from light that wanders.
_SURELY, _LEAST_CYCLES = 4.0, 3


def _repeatability(means: FloatArray, noise: FloatArray, times: FloatArray | None = None) -> Repeatability:
    """Return what differs from cycle to cycle and is not the noise of the pixels.

    `means` are those over the pixels, shape (C, N); `noise` is what the noise of the pixels makes of their variance.
    The factor of each cycle that all angles share is taken out by least squares; what is left, of (C - 1) (N - 1)
    degrees of freedom, is each angle's own. A factor that drifts reaches the angles of one cycle one after the other:
    where their times are known and cycles are enough, it is divided out, and its error counts; else its slope counts
    for each angle as if it came at a time of its own.

    Definition; analysis of variance of a two-way layout.
    """
    level = means.mean(axis=0)
    if len(means) < 2 or not float(level @ level) > 0.0:
        return Repeatability()
    if times is not None and len(means) >= _LEAST_CYCLES:
        (_, drift, _), off = _differences(means, noise, times), times - times.mean()
        left, _, variance = _differences(means / (1.0 + drift * off), noise, times, freedom=len(means) - 2)
        if drift**2 > _SURELY**2 * variance:
            return replace(left, drift=drift, drift_error=np.sqrt(variance) * off.mean(axis=0))
    steady, slope, variance = _differences(means, noise, np.arange(float(len(means)))[:, None])
    drifted = 0.0 if _chance(slope**2, variance, 1) > _BY_CHANCE else max(slope**2 - variance, 0.0) / 12.0
    return replace(steady, own=float(np.sqrt(steady.own**2 + drifted * (1.0 - level.size**-2.0))))


def _differences(
    means: FloatArray, noise: FloatArray, times: FloatArray, *, freedom: int | None = None
) -> tuple[Repeatability, float, float]:
    """Return what angles do not repeat, the slope of the light over the cycles, and the variance of the slope."""
    cycles, angles = means.shape
    level = means.mean(axis=0)
    light, share = float(level @ level), float(np.sum(level**4)) / float(level @ level) ** 2
    noise_of_factor = float(level**2 @ noise) / light**2
    factor = (means - level) @ level / light
    left = means - level * (1.0 + factor[:, np.newaxis])
    noise_left = float(noise.sum()) - noise_of_factor * light
    own, own_freedom = 0.0, np.inf
    if angles > 1:
        squares, of_own = float(np.sum(left**2)) / (cycles - 1), (cycles - 1) * (angles - 1)
        chance = _chance(squares, noise_left, of_own)
        if chance < _BY_CHANCE:
            own = (squares - noise_left) / (light * (1.0 - share))
            own_freedom = of_own * (1.0 - noise_left / squares) ** 2 if chance < _HARDLY_BY_CHANCE else np.inf
    # Of the factor's variance, the part that the angles' own errors and the noise leave.
    of_others = noise_of_factor + own * share
    freedom = cycles - 1 if freedom is None else freedom
    common, common_freedom, spread = 0.0, np.inf, float(np.sum((factor - factor.mean()) ** 2)) / freedom
    chance = _chance(spread, of_others, freedom)
    if chance < _BY_CHANCE:
        common = spread - of_others
        common_freedom = freedom * (1.0 - of_others / spread) ** 2 if chance < _HARDLY_BY_CHANCE else np.inf
    apart = times - times.mean(axis=0)
    weight = float(np.sum((level * apart) ** 2))
    found = Repeatability(
        own=float(np.sqrt(own / cycles)),
        common=float(np.sqrt(common / cycles)),
        own_freedom=own_freedom,
        common_freedom=common_freedom,
    )
    return found, float(np.sum(level * apart * means)) / weight, (of_others + common) * light / weight


def _chance(variance: float, noise: float, freedom: int) -> float:
    """Return the chance that noise gives so large a variance, of degrees of freedom."""
    if noise > 0.0:
        return float(gammaincc(0.5 * freedom, 0.5 * freedom * variance / noise))
    return 0.0 if variance > 0.0 else 1.0


class _Running:
    """First and mean of vectors of pixels, and squared steps of linear functions of them, less their means."""

    def __init__(self, rows: FloatArray) -> None:
        self._rows, self._cycles = rows, 0
        self.first = self.mean = self._before = self._steps = np.empty((0, 0))

    def add(self, values: FloatArray) -> None:
        self._cycles += 1
        if self._cycles == 1:
            self.first, self.mean, self._steps = values, values.copy(), np.zeros((len(self._rows), values.shape[1]))
        else:
            step = values - self._before
            step -= step.mean(axis=1, keepdims=True)
            of_rows = self._rows @ step
            self._steps += np.square(of_rows, out=of_rows)
            self.mean += (values - self.mean) / self._cycles
        self._before = values

    def temporal(self, cycles: int, inflation: float) -> tuple[Sample, ...]:
        """Return deviations from frame to frame, by half the mean squared difference of consecutive repeats.

        Differences that share a frame are correlated; the error is taken over pixels, and needs no knowledge of that.
        EMVA Standard 1288, Release 4.0 Linear, section 6.6 (pairs).
        """
        if cycles < 2:
            return ()
        correction = self._steps.shape[1] / (self._steps.shape[1] - 1)
        found = (_root_of_mean(steps / (cycles - 1) / 2.0, correction=correction) for steps in self._steps)
        return tuple(replace(one, std_error=one.std_error * float(np.sqrt(inflation))) for one in found)


# Pairs (i, j) of a symmetric 3 x 3 matrix that are free.
_FREE = tuple((i, j) for i in range(3) for j in range(i, 3))


def _pack(mean: FloatArray, cov: FloatArray) -> FloatArray:
    return np.concatenate([mean, [cov[i, j] for i, j in _FREE]])


# Step of a numerical derivative in units of the pixels' own deviation.
_STEP = 1e-3
_TOLERANCE = 1e-7


def _distribution(packed: FloatArray, added: FloatArray) -> FloatArray:
    distribution = dolp.moments(packed[:3], _unpack_cov(packed) + added, tolerance=_TOLERANCE)
    if not bool(distribution.exists):
        raise ValueError(f"mean and deviation of the pixels' DoLP do not exist: {distribution.reason}")
    return _statistics(float(distribution.mean), float(distribution.std))


def _unpack_cov(packed: FloatArray) -> FloatArray:
    cov = np.empty((3, 3))
    for value, (i, j) in zip(packed[3:], _FREE, strict=True):
        cov[i, j] = cov[j, i] = value
    return cov


def _statistics(mean: float, std: float) -> FloatArray:
    return np.array([mean, std, mean / std])


def _influence_on_moments(pixels: FloatArray, packed: FloatArray) -> FloatArray:
    """Return how much each pixel shifts each of the nine moments, shape (9, P)."""
    off = pixels - packed[:3, None]
    products = np.stack([off[i] * off[j] for i, j in _FREE])
    return np.concatenate([off, products - packed[3:, None]])


def _gradient(packed: FloatArray, added: FloatArray) -> FloatArray:
    """Return the derivative of the distribution's three statistics by the nine moments, shape (3, 9)."""
    deviations = np.sqrt(np.diag(_unpack_cov(packed) + added))
    scales = np.concatenate([deviations, [deviations[i] * deviations[j] for i, j in _FREE]])
    columns = []
    for k, scale in enumerate(scales):
        step = np.zeros(9)
        step[k] = _STEP * scale
        columns.append((_distribution(packed + step, added) - _distribution(packed - step, added)) / (2.0 * step[k]))
    return np.stack(columns, axis=1)


def _influence_on_statistics(values: FloatArray) -> FloatArray:
    """Return how much each pixel shifts mean, deviation and their ratio, shape (P, 3)."""
    mean, std = values.mean(), values.std()
    on_mean = values - mean
    on_std = (on_mean**2 - std**2) / (2.0 * std)
    return np.stack([on_mean, on_std, on_mean / std - mean * on_std / std**2], axis=1)
