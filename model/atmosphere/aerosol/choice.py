"""Choice of the aerosol of an atmosphere: a documented kind, or spheres of one's own."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.aerosol.angstrom import REFERENCE_WAVELENGTH_M, angstrom_ratio
from model.atmosphere.aerosol.mie_aerosol import aerosol_extinction_m2, aerosol_scattering
from model.atmosphere.aerosol.models import (
    TABULATED,
    AerosolOptics,
    AerosolType,
    aerosol_optics,
    relative_extinction,
    table_wavelengths_m,
)
from model.atmosphere.aerosol.particle_modes import MieAerosol
from model.atmosphere.aerosol.presets import preset_aerosol

AerosolChoice = AerosolType | MieAerosol
_SPECTRUM_NODES = 8


def spheres_of(choice: AerosolChoice, *, relative_humidity: float) -> MieAerosol:
    """Spheres of an aerosol; those of one's own are as they are given, at any humidity.

    Parameters
    ----------
    choice
        Spheres of one's own, or the name of a kind.
    relative_humidity
        0 to 0.8; of no meaning for one's own.
    """
    if isinstance(choice, MieAerosol):
        return choice
    return preset_aerosol(AerosolType(choice), relative_humidity=relative_humidity)


def optics_of(
    choice: AerosolChoice, *, wavelength_m: float, relative_humidity: float, angstrom_exponent: float | None
) -> AerosolOptics:
    """Optical properties of an aerosol at one wavelength: from its table where it has one, otherwise by Mie's theory.

    Parameters
    ----------
    choice
        Which aerosol.
    wavelength_m
        [m].
    relative_humidity
        At the ground.
    angstrom_exponent
        Of the extinction in place of its own spectrum; or None.

    Raises
    ------
    ValueError
        An argument outside its range.
    """
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

    Notes
    -----
    Of spheres, beyond eight wavelengths, a polynomial in 1/wavelength through eight that are computed.
    """
    if angstrom_exponent is not None:
        return angstrom_ratio(exponent=angstrom_exponent, wavelength_m=wavelength_m)
    if choice in TABULATED:
        return relative_extinction(
            kind=AerosolType(choice), wavelength_m=wavelength_m, relative_humidity=relative_humidity
        )
    spheres = spheres_of(choice, relative_humidity=relative_humidity)
    wavelengths = np.asarray(wavelength_m, dtype=float)
    if wavelengths.size <= _SPECTRUM_NODES:
        each = [_logarithm(spheres, wavelength) for wavelength in wavelengths.ravel()]
        return np.asarray(np.exp(np.array(each)).reshape(wavelengths.shape))
    nodes_m = chebyshev_wavelengths_m(
        shortest_m=float(np.min(wavelengths)), longest_m=float(np.max(wavelengths)), count=_SPECTRUM_NODES
    )
    at_nodes = np.array([_logarithm(spheres, node) for node in nodes_m])
    basis = lagrange_basis(nodes_m=nodes_m, wavelength_m=wavelengths.ravel())
    return np.asarray(np.exp(at_nodes @ basis).reshape(wavelengths.shape))


def kinks_of(choice: AerosolChoice, *, relative_humidity: float) -> frozenset[float]:
    """Wavelengths at which the properties of an aerosol over wavelength have a kink: the entries of its tables [m].

    Parameters
    ----------
    choice
        Spheres of one's own, or the name of a kind.
    relative_humidity
        0 to 0.8.
    """
    if choice in TABULATED:
        return frozenset(table_wavelengths_m())
    modes = spheres_of(choice, relative_humidity=relative_humidity).modes
    return frozenset(wavelength for mode in modes for wavelength in mode.index.wavelength_m)


def _logarithm(spheres: MieAerosol, wavelength_m: float) -> float:
    """Logarithm of the extinction over that at 550 nm."""
    here, there = (
        aerosol_extinction_m2(spheres, wavelength_m=float(length)) for length in (wavelength_m, REFERENCE_WAVELENGTH_M)
    )
    return float(np.log(here / there))


def chebyshev_wavelengths_m(*, shortest_m: float, longest_m: float, count: int) -> NDArray[np.float64]:
    """Wavelengths at which to compute what is smooth over a band, increasing [m].

    Parameters
    ----------
    shortest_m, longest_m
        Ends of the band [m].
    count
        How many, 1 or more.

    Raises
    ------
    ValueError
        The band or the count is empty.

    References
    ----------
    definition: zeros of the Chebyshev polynomial
    """
    if not 0.0 < shortest_m < longest_m:
        raise ValueError(f"shortest_m = {shortest_m!r} m must be above 0 and below longest_m = {longest_m!r} m")
    if count < 1:
        raise ValueError(f"count = {count!r}, allowed is 1 or more")
    zeros = np.cos(np.pi * (2.0 * np.arange(count, 0, -1) - 1.0) / (2.0 * count))
    return np.asarray((shortest_m + longest_m) / 2.0 + (longest_m - shortest_m) / 2.0 * zeros)


def lagrange_basis(*, nodes_m: NDArray[np.float64], wavelength_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Polynomials in 1/wavelength that are 1 at one node and 0 at the others, shape (nodes, N).

    Parameters
    ----------
    nodes_m
        Distinct wavelengths [m].
    wavelength_m
        Where to read the polynomials [m], shape (N,).
    """
    node, target = 1e-6 / nodes_m, 1e-6 / wavelength_m
    basis = np.ones((node.size, target.size))
    for i in range(node.size):
        for other in np.delete(node, i):
            basis[i] *= (target - other) / (node[i] - other)
    return basis
