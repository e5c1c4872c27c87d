"""Diffuse term of a rough surface: light that the facets let in and the body scatters back."""

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from model.numerics import gauss_legendre
from model.surface.facets import (
    Lobe,
    half_vector_geometry,
    lobe_reflectance,
    mueller_elements,
    reflectance_at,
    write_rotated,
)
from model.surface.table import TabulatedBrdf

FloatArray = NDArray[np.float64]


DiffuseKind = Literal["lambert", "balance", "coupled", "polarised", "volume"]
DIFFUSE: tuple[DiffuseKind, ...] = get_args(DiffuseKind)


@dataclass(frozen=True, kw_only=True)
class SingleScattering:
    """Light that one particle of the body scatters before it leaves; see `model.surface.pbrdf.Surface`."""

    weight: float
    asymmetry: float
    dolp: float
    depolarization: float

    def __post_init__(self) -> None:
        for name, value in (("single_scattering", self.weight), ("depolarization", self.depolarization)):
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{name} = {value}; allowed is 0 to 1")
        if not abs(self.asymmetry) <= ASYMMETRY_MOST:
            raise ValueError(f"asymmetry = {self.asymmetry}; allowed is -{ASYMMETRY_MOST:g} to {ASYMMETRY_MOST:g}")
        # More, and the weakly scattering half of the directions would be polarized by more than 1.
        most = ((1.0 + self.asymmetry**2) / (1.0 + abs(self.asymmetry)) ** 2) ** 1.5
        if not 0.0 <= self.dolp <= most:
            raise ValueError(
                f"single_dolp = {self.dolp}; allowed is 0 to {most:.4g} with asymmetry = {self.asymmetry:g}"
            )


ASYMMETRY_MOST = 0.8
_NO_SINGLE = SingleScattering(weight=0.0, asymmetry=0.0, dolp=0.0, depolarization=0.0)


@dataclass(frozen=True, kw_only=True)
class Diffuse:
    """Parameters of the diffuse term of a surface; of "table", a measured surface stands for all of it."""

    kind: DiffuseKind | Literal["table"]
    lobe: Lobe
    specular_weight: float
    excess: float
    dhr_angle_rad: float
    single: SingleScattering = _NO_SINGLE
    table: TabulatedBrdf | None = None
    table_errors: tuple[float, float, float] = (0.0, 0.0, 0.0)


