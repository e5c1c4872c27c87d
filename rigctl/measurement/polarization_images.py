"""Stokes parameters, DoLP and AoLP of every pixel."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.processing.reconstruction import Design, reconstruct
from model.stokes import aolp_rad, dolp

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class PolarizationImages:
    """What a run shows, pixel by pixel.

    Attributes
    ----------
    stokes : (3, H, W) array
        S0, S1, S2, in the unit of the measurement.
    dolp : (H, W) array
        NaN where it has no meaning: no light, saturated or missing.
    aolp_deg : (H, W) array
        Counter-clockwise from horizontal, in [0, 180).
    unusable : (H, W) array of bool
        Saturated or missing in any frame.
    """

    stokes: FloatArray
    dolp: FloatArray
    aolp_deg: FloatArray
    unusable: NDArray[np.bool_]


def polarization_images(plan: Design, channels: FloatArray, *, unusable: NDArray[np.bool_]) -> PolarizationImages:
    """Return the images of a run.

    Parameters
    ----------
    plan : Design
        Measured polarizer angles and the inverse in use.
    channels : (N, H, W) array
        Mean of each angle, dark level off.
    unusable : (H, W) array of bool
        Pixels that are saturated or missing.
    """
    stokes = reconstruct(plan, channels)
    dark = unusable | (stokes[0] <= 0.0)
    lit = np.where(dark, 1.0, stokes)
    return PolarizationImages(
        stokes=stokes,
        dolp=np.where(dark, np.nan, dolp(np.moveaxis(lit, 0, -1))),
        aolp_deg=np.rad2deg(aolp_rad(np.moveaxis(stokes, 0, -1))),
        unusable=unusable,
    )
