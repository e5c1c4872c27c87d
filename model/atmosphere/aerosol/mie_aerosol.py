"""Extinction and scattering of an aerosol of homogeneous spheres at one wavelength."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import ceil, log, pi

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.aerosol.matrix_expansion import AngularGrid, angular_grid, expand, extinction_sum, sphere_sums
from model.atmosphere.aerosol.particle_modes import MieAerosol, ParticleMode
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


# The variable of the integral over size is ln x + x / _BEND: steps of ln x for small spheres, of x for large ones,
# whose efficiencies ripple with a period in x.
_BEND = 10.0
_FIRST_STEP = 0.08
_LARGEST_SIZE = 2e3
_SCAN_STEP = 0.05  # of ln x, to find the sizes that matter


def size_ranges(aerosol: MieAerosol, *, wavelength_m: float, tolerance: float) -> list[NDArray[np.float64]]:
    """For each mode the size parameters between which its distribution is smooth; empty if it adds nothing.

    Parameters
    ----------
    aerosol
        Its modes.
    wavelength_m
        [m].
    tolerance
        Share of the extinction that both tails of all modes together may leave out, about four times over.

    Raises
    ------
    ValueError
        Spheres matter that are too large for the wavelength.
    """
    grids = [_weighed_sizes(mode, wavelength_m) for mode in aerosol.modes]
    least = tolerance / (8.0 * len(grids)) * sum(float(np.sum(weight)) for _, weight in grids)
    ranges = [
        _range(mode, size, weight, least, wavelength_m)
        for mode, (size, weight) in zip(aerosol.modes, grids, strict=True)
    ]
    largest = max(float(bounds[-1]) for bounds in ranges if bounds.size)
    if largest > _LARGEST_SIZE:
        raise ValueError(
            f"aerosol {aerosol.name!r}: spheres up to {largest * wavelength_m / (2.0 * pi):.3g} m matter at "
            f"{wavelength_m:.4g} m, allowed are {_LARGEST_SIZE * wavelength_m / (2.0 * pi):.3g} m; "
            "give a smaller largest_radius_m or a larger tolerance"
        )
    return ranges


def size_nodes(
    mode: ParticleMode, bounds: NDArray[np.float64], *, wavelength_m: float, halving: int, middles: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Size parameters and weights (number times geometrical cross-section [m2]) of a rule for one mode.

    Parameters
    ----------
    bounds
        One of `size_ranges`, not empty.
    wavelength_m
        [m].
    halving
        How often the first step has been halved.
    middles
        False: the trapezoidal rule. True: the rule of the middles of its steps; the mean of both is the trapezoidal
        rule of the next halving.

    References
    ----------
    Korobov's transformation of a trapezoidal rule: Sidi, Practical Extrapolation Methods (2003), appendix D.
    """
    place, step = _steps(np.log(bounds) + bounds / _BEND, halving, middles=middles, ends_vanish=mode.sizes.ends_vanish)
    size = _size_at(place)
    radius = size * wavelength_m / (2.0 * pi)
    density = mode.number_share * mode.sizes.number_per_log_radius(radius) * pi * radius**2
    weight = density * step / (1.0 + size / _BEND)
    return size[weight > 0.0], weight[weight > 0.0]


def _weighed_sizes(mode: ParticleMode, wavelength_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Size parameters in equal steps of their logarithm, and roughly what each adds to the extinction."""
    first, last = mode.sizes.breaks_m[0], mode.sizes.breaks_m[-1]
    radius = np.geomspace(first, last, ceil(log(last / first) / _SCAN_STEP) + 2)
    size = 2.0 * pi * radius / wavelength_m
    # Small spheres absorb like x and scatter like x^4, large ones take away twice their cross-section.
    efficiency = np.minimum(2.0, 0.25 * size**4 + 2.0 * size * mode.index.at(wavelength_m).imag)
    number = mode.number_share * mode.sizes.number_per_log_radius(radius)
    return size, number * radius**2 * efficiency * log(last / first) / radius.size


def _range(
    mode: ParticleMode, size: NDArray[np.float64], weight: NDArray[np.float64], least: float, wavelength_m: float
) -> NDArray[np.float64]:
    """Range of one mode: its breaks, cut where the tails beyond add less than the least."""
    kept = np.flatnonzero((np.cumsum(weight) > least) & (np.cumsum(weight[::-1])[::-1] > least))
    if kept.size == 0:
        return np.zeros(0)
    low, high = size[max(kept[0] - 1, 0)], size[min(kept[-1] + 1, size.size - 1)]
    breaks = 2.0 * pi * np.array(mode.sizes.breaks_m) / wavelength_m
    inner = breaks[(breaks > low * (1.0 + 1e-9)) & (breaks < high * (1.0 - 1e-9))]
    return np.concatenate([[low], inner, [high]])


def _steps(
    bounds: NDArray[np.float64], halving: int, *, middles: bool, ends_vanish: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Abscissae and weights of a rule on neighbouring intervals."""
    abscissae, weights = [], []
    for low, high in pairwise(bounds):
        count = ceil((high - low) / _FIRST_STEP) * 2**halving
        share = (np.arange(count) + 0.5) / count if middles else np.arange(count + 1.0) / count
        step = np.full(share.size, 1.0 / count)
        if not middles:
            step[[0, -1]] /= 2.0
        if not ends_vanish:
            # The rule then is of eighth order on an interval at whose ends the size distribution breaks off.
            step, share = 140.0 * (share * (1.0 - share)) ** 3 * step, share**4 * np.polyval((-20, 70, -84, 35), share)
        abscissae.append(low + (high - low) * share)
        weights.append((high - low) * step)
    return np.concatenate(abscissae), np.concatenate(weights)


def _size_at(place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Size parameter x of ln x + x / _BEND, by Newton's method in ln x, which is convex."""
    logarithm = np.where(place < 1.0, place, np.log(_BEND * np.maximum(place, 1.0)))
    for _ in range(12):
        bend = np.exp(logarithm) / _BEND
        logarithm = logarithm - (logarithm + bend - place) / (1.0 + bend)
    return np.asarray(np.exp(logarithm))
