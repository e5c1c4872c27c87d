"""Absorption by ozone, which lies above nearly all scattering."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

# fmt: off
_WAVELENGTH_NM = np.array([
    300, 305, 310, 315, 320, 325, 330, 335, 340, 345, 350, 360, 440, 450, 460, 470, 480, 490, 500, 510, 520, 530,
    540, 550, 570, 593, 610, 630, 656, 667.6, 690, 710, 718, 724.4, 740, 752.5, 757.5, 762.5, 767.5, 780,
])
_ABSORPTION_PER_ATM_CM = np.array([
    10.0, 4.8, 2.7, 1.35, 0.8, 0.38, 0.16, 0.075, 0.04, 0.019, 0.007, 0.0, 0.0, 0.003, 0.006, 0.009, 0.014, 0.021,
    0.03, 0.04, 0.048, 0.063, 0.075, 0.085, 0.12, 0.119, 0.12, 0.09, 0.065, 0.051, 0.028, 0.018, 0.015, 0.012, 0.01,
    0.008, 0.007, 0.006, 0.005, 0.0,
])
# fmt: on


def ozone_optical_depth(*, wavelength_m: ArrayLike, ozone_m: float) -> NDArray[np.float64]:
    """Vertical optical depth of ozone.

    Parameters
    ----------
    wavelength_m
        [m], 300e-9 or more; 0 is returned beyond 780 nm.
    ozone_m
        Thickness of the pure gas at standard temperature and pressure [m], 0 or more; 3.44e-3 is the US standard.

    Raises
    ------
    ValueError
        An argument outside its range.

    References
    ----------
    Bird & Riordan, J. Clim. Appl. Meteorol. 25 (1986) 87, table 1 (linear between its wavelengths).
    """
    wavelength_nm = np.asarray(wavelength_m, dtype=float) * 1e9
    if not np.all(wavelength_nm >= _WAVELENGTH_NM[0] * (1.0 - 1e-12)):
        raise ValueError(f"wavelength_m = {np.min(wavelength_nm):.6g}e-9 m, allowed is 300e-9 m or more")
    if not 0.0 <= ozone_m < np.inf:
        raise ValueError(f"ozone_m = {ozone_m!r} m, but it must be finite and 0 or more")
    return np.asarray(np.interp(wavelength_nm, _WAVELENGTH_NM, _ABSORPTION_PER_ATM_CM) * ozone_m * 100.0)
