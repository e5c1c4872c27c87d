"""Least squares with scatter, against closed forms and draws."""

import numpy as np
import pytest

from calibration.sensor.fits import fit_with_scatter

X = np.linspace(1.0, 12.0, 12)
LINE = np.column_stack([np.ones_like(X), X])


def test_points_on_a_line_give_the_line_without_scatter() -> None:
    fit = fit_with_scatter(LINE, 3.0 + 2.0 * X, sampling_covariance=np.diag(0.1 * X), scatter_shape=np.ones_like(X))
    # Condition of the design below 1e2: rounding stays below 1e-12.
    np.testing.assert_allclose(fit.parameters, [3.0, 2.0], rtol=1e-12)
    assert fit.scatter == 0.0


def test_covariance_is_the_inverse_of_the_normal_matrix() -> None:
    errors = 0.1 + 0.05 * X
    fit = fit_with_scatter(LINE, 3.0 + 2.0 * X, sampling_covariance=np.diag(errors**2), scatter_shape=np.ones_like(X))
    expected = np.linalg.inv(LINE.T @ np.diag(errors**-2) @ LINE)
    np.testing.assert_allclose(fit.covariance, expected, rtol=1e-11)


def test_an_error_that_all_points_share_goes_into_the_intercept() -> None:
    covariance = np.diag(np.full(12, 0.01)) + 4.0
    fit = fit_with_scatter(LINE, 3.0 + 2.0 * X, sampling_covariance=covariance, scatter_shape=np.ones_like(X))
    alone = np.linalg.inv(LINE.T @ LINE) * 0.01
    # Condition number of the covariance 5e3 times that of the design.
    assert fit.covariance[0, 0] == pytest.approx(4.0 + alone[0, 0], rel=1e-9)
    assert fit.covariance[1, 1] == pytest.approx(alone[1, 1], rel=1e-9)


def test_scatter_makes_chi_squared_equal_to_its_freedom() -> None:
    values = 2.0 * X * (1.0 + 0.02 * np.random.default_rng(1).standard_normal(12))
    design, shape, sampling = X[:, None], X, np.full(12, 1e-4)
    fit = fit_with_scatter(design, values, sampling_covariance=np.diag(sampling), scatter_shape=shape)
    residual = values - design @ fit.parameters
    chi2 = np.sum(residual**2 / (sampling + (fit.scatter * shape) ** 2))
    # brentq ends within 2e-12 or 4 ulp of the variance of scatter, which is 1e-3.
    assert chi2 == pytest.approx(11.0, rel=1e-6)
    # 11 degrees of freedom: a relative error of 1 / sqrt(22) of a deviation of 0.04; 4 sigma.
    assert fit.scatter == pytest.approx(0.04, rel=4.0 / np.sqrt(22.0))


def test_without_freedom_there_is_no_chi_squared() -> None:
    fit = fit_with_scatter(LINE[:2], np.array([5.0, 7.0]), sampling_covariance=np.eye(2), scatter_shape=np.ones(2))
    assert fit.chi2_per_dof is None
    np.testing.assert_allclose(fit.parameters, [3.0, 2.0], rtol=1e-12)


def test_intervals_cover_when_points_scatter() -> None:
    draws, scores = np.random.default_rng(2), []
    for _ in range(400):
        sampling = 0.05 * X
        values = 2.0 * X * (1.0 + 0.05 * draws.standard_normal(12)) + sampling * draws.standard_normal(12)
        fit = fit_with_scatter(X[:, None], values, sampling_covariance=np.diag(sampling**2), scatter_shape=X)
        scores.append((fit.parameters[0] - 2.0) / np.sqrt(fit.covariance[0, 0]))
    # The error bar comes from 11 residuals, so the score follows Student's law, variance 11 / 9 (excess
    # kurtosis 6 / 7); 4 sigma of the variance of 400.
    assert np.mean(scores) == pytest.approx(0.0, abs=4.0 * np.sqrt(11.0 / 9.0 / 400.0))
    assert np.var(scores) == pytest.approx(11.0 / 9.0, abs=4.0 * 11.0 / 9.0 * np.sqrt((2.0 + 6.0 / 7.0) / 400.0))
