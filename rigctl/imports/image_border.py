"""Constant pixels along the edges of an image: what resampling, cropping or a mask left there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

# A border is at least so long, as a share of the shorter side, and at most so large a share of the image.
_LEAST_LENGTH, _LARGEST_SHARE = 0.5, 0.3
# A value that is as common within the image is no border's.
_LARGEST_SHARE_INSIDE = 0.01


@dataclass(frozen=True, kw_only=True)
class Border:
    """Pixels of one value that hang together along the edges.

    Attributes
    ----------
    value_dn : int
        Their count.
    fraction : float
        Of all pixels.
    """

    value_dn: int
    fraction: float


def constant_border(counts: NDArray[np.uint16]) -> Border | None:
    """Return the constant border of an image, or None.

    Parameters
    ----------
    counts : (H, W) array
        As in the file.

    Notes
    -----
    The most common value along the four edges, where pixels of it hang together from an edge inward, are at least
    half a side long, and are rare in the rest of the image. An image that is dark all over has none.
    """
    edges = np.concatenate([counts[0], counts[-1], counts[:, 0], counts[:, -1]])
    values, numbers = np.unique(edges, return_counts=True)
    value = int(values[np.argmax(numbers)])
    same = counts == value
    pieces, _ = label(same)
    touching = np.unique(np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]]))
    sizes = np.bincount(pieces.ravel())
    least = _LEAST_LENGTH * min(counts.shape)
    border = [int(piece) for piece in touching if piece and sizes[piece] >= least]
    pixels = int(sum(sizes[piece] for piece in border))
    inside = int(same.sum()) - pixels
    if not pixels or pixels > _LARGEST_SHARE * counts.size or inside > _LARGEST_SHARE_INSIDE * counts.size:
        return None
    return Border(value_dn=value, fraction=pixels / counts.size)
