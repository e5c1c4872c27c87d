"""Extinction and scattering of an aerosol of homogeneous spheres at one wavelength."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.aerosol.matrix_expansion import AngularGrid, angular_grid, expand, extinction_sum, sphere_sums
from model.atmosphere.aerosol.particle_modes import MieAerosol
from model.atmosphere.aerosol.size_rule import size_nodes, size_ranges
from model.atmosphere.transfer.scattering_matrix import ScatteringMatrix

_MOST_HALVINGS = 5
_MEMORY = 64


@dataclass(frozen=True, kw_only=True, eq=False)
class AerosolScattering:
    """Extinction and scattering of an aerosol of spheres at one wavelength.

    Attributes
    ----------
    extinction_m2
        Mean extinction cross-section of a particle [m2].
    ssa
        Single-scattering albedo.
    matrix
        Scattering matrix.
    error_estimate
        Estimated relative error of the extinction and of the scattering.
    """

    extinction_m2: float
    ssa: float
    matrix: ScatteringMatrix
    error_estimate: float


def aerosol_scattering(aerosol: MieAerosol, *, wavelength_m: float, tolerance: float = 1e-3) -> AerosolScattering:
    """Attenuation and scattering matrix of an aerosol of spheres at one wavelength; remembered.

    Parameters
    ----------
    aerosol
        Sizes and indices.
    wavelength_m
        In the air [m], above 0.
    tolerance
        Wanted error of cross-sections and expansion relative to the scattering, above 0. The result says what it
        estimates to have reached; narrow resonances of spheres without absorption fall slowly.

    Raises
    ------
    ValueError
        An argument outside its range, or spheres too large for the wavelength.

    Notes
    -----
    Trapezoidal rule over size, halved until two steps agree. Both tails of the sizes that add less than a quarter of
    the tolerance, and the degrees of the expansion that do, are left out.

    References
    ----------
    Hansen & Travis, Space Sci. Rev. 16 (1974) 527, doi:10.1007/BF00168069, section 2.
    """
    _check(wavelength_m, tolerance)
    return _scattering(aerosol, float(wavelength_m), float(tolerance))


@lru_cache(maxsize=_MEMORY)
def _scattering(aerosol: MieAerosol, wavelength_m: float, tolerance: float) -> AerosolScattering:
    """Return what `aerosol_scattering` does."""
    ranges = size_ranges(aerosol, wavelength_m=wavelength_m, tolerance=tolerance)
    grid = angular_grid(largest_size_parameter=max(float(bounds[-1]) for bounds in ranges if bounds.size))
    total = _sums(aerosol, ranges, wavelength_m, grid, 0, middles=False)
    for halving in range(_MOST_HALVINGS):
        coarse = total
        total = (coarse + _sums(aerosol, ranges, wavelength_m, grid, halving, middles=True)) / 2.0
        change = (total - coarse) / total[1, 0]
        if _size_of(change) <= tolerance:
            break
    return AerosolScattering(
        extinction_m2=float(total[0, 0]) / sum(mode.number_share for mode in aerosol.modes),
        ssa=min(float(total[1, 0] / total[0, 0]), 1.0),  # rounding of spheres that do not absorb
        matrix=_matrix(total[1:] / total[1, 0], change[1:], tolerance),
        error_estimate=_size_of(change) + tolerance / 4.0,
    )


def aerosol_extinction_m2(aerosol: MieAerosol, *, wavelength_m: float, tolerance: float = 1e-3) -> float:
    """Mean extinction cross-section of a particle [m2], without the matrix, which costs most; remembered.

    Parameters
    ----------
    aerosol, wavelength_m, tolerance
        As in `aerosol_scattering`.
    """
    _check(wavelength_m, tolerance)
    return _extinction_m2(aerosol, float(wavelength_m), float(tolerance))


@lru_cache(maxsize=16 * _MEMORY)
def _extinction_m2(aerosol: MieAerosol, wavelength_m: float, tolerance: float) -> float:
    """Return what `aerosol_extinction_m2` does."""
    ranges = size_ranges(aerosol, wavelength_m=wavelength_m, tolerance=tolerance)
    total = _extinction(aerosol, ranges, wavelength_m, 0, middles=False)
    for halving in range(_MOST_HALVINGS):
        coarse = total
        total = (coarse + _extinction(aerosol, ranges, wavelength_m, halving, middles=True)) / 2.0
        if abs(total - coarse) <= tolerance * total:
            break
    return total / sum(mode.number_share for mode in aerosol.modes)


def _check(wavelength_m: float, tolerance: float) -> None:
    """Refuse numbers without meaning."""
    for name, value in (("wavelength_m", wavelength_m), ("tolerance", tolerance)):
        if not 0.0 < value < np.inf:
            raise ValueError(f"aerosol: {name} = {value!r}, but it must be finite and above 0")


def _sums(
    aerosol: MieAerosol,
    ranges: list[NDArray[np.float64]],
    wavelength_m: float,
    grid: AngularGrid,
    halving: int,
    *,
    middles: bool,
) -> NDArray[np.float64]:
    """Integrals over size by one rule: row 0 begins with the extinction, row 1 + l is the expansion's degree l."""
    extinction, matrix = 0.0, np.zeros((4, grid.mu.size))
    for mode, bounds in zip(aerosol.modes, ranges, strict=True):
        if bounds.size:
            size, weight = size_nodes(mode, bounds, wavelength_m=wavelength_m, halving=halving, middles=middles)
            part = sphere_sums(grid, size_parameter=size, weight=weight, index=mode.index.at(wavelength_m))
            extinction, matrix = extinction + part[0], matrix + part[1]
    return np.concatenate([[[extinction, 0.0, 0.0, 0.0]], expand(grid, matrix)])


def _size_of(change: NDArray[np.float64]) -> float:
    """Size of a relative change as `_sums` lays it out: of the extinction, or of the matrix (rms over the sphere)."""
    degree = np.arange(change.shape[0] - 1)[:, np.newaxis]
    elements = np.sqrt(np.sum(change[1:] ** 2 / (2 * degree + 1), axis=0))
    return float(max(abs(change[0, 0]), np.max(elements)))


def _matrix(coefficients: NDArray[np.float64], change: NDArray[np.float64], tolerance: float) -> ScatteringMatrix:
    """Scattering matrix, cut where the rest of its expansion is negligible."""
    length = _length(coefficients, tolerance / 4.0)
    degree = np.arange(len(change))
    missing = float(np.sum(np.abs(coefficients[length:, 0]))) + tolerance / 4.0  # degrees, and tails of the sizes
    return ScatteringMatrix(
        coefficients=coefficients[:length],
        error_estimate=missing + float(np.sqrt(np.sum(change[:, 0] ** 2 / (2 * degree + 1)))),
    )


def _extinction(
    aerosol: MieAerosol, ranges: list[NDArray[np.float64]], wavelength_m: float, halving: int, *, middles: bool
) -> float:
    """Integral of the extinction over size by one rule."""
    total = 0.0
    for mode, bounds in zip(aerosol.modes, ranges, strict=True):
        if bounds.size:
            size, weight = size_nodes(mode, bounds, wavelength_m=wavelength_m, halving=halving, middles=middles)
            total += extinction_sum(size_parameter=size, weight=weight, index=mode.index.at(wavelength_m))
    return total


def _length(coefficients: NDArray[np.float64], tolerance: float) -> int:
    """Degrees to keep so that those left out sum to less than the tolerance, 2 at least."""
    size = np.max(np.abs(coefficients), axis=1)
    beyond = np.cumsum(size[::-1])[::-1]
    return max(int(np.count_nonzero(beyond > tolerance)), 2)
