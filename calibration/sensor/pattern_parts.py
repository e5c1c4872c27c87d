"""The fixed pattern of a level, split into what rows, columns, single pixels and uneven light have of it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

SingleArray = NDArray[np.float32]

# The coarse grid on which uneven light is told from pixel noise.
_BLOCKS_ACROSS = 16


@dataclass(frozen=True, kw_only=True)
class PatternParts:
    """Variances [DN^2] that add up to the spatial variance; each may be below 0 by its error."""

    row_dn2: float
    column_dn2: float
    pixel_dn2: float


def pattern_parts(picture_dn: SingleArray, *, spatial_variance_dn2: float, noise_dn2: float) -> PatternParts:
    """Return the parts of the spatial variance that rows, columns and pixels have.

    Parameters
    ----------
    picture_dn : (M, N) array of float32
        Mean picture of a level [DN].
    spatial_variance_dn2 : float
        Its variance, temporal noise taken off [DN^2].
    noise_dn2 : float
        Temporal variance that is left in a pixel of the mean picture [DN^2].

    Notes
    -----
    A picture of one row, one column or 2 x 2 pixels has no parts that could be told apart; all of it counts as pixels'.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, section 8.2: the means of rows and of columns hold their own pattern
    and a share of the pixels', which three linear equations take apart.
    """
    rows, columns = picture_dn.shape
    freedom = rows * columns - rows - columns
    if freedom <= 0:
        return PatternParts(row_dn2=0.0, column_dn2=0.0, pixel_dn2=spatial_variance_dn2)
    of_columns = float(np.var(cv2.reduce(picture_dn, 0, cv2.REDUCE_AVG, dtype=cv2.CV_64F))) - noise_dn2 / rows
    of_rows = float(np.var(cv2.reduce(picture_dn, 1, cv2.REDUCE_AVG, dtype=cv2.CV_64F))) - noise_dn2 / columns
    n = rows * columns
    return PatternParts(
        row_dn2=((n - columns) * of_rows - rows * (spatial_variance_dn2 - of_columns)) / freedom,
        column_dn2=((n - rows) * of_columns - columns * (spatial_variance_dn2 - of_rows)) / freedom,
        pixel_dn2=n * (spatial_variance_dn2 - of_columns - of_rows) / freedom,
    )


def small_scale_variance(picture_dn: SingleArray) -> float | None:
    """Return the variance of pixels about the mean of their block, noise included [DN^2]; None for a tiny picture.

    Parameters
    ----------
    picture_dn : (M, N) array of float32
        Mean picture of a level, its mean taken off [DN].

    Notes
    -----
    Blocks have a sixteenth of the shorter side; the last rows and columns that fill none are left out.
    """
    side = _block_side(picture_dn.shape)
    if side == 0:
        return None
    rows, columns = picture_dn.shape[0] // side, picture_dn.shape[1] // side
    whole = picture_dn[: rows * side, : columns * side]
    # By whole numbers, area interpolation is the mean of each block.
    blocks = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    within = cv2.norm(whole, cv2.NORM_L2SQR) - side**2 * cv2.norm(blocks, cv2.NORM_L2SQR)
    return float(within) / (whole.size - blocks.size)


def small_scale_freedom(shape: tuple[int, int]) -> float:
    """Return the share of the pixels' degrees of freedom that is left once block means are taken off."""
    side = _block_side(shape)
    return 1.0 - side**-2 if side else 1.0


def _block_side(shape: tuple[int, ...]) -> int:
    """Return the side of a block, 0 where there are not two of them."""
    side = max(2, min(shape) // _BLOCKS_ACROSS)
    return side if (shape[0] // side) * (shape[1] // side) > 1 else 0


def mosaic_contrast(picture_dn: SingleArray, *, mean_dn: float) -> float:
    """Return the largest difference of the means of the four pixels of a 2 x 2 cell, relative to the mean.

    Parameters
    ----------
    picture_dn : (M, N) array of float32
        Mean picture of a level, its mean taken off or not [DN]. The last row and column of an odd number are left out.
    mean_dn : float
        Mean of the level [DN].
    """
    rows, columns = (size - size % 2 for size in picture_dn.shape)
    if rows * columns == 0 or mean_dn <= 0.0:
        return 0.0
    lines = [cv2.reduce(picture_dn[start:rows:2], 0, cv2.REDUCE_AVG, dtype=cv2.CV_64F)[0] for start in (0, 1)]
    cells = [line[side:columns:2].mean() for line in lines for side in (0, 1)]
    return float(max(cells) - min(cells)) / mean_dn
