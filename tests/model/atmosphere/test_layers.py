"""Layers and their scattering matrices against explicit sums."""

from math import factorial

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.atmosphere.layers import (
    AerosolKind,
    Layer,
    ScatteringMatrix,
    element_edges,
    expansion_coefficients,
    henyey_greenstein,
    matrix_column,
    merge_alike,
    rayleigh_column,
    slant,
    source_weights,
    stokes_basis,
    wigner_d,
)
from model.atmosphere.mie import (
    aerosol_scattering,
    amplitude_sums,
    angular_grid,
    expand,
    sphere_coefficients,
    sphere_sums,
)
from tests.model.atmosphere.mie_cases import REFERENCE, aerosol_of
from tests.model.atmosphere.oracles import azimuth_modes, efficiencies, rayleigh_matrix, rotated_matrix


def test_alike_neighbours_are_joined():
    thin, other = Layer(0.1, 0.05, 0.9, 0.6, 1.0), Layer(0.2, 0.0, 0.0, 0.0, 1.0)
    merged = merge_alike([thin, thin, other, thin])
    assert [layer.depth for layer in merged] == pytest.approx([0.3, 0.2, 0.15])
    assert merged[0].tau_aerosol == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ((-0.1, 0.0, 0.0, 0.0, 0.0), "tau_rayleigh"),
        ((0.0, np.inf, 0.0, 0.0, 0.0), "tau_aerosol"),
        ((0.0, 0.1, 1.1, 0.0, 0.0), "ssa_aerosol"),
        ((0.0, 0.1, 0.9, 1.0, 0.0), "g_aerosol"),
        ((0.0, 0.1, 0.9, 0.5, np.nan), "delta"),
    ],
)
def test_impossible_layers_are_refused(values, named):
    with pytest.raises(ValueError, match=named):
        Layer(*values)


@pytest.mark.parametrize("part", [0.3, 0.5, 1.0])
@pytest.mark.parametrize("path", [1e-9, 1e-3, 0.4, 0.999, 1.001, 3.0, 50.0])
def test_weights_integrate_a_parabola_exactly(path, part):
    with mpmath.workdps(40):
        x, u = mpmath.mpf(path), mpmath.mpf(part)
        basis = (lambda v: 1 - 3 * v + 2 * v * v, lambda v: 4 * v - 4 * v * v, lambda v: 2 * v * v - v)
        exact = [float(mpmath.quad(lambda v, q=q: x * mpmath.exp(-x * (u - v)) * q(v), [0, u / 2, u])) for q in basis]
    weights = source_weights(path=np.array(path), part=np.array(part))
    # A few roundings of terms whose sum is at most the source times (1 - exp(-path)).
    np.testing.assert_allclose(weights, exact, rtol=2e-13, atol=2e-14 * (1 - np.exp(-path)))


def test_at_the_horizon_only_the_near_face_counts():
    np.testing.assert_allclose(source_weights(path=np.array(np.inf), part=np.array(1.0)), [0.0, 0.0, 1.0])


def test_nothing_crossed_adds_nothing():
    np.testing.assert_array_equal(source_weights(path=np.array(np.inf), part=np.array(0.0)), np.zeros(3))


def test_slant_depth_has_its_limits():
    np.testing.assert_array_equal(
        slant(np.array([0.0, 0.2, 0.2]), np.array([0.0, 0.0, 0.5])), np.array([0.0, np.inf, 0.4])
    )


def test_elements_are_as_fine_as_asked_and_keep_their_layer():
    layers = [Layer(0.1, 0.0, 0.0, 0.0, 1.0), Layer(0.25, 0.0, 0.0, 0.0, 0.5)]
    edges, owner = element_edges(layers, element_depth=0.06, halvings=2)
    assert np.all(np.diff(edges) <= 0.06)
    assert edges[[0, -1]] == pytest.approx([0.0, 0.35])
    assert np.sum(np.diff(edges)[owner == 0]) == pytest.approx(0.1)
    assert edges[1] == pytest.approx(0.05 / 4)


def test_a_single_element_is_halved_toward_both_faces():
    edges, _ = element_edges([Layer(0.01, 0.0, 0.0, 0.0, 1.0)], element_depth=0.02, halvings=2)
    steps = np.diff(edges)
    assert np.all(steps > 0.0)
    assert steps[0] == pytest.approx(0.0025)
    assert steps[-1] == pytest.approx(0.01 / 8)


MOLECULES = Layer(0.3, 0.0, 0.0, 0.0, 0.958)


