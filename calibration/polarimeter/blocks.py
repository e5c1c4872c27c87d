"""Pictures as means over blocks of pixels, for maps."""

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError

FloatArray = NDArray[np.float64]


def block_means(picture: NDArray[np.float64] | NDArray[np.uint16] | NDArray[np.bool_], side: int) -> FloatArray:
    """Return the means over square blocks of a picture.

    Parameters
    ----------
    picture : (H, W) array
        Counts, or true and false: then the share of true.
    side : int
        Pixels along a side of a block; 1 gives the picture itself. Rows and columns at the lower and right border that
        do not make a whole block are left out.

    Raises
    ------
    CalibrationError
        The picture is smaller than a block.
    """
    rows, columns = (length // side for length in picture.shape)
    if side < 1 or rows == 0 or columns == 0:
        raise CalibrationError(
            f"blocks of {side} x {side} pixels do not fit into a picture of {picture.shape[1]} x {picture.shape[0]}"
        )
    whole = picture[: rows * side, : columns * side].astype(np.float64)
    means: FloatArray = whole.reshape(rows, side, columns, side).mean(axis=(1, 3))
    return means
