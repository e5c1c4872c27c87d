"""How far a fault moves the polarization of a region, and the light of a region as it is without it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.diagnosis.causes import PER_FRAME
from model.processing.diagnosis.correction import can_be_undone, corrected_pictures, corrected_system, frame_faults
from model.stokes import aolp_rad, dolp

FloatArray = NDArray[np.float64]

# Below this degree an angle of polarization has no meaning, and none of its changes.
_LEAST_DOLP = 1e-6


@dataclass(frozen=True, kw_only=True)
class Consequence:
    """What a fault does to the polarization of a region.

    Attributes
    ----------
    dolp_shift, aolp_shift_rad
        With the fault less without it; None where there is no light or no angle, or where the fault is too large to be
        undone.
    """

    dolp_shift: float | None
    aolp_shift_rad: float | None


def consequence(
    system: ArrayLike, means: ArrayLike, parameters: FloatArray, *, light: float, slopes: ArrayLike | None = None
) -> Consequence:
    """Return what faults of a known size do to the polarization of a region.

    Parameters
    ----------
    system
        Rows of the frames as they are said to be, shape (N, 3).
    means
        Mean counts of the region behind each angle, dark level taken off, shape (N,) [DN].
    parameters
        Of single frames and the response, shape (P,).
    light
        Counts at which a curved response adds its share [DN].
    slopes
        Mean slopes of the region behind each angle, x and y, shape (N, 2) [DN/pixel]; shifts change no even region, and
        are left out without.
    """
    rows, counts = np.asarray(system, dtype=np.float64), np.asarray(means, dtype=np.float64)
    with_fault = np.linalg.pinv(rows) @ counts
    still = (
        counts
        if slopes is None
        else counts + np.sum(_shifts(parameters, len(counts)) * np.asarray(slopes, dtype=np.float64), axis=1)
    )
    without = stokes_without(rows, still, parameters, light=light)
    is_known = can_be_undone(parameters) and with_fault[0] > 0.0 and without[0] > 0.0
    if not is_known:
        return Consequence(dolp_shift=None, aolp_shift_rad=None)
    degrees = float(dolp(with_fault)), float(dolp(without))
    turned = float(aolp_rad(with_fault) - aolp_rad(without))
    return Consequence(
        dolp_shift=degrees[0] - degrees[1],
        aolp_shift_rad=(turned + np.pi / 2) % np.pi - np.pi / 2 if min(degrees) > _LEAST_DOLP else None,
    )


def stokes_without(system: FloatArray, means: FloatArray, parameters: FloatArray, *, light: float) -> FloatArray:
    """Return the Stokes parameters of mean counts with faults taken out, shape (3,); shifts are left."""
    faults = frame_faults(parameters, len(means))
    design, _ = corrected_system(system, faults)
    flat = np.repeat(means[:, None, None], 4, axis=2)
    return np.asarray(design.inverse @ corrected_pictures(flat, faults, light=light)[:, 0, 0])


def _shifts(parameters: FloatArray, frames: int) -> FloatArray:
    first = PER_FRAME.index("shift x") * frames
    return parameters[first : first + 2 * frames].reshape(2, frames).T
