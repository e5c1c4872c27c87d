"""The diffuse radiance of a solved atmosphere at any level and in any direction."""

from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.transfer.depth import slant, source_weights
from model.atmosphere.transfer.first_order import single_scattering
from model.atmosphere.transfer.layers import Layer
from model.atmosphere.transfer.spherical_functions import basis_functions

_CHUNK = 512  # lines of sight evaluated at once, to bound the memory
_ROUNDING = 1e-9  # by which sums of depths and cosines of a caller may overshoot


@dataclass(frozen=True, kw_only=True)
class ModeBlock:
    """Light scattered more than once, in azimuth modes that share their number of Stokes components.

    Attributes
    ----------
    modes
        The azimuth modes.
    expansion
        Expansion of twice the source at the three points of each element, shape (M, E, 3, L, S).
    """

    modes: range
    expansion: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Solution:
    """Diffuse light of one sun position, one ground and one wavelength, at every level and in every direction.

    Attributes
    ----------
    layers
        The layers with alike neighbours joined, top to bottom.
    mu0
        Cosine of the solar zenith angle.
    edges
        Optical depths of the faces of the solver's elements, without what counts as not scattered, shape (E + 1,).
    blocks
        The light scattered more than once.
    ground_radiance
        Radiance that leaves the Lambertian ground, per unit beam irradiance [sr-1].
    diffuse_irradiance
        Downward diffuse irradiance at the ground, per unit beam irradiance.
    orders
        Orders of scattering that were summed.
    converged
        Whether the orders left out are below the tolerance asked for.
    error_estimate
        Estimated error of the radiance as a share of the mean radiance that leaves the atmosphere on the same side: of
        the quadrature in angle and depth, of the expansion and of the orders left out. For views up to 89 degrees; of
        spheres, also ten degrees and more from the sun.
    """

    layers: tuple[Layer, ...]
    mu0: float
    edges: NDArray[np.float64]
    blocks: tuple[ModeBlock, ...]
    ground_radiance: float
    diffuse_irradiance: float
    orders: int
    converged: bool
    error_estimate: float

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
        At the horizon (mu = 0) the limit is returned, the source at the observer. The direct beam is left out.
        At mu = 1 the azimuth still says how the frame is turned.

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
        """Depths that were checked, with an overshoot from rounding taken back, as the solver counts them."""
        allowed = (tau >= 0.0) & (tau <= self.depth * (1.0 + _ROUNDING))
        if not np.all(allowed):
            raise ValueError(f"stokes: tau_above = {tau[~allowed][0]!r}, allowed is 0 to {self.depth:.6g}")
        full, counted = self._faces
        # Both grow in proportion within a layer; where they are the same, so is the result, to the last digit.
        return np.asarray(np.minimum(tau - np.interp(tau, full, full - counted), self.edges[-1]))

    @cached_property
    def _faces(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Depths of the layers' faces, whole and as the solver counts them."""
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
            # Lines of sight that differ in azimuth alone, as on a grid of the sky, share the modes.
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


def _cosine(mu: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cosines that were checked, with an overshoot from rounding taken back."""
    allowed = (mu >= 0.0) & (mu <= 1.0 + _ROUNDING)
    if not np.all(allowed):
        raise ValueError(f"stokes: mu = {mu[~allowed][0]!r}, allowed is 0 (horizon) to 1 (vertical)")
    return np.asarray(np.minimum(mu, 1.0))


def _finite(phi_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Azimuths that were checked."""
    if not np.all(np.isfinite(phi_rad)):
        raise ValueError("stokes: phi_rad must be finite")
    return phi_rad