def add_diffuse(
    out: FloatArray, theta_i_rad: FloatArray, theta_r_rad: FloatArray, phi_rad: FloatArray, *, diffuse: Diffuse
) -> None:
    """Add the diffuse term to Mueller matrices.

    With E the reflectance of the lobe, B its weight and x = DHR - B E(theta_m):

    - "lambert": f00 = x / pi. Reciprocal; a bright glossy surface reflects more than it receives near grazing.
    - "balance": f00 = max(0, DHR - B E(theta_i)) / pi, so that the total is DHR at all angles of incidence up to the
      one where the lobe alone exceeds it. Conserves energy; not reciprocal.
    - "coupled": f00 = rho (1 - B E(theta_i)) (1 - B E(theta_r)) / (pi mean(1 - B E)), rho = x / (1 - B E(theta_m)).
      Reciprocal, total B E + rho (1 - B E) <= 1. Without shadowing E passes 1 near grazing; there 1 - B E counts as 0.
    - "polarised": f = rho t(theta_r) t(theta_i)^T / pi, t = ((T_s + T_p) / 2, (T_s - T_p) / 2, 0),
      T = 1 - B |r|^2 of the mean plane: light enters, loses its polarization and leaves. Reciprocal; conserves
      energy for every polarization of the light that comes in.
    - "volume": f = T(theta_r) f_1 T(theta_i) + x c(theta_r) c(theta_i)^T / (pi mean(c0)). T is the Fresnel
      transmission of the mean plane, (1 - B |r|^2) as a Mueller matrix. f_1 = w P / (4 pi (cos theta_i +
      cos theta_r)) is scattered once in a half-space: P00 is the phase function of Henyey and Greenstein, P01 that of
      a dipole, single_dolp P00(90 deg) sin^2 / (1 + cos^2), P11 = (1 - depolarization) P00,
      P22 = P11 2 cos / (1 + cos^2) of the scattering angle. c = (1, 0) - (what lobe and f_1 send up of S0 and S1) is
      left to be scattered often, and loses its polarization but for the way in and out. x is that share of it which
      gives the DHR. Reciprocal; the total of every polarization is at most 1.

    "balance": Hyde, Schmidt and Havrilla (2009), doi:10.1364/OE.17.022138, with the measured DHR in place of
    a perfect reflector's. "coupled": Kelemen and Szirmay-Kalos (2001), Eurographics short presentations. "polarised":
    Baek et al. (2018), doi:10.1145/3272127.3275018. "volume": first order of scattering in a half-space,
    Chandrasekhar, Radiative Transfer (1960); split into single and multiple scattering, Hapke (1981),
    doi:10.1029/JB086iB04p03039; under an interface, Germer (2003), Proc. SPIE 5158, 193; remainder as in "coupled".
    """
    if diffuse.table is not None:
        out += diffuse.table.matrix(theta_i_rad, theta_r_rad, phi_rad, errors=diffuse.table_errors)
    elif diffuse.kind == "lambert":
        out[:, 0, 0] += diffuse.excess / np.pi
    elif diffuse.kind == "balance":
        out[:, 0, 0] += _balance(theta_i_rad, diffuse) / np.pi
    elif diffuse.kind == "coupled":
        escape = _unreflected(theta_i_rad, diffuse) * _unreflected(theta_r_rad, diffuse)
        out[:, 0, 0] += _scale(diffuse) / np.pi * escape
    else:
        through = _transmitted
        if diffuse.kind == "volume":
            through = _left_over
            out += _scattered_once(theta_i_rad, theta_r_rad, phi_rad, diffuse)
        entering = _scale(diffuse) / np.pi * through(theta_i_rad, diffuse)
        leaving = through(theta_r_rad, diffuse)
        out[:, :2, :2] += leaving.T[:, :, None] * entering.T[:, None, :]


def _balance(theta_i_rad: FloatArray, diffuse: Diffuse) -> FloatArray:
    """Return what DHR leaves at the angle of incidence, not below zero; shape (N,)."""
    at_measurement = reflectance_at(diffuse.lobe, diffuse.dhr_angle_rad)
    dhr = diffuse.excess + diffuse.specular_weight * at_measurement
    lobe = diffuse.specular_weight * reflectance_table(diffuse.lobe).at(theta_i_rad)
    return np.asarray(np.maximum(dhr - lobe, 0.0))


_TOLERANCE_REFLECTANCE_TABLE = 1e-7
_DEGREES = (12, 24, 48, 96, 192)
_WORST_ERROR = 1e-4
_MEAN_NODES = 48


@dataclass(frozen=True, kw_only=True, eq=False)
class ReflectanceTable:
    """A piecewise series for E(theta), theta in [0, pi/2)."""

    edges: FloatArray
    coefficients: tuple[FloatArray, ...]
    stretch_rad: float
    rise: float
    error: float

    def at(self, theta_rad: FloatArray) -> FloatArray:
        """Return E of unpolarised light."""
        u = np.arcsinh((0.5 * np.pi - theta_rad) / self.stretch_rad)
        series = self._piece(0, u)
        for index in range(1, len(self.coefficients)):
            beyond = u > self.edges[index]
            series[beyond] = self._piece(index, u[beyond])
        if self.rise > 0.0:
            series *= 1.0 + self.rise / np.cos(theta_rad)
        return series

    def _piece(self, index: int, u: FloatArray) -> FloatArray:
        low, high = self.edges[index], self.edges[index + 1]
        position = (2.0 * u - (low + high)) / (high - low)
        return np.asarray(chebyshev.chebval(position, self.coefficients[index]))

    def mean_nodes(self) -> tuple[FloatArray, FloatArray]:
        """Return angles and weights for the cosine-weighted mean over the hemisphere.

        Definition; Gauss-Legendre in the stretched angle, piece by piece.
        """
        node, weight = gauss_legendre(_MEAN_NODES)
        widths = np.diff(self.edges)[:, None]
        u = (self.edges[:-1, None] + widths * node).ravel()
        theta = 0.5 * np.pi - self.stretch_rad * np.sinh(u)
        return theta, (widths * weight).ravel() * self.stretch_rad * np.cosh(u) * np.sin(2.0 * theta)


