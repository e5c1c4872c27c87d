"""The sum over successive orders of scattering, with the rule that stops it."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import exp, inf, pi

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.transfer.scattering import Scattering, beam_source, project, scattered_source
from model.atmosphere.transfer.transport import Grid, Transport, carry, carry_beam


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Setting that the orders of one run share.

    Attributes
    ----------
    grid, transport
        Levels, directions, and the extinction between them.
    albedo
        Albedo of the Lambertian ground, 0 to 1.
    tolerance
        Largest estimated share of all further orders in the mean radiance of any level.
    max_orders
        Where to give up.
    """

    grid: Grid
    transport: Transport
    albedo: float
    tolerance: float
    max_orders: int


@dataclass(frozen=True, kw_only=True)
class OrderSum:
    """The sum of all orders of a block of azimuth modes.

    Attributes
    ----------
    moments
        Expansion of the diffuse radiance at each level, shape (M, 2E + 1, L, S).
    diffuse_irradiance
        Diffuse downward irradiance at the ground; 0 for a block without mode 0.
    orders
        Orders summed.
    tail
        Estimated share of all further orders in the mean radiance, at the level where it is largest.
    ratio
        Size of the last order over that of the one before; 0 where there was nothing to scatter.
    """

    moments: NDArray[np.float64]
    diffuse_irradiance: float
    orders: int
    tail: float
    ratio: float


def sum_orders(setting: Setting, scattering: Scattering, *, mean_radiance: NDArray[np.float64] | None) -> OrderSum:
    """Sum of the orders until the estimated tail is below the tolerance or the orders run out.

    Parameters
    ----------
    setting
        Grid, ground and stopping rule.
    scattering
        The block of modes.
    mean_radiance
        Mean radiance of each level that the tail is measured by, shape (2E + 1,); None for the block of mode 0,
        which knows it itself.

    Notes
    -----
    The tail is taken as geometric, with the ratio of the last two orders. Where that ratio reaches 1 (it grows toward
    its limit from below in a conservative atmosphere), the tail counts as infinite.
    """
    has_mean = mean_radiance is None
    total, irradiance, size, ratio, tail, count = np.zeros(1), 0.0, 0.0, 0.0, inf, 0
    for moments, flux in _orders(setting, scattering, has_mean=has_mean):
        count += 1
        total, irradiance = total + moments, irradiance + flux
        reference = mean_radiance_of(total) if mean_radiance is None else mean_radiance
        size, ratio, tail = _progress(moments, reference, size)
        if tail <= setting.tolerance or count == setting.max_orders:
            break
    return OrderSum(moments=total, diffuse_irradiance=irradiance, orders=count, tail=tail, ratio=ratio)


def mean_radiance_of(moments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean radiance over all directions at each level, from an expansion of modes that begin with 0.

    Parameters
    ----------
    moments
        Expansion of a radiance over direction, shape (M, levels, L, S).

    References
    ----------
    definition: the moment of degree 0 is the integral over the cosine from -1 to 1.
    """
    mean: NDArray[np.float64] = moments[0, :, 0, 0] / 2.0
    return mean


def _orders(setting: Setting, scattering: Scattering, *, has_mean: bool) -> Iterator[tuple[NDArray[np.float64], float]]:
    """Expansion and ground irradiance of each order, without end; the first holds light off the ground once."""
    grid = setting.grid
    flux = direct_irradiance(grid) if has_mean else 0.0
    radiance = carry_beam(setting.transport, beam_source(scattering, grid), ground_light(setting, scattering, flux))
    while True:
        moments = project(scattering, radiance)
        flux = _irradiance(grid, radiance) if has_mean else 0.0
        yield moments, flux
        source = scattered_source(scattering, moments, grid)
        radiance = carry(setting.transport, source, ground_light(setting, scattering, flux))


def _irradiance(grid: Grid, radiance: NDArray[np.float64]) -> float:
    """Downward irradiance at the ground of the radiance of mode 0."""
    return 2.0 * pi * float(np.sum(grid.weights * grid.nodes * radiance[-1, 0, 0, :, 0]))


def _progress(
    moments: NDArray[np.float64], mean_radiance: NDArray[np.float64], size_before: float
) -> tuple[float, float, float]:
    """Size of an order, its ratio to the one before, and the estimated tail."""
    largest = np.max(np.abs(moments), axis=(0, 2, 3)) / 2.0
    share = np.zeros_like(largest)
    np.divide(largest, mean_radiance, out=share, where=mean_radiance > 0.0)
    size = float(np.max(share))
    if size == 0.0:
        return 0.0, 0.0, 0.0
    ratio = size / size_before if size_before > 0.0 else 1.0
    return size, ratio, size * ratio / (1.0 - ratio) if ratio < 1.0 else inf


def ground_light(setting: Setting, scattering: Scattering, irradiance: float) -> NDArray[np.float64]:
    """Radiance that leaves the Lambertian ground under an irradiance, shape (M, N, S): mode 0 and unpolarized.

    Parameters
    ----------
    setting
        Grid and albedo.
    scattering
        For the shapes of modes and Stokes parameters.
    irradiance
        Of the ground, per unit beam irradiance, 0 or more.

    References
    ----------
    Chandrasekhar, Radiative Transfer (1950), section 12: albedo times irradiance over pi.
    """
    light = np.zeros((scattering.beam.shape[0], setting.grid.nodes.size, scattering.beam.shape[2]))
    light[0, :, 0] = setting.albedo * irradiance / pi
    return light


def direct_irradiance(grid: Grid) -> float:
    """Irradiance of the ground by the beam, per unit beam irradiance at the top.

    Parameters
    ----------
    grid
        Levels and the beam's cosine.
    """
    return grid.mu0 * exp(-float(grid.edges[-1]) / grid.mu0)
