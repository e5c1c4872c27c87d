"""How far rounding to whole steps moves levels, where the noise is smaller than a step."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

# Waves of the periodic error that are summed: the last is below 1e-16 where noise is a third of a step, and a share of
# 1/40 of the first without any.
_WAVES = np.arange(1, 41)
# Noise from which on rounding moves a mean by less than a fortieth of a step.
_HARMLESS_STEPS = 0.35


def rounding_error_rms(std: ArrayLike) -> FloatArray:
    """Return how far rounding moves a mean, root mean square over where the mean lies between two steps.

    Parameters
    ----------
    std
        Of the noise before rounding, in steps, >= 0: 12^(-1/2) steps without any, nothing above half a step.

    References
    ----------
    Widrow and Kollar, Quantization Noise (2008), chapter 4: the error is a sum of waves that noise damps.
    """
    waves = np.exp(-2.0 * (np.pi * _WAVES * np.asarray(std, dtype=np.float64)[..., None]) ** 2) / (np.pi * _WAVES)
    return np.asarray(np.sqrt(0.5 * np.sum(waves**2, axis=-1)))


def frame_noise_steps(pictures: FloatArray, usable: NDArray[np.bool_], *, step: float) -> FloatArray:
    """Return the noise of one pixel of each frame before rounding, in steps, from where the picture is smoothest.

    Parameters
    ----------
    pictures
        Shape (N, H, W).
    usable
        Shape (H, W).
    step
        Of the rounding, in the unit of the pictures.
    """
    whole = usable[:, 2:] & usable[:, 1:-1] & usable[:, :-2]
    bends = pictures[:, :, 2:] - 2.0 * pictures[:, :, 1:-1] + pictures[:, :, :-2]
    found = np.zeros(len(pictures))
    for index, bend in enumerate(bends):
        squares = _row_pieces(np.where(whole, bend**2, np.nan)) / (6.0 * step**2)
        kept = squares[np.isfinite(squares)]
        found[index] = np.sqrt(max(float(np.quantile(kept, 0.2)) - 1.0 / 12.0, 0.0)) if kept.size else 0.0
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundedParts:
    """Parts of a set of pictures whose rounding is the same.

    Attributes
    ----------
    numbers : (H, W) array
        Which part each pixel is of, from 0; -1 where it is not usable.
    errors : (N,) array
        By how much rounding moves a part of each frame (standard deviation), unit of the pictures.
    """

    numbers: NDArray[np.intp]
    errors: FloatArray


def rounded_parts(
    pictures: FloatArray, usable: NDArray[np.bool_], *, null_basis: FloatArray, step: float
) -> RoundedParts | None:
    """Return the pixels that have the same counts in every frame, whose rounding is the same where there is no noise.

    Parameters
    ----------
    pictures
        Shape (N, H, W).
    usable
        Shape (H, W).
    null_basis
        Of the design, shape (N, N - 3): what is left of the pictures along it has noise and no texture.
    step
        Of the rounding, in the unit of the pictures; 0 where none is known.

    Returns
    -------
    RoundedParts or None
        None where the noise of all frames makes rounding harmless.
    """
    if not step > 0.0 or not usable.any():
        return None
    onto = null_basis @ null_basis.T
    kept = np.sqrt(np.diag(onto))
    left = np.tensordot(onto[kept > 0.0] / kept[kept > 0.0, None], pictures, axes=1)
    noise = frame_noise_steps(pictures, usable, step=step)
    noise = np.minimum(noise, np.sqrt(np.mean(frame_noise_steps(left, usable, step=step) ** 2)))
    if noise.min() >= _HARMLESS_STEPS:
        return None
    counts = np.rint(pictures[:, usable] / step).astype(np.int64)
    # Numbers of the sets of counts, made frame by frame so that they stay small.
    together = np.zeros(counts.shape[1], dtype=np.int64)
    for one in counts:
        spread = int(np.ptp(one)) + 1
        together = np.unique(together * spread + (one - one.min()), return_inverse=True)[1]
    numbers = np.full(usable.shape, -1, dtype=np.intp)
    numbers[usable] = together
    return RoundedParts(numbers=numbers, errors=np.asarray(step * rounding_error_rms(noise)))


def rounding_offsets(pictures: FloatArray, usable: NDArray[np.bool_], *, step: float) -> FloatArray:
    """Return by how much rounding may have moved the level of each frame (standard deviation), unit of the pictures.

    Notes
    -----
    Where the light of a picture covers many steps the errors of its parts cancel.
    """
    if not usable.any() or not step > 0.0:
        return np.zeros(len(pictures))
    error = step * rounding_error_rms(frame_noise_steps(pictures, usable, step=step))
    spread = np.array([np.subtract(*np.quantile(picture[usable], [0.95, 0.05])) for picture in pictures]) / step
    return np.asarray(error / np.sqrt(1.0 + np.maximum(spread, 0.0)))


def _row_pieces(squares: FloatArray) -> FloatArray:
    """Return the means of pieces of 32 pixels of a row."""
    width = squares.shape[1] - squares.shape[1] % 32
    return np.asarray(squares[:, :width].reshape(-1, 32).mean(axis=1))
