"""Slow, literal formulas that the solver is held against; the product uses none of them."""

import numpy as np
from numpy.typing import NDArray


def frame(u: float, phi_rad: float) -> tuple[NDArray, NDArray, NDArray]:
    """Unit vectors n, e_theta, e_phi of light that travels with cosine u from the upward vertical."""
    s = np.sqrt(1.0 - u * u)
    n = np.array([s * np.cos(phi_rad), s * np.sin(phi_rad), u])
    return (
        n,
        np.array([u * np.cos(phi_rad), u * np.sin(phi_rad), -s]),
        np.array([-np.sin(phi_rad), np.cos(phi_rad), 0.0]),
    )


def mueller(jones: NDArray) -> NDArray:
    """Mueller matrix for (I, Q, U) of a real Jones matrix."""
    (a, b), (c, d) = jones
    return np.array(
        [
            [(a * a + b * b + c * c + d * d) / 2, (a * a - b * b + c * c - d * d) / 2, a * b + c * d],
            [(a * a + b * b - c * c - d * d) / 2, (a * a - b * b - c * c + d * d) / 2, a * b - c * d],
            [a * c + b * d, a * c - b * d, a * d + b * c],
        ]
    )


def rayleigh_matrix(u: float, u_in: float, phi_rad: float, delta: float) -> NDArray:
    """Rayleigh scattering matrix in the meridian frames, from the dipole that the field excites."""
    _, theta, phi = frame(u, phi_rad)
    _, theta_in, phi_in = frame(u_in, 0.0)
    jones = np.array([[theta @ theta_in, theta @ phi_in], [phi @ theta_in, phi @ phi_in]])
    return 1.5 * delta * mueller(jones) + (1.0 - delta) * np.diag([1.0, 0.0, 0.0])


def rotated_matrix(u: float, u_in: float, phi_rad: float, scattering: NDArray) -> NDArray:
    """Scattering matrix in the meridian frames, from the one in the scattering plane, by rotations."""
    n, theta, phi = frame(u, phi_rad)
    n_in, theta_in, phi_in = frame(u_in, 0.0)
    across = np.cross(n_in, n) / np.linalg.norm(np.cross(n_in, n))

    def to_plane(n, theta, phi):
        along = np.cross(across, n)
        return mueller(np.array([[along @ theta, along @ phi], [across @ theta, across @ phi]]))

    return np.linalg.inv(to_plane(n, theta, phi)) @ scattering @ to_plane(n_in, theta_in, phi_in)


def azimuth_modes(matrices: NDArray, count: int) -> NDArray:
    """Modes (count, 3, 3) of a matrix sampled over azimuth (samples, 3, 3): I, Q as cosine and U as sine series."""
    samples = matrices.shape[0]
    angle = 2.0 * np.pi * np.arange(samples) / samples
    modes = np.zeros((count, 3, 3))
    for m in range(count):
        cosine = np.tensordot(np.cos(m * angle), matrices, 1) / samples
        sine = np.tensordot(np.sin(m * angle), matrices, 1) / samples
        modes[m] = cosine
        modes[m, :2, 2], modes[m, 2, :2] = -sine[:2, 2], sine[2, :2]
    return modes


def efficiencies(size: NDArray[np.float64], a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Extinction, scattering and asymmetry of spheres, shape (3, N): Bohren & Huffman (4.61), (4.62), section 4.5."""
    order = np.arange(1, a.shape[1] + 1)
    scattering = 2.0 / size**2 * ((np.abs(a) ** 2 + np.abs(b) ** 2) @ (2 * order + 1))
    neighbours = (a[:, :-1] * a[:, 1:].conj() + b[:, :-1] * b[:, 1:].conj()).real
    cosines = neighbours @ (order * (order + 2) / (order + 1))[:-1]
    cosines = cosines + (a * b.conj()).real @ ((2 * order + 1) / (order * (order + 1)))
    extinction = 2.0 / size**2 * ((a + b).real @ (2 * order + 1))
    return np.stack([extinction, scattering, 4.0 / size**2 * cosines / scattering])
