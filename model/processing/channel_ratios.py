"""Counts behind each polarizer angle over the mean of all: what of them does not depend on scale."""

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments

FloatArray = NDArray[np.float64]


def channel_ratios(channels: Moments) -> tuple[FloatArray, FloatArray]:
    """Return the counts of each channel over the mean of all channels, and their standard errors to first order.

    Parameters
    ----------
    channels
        Mean counts, shape (N,), dark level taken off, with their covariance.

    Raises
    ------
    ValueError
        The mean of all channels is not above 0.

    Notes
    -----
    N ratios of which N - 1 are free: their mean is 1.
    """
    whole = float(channels.mean.mean())
    if not whole > 0.0:
        raise ValueError(f"the mean of all channels is {whole:.3g}; a ratio needs it above 0")
    ratios = channels.mean / whole
    count = channels.mean.size
    jacobian = (np.eye(count) - ratios[:, None] / count) / whole
    variances = np.einsum("ij,jk,ik->i", jacobian, channels.cov, jacobian)
    # Of an error that is common to all channels only rounding is left, of either sign.
    return ratios, np.sqrt(np.maximum(variances, 0.0))
