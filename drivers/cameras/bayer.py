"""One colour of a mosaic, or several summed: every pixel of the result is one cell of 2 x 2 samples."""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from drivers.cameras.pixel_format import PixelFormat
from drivers.errors import LimitError

Plane = Literal["red", "green-1", "green-2", "blue", "green", "sum"]
PLANES: tuple[Plane, ...] = get_args(Plane)
"""Green-1 stands in the rows of red. "green" is the sum of both greens, "sum" that of all four samples."""

_SUMMED: dict[str, tuple[str, ...]] = {
    "green": ("green-1", "green-2"),
    "sum": ("red", "green-1", "green-2", "blue"),
}
_MOST_DN = 65535


def samples_of(plane: Plane) -> int:
    """Return how many samples make a pixel of a plane: 1, 2 or 4."""
    return len(_SUMMED.get(plane, (plane,)))


def places_of(plane: Plane, *, cell: str) -> tuple[tuple[int, int], ...]:
    """Return row and column within a cell, such as "RGGB", of each sample that makes a pixel of a plane."""
    red, blue = divmod(cell.index("R"), 2), divmod(cell.index("B"), 2)
    places = {"red": red, "blue": blue, "green-1": (red[0], 1 - red[1]), "green-2": (blue[0], 1 - blue[1])}
    return tuple(places[colour] for colour in _SUMMED.get(plane, (plane,)))


def bit_depth_of(plane: Plane, *, bit_depth: int) -> int:
    """Return the bits of a plane, whose samples have `bit_depth` bits.

    Raises
    ------
    LimitError
        A sum would not fit 16 bits.
    """
    depth = bit_depth + (samples_of(plane) - 1).bit_length()
    if depth > 16:
        raise LimitError(
            f"plane {plane}: a sum of {samples_of(plane)} samples of {bit_depth} bits takes {depth}, and counts have "
            "16 at most; take one colour, or state the true bit_depth where samples have fewer"
        )
    return depth


def take_plane(
    counts: NDArray[np.uint16], *, cell: str, plane: Plane, saturation_dn: int, saturated_as_dn: int
) -> NDArray[np.uint16]:
    """Return a plane of a mosaic, in an array of its own.

    Parameters
    ----------
    counts : (H, W) array of uint16
        The mosaic; its first sample is the first of a cell.
    cell : str
        Colours of a cell row by row, such as "RGGB".
    plane : str
        What is wanted.
    saturation_dn : int
        A sample at or above this is saturated [DN].
    saturated_as_dn : int
        What a sum of which one sample is saturated is set to [DN].

    Returns
    -------
    (ceil(H / 2), ceil(W / 2)) or smaller array of uint16
        One colour has every sample of it. A sum has the whole cells only.

    Raises
    ------
    LimitError
        `saturated_as_dn` does not fit 16 bits.

    Notes
    -----
    A sum loses the colours, and range: where light fills one colour's sample, the others' light in this cell is lost
    with it, since the sum is known no more. Its variance is the sum of the samples' variances.
    """
    parts = [counts[row::2, column::2] for row, column in places_of(plane, cell=cell)]
    if len(parts) == 1:
        return parts[0].copy()
    if saturated_as_dn > _MOST_DN:
        raise LimitError(
            f"plane {plane}: sums go up to {saturated_as_dn} DN, and counts to {_MOST_DN}: take one colour"
        )
    height, width = counts.shape[0] // 2, counts.shape[1] // 2
    total = np.zeros((height, width), dtype=np.uint32)
    is_saturated = np.zeros((height, width), dtype=np.bool_)
    for part in (part[:height, :width] for part in parts):
        total += part
        is_saturated |= part >= saturation_dn
    total[is_saturated] = saturated_as_dn
    return total.astype(np.uint16)


def counts_of_picture(
    counts: NDArray[np.uint16], *, pixel_format: PixelFormat, plane: Plane | None
) -> NDArray[np.uint16]:
    """Return the wanted plane of a camera's picture; the picture itself where it has no colours."""
    if pixel_format.cell is None or plane is None:
        return counts
    return take_plane(
        counts,
        cell=pixel_format.cell,
        plane=plane,
        saturation_dn=2**pixel_format.bit_depth - 1,
        saturated_as_dn=2 ** bit_depth_of(plane, bit_depth=pixel_format.bit_depth) - 1,
    )


def size_of_counts(pixel_format: PixelFormat, *, plane: Plane | None, width: int, height: int) -> tuple[int, int, int]:
    """Return width, height and bits of the counts that a camera's pictures of a size are made into.

    Raises
    ------
    LimitError
        A plane is asked for where there are no colours, or none where there are.
    """
    if pixel_format.cell is None and plane is None:
        return width, height, pixel_format.bit_depth
    if pixel_format.cell is None or plane is None:
        wanted = "|".join(PLANES)
        raise LimitError(f"pixel format {pixel_format.name}: plane={wanted} goes with a Bayer format, and only there")
    width, height = plane_size(width=width, height=height, cell=pixel_format.cell, plane=plane)
    return width, height, bit_depth_of(plane, bit_depth=pixel_format.bit_depth)


def plane_size(*, width: int, height: int, cell: str, plane: Plane) -> tuple[int, int]:
    """Return width and height of a plane of a mosaic of this size."""
    if samples_of(plane) > 1:
        return width // 2, height // 2
    ((row, column),) = places_of(plane, cell=cell)
    return (width - column + 1) // 2, (height - row + 1) // 2
