"""Documented kinds of aerosol: optical properties by wavelength, equivalent spheres, profile over height.

The rural and the tropospheric aerosol are tables. The others, and user-defined ones, are spheres with documented sizes
and indices that change with humidity. Angstrom's law may replace the spectrum of a kind.
"""

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache
from math import isfinite, log, log1p

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.chebyshev import chebpts1
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.mie import (
    MieAerosol,
    ParticleMode,
    RefractiveIndex,
    aerosol_extinction_m2,
    aerosol_scattering,
    log_normal,
    mixed_index,
)

BOUNDARY_LAYER_TOP_M = 2000.0

_REFERENCE_WAVELENGTH_M = 550e-9


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
    return exponent, first_depth * (_REFERENCE_WAVELENGTH_M / first_m) ** -exponent


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


AerosolChoice = AerosolType | MieAerosol
_SPECTRUM_NODES = 8


@dataclass(frozen=True, kw_only=True)
class AerosolOptics:
    """Optical properties of an aerosol at one wavelength."""

    extinction: float
    ssa: float
    g: float


TABULATED = frozenset({AerosolType.RURAL, AerosolType.TROPOSPHERIC})


def optics_of(
    choice: AerosolChoice, *, wavelength_m: float, relative_humidity: float, angstrom_exponent: float | None
) -> AerosolOptics:
    """Optical properties of an aerosol at one wavelength: from its table if it has one, otherwise by Mie's theory."""
    extinction = float(
        extinction_of(
            choice,
            wavelength_m=wavelength_m,
            relative_humidity=relative_humidity,
            angstrom_exponent=angstrom_exponent,
        )
    )
    if choice in TABULATED:
        own = aerosol_optics(kind=AerosolType(choice), wavelength_m=wavelength_m, relative_humidity=relative_humidity)
        return AerosolOptics(extinction=extinction, ssa=own.ssa, g=own.g)
    spheres = spheres_of(choice, relative_humidity=relative_humidity)
    scattering = aerosol_scattering(spheres, wavelength_m=wavelength_m)
    return AerosolOptics(extinction=extinction, ssa=scattering.ssa, g=scattering.matrix.g)


def extinction_of(
    choice: AerosolChoice, *, wavelength_m: ArrayLike, relative_humidity: float, angstrom_exponent: float | None
) -> NDArray[np.float64]:
    """Extinction of an aerosol over that at 550 nm; arguments as in `optics_of`, but for many wavelengths.

    For spheres at more than eight wavelengths, a polynomial in 1/wavelength through eight computed ones.
    """
    if angstrom_exponent is not None:
        return angstrom_ratio(exponent=angstrom_exponent, wavelength_m=wavelength_m)
    if choice in TABULATED:
        return _read(_table(AerosolType(choice), relative_humidity)[0], wavelength_m)
    spheres = spheres_of(choice, relative_humidity=relative_humidity)
    wavelengths = np.asarray(wavelength_m, dtype=float)
    if wavelengths.size <= _SPECTRUM_NODES:
        each = [_logarithm(spheres, wavelength) for wavelength in wavelengths.ravel()]
        return np.asarray(np.exp(np.array(each)).reshape(wavelengths.shape))
    shortest_m, longest_m = float(np.min(wavelengths)), float(np.max(wavelengths))
    nodes_m = 0.5 * (shortest_m + longest_m) + 0.5 * (longest_m - shortest_m) * chebpts1(_SPECTRUM_NODES)
    logarithms = [_logarithm(spheres, node) for node in nodes_m]
    through_nodes = Polynomial.fit(1.0 / nodes_m, logarithms, _SPECTRUM_NODES - 1)
    return np.asarray(np.exp(through_nodes(1.0 / wavelengths)))


