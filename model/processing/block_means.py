"""Means of square blocks of pictures, where every pixel of the block is usable."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def block_means(pictures: ArrayLike, usable: ArrayLike, *, side: int) -> NDArray[np.float64]:
    """Return the mean of each block all of whose pixels are usable.

    Parameters
    ----------
    pictures
        Shape (N, H, W).
    usable
        Shape (H, W), bool.
    side
        Of a block [pixel], >= 1; rows and columns that do not fill a block are left out.

    Returns
    -------
    array of float64, shape (N, B)
        B blocks, row by row; none where none is usable.
    """
    images, good = np.asarray(pictures, dtype=np.float64), np.asarray(usable, dtype=np.bool_)
    rows, columns = good.shape[0] // side, good.shape[1] // side
    cut = images[:, : rows * side, : columns * side].reshape(-1, rows, side, columns, side)
    whole = good[: rows * side, : columns * side].reshape(rows, side, columns, side).all(axis=(1, 3))
    return np.asarray(cut.mean(axis=(2, 4))[:, whole])
