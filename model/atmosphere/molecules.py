"""Air without particles: pressure of the US standard atmosphere 1976 and scattering by molecules."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

SEA_LEVEL_PRESSURE_PA = 101325.0
_EARTH_RADIUS_M = 6356766.0
_HYDROSTATIC_K_PER_M = 0.0341631947  # g0 M / R
_BASE_HEIGHT_M = np.array([0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3])  # geopotential
_LAPSE_K_PER_M = np.array([-6.5e-3, 0.0, 1e-3, 2.8e-3, 0.0, -2.8e-3, -2e-3])
_SEA_LEVEL_TEMPERATURE_K = 288.15
_TOP_M = 84852.0  # geopotential
_SHORTEST_M, _LONGEST_M = 0.25e-6, 1.1e-6


def pressure_ratio(height_m: ArrayLike) -> NDArray[np.float64]:
    """Pressure over that at sea level in the US standard atmosphere 1976.

    Parameters
    ----------
    height_m
        Geometric height [m], 0 or more.

    Returns
    -------
    ndarray
        1 at the sea; 0 above 86 km, where 4e-6 of the air is left.

    References
    ----------
    U.S. Standard Atmosphere 1976, NOAA-S/T 76-1562, eqs. (18), (33a), (33b), table 4.
    """
    height = np.asarray(height_m, dtype=float)
    # Above the top, infinity included, nothing is left; held there the formula stays finite.
    held = np.minimum(height, 2.0 * _TOP_M)
    geopotential = _EARTH_RADIUS_M * held / (_EARTH_RADIUS_M + held)
    ratio = np.ones_like(geopotential)
    temperature = _SEA_LEVEL_TEMPERATURE_K
    for base, top, lapse in zip(_BASE_HEIGHT_M, [*_BASE_HEIGHT_M[1:], _TOP_M], _LAPSE_K_PER_M, strict=True):
        thickness = np.clip(geopotential - base, 0.0, top - base)
        ratio *= _layer_ratio(thickness, temperature, lapse)
        temperature += lapse * (top - base)
    return np.where(geopotential < _TOP_M, ratio, 0.0)


def _layer_ratio(thickness_m: NDArray[np.float64], base_k: float, lapse_k_per_m: float) -> NDArray[np.float64]:
    """Fall of the pressure through part of a layer of constant lapse rate."""
    if lapse_k_per_m == 0.0:
        return np.asarray(np.exp(-_HYDROSTATIC_K_PER_M * thickness_m / base_k))
    exponent = -_HYDROSTATIC_K_PER_M / lapse_k_per_m
    return np.asarray((1.0 + lapse_k_per_m * thickness_m / base_k) ** exponent)


def rayleigh_optical_depth(
    *, wavelength_m: ArrayLike, surface_pressure_pa: float = SEA_LEVEL_PRESSURE_PA
) -> NDArray[np.float64]:
    """Vertical optical depth of molecular scattering.

    Parameters
    ----------
    wavelength_m
        [m], 0.25e-6 to 1.1e-6.
    surface_pressure_pa
        Pressure at the ground [Pa], above 0.

    Raises
    ------
    ValueError
        An argument outside its range.

    References
    ----------
    Bodhaine et al., J. Atmos. Oceanic Technol. 16 (1999) 1854, eq. (30),
    doi:10.1175/1520-0426(1999)016<1854:ORODC>2.0.CO;2 (sea level, 45 degrees, 360 ppm CO2).
    """
    inverse_square = _inverse_square_um(wavelength_m)
    if not 0.0 < surface_pressure_pa < np.inf:
        raise ValueError(f"surface_pressure_pa = {surface_pressure_pa!r} Pa, but it must be finite and above 0")
    above = 1.0455996 - 341.29061 * inverse_square - 0.90230850 / inverse_square
    below = 1.0 + 0.0027059889 * inverse_square - 85.968563 / inverse_square
    return np.asarray(0.0021520 * above / below * surface_pressure_pa / SEA_LEVEL_PRESSURE_PA)


def rayleigh_anisotropy(*, wavelength_m: float) -> float:
    """Anisotropy delta = (1 - rho)/(1 + rho/2) of the scattering by air, rho its depolarization factor.

    Parameters
    ----------
    wavelength_m
        [m], 0.25e-6 to 1.1e-6.

    Raises
    ------
    ValueError
        The wavelength is outside its range.

    References
    ----------
    Bates, Planet. Space Sci. 32 (1984) 785; mixed as in Bodhaine et al. (1999), eqs. (5), (6), (23).
    """
    inverse_square = float(_inverse_square_um(wavelength_m))
    nitrogen = 1.034 + 3.17e-4 * inverse_square
    oxygen = 1.096 + 1.385e-3 * inverse_square + 1.448e-4 * inverse_square**2
    king = (78.084 * nitrogen + 20.946 * oxygen + 0.934 + 0.036 * 1.15) / (78.084 + 20.946 + 0.934 + 0.036)
    depolarization = 6.0 * (king - 1.0) / (3.0 + 7.0 * king)
    return (1.0 - depolarization) / (1.0 + depolarization / 2.0)


def _inverse_square_um(wavelength_m: ArrayLike) -> NDArray[np.float64]:
    """Wavelength to the power -2 [um-2], after a check."""
    wavelength = np.asarray(wavelength_m, dtype=float)
    if not np.all((wavelength >= _SHORTEST_M) & (wavelength <= _LONGEST_M)):
        raise ValueError(
            f"wavelength_m = {np.min(wavelength):.6g} to {np.max(wavelength):.6g} m, "
            f"allowed is {_SHORTEST_M} to {_LONGEST_M} m"
        )
    return (wavelength * 1e6) ** -2.0
