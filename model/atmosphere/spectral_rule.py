"""Quadrature rule of few wavelengths for a band: Gauss's, for the sun's spectrum itself.

The radiance over the solar spectrum is smooth in the wavelength, the solar spectrum is not; so that is the measure, and
the radiance the function that is integrated.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Of a share of the band, so that a whole one is not rounded up.
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectralRule:
    """Wavelengths at which to compute the ratio of radiance to solar irradiance, and what each stands for.

    Attributes
    ----------
    wavelength_m
        Shape (K,), increasing [m].
    irradiance
        Irradiance that each stands for, above 0 [W m-2]; they sum to that of the band.
    """

    wavelength_m: FloatArray
    irradiance: FloatArray


def spectral_rule(
    *, wavelength_m: FloatArray, irradiance: FloatArray, count: int, kinks_m: Iterable[float] = ()
) -> SpectralRule:
    """Return few wavelengths that stand for a spectrum of many.

    Parameters
    ----------
    wavelength_m
        Samples of the spectrum, shape (N,), increasing [m].
    irradiance
        Irradiance that each sample stands for, shape (N,), 0 or more and somewhere above [W m-2].
    count
        How many wavelengths for the band, 1 or more. For 400 to 700 nm, 2 leave 1e-3 of the sky's radiance and 3 leave
        2e-4.
    kinks_m
        Where the radiance over the spectrum has a kink, as at the entries of a table [m]. Each stretch between them
        has a rule of its own, with its part of the wavelengths, rounded up.

    Raises
    ------
    ValueError
        The count is below 1, or the spectrum is empty.

    Notes
    -----
    K wavelengths integrate polynomials in 1/wavelength up to degree 2K - 1. A stretch with no more samples than
    wavelengths is taken as it is.

    References
    ----------
    Golub & Welsch, Math. Comput. 23 (1969) 221, doi:10.1090/S0025-5718-69-99647-1.
    """
    if count < 1:
        raise ValueError(f"count = {count!r}, allowed is 1 or more")
    lit = irradiance > 0.0
    if not np.any(lit):
        raise ValueError("spectral_rule: a spectrum without light")
    inverse, weight = 1.0 / wavelength_m[lit], irradiance[lit]
    stretch = np.searchsorted(np.sort(-1.0 / np.array([*kinks_m], dtype=float)), -inverse)
    width = abs(float(inverse[-1] - inverse[0])) or 1.0
    parts = []
    for own in (stretch == k for k in np.unique(stretch)):
        share = abs(float(inverse[own][-1] - inverse[own][0])) / width
        parts.append(_gauss(inverse[own], weight[own], max(ceil(count * share - _ROUNDING), 1)))
    return SpectralRule(
        wavelength_m=np.concatenate([1.0 / nodes for nodes, _ in parts]),
        irradiance=np.concatenate([weights for _, weights in parts]),
    )


def _gauss(inverse: FloatArray, weight: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Gauss's nodes for a sum over samples, falling, and their weights: eigenvalues of Lanczos's tridiagonal matrix."""
    if inverse.size <= count:
        return inverse, weight
    vectors = np.sqrt(weight / np.sum(weight))[:, np.newaxis]
    scaled = (inverse - np.mean(inverse)) / np.ptp(inverse)
    jacobi = np.zeros((count, count))
    for k in range(count):
        following = scaled * vectors[:, k]
        jacobi[k, k] = following @ vectors[:, k]
        # Twice, against rounding.
        for _ in range(2):
            following = following - vectors @ (vectors.T @ following)
        if k + 1 < count:
            jacobi[k, k + 1] = jacobi[k + 1, k] = np.linalg.norm(following)
            vectors = np.column_stack([vectors, following / jacobi[k, k + 1]])
    values, eigen = np.linalg.eigh(jacobi)
    nodes = values[::-1] * np.ptp(inverse) + np.mean(inverse)
    return nodes, np.sum(weight) * eigen[0, ::-1] ** 2
