"""Scattering matrices: their expansion coefficients, and exactly for light that is scattered once.

A scattering matrix enters the solver twice. Light scattered once needs its first column, exactly, at any angle; light
scattered more often needs its coefficients in Wigner functions. A further kind of aerosol has to bring these two.
"""

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.transfer.layers import Layer
from model.atmosphere.transfer.scattering_matrix import ScatteringMatrix


class AerosolKind(StrEnum):
    """Kind of aerosol by what its scattering does to polarization."""

    DEPOLARIZING = "depolarizing"
    """The scattered light is unpolarized."""
    POLARIZING = "polarizing"
    """Unpolarized light stays so; polarized light keeps its state in and near the forward direction."""
    SPHERES = "spheres"
    """As homogeneous spheres do, by their scattering matrix."""


def layers_of_kind(layers: Sequence[Layer], kind: AerosolKind) -> list[Layer]:
    """Layers with scattering matrices where the kind of aerosol asks for them, and without otherwise.

    Parameters
    ----------
    layers
        From top to bottom.
    kind
        How the aerosol's scattering polarizes.

    Raises
    ------
    ValueError
        Spheres are asked for, but a layer whose aerosol scatters has no matrix.
    """
    if kind is not AerosolKind.SPHERES:
        return [replace(layer, matrix=None) for layer in layers]
    if any(layer.matrix is None and layer.tau_aerosol * layer.ssa_aerosol > 0.0 for layer in layers):
        raise ValueError("aerosol 'spheres' asks for a matrix in every layer whose aerosol scatters")
    return list(layers)


def expansion_coefficients(layers: Sequence[Layer], *, degree_max: int, aerosol: AerosolKind) -> NDArray[np.float64]:
    """Expansion coefficients of each layer's scattering matrix times its single-scattering albedo.

    Parameters
    ----------
    layers
        K layers of depth above 0.
    degree_max
        Largest degree kept.
    aerosol
        What the aerosol does to polarization.

    Returns
    -------
    ndarray, shape (K, degree_max + 1, 4)
        Coefficients a1, a2, a3, b1, defined by F11 = sum a1 d^l_00, F22 + F33 = sum (a2 + a3) d^l_22,
        F22 - F33 = sum (a2 - a3) d^l_2-2, F12 = sum b1 d^l_02, where F11 averages to the albedo over the sphere.

    Notes
    -----
    A layer with a scattering matrix has its coefficients, less the share of a forward peak that counts as not
    scattered (delta-M). Others are Henyey-Greenstein: a1 = (2l + 1) g^l; a polarizing one also has a2 = a3 = a1 from
    l = 2, the simplest choice that is regular at 180 degrees. Both have b1 = 0: real particles polarize by
    themselves, these do not.

    References
    ----------
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


def rayleigh_column(*, mu: NDArray[np.float64], beam_mu: float, phi_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """First column (I, Q, U for unpolarized light) of the scattering matrix of isotropic dipoles, delta = 1.

    Parameters
    ----------
    mu, beam_mu
        Cosines of the directions of propagation from the upward vertical, of the scattered light and of the beam.
    phi_rad
        Azimuth of propagation of the scattered light minus that of the beam, counter-clockwise from above, shape of mu.

    Returns
    -------
    ndarray, shape (..., 3)
        Meridian frame, Q > 0 for E in the vertical plane; I averages to 1 over the sphere.

    Notes
    -----
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
    """First column (I, Q, U for unpolarized light) of a scattering matrix, shape (..., 3); I averages to 1.

    Parameters
    ----------
    matrix
        The scattering matrix in the scattering plane.
    mu, beam_mu, phi_rad
        Directions as in `rayleigh_column`.
    """
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

    Parameters
    ----------
    g
        Asymmetry, -1 < g < 1.
    mu, beam_mu, phi_rad
        Directions as in `rayleigh_column`; g broadcasts against them.

    References
    ----------
    Henyey & Greenstein, Astrophys. J. 93 (1941) 70.
    """
    _, _, cosine = _beam_components(mu, beam_mu, phi_rad)
    values: NDArray[np.float64] = (1.0 - g**2) / (1.0 + g**2 - 2.0 * g * cosine) ** 1.5
    return values


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
