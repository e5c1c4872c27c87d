import numpy as np
import pytest
from scipy.special import ndtr

from model.processing import dolp_studies as normalized_stokes
from tests.model.oracles import covariance

MEAN = np.array([1.0, 0.3, 0.1])
COV = covariance((0.5, 0.22, 0.14), r01=0.4, r02=-0.3)


def _double_integral(x, component):
    """Pr(S_k <= x S0, S0 > 0) with the inner integral closed and the outer one by a fine Gauss-Legendre rule."""
    slope = COV[component, 0] / COV[0, 0]
    own = np.sqrt(COV[component, component] - slope * COV[component, 0])
    nodes, weights = np.polynomial.legendre.leggauss(200)
    s0 = 3.0 * (nodes + 1.0)
    bell = np.exp(-0.5 * ((s0 - 1.0) / 0.5) ** 2) / (0.5 * np.sqrt(2.0 * np.pi))
    inner = ndtr((x * s0 - MEAN[component] - slope * (s0 - 1.0)) / own)
    return np.sum(3.0 * weights * bell * inner) / ndtr(2.0)


@pytest.mark.parametrize("component", [1, 2])
@pytest.mark.parametrize("x", [-3.0, -0.2, 0.3, 1.0])
def test_cdf_against_the_double_integral(x, component):
    found = normalized_stokes.distribution(x, MEAN, COV, component=component)
    # The outer rule leaves out S0 above 6, ten deviations.
    np.testing.assert_allclose(found.lower, _double_integral(x, component), rtol=1e-12)
    np.testing.assert_allclose(found.lower + found.upper, 1.0, rtol=1e-14)


@pytest.mark.parametrize("p", [1e-12, 1e-3, 0.5, 1.0 - 1e-9])
def test_quantile_inverts_the_law(p):
    x = normalized_stokes.quantile(p, MEAN, COV, component=1)
    found = normalized_stokes.distribution(x, MEAN, COV, component=1)
    smaller = found.lower / p if p <= 0.5 else found.upper / (1.0 - p)
    np.testing.assert_allclose(smaller, 1.0, rtol=1e-12)


def test_density_is_the_derivative():
    step = 1e-5
    lower = [normalized_stokes.distribution(0.4 + k * step, MEAN, COV, component=2).lower for k in (-1, 1)]
    slope = (lower[1] - lower[0]) / (2.0 * step)
    np.testing.assert_allclose(normalized_stokes.distribution(0.4, MEAN, COV, component=2).density, slope, rtol=1e-8)


def test_known_intensity_leaves_a_normal_law():
    found = normalized_stokes.quantile(0.975, (2.0, 0.3, 0.1), np.diag([0.0, 0.04, 0.09]), component=2)
    np.testing.assert_allclose(found, 0.05 + 0.15 * 1.959963984540054, rtol=1e-13)


def test_high_signal_to_noise_keeps_the_width():
    found = normalized_stokes.quantile([0.16, 0.84], (1.0, 0.3, 0.1), 1e-12 * np.eye(3), component=1)
    # First order: sqrt(1 + 0.3^2) 1e-6; the next order is 1e-6 of it.
    width = np.sqrt(1.09) * 1e-6 * 2.0 * 0.994457883209753
    np.testing.assert_allclose(found[1] - found[0], width, rtol=1e-5)


@pytest.mark.parametrize(("component", "cov"), [(3, COV), (1, np.outer(MEAN, MEAN))])
def test_what_has_no_law_is_refused(component, cov):
    with pytest.raises(ValueError, match=r"component|fluctuation"):
        normalized_stokes.distribution(0.3, MEAN, cov, component=component)
