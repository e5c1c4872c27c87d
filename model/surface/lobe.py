"""The specular lobe: Fresnel mirrors with Gaussian slopes that hide one another."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.surface import fresnel
from model.surface.half_vector import HalfVectorGeometry
from model.surface.shadowing import SHADOWING, Shadowing, shadowed_prefactor

FloatArray = NDArray[np.float64]

# The lobe's solid angle is about 4 pi slope_rms^2; below this it is narrower than the sun's disc by far.
SLOPE_RMS_MIN = 1e-3
INDEX_MAX = 1e9


@dataclass(frozen=True, kw_only=True)
class Lobe:
    """Parameters of the specular lobe of a surface.

    Parameters
    ----------
    n, k
        Real and imaginary part of the refractive index; 0 < n <= 1e9, 0 <= k <= 1e9.
    slope_rms
        Standard deviation of the facet slope along one axis, at least 1e-3. (Beckmann's alpha is sqrt(2) times it.)
    shadowing
        One of `SHADOWING`.

    Raises
    ------
    ValueError
        If a value is outside its range.
    """

    n: float
    k: float
    slope_rms: float
    shadowing: Shadowing

    def __post_init__(self) -> None:
        require_index(n=self.n, k=self.k)
        require_slope_rms(self.slope_rms)
        if self.shadowing not in SHADOWING:
            raise ValueError(f"shadowing = {self.shadowing!r}; allowed are {', '.join(map(repr, SHADOWING))}")


def require_index(*, n: float, k: float) -> None:
    """Raise unless n + ik is a refractive index.

    Parameters
    ----------
    n, k
        Real and imaginary part.

    Raises
    ------
    ValueError
        If n is not in (0, 1e9] or k not in [0, 1e9].
    """
    if not 0.0 < n <= INDEX_MAX:
        raise ValueError(f"n = {n}; allowed is 0 < n <= {INDEX_MAX:g} (real part of the refractive index)")
    if not 0.0 <= k <= INDEX_MAX:
        raise ValueError(f"k = {k}; allowed is 0 <= k <= {INDEX_MAX:g} (the index is n + ik, absorption is positive)")


def require_slope_rms(slope_rms: float) -> None:
    """Raise unless the slope is one that a lobe of finite width can have.

    Parameters
    ----------
    slope_rms
        Standard deviation of the facet slope along one axis.

    Raises
    ------
    ValueError
        If below 1e-3 or not finite.
    """
    if not (math.isfinite(slope_rms) and slope_rms >= SLOPE_RMS_MIN):
        raise ValueError(
            f"slope_rms = {slope_rms}; allowed is {SLOPE_RMS_MIN:g} and above (per axis). A smoother surface is "
            "a mirror: its lobe is narrower than the sun's disc, so a reflectance per solid angle says nothing; "
            "use a slope of the sun's half width (about 0.0023) or the mirror's Fresnel reflectance"
        )


def facet_density(tan2_beta: FloatArray, *, slope_rms: float) -> FloatArray:
    """Return the density of facet normals over solid angle, with integral of D cos(beta) equal to 1.

    Parameters
    ----------
    tan2_beta
        Squared facet slope, not negative.
    slope_rms
        Standard deviation of the slope along one axis.

    Returns
    -------
    ndarray
        D [sr^-1]; 0 where the exponential underflows.

    References
    ----------
    Priest and Germer (2000), Proc. Military Sensing Symposia; Beckmann's distribution with alpha = sqrt(2) slope_rms.
    """
    variance = slope_rms * slope_rms
    with np.errstate(under="ignore"):
        weight = np.exp(tan2_beta * (-0.5 / variance))
        return np.asarray(weight * (1.0 + tan2_beta) ** 2 / (2.0 * np.pi * variance))


def write_specular(out: FloatArray, geometry: HalfVectorGeometry, *, lobe: Lobe, weight: float) -> None:
    """Write the Mueller matrices of the lobe into an array.

    Parameters
    ----------
    out
        Shape (N, 3, 3); overwritten [sr^-1].
    geometry
        Arrays of shape (N,).
    weight
        Factor on all elements.

    References
    ----------
    [MK14] section II-A; Priest and Germer (2000). M = R(-eta_r) M_Fresnel R(eta_i) times D G / (4 cos cos).
    """
    g = geometry
    scale = weight * facet_density(g.tan2_beta, slope_rms=lobe.slope_rms)
    scale *= shadowed_prefactor(
        cos_i=g.cos_i,
        sin_i=g.sin_i,
        cos_r=g.cos_r,
        sin_r=g.sin_r,
        mean_cosine=g.mean_cosine,
        cos2_psi=g.cos2_psi,
        slope_rms=lobe.slope_rms,
        shadowing=lobe.shadowing,
    )
    m00, m01, m22 = fresnel.mueller_elements(cos2_psi=g.cos2_psi, n=lobe.n, k=lobe.k)
    _write_rotated(out, g, m00 * scale, m01 * scale, m22 * scale)


def _write_rotated(out: FloatArray, g: HalfVectorGeometry, m00: FloatArray, m01: FloatArray, m22: FloatArray) -> None:
    """Turn the facet's matrix into the horizontal axes of both rays."""
    ci, si, cr, sr = g.cos_2eta_i, g.sin_2eta_i, g.cos_2eta_r, g.sin_2eta_r
    out[:, 0, 0] = m00
    out[:, 0, 1] = m01 * ci
    out[:, 0, 2] = m01 * si
    out[:, 1, 0] = m01 * cr
    out[:, 2, 0] = m01 * sr
    row_1, row_2 = m00 * cr, m22 * sr
    out[:, 1, 1] = row_1 * ci + row_2 * si
    out[:, 1, 2] = row_1 * si - row_2 * ci
    row_1, row_2 = m00 * sr, m22 * cr
    out[:, 2, 1] = row_1 * ci - row_2 * si
    out[:, 2, 2] = row_1 * si + row_2 * ci
