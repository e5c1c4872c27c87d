"""Light of the beam that has been scattered once: closed forms of depth, the exact scattering matrix in angle."""

from collections.abc import Iterator, Sequence
from math import pi

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.transfer.depth import slant
from model.atmosphere.transfer.layers import Layer
from model.atmosphere.transfer.phase import henyey_greenstein, matrix_column, rayleigh_column
from model.atmosphere.transfer.scattering_matrix import ScatteringMatrix


def beam_share(*, depth: NDArray[np.float64], mu: NDArray[np.float64], mu0: float, upward: bool) -> NDArray[np.float64]:
    """Radiance that a homogeneous depth lit by the beam adds, per unit of scattered source at its top.

    Parameters
    ----------
    depth
        Optical depth crossed, 0 or more.
    mu
        Cosine of the line of sight from the vertical, 0 to 1; broadcasts against depth.
    mu0
        Cosine of the solar zenith angle, above 0.
    upward
        Whether the light leaves at the top (True) or at the bottom.

    Notes
    -----
    For downward light (exp(-depth/mu0) - exp(-depth/mu)) / (1 - mu/mu0), written so that mu = mu0 and mu = 0 are no
    special points: only an exact 0/0 is replaced by its limit, and digits do not cancel beside it.

    References
    ----------
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


def single_scattering(
    layers: Sequence[Layer],
    *,
    mu0: float,
    tau_above: NDArray[np.float64],
    mu: NDArray[np.float64],
    phi_rad: NDArray[np.float64],
    upward: bool,
) -> NDArray[np.float64]:
    """Stokes radiance (I, Q, U) of light scattered exactly once, per unit beam irradiance [sr-1].

    Parameters
    ----------
    layers
        Top to bottom, each of depth above 0.
    mu0
        Cosine of the solar zenith angle.
    tau_above
        Optical depth above the observer, shape (R,).
    mu
        Cosine of the line of sight from the vertical, shape (R,), 0 to 1.
    phi_rad
        Azimuth of propagation of the light minus that of the beam, counter-clockwise from above, shape (R,).
    upward
        Whether the light travels upward.

    Returns
    -------
    ndarray, shape (R, 3)
        Meridian frame, Q > 0 for E in the vertical plane.
    """
    direction = mu if upward else -mu
    depths = np.array([layer.depth for layer in layers])
    faces = np.cumsum([0.0, *depths])
    # An observer that rounding puts below the last layer would see nothing of it along the horizon.
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