def angstrom_ratio(*, exponent: float, wavelength_m: ArrayLike) -> NDArray[np.float64]:
    """Optical depth over that at 550 nm.

    Angstrom, Geogr. Ann. 11 (1929) 156.
    """
    wavelength = np.asarray(wavelength_m, dtype=float)
    if not -1.0 <= exponent <= 4.0:
        raise ValueError(f"angstrom_exponent = {exponent!r}, allowed is -1 to 4")
    if not np.all(wavelength > 0.0):
        raise ValueError(f"wavelength_m = {np.min(wavelength)!r} m, but it must be above 0")
    return np.asarray((wavelength / _REFERENCE_WAVELENGTH_M) ** -exponent)


def kinks_of(choice: AerosolChoice, *, relative_humidity: float) -> frozenset[float]:
    """Wavelengths of kinks in the properties of an aerosol: the entries of its tables [m]."""
    if choice in TABULATED:
        return frozenset((_WAVELENGTH_UM * 1e-6).tolist())
    modes = spheres_of(choice, relative_humidity=relative_humidity).modes
    return frozenset(wavelength for mode in modes for wavelength in mode.index.wavelength_m)


def spheres_of(choice: AerosolChoice, *, relative_humidity: float) -> MieAerosol:
    """Spheres of an aerosol; user-defined ones do not depend on humidity."""
    if isinstance(choice, MieAerosol):
        return choice
    return preset_aerosol(AerosolType(choice), relative_humidity=relative_humidity)


