"""Solution of the atmosphere by sasktran2, as an independent check. The package is imported at the first use."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from math import exp, pi
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.layers import (
    AerosolKind,
    Layer,
    element_edges,
    expansion_coefficients,
    layers_of_kind,
    merge_alike,
    peak_irradiance,
    with_truncated_matrix,
)
from model.atmosphere.sky import MATRIX_DEGREE, sky_irradiance
from model.atmosphere.solver import check_scene

# Height is proportional to optical depth, the only relevant quantity for plane layers. Planes are emulated by a sphere
# so large that 80 degrees from the vertical the air is thicker by 3e-4; a larger one, or a thinner shell, would lose
# digits of its path lengths.
_THICKNESS_M, _RADIUS_M = 2e4, 1e9
_LOWEST_SKY_MU = 1e-3
_ALMOST_VERTICAL = 1.0 - 1e-9  # at exactly 1 its frame is not turned with the azimuth
_FEWEST_MOMENTS = 64
_HENYEY_GREENSTEIN_MOMENTS = 128
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Sasktran2Solution:
    """Diffuse light by sasktran2; a `model.atmosphere.sky.DiffuseLight`.

    Attributes
    ----------
    layers
        Top to bottom.
    mu0
        Cosine of the solar zenith angle.
    albedo
        Albedo of the Lambertian ground.
    aerosol
        Effect of the aerosol on polarization.
    streams
        Directions of its discrete ordinates.
    element_depth
        Largest optical depth between its levels.
    """

    layers: tuple[Layer, ...]
    mu0: float
    albedo: float
    aerosol: AerosolKind
    streams: int
    element_depth: float

    @property
    def depth(self) -> float:
        """Extinction optical depth."""
        return sum(layer.full_depth for layer in self.layers)

    @property
    def converged(self) -> bool:
        """True: it does not iterate."""
        return True

    @cached_property
    def diffuse_irradiance(self) -> float:
        """Downward diffuse irradiance at the ground: of the sky without its forward peak, and of the peak."""
        smooth = with_truncated_matrix(self.layers, degree=MATRIX_DEGREE)
        return sky_irradiance(replace(self, layers=tuple(smooth))) + peak_irradiance(self.layers, smooth, mu0=self.mu0)

    @property
    def ground_radiance(self) -> float:
        """Radiance that leaves the Lambertian ground [sr-1]."""
        if self.albedo == 0.0:
            return 0.0
        return self.albedo / pi * (self.mu0 * exp(-self.depth / self.mu0) + self.diffuse_irradiance)

    def stokes(
        self, tau_above: ArrayLike, mu: ArrayLike, phi_rad: ArrayLike, *, looking: Literal["up", "down"]
    ) -> NDArray[np.float64]:
        """Stokes radiance S0, S1, S2 of the diffuse light, per unit beam irradiance [sr-1].

        Parameters
        ----------
        tau_above, mu, phi_rad, looking
            As in `model.atmosphere.solver.Solution.stokes`; looking down, mu above 0.

        Raises
        ------
        ValueError
            An argument outside its range.

        Notes
        -----
        Looking up needs its spherical mode, which has interpolation errors up to 1.6 % in light scattered more than
        once, 2 to 10 degrees from the zenith; looking down uses the accurate plane-parallel mode. Its sphere has no
        flat horizon: nearer than 0.06 deg the sky at 0.06 deg is returned, wrong by up to 2e-2. Looking down from less
        than 1 deg above the horizon is wrong by a half.

        References
        ----------
        Zawada et al., sasktran2 (https://github.com/usask-arg/sasktran2).
        """
        tau, cosine, phi = (np.asarray(values, dtype=float) for values in np.broadcast_arrays(tau_above, mu, phi_rad))
        _check_rays(tau / self.depth, cosine, phi, looking)
        if looking == "up":
            cosine = np.maximum(cosine, _LOWEST_SKY_MU)
        height_m = (1.0 - np.minimum(tau.ravel() / self.depth, 1.0)) * _THICKNESS_M
        rays = np.stack([height_m, np.minimum(cosine.ravel(), _ALMOST_VERTICAL), phi.ravel()])
        total = np.zeros((rays.shape[1], 3))
        # It returns nothing for a ray without air: the sky above is black, the ground below is known.
        if looking == "up":
            crossing = height_m < _THICKNESS_M
        else:
            crossing = height_m > 0.0
            total[~crossing, 0] = self.ground_radiance
        if np.any(crossing):
            total[crossing] = self._radiance(rays[:, crossing], looking)
        return total.reshape(*tau.shape, 3)

    def _radiance(self, rays: NDArray[np.float64], looking: Literal["up", "down"]) -> NDArray[np.float64]:
        """Radiance along rays of height, cosine and azimuth, shape (R, 3)."""
        sk = _package()
        config = _configured(sk, self.streams, self._moments)
        heights_m, owner = self._levels()
        mode = sk.GeometryType.Spherical if looking == "up" else sk.GeometryType.PlaneParallel
        geometry = sk.Geometry1D(self.mu0, 0.0, _RADIUS_M, heights_m, sk.InterpolationMethod.LinearInterpolation, mode)
        views = sk.ViewingGeometry()
        for height, mu, phi in rays.T:
            if looking == "up":
                views.add_ray(sk.SolarAnglesObserverLocation(self.mu0, phi, mu, height))
            else:
                # Its azimuth is that of the light's propagation.
                views.add_ray(sk.GroundViewingSolar(self.mu0, phi - pi, mu, height))
        air = sk.Atmosphere(geometry, config, calculate_derivatives=False, numwavel=1)
        self._fill(air, owner)
        try:
            light = sk.Engine(config, geometry, views).calculate_radiance(air)["radiance"].to_numpy()[0]
        except RuntimeError as error:
            raise ValueError(
                f"sasktran2 refuses {heights_m.size} levels of {self.depth:.3g} optical depth: {error}"
            ) from error
        # Q > 0 there is vertical vibration; U has our sign.
        return np.asarray(light * np.array([1.0, -1.0, 1.0]) + 0.0)

    @property
    def _moments(self) -> int:
        """Length of the expansion that single scattering needs: cut short, the sky is wrong by percents."""
        lengths = [len(layer.matrix.coefficients) for layer in self.layers if layer.matrix is not None]
        return max([_HENYEY_GREENSTEIN_MOMENTS if not lengths else _FEWEST_MOMENTS, *lengths])

    def _levels(self) -> tuple[NDArray[np.float64], NDArray[np.int_]]:
        """Heights [m] and layers of its levels, upward: the middles of elements, between which it is linear."""
        edges, owner = element_edges(self.layers, element_depth=self.element_depth, halvings=0)
        tau = np.concatenate([edges[:1], (edges[1:] + edges[:-1]) / 2.0, edges[-1:]])
        heights = (1.0 - tau / edges[-1]) * _THICKNESS_M
        return heights[::-1], np.concatenate([owner[:1], owner, owner[-1:]])[::-1]

    def _fill(self, air: Any, owner: NDArray[np.int_]) -> None:
        """Extinction, albedo and scattering matrix at its levels, and the ground."""
        coefficients = expansion_coefficients(self.layers, degree_max=self._moments - 1, aerosol=self.aerosol)
        albedos = coefficients[:, 0, 0]
        scale = np.where(albedos > 0.0, albedos, 1.0)
        series = (coefficients / scale[:, np.newaxis, np.newaxis])[owner].transpose(2, 1, 0)
        series[0, 0] = 1.0
        air.storage.total_extinction[:, 0] = self.depth / _THICKNESS_M
        air.storage.ssa[:, 0] = albedos[owner]
        for name, values in zip(("a1", "a2", "a3", "b1"), series * [[[1.0]], [[1.0]], [[1.0]], [[-1.0]]], strict=True):
            getattr(air.leg_coeff, name)[:, :, 0] = values
        air.surface.albedo[:] = self.albedo


def sasktran2_solution(
    layers: Sequence[Layer],
    *,
    mu0: float,
    albedo: float,
    aerosol: AerosolKind = AerosolKind.DEPOLARIZING,
    nodes: int = 8,
    element_depth: float = 0.01,
    tolerance: float = 1e-6,
) -> Sasktran2Solution:
    """Light of an atmosphere by sasktran2, in place of `model.atmosphere.solver.solve`.

    Parameters
    ----------
    layers, mu0, albedo, aerosol
        As in `solve`.
    nodes
        Half the number of its streams; fewer than 8 are raised to 8.
    element_depth
        Largest optical depth between its levels; more than 0.01 is lowered to that.
    tolerance
        As in `solve`, above 0; without effect, since this does not iterate.

    Raises
    ------
    ValueError
        An argument outside its range, no air, or the package is not installed.

    Notes
    -----
    Accurate settings: exact single scattering with the whole expansion, delta-M for the rest, levels as dense as its
    linear interpolation needs. Ten to a hundred times slower than `solve`.

    References
    ----------
    Zawada et al., sasktran2 (https://github.com/usask-arg/sasktran2).
    """
    check_scene(mu0=mu0, albedo=albedo)
    kind = AerosolKind(aerosol)
    merged = merge_alike(layers_of_kind(layers, kind))
    if not merged:
        raise ValueError("sasktran2: there is no air to solve")
    if not tolerance > 0.0:
        raise ValueError(f"sasktran2: tolerance = {tolerance!r}, but it must be above 0")
    _package()
    return Sasktran2Solution(
        layers=tuple(merged),
        mu0=mu0,
        albedo=albedo,
        aerosol=kind,
        streams=2 * max(nodes, 8),
        element_depth=min(element_depth, 0.01),
    )


def _check_rays(
    share: NDArray[np.float64],
    mu: NDArray[np.float64],
    phi_rad: NDArray[np.float64],
    looking: Literal["up", "down"],
) -> None:
    """Refuse rays that do not run in the air; share of the depth above the observer, with room for rounding."""
    if not np.all((share >= 0.0) & (share <= 1.0 + _ROUNDING)):
        raise ValueError("stokes: tau_above must be 0 to the depth of the air")
    if not np.all((mu >= 0.0) & (mu <= 1.0 + _ROUNDING)):
        raise ValueError("stokes: mu must be 0 (the horizon) to 1")
    if looking == "down" and np.any(mu == 0.0):
        raise ValueError("stokes: mu must be above 0 looking down, because sasktran2 has no horizon")
    if not np.all(np.isfinite(phi_rad)):
        raise ValueError("stokes: phi_rad must be finite")


def _package() -> Any:
    """Import the package."""
    try:
        return import_module("sasktran2")
    except ImportError as error:
        raise ValueError("engine 'sasktran2' is not installed: pip install sasktran2") from error


def _configured(sk: Any, streams: int, moments: int) -> Any:
    """Return settings of its engine."""
    config = sk.Config()
    config.num_stokes = 3
    config.num_streams = streams
    config.num_singlescatter_moments = moments
    config.delta_m_scaling = True
    config.multiple_scatter_source = sk.MultipleScatterSource.DiscreteOrdinates
    config.single_scatter_source = sk.SingleScatterSource.Exact
    return config
