"""Sums over blocks of pictures of what a joint fit of faults needs, tile by tile."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.processing.diagnosis.causes import PER_FRAME, SHARED
from model.processing.diagnosis.correction import FrameFaults
from model.processing.reconstruction import Design

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Side of a block [pixel]: its means hold the edges that show shifts, and little of the noise.
BLOCK_PIXELS = 4
# Pixels at the end of a picture into which resampling may have mixed what is beyond it, and whose slopes reach there.
_EDGE_PIXELS = 3
# Light below this share of the mean has no logarithm worth having.
_DARKEST_SHARE = 0.01
# Of 16 in a block: with fewer it is left out.
_LEAST_PIXELS = 4.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Residuals and what faults would make of them, block by block on a grid.

    Attributes
    ----------
    residual : (N, R, C) array
        What no light gives, as a share of the counts of each frame [DN].
    features : (7 N, R, C) array
        What one unit of each fault adds to the counts of one frame, kind by kind.
    instruments : (7 N, R, C) array
        The same of the blocks around, whose noise is not that of the residual; shifts, which need edges, of the block.
    residual_slopes : (2, N, R, C) array
        Slopes of the residual, across and down: noise, where no picture is shifted.
    light, steepness : (R, C) array
        Mean counts and mean square slope.
    pixels : (R, C) array
        Usable pixels of each block.
    """

    residual: FloatArray
    features: FloatArray
    instruments: FloatArray
    residual_slopes: FloatArray
    light: FloatArray
    steepness: FloatArray
    pixels: FloatArray


def usable_with_neighbours(usable: BoolArray) -> BoolArray:
    """Return the pixels that are usable and whose four neighbours are, away from where the picture ends.

    Notes
    -----
    Resampling mixes nothings from beyond the picture, or from a border that holds none, into its outer pixels: such an
    edge is steep and does not walk with the scene, so that some pixels more are left out there.
    """
    inner = usable[1:-1, 1:-1] & usable[:-2, 1:-1] & usable[2:, 1:-1] & usable[1:-1, :-2] & usable[1:-1, 2:]
    if not inner.size:
        return np.zeros_like(usable)
    return np.asarray(np.pad(inner, 1) & ~_near_the_end(~usable))


def _near_the_end(unusable: BoolArray) -> BoolArray:
    """Return the pixels that are near a side of the picture, or near what is unusable from there on."""
    wide = np.pad(unusable, _EDGE_PIXELS, constant_values=True)
    beyond = np.zeros_like(wide)
    for axis in (0, 1):
        beyond |= np.logical_and.accumulate(wide, axis=axis)
        beyond |= np.flip(np.logical_and.accumulate(np.flip(wide, axis), axis=axis), axis)
    for axis in (0, 1):
        rows = np.moveaxis(beyond, axis, 0).copy()
        near = rows.copy()
        for step in range(1, _EDGE_PIXELS + 1):
            near[step:] |= rows[:-step]
            near[:-step] |= rows[step:]
        beyond = np.moveaxis(near, 0, axis)
    return beyond[_EDGE_PIXELS:-_EDGE_PIXELS, _EDGE_PIXELS:-_EDGE_PIXELS]


def block_samples(
    plan: Design,
    slopes_of_angle: FloatArray,
    pictures: FloatArray,
    usable: BoolArray,
    *,
    faults: FrameFaults,
    light: float,
) -> Samples:
    """Return the block means of residuals and features.

    Parameters
    ----------
    plan
        System matrix of the frames, with any correction of throughput or angle in it.
    slopes_of_angle
        Change of the system matrix's rows with the angle, shape (N, 3) [1/rad].
    pictures
        Counts, dark level taken off, shape (N, H, W).
    usable
        Pixels with their neighbours, shape (H, W).
    faults
        That were taken out of the pictures and put into the design: features are of what is added to them.
    light
        Counts at which a curved response adds its share [DN].
    """
    height, width = (side - side % BLOCK_PIXELS for side in usable.shape)
    good = usable[:height, :width]
    images = np.where(usable, pictures, 0.0)[:, :height, :width]
    pixels = _block_sums(good.astype(np.float64))
    pixels = np.where(pixels < _LEAST_PIXELS, 0.0, pixels)
    per_pixel = np.where(pixels > 0.0, 1.0 / np.maximum(pixels, _LEAST_PIXELS), 0.0)
    onto_light = plan.system @ plan.inverse
    means = _block_sums(images) * per_pixel
    fitted = np.asarray(np.tensordot(onto_light, means, axes=1))
    # Picture by picture: what is made of one stays in the cache until it is summed.
    slopes = np.swapaxes([_slope_sums(picture, good) for picture in pictures], 0, 1) * per_pixel
    walks = [np.tensordot(onto_light, slope, axes=1) for slope in slopes]
    turned = np.tensordot(slopes_of_angle @ plan.inverse, means, axes=1)
    gain = 1.0 + faults.throughput[:, None, None]
    # Of light before the throughputs: bent after them, it would bend the throughputs, and could stand in their place.
    bent = _responses(np.tensordot(onto_light, images, axes=1) / gain, faults, light, per_pixel)
    features = np.concatenate(
        [fitted / gain, turned, np.ones_like(fitted), -walks[0], -walks[1], *(gain * one for one in bent)]
    )
    features = np.asarray(features * (pixels > 0))
    return Samples(
        residual=means - fitted,
        features=features,
        instruments=_instruments(features, pixels),
        residual_slopes=slopes - np.array(walks),
        light=np.asarray(fitted.mean(axis=0)),
        steepness=np.asarray(np.mean(walks[0] ** 2 + walks[1] ** 2, axis=0)),
        pixels=pixels,
    )