_Part = Literal["s0", "s1"]
_PARTS: tuple[_Part, ...] = get_args(_Part)


@lru_cache(maxsize=64)
def reflectance_table(lobe: Lobe, part: _Part = "s0") -> ReflectanceTable:
    """Return the series of a lobe; made once for each lobe and kept.

    Parameters
    ----------
    lobe
        Index, slopes and shadowing.
    part
        "s0" of unpolarised light, "s1" what horizontally polarised light adds to that.

    Returns
    -------
    ReflectanceTable
        Immutable, so that threads may share it.

    Raises
    ------
    ValueError
        If its error cannot be brought below 1e-4.
    """
    stretch = min(4.0 * lobe.slope_rms, 1.0)
    rise = lobe.slope_rms if lobe.shadowing == "none" else 0.0
    # The V-cavity's branches change their order at 45 deg, and E has a kink there in a higher derivative.
    angles = [0.5 * np.pi, 0.25 * np.pi, 0.0] if lobe.shadowing == "v-cavity" else [0.5 * np.pi, 0.0]
    edges = np.arcsinh((0.5 * np.pi - np.array(angles)) / stretch)
    sampled = _Sampling(lobe=lobe, part=part, stretch=stretch, rise=rise)
    pieces = [_series(sampled, low, high) for low, high in pairwise(edges)]
    error = max(piece_error for _, piece_error in pieces)
    _require_converged(error, lobe)
    return ReflectanceTable(
        edges=edges,
        coefficients=tuple(coefficients for coefficients, _ in pieces),
        stretch_rad=stretch,
        rise=rise,
        error=error,
    )


@dataclass(frozen=True, kw_only=True)
class _Sampling:
    lobe: Lobe
    part: _Part
    stretch: float
    rise: float


def _series(sampling: _Sampling, low: float, high: float) -> tuple[FloatArray, float]:
    """Return coefficients between two stretched angles, and their error in E."""
    samples = _samples(sampling, low, high, _DEGREES[0])
    for degree in _DEGREES[1:]:
        coarse = chebyshev.chebval(_nodes(degree)[1::2], _coefficients(samples[0]))
        between = _samples(sampling, low, high, degree, odd_only=True)
        miss = float(np.max(np.abs(between[0] - coarse)))
        samples = _interleaved(samples, between)
        if miss < _TOLERANCE_REFLECTANCE_TABLE:
            break
    values, quadrature_error, factor = samples
    coefficients, dropped = _trimmed(_coefficients(values))
    coefficients.flags.writeable = False
    # An error of the series is larger in E; what counts is E up to 1 (and what rounding adds to 1).
    amplification = float(np.max(1.0 / factor, where=values <= 1.001 * factor, initial=1.0))
    return coefficients, (miss + float(np.max(quadrature_error)) + dropped) * amplification


def _samples(sampling: _Sampling, low: float, high: float, degree: int, *, odd_only: bool = False) -> FloatArray:
    """Return rows of the tabulated function, its quadrature error, and the factor from E to it, at nodes."""
    position = _nodes(degree)[1::2] if odd_only else _nodes(degree)
    u = low + 0.5 * (position + 1.0) * (high - low)
    theta = np.clip(0.5 * np.pi - sampling.stretch * np.sinh(u), 0.0, 0.5 * np.pi)
    factor = np.cos(theta) / (np.cos(theta) + sampling.rise)
    reflectance = lobe_reflectance(theta, lobe=sampling.lobe)
    value = reflectance.s0 if sampling.part == "s0" else reflectance.s1
    return np.stack([value * factor, reflectance.error * factor, factor])


def _nodes(degree: int) -> FloatArray:
    return np.asarray(np.cos(np.pi * np.arange(degree + 1) / degree))