@settings(deadline=None, max_examples=50)
@given(u=st.floats(-1.0, 1.0), u_in=st.floats(-1.0, 1.0), phi_rad=st.floats(-7.0, 7.0, allow_subnormal=False))
def test_rayleigh_column_is_that_of_the_dipole(u, u_in, phi_rad):
    column = rayleigh_column(mu=np.array(u), beam_mu=u_in, phi_rad=np.array(phi_rad))
    np.testing.assert_allclose(column, rayleigh_matrix(u, u_in, phi_rad, 1.0)[:, 0], atol=1e-14)


def test_rayleigh_expansion_gives_the_modes_of_the_dipole_matrix():
    u, u_in, samples = 0.35, -0.8, 8  # 8 azimuths resolve the modes 0..2 exactly
    full = np.array(
        [rayleigh_matrix(u, u_in, phi, MOLECULES.delta) for phi in 2 * np.pi * np.arange(samples) / samples]
    )
    a1, a2, a3, b1 = expansion_coefficients([MOLECULES], degree_max=2, aerosol=AerosolKind.DEPOLARIZING)[0].T
    basis = stokes_basis(degree_max=2, order_max=2, mu=np.array([u, u_in]))
    middle = np.zeros((3, 3, 3))
    middle[:, 0, 0], middle[:, 1, 1], middle[:, 2, 2] = a1, a2, a3
    middle[:, 0, 1] = middle[:, 1, 0] = b1
    modes = np.einsum("mlis,lij,mljt->mst", basis[:, :, :, 0], middle, basis[:, :, :, 1])
    np.testing.assert_allclose(modes, azimuth_modes(full, 3), atol=1e-14)


def test_aerosol_expansion_sums_to_henyey_greenstein():
    layer = Layer(0.0, 0.2, 0.9, 0.6, 1.0)
    a1 = expansion_coefficients([layer], degree_max=60, aerosol=AerosolKind.DEPOLARIZING)[0, :, 0]
    cosine = np.linspace(-1.0, 1.0, 9)
    series = np.polynomial.legendre.legval(cosine, a1)
    exact = 0.9 * henyey_greenstein(g=np.array(0.6), mu=cosine, beam_mu=1.0, phi_rad=np.zeros(9))
    # First term left out: 123 * 0.6^61 = 4e-12, the rest 2.5 times that.
    np.testing.assert_allclose(series, exact, atol=2e-11)


def test_only_a_polarizing_aerosol_passes_polarization_on():
    layer = Layer(0.0, 0.3, 1.0, 0.6, 1.0)
    depolarizing = expansion_coefficients([layer], degree_max=4, aerosol=AerosolKind.DEPOLARIZING)[0]
    polarizing = expansion_coefficients([layer], degree_max=4, aerosol=AerosolKind.POLARIZING)[0]
    assert not np.any(depolarizing[:, 1:])
    np.testing.assert_allclose(polarizing[2:, 1], polarizing[2:, 0])
    np.testing.assert_allclose(polarizing[2:, 2], polarizing[2:, 0])


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


RAYLEIGH = ScatteringMatrix(
    coefficients=np.array([[1.0, 0, 0, 0], [0, 0, 0, 0], [0.5, 3.0, 0, -np.sqrt(6.0) / 2.0]]), error_estimate=0.0
)
ANGLE_RAD = np.linspace(0.0, np.pi, 41)


@pytest.fixture(scope="module")
def bimodal():
    case = next(case for case in REFERENCE["distributions"] if case["name"] == "bimodal")
    return aerosol_scattering(aerosol_of(case), wavelength_m=case["wavelength_m"], tolerance=1e-6).matrix


@pytest.mark.parametrize(("x", "n", "k"), [(0.01, 1.5, 0.01), (5.0, 1.5, 0.0), (60.0, 1.33, 0.001)])
def test_the_expansion_sums_to_the_matrix_of_the_amplitudes(x, n, k):
    size = np.array([x])
    grid = angular_grid(largest_size_parameter=x)
    extinction, sums = sphere_sums(grid, size_parameter=size, weight=np.ones(1), index=complex(n, k))
    series = expand(grid, sums)
    a, b = sphere_coefficients(size_parameter=size, n=n, k=k)
    expected = efficiencies(size, a, b)[:, 0]
    assert extinction == pytest.approx(expected[0], rel=1e-12)
    assert series[0, 0] == pytest.approx(expected[1], rel=1e-11)
    assert series[1, 0] / series[0, 0] / 3 == pytest.approx(expected[2], rel=1e-11, abs=1e-13)
    plus, minus = (part[0] for part in amplitude_sums(a, b, np.cos(ANGLE_RAD)))
    s1, s2 = (plus + minus) / 2, (plus - minus) / 2
    wanted = np.array([abs(s1) ** 2 + abs(s2) ** 2, 2 * (s1 * s2.conj()).real, abs(s2) ** 2 - abs(s1) ** 2])
    wanted *= 2.0 / x**2 / series[0, 0]
    f11, f22, f33, f12 = ScatteringMatrix(coefficients=series / series[0, 0], error_estimate=0.0).matrix(ANGLE_RAD)
    # Some hundred terms of a size up to the forward value are summed.
    tolerance = 1e-11 * np.max(wanted[0])
    for found, element in ((f11, wanted[0]), (f22, wanted[0]), (f33, wanted[1]), (f12, wanted[2])):
        np.testing.assert_allclose(found, element, atol=tolerance)


