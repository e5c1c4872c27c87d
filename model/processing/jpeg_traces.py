"""Traces of JPEG: coefficients of aligned blocks of 8 x 8 pixels that lie on a lattice."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import dctn

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Compression:
    """How regular the coefficients of aligned blocks are, and those of displaced ones; 1 is a perfect lattice."""

    aligned: float
    displaced: float
    is_found: bool


# Coefficients of low frequency, which hold most of a picture and are coarsest against its noise.
_COEFFICIENTS = ((0, 1), (1, 0), (1, 1), (0, 2), (2, 0), (1, 2), (2, 1))
_PERIODS = 80
_LEAST_BLOCKS = 64

# Difference of the regularity of aligned and of displaced blocks, above which nothing but coding explains it.
_LEAST_EXCESS = 0.25
_SIGMAS = 6.0


def jpeg_traces(picture: ArrayLike) -> Compression | None:
    """Return whether a picture went through JPEG; None where it is too small or too even to tell.

    Parameters
    ----------
    picture
        Shape (H, W), from its true first row and column: blocks are counted from there.

    Notes
    -----
    Coding rounds each coefficient to multiples of its own step. The mean of exp(2 pi i c / step) is then near 1 for
    aligned blocks and not for blocks displaced by four pixels, whose coefficients no coding rounded.
    """
    counts = np.asarray(picture, dtype=np.float64)
    aligned = _coefficients(counts)
    displaced = _coefficients(counts[4:, 4:])
    if min(len(aligned), len(displaced)) < _LEAST_BLOCKS:
        return None
    excess = [_regularity(aligned[:, k], displaced[:, k]) for k in range(len(_COEFFICIENTS))]
    known = [one for one in excess if one is not None]
    if len(known) < 3:
        return None
    own, other = (float(np.median([pair[side] for pair in known])) for side in (0, 1))
    chance = _SIGMAS / np.sqrt(len(aligned))
    return Compression(aligned=own, displaced=other, is_found=bool(own - other > max(_LEAST_EXCESS, chance)))


_BLOCK = 8


def _coefficients(counts: FloatArray) -> FloatArray:
    """Return coefficients of every block, shape (blocks, coefficients)."""
    rows, columns = counts.shape[0] // _BLOCK, counts.shape[1] // _BLOCK
    cut = counts[: rows * _BLOCK, : columns * _BLOCK].reshape(rows, _BLOCK, columns, _BLOCK).transpose(0, 2, 1, 3)
    spectrum = dctn(cut.reshape(-1, _BLOCK, _BLOCK), axes=(1, 2), norm="ortho")
    return np.asarray(spectrum[:, [row for row, _ in _COEFFICIENTS], [column for _, column in _COEFFICIENTS]])


def _regularity(aligned: FloatArray, displaced: FloatArray) -> tuple[float, float] | None:
    """Return the regularity of both at the period that tells them apart most; None where nothing varies."""
    # Half of a picture's coefficients near nothing are no lattice: the outer half decides.
    size = float(np.median(np.abs(displaced)))
    if not size > 0.0:
        return None
    outer = [one[np.abs(one) > size] for one in (aligned, displaced)]
    if min(len(one) for one in outer) < _LEAST_BLOCKS // 4:
        return None
    periods = np.geomspace(0.15 * size, 4.0 * size, _PERIODS)
    waves = [np.abs(np.mean(np.exp(2j * np.pi * one[:, None] / periods), axis=0)) for one in outer]
    best = int(np.argmax(waves[0] - waves[1]))
    return float(waves[0][best]), float(waves[1][best])
