"""The scene as it really is in a simulation: one Stokes vector a pixel, drawn once from plain records.

Pictures: the first row is the top, x runs right, y down. Stokes vectors (S0, S1, S2) are radiances in band
[W m^-2 sr^-1] with S1 = horizontal - vertical and S2 = (+45) - (-45), where angles run counter-clockwise from
horizontal in the picture as it is shown.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# A fully polarised vector written in decimals misses DoLP = 1 by some eps.
_ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """Light from a kind of surface, and how it differs from pixel to pixel.

    Parameters
    ----------
    mean_stokes
        Mean of (S0, S1, S2) [W m^-2 sr^-1]; S0 > 0 and DoLP <= 1.
    texture_rms
        Relative rms of a normal factor common to the whole Stokes vector of a pixel, as of albedo; >= 0.
    extra_covariance
        Covariance, shape (3, 3) [(W m^-2 sr^-1)^2], of a normal vector that is added to each pixel,
        independent of the texture; None for no such vector. It may be singular.

    Raises
    ------
    ValueError
        If the mean is not physical, or a spread is not one.
    """

    mean_stokes: tuple[float, float, float]
    texture_rms: float = 0.0
    extra_covariance: FloatArray | None = None

    def __post_init__(self) -> None:
        refuse_unphysical(np.array(self.mean_stokes, dtype=np.float64).reshape(-1), name="mean_stokes")
        if not 0.0 <= self.texture_rms < np.inf:
            raise ValueError(f"texture_rms is {self.texture_rms}; it has to be a number of at least 0")
        if self.extra_covariance is not None:
            refuse_no_covariance(self.extra_covariance)


@dataclass(frozen=True, kw_only=True)
class Rectangle:
    """The pixels with left <= x < left + width and top <= y < top + height."""

    left: int
    top: int
    width: int
    height: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Region:
    """Place of a surface: a rectangle, or a mask of shape (H, W) that is True on it."""

    surface: Surface
    where: Rectangle | NDArray[np.bool_]


def paint_scene(
    *,
    width: int,
    height: int,
    background: Surface,
    regions: Sequence[Region],
    generator: np.random.Generator,
) -> FloatArray:
    """Return the Stokes radiance of every pixel, drawn once.

    Parameters
    ----------
    width, height
        Size of the picture in pixels.
    background
        What is seen where no region is.
    regions
        Painted in this order: a later one covers an earlier one.
    generator
        Where texture comes from. The same state gives the same scene.

    Returns
    -------
    array of float64, shape (3, height, width)
        (S0, S1, S2) [W m^-2 sr^-1], read-only.

    Raises
    ------
    ValueError
        If a region reaches outside of the picture, or a drawn pixel has S0 <= 0 or DoLP > 1: then texture or
        covariance is too wide for the mean. Nothing is cut off, since that would change the moments.
    """
    radiance = np.empty((3, height, width))
    radiance[...] = _drawn(background, count=width * height, generator=generator).reshape(radiance.shape)
    for region in regions:
        inside = _mask(region.where, width=width, height=height)
        radiance[:, inside] = _drawn(region.surface, count=int(inside.sum()), generator=generator)
    refuse_unphysical(radiance, name="a drawn pixel (make texture_rms or extra_covariance smaller)")
    radiance.flags.writeable = False
    return radiance


def refuse_unphysical(stokes: FloatArray, *, name: str) -> None:
    """Raise ValueError unless every Stokes vector (first axis) is finite with S0 > 0 and DoLP <= 1."""
    if stokes.shape[0] != 3:
        raise ValueError(f"{name}: the first axis has length {stokes.shape[0]}; it has to be 3 (S0, S1, S2)")
    s0, s1, s2 = stokes
    physical = (s0 > 0.0) & np.isfinite(s0) & (np.hypot(s1, s2) <= s0 * (1.0 + _ROUNDING))
    if not np.all(physical):
        bad = stokes.reshape(3, -1)[:, int(np.argmin(physical))]
        raise ValueError(
            f"{name}: (S0, S1, S2) = ({bad[0]:g}, {bad[1]:g}, {bad[2]:g}) W m^-2 sr^-1 is no light; "
            "S0 has to be finite and above 0, and the root of S1^2 + S2^2 at most S0"
        )


def refuse_no_covariance(covariance: FloatArray) -> None:
    """Raise ValueError unless a matrix is a covariance of a Stokes vector; it may be singular."""
    if covariance.shape != (3, 3) or not np.array_equal(covariance, covariance.T):
        raise ValueError("extra_covariance has to be symmetric with shape (3, 3)")
    if not np.all(np.isfinite(covariance)):
        raise ValueError("extra_covariance has to be finite")
    smallest = np.linalg.eigvalsh(covariance)[0]
    if smallest < -_ROUNDING * np.trace(covariance):
        raise ValueError(f"extra_covariance has an eigenvalue of {smallest:g}; none may be negative")


def _drawn(surface: Surface, *, count: int, generator: np.random.Generator) -> FloatArray:
    """Return `count` Stokes vectors of a surface, shape (3, count)."""
    stokes = np.repeat(np.array(surface.mean_stokes, dtype=np.float64)[:, np.newaxis], count, axis=1)
    if surface.texture_rms > 0.0:
        stokes *= 1.0 + surface.texture_rms * generator.standard_normal(count)
    if surface.extra_covariance is not None:
        variances, axes = np.linalg.eigh(surface.extra_covariance)
        # A singular covariance has eigenvalues that are zero but for rounding.
        spreads = np.sqrt(np.maximum(variances, 0.0))
        stokes += (axes * spreads) @ generator.standard_normal((3, count))
    return stokes


def _mask(where: Rectangle | NDArray[np.bool_], *, width: int, height: int) -> NDArray[np.bool_]:
    if isinstance(where, Rectangle):
        return _rectangle_mask(where, width=width, height=height)
    if where.shape != (height, width):
        raise ValueError(f"a mask has shape {where.shape}; the picture has {(height, width)}")
    return where


def _rectangle_mask(rectangle: Rectangle, *, width: int, height: int) -> NDArray[np.bool_]:
    right, bottom = rectangle.left + rectangle.width, rectangle.top + rectangle.height
    fits = 0 <= rectangle.left < right <= width and 0 <= rectangle.top < bottom <= height
    if not fits:
        raise ValueError(f"{rectangle} is empty or reaches outside of the picture of {width} x {height} pixels")
    mask = np.zeros((height, width), dtype=np.bool_)
    mask[rectangle.top : bottom, rectangle.left : right] = True
    return mask