def kinds() -> tuple[str, ...]:
    """Return the kinds of features, in their order."""
    return (*PER_FRAME, *SHARED)


def _instruments(features: FloatArray, pixels: FloatArray) -> FloatArray:
    held = (pixels > 0).astype(np.float64)
    around = _sums_around(held[None])[0]
    smooth = _sums_around(features) * (held / np.maximum(around, 1.0))
    frames = len(features) // len(kinds())
    for kind in ("shift x", "shift y"):
        own = slice(kinds().index(kind) * frames, (kinds().index(kind) + 1) * frames)
        smooth[own] = features[own]
    return np.asarray(smooth)


def _sums_around(images: FloatArray) -> FloatArray:
    """Return the sums of the eight neighbours of each block."""
    wide = np.pad(images, ((0, 0), (1, 1), (1, 1)))
    across = wide[:, :, :-2] + wide[:, :, 1:-1] + wide[:, :, 2:]
    return np.asarray(across[:, :-2] + across[:, 1:-1] + across[:, 2:] - images)


def _responses(
    fitted: FloatArray, faults: FrameFaults, light: float, per_pixel: FloatArray
) -> tuple[FloatArray, FloatArray]:
    square, logarithm = np.swapaxes([_response_sums(picture, faults, light) for picture in fitted], 0, 1) * per_pixel
    return square, logarithm / (1.0 + faults.power)


def _response_sums(fitted: FloatArray, faults: FrameFaults, light: float) -> FloatArray:
    """Return the block sums of a picture as a parabola and as a power bend it, shape (2, h, w)."""
    relative = fitted / light
    rising = np.maximum(1.0 + 2.0 * faults.curvature * relative, _DARKEST_SHARE)
    logarithm = np.log(np.maximum(relative, _DARKEST_SHARE))
    return np.array([_block_sums(fitted * relative / rising), _block_sums(fitted * logarithm)])


def _slope_sums(picture: FloatArray, good: BoolArray) -> FloatArray:
    """Return the block sums of a picture's slopes across and down, shape (2, h, w)."""
    height, width = good.shape
    sums = []
    for axis in (1, 0):
        turned = np.moveaxis(picture, axis, 1)
        slope = np.zeros_like(picture)
        np.moveaxis(slope, axis, 1)[:, 1:-1] = 0.5 * (turned[:, 2:] - turned[:, :-2])
        sums.append(_block_sums(np.where(good, slope[:height, :width], 0.0)))
    return np.array(sums)


def _block_sums(pictures: FloatArray) -> FloatArray:
    """Return sums over blocks, weighted 1/4, 1/2, 1/4 first: what mosaics leave from pixel to pixel is gone."""
    return _summed_along(_summed_along(pictures, -1), -2)


def _summed_along(pictures: FloatArray, axis: int) -> FloatArray:
    moved = np.moveaxis(pictures, axis, -1)
    cut = moved.reshape(*moved.shape[:-1], -1, BLOCK_PIXELS)
    first, last = cut[..., 0], cut[..., -1]
    sums = cut.sum(axis=-1) - 0.25 * (first + last)
    # A block's weights reach one pixel into its neighbours; at the border its own pixel stands for the one outside.
    before = np.concatenate([first[..., :1], last[..., :-1]], axis=-1)
    after = np.concatenate([first[..., 1:], last[..., -1:]], axis=-1)
    return np.asarray(np.moveaxis(sums + 0.25 * (before + after), -1, axis))
