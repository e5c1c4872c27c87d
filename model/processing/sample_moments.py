"""Mean and deviation of the pixels of a region, each with its standard error.

Every standard error here is taken from the scatter of the pixels themselves, not from an assumed distribution, and
holds for pixels that are independent of each other: `effective_pixels` says how far they are.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import Moments

FloatArray = NDArray[np.float64]

# A correlation of neighbours is taken for one when it exceeds this many of its own standard errors.
_CORRELATION_SIGNIFICANCE = 5.0
# Side of the blocks whose means tell how many independent pixels there are [pixels].
_BLOCK_SIDE = 16
_LEAST_BLOCKS = 12
# Regions up to this side are looked at lag by lag, larger ones by their blocks [pixels].
_MOST_LAGS = 256
# Correlation that counts as none, and its own standard errors; share of all pairs that may be taken for correlated.
_NO_CORRELATION, _LAG_SIGNIFICANCE, _MOST_PAIRS = 0.02, 2.0, 0.25
# Share of the largest variance below which a component is rounding.
_NOTHING = 1e-12


@dataclass(frozen=True, kw_only=True)
class Sample:
    """A number found from a sample, with the standard error that the sample gives for it."""

    value: float
    std_error: float


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
    array = _checked(values, least=4)
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


def _excess(values: FloatArray, inside: NDArray[np.bool_]) -> float:
    """Return by how much the variance of the mean is larger than that of pixels that are independent."""
    image = np.zeros(inside.shape)
    image[inside] = values
    alike = values.size / effective_pixels(image, inside)
    return (alike - 1.0) * float(np.var(values, ddof=1)) / values.size if alike > 1.0 else 0.0


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


def temporal_deviation(repeats: ArrayLike) -> Sample:
    """Return the deviation from frame to frame of a pixel, from the differences of consecutive repeats.

    Parameters
    ----------
    repeats
        Shape (R, P): R >= 2 repeats of P >= 4 pixels, in the order of time; any unit.

    Returns
    -------
    Sample
        Root of half the mean squared difference, the mean difference of each pair taken off: neither a pattern
        that stands still nor a flicker common to all pixels adds to it.

    Raises
    ------
    ValueError
        There are fewer repeats or pixels, or a value is not finite.

    Notes
    -----
    Differences that share a frame are correlated; the standard error is taken over pixels, from what each pixel
    gives after all its repeats, and so needs no knowledge of that.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, section 6.6 (pairs); definition.
    """
    array = _checked(repeats, least=4)
    if array.shape[0] < 2:
        raise ValueError(f"repeats has {array.shape[0]} repeat; a temporal deviation needs at least 2")
    differences = np.diff(array, axis=0)
    differences -= differences.mean(axis=1, keepdims=True)
    return deviation_of_squares(np.mean(differences**2, axis=0) / 2.0)


def deviation_of_squares(per_pixel: FloatArray) -> Sample:
    """Return the deviation from frame to frame by half the mean squared difference of each pixel, shape (P,).

    The mean over the pixels was taken off each difference, as in `temporal_deviation`.

    Parameters
    ----------
    per_pixel
        Half the mean squared difference of consecutive repeats, shape (P,), P >= 2, in the square of any unit.
    """
    return _root_of_mean(per_pixel, correction=per_pixel.size / (per_pixel.size - 1))


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


def _neighbours_are_alike(image: FloatArray, inside: NDArray[np.bool_]) -> bool:
    """Return whether the correlation of neighbours along rows or columns exceeds what independent pixels would show."""
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
    return False


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


def _checked(values: ArrayLike, *, least: int) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] < least:
        raise ValueError(f"values has shape {array.shape}; needed are at least {least} pixels on the last axis")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"values holds {int(np.sum(~np.isfinite(array)))} numbers that are not finite")
    return array
