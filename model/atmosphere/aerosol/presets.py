"""Spheres of documented aerosols: their sizes and indices, and how they grow with humidity."""

from functools import lru_cache
from math import log1p

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.aerosol.models import AerosolType
from model.atmosphere.aerosol.particle_modes import MieAerosol, ParticleMode
from model.atmosphere.aerosol.refractive_index import RefractiveIndex, mixed_index
from model.atmosphere.aerosol.size_distribution import log_normal

_WAVELENGTH_M = tuple(nm / 1e9 for nm in (300.0, 337.1, 400.0, 488.0, 514.5, 550.0, 632.8, 694.3, 860.0, 1060.0))
_ROWS = len(_WAVELENGTH_M)
WATER = RefractiveIndex(
    wavelength_m=_WAVELENGTH_M,
    n=(1.349, 1.345, 1.339, 1.335, 1.334, 1.333, 1.332, 1.331, 1.329, 1.326),
    k=(1.6e-8, 8.5e-9, 1.9e-9, 9.4e-10, 1.0e-9, 2.0e-9, 1.4e-8, 3.4e-8, 2.9e-7, 5.0e-6),
)
WATER_SOLUBLE = RefractiveIndex(
    wavelength_m=_WAVELENGTH_M,
    n=(1.53,) * 8 + (1.52, 1.52),
    k=(0.008, 0.005, 0.005, 0.005, 0.005, 0.006, 0.006, 0.007, 0.012, 0.017),
)
DUST_LIKE = RefractiveIndex(wavelength_m=_WAVELENGTH_M, n=(1.53,) * 8 + (1.52, 1.52), k=(0.008,) * _ROWS)
SOOT = RefractiveIndex(
    wavelength_m=_WAVELENGTH_M,
    n=(1.74,) + (1.75,) * 9,
    k=(0.47, 0.47, 0.46, 0.45, 0.45, 0.44, 0.43, 0.43, 0.43, 0.44),
)
MINERAL = RefractiveIndex(
    wavelength_m=tuple(nm / 1e9 for nm in (300.0, 350.0, 400.0, 450.0, 500.0, 550.0, 600.0, 650.0, 700.0, 1060.0)),
    n=(1.53,) * 10,
    k=(0.025, 0.017, 0.013, 0.0085, 0.0078, 0.0055, 0.0045, 0.0045, 0.0040, 0.0040),
)
_RURAL_SUBSTANCE = mixed_index(parts=(WATER_SOLUBLE, DUST_LIKE), volume_shares=(0.7, 0.3))

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
_GIVES_TABLE = f"{_SECOND_HAND}, but they give back its table of optical properties"


# Asked for at every wavelength of a band, whatever it be.
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
    Rural and tropospheric: with these sizes and indices Mie's theory gives back extinction, absorption and asymmetry of
    `model.atmosphere.aerosol.models` within 1 %, and the asymmetry within 5e-4, so that both are one aerosol. Radii
    grow with humidity as tabulated (their logarithm linear in that of 1 - humidity), the index mixes by volume.

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
        mode = _grown(_WATER_SOLUBLE_RADIUS_M, np.log10(2.24), 1.0, WATER_SOLUBLE, relative_humidity)
        return MieAerosol(name=kind.value, modes=(mode,), source=_OPAC, assumed=_SECOND_HAND)
    return _dust() if kind is AerosolType.DUST else _soot()


def _dust() -> MieAerosol:
    """Dust carried far."""
    sizes = log_normal(number_median_radius_m=0.5e-6, log10_sigma=float(np.log10(2.2)), largest_radius_m=5e-6)
    mode = ParticleMode(number_share=1.0, sizes=sizes, index=MINERAL)
    return MieAerosol(
        name=AerosolType.DUST.value,
        modes=(mode,),
        source=f"{_OPAC}: mineral, transported",
        assumed=f"{_SECOND_HAND}; dust is not made of spheres: behind 90 degrees its polarization differs",
    )


def _soot() -> MieAerosol:
    """Soot."""
    sizes = log_normal(number_median_radius_m=0.0118e-6, log10_sigma=float(np.log10(2.0)))
    return MieAerosol(
        name=AerosolType.SOOT.value,
        modes=(ParticleMode(number_share=1.0, sizes=sizes, index=SOOT),),
        source=f"{_OPAC}: soot; index of Shettle & Fenn (1979)",
        assumed=f"{_SECOND_HAND}; soot is not made of spheres but of chains of them",
    )


def _grown(
    radius_m: NDArray[np.float64], log10_sigma: float, number_share: float, substance: RefractiveIndex, humidity: float
) -> ParticleMode:
    """Mode of dry particles that have taken up water."""
    growth = float(np.exp(np.interp(-log1p(-humidity), -np.log1p(-_HUMIDITY), np.log(radius_m / radius_m[0]))))
    share = growth**-3
    index = mixed_index(parts=(substance, WATER), volume_shares=(share, 1.0 - share))
    sizes = log_normal(number_median_radius_m=growth * float(radius_m[0]), log10_sigma=float(log10_sigma))
    return ParticleMode(number_share=number_share, sizes=sizes, index=index)
