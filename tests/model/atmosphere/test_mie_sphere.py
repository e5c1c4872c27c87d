import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.atmosphere.mie import amplitude_sums, efficiencies, sphere_coefficients
from tests.model.atmosphere.mie_cases import REFERENCE

MU = np.array(REFERENCE["mu"])


def one_sphere(x, n, k, mu=MU):
    """Extinction, scattering, asymmetry and both amplitudes of one sphere."""
    size = np.array([x])
    a, b = sphere_coefficients(size_parameter=size, n=n, k=k)
    result = efficiencies(size_parameter=size, a=a, b=b)
    plus, minus = amplitude_sums(a, b, mu)
    numbers = [float(value[0]) for value in (result.extinction, result.scattering, result.asymmetry)]
    return np.array(numbers), (plus[0] + minus[0]) / 2, (plus[0] - minus[0]) / 2


@pytest.mark.parametrize("case", REFERENCE["spheres"], ids=lambda case: f"x={case['x']} m={case['n']}+{case['k']}i")
def test_efficiencies_are_those_of_the_literal_series_and_of_miepython(case):
    numbers, _, _ = one_sphere(case["x"], case["n"], case["k"])
    # Thirteen digits are stored; a thousand terms round to some 1e-13 of the largest. The asymmetry of a small sphere
    # (2e-7 for x = 1e-3) is a difference that rounds to 1e-15.
    np.testing.assert_allclose(numbers[:2], case["literal"][:2], rtol=1e-11)
    assert numbers[2] == pytest.approx(case["literal"][2], rel=1e-11, abs=2e-15)
    # miepython's extinction of absorbing spheres is itself off by up to 2e-10.
    np.testing.assert_allclose(numbers, case["miepython"], rtol=1e-8)


@pytest.mark.parametrize("case", REFERENCE["spheres"], ids=lambda case: f"x={case['x']} m={case['n']}+{case['k']}i")
def test_amplitudes_are_those_of_miepython(case):
    _, s1, s2 = one_sphere(case["x"], case["n"], case["k"])
    real1, imag1, real2, imag2 = np.array(case["amplitudes"]).T
    for found, wanted in ((s1, real1 + 1j * imag1), (s2, real2 + 1j * imag2)):
        # Its series ends some terms earlier: 2e-10 of the forward amplitude.
        np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-9 * abs(wanted[0]))


@pytest.mark.parametrize(("x", "n", "k"), [(1e-8, 1.5, 0.1), (0.02, 1.5, 0.0), (3.0, 1.33, 0.0), (12.0, 1.6, 0.5)])
def test_coefficients_are_quotients_of_bessel_functions(x, n, k):
    a, b = sphere_coefficients(size_parameter=np.array([x]), n=n, k=k)
    with mpmath.workdps(60):
        index, size = mpmath.mpc(n, k), mpmath.mpf(x)

        def psi(order, z):
            return mpmath.sqrt(mpmath.pi * z / 2) * mpmath.besselj(order + mpmath.mpf(1) / 2, z)

        def xi(order, z):
            return psi(order, z) + 1j * mpmath.sqrt(mpmath.pi * z / 2) * mpmath.bessely(order + mpmath.mpf(1) / 2, z)

        def slope(function, order, z):
            return function(order - 1, z) - order * function(order, z) / z

        for order in (1, 2):
            inner, inner_slope = psi(order, index * size), slope(psi, order, index * size)
            for found, factor in ((a, index), (b, 1 / index)):
                top = factor * inner * slope(psi, order, size) - psi(order, size) * inner_slope
                bottom = factor * inner * slope(xi, order, size) - xi(order, size) * inner_slope
                exact = complex(top / bottom)
                # The magnetic ones of a small sphere are a difference of equal terms, but count for nothing.
                allowed = 1e-12 * abs(exact) + 1e-15 * abs(complex(a[0, order - 1]))
                assert abs(found[0, order - 1] - exact) < allowed


@settings(deadline=None, max_examples=30)
@given(x=st.floats(1e-3, 300.0), n=st.floats(1.1, 2.5))
def test_a_sphere_that_does_not_absorb_scatters_what_it_takes_away(x, n):
    numbers, _, _ = one_sphere(x, n, 0.0)
    assert numbers[1] == pytest.approx(numbers[0], rel=1e-12)  # rounding of the sums of positive terms


@settings(deadline=None, max_examples=30)
@given(x=st.floats(1e-3, 300.0), n=st.floats(1.05, 2.5), k=st.floats(1e-6, 2.0))
def test_an_absorbing_sphere_scatters_less(x, n, k):
    numbers, _, _ = one_sphere(x, n, k)
    assert 0.0 < numbers[1] < numbers[0]
    assert -1.0 < numbers[2] < 1.0


@settings(deadline=None, max_examples=20)
@given(x=st.floats(1e-2, 200.0), k=st.floats(0.0, 1.0))
def test_the_forward_amplitude_is_the_extinction(x, k):
    numbers, s1, s2 = one_sphere(x, 1.5, k, np.array([1.0]))
    assert s1[0] == pytest.approx(s2[0], rel=1e-12)
    assert 4.0 * s1[0].real / x**2 == pytest.approx(numbers[0], rel=1e-10)


def test_a_very_small_sphere_is_a_dipole():
    x, m = 1e-4, 1.5 + 0.02j
    numbers, s1, s2 = one_sphere(x, m.real, m.imag)
    strength = (m**2 - 1) / (m**2 + 2)
    # What is left out is of the order of x^2.
    assert numbers[1] == pytest.approx(8 / 3 * x**4 * abs(strength) ** 2, rel=1e-7)
    assert numbers[0] == pytest.approx(4 * x * strength.imag, rel=1e-6)
    np.testing.assert_allclose(s2, s1 * MU, rtol=1e-6, atol=1e-6 * abs(s1[0]))


def test_a_sphere_of_the_index_around_it_is_not_there():
    coefficients = sphere_coefficients(size_parameter=np.array([2.0]), n=1.0, k=0.0)
    assert max(np.max(np.abs(part)) for part in coefficients) < 1e-14


def test_many_sizes_at_once_equal_one_by_one():
    sizes = np.array([1e-3, 0.5, 0.5, 7.0, 120.0])
    a, b = sphere_coefficients(size_parameter=sizes, n=1.53, k=0.01)
    together = efficiencies(size_parameter=sizes, a=a, b=b)
    for i, x in enumerate(sizes):
        numbers, _, _ = one_sphere(x, 1.53, 0.01)
        found = [together.extinction[i], together.scattering[i], together.asymmetry[i]]
        np.testing.assert_allclose(found, numbers, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"size_parameter": np.array([0.0])}, "size_parameter"),
        ({"size_parameter": np.array([np.nan])}, "size_parameter"),
        ({"size_parameter": np.array([3e4])}, "size_parameter"),
        ({"size_parameter": np.zeros(0)}, "size_parameter"),
        ({"size_parameter": np.array([2.0, 1.0])}, "increase"),
        ({"n": 0.0}, "n = 0.0"),
        ({"k": -0.1}, "k = -0.1"),
        ({"k": np.inf}, "k = inf"),
    ],
)
def test_what_the_series_does_not_cover_is_refused(change, named):
    with pytest.raises(ValueError, match=named):
        sphere_coefficients(**({"size_parameter": np.array([1.0]), "n": 1.5, "k": 0.0} | change))
