"""Mie scattering by one sphere and by aerosols of many spheres.

An aerosol is made of modes: a refractive index over wavelength and a size distribution each. Sums over spheres are
taken at quadrature angles and expanded in generalised spherical functions (`aerosol_scattering`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import pairwise
from math import ceil, exp, inf, isfinite, log, pi, sqrt
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.layers import ScatteringMatrix, matrix_functions


@dataclass(frozen=True, kw_only=True)
class RefractiveIndex:
    """Index n + ik (k >= 0 absorbs) as a table over wavelength; a single row is valid at all wavelengths.

    Attributes
    ----------
    n, k
        Real part, above 0, and absorbing part, 0 or more; linear between rows.
    wavelength_m
        Increasing wavelengths of the rows [m]; empty for a single row.
    """

    n: tuple[float, ...]
    k: tuple[float, ...]
    wavelength_m: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        rows = len(self.wavelength_m) or 1
        if len(self.n) != rows or len(self.k) != rows:
            raise ValueError(f"RefractiveIndex: {rows} rows, but {len(self.n)} values of n and {len(self.k)} of k")
        if not all(0.0 < value < np.inf for value in self.n):
            raise ValueError(f"RefractiveIndex: n = {self.n!r}, but all must be finite and above 0")
        if not all(0.0 <= value < np.inf for value in self.k):
            raise ValueError(f"RefractiveIndex: k = {self.k!r}, but all must be finite and 0 or more (n + ik absorbs)")
        if not np.all(np.diff([0.0, *self.wavelength_m]) > 0.0):
            raise ValueError("RefractiveIndex: wavelength_m must be above 0 and increase")

    def at(self, wavelength_m: float) -> complex:
        """Index n + ik at a wavelength [m].

        Raises
        ------
        ValueError
            The wavelength is outside the table.
        """
        if not self.wavelength_m:
            return complex(self.n[0], self.k[0])
        first, last = self.wavelength_m[0], self.wavelength_m[-1]
        if not first <= wavelength_m <= last:
            raise ValueError(
                f"wavelength_m = {wavelength_m!r} m, but the refractive index is given for {first} to {last} m"
            )
        n, k = (float(np.interp(wavelength_m, self.wavelength_m, values)) for values in (self.n, self.k))
        return complex(n, k)


def mixed_index(*, parts: tuple[RefractiveIndex, ...], volume_shares: tuple[float, ...]) -> RefractiveIndex:
    """Index of substances mixed within each particle: the mean of n and of k by volume.

    Haenel, Adv. Geophys. 19 (1976) 73, doi:10.1016/S0065-2687(08)60142-9.
    """
    wavelengths = {part.wavelength_m for part in parts}
    if len(wavelengths) != 1 or len(parts) != len(volume_shares):
        raise ValueError("mixed_index: all parts must be given at the same wavelengths, each with a share")
    if min(volume_shares) < 0.0 or abs(sum(volume_shares) - 1.0) > 1e-9:
        raise ValueError(f"mixed_index: volume_shares = {volume_shares!r} must be 0 or more and sum to 1")
    n, k = (
        tuple(float(value) for value in np.array(volume_shares) @ np.array([getattr(part, name) for part in parts]))
        for name in ("n", "k")
    )
    return RefractiveIndex(n=n, k=k, wavelength_m=parts[0].wavelength_m)


_REACH = 8.0  # standard deviations beyond which 1e-15 of a log-normal distribution lies


@dataclass(frozen=True, kw_only=True)
class LogNormal:
    """Log-normal number of particles over radius; `log_normal` makes one from other parameters.

    Attributes
    ----------
    median_radius_m
        Radius that half of the particles exceed [m], above 0.
    ln_sigma
        Standard deviation of the natural logarithm of the radius, above 0 to 2.
    largest_radius_m
        Radius [m] above which there are none.
    """

    median_radius_m: float
    ln_sigma: float
    largest_radius_m: float = inf

    def __post_init__(self) -> None:
        if not (0.0 < self.median_radius_m < inf):
            raise ValueError(f"LogNormal: median_radius_m = {self.median_radius_m!r} m must be finite and above 0")
        if not 0.0 < self.ln_sigma <= 2.0:
            raise ValueError(
                f"LogNormal: ln_sigma = {self.ln_sigma!r}, allowed is above 0 to 2; "
                "it is the natural logarithm of the geometric standard deviation"
            )
        if not self.largest_radius_m > self.breaks_m[0]:
            raise ValueError(f"LogNormal: largest_radius_m = {self.largest_radius_m!r} m leaves no particles")

    @property
    def breaks_m(self) -> tuple[float, ...]:
        """Ends [m] for number and area; the median of the area is exp(2 sigma^2) larger than that of the number."""
        lowest = self.median_radius_m * exp(-_REACH * self.ln_sigma)
        highest = self.median_radius_m * exp(2.0 * self.ln_sigma**2 + _REACH * self.ln_sigma)
        return lowest, min(highest, self.largest_radius_m)

    @property
    def ends_vanish(self) -> bool:
        """True if there is no largest radius."""
        return self.largest_radius_m == inf

    def number_per_log_radius(self, radius_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Particles per unit of ln(radius); 0 above the largest radius, otherwise not renormalized."""
        deviation = (np.log(radius_m) - log(self.median_radius_m)) / self.ln_sigma
        density = np.exp(-0.5 * deviation**2) / (sqrt(2.0 * pi) * self.ln_sigma)
        return np.where(radius_m <= self.largest_radius_m, density, 0.0)


