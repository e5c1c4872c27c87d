"""Pictures and system matrix with faults of a known size taken out."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.processing.diagnosis.causes import PER_FRAME, SHARED, parameter_count
from model.processing.reconstruction import Design, design_from_system

FloatArray = NDArray[np.float64]

# Shifts below this change nothing that is seen [pixel].
_LEAST_SHIFT_PIXELS = 1e-4
_LARGEST_CURVATURE, _LARGEST_POWER, _LARGEST_SHARE, _LARGEST_SHIFT_PIXELS = 0.9, 0.8, 0.7, 12.0
# A response that is bent further down has turned where the light is twice its mean: none does.
_LEAST_CURVATURE = -0.15


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameFaults:
    """How large each fault of single frames is.

    Attributes
    ----------
    throughput, angle_rad, dark_dn : (N,) array
        Shares of the light, turns [rad] and levels added [DN].
    shift_pixels : (N, 2) array
        x to the right, y down.
    curvature, power : float
        Of the response: counts are f + curvature f^2 / light, and light (f / light)^(1 + power).
    """

    throughput: FloatArray
    angle_rad: FloatArray
    dark_dn: FloatArray
    shift_pixels: FloatArray
    curvature: float
    power: float


def frame_faults(parameters: FloatArray, frames: int) -> FrameFaults:
    """Return parameters as faults of frames, held within what a correction can undo."""
    if parameters.shape != (parameter_count(frames),):
        raise ValueError(f"parameters has shape {parameters.shape}; allowed is ({parameter_count(frames)},)")
    parts = parameters[: len(PER_FRAME) * frames].reshape(len(PER_FRAME), frames)
    return FrameFaults(
        throughput=np.clip(parts[0], -_LARGEST_SHARE, _LARGEST_SHARE),
        angle_rad=np.clip(parts[1], -_LARGEST_SHARE, _LARGEST_SHARE),
        dark_dn=parts[2],
        shift_pixels=np.clip(parts[3:5].T, -_LARGEST_SHIFT_PIXELS, _LARGEST_SHIFT_PIXELS),
        curvature=float(np.clip(parameters[-2], -_LARGEST_CURVATURE, _LARGEST_CURVATURE)),
        power=float(np.clip(parameters[-1], -_LARGEST_POWER, _LARGEST_POWER)),
    )


def can_be_undone(parameters: FloatArray) -> bool:
    """Return whether faults are so small that a correction undoes all of them."""
    frames = (len(parameters) - len(SHARED)) // len(PER_FRAME)
    faults = frame_faults(parameters, frames)
    held = np.concatenate([faults.throughput, faults.angle_rad, faults.shift_pixels.T.ravel(), [faults.power]])
    asked = np.delete(parameters, np.s_[2 * frames : 3 * frames])
    return bool(np.array_equal(held, np.delete(asked, -2)) and _LEAST_CURVATURE <= parameters[-2] <= _LARGEST_CURVATURE)


def corrected_system(system: FloatArray, faults: FrameFaults) -> tuple[Design, FloatArray]:
    """Return the design with throughputs and angles as they are, and how its rows change with the angle.

    Parameters
    ----------
    system
        Rows of the frames as they are said to be, shape (N, 3).
    faults
        Of the frames.

    Notes
    -----
    A turned polarizer turns S1 and S2 of its row.
    """
    cosine, sine = np.cos(2 * faults.angle_rad), np.sin(2 * faults.angle_rad)
    gain = 1.0 + faults.throughput
    rows = np.column_stack(
        [
            gain * system[:, 0],
            gain * (cosine * system[:, 1] - sine * system[:, 2]),
            gain * (sine * system[:, 1] + cosine * system[:, 2]),
        ]
    )
    turned = np.column_stack([np.zeros(len(rows)), -2.0 * rows[:, 2], 2.0 * rows[:, 1]])
    return design_from_system(rows), turned


def corrected_pictures(pictures: FloatArray, faults: FrameFaults, *, light: float) -> FloatArray:
    """Return pictures with dark levels, response and shifts undone, shape as given.

    Parameters
    ----------
    pictures
        Shape (N, H, W) [DN].
    faults
        Of the frames.
    light
        Counts at which a curved response adds its share [DN].
    """
    straight = _straightened(pictures - faults.dark_dn[:, None, None], faults, light)
    for index, (x, y) in enumerate(faults.shift_pixels):
        if max(abs(x), abs(y)) > _LEAST_SHIFT_PIXELS:
            straight[index] = _moved_back(_moved_back(straight[index], x, axis=1), y, axis=0)
    return straight


def _straightened(pictures: FloatArray, faults: FrameFaults, light: float) -> FloatArray:
    straight = pictures
    if faults.power:
        straight = light * np.sign(straight) * np.abs(straight / light) ** (1.0 / (1.0 + faults.power))
    if faults.curvature:
        root = np.maximum(1.0 + 4.0 * faults.curvature * straight / light, 0.01)
        straight = 2.0 * straight / (1.0 + np.sqrt(root))
    return np.array(straight)


def _moved_back(picture: FloatArray, shift_pixels: float, *, axis: int) -> FloatArray:
    """Return a picture moved back along an axis, by cubic convolution; edges are repeated (Keys 1981)."""
    whole = int(np.floor(shift_pixels))
    part = shift_pixels - whole
    taps = (
        0.5 * part * (part * (2.0 - part) - 1.0),
        0.5 * (part**2 * (3.0 * part - 5.0) + 2.0),
        0.5 * part * (part * (4.0 - 3.0 * part) + 1.0),
        0.5 * part**2 * (part - 1.0),
    )
    size = picture.shape[axis]
    pad = [(0, 0), (0, 0)]
    pad[axis] = (abs(whole) + 2, abs(whole) + 2)
    wide = np.pad(picture, pad, mode="edge")
    start = abs(whole) + 2 + whole - 1
    cuts = [[slice(None), slice(None)] for _ in taps]
    for step, cut in enumerate(cuts):
        cut[axis] = slice(start + step, start + step + size)
    return np.asarray(sum(tap * wide[tuple(cut)] for tap, cut in zip(taps, cuts, strict=True)))