@dataclass(frozen=True, kw_only=True)
class AerosolColumn:
    """Extinction of the aerosol at 550 nm, exponential between the heights of a table."""

    height_m: NDArray[np.float64]
    extinction_per_m: NDArray[np.float64]
    scale: float

    def optical_depth_between(self, lower_m: ArrayLike, upper_m: ArrayLike) -> NDArray[np.float64]:
        """Optical depth at 550 nm between two heights, lower_m <= upper_m [m]."""
        return self._below(np.asarray(upper_m, dtype=float)) - self._below(np.asarray(lower_m, dtype=float))

    def _below(self, height_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Optical depth between the ground and a height."""
        part = np.clip(height_m[..., np.newaxis] - self.height_m[:-1], 0.0, np.diff(self.height_m))
        rate = np.diff(np.log(self.extinction_per_m)) / np.diff(self.height_m)
        # The mean of an exponential over the part crossed; rate may be 0 where extinction does not change.
        growth = rate * part
        safe = np.where(growth == 0.0, 1.0, growth)
        mean = np.where(growth == 0.0, 1.0, np.expm1(growth) / safe)
        return np.asarray(self.scale * np.sum(self.extinction_per_m[:-1] * part * mean, axis=-1))


# At 0, 1, 2, 3 and 4 km for each visibility [km-1].
_LOWER_PER_KM = np.array(
    [
        [0.0662, 0.0415, 0.0260, 0.0146, 0.0102],
        [0.158, 0.0991, 0.0621, 0.0346, 0.0185],
        [0.379, 0.379, 0.0621, 0.0346, 0.0185],
        [0.770, 0.770, 0.0621, 0.0346, 0.0185],
        [1.94, 1.94, 0.0621, 0.0346, 0.0185],
    ]
)
_REFERENCE_VISIBILITY_M = 23e3

# fmt: off
_HEIGHT_M = 1e3 * np.array([
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 30, 35, 40,
])
# From 5 km up: spring and summer below 10 km, background stratosphere above [km-1].
_UPPER_PER_KM = np.array([
    9.31e-3, 7.71e-3, 6.23e-3, 3.37e-3, 1.82e-3, 1.14e-3, 7.99e-4, 6.41e-4, 5.17e-4, 4.42e-4, 3.95e-4, 3.82e-4,
    4.25e-4, 5.2e-4, 5.81e-4, 5.89e-4, 5.02e-4, 4.2e-4, 3e-4, 1.98e-4, 1.31e-4, 3.32e-5, 1.64e-5, 7.99e-6,
])
_VISIBILITY_KM = np.array([50.0, 23.0, 10.0, 5.0, 2.0])
# fmt: on


def aerosol_column(*, visibility_m: float | None = None, optical_depth: float | None = None) -> AerosolColumn:
    """Aerosol over height for a visibility at the ground, or for an optical depth at 550 nm.

    Up to 4 km extinction is linear in 1/visibility between the tabulated 2, 5, 10, 23 and 50 km. Codes differ by 30 %
    in the optical depth for a visibility: 0.324 here for 23 km, 0.226 by the rule of 6S.

    Shettle & Fenn, AFGL-TR-79-0214 (1979), as tabulated in LOWTRAN 7 (Kneizys et al., AFGL-TR-88-0177).
    """
    if (visibility_m is None) == (optical_depth is None):
        raise ValueError("aerosol_column: give either visibility_m or optical_depth")
    if visibility_m is not None:
        return _column_of_visibility(visibility_m)
    if optical_depth is None or not 0.0 <= optical_depth < np.inf:
        raise ValueError(f"aerosol_column: optical_depth = {optical_depth!r}, but it must be finite and 0 or more")
    reference = _column_of_visibility(_REFERENCE_VISIBILITY_M)
    return replace(reference, scale=optical_depth / float(reference.optical_depth_between(0.0, _HEIGHT_M[-1])))


def _column_of_visibility(visibility_m: float) -> AerosolColumn:
    """Column of a meteorological range."""
    visibility_km = visibility_m / 1e3
    if not _VISIBILITY_KM[-1] <= visibility_km <= _VISIBILITY_KM[0]:
        raise ValueError(f"aerosol_column: visibility_m = {visibility_m!r} m, allowed is 2e3 to 50e3 m")
    lower = [np.interp(1.0 / visibility_km, 1.0 / _VISIBILITY_KM, column) for column in _LOWER_PER_KM.T]
    per_km = np.concatenate([lower, _UPPER_PER_KM])
    return AerosolColumn(height_m=_HEIGHT_M, extinction_per_m=per_km / 1e3, scale=1.0)


_WAVELENGTH_UM = np.array([0.20, 0.30, 0.3371, 0.55, 0.6943, 1.06])
_RURAL_HUMIDITY = np.array([0.0, 0.70, 0.80])


def _read(row: NDArray[np.float64], wavelength_m: ArrayLike) -> NDArray[np.float64]:
    """Table row at wavelengths."""
    wavelength_um = np.asarray(wavelength_m, dtype=float) * 1e6
    if not np.all((wavelength_um >= _WAVELENGTH_UM[0]) & (wavelength_um <= _WAVELENGTH_UM[-1])):
        raise ValueError(
            f"wavelength_m = {np.min(wavelength_um):.6g}e-6 to {np.max(wavelength_um):.6g}e-6 m, "
            "allowed is 0.2e-6 to 1.06e-6 m for aerosol"
        )
    return np.asarray(np.exp(np.interp(wavelength_um, _WAVELENGTH_UM, np.log(row))))


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


def _table(kind: AerosolType, relative_humidity: float) -> NDArray[np.float64]:
    """Extinction, absorption and asymmetry over wavelength; logarithms are linear in that of 1 - humidity."""
    if not _RURAL_HUMIDITY[0] <= relative_humidity <= _RURAL_HUMIDITY[-1]:
        raise ValueError(f"relative_humidity = {relative_humidity!r}, allowed is 0 to {_RURAL_HUMIDITY[-1]}")
    if kind not in TABULATED:
        raise ValueError(f"aerosol {kind.value!r} has no table, only spheres")
    if kind is AerosolType.TROPOSPHERIC:
        return _TROPOSPHERIC
    dryness, given = -np.log1p(-_RURAL_HUMIDITY), -np.log1p(-relative_humidity)
    lower = min(int(np.searchsorted(dryness, given, side="right")) - 1, dryness.size - 2)
    share = (given - dryness[lower]) / (dryness[lower + 1] - dryness[lower])
    mixed: NDArray[np.float64] = (1.0 - share) * np.log(_RURAL[lower]) + share * np.log(_RURAL[lower + 1])
    return np.exp(mixed)


_HUMIDITY = np.array([0.0, 0.5, 0.7, 0.8])
# Median radii [m] of the number, dry and at these humidities.
_FINE_RADIUS_M = 1e-6 * np.array([0.02700, 0.02748, 0.02846, 0.03274])
_COARSE_RADIUS_M = 1e-6 * np.array([0.4300, 0.4377, 0.4571, 0.5477])
_WATER_SOLUBLE_RADIUS_M = 1e-6 * np.array([0.0212, 0.0262, 0.0285, 0.0306])
_FINE_LOG10_SIGMA, _COARSE_LOG10_SIGMA = 0.35, 0.40
_FINE_SHARE = 0.999875
_SHETTLE_FENN = "Shettle & Fenn, AFGL-TR-79-0214 (1979): sizes of tables 1 and 2, substance of table 4"
_OPAC = (
    "Hess, Koepke & Schult, Bull. Am. Meteorol. Soc. 79 (1998) 831, doi:10.1175/1520-0477(1998)079<0831:OPOAAC>2.0.CO;2"
)
_SECOND_HAND = "numbers not checked against the original report"
_GIVES_TABLE = f"{_SECOND_HAND}, but they reproduce its table of optical properties"

_WAVELENGTH_M = tuple(nm / 1e9 for nm in (300.0, 337.1, 400.0, 488.0, 514.5, 550.0, 632.8, 694.3, 860.0, 1060.0))
_ROWS = len(_WAVELENGTH_M)
_WATER = RefractiveIndex(
    wavelength_m=_WAVELENGTH_M,
    n=(1.349, 1.345, 1.339, 1.335, 1.334, 1.333, 1.332, 1.331, 1.329, 1.326),
    k=(1.6e-8, 8.5e-9, 1.9e-9, 9.4e-10, 1.0e-9, 2.0e-9, 1.4e-8, 3.4e-8, 2.9e-7, 5.0e-6),
)
_WATER_SOLUBLE = RefractiveIndex(
    wavelength_m=_WAVELENGTH_M,
    n=(1.53,) * 8 + (1.52, 1.52),
    k=(0.008, 0.005, 0.005, 0.005, 0.005, 0.006, 0.006, 0.007, 0.012, 0.017),
)
_DUST_LIKE = RefractiveIndex(wavelength_m=_WAVELENGTH_M, n=(1.53,) * 8 + (1.52, 1.52), k=(0.008,) * _ROWS)
_SOOT = RefractiveIndex(
    wavelength_m=_WAVELENGTH_M,
    n=(1.74,) + (1.75,) * 9,
    k=(0.47, 0.47, 0.46, 0.45, 0.45, 0.44, 0.43, 0.43, 0.43, 0.44),
)
_MINERAL = RefractiveIndex(
    wavelength_m=tuple(nm / 1e9 for nm in (300.0, 350.0, 400.0, 450.0, 500.0, 550.0, 600.0, 650.0, 700.0, 1060.0)),
    n=(1.53,) * 10,
    k=(0.025, 0.017, 0.013, 0.0085, 0.0078, 0.0055, 0.0045, 0.0045, 0.0040, 0.0040),
)
_RURAL_SUBSTANCE = mixed_index(parts=(_WATER_SOLUBLE, _DUST_LIKE), volume_shares=(0.7, 0.3))


# Needed at every wavelength of a band.
@lru_cache(maxsize=32)
def preset_aerosol(kind: AerosolType, *, relative_humidity: float) -> MieAerosol:
    """Spheres of a documented aerosol.

    Parameters
    ----------
    kind
        Which aerosol.
    relative_humidity
        0 to 0.8. Dust and soot take up no water.

    Raises
    ------
    ValueError
        The humidity is outside its range.

    Notes
    -----
    Rural and tropospheric: these sizes and indices reproduce the tabulated extinction and absorption within 1 %, and
    the asymmetry within 5e-4. Radii grow with humidity as tabulated (their logarithm linear in that of 1 - humidity),
    the index mixes by volume.

    References
    ----------
    Shettle & Fenn, AFGL-TR-79-0214 (1979); Hess, Koepke & Schult, Bull. Am. Meteorol. Soc. 79 (1998) 831.
    """
    if not _HUMIDITY[0] <= relative_humidity <= _HUMIDITY[-1]:
        raise ValueError(f"relative_humidity = {relative_humidity!r}, allowed is 0 to {_HUMIDITY[-1]}")
    fine = _grown(_FINE_RADIUS_M, _FINE_LOG10_SIGMA, _FINE_SHARE, _RURAL_SUBSTANCE, relative_humidity)
    if kind is AerosolType.RURAL:
        coarse = _grown(_COARSE_RADIUS_M, _COARSE_LOG10_SIGMA, 1.0 - _FINE_SHARE, _RURAL_SUBSTANCE, relative_humidity)
        return MieAerosol(name=kind.value, modes=(fine, coarse), source=_SHETTLE_FENN, assumed=_GIVES_TABLE)
    if kind is AerosolType.TROPOSPHERIC:
        return MieAerosol(name=kind.value, modes=(fine,), source=_SHETTLE_FENN, assumed=_GIVES_TABLE)
    if kind is AerosolType.WATER_SOLUBLE:
        mode = _grown(_WATER_SOLUBLE_RADIUS_M, np.log10(2.24), 1.0, _WATER_SOLUBLE, relative_humidity)
        return MieAerosol(name=kind.value, modes=(mode,), source=_OPAC, assumed=_SECOND_HAND)
    if kind is AerosolType.DUST:
        sizes = log_normal(number_median_radius_m=0.5e-6, log10_sigma=float(np.log10(2.2)), largest_radius_m=5e-6)
        index, source = _MINERAL, f"{_OPAC}: mineral, transported"
        assumed = f"{_SECOND_HAND}; dust is not made of spheres: behind 90 degrees its polarization differs"
    else:
        sizes = log_normal(number_median_radius_m=0.0118e-6, log10_sigma=float(np.log10(2.0)))
        index, source = _SOOT, f"{_OPAC}: soot; index of Shettle & Fenn (1979)"
        assumed = f"{_SECOND_HAND}; soot is not made of spheres but of chains of them"
    mode = ParticleMode(number_share=1.0, sizes=sizes, index=index)
    return MieAerosol(name=kind.value, modes=(mode,), source=source, assumed=assumed)


def _grown(
    radius_m: NDArray[np.float64], log10_sigma: float, number_share: float, substance: RefractiveIndex, humidity: float
) -> ParticleMode:
    """Mode of dry particles that have taken up water."""
    growth = float(np.exp(np.interp(-log1p(-humidity), -np.log1p(-_HUMIDITY), np.log(radius_m / radius_m[0]))))
    share = growth**-3
    index = mixed_index(parts=(substance, _WATER), volume_shares=(share, 1.0 - share))
    sizes = log_normal(number_median_radius_m=growth * float(radius_m[0]), log10_sigma=float(log10_sigma))
    return ParticleMode(number_share=number_share, sizes=sizes, index=index)


def _logarithm(spheres: MieAerosol, wavelength_m: float) -> float:
    """Logarithm of the extinction over that at 550 nm."""
    here, there = (
        aerosol_extinction_m2(spheres, wavelength_m=float(length)) for length in (wavelength_m, _REFERENCE_WAVELENGTH_M)
    )
    return float(np.log(here / there))


def aerosol_optics(*, kind: AerosolType, wavelength_m: float, relative_humidity: float) -> AerosolOptics:
    """Optical properties of the rural or the tropospheric aerosol at one wavelength.

    Shettle & Fenn, AFGL-TR-79-0214 (1979), as tabulated in LOWTRAN 7 (Kneizys et al., AFGL-TR-88-0177).
    """
    extinction, absorption, asymmetry = (float(_read(row, wavelength_m)) for row in _table(kind, relative_humidity))
    return AerosolOptics(extinction=extinction, ssa=1.0 - absorption / extinction, g=asymmetry)
