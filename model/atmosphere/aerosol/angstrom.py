"""Angstrom's law: the optical depth of an aerosol as a power of the wavelength."""

from math import isfinite, log

import numpy as np
from numpy.typing import ArrayLike, NDArray

REFERENCE_WAVELENGTH_M = 550e-9


def angstrom_ratio(*, exponent: float, wavelength_m: ArrayLike) -> NDArray[np.float64]:
    """Optical depth over that at 550 nm.

    Parameters
    ----------
    exponent
        Angstrom's exponent, -1 to 4; the depth falls like the wavelength to the power -exponent.
    wavelength_m
        [m], above 0.

    Raises
    ------
    ValueError
        An argument outside its range.

    References
    ----------
    Angstrom, Geogr. Ann. 11 (1929) 156.
    """
    wavelength = np.asarray(wavelength_m, dtype=float)
    if not -1.0 <= exponent <= 4.0:
        raise ValueError(f"angstrom_exponent = {exponent!r}, allowed is -1 to 4")
    if not np.all(wavelength > 0.0):
        raise ValueError(f"wavelength_m = {np.min(wavelength)!r} m, but it must be above 0")
    return np.asarray((wavelength / REFERENCE_WAVELENGTH_M) ** -exponent)


def angstrom_law(*, first_m: float, first_depth: float, second_m: float, second_depth: float) -> tuple[float, float]:
    """Angstrom's exponent and the optical depth at 550 nm of an aerosol measured at two wavelengths.

    Parameters
    ----------
    first_m, second_m
        Different wavelengths [m].
    first_depth, second_depth
        Optical depths there, above 0.

    Raises
    ------
    ValueError
        An argument outside its range.

    References
    ----------
    Angstrom, Geogr. Ann. 11 (1929) 156.
    """
    values = (first_m, first_depth, second_m, second_depth)
    if first_m == second_m or not all(isfinite(value) and value > 0.0 for value in values):
        raise ValueError(f"angstrom_law: {values!r} must be finite, above 0 and at two different wavelengths")
    exponent = -log(second_depth / first_depth) / log(second_m / first_m)
    return exponent, first_depth * (REFERENCE_WAVELENGTH_M / first_m) ** -exponent
