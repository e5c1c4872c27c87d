"""Pictures of a sensor with polarizers on its pixels: cells of 2 x 2, four angles in one exposure.

A cell's places are counted row by row: 0 1 in its upper row, 2 3 in the lower one.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Interpolation = Literal["none", "bilinear"]
Counts = NDArray[np.uint16]
FloatArray = NDArray[np.float64]

PLACES = 4
# Of the pixels of an interpolated picture a quarter has its own sample, a half the mean of two, a quarter that of four.
_BILINEAR_VARIANCE = (1.0 + 2.0 * 0.5 + 0.25) / 4.0
_ACROSS_DEG, _TURN_DEG = 90.0, 180.0
_NEAR_DEG = 10.0
# Cells that are averaged before pairs are compared, along each side: edges of the scene fall on one place or the other.
_BLOCK = 8
_LEAST_BLOCKS = 4
# Sensitivities behind the angles of real sensors differ by some 2 %, so that right pairs differ by as much.
_SPREAD, _POLARIZED, _CLEARLY = 0.97, 0.05, 3.0


def planes(counts: Counts, *, interpolation: Interpolation, saturation_dn: float) -> tuple[Counts, ...]:
    """Return the picture behind each place of the cell.

    Parameters
    ----------
    counts : (H, W) array of uint16
        The mosaic; its first sample is the first of a cell. A last odd row or column is left out.
    interpolation : {"none", "bilinear"}
        "none" gives the samples themselves, (H // 2, W // 2); "bilinear" gives every pixel of whole cells a count
        behind every angle: its own, or the mean of the two or four nearest. Beyond the rim the rim repeats.
    saturation_dn : float
        A sample at or above this is saturated; what any part of such a sample is in is set to it [DN].

    Returns
    -------
    four (h, w) arrays of uint16
        In the order of the places; means are rounded to the nearest, halves to even.
    """
    height, width = (size - size % 2 for size in counts.shape)
    parts = [counts[row:height:2, column:width:2] for row, column in ((0, 0), (0, 1), (1, 0), (1, 1))]
    if interpolation == "none":
        return tuple(part.copy() for part in parts)
    return tuple(
        _everywhere(part, row=place // 2, column=place % 2, saturation_dn=saturation_dn)
        for place, part in enumerate(parts)
    )


def mosaic(parts: Sequence[Counts]) -> Counts:
    """Return the picture whose samples behind each place of the cell are these, (2 h, 2 w).

    Parameters
    ----------
    parts
        Counts behind each place of the cell, row by row, four of shape (h, w) [DN].
    """
    height, width = parts[0].shape
    picture = np.empty((2 * height, 2 * width), dtype=np.uint16)
    for place, part in enumerate(parts):
        picture[place // 2 :: 2, place % 2 :: 2] = part
    return picture


def variance_factor(interpolation: Interpolation) -> float:
    """Return what an interpolation makes of the variance of noise, in the mean over the pixels.

    Parameters
    ----------
    interpolation
        "none" or "bilinear".

    Notes
    -----
    Rounding adds 1/12 DN^2 to what is interpolated, which is not in it.
    """
    return _BILINEAR_VARIANCE if interpolation == "bilinear" else 1.0


def mean_inflation(interpolation: Interpolation) -> float:
    """Return how many times the variance of a region's mean is that of as many independent pixels of its noise."""
    return 1.0 / (samples_per_pixel(interpolation) * variance_factor(interpolation))


def deviation_inflation(interpolation: Interpolation) -> float:
    """Return the same for the variance of a deviation over the pixels.

    Notes
    -----
    That of independent pixels, times the sum of squared covariances with all others over the squared variance, in the
    mean over the pixels. Along a row the samples have the covariances 1, 1/2 with their neighbours, and the means of
    two 1/2, 1/2, 1/4: 1.5 and 0.875 in squares.
    """
    if interpolation == "none":
        return 1.0
    along_row = (1.5 + 0.875) / 2.0
    return along_row**2 / _BILINEAR_VARIANCE**2


def samples_per_pixel(interpolation: Interpolation) -> float:
    """Return how many samples of its own a pixel behind an angle has: the mean of a region rests on these."""
    return 1.0 / PLACES if interpolation == "bilinear" else 1.0


def reach_px(interpolation: Interpolation) -> int:
    """Return how far from the border of a region a pixel still has some of the light beyond it, whole pixels."""
    return 2 if interpolation == "bilinear" else 0


def _everywhere(part: Counts, *, row: int, column: int, saturation_dn: float) -> Counts:
    quadruple = _doubled(_doubled(part.astype(np.uint32), first=row).T, first=column).T
    mean = np.rint(quadruple * 0.25)
    full = (part >= saturation_dn).astype(np.uint32)
    touched = _doubled(_doubled(full, first=row).T, first=column).T > 0
    mean[touched] = saturation_dn
    return np.ascontiguousarray(mean, dtype=np.uint16)


def _doubled(rows: NDArray[np.uint32], *, first: int) -> NDArray[np.uint32]:
    """Return twice as many rows, twice as bright: those given from row `first` on, and between them their means."""
    out = np.empty((2 * len(rows), rows.shape[1]), dtype=np.uint32)
    out[first::2] = 2 * rows
    neighbour = np.concatenate([rows[1:], rows[-1:]]) if first == 0 else np.concatenate([rows[:1], rows[:-1]])
    out[1 - first :: 2] = rows + neighbour
    return out


def crossed_pairs(cell_deg: tuple[float, ...]) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """Return which two pairs of places stand across one another by the angles of a cell; None where they do not."""
    pairs = [pair for pair in combinations(range(PLACES), 2) if _is_across(cell_deg[pair[0]] - cell_deg[pair[1]])]
    return (pairs[0], pairs[1]) if len(pairs) == 2 and set(pairs[0]).isdisjoint(pairs[1]) else None


def pair_differences(pictures: tuple[FloatArray, ...]) -> dict[tuple[int, int], FloatArray]:
    """Return, for each way to pair the places, by how much the sums of both pairs differ, block by block.

    Light behind an angle and across it adds up to the same whatever the angle: of the three ways to pair four places
    the right one has no difference, whatever the light. Unpolarized light has none in any.
    """
    blocks = [_blocks(picture) for picture in pictures]
    if blocks[0].size < _LEAST_BLOCKS:
        return {}
    total = np.sum(blocks, axis=0)
    lit = total > 0.0
    return {
        (0, other): np.asarray((2.0 * (blocks[0] + blocks[other]) - total)[lit] * 2.0 / total[lit])
        for other in range(1, PLACES)
    }


def pair_by_light(counts: Counts, cell_deg: tuple[float, ...], *, saturation_dn: float) -> tuple[int, int] | None:
    """Return which two places stand across one another by their light, where those of the stated cell do not.

    Parameters
    ----------
    counts
        One picture, shape (H, W) [DN].
    cell_deg
        Axes of the four polarizers of a cell as stated, row by row [deg].
    saturation_dn
        Counts from which a pixel is left out [DN].

    Returns
    -------
    pair of places or None
        None where the light agrees with the cell, tells nothing, or the cell has no two crossed pairs.

    Notes
    -----
    A cell with its pairs in the right places and angles exchanged within or between them cannot be told from light
    whose polarization is not known.
    """
    stated = crossed_pairs(cell_deg)
    if stated is None:
        return None
    parts = planes(counts, interpolation="none", saturation_dn=saturation_dn)
    light = tuple(np.where(part >= saturation_dn, np.nan, part) for part in parts)
    spread = {pair: float(np.quantile(np.abs(d), _SPREAD)) for pair, d in pair_differences(light).items() if d.size}
    mine = next((pair for pair in stated if 0 in pair), (0, 0))
    if mine not in spread or spread[mine] < _POLARIZED:
        return None
    best = min(spread, key=lambda pair: spread[pair])
    return best if spread[best] * _CLEARLY <= spread[mine] else None


def _is_across(difference_deg: float) -> bool:
    return abs((difference_deg - _ACROSS_DEG + _TURN_DEG / 2) % _TURN_DEG - _TURN_DEG / 2) <= _NEAR_DEG


def _blocks(picture: FloatArray) -> FloatArray:
    height, width = (size // _BLOCK for size in picture.shape)
    cut = picture[: height * _BLOCK, : width * _BLOCK]
    return np.asarray(cut.reshape(height, _BLOCK, width, _BLOCK).mean(axis=(1, 3)))


def coarse_pictures(
    pictures: FloatArray, usable: NDArray[np.bool_], *, most_pixels: int
) -> tuple[FloatArray, NDArray[np.bool_], int]:
    """Return pictures of squares of pixels, which of these are usable whole, and their side; as given if small.

    Parameters
    ----------
    pictures
        Shape (K, H, W), any unit.
    usable
        Pixels that may be used, shape (H, W).
    most_pixels
        That a picture may have, 1 or more.
    """
    height, width = usable.shape
    side = int(np.ceil(np.sqrt(height * width / most_pixels)))
    if side <= 1:
        return pictures, usable, 1
    cut = (slice(height - height % side), slice(width - width % side))
    squares = (height // side, side, width // side, side)
    means = pictures[:, *cut].reshape(len(pictures), *squares).mean(axis=(2, 4))
    return np.asarray(means), np.asarray(usable[cut].reshape(squares).all(axis=(1, 3))), side