def log_normal(
    *,
    number_median_radius_m: float | None = None,
    volume_median_radius_m: float | None = None,
    ln_sigma: float | None = None,
    log10_sigma: float | None = None,
    largest_radius_m: float = inf,
) -> LogNormal:
    """Log-normal distribution from either median and either logarithm.

    Parameters
    ----------
    number_median_radius_m, volume_median_radius_m
        Exactly one: radius [m] that half of the number, or of the volume, lies above.
    ln_sigma, log10_sigma
        Exactly one: standard deviation of the natural or of the decimal logarithm of the radius.
    largest_radius_m
        Radius [m] above which there are no particles.

    Raises
    ------
    ValueError
        Not exactly one of a pair is given, or it is outside its range.

    References
    ----------
    definition: the volume's median is exp(3 sigma^2) times that of the number.
    """
    if (number_median_radius_m is None) == (volume_median_radius_m is None):
        raise ValueError("log_normal: give either number_median_radius_m or volume_median_radius_m")
    if (ln_sigma is None) == (log10_sigma is None):
        raise ValueError("log_normal: give either ln_sigma or log10_sigma")
    sigma = ln_sigma if ln_sigma is not None else log(10.0) * (log10_sigma or 0.0)
    median = number_median_radius_m
    if median is None:
        median = (volume_median_radius_m or 0.0) * exp(-3.0 * sigma**2)
    return LogNormal(median_radius_m=median, ln_sigma=sigma, largest_radius_m=largest_radius_m)


