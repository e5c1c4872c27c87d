"""Stokes parameters, DoLP and AoLP of every pixel."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from model.processing.maps import Float32Array, polarization_maps
from model.processing.reconstruction import Design

FloatArray = NDArray[np.float64]

_NEIGHBOURHOOD = (7, 7)


@dataclass(frozen=True, kw_only=True, eq=False)
class PolarizationImages:
    """What a run shows, pixel by pixel, in single precision: for pictures; numbers of regions come from its channels.

    Attributes
    ----------
    stokes : (3, H, W) array
        S0, S1, S2, in the unit of the measurement.
    dolp : (H, W) array
        NaN where it has no meaning: no light, saturated or missing.
    aolp_deg : (H, W) array
        Counter-clockwise from horizontal, in [0, 180); NaN where there is no light.
    unusable : (H, W) array of bool
        Saturated or missing in any frame.
    aolp_error_deg : (H, W) array
        How well the angle is known, from how S1 and S2 scatter between neighbours: noise and fine texture.
    residual : (H, W) array or None
        Twice the largest residual of the fit over the mean of the angles: at 0, 45, 90, 135 deg what orthogonal pairs
        differ by. None with three angles; NaN where there is no light.
    """

    stokes: Float32Array
    dolp: Float32Array
    aolp_deg: Float32Array
    unusable: NDArray[np.bool_]
    aolp_error_deg: Float32Array
    residual: FloatArray | None


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
    maps = polarization_maps(channels.astype(np.float32), plan)
    dark = unusable | ~maps.valid
    return PolarizationImages(
        stokes=maps.stokes,
        dolp=np.where(dark, np.float32(np.nan), maps.dolp),
        aolp_deg=np.rad2deg(maps.aolp_rad),
        unusable=unusable,
        aolp_error_deg=_aolp_error_deg(maps.stokes),
        residual=_residual(plan, channels, dark),
    )


def _aolp_error_deg(stokes: Float32Array) -> Float32Array:
    squares = sum(_scatter_squares(component) for component in stokes[1:]) / 2.0
    # Of the neighbours' mean: where there is no polarization, that of single pixels is the noise itself.
    smooth = [cv2.blur(component, _NEIGHBOURHOOD, borderType=cv2.BORDER_REPLICATE) for component in stokes[1:]]
    polarized = np.maximum(np.hypot(*smooth), 1e-12)
    return np.asarray(np.minimum(np.degrees(0.5 * np.sqrt(squares) / polarized), 90.0))


def _scatter_squares(image: Float32Array) -> Float32Array:
    """Return the local variance of a pixel about the line through its neighbours."""
    bent = np.zeros_like(image)
    bent[:, 1:-1] = np.square(image[:, 2:] - 2.0 * image[:, 1:-1] + image[:, :-2]) / 6.0
    # Running sums go below 0 by rounding.
    return np.maximum(cv2.blur(bent, _NEIGHBOURHOOD, borderType=cv2.BORDER_REPLICATE), 0.0)


def _residual(plan: Design, channels: FloatArray, dark: NDArray[np.bool_]) -> FloatArray | None:
    if plan.redundancy == 0:
        return None
    left = np.tensordot(plan.null_basis @ plan.null_basis.T, channels, axes=1)
    largest = np.take_along_axis(left, np.argmax(np.abs(left), axis=0)[None], axis=0)[0]
    # At equal sizes the sign is that of the first angle, so that a picture has one.
    if plan.redundancy == 1:
        largest = left[0] / max(float(np.abs(plan.null_basis[0, 0])), 1e-12) * float(np.abs(plan.null_basis).max())
    mean = channels.mean(axis=0)
    return np.where(dark | (mean <= 0.0), np.nan, 2.0 * largest / np.where(mean > 0.0, mean, 1.0))
