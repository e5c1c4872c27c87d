import numpy as np
import pytest

from model.atmosphere.layers import ScatteringMatrix, matrix_column, matrix_functions, wigner_d
from model.atmosphere.mie import (
    aerosol_scattering,
    amplitude_sums,
    angular_grid,
    efficiencies,
    expand,
    sphere_coefficients,
    sphere_sums,
)
from tests.model.atmosphere.mie_cases import REFERENCE, aerosol_of
from tests.model.atmosphere.oracles import rotated_matrix

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
    exact = efficiencies(size_parameter=size, a=a, b=b)
    assert extinction == pytest.approx(exact.extinction[0], rel=1e-12)
    assert series[0, 0] == pytest.approx(exact.scattering[0], rel=1e-11)
    assert series[1, 0] / series[0, 0] / 3 == pytest.approx(exact.asymmetry[0], rel=1e-11, abs=1e-13)
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


def test_functions_are_wigners():
    mu = np.array([-1.0, -0.3, 0.4, 0.99, 1.0])
    rows = list(matrix_functions(degree_max=30, mu=mu))
    assert len(rows) == 31
    for order, second, column in ((0, 0, 0), (2, 2, 1), (2, -2, 2), (0, 2, 3)):
        values = wigner_d(degree_max=30, order_max=2, second=second, mu=mu)[order]
        np.testing.assert_allclose([row[column] for row in rows], values, atol=1e-12)


@pytest.mark.parametrize("degree_max", [0, 1, 2])
def test_short_expansions_end_where_they_should(degree_max):
    assert len(list(matrix_functions(degree_max=degree_max, mu=np.array([0.3])))) == degree_max + 1


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
