"""Row and column noise, and noise in time that neighbouring pixels share."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

SingleArray = NDArray[np.float32]

# So many pixels, of the first rows, show it well enough.
_PIXELS = 98304


@dataclass(frozen=True, kw_only=True)
class RowColumnNoise:
    """From the difference of two frames, its mean taken off.

    Attributes
    ----------
    horizontal, vertical : float
        Correlation of the noise of a pixel with that of its neighbour to the right, and below.
    std_error : float
        Of these two, where noise is independent from pixel to pixel.
    row_variance_dn2, column_variance_dn2 : float
        Variance that all pixels of a row, and of a column, have in common in one frame [DN^2]; may be below 0 by
        its error.
    row_std_error_dn2, column_std_error_dn2 : float
        Of these two, where noise is independent from pixel to pixel [DN^2].
    """

    horizontal: float
    vertical: float
    std_error: float
    row_variance_dn2: float
    column_variance_dn2: float
    row_std_error_dn2: float
    column_std_error_dn2: float


def row_column_noise(
    first: NDArray[np.uint16], second: NDArray[np.uint16], *, outlier: NDArray[np.bool_] | None
) -> RowColumnNoise:
    """Return what pixels share of the noise in time.

    Parameters
    ----------
    first, second : (H, W) arrays of uint16
        Two frames of one level [DN].
    outlier : (H, W) array of bool or None
        Pixels to leave out.

    Notes
    -----
    A sensor's noise is independent from pixel to pixel. Neighbours share noise where a camera filters, interpolates
    colours or compresses, and where charge spreads; the gain of a photon-transfer curve is then wrong by as much.
    """
    shown = slice(max(2, _PIXELS // first.shape[1]))
    difference = np.subtract(second[shown], first[shown], dtype=np.float32)
    difference -= cv2.mean(difference)[0]
    if outlier is not None:
        difference[outlier[shown]] = 0.0
    rows, columns = difference.shape
    total = _product(difference, difference)
    variance_dn2 = 0.5 * total / difference.size
    of_rows = (
        0.5 * float(np.square(cv2.reduce(difference, 1, cv2.REDUCE_AVG, dtype=cv2.CV_64F)).mean())
        - variance_dn2 / columns
    )
    of_columns = (
        0.5 * float(np.square(cv2.reduce(difference, 0, cv2.REDUCE_AVG, dtype=cv2.CV_64F)).mean()) - variance_dn2 / rows
    )
    return RowColumnNoise(
        horizontal=_product(difference[:, 1:], difference[:, :-1]) / total if total else 0.0,
        vertical=_product(difference[1:], difference[:-1]) / total if total else 0.0,
        std_error=float(1.0 / np.sqrt(difference.size)),
        row_variance_dn2=of_rows,
        column_variance_dn2=of_columns,
        row_std_error_dn2=float(variance_dn2 / columns * np.sqrt(2.0 / rows)),
        column_std_error_dn2=float(variance_dn2 / rows * np.sqrt(2.0 / columns)),
    )


def _product(one: SingleArray, other: SingleArray) -> float:
    # Not `@`: its threads cost more than they save.
    return float(np.einsum("ij,ij->i", one, other).sum(dtype=np.float64))
