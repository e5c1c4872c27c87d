"""Plane-parallel vector radiative transfer by successive orders of scattering.

Light scattered once has closed forms in depth and the exact scattering matrix in angle. Light scattered more often is
carried on a grid of levels and quadrature directions, azimuth mode by mode, order after order, until the rest is below
the tolerance. The error is estimated from the residual of the solution in the equation of transfer on a finer grid.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import acos, cos, degrees, exp, inf, pi, radians
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.layers import (
    AerosolKind,
    Layer,
    ScatteringMatrix,
    basis_functions,
    delta_m_truncated,
    element_edges,
    expansion_coefficients,
    forward_share,
    henyey_greenstein,
    layers_of_kind,
    matrix_column,
    matrix_functions,
    merge_alike,
    rayleigh_column,
    slant,
    source_weights,
    stokes_basis,
)
from model.numerics import gauss_legendre

__all__ = ["AerosolKind", "Layer", "ScatteringMatrix", "Solution", "solve"]


@dataclass(frozen=True, kw_only=True)
class ModeBlock:
    """Light scattered more than once, in azimuth modes of equal number of Stokes components.

    Attributes
    ----------
    modes
        The azimuth modes.
    expansion
        Expansion of twice the source at the three points of each element, shape (M, E, 3, L, S).
    """

    modes: range
    expansion: NDArray[np.float64]


_CHUNK = 512  # lines of sight evaluated at once, to bound the memory
_ROUNDING = 1e-9  # allowed rounding of depths and cosines


@dataclass(frozen=True, kw_only=True)
class Solution:
    """Diffuse light of one sun position, one ground and one wavelength, at every level and in every direction.

    Attributes
    ----------
    layers
        The layers from the top, equal neighbours joined.
    mu0
        Cosine of the solar zenith angle.
    edges
        Optical depths of the faces of the solver's elements, without the unscattered share, shape (E + 1,).
    blocks
        The light scattered more than once.
    ground_radiance
        Radiance that leaves the Lambertian ground, per unit beam irradiance [sr-1].
    diffuse_irradiance
        Downward diffuse irradiance at the ground, per unit beam irradiance.
    orders
        Number of summed orders of scattering.
    converged
        Whether the omitted orders are below the tolerance.
    """

    layers: tuple[Layer, ...]
    mu0: float
    edges: NDArray[np.float64]
    blocks: tuple[ModeBlock, ...]
    ground_radiance: float
    diffuse_irradiance: float
    orders: int
    converged: bool

    @cached_property
    def depth(self) -> float:
        """Extinction optical depth of all layers."""
        return sum(layer.full_depth for layer in self.layers)

    def stokes(
        self, tau_above: ArrayLike, mu: ArrayLike, phi_rad: ArrayLike, *, looking: Literal["up", "down"]
    ) -> NDArray[np.float64]:
        """Stokes radiance S0, S1, S2 of the diffuse light, per unit beam irradiance [sr-1].

        Parameters
        ----------
        tau_above
            Optical depth above the observer, 0 to that of all layers.
        mu
            Cosine of the line of sight from the vertical, up or down as one looks, 0 to 1.
        phi_rad
            Looking up: azimuth of the sun minus azimuth of the point looked at; looking down: azimuth of the sun minus
            azimuth of the sensor as seen from the target [rad]. Compass azimuths. The three arrays broadcast.
        looking
            "up" or "down".

        Returns
        -------
        ndarray, shape (..., 3)
            S1 > 0 for horizontal vibration, S2 > 0 for +45 degrees counter-clockwise as the observer sees it. Looking
            down, light from the ground is included.

        Raises
        ------
        ValueError
            An argument outside its range.

        Notes
        -----
        At the horizon (mu = 0) the limit is returned, the source at the observer. The direct beam is not included. At
        mu = 1 the azimuth still determines the frame.

        References
        ----------
        definition; conventions of [MK14] eq. (11).
        """
        if looking not in ("up", "down"):
            raise ValueError(f"stokes: looking = {looking!r}, but it must be 'up' or 'down'")
        tau, cosine, phi = (np.asarray(values, dtype=float) for values in np.broadcast_arrays(tau_above, mu, phi_rad))
        requests = np.stack([self._tau(tau).ravel(), _cosine(cosine).ravel(), _finite(phi).ravel()])
        upward = looking == "down"
        chunks = [
            self._radiance(*requests[:, start : start + _CHUNK], upward=upward)
            for start in range(0, max(requests.shape[1], 1), _CHUNK)
        ]
        # Meridian frame (Q > 0 for vertical vibration, U) to the observer's: S1 = -Q, S2 = -U.
        observed: NDArray[np.float64] = np.concatenate(chunks) * np.array([1.0, -1.0, -1.0]) + 0.0
        return observed.reshape(*tau.shape, 3)

    def _tau(self, tau: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return checked depths in the solver's scale, limited to the range."""
        allowed = (tau >= 0.0) & (tau <= self.depth * (1.0 + _ROUNDING))
        if not np.all(allowed):
            raise ValueError(f"stokes: tau_above = {tau[~allowed][0]!r}, allowed is 0 to {self.depth:.6g}")
        full, counted = self._faces
        # Both are proportional within a layer; equal depths give exactly equal results.
        return np.asarray(np.minimum(tau - np.interp(tau, full, full - counted), self.edges[-1]))

    @cached_property
    def _faces(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Depths of the layers' faces, true and in the solver's scale."""
        full = np.cumsum([0.0, *(layer.full_depth for layer in self.layers)])
        return full, np.cumsum([0.0, *(layer.depth for layer in self.layers)])

    def _radiance(
        self, tau: NDArray[np.float64], mu: NDArray[np.float64], phi_rad: NDArray[np.float64], *, upward: bool
    ) -> NDArray[np.float64]:
        """I, Q, U in the meridian frame for requests of shape (R,)."""
        propagation_rad = phi_rad - pi if upward else phi_rad
        total = single_scattering(
            self.layers, mu0=self.mu0, tau_above=tau, mu=mu, phi_rad=propagation_rad, upward=upward
        )
        if self.blocks:
            # Lines of sight that differ only in azimuth, as on a grid of the sky, share the modes.
            lines, line_of = np.unique(tau + 1j * mu, return_inverse=True)
            weights = self._path_weights(lines.real, lines.imag, upward=upward)
            for block in self.blocks:
                modes = _mode_radiance(block, weights, lines.imag if upward else -lines.imag)
                total += _azimuth_sum(block.modes, modes[:, line_of], propagation_rad)
        if upward:
            total[:, 0] += self.ground_radiance * np.exp(-slant(self.edges[-1] - tau, mu))
        return total

    def _path_weights(self, tau: NDArray[np.float64], mu: NDArray[np.float64], *, upward: bool) -> NDArray[np.float64]:
        """Weights of the source at the points of all elements in each request, shape (R, E * 3)."""
        observer, line = tau[:, np.newaxis], mu[:, np.newaxis]
        tops, bottoms = self.edges[:-1], self.edges[1:]
        crossed, between = (bottoms - observer, tops - observer) if upward else (observer - tops, observer - bottoms)
        depths = bottoms - tops
        weights = source_weights(path=slant(depths, line), part=np.clip(crossed / depths, 0.0, 1.0))
        weights *= np.exp(-slant(np.maximum(between, 0.0), line))[..., np.newaxis]
        return (weights[..., ::-1] if upward else weights).reshape(tau.size, 3 * depths.size)


def solve(
    layers: Sequence[Layer],
    *,
    mu0: float,
    albedo: float,
    aerosol: AerosolKind = AerosolKind.DEPOLARIZING,
    nodes: int = 16,
    element_depth: float = 0.02,
    tolerance: float = 1e-6,
    max_orders: int = 500,
) -> Solution:
    """Diffuse polarized light of a plane-parallel atmosphere under the sun, at every level and in every direction.

    Parameters
    ----------
    layers
        Homogeneous layers from top to bottom; may be empty.
    mu0
        Cosine of the solar zenith angle, cos(85 deg) to 1.
    albedo
        Albedo of the Lambertian ground, 0 to 1.
    aerosol
        Effect of aerosol scattering on polarization; spheres need a matrix in every layer with aerosol.
    nodes
        Quadrature directions of each hemisphere, 4 or more; an asymmetry above 0.8 needs more than 16.
    element_depth
        Largest optical depth in which the source is taken as a parabola, above 0.
    tolerance
        Estimated share of the omitted orders in the mean radiance of any level, above 0.
    max_orders
        Limit of orders; a solution that stops there has `converged = False`.

    Raises
    ------
    ValueError
        An argument outside its range.

    Notes
    -----
    Light scattered once is exact. Error against published tables for molecules: 2e-5 of the radiance from the zenith to
    89 degrees, optical depth 0.005 to 2; Henyey-Greenstein g = 0.65: 2e-5, g = 0.76: 2e-4. The unresolved forward peak
    of a scattering matrix counts as unscattered, except in light scattered once (delta-M with TMS, see
    `model.atmosphere.layers`). The number of orders and the time grow with the depth (70 orders at 2, conservative).
    Refraction and curvature are left out.

    References
    ----------
    Lenoble et al., J. Quant. Spectrosc. Radiat. Transfer 107 (2007) 479, doi:10.1016/j.jqsrt.2007.03.010 (method).
    """
    check_scene(mu0=mu0, albedo=albedo)
    _check_settings(nodes=nodes, element_depth=element_depth, tolerance=tolerance, max_orders=max_orders)
    kind = AerosolKind(aerosol)
    alike = merge_alike(layers_of_kind(layers, kind))
    degree = _degree_max(alike, nodes=nodes)
    merged = delta_m_truncated(alike, degree=degree)
    edges, owner = element_edges(merged, element_depth=element_depth, halvings=_HALVINGS)
    node_mu, weights = gauss_nodes(nodes)
    grid = Grid(edges=edges, nodes=node_mu, weights=weights, mu0=mu0)
    coefficients = expansion_coefficients(merged, degree_max=degree, aerosol=kind)[owner]
    blocks: list[_SolvedBlock] = []
    for modes, polarized in _mode_blocks(degree, kind):
        block = _solve_block(
            grid,
            coefficients,
            modes,
            polarized,
            albedo=albedo,
            tolerance=tolerance,
            max_orders=max_orders,
            mean_radiance=_mean_radiance_of(blocks[0].moments) if blocks else None,
        )
        blocks.append(block)
    irradiance = blocks[0].diffuse_irradiance
    return Solution(
        layers=tuple(merged),
        mu0=mu0,
        edges=grid.edges,
        blocks=tuple(
            ModeBlock(modes=block.modes, expansion=_element_expansion(coefficients, block.moments)) for block in blocks
        ),
        ground_radiance=albedo / pi * (_direct_irradiance(grid) + irradiance),
        # The forward peak, treated as beam, is diffuse light.
        diffuse_irradiance=irradiance + _direct_irradiance(grid) - mu0 * exp(-_full_depth(merged) / mu0),
        orders=max(block.orders for block in blocks),
        converged=all(block.tail <= tolerance for block in blocks),
    )


def gauss_nodes(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights for integrals over the cosine in (0, 1): Gauss-Legendre in its square root.

    The square root concentrates nodes at the horizon, where the radiance of thin layers varies within a cosine of the
    order of their optical depth. Polynomials of the cosine are exact up to degree count - 1.
    """
    root, weight = gauss_legendre(count)
    return root**2, 2.0 * weight * root


_HALVINGS = 4  # of the outermost elements, for the source's t log t
_SMALLEST_MU0 = cos(radians(85.0)) - 1e-12  # rounding of a caller's 85 degrees


def check_scene(*, mu0: float, albedo: float) -> None:
    """Raise ValueError for geometry that the equations do not cover."""
    if not mu0 <= 1.0:
        raise ValueError(f"solve: mu0 = {mu0!r}, but the cosine of the solar zenith angle is at most 1")
    if mu0 < _SMALLEST_MU0:
        zenith = degrees(acos(max(mu0, -1.0)))
        raise ValueError(
            f"solve: solar zenith {zenith:.2f} deg (mu0 = {mu0:.5f}), allowed is 0 to 85 deg: "
            "a plane-parallel atmosphere is wrong for a lower sun"
        )
    if not 0.0 <= albedo <= 1.0:
        raise ValueError(f"solve: albedo = {albedo!r}, allowed is 0 to 1")


def _cosine(mu: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return checked cosines, limited to the range."""
    allowed = (mu >= 0.0) & (mu <= 1.0 + _ROUNDING)
    if not np.all(allowed):
        raise ValueError(f"stokes: mu = {mu[~allowed][0]!r}, allowed is 0 (horizon) to 1 (vertical)")
    return np.asarray(np.minimum(mu, 1.0))


def _finite(phi_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Azimuths that were checked."""
    if not np.all(np.isfinite(phi_rad)):
        raise ValueError("stokes: phi_rad must be finite")
    return phi_rad


def single_scattering(
    layers: Sequence[Layer],
    *,
    mu0: float,
    tau_above: NDArray[np.float64],
    mu: NDArray[np.float64],
    phi_rad: NDArray[np.float64],
    upward: bool,
) -> NDArray[np.float64]:
    """Stokes radiance (I, Q, U) of light scattered exactly once, per unit beam irradiance [sr-1]."""
    direction = mu if upward else -mu
    depths = np.array([layer.depth for layer in layers])
    faces = np.cumsum([0.0, *depths])
    # Rounding must not put an observer below the last layer, which would be invisible along the horizon.
    observer = np.minimum(tau_above, faces[-1])
    reach = _radiance_per_source(faces, mu0=mu0, tau_above=observer, mu=mu, upward=upward)
    rayleigh = np.array([layer.tau_rayleigh / layer.depth for layer in layers])
    delta = np.array([layer.delta for layer in layers])
    column = rayleigh_column(mu=direction, beam_mu=-mu0, phi_rad=phi_rad)
    total = (reach @ (rayleigh * delta))[:, np.newaxis] * column
    total[:, 0] += reach @ (rayleigh * (1.0 - delta))
    for shape, strength in _aerosol_strengths(layers):
        light = _aerosol_column(shape, mu=direction, beam_mu=-mu0, phi_rad=phi_rad)
        total += (reach @ strength)[:, np.newaxis] * light
    return np.asarray(total / (4.0 * pi))


def _radiance_per_source(
    faces: NDArray[np.float64],
    *,
    mu0: float,
    tau_above: NDArray[np.float64],
    mu: NDArray[np.float64],
    upward: bool,
) -> NDArray[np.float64]:
    """Share of each layer in the radiance at each observer, shape (R, K)."""
    observer, line = tau_above[:, np.newaxis], mu[:, np.newaxis]
    tops, bottoms = faces[:-1], faces[1:]
    seen_top = np.maximum(tops, observer) if upward else tops
    seen_bottom = bottoms if upward else np.minimum(bottoms, observer)
    seen = np.maximum(seen_bottom - seen_top, 0.0)
    between = np.maximum(seen_top - observer if upward else observer - seen_bottom, 0.0)
    share = beam_share(depth=seen, mu=line, mu0=mu0, upward=upward)
    return share * np.exp(-slant(between, line) - seen_top / mu0)


def beam_share(*, depth: NDArray[np.float64], mu: NDArray[np.float64], mu0: float, upward: bool) -> NDArray[np.float64]:
    """Radiance of a homogeneous depth lit by the beam, per unit of scattered source at its top.

    For downward light (exp(-depth/mu0) - exp(-depth/mu)) / (1 - mu/mu0), in a form that is regular at mu = mu0 and mu =
    0: only an exact 0/0 is replaced by its limit, and digits do not cancel near it.

    Chandrasekhar, Radiative Transfer (1950), section 7 (formal solution for a source exp(-t/mu0)).
    """
    path = slant(depth, mu)
    if upward:
        return np.asarray(-np.expm1(-path - depth / mu0) / (1.0 + mu / mu0))
    contrast = np.broadcast_to(1.0 - mu / mu0, path.shape)
    both = np.exp(-np.minimum(path, depth / mu0))
    # path * contrast = path - depth/mu0; its first factor is infinite at the horizon, where the contrast is 1.
    growth = -np.expm1(-np.abs(np.multiply(path, contrast)))
    share = np.where(np.isfinite(path), path, 0.0)
    np.divide(growth, np.abs(contrast), out=share, where=contrast != 0.0)
    return both * share


def _aerosol_strengths(layers: Sequence[Layer]) -> Iterator[tuple[float | ScatteringMatrix, NDArray[np.float64]]]:
    """Each matrix or asymmetry of the aerosol, and its scattering per extinction in each layer."""
    strength = np.array([layer.tau_aerosol * layer.ssa_aerosol / layer.depth for layer in layers])
    shapes = [layer.g_aerosol if layer.matrix is None else layer.matrix for layer in layers]
    for shape in dict.fromkeys(shapes):
        yield shape, np.where([one == shape for one in shapes], strength, 0.0)


def _aerosol_column(
    shape: float | ScatteringMatrix, *, mu: NDArray[np.float64], beam_mu: float, phi_rad: NDArray[np.float64]
) -> NDArray[np.float64]:
    """First column (I, Q, U) of an aerosol's scattering matrix, shape (R, 3)."""
    if isinstance(shape, ScatteringMatrix):
        return matrix_column(matrix=shape, mu=mu, beam_mu=beam_mu, phi_rad=phi_rad)
    peak = henyey_greenstein(g=shape, mu=mu, beam_mu=beam_mu, phi_rad=phi_rad)
    return np.stack([peak, np.zeros_like(peak), np.zeros_like(peak)], axis=-1)


def _mode_radiance(
    block: ModeBlock, weights: NDArray[np.float64], direction: NDArray[np.float64]
) -> NDArray[np.float64]:
    """I, Q, U of each mode of a block, shape (M, R, 3): along the path in expansion space, then to the direction."""
    modes, elements, points, degrees, stokes_count = block.expansion.shape
    along_path = weights @ block.expansion.reshape(modes, elements * points, degrees * stokes_count)
    expansion = np.moveaxis(along_path.reshape(modes, direction.size, degrees, stokes_count), 1, -1)
    functions = basis_functions(degree_max=degrees - 1, order_max=max(block.modes), mu=direction)
    plain, even, odd = functions[:, min(block.modes) :]
    radiance = np.zeros((modes, direction.size, 3))
    radiance[..., 0] = np.sum(plain * expansion[:, :, 0], axis=1)
    if stokes_count > 1:
        radiance[..., 1] = np.sum(even * expansion[:, :, 1] + odd * expansion[:, :, 2], axis=1)
        radiance[..., 2] = np.sum(odd * expansion[:, :, 1] + even * expansion[:, :, 2], axis=1)
    return 0.5 * radiance


def _azimuth_sum(modes: range, radiance: NDArray[np.float64], phi_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fourier series of modes (M, R, 3): cosines for I and Q, sines for U."""
    order = np.array(modes)[:, np.newaxis]
    factor = np.where(order == 0, 1.0, 2.0)
    cosine, sine = factor * np.cos(order * phi_rad), factor * np.sin(order * phi_rad)
    return np.asarray(np.sum(radiance * np.stack([cosine, cosine, sine], axis=-1), axis=0))


def _check_settings(*, nodes: int, element_depth: float, tolerance: float, max_orders: int) -> None:
    """Raise ValueError for impossible numerical settings."""
    for name, value, least in (("nodes", nodes, 4), ("max_orders", max_orders, 1)):
        if value < least:
            raise ValueError(f"solve: {name} = {value!r}, allowed is {least} or more")
    for name, number in (("element_depth", element_depth), ("tolerance", tolerance)):
        if not 0.0 < number < inf:
            raise ValueError(f"solve: {name} = {number!r}, but it must be finite and above 0")


_RAYLEIGH_DEGREE = 2
_NEGLIGIBLE = 1e-7  # share of light scattered twice in an omitted degree, if the directions resolve as many
_BEYOND_AUREOLE_MU = np.cos(np.radians(np.linspace(10.0, 180.0, 86)))


def _degree_max(layers: Sequence[Layer], *, nodes: int) -> int:
    """Largest degree of the expansion: 2 for molecules; for aerosol until it is negligible, or 2 * nodes - 1.

    Light scattered once needs no expansion, so the square of a coefficient matters. A matrix without its forward peak
    is best truncated at 3/2 of the nodes: products of higher degree are not integrated accurately (rural aerosol, 12
    nodes, error of the sky beyond 20 degrees from the sun: 1.6e-4 there, 6e-4 at 2, 4.6e-4 at 1).
    """
    matrices = [layer.matrix for layer in layers if layer.matrix is not None]
    if matrices:
        longest = max(matrix.coefficients.shape[0] for matrix in matrices) - 1
        return int(max(min(3 * nodes // 2 - 1, longest), _RAYLEIGH_DEGREE))
    degree = _RAYLEIGH_DEGREE
    while degree < 2 * nodes - 1 and _truncation_error(layers, degree=degree) > _NEGLIGIBLE:
        degree += 1
    return degree


def _truncation_error(layers: Sequence[Layer], *, degree: int) -> float:
    """Error, as a share of the mean radiance, from the degrees above the given one in light scattered twice.

    Henyey-Greenstein: the first term left out, (2l + 1) g^(2l) times the albedo of the aerosol, over 1 - g^2 for those
    that follow. A matrix: the largest error, beyond ten degrees from the sun, that delta-M with exact single scattering
    leaves, times half the depth of scattering by the aerosol, which is the share of light scattered twice.

    Nakajima & Tanaka, J. Quant. Spectrosc. Radiat. Transfer 40 (1988) 51, doi:10.1016/0022-4073(88)90031-3.
    """
    depth = sum(layer.tau_aerosol * layer.ssa_aerosol for layer in layers if layer.matrix is not None)
    return max(
        (
            layer.tau_aerosol
            * layer.ssa_aerosol
            / layer.depth
            * _neglected(layer, degree)
            * (1.0 if layer.matrix is None else min(depth / 2.0, 1.0))
            for layer in layers
        ),
        default=0.0,
    )


def _neglected(layer: Layer, degree: int) -> float:
    """Share of light that the aerosol scattered twice in the degrees above the given one."""
    following = degree + 1
    if layer.matrix is None:
        return float((2 * following + 1) * abs(layer.g_aerosol) ** (2 * following) / (1.0 - layer.g_aerosol**2))
    return _aureole_error(layer.matrix, degree, forward_share(layer, degree=degree))


@lru_cache(maxsize=256)
def _aureole_error(matrix: ScatteringMatrix, degree: int, peak: float) -> float:
    """Largest error of the phase function of light scattered twice, ten degrees and more from the sun.

    Light scattered twice has the squares of the coefficients (over 2l + 1); delta-M keeps them up to the degree, and
    beyond TMS gives twice the peak times the coefficient.
    """
    degrees = np.arange(matrix.coefficients.shape[0])
    share = matrix.coefficients[:, 0] / (2 * degrees + 1)
    missing = np.where(degrees <= degree, -(peak**2), share**2 - 2.0 * peak * share)
    functions = matrix_functions(degree_max=degrees.size - 1, mu=_BEYOND_AUREOLE_MU)
    total = np.zeros_like(_BEYOND_AUREOLE_MU)
    for weight, row in zip(missing * (2 * degrees + 1), functions, strict=True):
        total += weight * row[0]
    return float(np.max(np.abs(total)))


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Levels and directions of one run.

    Levels are the faces and the middles of E elements, 2E + 1 of them from the top. Arrays of radiance have the axes
    level, azimuth mode, way (0 down, 1 up), direction, Stokes component; arrays of source have element and point
    (top, middle, bottom of it) in place of level.
    """

    edges: NDArray[np.float64]
    nodes: NDArray[np.float64]
    weights: NDArray[np.float64]
    mu0: float

    @cached_property
    def decay(self) -> NDArray[np.float64]:
        """Extinction from the start of each element to its middle and its far face, shape (2, E, N)."""
        path = slant(self.depths[:, np.newaxis], self.nodes)
        return np.asarray(np.exp(-path * _PARTS[:, np.newaxis, np.newaxis]))

    @cached_property
    def source_weight(self) -> NDArray[np.float64]:
        """Share of the source at the three points of an element in the light at its middle and its far face."""
        path = slant(self.depths[:, np.newaxis], self.nodes)
        return np.moveaxis(source_weights(path=path, part=_PARTS[:, np.newaxis, np.newaxis]), -1, 0)

    @cached_property
    def beam_weight(self) -> NDArray[np.float64]:
        """The same for light scattered from the beam, both ways, with the extinction of the beam."""
        crossed = _PARTS[:, np.newaxis, np.newaxis] * self.depths[:, np.newaxis]
        down, up = (beam_share(depth=crossed, mu=self.nodes, mu0=self.mu0, upward=upward) for upward in (False, True))
        start_of_down = self.edges[:-1, np.newaxis]
        start_of_up = self.edges[1:, np.newaxis] - crossed
        return np.stack([down * np.exp(-start_of_down / self.mu0), up * np.exp(-start_of_up / self.mu0)], axis=2)

    @property
    def depths(self) -> NDArray[np.float64]:
        """Optical depth of each element."""
        return np.diff(self.edges)

    @property
    def direction_mu(self) -> NDArray[np.float64]:
        """Cosine of propagation from the upward vertical of all 2N directions, first those downward."""
        return np.concatenate([-self.nodes, self.nodes])


_PARTS = np.array([0.5, 1.0])  # of an element: its middle and its far face


@dataclass(frozen=True, kw_only=True)
class _SolvedBlock:
    """Azimuth modes solved together, and the sum of their orders."""

    modes: range
    polarized: bool
    moments: NDArray[np.float64]
    diffuse_irradiance: float
    orders: int
    tail: float


@dataclass(frozen=True, kw_only=True)
class Scattering:
    """Scattering of a block of azimuth modes."""

    basis: NDArray[np.float64]
    projector: NDArray[np.float64]
    beam: NDArray[np.float64]
    coefficients: NDArray[np.float64]


def _scattering_of(grid: Grid, coefficients: NDArray[np.float64], *, modes: range, polarized: bool) -> Scattering:
    """Operators of a block of azimuth modes.

    Siewert, Astron. Astrophys. 109 (1982) 195.
    """
    kept = slice(0, 3 if polarized else 1)
    degrees = coefficients.shape[1]
    directions = np.append(grid.direction_mu, -grid.mu0)
    basis = stokes_basis(degree_max=degrees - 1, order_max=max(modes), mu=directions)[min(modes) :, :, kept, :, kept]
    light = basis[:, :, :, :-1]
    stokes_count = light.shape[2]
    flat = light.reshape(len(modes), degrees * stokes_count, -1)
    weights = np.repeat(np.tile(grid.weights, 2), stokes_count)
    return Scattering(
        basis=flat,
        projector=np.ascontiguousarray(np.swapaxes(flat * weights, 1, 2)),
        beam=basis[:, :, :, -1, 0],
        coefficients=coefficients,
    )


def _mean_radiance_of(moments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean radiance over all directions at each level, from an expansion of modes that begin with 0.

    definition: the moment of degree 0 is the integral over the cosine from -1 to 1.
    """
    mean: NDArray[np.float64] = moments[0, :, 0, 0] / 2.0
    return mean


def _solve_block(
    grid: Grid,
    coefficients: NDArray[np.float64],
    modes: range,
    polarized: bool,
    *,
    albedo: float,
    tolerance: float,
    max_orders: int,
    mean_radiance: NDArray[np.float64] | None,
) -> _SolvedBlock:
    """Sum the orders of a block until the estimated tail is below the tolerance or the orders run out.

    The size of an order is relative to the mean radiance at each level from the block of mode 0; None for that block.
    The tail is geometric with the ratio of the last two orders, and infinite if this ratio reaches 1 (it increases
    toward its limit in a conservative atmosphere).
    """
    scattering = _scattering_of(grid, coefficients, modes=modes, polarized=polarized)
    total, irradiance, size, tail, count = np.zeros(1), 0.0, 0.0, inf, 0
    for moments, flux in _orders(grid, scattering, albedo, has_mean=mean_radiance is None):
        count += 1
        total, irradiance = total + moments, irradiance + flux
        reference = _mean_radiance_of(total) if mean_radiance is None else mean_radiance
        size, tail = _progress(moments, reference, size)
        if tail <= tolerance or count == max_orders:
            break
    return _SolvedBlock(
        modes=modes,
        polarized=polarized,
        moments=total,
        diffuse_irradiance=irradiance,
        orders=count,
        tail=tail,
    )


def _orders(
    grid: Grid, scattering: Scattering, albedo: float, *, has_mean: bool
) -> Iterator[tuple[NDArray[np.float64], float]]:
    """Expansion and ground irradiance of each order; the first includes light reflected once by the ground."""
    flux = _direct_irradiance(grid) if has_mean else 0.0
    radiance = _carry_beam(grid, _beam_source(scattering, grid), _ground_light(grid, scattering, albedo * flux))
    while True:
        moments = project(scattering, radiance)
        flux = _irradiance(grid, radiance) if has_mean else 0.0
        yield moments, flux
        source = scattered_source(scattering, moments, grid)
        radiance = _carry(grid, source, _ground_light(grid, scattering, albedo * flux))


def _direct_irradiance(grid: Grid) -> float:
    """Irradiance of the ground by the beam, per unit beam irradiance at the top."""
    return grid.mu0 * exp(-float(grid.edges[-1]) / grid.mu0)


def _carry_beam(grid: Grid, strength: NDArray[np.float64], ground: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance at all levels of light scattered once, and of beam light reflected by the ground."""
    added = grid.beam_weight[:, :, np.newaxis, :, :, np.newaxis] * strength
    steps = np.stack([added[:, :, :, 0], added[:, ::-1, :, 1]], axis=3)
    return _accumulate(grid, steps.reshape(*steps.shape[:-2], ground[0].size), ground)


def _accumulate(grid: Grid, steps: NDArray[np.float64], ground: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance at all levels from what each element adds at its middle and far face, shape (2, E, M, 2, N S).

    Both directions are in the order in which their light passes the elements, and computed together.
    """
    count, modes = steps.shape[1:3]
    by_way = np.stack([grid.decay, grid.decay[:, ::-1]], axis=2)
    decay = _for_each_component(by_way, ground.shape[-1])[:, :, np.newaxis]
    faces = np.zeros((count + 1, *steps.shape[2:]))
    faces[0, :, 1] = ground.reshape(modes, steps.shape[-1])
    for step in range(count):
        np.multiply(faces[step], decay[1, step], out=faces[step + 1])
        faces[step + 1] += steps[1, step]
    middles = faces[:-1] * decay[0]
    middles += steps[0]
    levels = np.empty((2 * count + 1, *steps.shape[2:]))
    levels[::2, :, 0], levels[1::2, :, 0] = faces[:, :, 0], middles[:, :, 0]
    levels[::2, :, 1], levels[1::2, :, 1] = faces[::-1, :, 1], middles[::-1, :, 1]
    return levels.reshape(*levels.shape[:-1], *ground.shape[1:])


def _for_each_component(factors: NDArray[np.float64], stokes_count: int) -> NDArray[np.float64]:
    """Factors of directions, shape (..., N), for every component of each, shape (..., N S).

    Numpy's inner loop then runs over all of these, not over the few components.
    """
    return np.repeat(factors, stokes_count, axis=-1)


def _beam_source(scattering: Scattering, grid: Grid) -> NDArray[np.float64]:
    """Source of the beam of unit irradiance in each element without its extinction, shape (E, M, 2, N, S).

    Chandrasekhar, Radiative Transfer (1950), section 7.
    """
    modes, degrees, stokes_count = scattering.beam.shape
    expansion = _apply_coefficients(scattering.coefficients, scattering.beam[:, np.newaxis])
    source = expansion.reshape(modes, -1, degrees * stokes_count) @ scattering.basis
    shape = (modes, -1, 2, grid.nodes.size, stokes_count)
    return np.moveaxis(source.reshape(shape), 0, 1) / (4.0 * pi)


def _apply_coefficients(coefficients: NDArray[np.float64], expansion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Product of the matrices B_l of `stokes_basis` with an expansion (..., L, S); for S = 1 of a1 alone.

    de Rooij & van der Stap, Astron. Astrophys. 131 (1984) 237.
    """
    if expansion.shape[-1] == 1:
        return coefficients[..., :1] * expansion
    # Contiguous, so that numpy's inner loop runs over degrees and components, not only over three components.
    product = np.ascontiguousarray(coefficients[..., :3]) * expansion
    product[..., 0] += coefficients[..., 3] * expansion[..., 1]
    product[..., 1] += coefficients[..., 3] * expansion[..., 0]
    return product


def _ground_light(grid: Grid, scattering: Scattering, exitance: float) -> NDArray[np.float64]:
    """Radiance that leaves the Lambertian ground, shape (M, N, S): mode 0 and unpolarized.

    `exitance` is albedo times irradiance: Chandrasekhar, Radiative Transfer (1950), section 12.
    """
    light = np.zeros((scattering.beam.shape[0], grid.nodes.size, scattering.beam.shape[2]))
    light[0, :, 0] = exitance / pi
    return light


def project(scattering: Scattering, radiance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Expansion of a radiance over direction, shape (M, levels, L, S), from shape (levels, M, 2, N, S)."""
    levels, modes = radiance.shape[:2]
    flat = radiance.reshape(levels, modes, -1).swapaxes(0, 1)
    return (flat @ scattering.projector).reshape(modes, levels, *scattering.beam.shape[1:])


def _irradiance(grid: Grid, radiance: NDArray[np.float64]) -> float:
    """Downward irradiance at the ground of the radiance of mode 0."""
    return 2.0 * pi * float(np.sum(grid.weights * grid.nodes * radiance[-1, 0, 0, :, 0]))


def scattered_source(scattering: Scattering, moments: NDArray[np.float64], grid: Grid) -> NDArray[np.float64]:
    """Source of light scattered once more, shape (E, 3, M, 2, N, S), from an expansion (M, levels, L, S) at the levels.

    Chandrasekhar, Radiative Transfer (1950), section 7: the source is half the integral over the cosine.
    """
    expansion = _element_expansion(scattering.coefficients, moments)
    modes, elements, points, degrees, stokes_count = expansion.shape
    source = expansion.reshape(modes, elements * points, degrees * stokes_count) @ scattering.basis
    source *= 0.5
    shape = (modes, elements, points, 2, grid.nodes.size, stokes_count)
    return np.moveaxis(source.reshape(shape), 0, 2)


def _element_expansion(coefficients: NDArray[np.float64], moments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Expansion of twice the source at the three points of each element, shape (M, E, 3, L, S)."""
    points = 2 * np.arange(coefficients.shape[0])[:, np.newaxis] + np.arange(3)
    return _apply_coefficients(coefficients[:, np.newaxis], moments[:, points])


def _carry(grid: Grid, source: NDArray[np.float64], ground: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance at all levels from a source in the elements and light from the ground."""
    elements, _, modes, _, nodes, stokes_count = source.shape
    flat = source.reshape(elements, 3, modes, 2, nodes * stokes_count)
    weight = _for_each_component(grid.source_weight, stokes_count)[..., np.newaxis, :]
    steps = np.empty((2, elements, modes, 2, nodes * stokes_count))
    # Each direction in the order in which its light passes elements and points.
    for way, met in ((0, flat[..., 0, :]), (1, flat[::-1, ::-1, :, 1])):
        along = weight if way == 0 else weight[:, :, ::-1]
        np.multiply(along[0], met[:, 0], out=steps[..., way, :])
        steps[..., way, :] += along[1] * met[:, 1]
        steps[..., way, :] += along[2] * met[:, 2]
    return _accumulate(grid, steps, ground)


def _progress(
    moments: NDArray[np.float64], mean_radiance: NDArray[np.float64], size_before: float
) -> tuple[float, float]:
    """Size of an order, and the estimated tail."""
    largest = np.max(np.abs(moments), axis=(0, 2, 3)) / 2.0
    share = np.zeros_like(largest)
    np.divide(largest, mean_radiance, out=share, where=mean_radiance > 0.0)
    size = float(np.max(share))
    if size == 0.0:
        return 0.0, 0.0
    ratio = size / size_before if size_before > 0.0 else 1.0
    return size, size * ratio / (1.0 - ratio) if ratio < 1.0 else inf


def _mode_blocks(degree: int, aerosol: AerosolKind) -> list[tuple[range, bool]]:
    """Azimuth modes solved together, and whether they are polarized.

    Molecules scatter in modes 0 to 2 only: higher ones of a depolarizing aerosol have no polarization. Both kinds are
    solved separately because their orders decrease faster.
    """
    blocks = [(range(_RAYLEIGH_DEGREE + 1), True)]
    if degree > _RAYLEIGH_DEGREE:
        blocks.append((range(_RAYLEIGH_DEGREE + 1, degree + 1), aerosol is not AerosolKind.DEPOLARIZING))
    return blocks


def _full_depth(layers: Sequence[Layer]) -> float:
    """Extinction optical depth of all layers."""
    return sum(layer.full_depth for layer in layers)
