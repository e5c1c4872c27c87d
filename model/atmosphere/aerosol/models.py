"""Kinds of aerosol; tabulated optical properties of the rural and the tropospheric one."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

_WAVELENGTH_UM = np.array([0.20, 0.30, 0.3371, 0.55, 0.6943, 1.06])
_RURAL_HUMIDITY = np.array([0.0, 0.70, 0.80])
# For each humidity: extinction, absorption (both relative to the extinction at 0.55 um), asymmetry.
_RURAL = np.array(
    [
        [
            [2.09291, 1.74582, 1.60500, 1.0, 0.75203, 0.41943],
            [0.67196, 0.11937, 0.08506, 0.05930, 0.05152, 0.05816],
            [0.7581, 0.6785, 0.6712, 0.6479, 0.6342, 0.6176],
        ],
        [
            [2.09544, 1.74165, 1.59981, 1.0, 0.75316, 0.42171],
            [0.62968, 0.10816, 0.07671, 0.05380, 0.04684, 0.05335],
            [0.7632, 0.6928, 0.6865, 0.6638, 0.6498, 0.6314],
        ],
        [
            [2.07082, 1.71456, 1.57962, 1.0, 0.76095, 0.43228],
            [0.51899, 0.08278, 0.05816, 0.04082, 0.03570, 0.04158],
            [0.7725, 0.7240, 0.7197, 0.6997, 0.6858, 0.6650],
        ],
    ]
)
_TROPOSPHERIC = np.array(
    [
        [2.21519, 1.82266, 1.66557, 1.0, 0.72525, 0.35481],
        [0.65, 0.08791, 0.05816, 0.03652, 0.02994, 0.03278],
        [0.7571, 0.6858, 0.6790, 0.6510, 0.6315, 0.5887],
    ]
)


class AerosolType(StrEnum):
    """Origin of an aerosol."""

    RURAL = "rural"
    """Continental aerosol of the lowest 2 km."""
    TROPOSPHERIC = "tropospheric"
    """The same without its large particles, of the free troposphere or a very clear day."""
    WATER_SOLUBLE = "water-soluble"
    """Sulfates, nitrates and organic substances."""
    DUST = "dust"
    """Mineral dust carried far from its desert."""
    SOOT = "soot"
    """Carbon of combustion."""


TABULATED = frozenset({AerosolType.RURAL, AerosolType.TROPOSPHERIC})


@dataclass(frozen=True, kw_only=True)
class AerosolOptics:
    """Optical properties of an aerosol at one wavelength.

    Attributes
    ----------
    extinction
        Relative to that at 550 nm.
    ssa
        Single-scattering albedo.
    g
        Asymmetry.
    """

    extinction: float
    ssa: float
    g: float


def aerosol_optics(*, kind: AerosolType, wavelength_m: float, relative_humidity: float) -> AerosolOptics:
    """Optical properties of the rural or the tropospheric aerosol at one wavelength.

    Parameters
    ----------
    kind, relative_humidity
        As in `relative_extinction`.
    wavelength_m
        [m], 0.2e-6 to 1.06e-6.

    Raises
    ------
    ValueError
        An argument outside its range.

    References
    ----------
    Shettle & Fenn, AFGL-TR-79-0214 (1979), as tabulated in LOWTRAN 7 (Kneizys et al., AFGL-TR-88-0177).
    """
    extinction, absorption, asymmetry = (float(_read(row, wavelength_m)) for row in _table(kind, relative_humidity))
    return AerosolOptics(extinction=extinction, ssa=1.0 - absorption / extinction, g=asymmetry)


def relative_extinction(*, kind: AerosolType, wavelength_m: ArrayLike, relative_humidity: float) -> NDArray[np.float64]:
    """Extinction of a standard aerosol over that at 550 nm.

    Parameters
    ----------
    kind
        Rural or tropospheric.
    wavelength_m
        [m], 0.2e-6 to 1.06e-6.
    relative_humidity
        0 to 0.8. The tropospheric aerosol is that of 0.7 in any case.

    Raises
    ------
    ValueError
        An argument outside its range.

    Notes
    -----
    Logarithms are linear in the wavelength, and in the logarithm of 1 - humidity.

    References
    ----------
    Shettle & Fenn, AFGL-TR-79-0214 (1979), as tabulated in LOWTRAN 7 (Kneizys et al., AFGL-TR-88-0177).
    """
    return _read(_table(kind, relative_humidity)[0], wavelength_m)


def table_wavelengths_m() -> tuple[float, ...]:
    """Wavelengths of the tables, at which the properties of an aerosol over wavelength have a kink [m]."""
    return tuple(float(entry) * 1e-6 for entry in _WAVELENGTH_UM)


def _read(row: NDArray[np.float64], wavelength_m: ArrayLike) -> NDArray[np.float64]:
    """Table row at wavelengths."""
    wavelength_um = np.asarray(wavelength_m, dtype=float) * 1e6
    if not np.all((wavelength_um >= _WAVELENGTH_UM[0]) & (wavelength_um <= _WAVELENGTH_UM[-1])):
        raise ValueError(
            f"wavelength_m = {np.min(wavelength_um):.6g}e-6 to {np.max(wavelength_um):.6g}e-6 m, "
            "allowed is 0.2e-6 to 1.06e-6 m for aerosol"
        )
    return np.asarray(np.exp(np.interp(wavelength_um, _WAVELENGTH_UM, np.log(row))))


def _table(kind: AerosolType, relative_humidity: float) -> NDArray[np.float64]:
    """Extinction, absorption and asymmetry over wavelength."""
    if not _RURAL_HUMIDITY[0] <= relative_humidity <= _RURAL_HUMIDITY[-1]:
        raise ValueError(f"relative_humidity = {relative_humidity!r}, allowed is 0 to {_RURAL_HUMIDITY[-1]}")
    if kind not in TABULATED:
        raise ValueError(f"aerosol {kind.value!r} has no table, only spheres (`model.atmosphere.aerosol.presets`)")
    return _TROPOSPHERIC if kind is AerosolType.TROPOSPHERIC else _rural_table(relative_humidity)


def _rural_table(relative_humidity: float) -> NDArray[np.float64]:
    """Extinction, absorption and asymmetry of the rural aerosol at a humidity."""
    dryness, given = -np.log1p(-_RURAL_HUMIDITY), -np.log1p(-relative_humidity)
    lower = min(int(np.searchsorted(dryness, given, side="right")) - 1, dryness.size - 2)
    share = (given - dryness[lower]) / (dryness[lower + 1] - dryness[lower])
    mixed: NDArray[np.float64] = (1.0 - share) * np.log(_RURAL[lower]) + share * np.log(_RURAL[lower + 1])
    return np.exp(mixed)