def _coefficients(values: FloatArray) -> FloatArray:
    """Series through values at cos(pi j / degree), by the discrete cosine sum."""
    degree = values.size - 1
    j = np.arange(degree + 1)
    halved = values.copy()
    halved[[0, -1]] *= 0.5
    coefficients = np.cos(np.pi * np.outer(j, j) / degree) @ halved * (2.0 / degree)
    coefficients[[0, -1]] *= 0.5
    return np.asarray(coefficients)


def _interleaved(even: FloatArray, odd: FloatArray) -> FloatArray:
    """Return samples at all nodes of a degree from those of half of it and those between."""
    together = np.empty((even.shape[0], even.shape[1] + odd.shape[1]))
    together[:, ::2], together[:, 1::2] = even, odd
    return together


def _trimmed(coefficients: FloatArray) -> tuple[FloatArray, float]:
    """Return the series without the tail that only costs time, and the sum of what was dropped."""
    tail = np.cumsum(np.abs(coefficients[::-1]))[::-1]
    count = max(int(np.sum(tail > 0.1 * _TOLERANCE_REFLECTANCE_TABLE)), 1)
    return coefficients[:count].copy(), float(np.sum(np.abs(coefficients[count:])))


def _require_converged(error: float, lobe: Lobe) -> None:
    if error > _WORST_ERROR:
        raise ValueError(
            f"the reflectance of the lobe n = {lobe.n:g}, k = {lobe.k:g}, slope_rms = {lobe.slope_rms:g} is known "
            f"to {error:.1g} only; allowed is {_WORST_ERROR:g}. A real index below 1 has a critical angle at which "
            "the quadrature is slow: give the absorption k, or leave out dhr"
        )


def _unreflected(theta_rad: FloatArray, diffuse: Diffuse) -> FloatArray:
    """Return 1 - B E(theta), the share of light that the lobe does not take; shape (N,)."""
    lobe = diffuse.specular_weight * reflectance_table(diffuse.lobe).at(theta_rad)
    return np.asarray(np.maximum(1.0 - lobe, 0.0))


# E is known to this; a perfect mirror leaves less than that, and 0 / 0 must not be asked.
_NOTHING = 1e-8
# A transmittance is known to 1e-16; below this too few of its digits are left to divide by.
_OPAQUE = 1e-12


@lru_cache(maxsize=64)
def _scale(diffuse: Diffuse) -> float:
    """Return the factor by which a product of two angles' functions has the total DHR that was measured."""
    if abs(diffuse.excess) < _NOTHING:
        return 0.0
    if diffuse.kind == "volume":
        angle = np.array([diffuse.dhr_angle_rad])
        share = (diffuse.excess - _sent_up_once(angle, diffuse)[0, 0]) / _left_over(angle, diffuse)[0, 0]
        return float(share / _mean_left_over(diffuse))
    if diffuse.kind == "coupled":
        there = 1.0 - diffuse.specular_weight * reflectance_at(diffuse.lobe, diffuse.dhr_angle_rad)
        return diffuse.excess / (there * _mean_unreflected(diffuse))
    there = float(_transmitted(np.array([diffuse.dhr_angle_rad]), diffuse)[0, 0])
    if there < _OPAQUE:
        raise ValueError(
            f"diffuse = 'polarised': no light enters a surface of n = {diffuse.lobe.n:g}, k = {diffuse.lobe.k:g} "
            f"(a share of {there:.1g}), so that none can leave; choose 'coupled', or leave out dhr"
        )
    return diffuse.excess / (there * _mean_transmitted(diffuse))


def _mean_unreflected(diffuse: Diffuse) -> float:
    """Return the cosine-weighted mean of 1 - B E over the hemisphere."""
    theta, weight = reflectance_table(diffuse.lobe).mean_nodes()
    return float(weight @ _unreflected(theta, diffuse))


def _transmitted(theta_rad: FloatArray, diffuse: Diffuse) -> FloatArray:
    """Return transmittance for S0 and for S1 through the mean plane, 1 - B R and -B (Rs - Rp) / 2; shape (2, N)."""
    lobe = diffuse.lobe
    mean, difference, _ = mueller_elements(cos2_psi=np.cos(theta_rad) ** 2, n=lobe.n, k=lobe.k)
    return np.stack([1.0 - diffuse.specular_weight * mean, -diffuse.specular_weight * difference])


