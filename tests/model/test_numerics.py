"""Quadrature rules, adaptive integration, a spline and a fit, against closed forms and scipy."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

from model.numerics import (
    ClampedSpline,
    clenshaw_curtis,
    fit_above_zero,
    gauss_hermite,
    gauss_legendre,
    integrate_panels,
)

QUIET = np.array([1e-15])


def test_clenshaw_curtis_is_exact_for_polynomials_of_its_degree():
    nodes, weights = clenshaw_curtis(12)
    powers = np.arange(13)
    moments = weights @ nodes[:, None] ** powers
    np.testing.assert_allclose(moments, np.where(powers % 2 == 0, 2.0 / (powers + 1.0), 0.0), atol=1e-15)


def test_every_other_node_is_the_rule_of_half_the_degree():
    np.testing.assert_allclose(clenshaw_curtis(24)[0][::2], clenshaw_curtis(12)[0], atol=1e-16)


def test_gauss_hermite_gives_moments_of_a_normal_variable():
    nodes, weights = gauss_hermite(8)
    np.testing.assert_allclose([weights @ nodes**k for k in (0, 2, 4, 6)], [1.0, 1.0, 3.0, 15.0], rtol=1e-13)


def test_gauss_legendre_covers_zero_to_one():
    nodes, weights = gauss_legendre(6)
    assert weights @ nodes**11 == pytest.approx(1.0 / 12.0, rel=1e-14)


def test_narrow_peak_that_the_cuts_show_is_integrated():
    width = 1e-9
    cuts = np.concatenate([[-1.0], [-width, 0.0, width], [1.0]])[None]
    found = integrate_panels(
        lambda index, x: (width / (np.pi * (x**2 + width**2)))[None], cuts=cuts, tolerance=1e-12, noise=QUIET
    )
    expected = 2.0 / np.pi * np.arctan(1.0 / width)
    assert found.value[0, 0] == pytest.approx(expected, rel=1e-11)
    assert abs(found.value[0, 0] - expected) <= found.error[0, 0] + 1e-15


def test_domains_and_functions_are_kept_apart():
    cuts = np.array([[0.0, 1.0], [0.0, 2.0]])
    found = integrate_panels(
        lambda index, x: np.stack([x, (index[:, None] + 1.0) * np.cos(x)]),
        cuts=cuts,
        tolerance=1e-12,
        noise=np.zeros(2),
    )
    np.testing.assert_allclose(found.value, [[0.5, np.sin(1.0)], [2.0, 2.0 * np.sin(2.0)]], rtol=1e-14)


def test_panels_without_width_cost_nothing():
    cuts = np.array([[0.0, 0.0, 1.0, 1.0]])
    found = integrate_panels(lambda index, x: np.ones((1, *x.shape)), cuts=cuts, tolerance=1e-12, noise=QUIET)
    assert found.value[0, 0] == pytest.approx(1.0, rel=1e-15)


def test_noise_that_never_converges_is_reported_in_the_error():
    rng = np.random.default_rng(1)
    found = integrate_panels(
        lambda index, x: 1.0 + rng.normal(size=(1, *x.shape)), cuts=np.array([[0.0, 1.0]]), tolerance=1e-12, noise=QUIET
    )
    assert found.error[0, 0] > 1e-3


def test_the_spline_is_that_of_scipy_beyond_its_ends_too():
    rng = np.random.default_rng(1)
    x, y = np.cumsum(rng.uniform(0.1, 1.0, 30)), rng.normal(size=30)
    at = np.linspace(x[0] - 1.0, x[-1] + 1.0, 500)
    np.testing.assert_allclose(ClampedSpline(x, y)(at), CubicSpline(x, y, bc_type="clamped")(at), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_the_fit_is_that_of_scipy(seed):
    rng = np.random.default_rng(seed)
    rows, count = rng.integers(2, 40), rng.integers(1, 12)
    # Columns of one sign are nearly alike, so that most of them are not used.
    columns, values = rng.uniform(size=(rows, count)) ** (seed % 3), rng.normal(size=rows)
    found = fit_above_zero(columns, values)
    assert np.all(found >= 0.0)
    assert np.linalg.norm(columns @ found - values) <= nnls(columns, values)[1] * (1.0 + 1e-12) + 1e-12


def test_the_fit_of_values_below_0_by_columns_above_it_is_nothing():
    np.testing.assert_array_equal(fit_above_zero(np.ones((4, 2)), -np.ones(4)), [0.0, 0.0])
