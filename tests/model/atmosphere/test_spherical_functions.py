from math import factorial

import numpy as np
import pytest

from model.atmosphere.layers import stokes_basis, wigner_d
from tests.model.atmosphere.oracles import azimuth_modes, rotated_matrix

MU = np.array([-1.0, -0.93, -0.3, 0.0, 0.2, 0.77, 1.0])


def explicit_d(degree, m, n, mu):
    """Wigner's sum over factorials, in the sign convention of d^1_10 = -sin / sqrt 2 (degree <= 12: digits enough)."""
    half = np.arccos(mu) / 2.0
    total = np.zeros_like(mu)
    for k in range(2 * degree + 1):
        orders = (degree + m - k, k, degree - n - k, n - m + k)
        if min(orders) < 0:
            continue
        scale = np.sqrt(float(np.prod([float(factorial(degree + s)) for s in (m, -m, n, -n)])))
        term = (-1.0) ** k * scale / np.prod([float(factorial(order)) for order in orders])
        total += (
            term * np.cos(half) ** (2 * degree + m - n - 2 * k) * (-np.sin(half)) ** (n - m + 2 * k) * (-1.0) ** (n - m)
        )
    return total


@pytest.mark.parametrize("second", [0, 2, -2])
def test_wigner_functions_equal_the_explicit_sum(second):
    values = wigner_d(degree_max=10, order_max=8, second=second, mu=MU)
    for m in range(9):
        for degree in range(max(m, 2), 11):
            # Cancellation in the alternating sum leaves about 1e-11 at degree 10.
            np.testing.assert_allclose(
                values[m, degree], explicit_d(degree, m, second, MU), atol=1e-10, err_msg=f"l={degree} m={m}"
            )


def test_functions_below_their_lowest_degree_are_zero():
    values = wigner_d(degree_max=4, order_max=6, second=2, mu=MU)
    assert not np.any(values[:, :2])
    assert not np.any(values[5:])


def test_functions_of_high_degree_stay_orthonormal():
    # Exact: the integral of d^l d^l over the cosine is 2/(2l+1), and 40 Gauss nodes integrate degree 79.
    nodes, weights = np.polynomial.legendre.leggauss(40)
    values = wigner_d(degree_max=38, order_max=17, second=2, mu=nodes)[17, 17:]
    gram = (values * weights) @ values.T
    np.testing.assert_allclose(gram, np.diag(2.0 / (2 * np.arange(17, 39) + 1)), atol=1e-13)


def test_basis_separates_an_arbitrary_scattering_matrix():
    # Random coefficients of degree 0..5; their matrix is rotated from the scattering plane to the meridian frames.
    coefficients = np.random.default_rng(5).normal(size=(6, 4))
    coefficients[:2, 1:] = 0.0  # those functions begin at degree 2
    u, u_in, samples = 0.4, -0.7, 16
    azimuths = 2.0 * np.pi * np.arange(samples) / samples + 1e-7  # off the plane where the normal is undefined
    full = np.array([rotated_matrix(u, u_in, phi, plane_matrix(coefficients, u, u_in, phi)) for phi in azimuths])
    basis = stokes_basis(degree_max=5, order_max=5, mu=np.array([u, u_in]))
    a1, a2, a3, b1 = coefficients.T
    middle = np.zeros((6, 3, 3))
    middle[:, 0, 0], middle[:, 1, 1], middle[:, 2, 2] = a1, a2, a3
    middle[:, 0, 1] = middle[:, 1, 0] = b1
    modes = np.einsum("mlis,lij,mljt->mst", basis[:, :, :, 0], middle, basis[:, :, :, 1])
    # The shift of the azimuths by 1e-7 enters times the mode number and the size of the matrix (about 10).
    np.testing.assert_allclose(modes, azimuth_modes(full, 6), atol=1e-5)


def plane_matrix(coefficients, u, u_in, phi_rad):
    """F11, F12, F22, F33 in the scattering plane from their definitions as sums of Wigner functions."""
    cosine = np.sqrt((1 - u * u) * (1 - u_in * u_in)) * np.cos(phi_rad) + u * u_in
    a1, a2, a3, b1 = coefficients.T
    d = {
        (m, n): np.array(
            [explicit_d(degree, m, n, np.array([cosine]))[0] if degree >= m else 0.0 for degree in range(6)]
        )
        for m, n in ((0, 0), (0, 2), (2, 2), (2, -2))
    }
    f11, f12 = a1 @ d[0, 0], b1[2:] @ d[0, 2][2:]
    plus, minus = (a2 + a3)[2:] @ d[2, 2][2:], (a2 - a3)[2:] @ d[2, -2][2:]
    return np.array([[f11, f12, 0.0], [f12, (plus + minus) / 2, 0.0], [0.0, 0.0, (plus - minus) / 2]])
