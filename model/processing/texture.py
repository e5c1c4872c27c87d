"""The texture of a region, Sigma_v, out of the spread of its pixels: what is left when the noise is taken off."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Texture:
    """Covariance of the light over a region's pixels, estimated.

    Parameters
    ----------
    cov
        Estimate, shape (n, n), positive semi-definite; in the square of the pixels' unit.
    std_error
        Standard error of each element, shape (n, n), before any repair.
    rank_one_share
        Largest eigenvalue over the trace: 1 where all components vary together, as for a common factor such as albedo;
        1/n where they vary alike and independently. Not a number where there is no texture.
    common_factor_rms
        Relative rms of a factor common to all components that explains the spread along the mean; the rest of `cov`
        is what such a factor does not explain.
    removed_variance
        Sum of the negative eigenvalues that were set to zero, as a positive number: 0 where nothing was repaired.
    """

    cov: FloatArray
    std_error: FloatArray
    rank_one_share: float
    common_factor_rms: float
    removed_variance: float

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
        Channels or Stokes parameters of each pixel in the mean of all repeats, shape (n, P), P >= 4; dark level off.
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