def test_no_group_of_sizes_differs_from_another():
    # A sphere just above the limit of a group has more angles than one just below; both are exact.
    sizes = np.array([3.3, 3.4, 3.5, 6.0])
    grid = angular_grid(largest_size_parameter=6.0)
    together = expand(grid, sphere_sums(grid, size_parameter=sizes, weight=np.ones(4), index=1.5 + 0.1j)[1])
    apart = sum(
        expand(grid, sphere_sums(grid, size_parameter=np.array([x]), weight=np.ones(1), index=1.5 + 0.1j)[1])
        for x in sizes
    )
    np.testing.assert_allclose(together, apart, atol=1e-12 * together[0, 0])


def test_the_sampled_column_is_the_sum_of_the_series(bimodal):
    angle = np.random.default_rng(3).uniform(0.0, np.pi, 400)
    exact = bimodal.matrix(angle)
    f11, f12 = bimodal.first_column(angle)
    # Sixth-order interpolation at four samples per degree of the highest term, which is small itself.
    np.testing.assert_allclose(f11, exact[0], atol=1e-6 * np.max(exact[0]))
    np.testing.assert_allclose(f12, exact[3], atol=1e-6 * np.max(exact[0]))


def test_the_ends_of_the_angles_are_no_special_places(bimodal):
    ends = np.array([0.0, np.pi])
    f11, f12 = bimodal.first_column(ends)
    np.testing.assert_allclose(f11, bimodal.matrix(ends)[0], rtol=1e-9)
    np.testing.assert_allclose(f12, 0.0, atol=1e-9 * f11[0])


def test_dipoles_as_a_matrix_polarize_as_they_do():
    f11, f22, f33, f12 = RAYLEIGH.matrix(ANGLE_RAD)
    cosine = np.cos(ANGLE_RAD)
    np.testing.assert_allclose(f11, 0.75 * (1 + cosine**2), atol=1e-14)
    np.testing.assert_allclose(f22, f11, atol=1e-14)
    np.testing.assert_allclose(f33, 1.5 * cosine, atol=1e-14)
    np.testing.assert_allclose(f12, -0.75 * np.sin(ANGLE_RAD) ** 2, atol=1e-14)


@pytest.mark.parametrize(("u", "u_in", "phi_rad"), [(0.3, -0.8, 1.0), (-0.6, -0.5, 2.5), (-0.9, -0.2, -0.4)])
def test_the_column_in_meridian_frames_is_the_rotated_matrix(bimodal, u, u_in, phi_rad):
    cosine = np.sqrt((1 - u * u) * (1 - u_in * u_in)) * np.cos(phi_rad) + u * u_in
    f11, f22, f33, f12 = bimodal.matrix(np.array([np.arccos(cosine)]))[:, 0]
    plane = np.array([[f11, f12, 0.0], [f12, f22, 0.0], [0.0, 0.0, f33]])
    found = matrix_column(matrix=bimodal, mu=np.array([u]), beam_mu=u_in, phi_rad=np.array([phi_rad]))[0]
    np.testing.assert_allclose(found, rotated_matrix(u, u_in, phi_rad, plane)[:, 0], atol=1e-5 * f11)


@pytest.mark.parametrize("direction", [-0.6, 0.6])
def test_light_straight_on_or_back_has_no_preferred_plane(bimodal, direction):
    phi = np.array([0.0 if direction < 0 else np.pi])
    column = matrix_column(matrix=bimodal, mu=np.array([direction]), beam_mu=-0.6, phi_rad=phi)[0]
    assert column[0] > 0.0
    np.testing.assert_allclose(column[1:], 0.0, atol=1e-6 * column[0])


@pytest.mark.parametrize("coefficients", [np.ones((3, 3)), np.zeros((2, 4)), np.array([[2.0, 0, 0, 0]]), np.ones(4)])
def test_a_matrix_that_is_not_normalized_is_refused(coefficients):
    with pytest.raises(ValueError, match="begin with 1"):
        ScatteringMatrix(coefficients=coefficients, error_estimate=0.0)
