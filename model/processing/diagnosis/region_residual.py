"""What no light gives in the mean of a region, with the error that the residual of its own pixels shows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.processing.reconstruction import Design

FloatArray = NDArray[np.float64]

# Blocks of a region, the largest first: neighbours share blur, mosaics and shading.
_SIDES_PIXELS = (32, 16, 8, 4, 2, 1)
_LEAST_BLOCKS = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class RegionResidual:
    """The mean counts of a region, and the covariance of what in them is no light.

    Attributes
    ----------
    means : (N,) array
        Of the region.
    cov : (N, N) array
        Of the residual of that mean; nothing along what light does.
    """

    means: FloatArray
    cov: FloatArray


def region_residual(plan: Design, pictures: FloatArray, inside: NDArray[np.bool_]) -> RegionResidual:
    """Return the mean of a region and the covariance of its residual, from blocks of the residual.

    Parameters
    ----------
    plan
        Of the frames.
    pictures
        Shape (N, H, W), dark level taken off.
    inside
        Usable pixels of the region, shape (H, W); one at least.

    Notes
    -----
    Texture cancels in the residual, so that its blocks and not those of the channels tell the error.
    """
    rows, columns = np.nonzero(inside)
    if not rows.size:
        raise ValueError("inside holds no pixel; at least one is needed")
    counts = pictures[:, rows, columns]
    onto = plan.null_basis @ plan.null_basis.T
    residual = onto @ counts
    scattered = [_scatter_of_mean(residual, rows // side, columns // side) for side in _SIDES_PIXELS]
    found = [cov for cov in scattered if cov is not None]
    widest = max(found, key=lambda cov: float(np.trace(cov)), default=np.zeros((len(counts),) * 2))
    return RegionResidual(means=np.asarray(counts.mean(axis=1)), cov=widest)


def _scatter_of_mean(residual: FloatArray, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> FloatArray | None:
    """Return the covariance of the mean as blocks show it; None where there are too few of them."""
    _, block = np.unique(rows * (int(columns.max()) + 1) + columns, return_inverse=True)
    blocks = int(block.max()) + 1
    if blocks < _LEAST_BLOCKS:
        return None
    left = residual - residual.mean(axis=1, keepdims=True)
    sums = np.array([np.bincount(block, weights=one, minlength=blocks) for one in left])
    return np.asarray(sums @ sums.T * (blocks / (blocks - 1.0)) / residual.shape[1] ** 2)
