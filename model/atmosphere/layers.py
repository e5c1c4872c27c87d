"""Homogeneous layers with their scattering matrices: expansion, truncation and integration over depth.

Light scattered once needs the first column of the scattering matrix, exactly, at any angle; light scattered more often
needs its coefficients in Wigner functions. Every kind of aerosol must provide both. The forward peak that few
directions cannot represent counts as unscattered (delta-M).

Each layer is cut in elements, in which the source is a parabola of optical depth through the values at the top, in
the middle and at the bottom; the exponential of extinction is integrated exactly.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property, lru_cache
from itertools import groupby
from math import ceil, comb, exp, isfinite, pi, sqrt

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def stokes_basis(*, degree_max: int, order_max: int, mu: FloatArray) -> FloatArray:
    """Basis matrices between the radiance (I, Q, U) of one azimuth mode and expansion space.

    With I, Q as cosine and U as sine series in the azimuth of propagation, mode m of the scattering matrix between
    two directions is the sum over l of basis(mu) @ B_l @ basis(mu'), B_l = [[a1, b1, 0], [b1, a2, 0], [0, 0, a3]]
    (the coefficients of `phase`), in the meridian frame with Q > 0 for E in the vertical plane.

    Siewert, Astron. Astrophys. 109 (1982) 195; de Rooij & van der Stap, Astron. Astrophys. 131 (1984) 237.
    """
    plain, even, odd = basis_functions(degree_max=degree_max, order_max=order_max, mu=mu)
    basis = np.zeros((order_max + 1, degree_max + 1, 3, mu.size, 3))
    basis[:, :, 0, :, 0] = plain
    basis[:, :, 1, :, 1] = basis[:, :, 2, :, 2] = even
    basis[:, :, 1, :, 2] = basis[:, :, 2, :, 1] = odd
    return basis


def _functions(degree_max: int, order_max: int, mu_bytes: bytes) -> FloatArray:
    mu = np.frombuffer(mu_bytes)
    plain, plus, minus = (wigner_d(degree_max=degree_max, order_max=order_max, second=n, mu=mu) for n in (0, 2, -2))
    functions = np.stack([plain, 0.5 * (plus + minus), 0.5 * (minus - plus)])
    functions.flags.writeable = False
    return functions


# Cached for quadratures and for lines of sight, to which a sweep returns with every sun; many directions would take
# tens of megabytes.
_kept_functions_of_many, _kept_functions_of_few, _kept_functions_of_some = (
    lru_cache(maxsize=size)(_functions) for size in (6, 48, 192)
)
_KEPT_UP_TO = ((10_000, _kept_functions_of_some), (40_000, _kept_functions_of_few))


def basis_functions(*, degree_max: int, order_max: int, mu: FloatArray) -> FloatArray:
    """Entries of the matrices of `stokes_basis` that are not zero: I to I, Q to Q as U to U, Q to U as U to Q.

    Siewert, Astron. Astrophys. 109 (1982) 195.
    """
    numbers = (degree_max + 1) * (order_max + 1) * mu.size
    kept = next((kept for most, kept in _KEPT_UP_TO if numbers <= most), _kept_functions_of_many)
    return kept(degree_max, order_max, np.ascontiguousarray(mu, dtype=np.float64).tobytes())


_SAMPLES_PER_DEGREE = 4
_STENCIL = np.arange(-2, 4)  # sixth-order interpolation between samples
_FEWEST_DEGREES = 24


@dataclass(frozen=True, kw_only=True, eq=False)
class ScatteringMatrix:
    """Scattering matrix of spheres by its expansion; compared by identity.

    Attributes
    ----------
    coefficients
        a1, a2, a3, b1 of degree 0, 1, ... as in `phase.expansion_coefficients`, shape (L, 4); the first is 1.
    error_estimate
        Estimated error of F11 in the mean over the sphere. It is larger within a degree or two of forward, the
        diffraction of the few largest spheres.
    """

    coefficients: NDArray[np.float64]
    error_estimate: float
    _samples: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        shape = self.coefficients.shape
        if len(shape) != 2 or shape[1] != 4 or shape[0] < 1 or abs(self.coefficients[0, 0] - 1.0) > 1e-9:
            raise ValueError("ScatteringMatrix: coefficients must be of shape (L, 4) and begin with 1")
        object.__setattr__(self, "_samples", _sampled_column(self.coefficients))

    @property
    def g(self) -> float:
        """Asymmetry, the mean cosine of the scattering angle."""
        return float(self.coefficients[1, 0]) / 3.0 if self.coefficients.shape[0] > 1 else 0.0

    def first_column(self, angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """F11 and F12 at scattering angles, shape (2, ...), F11 of mean 1 over the sphere.

        Parameters
        ----------
        angle_rad
            0 to pi [rad].

        Notes
        -----
        Interpolated between samples four times as dense as the expansion requires: error below 1e-6 of the largest
        value nearby.
        """
        last = self._samples.shape[1] - 1 - 2 * _STENCIL[-1]
        place = angle_rad / pi * last
        lower = np.clip(np.floor(place).astype(int), 0, last - 1)
        total = np.zeros((2, *angle_rad.shape))
        for offset in _STENCIL:
            others = _STENCIL[offset != _STENCIL]
            shares = [(place - lower - other) / (offset - other) for other in others]
            total += np.prod(shares, axis=0) * self._samples[:, lower + offset + _STENCIL[-1]]
        return total

    def matrix(self, angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """F11, F22, F33 and F12 at scattering angles by the sum of the expansion, shape (4, N)."""
        a1, a2, a3, b1 = self.coefficients.T
        weights = np.stack([a1, a2 + a3, a2 - a3, b1], axis=-1)
        total = np.zeros((4, angle_rad.size))
        functions = matrix_functions(degree_max=a1.size - 1, mu=np.cos(angle_rad))
        for weight, row in zip(weights, functions, strict=True):
            total += weight[:, np.newaxis] * row
        plain, plus, minus, mixed = total
        return np.stack([plain, (plus + minus) / 2.0, (plus - minus) / 2.0, mixed])


@dataclass(frozen=True)
class Layer:
    """A homogeneous layer of molecules and one aerosol.

    Attributes
    ----------
    tau_rayleigh
        Optical depth of molecular scattering, 0 or more.
    tau_aerosol
        Optical depth of aerosol extinction, 0 or more.
    ssa_aerosol
        Single-scattering albedo of the aerosol, 0 to 1. A pure absorber (ozone) is an aerosol of albedo 0.
    g_aerosol
        Asymmetry of the aerosol's Henyey-Greenstein function, -1 < g < 1; not used with a matrix.
    delta
        Rayleigh anisotropy (1 - rho)/(1 + rho/2), rho the depolarization factor, 0 to 1; about 0.958 for air.
    matrix
        Scattering matrix of spheres; None for a Henyey-Greenstein function.
    forward_share
        Share of the aerosol's scattering that counts as unscattered, 0 to below 1; set by the solver.
    """

    tau_rayleigh: float
    tau_aerosol: float
    ssa_aerosol: float
    g_aerosol: float
    delta: float
    matrix: ScatteringMatrix | None = None
    forward_share: float = 0.0

    def __post_init__(self) -> None:
        for name in ("tau_rayleigh", "tau_aerosol"):
            _require(name, getattr(self, name), getattr(self, name) >= 0.0, "0 or more")
        for name in ("ssa_aerosol", "delta"):
            _require(name, getattr(self, name), 0.0 <= getattr(self, name) <= 1.0, "0 to 1")
        _require("forward_share", self.forward_share, 0.0 <= self.forward_share < 1.0, "0 to below 1")
        _require("g_aerosol", self.g_aerosol, -1.0 < self.g_aerosol < 1.0, "strictly between -1 and 1")

    @cached_property
    def depth(self) -> float:
        """Optical depth of the layer without the unscattered share."""
        return self.full_depth - self.tau_aerosol * self.ssa_aerosol * self.forward_share

    @property
    def full_depth(self) -> float:
        """Extinction optical depth of the layer."""
        return self.tau_rayleigh + self.tau_aerosol


_NEGLIGIBLE = 1e-13  # of the whole depth: closer faces coincide in double precision


def merge_alike(layers: Sequence[Layer]) -> list[Layer]:
    """Layers with equal neighbours joined, without those of no depth."""
    least = _NEGLIGIBLE * sum(layer.depth for layer in layers)
    filled = (layer for layer in layers if layer.depth > least)
    return [_joined(list(alike)) for _, alike in groupby(filled, key=_composition)]


class AerosolKind(StrEnum):
    """Kind of aerosol by its effect on polarization."""

    DEPOLARIZING = "depolarizing"
    """The scattered light is unpolarized."""
    POLARIZING = "polarizing"
    """Unpolarized light stays so; polarized light keeps its state in and near the forward direction."""
    SPHERES = "spheres"
    """Scattering matrix of homogeneous spheres."""


def layers_of_kind(layers: Sequence[Layer], kind: AerosolKind) -> list[Layer]:
    """Layers with scattering matrices only if the kind of aerosol needs them."""
    if kind is not AerosolKind.SPHERES:
        return [layer if layer.matrix is None else replace(layer, matrix=None) for layer in layers]
    if any(layer.matrix is None and layer.tau_aerosol * layer.ssa_aerosol > 0.0 for layer in layers):
        raise ValueError("aerosol 'spheres' needs a matrix in every layer whose aerosol scatters")
    return list(layers)


def expansion_coefficients(layers: Sequence[Layer], *, degree_max: int, aerosol: AerosolKind) -> NDArray[np.float64]:
    """Expansion coefficients of each layer's scattering matrix times its single-scattering albedo.

    A layer with a scattering matrix has its coefficients, less the forward peak that counts as unscattered (delta-M).
    Others are Henyey-Greenstein: a1 = (2l + 1) g^l; a polarizing one also has a2 = a3 = a1 from l = 2, the simplest
    choice that is regular at 180 degrees. Both have b1 = 0: unlike real particles they do not polarize.

    de Rooij & van der Stap, Astron. Astrophys. 131 (1984) 237 (b1 there has the other sign, its P^l_02 = -d^l_02);
    Wiscombe, J. Atmos. Sci. 34 (1977) 1408 (delta-M); Henyey & Greenstein, Astrophys. J. 93 (1941) 70.
    """
    coefficients = np.zeros((len(layers), degree_max + 1, 4))
    degree = np.arange(degree_max + 1)
    for row, layer in zip(coefficients, layers, strict=True):
        row += layer.tau_aerosol * layer.ssa_aerosol * _aerosol_expansion(layer, degree, aerosol)
        row[0, 0] += layer.tau_rayleigh
        row[2] += layer.tau_rayleigh * layer.delta * np.array([0.5, 3.0, 0.0, -sqrt(6.0) / 2.0])
        row /= layer.depth
    return coefficients


def rayleigh_column(*, mu: NDArray[np.float64], beam_mu: float, phi_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """First column (I, Q, U for unpolarized light) of the scattering matrix of isotropic dipoles, delta = 1.

    From the components of the beam's direction along the two field directions, without rotation angles: there is no
    0/0 at the zenith or in the direction of the beam.
    """
    along_theta, along_phi, _ = _beam_components(mu, beam_mu, phi_rad)
    theta_power, phi_power = 1.0 - along_theta**2, 1.0 - along_phi**2
    cross = -2.0 * along_theta * along_phi
    return 0.75 * np.stack([theta_power + phi_power, theta_power - phi_power, cross], axis=-1)


def matrix_column(
    *, matrix: ScatteringMatrix, mu: NDArray[np.float64], beam_mu: float, phi_rad: NDArray[np.float64]
) -> NDArray[np.float64]:
    """First column (I, Q, U for unpolarized light) of a scattering matrix, shape (..., 3); I averages to 1."""
    along_theta, along_phi, cosine = _beam_components(mu, beam_mu, phi_rad)
    sine_square = along_theta**2 + along_phi**2
    plain, mixed = matrix.first_column(np.arctan2(np.sqrt(sine_square), cosine))
    # F12 falls like the square of the sine toward both ends, where the scattering plane is undefined.
    degree = np.zeros_like(mixed)
    np.divide(mixed, sine_square, out=degree, where=sine_square > 0.0)
    return np.stack([plain, degree * (along_theta**2 - along_phi**2), degree * 2.0 * along_theta * along_phi], axis=-1)


def henyey_greenstein(
    *, g: float | NDArray[np.float64], mu: NDArray[np.float64], beam_mu: float, phi_rad: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Henyey-Greenstein phase function, which averages to 1 over the sphere.

    Henyey & Greenstein, Astrophys. J. 93 (1941) 70.
    """
    _, _, cosine = _beam_components(mu, beam_mu, phi_rad)
    values: NDArray[np.float64] = (1.0 - g**2) / (1.0 + g**2 - 2.0 * g * cosine) ** 1.5
    return values


_ROUNDING = 1e-9
_SERIES_TERMS = 18  # the series to here has an error of 2/18! at 1


def element_edges(
    layers: Sequence[Layer], *, element_depth: float, halvings: int
) -> tuple[NDArray[np.float64], NDArray[np.int_]]:
    """Optical depths of the elements' faces, and the layer each element belongs to."""
    # Rounding of a depth that is a multiple of the element's must not add an element.
    counts = [max(ceil(layer.depth / element_depth - _ROUNDING), 1) for layer in layers]
    depths = [layer.depth / count for layer, count in zip(layers, counts, strict=True)]
    owner = np.repeat(np.arange(len(layers)), counts)
    edges = np.concatenate([[0.0], np.cumsum(np.repeat(depths, counts))])
    if owner.size == 0 or halvings == 0:
        return edges, owner
    # The source bends like t log t at the outer faces: the first and the last element are halved toward them.
    shares = 0.5 ** np.arange(1, halvings + 1)
    edges = np.concatenate([[0.0], edges[1] * shares[::-1], edges[1:]])
    last = edges[-1] - edges[-2]
    edges = np.concatenate([edges[:-1], edges[-1] - last * shares, edges[-1:]])
    return edges, np.pad(owner, halvings, mode="edge")


def slant(depth: NDArray[np.float64], mu: NDArray[np.float64]) -> NDArray[np.float64]:
    """Slant optical depth depth/mu; infinite at the horizon, and 0 where there is no depth."""
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # of cosines that are 0 or next to it
        return np.where(depth > 0.0, depth / mu, 0.0)


def source_weights(*, path: NDArray[np.float64], part: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights of the three source values of an element in its radiance.

    Exact for a source that is a parabola of depth. At the horizon only the source at the observer counts.
    """
    constant, linear, square = (part**power * moment for power, moment in enumerate(_exponential_moments(path, part)))
    return np.stack([constant - 3.0 * linear + 2.0 * square, 4.0 * (linear - square), 2.0 * square - linear], axis=-1)


def delta_m_truncated(layers: Sequence[Layer], *, degree: int) -> list[Layer]:
    """Layers whose scattering matrices lack the forward peak beyond an expansion to a degree.

    Delta-M: the peak counts as unscattered, in the amount that makes the first omitted degree vanish. Light scattered
    once keeps the exact matrix, along the paths of the reduced depth (TMS). The remaining error is the shape of the
    aureole of light scattered twice and more, within some ten degrees of the sun.

    Wiscombe, J. Atmos. Sci. 34 (1977) 1408; Nakajima & Tanaka, J. Quant. Spectrosc. Radiat. Transfer 40 (1988) 51,
    doi:10.1016/0022-4073(88)90031-3.
    """
    return [
        layer if layer.matrix is None else replace(layer, forward_share=forward_share(layer, degree=degree))
        for layer in layers
    ]


def with_truncated_matrix(layers: Sequence[Layer], *, degree: int) -> list[Layer]:
    """Layers of reduced depth and albedo with truncated matrices, also for light scattered once (`delta_m_truncated`).

    Fluxes of their light, together with that of the peak, are those of the layers given, and far easier to integrate.

    Wiscombe, J. Atmos. Sci. 34 (1977) 1408.
    """
    return [_truncated(layer, degree) for layer in layers]


def peak_irradiance(layers: Sequence[Layer], truncated: Sequence[Layer], *, mu0: float) -> float:
    """Irradiance of the ground by the forward peak, which counts as beam, per unit of the beam's."""
    full, counted = (sum(layer.depth for layer in each) for each in (layers, truncated))
    return mu0 * (exp(-counted / mu0) - exp(-full / mu0))


def single_peak_irradiance(layers: Sequence[Layer], *, degree: int, mu0: float) -> float:
    """Irradiance of the ground by the forward peak of light scattered once, per unit beam irradiance.

    definition: it goes on along the beam.
    """
    depth = sum(layer.depth for layer in layers)
    scattered = sum(forward_share(layer, degree=degree) * layer.ssa_aerosol * layer.tau_aerosol for layer in layers)
    return scattered * exp(-depth / mu0)


def truncated_by_absorption(layers: Sequence[Layer], *, degree: int) -> list[Layer]:
    """Layers of the same depth with truncated matrices, the forward peak subtracted from their albedo."""
    return [_cut(layer, degree) for layer in layers]


def forward_share(layer: Layer, *, degree: int) -> float:
    """Share of the aerosol's scattering in the peak beyond a degree; 0 where the expansion has ended or is negative.

    Wiscombe, J. Atmos. Sci. 34 (1977) 1408: the first coefficient left out, over 2l + 1.
    """
    if layer.matrix is None or layer.matrix.coefficients.shape[0] <= degree + 1:
        return 0.0
    return max(float(layer.matrix.coefficients[degree + 1, 0]) / (2 * degree + 3), 0.0)


def matrix_functions(*, degree_max: int, mu: FloatArray) -> Iterator[FloatArray]:
    """Functions in which a scattering matrix is expanded, degree by degree from 0.

    de Rooij & van der Stap, Astron. Astrophys. 131 (1984) 237; recurrence as in `wigner_d`.
    """
    functions = np.zeros((3, 4, mu.size))
    functions[0, 0], functions[1, 0], functions[2, 0] = 1.0, mu, 1.5 * mu**2 - 0.5
    for row, (order, second) in enumerate(((2, 2), (2, -2), (0, 2)), start=1):
        functions[2, row] = _lowest_degree(order, second, mu)
    yield from functions[: degree_max + 1]
    before, current = functions[1], functions[2]
    first, second_order = np.array([0, 2, 2, 0])[:, np.newaxis], np.array([0, 2, -2, 2])[:, np.newaxis]
    degree = np.arange(2.0, max(degree_max, 2))[:, np.newaxis, np.newaxis]
    scale = degree * np.sqrt(((degree + 1) ** 2 - first**2) * ((degree + 1) ** 2 - second_order**2))
    rise = (2 * degree + 1) * degree * (degree + 1) / scale
    shift = (2 * degree + 1) * first * second_order / scale
    fall = (degree + 1) * np.sqrt((degree**2 - first**2) * (degree**2 - second_order**2)) / scale
    for factor, constant, back in zip(rise, shift, fall, strict=True):
        before, current = current, (factor * mu - constant) * current - back * before
        yield current


def wigner_d(*, degree_max: int, order_max: int, second: int, mu: FloatArray) -> FloatArray:
    """Wigner's functions d^l_mn(arccos mu) for every degree l and first order m, at one second order n.

    Upward recurrence in l from the closed form at l = max(m, |n|), which is stable.

    Mishchenko, Travis & Lacis, Scattering, Absorption, and Emission of Light by Small Particles (2002), appendix B.
    """
    values = np.zeros((order_max + 1, degree_max + 1, mu.size))
    for order in range(min(order_max, degree_max) + 1):
        lowest = max(order, abs(second))
        if lowest <= degree_max:
            values[order, lowest] = _lowest_degree(order, second, mu)
    for degree, rise, shift, fall in _recurrence(degree_max, order_max, second):
        # Orders above this degree start later, from their own closed form.
        known = slice(0, rise.shape[0])
        values[known, degree + 1] = (rise * mu - shift) * values[known, degree]
        values[known, degree + 1] -= fall * values[known, max(degree, 1) - 1]
    return values


def _lowest_degree(order: int, second: int, mu: FloatArray) -> FloatArray:
    """d^l_mn at l = max(m, |n|)."""
    difference, total = abs(order - second), abs(order + second)
    sign = 1.0 if second >= order else (-1.0) ** difference
    shape: FloatArray = ((1.0 - mu) / 2.0) ** (difference / 2) * ((1.0 + mu) / 2.0) ** (total / 2)
    return sign * sqrt(comb(difference + total, total)) * shape


@lru_cache(maxsize=64)
def _recurrence(
    degree_max: int, order_max: int, second: int
) -> tuple[tuple[int, FloatArray, FloatArray, FloatArray], ...]:
    """For each degree l its factors in d^(l+1) = (rise mu - shift) d^l - fall d^(l-1), by first order, shape (M, 1)."""
    return tuple((degree, *_factors(degree, order_max, second)) for degree in range(abs(second), degree_max))


def _factors(degree: int, order_max: int, second: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Factors of one degree; at l = 0 there is no degree before, and its factor is 0."""
    orders = np.arange(min(order_max, degree) + 1)[:, np.newaxis]
    upper, divisor = degree + 1, max(degree, 1)
    scale = np.sqrt((upper**2 - orders**2) * (upper**2 - second**2))
    earlier = np.sqrt((degree**2 - orders**2) * (degree**2 - second**2)) * (upper / divisor)
    twice = 2 * degree + 1
    return twice * upper / scale, twice * (orders * second / divisor) / scale, earlier / scale


def _sampled_column(coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    """F11 and F12 at equally spaced angles from 0 to pi and, mirrored (both are even), some beyond each end."""
    degrees = max(coefficients.shape[0], _FEWEST_DEGREES)
    mu = np.cos(pi * np.arange(degrees + 1) / degrees)
    total = np.zeros((2, mu.size))
    for weight, row in zip(coefficients, matrix_functions(degree_max=len(coefficients) - 1, mu=mu), strict=True):
        total[0] += weight[0] * row[0]
        total[1] += weight[3] * row[3]
    # As sums of cosines of multiples of the angle they are read between these angles exactly.
    around = np.concatenate([total, total[:, -2:0:-1]], axis=1)
    count = _SAMPLES_PER_DEGREE * degrees
    dense = _SAMPLES_PER_DEGREE * np.fft.irfft(np.fft.rfft(around, axis=1), 2 * count, axis=1)[:, : count + 1]
    return np.pad(dense, ((0, 0), (_STENCIL[-1], _STENCIL[-1])), mode="reflect")


def _require(name: str, value: float, allowed: bool, wanted: str) -> None:
    """Refuse a number outside its range."""
    if not (allowed and isfinite(value)):
        raise ValueError(f"Layer: {name} = {value!r}, but it must be finite and {wanted}")


def _joined(alike: list[Layer]) -> Layer:
    """One layer of the depth of all."""
    if len(alike) == 1:
        return alike[0]
    return replace(
        alike[0],
        tau_rayleigh=sum(layer.tau_rayleigh for layer in alike),
        tau_aerosol=sum(layer.tau_aerosol for layer in alike),
    )


def _composition(layer: Layer) -> tuple[object, ...]:
    """Return the properties that equal layers share; rounded, since cutting a layer rounds its depths."""
    aerosol_share = float(f"{layer.tau_aerosol / layer.depth:.10g}")
    return (aerosol_share, layer.ssa_aerosol, layer.g_aerosol, layer.delta, layer.matrix, layer.forward_share)


def _aerosol_expansion(layer: Layer, degree: NDArray[np.int_], aerosol: AerosolKind) -> NDArray[np.float64]:
    """Expansion of the aerosol's scattering matrix, shape (L, 4)."""
    series = np.zeros((degree.size, 4))
    if layer.matrix is not None:
        known = layer.matrix.coefficients[: degree.size]
        series[: len(known)] = known
        peak = layer.forward_share * (2 * degree + 1)
        series[:, 0] -= peak
        series[2:, 1:3] -= peak[2:, np.newaxis]
        return series
    series[:, 0] = (2 * degree + 1) * np.power(layer.g_aerosol, degree)
    if aerosol is AerosolKind.POLARIZING:
        series[2:, 1:3] = series[2:, :1]
    return series


def _beam_components(
    mu: NDArray[np.float64], beam_mu: float, phi_rad: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Components of the beam's direction along e_theta, e_phi and the direction of the scattered light."""
    sine, beam_sine = np.sqrt(1.0 - mu**2), sqrt(1.0 - beam_mu**2)
    cosine_phi = np.cos(phi_rad)
    along_theta = mu * cosine_phi * beam_sine - sine * beam_mu
    along_phi = -np.sin(phi_rad) * beam_sine
    along_light = sine * cosine_phi * beam_sine + mu * beam_mu
    return along_theta, along_phi, along_light


def _exponential_moments(path: NDArray[np.float64], part: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Moments E_k = y * integral over z in (0, 1) of exp(-y (1 - z)) z^k, k = 0, 1, 2, for y = path * part."""
    crossed = np.zeros(np.broadcast_shapes(path.shape, part.shape))
    np.multiply(path, part, out=crossed, where=part > 0.0)
    zeroth = -np.expm1(-crossed)
    thick = np.maximum(crossed, 1.0)
    first_thick = 1.0 - zeroth / thick
    second_thick = 1.0 - 2.0 * first_thick / thick
    first, second = _moments_of_thin(np.minimum(crossed, 1.0))
    is_thick = crossed > 1.0
    return [zeroth, np.where(is_thick, first_thick, first), np.where(is_thick, second_thick, second)]


def _moments_of_thin(crossed: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """First and second moments by backward recurrence, which keeps all digits for arguments up to 1."""
    moment = crossed / (_SERIES_TERMS + 1.0)
    for power in range(_SERIES_TERMS, 2, -1):
        moment = crossed * (1.0 - moment) / power
    return crossed * (1.0 - moment) / 2.0, moment


def _truncated(layer: Layer, degree: int) -> Layer:
    """Return one layer of `with_truncated_matrix`."""
    lost = layer.ssa_aerosol * forward_share(layer, degree=degree)
    cut = _cut(layer, degree)
    return replace(cut, tau_aerosol=layer.tau_aerosol * (1.0 - lost), ssa_aerosol=cut.ssa_aerosol / (1.0 - lost))


def _cut(layer: Layer, degree: int) -> Layer:
    """Return one layer of `truncated_by_absorption`."""
    share = forward_share(layer, degree=degree)
    if layer.matrix is None or share == 0.0:
        return layer
    series = layer.matrix.coefficients[: degree + 1].copy()
    peak = share * (2.0 * np.arange(degree + 1) + 1.0)
    series[:, 0] -= peak
    series[2:, 1:3] -= peak[2:, np.newaxis]
    matrix = ScatteringMatrix(coefficients=series / (1.0 - share), error_estimate=layer.matrix.error_estimate)
    return replace(layer, ssa_aerosol=layer.ssa_aerosol * (1.0 - share), matrix=matrix)
