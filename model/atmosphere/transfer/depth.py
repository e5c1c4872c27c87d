"""Integration of the source function along a line of sight through layers.

Each layer is cut in elements, in which the source is a parabola of optical depth through the values at the top, in
the middle and at the bottom; the exponential of extinction is integrated exactly.
"""

from collections.abc import Sequence
from math import ceil

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.transfer.layers import Layer

_ROUNDING = 1e-9
_SERIES_TERMS = 18  # what the first guess leaves of an error at 1 is 2/18!


def element_edges(
    layers: Sequence[Layer], *, element_depth: float, halvings: int
) -> tuple[NDArray[np.float64], NDArray[np.int_]]:
    """Optical depths of the elements' faces, and the layer each element belongs to.

    Parameters
    ----------
    layers
        Top to bottom, each of depth above 0.
    element_depth
        Largest optical depth of an element, above 0.
    halvings
        How often the elements at the top and at the ground are halved toward the face.

    Returns
    -------
    edges : ndarray, shape (E + 1,)
        From 0 to the depth of all.
    owner : ndarray, shape (E,)
        Index of the layer.
    """
    # A depth that is a multiple of the element's but for rounding must not make one element more.
    counts = [max(ceil(layer.depth / element_depth - _ROUNDING), 1) for layer in layers]
    depths = [layer.depth / count for layer, count in zip(layers, counts, strict=True)]
    owner = np.repeat(np.arange(len(layers)), counts)
    edges = np.concatenate([[0.0], np.cumsum(np.repeat(depths, counts))])
    if owner.size == 0 or halvings == 0:
        return edges, owner
    # The source bends like t log t at the outer faces: the first and the last element are halved toward them.
    shares = 0.5 ** np.arange(1, halvings + 1)
    edges = np.concatenate([[0.0], edges[1] * shares[::-1], edges[1:]])
    last = edges[-1] - edges[-2]
    edges = np.concatenate([edges[:-1], edges[-1] - last * shares, edges[-1:]])
    return edges, np.pad(owner, halvings, mode="edge")


def slant(depth: NDArray[np.float64], mu: NDArray[np.float64]) -> NDArray[np.float64]:
    """Slant optical depth depth/mu; infinite at the horizon, and 0 where there is no depth.

    Parameters
    ----------
    depth
        Vertical optical depth, 0 or more.
    mu
        Cosine of the zenith angle, 0 to 1; broadcasts with the depth.
    """
    depth, mu = np.broadcast_arrays(depth, mu)
    path = np.where(depth > 0.0, np.inf, 0.0)
    with np.errstate(over="ignore"):  # of cosines next to 0
        np.divide(depth, mu, out=path, where=mu > 0.0)
    return path


def source_weights(*, path: NDArray[np.float64], part: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights of the three source values of an element in the radiance that it adds.

    Parameters
    ----------
    path
        Slant optical depth of the whole element, 0 or more; infinite allowed.
    part
        Share of the element that light has crossed since it came in, 0 to 1; broadcasts against path.

    Returns
    -------
    ndarray, shape (..., 3)
        For the values where the light comes in, in the middle, and at the far face.

    Notes
    -----
    Exact for a source that is a parabola of depth. At the horizon only the source at the observer counts.
    """
    constant, linear, square = (part**power * moment for power, moment in enumerate(_exponential_moments(path, part)))
    return np.stack([constant - 3.0 * linear + 2.0 * square, 4.0 * (linear - square), 2.0 * square - linear], axis=-1)


def _exponential_moments(path: NDArray[np.float64], part: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Moments E_k = y * integral over z in (0, 1) of exp(-y (1 - z)) z^k, k = 0, 1, 2, for y = path * part."""
    crossed = np.zeros(np.broadcast_shapes(path.shape, part.shape))
    np.multiply(path, part, out=crossed, where=part > 0.0)
    zeroth = -np.expm1(-crossed)
    thick = np.maximum(crossed, 1.0)
    first_thick = 1.0 - zeroth / thick
    second_thick = 1.0 - 2.0 * first_thick / thick
    first, second = _moments_of_thin(np.minimum(crossed, 1.0))
    is_thick = crossed > 1.0
    return [zeroth, np.where(is_thick, first_thick, first), np.where(is_thick, second_thick, second)]


def _moments_of_thin(crossed: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """First and second moments by backward recurrence, which keeps all digits for arguments up to 1."""
    moment = crossed / (_SERIES_TERMS + 1.0)
    for power in range(_SERIES_TERMS, 2, -1):
        moment = crossed * (1.0 - moment) / power
    return crossed * (1.0 - moment) / 2.0, moment