def _mean_transmitted(diffuse: Diffuse) -> float:
    """Return the cosine-weighted mean transmittance of unpolarised light over the hemisphere."""
    theta, weight = _mean_nodes(diffuse.lobe)
    return float(weight @ _transmitted(theta, diffuse)[0])


_MEAN_NODES_DIFFUSE = 96


def _mean_nodes(lobe: Lobe) -> tuple[FloatArray, FloatArray]:
    """Angles and weights for the cosine-weighted mean, with a panel end at the critical angle of n below 1."""
    node, weight = gauss_legendre(_MEAN_NODES_DIFFUSE)
    critical = float(np.arcsin(lobe.n)) if lobe.n < 1.0 else 0.5 * np.pi
    spans = [(0.0, critical), (critical, 0.5 * np.pi)]
    # Squeezed towards both ends of each panel: the root at the critical angle becomes smooth.
    spaced, stretch = np.sin(0.5 * np.pi * node) ** 2, 0.5 * np.pi * np.sin(np.pi * node) * weight
    theta = np.concatenate([low + (high - low) * spaced for low, high in spans])
    lengths = np.concatenate([(high - low) * stretch for low, high in spans])
    return theta, lengths * np.sin(2.0 * theta)


def single_excess(diffuse: Diffuse) -> float:
    """Return by how much what one particle scatters exceeds what the DHR leaves to the diffuse term."""
    return float(_sent_up_once(np.array([diffuse.dhr_angle_rad]), diffuse)[0, 0]) - diffuse.excess


def _scattered_once(
    theta_i_rad: FloatArray, theta_r_rad: FloatArray, phi_rad: FloatArray, diffuse: Diffuse
) -> FloatArray:
    """Return T f_1 T of "volume", shape (N, 3, 3)."""
    single, geometry = diffuse.single, half_vector_geometry(theta_i_rad, theta_r_rad, phi_rad)
    g2, cosine = single.asymmetry**2, 1.0 - 2.0 * geometry.cos2_psi
    at_right_angle = (1.0 - g2) / (1.0 + g2) ** 1.5
    scale = single.weight / (4.0 * np.pi * (geometry.cos_i + geometry.cos_r))
    m00 = scale * (1.0 - g2) / (1.0 + g2 - 2.0 * single.asymmetry * cosine) ** 1.5
    square = cosine * cosine
    m11 = (1.0 - single.depolarization) * m00
    out = np.empty((theta_i_rad.size, 3, 3))
    write_rotated(
        out,
        geometry,
        m00=m00,
        m01=scale * single.dolp * at_right_angle * (1.0 - square) / (1.0 + square),
        m11=m11,
        m22=m11 * 2.0 * cosine / (1.0 + square),
    )
    return np.asarray(_interface(theta_r_rad, diffuse) @ out @ _interface(theta_i_rad, diffuse))


def _interface(theta_rad: FloatArray, diffuse: Diffuse) -> FloatArray:
    """Return the Mueller matrices of the way through the mean plane, shape (N, 3, 3)."""
    mean, difference = _transmitted(theta_rad, diffuse)
    matrix = np.zeros((theta_rad.size, 3, 3))
    matrix[:, 0, 0] = matrix[:, 1, 1] = mean
    matrix[:, 0, 1] = matrix[:, 1, 0] = difference
    matrix[:, 2, 2] = np.sqrt((mean - difference) * (mean + difference))
    return matrix


# Of the series for what one particle sends up, in the root of the height over the horizon; and of its quadrature.
_ONCE_DEGREE, _ONCE_ORDERS = 20, (24, 36)


@dataclass(frozen=True, kw_only=True, eq=False)
class _OnceTable:
    coefficients: FloatArray
    error: float


def _of_single(diffuse: Diffuse) -> Diffuse:
    """Return the same term without what single scattering does not depend on, as a key."""
    return replace(diffuse, excess=0.0, dhr_angle_rad=0.0)


