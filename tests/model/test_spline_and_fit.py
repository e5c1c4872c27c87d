"""A spline and a fit that need no scipy, held against scipy's."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

from model.numerics import ClampedSpline, fit_above_zero


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