@dataclass(frozen=True, kw_only=True)
class TabulatedSizes:
    """Number of particles over radius as a table; linear in ln(radius) between its rows, none outside.

    Attributes
    ----------
    radius_m
        Increasing radii [m], two or more, above 0.
    number_per_log_radius_at
        Particles per unit of ln(radius) at these, 0 or more, on any scale.
    """

    radius_m: tuple[float, ...]
    number_per_log_radius_at: tuple[float, ...]

    def __post_init__(self) -> None:
        radius, number = np.array(self.radius_m), np.array(self.number_per_log_radius_at)
        if radius.size < 2 or radius.shape != number.shape:
            raise ValueError(f"TabulatedSizes: {radius.size} radii and {number.size} numbers; give two or more of each")
        if not (radius[0] > 0.0 and np.all(np.diff(radius) > 0.0) and isfinite(radius[-1])):
            raise ValueError("TabulatedSizes: radius_m must be finite, above 0 and increase")
        if not (np.all(number >= 0.0) and np.all(np.isfinite(number)) and np.any(number > 0.0)):
            raise ValueError("TabulatedSizes: number_per_log_radius_at must be finite, 0 or more, and not all 0")

    @property
    def breaks_m(self) -> tuple[float, ...]:
        """Radii [m] of the rows."""
        return self.radius_m

    @property
    def ends_vanish(self) -> bool:
        """False: a table has corners."""
        return False

    def number_per_log_radius(self, radius_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Particles per unit of ln(radius), for one particle in total."""
        log_radius, number = np.log(self.radius_m), np.array(self.number_per_log_radius_at)
        total = np.sum(np.diff(log_radius) * (number[1:] + number[:-1])) / 2.0
        return np.asarray(np.interp(np.log(radius_m), log_radius, number / total, left=0.0, right=0.0))


def number_of_volume(*, volume: float, volume_median_radius_m: float, ln_sigma: float) -> float:
    """Return the number of particles of a log-normal distribution per unit of their total volume.

    Parameters
    ----------
    volume
        Volume of all particles, above 0, in any unit.
    volume_median_radius_m
        Radius [m] that half of the volume lies above, above 0.
    ln_sigma
        Standard deviation of the natural logarithm of the radius, above 0 to 2.

    Raises
    ------
    ValueError
        An argument outside its range.

    References
    ----------
    definition: the mean cube of the radius is that of the volume's median times exp(-9 sigma^2 / 2).
    """
    if not all(isfinite(value) and value > 0.0 for value in (volume, volume_median_radius_m)):
        raise ValueError(f"volume = {volume!r} and volume_median_radius_m = {volume_median_radius_m!r} must be above 0")
    if not 0.0 < ln_sigma <= 2.0:
        raise ValueError(f"ln_sigma = {ln_sigma!r}, allowed is above 0 to 2")
    mean_cube = volume_median_radius_m**3 * exp(-4.5 * ln_sigma**2)
    return volume / (4.0 / 3.0 * pi * mean_cube)


class SizeDistribution(Protocol):
    """Number of particles over the logarithm of their radius."""

    @property
    def breaks_m(self) -> tuple[float, ...]:
        """Increasing radii [m]: the ends, and points between where the number is not smooth."""
        ...

    @property
    def ends_vanish(self) -> bool:
        """True if the number falls smoothly to zero at both ends, and is smooth between."""
        ...

    def number_per_log_radius(self, radius_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Particles per unit of ln(radius), for one particle in total."""
        ...


@dataclass(frozen=True, kw_only=True)
class ParticleMode:
    """Particles of one substance and one size distribution.

    Attributes
    ----------
    number_share
        Their share of all particles, above 0.
    sizes
        Size distribution.
    index
        Refractive index.
    """

    number_share: float
    sizes: SizeDistribution
    index: RefractiveIndex

    def __post_init__(self) -> None:
        if not 0.0 < self.number_share < np.inf:
            raise ValueError(f"ParticleMode: number_share = {self.number_share!r} must be finite and above 0")


@dataclass(frozen=True, kw_only=True)
class MieAerosol:
    """Aerosol of homogeneous spheres.

    Attributes
    ----------
    name
        Its name in reports.
    modes
        One or more; their shares count relative to each other.
    source
        Origin of its numbers.
    assumed
        Properties that are assumed rather than documented, in words; empty if there are none.
    """

    name: str
    modes: tuple[ParticleMode, ...]
    source: str
    assumed: str = ""

    def __post_init__(self) -> None:
        if not self.modes:
            raise ValueError(f"MieAerosol {self.name!r}: give one mode or more")


@dataclass(frozen=True, kw_only=True, eq=False)
class AerosolScattering:
    """Extinction and scattering of an aerosol of spheres at one wavelength."""

    extinction_m2: float
    ssa: float
    matrix: ScatteringMatrix
    error_estimate: float


_MOST_HALVINGS = 5
_MEMORY = 64


def aerosol_scattering(aerosol: MieAerosol, *, wavelength_m: float, tolerance: float = 1e-3) -> AerosolScattering:
    """Attenuation and scattering matrix of an aerosol of spheres at one wavelength; cached.

    Parameters
    ----------
    aerosol
        Sizes and indices.
    wavelength_m
        In the air [m], above 0.
    tolerance
        Error of cross-sections and expansion relative to the scattering, above 0. The result has the estimated error;
        narrow resonances of non-absorbing spheres converge slowly.

    Raises
    ------
    ValueError
        An argument outside its range, or spheres too large for the wavelength.

    Notes
    -----
    Trapezoidal rule over size, halved until two steps agree. Tails of the sizes and degrees of the expansion that add
    less than a quarter of the tolerance are left out.

    References
    ----------
    Hansen & Travis, Space Sci. Rev. 16 (1974) 527, doi:10.1007/BF00168069, section 2.
    """
    return _scattering(aerosol, wavelength_m, tolerance)


@lru_cache(maxsize=_MEMORY)
def _scattering(aerosol: MieAerosol, wavelength_m: float, tolerance: float) -> AerosolScattering:
    """Return the result of `aerosol_scattering`, cached under a key that includes the default tolerance."""
    _require_positive(wavelength_m=wavelength_m, tolerance=tolerance)
    ranges = _size_ranges(aerosol, wavelength_m=wavelength_m, tolerance=tolerance)
    grid = angular_grid(largest_size_parameter=max(float(bounds[-1]) for bounds in ranges if bounds.size))

    def rule(halving: int, middles: bool) -> NDArray[np.float64]:
        return _sums(aerosol, ranges, wavelength_m, grid, halving, middles=middles)

    total, change = _halved(rule, lambda total, change: _size_of(change / total[1, 0]) <= tolerance)
    change = change / total[1, 0]
    return AerosolScattering(
        extinction_m2=float(total[0, 0]) / sum(mode.number_share for mode in aerosol.modes),
        ssa=min(float(total[1, 0] / total[0, 0]), 1.0),  # rounding of non-absorbing spheres
        matrix=_matrix(total[1:] / total[1, 0], change[1:], tolerance),
        error_estimate=_size_of(change) + tolerance / 4.0,
    )


@lru_cache(maxsize=16 * _MEMORY)
def aerosol_extinction_m2(aerosol: MieAerosol, *, wavelength_m: float, tolerance: float = 1e-3) -> float:
    """Mean extinction cross-section of a particle [m2], without the costly matrix; cached."""
    _require_positive(wavelength_m=wavelength_m, tolerance=tolerance)
    ranges = _size_ranges(aerosol, wavelength_m=wavelength_m, tolerance=tolerance)

    def rule(halving: int, middles: bool) -> NDArray[np.float64]:
        return np.asarray(_extinction(aerosol, ranges, wavelength_m, halving, middles=middles))

    total, _ = _halved(rule, lambda total, change: bool(np.abs(change) <= tolerance * total))
    return float(total) / sum(mode.number_share for mode in aerosol.modes)


def _halved(
    rule: Callable[[int, bool], NDArray[np.float64]],
    is_enough: Callable[[NDArray[np.float64], NDArray[np.float64]], bool],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Trapezoidal rule, halved until the last change is small enough: the integral and that change."""
    total = rule(0, False)
    for halving in range(_MOST_HALVINGS):
        coarse = total
        total = (coarse + rule(halving, True)) / 2.0
        if is_enough(total, total - coarse):
            break
    return total, total - coarse


def _require_positive(**numbers: float) -> None:
    for name, value in numbers.items():
        if not 0.0 < value < np.inf:
            raise ValueError(f"aerosol: {name} = {value!r}, but it must be finite and above 0")


# The variable of the integral over size is ln x + x / _BEND: steps of ln x for small spheres, of x for large ones,
# whose efficiencies ripple with a period in x.
_BEND = 10.0
_FIRST_STEP = 0.08
_LARGEST_SIZE_MIE_AEROSOL = 2e3
_SCAN_STEP = 0.05  # of ln x, to find the relevant sizes


def _size_ranges(aerosol: MieAerosol, *, wavelength_m: float, tolerance: float) -> list[NDArray[np.float64]]:
    """For each mode the size parameters between which its distribution is smooth; empty if it is negligible."""
    grids = [_weighed_sizes(mode, wavelength_m) for mode in aerosol.modes]
    least = tolerance / (8.0 * len(grids)) * sum(float(np.sum(weight)) for _, weight in grids)
    ranges = [
        _range(mode, size, weight, least, wavelength_m)
        for mode, (size, weight) in zip(aerosol.modes, grids, strict=True)
    ]
    largest = max(float(bounds[-1]) for bounds in ranges if bounds.size)
    if largest > _LARGEST_SIZE_MIE_AEROSOL:
        raise ValueError(
            f"aerosol {aerosol.name!r}: spheres up to {largest * wavelength_m / (2.0 * pi):.3g} m contribute at "
            f"{wavelength_m:.4g} m, allowed are {_LARGEST_SIZE_MIE_AEROSOL * wavelength_m / (2.0 * pi):.3g} m; give a "
            "smaller largest_radius_m or a larger tolerance"
        )
    return ranges


def _weighed_sizes(mode: ParticleMode, wavelength_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Size parameters in equal steps of their logarithm, and their approximate extinction."""
    first, last = mode.sizes.breaks_m[0], mode.sizes.breaks_m[-1]
    radius = np.geomspace(first, last, ceil(log(last / first) / _SCAN_STEP) + 2)
    size = 2.0 * pi * radius / wavelength_m
    # Small spheres absorb like x and scatter like x^4; the extinction of large ones is twice their cross-section.
    efficiency = np.minimum(2.0, 0.25 * size**4 + 2.0 * size * mode.index.at(wavelength_m).imag)
    number = mode.number_share * mode.sizes.number_per_log_radius(radius)
    return size, number * radius**2 * efficiency * log(last / first) / radius.size


def _range(
    mode: ParticleMode, size: NDArray[np.float64], weight: NDArray[np.float64], least: float, wavelength_m: float
) -> NDArray[np.float64]:
    """Range of one mode: its breaks, without negligible tails."""
    kept = np.flatnonzero((np.cumsum(weight) > least) & (np.cumsum(weight[::-1])[::-1] > least))
    if kept.size == 0:
        return np.zeros(0)
    low, high = size[max(kept[0] - 1, 0)], size[min(kept[-1] + 1, size.size - 1)]
    breaks = 2.0 * pi * np.array(mode.sizes.breaks_m) / wavelength_m
    inner = breaks[(breaks > low * (1.0 + 1e-9)) & (breaks < high * (1.0 - 1e-9))]
    return np.concatenate([[low], inner, [high]])


@dataclass(frozen=True, kw_only=True)
class AngularGrid:
    """Scattering angles for groups of spheres of similar size, enough for exact integrals."""

    terms: tuple[int, ...]
    starts: tuple[int, ...]
    mu: NDArray[np.float64]
    weight: NDArray[np.float64]


# Terms of the largest sphere of each group: spheres of one group share their angles.
_GROUP_TERMS = (16, 24, 36, 54, 80, 120, 180, 270, 400, 600, 900, 1350, 2200)
_CHUNK = 512  # spheres at once, to bound the memory


def angular_grid(*, largest_size_parameter: float) -> AngularGrid:
    """Angles for spheres up to a size parameter.

    The matrix of a sphere of T terms is a polynomial of degree 2T: so is its expansion, and 2T + 1 nodes integrate
    their product exactly.
    """
    most = int(_sphere_terms(np.array([largest_size_parameter]))[0])
    terms = (*(limit for limit in _GROUP_TERMS if limit < most), most)
    rules = [_gauss_legendre(2 * limit + 1) for limit in terms]
    mu, weight = (np.concatenate(part) for part in zip(*rules, strict=True))
    starts = np.cumsum([0, *(rule[0].size for rule in rules)])
    return AngularGrid(terms=terms, starts=tuple(int(start) for start in starts), mu=mu, weight=weight)


def _sphere_terms(size_parameter: NDArray[np.float64]) -> NDArray[np.int_]:
    """Terms of the series for each size parameter.

    A term falls like exp(-(4/3) (1.26 c)^1.5) at x + c x^(1/3): for c = 6 the omitted part is below 1e-11 of the sum.

    Wiscombe, Appl. Opt. 19 (1980) 1505, doi:10.1364/AO.19.001505, who takes c = 4.05 for half as many digits.
    """
    return np.asarray(np.ceil(size_parameter + 6.0 * np.cbrt(size_parameter) + 4.0), dtype=np.int_)


@cache
def _gauss_legendre(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights on (-1, 1), by Newton's method: for thousands of nodes far faster than by eigenvalues."""
    mu = np.cos(np.pi * (np.arange(count, 0, -1) - 0.25) / (count + 0.5))
    slope = np.ones_like(mu)
    for _ in range(4):  # from an error of 1/count^2 of the spacing; each step squares it
        value, before = mu.copy(), np.ones_like(mu)
        for degree in range(1, count):
            value, before = ((2 * degree + 1) * mu * value - degree * before) / (degree + 1), value
        slope = count * (before - mu * value) / (1.0 - mu**2)
        mu = mu - value / slope
    return mu, 2.0 / ((1.0 - mu**2) * slope**2)


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
            size, weight = _size_nodes(mode, bounds, wavelength_m=wavelength_m, halving=halving, middles=middles)
            part = sphere_sums(grid, size_parameter=size, weight=weight, index=mode.index.at(wavelength_m))
            extinction, matrix = extinction + part[0], matrix + part[1]
    return np.concatenate([[[extinction, 0.0, 0.0, 0.0]], expand(grid, matrix)])


def _size_nodes(
    mode: ParticleMode, bounds: NDArray[np.float64], *, wavelength_m: float, halving: int, middles: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Size parameters and weights (number times geometrical cross-section [m2]) of a rule for one mode.

    Korobov's transformation of a trapezoidal rule: Sidi, Practical Extrapolation Methods (2003), appendix D.
    """
    place, step = _steps(np.log(bounds) + bounds / _BEND, halving, middles=middles, ends_vanish=mode.sizes.ends_vanish)
    size = _size_at(place)
    radius = size * wavelength_m / (2.0 * pi)
    density = mode.number_share * mode.sizes.number_per_log_radius(radius) * pi * radius**2
    weight = density * step / (1.0 + size / _BEND)
    return size[weight > 0.0], weight[weight > 0.0]


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
            # The rule is then of eighth order on an interval where the size distribution ends abruptly.
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


def sphere_sums(
    grid: AngularGrid, *, size_parameter: NDArray[np.float64], weight: NDArray[np.float64], index: complex
) -> tuple[float, NDArray[np.float64]]:
    """Extinction, and scattering matrix at the angles of the grid, summed over spheres.

    Bohren & Huffman, Absorption and Scattering of Light by Small Particles (1983), eq. (4.77).
    """
    extinction, matrix = 0.0, np.zeros((4, grid.mu.size))
    bounds = [0, *np.searchsorted(_sphere_terms(size_parameter), grid.terms, side="right")]
    for group, (first, stop) in enumerate(pairwise(bounds)):
        angles = slice(*grid.starts[group : group + 2])
        for start in range(first, stop, _CHUNK):
            chunk = slice(start, min(start + _CHUNK, stop))
            part = _chunk_sums(size_parameter[chunk], weight[chunk], index, grid.mu[angles])
            extinction += part[0]
            matrix[:, angles] += part[1]
    return extinction, matrix


def _chunk_sums(
    size_parameter: NDArray[np.float64], weight: NDArray[np.float64], index: complex, mu: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    """Extinction and matrix of some spheres at some angles, as in `sphere_sums`."""
    a, b = sphere_coefficients(size_parameter=size_parameter, n=index.real, k=index.imag)
    extinction = float(weight @ extinction_efficiency(size_parameter=size_parameter, a=a, b=b))
    plus, minus = amplitude_sums(a, b, mu)
    # The mean over the sphere of 4/x^2 F11 times the geometrical cross-section is that of scattering.
    share = 2.0 * weight / size_parameter**2
    sum_part = share @ (plus.real**2 + plus.imag**2)
    difference_part = share @ (minus.real**2 + minus.imag**2)
    mixed = share @ (plus.real * minus.real + plus.imag * minus.imag)
    return extinction, np.stack([(sum_part + difference_part) / 2.0, sum_part, difference_part, -mixed])


def sphere_coefficients(
    *, size_parameter: NDArray[np.float64], n: float, k: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Coefficients a_n and b_n of the scattered wave, column n - 1 for order n.

    Parameters
    ----------
    size_parameter
        Circumference over wavelength in the medium, shape (N,), increasing, 1e-8 to 2e4.
    n, k
        Real and (absorbing, 0 or more) imaginary part of the index relative to the medium, n above 0.

    Returns
    -------
    a, b : ndarray, shape (N, terms)
        Zero beyond the terms of each size.

    Raises
    ------
    ValueError
        An argument outside its range.

    Notes
    -----
    Logarithmic derivative downward from far above its turning point; Riccati-Bessel functions of the first kind upward
    to their turning point and by downward ratios beyond, of the second kind upward. Real parts are computed without
    differences of large terms, so that a small non-absorbing sphere has equal extinction and scattering.

    References
    ----------
    Bohren & Huffman, Absorption and Scattering of Light by Small Particles (1983), eqs. (4.56), (4.57), (4.88);
    time factor exp(-i omega t), index n + ik.
    """
    _check(size_parameter, n, k)
    terms = _sphere_terms(size_parameter)
    count = int(terms[-1])
    index = complex(n, k)
    derivative = _logarithmic_derivative(index * size_parameter, count)
    ratio = _first_kind_ratios(size_parameter, count)
    a, b = (np.zeros((size_parameter.size, count), dtype=complex) for _ in range(2))
    first, second = np.sin(size_parameter), np.cos(size_parameter)
    first_before, second_before = second, -first  # orders 0 and -1
    for order in range(1, count + 1):
        # Sizes increase, so series end in order: only the later ones continue.
        start = int(np.searchsorted(terms, order))
        x = size_parameter[start:]
        held = slice(start - size_parameter.size, None)
        upward = (2 * order - 1) / x * first[held] - first_before[held]
        first, first_before = np.where(order > x, first[held] * ratio[order, start:], upward), first[held]
        second, second_before = (2 * order - 1) / x * second[held] - second_before[held], second[held]
        for target, factor in ((a, 1.0 / index), (b, index)):
            slope = derivative[order, start:] * factor + order / x
            target[start:, order - 1] = _coefficient(slope * first - first_before, slope * second - second_before)
    return a, b


_LARGEST_SIZE, _SMALLEST_SIZE = 2e4, 1e-8


def _check(size_parameter: NDArray[np.float64], n: float, k: float) -> None:
    """Raise ValueError for sizes or indices that the series does not cover."""
    allowed = (size_parameter >= _SMALLEST_SIZE) & (size_parameter <= _LARGEST_SIZE)
    if size_parameter.ndim != 1 or size_parameter.size == 0 or not np.all(allowed):
        raise ValueError(
            f"size_parameter: 1 or more values of {_SMALLEST_SIZE:g} to {_LARGEST_SIZE:g} in one dimension are allowed"
        )
    if np.any(np.diff(size_parameter) < 0.0):
        raise ValueError("size_parameter must increase")
    if not (0.0 < n < np.inf and 0.0 <= k < np.inf):
        raise ValueError(f"index n = {n!r}, k = {k!r}: n must be above 0 and k 0 or more, both finite")


def _logarithmic_derivative(argument: NDArray[np.complexfloating], count: int) -> NDArray[np.complex128]:
    """D_n of the first kind at complex arguments, shape (count + 1, N)."""
    largest = float(np.max(np.abs(argument)))
    # Beyond the turning point an initial error decays like exp(-(4/3) (1.26 * 8)^1.5), below 1e-18.
    start = max(count, ceil(largest)) + ceil(8.0 * largest ** (1.0 / 3.0)) + 16
    values = np.zeros((count + 1, argument.size), dtype=complex)
    inverse = 1.0 / argument
    current = np.zeros_like(argument)
    for order in range(start, 0, -1):
        step = order * inverse
        current = step - 1.0 / (current + step)
        if order <= count + 1:
            values[order - 1] = current
    return values


def _first_kind_ratios(size_parameter: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Riccati-Bessel psi_n over psi_(n-1), shape (count + 1, N), meant for n above the size parameter."""
    ratios = np.zeros((count + 2, size_parameter.size))
    inverse = 1.0 / size_parameter
    # At the start, n^2 / x^2 - 1 of the turning point's width lies behind for all: terms + 20 orders.
    current = np.zeros_like(size_parameter)
    for order in range(count + 20 + ceil(2.0 * float(size_parameter[-1]) ** (1.0 / 3.0)), 0, -1):
        current = 1.0 / ((2 * order + 1) * inverse - current)
        if order <= count + 1:
            ratios[order] = current
    return ratios


def _coefficient(p: NDArray[np.complex128], q: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Quotient p / (p - iq), with an accurate real part for q far larger than p."""
    denominator = np.abs(p - 1j * q) ** 2
    mixed = p * q.conj()
    result: NDArray[np.complex128] = ((np.abs(p) ** 2 - mixed.imag) + 1j * mixed.real) / denominator
    return result


def extinction_efficiency(
    *, size_parameter: NDArray[np.float64], a: NDArray[np.complex128], b: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Return the extinction cross-sections of spheres over their geometrical ones, shape (N,).

    Bohren & Huffman (1983), eq. (4.62).
    """
    order = np.arange(1, a.shape[1] + 1)
    return np.asarray(2.0 / size_parameter**2 * ((a + b).real @ (2 * order + 1)))


def amplitude_sums(
    a: NDArray[np.complex128], b: NDArray[np.complex128], mu: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Sum and difference of the amplitudes, S1 + S2 and S1 - S2, each of shape (N, A).

    S1 is for the field across the scattering plane, S2 for the field in it.

    Bohren & Huffman (1983), eqs. (4.47), (4.74).
    """
    order = np.arange(1, a.shape[1] + 1)
    weight = (2 * order + 1) / (order * (order + 1))
    pi, tau = _angular_functions(mu, a.shape[1])
    return _product((a + b) * weight, pi + tau), _product((a - b) * weight, pi - tau)


def _angular_functions(mu: NDArray[np.float64], count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angular functions pi_n and tau_n for n = 1 to count, each of shape (count, A)."""
    pi = np.zeros((count + 1, mu.size))
    pi[1] = 1.0
    for order in range(2, count + 1):
        pi[order] = ((2 * order - 1) * mu * pi[order - 1] - order * pi[order - 2]) / (order - 1)
    orders = np.arange(1, count + 1)[:, np.newaxis]
    return pi[1:], orders * mu * pi[1:] - (orders + 1) * pi[:-1]


def _product(coefficients: NDArray[np.complex128], functions: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Complex by real matrix product, as two real ones."""
    return np.asarray(coefficients.real @ functions + 1j * (coefficients.imag @ functions))


def expand(grid: AngularGrid, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coefficients a1, a2, a3, b1 of a matrix of `sphere_sums`, summed over the groups, shape (L, 4).

    As in `model.atmosphere.layers.expansion_coefficients`; L is twice the terms of the largest sphere, plus 1.

    de Rooij & van der Stap, Astron. Astrophys. 131 (1984) 237, eqs. (117)-(122).
    """
    total = np.zeros((2 * grid.terms[-1] + 1, 4))
    for terms, (start, stop) in zip(grid.terms, pairwise(grid.starts), strict=True):
        weighted = matrix[:, start:stop] * grid.weight[start:stop]
        for degree, row in enumerate(matrix_functions(degree_max=2 * terms, mu=grid.mu[start:stop])):
            total[degree] += np.einsum("fa,fa->f", weighted, row)
    total *= np.arange(total.shape[0])[:, np.newaxis] + 0.5
    plain, plus, minus, mixed = total.T
    return np.stack([plain, (plus + minus) / 2.0, (plus - minus) / 2.0, mixed], axis=-1)


def _size_of(change: NDArray[np.float64]) -> float:
    """Size of a relative change in the layout of `_sums`: of the extinction, or of the matrix (rms over the sphere)."""
    degree = np.arange(change.shape[0] - 1)[:, np.newaxis]
    elements = np.sqrt(np.sum(change[1:] ** 2 / (2 * degree + 1), axis=0))
    return float(max(abs(change[0, 0]), np.max(elements)))


def _matrix(coefficients: NDArray[np.float64], change: NDArray[np.float64], tolerance: float) -> ScatteringMatrix:
    """Scattering matrix without negligible terms of its expansion."""
    length = _length(coefficients, tolerance / 4.0)
    degree = np.arange(len(change))
    missing = float(np.sum(np.abs(coefficients[length:, 0]))) + tolerance / 4.0  # degrees, and tails of the sizes
    return ScatteringMatrix(
        coefficients=coefficients[:length],
        error_estimate=missing + float(np.sqrt(np.sum(change[:, 0] ** 2 / (2 * degree + 1)))),
    )


def _length(coefficients: NDArray[np.float64], tolerance: float) -> int:
    """Return the number of degrees, at least 2, beyond which the rest sums to less than the tolerance."""
    size = np.max(np.abs(coefficients), axis=1)
    beyond = np.cumsum(size[::-1])[::-1]
    return max(int(np.count_nonzero(beyond > tolerance)), 2)


def _extinction(
    aerosol: MieAerosol, ranges: list[NDArray[np.float64]], wavelength_m: float, halving: int, *, middles: bool
) -> float:
    """Integral of the extinction over size by one rule."""
    total = 0.0
    for mode, bounds in zip(aerosol.modes, ranges, strict=True):
        if bounds.size:
            size, weight = _size_nodes(mode, bounds, wavelength_m=wavelength_m, halving=halving, middles=middles)
            total += _extinction_sum(size_parameter=size, weight=weight, index=mode.index.at(wavelength_m))
    return total


def _extinction_sum(*, size_parameter: NDArray[np.float64], weight: NDArray[np.float64], index: complex) -> float:
    """Sum over spheres of their extinction alone; arguments as in `sphere_sums`."""
    total = 0.0
    for start in range(0, size_parameter.size, _CHUNK):
        chunk = slice(start, start + _CHUNK)
        a, b = sphere_coefficients(size_parameter=size_parameter[chunk], n=index.real, k=index.imag)
        total += float(weight[chunk] @ extinction_efficiency(size_parameter=size_parameter[chunk], a=a, b=b))
    return total