@lru_cache(maxsize=64)
def _once_table(diffuse: Diffuse) -> _OnceTable:
    """Return the series of what one particle sends into the hemisphere of S0 and S1."""
    root = 0.5 * (_nodes(_ONCE_DEGREE) + 1.0)
    theta = 0.5 * np.pi * (1.0 - root * root)
    coarse, fine = (_hemisphere_once(theta, diffuse, order) for order in _ONCE_ORDERS)
    coefficients = np.stack([_coefficients(row) for row in fine])
    coefficients.flags.writeable = False
    left = float(np.sum(np.abs(coefficients[:, -2:])))
    return _OnceTable(coefficients=coefficients, error=float(np.max(np.abs(fine - coarse))) + left)


def _hemisphere_once(theta_i_rad: FloatArray, diffuse: Diffuse, order: int) -> FloatArray:
    """Return the first row of T f_1 T, times cosine, over the hemisphere, shape (2, T)."""
    node, weight = gauss_legendre(order)
    theta_r, phi = 0.5 * np.pi * (1.0 - node * node), np.pi * (np.arange(order) + 0.5) / order
    solid = np.pi * np.pi * node * weight * np.sin(2.0 * theta_r)
    i, r, around = (angle.ravel() for angle in np.meshgrid(theta_i_rad, theta_r, phi, indexing="ij"))
    rows = _scattered_once(i, r, around, diffuse)[:, 0, :2].reshape(theta_i_rad.size, order, order, 2).mean(axis=2)
    return np.asarray(np.einsum("trk,r->kt", rows, solid))


def _sent_up_once(theta_rad: FloatArray, diffuse: Diffuse) -> FloatArray:
    """Return the share of S0, and of S1, that leaves after one particle, shape (2, N)."""
    root = np.sqrt(np.maximum(1.0 - theta_rad * (2.0 / np.pi), 0.0))
    return np.asarray(chebyshev.chebval(2.0 * root - 1.0, _once_table(_of_single(diffuse)).coefficients.T))


def _left_over(theta_rad: FloatArray, diffuse: Diffuse) -> FloatArray:
    """Return what neither the lobe nor one particle sends up of S0, and of S1, shape (2, N)."""
    lobe = [diffuse.specular_weight * reflectance_table(diffuse.lobe, part).at(theta_rad) for part in _PARTS]
    s0, s1 = np.array([[1.0], [0.0]]) - np.stack(lobe) - _sent_up_once(theta_rad, diffuse)
    s0 = np.maximum(s0, 0.0)
    return np.stack([s0, np.clip(s1, -s0, s0)])


def _mean_left_over(diffuse: Diffuse) -> float:
    """Return the cosine-weighted mean of what is left over of unpolarised light."""
    theta, weight = reflectance_table(diffuse.lobe).mean_nodes()
    return float(weight @ _left_over(theta, diffuse)[0])


def diffuse_row(theta_i_rad: FloatArray, *, diffuse: Diffuse) -> FloatArray:
    """Return what the diffuse term adds to the directional-hemispherical reflectance.

    Definition: pi times the cosine-weighted mean of the first row over the hemisphere.
    """
    if diffuse.table is not None:
        return diffuse.table.hemispherical_row(theta_i_rad)
    row = np.zeros((2, theta_i_rad.size))
    if diffuse.kind == "lambert":
        row[0] = diffuse.excess
    elif diffuse.kind == "balance":
        row[0] = _balance(theta_i_rad, diffuse)
    elif diffuse.kind == "coupled":
        row[0] = _scale(diffuse) * _mean_unreflected(diffuse) * _unreflected(theta_i_rad, diffuse)
    elif diffuse.kind == "volume":
        row[:] = _scale(diffuse) * _mean_left_over(diffuse) * _left_over(theta_i_rad, diffuse)
        row += _sent_up_once(theta_i_rad, diffuse)
    else:
        row[:] = _scale(diffuse) * _mean_transmitted(diffuse) * _transmitted(theta_i_rad, diffuse)
    return row


def diffuse_error(diffuse: Diffuse) -> float:
    """Return the error of the diffuse part: three of its kinds rest on the series for E."""
    if diffuse.table is not None:
        return diffuse.table.reflectance_error
    series = diffuse.kind in ("balance", "coupled", "volume")
    error = diffuse.specular_weight * (reflectance_table(diffuse.lobe).error if series else 1e-8)
    return error + _once_table(_of_single(diffuse)).error if diffuse.kind == "volume" else error
