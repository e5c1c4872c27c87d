"""Cell of a camera with polarizers on its pixels: held against the light that it sees."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model.processing.mosaic import pair_by_light

_PLACES = ("upper left", "upper right", "lower left", "lower right")


def cell_problem(counts: NDArray[np.uint16], mosaic_deg: Sequence[float], *, bit_depth: int) -> str | None:
    """Return in words that the light contradicts a cell, or None: it agrees, or tells nothing.

    Parameters
    ----------
    counts : (H, W) array of uint16
        A picture as the camera sent it.
    mosaic_deg : sequence of four floats
        Angles of the cell, row by row [deg].
    bit_depth : int
        Bits of a count.
    """
    found = pair_by_light(counts, tuple(mosaic_deg), saturation_dn=float(2**bit_depth - 1))
    if found is None:
        return None
    stated = ", ".join(f"{angle:g}" for angle in mosaic_deg)
    one, other = (_PLACES[place] for place in found)
    return (
        f"mosaic_deg = [{stated}] does not fit the light: by its sums the {one} and the {other} pixel of a cell stand "
        "across one another, and the two that are left. Look up the cell of the sensor, and whether the picture is "
        "mirrored or begins at an odd row or column"
    )
