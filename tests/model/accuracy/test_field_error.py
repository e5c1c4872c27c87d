import numpy as np
import pytest

from model.accuracy.field_error import field_error
from model.quadrature import gauss_legendre


def over_field(law, per_side):
    """Values of a law of x and y in 0 to 1 at the tiles, as one component, and their weights."""
    node, weight = gauss_legendre(per_side)
    x, y = np.meshgrid(node, node)
    values = law(x, y).ravel()[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    return values, np.outer(weight, weight).ravel()


def variance(law, per_side):
    values, weights = over_field(law, per_side)
    return weights @ (values[:, 0] - weights @ values[:, 0]) ** 2


def test_a_plane_has_next_to_no_error_with_four_tiles():
    # Beyond degree 1 nothing is there but rounding; the smallest ratio of degrees is taken as a twentieth.
    values, _ = over_field(lambda x, y: 10.0 + x + 2.0 * y, 4)
    assert np.max(field_error(values).cov) < 1e-25


@pytest.mark.parametrize("per_side", [3, 4, 5, 6])
@pytest.mark.parametrize("steepness", [0.3, 1.0, 2.0])
def test_the_estimate_is_above_the_error_of_a_smooth_field(per_side, steepness):
    def law(x, y):
        return np.exp(steepness * (x + 0.5 * y))

    values, _ = over_field(law, per_side)
    true = abs(variance(law, per_side) - variance(law, 20))
    estimated = field_error(values).cov[0, 0]
    # Sums of 400 values of size 1 round by some eps.
    assert true < estimated + 1e-14
    # Not so far above as to be of no use: a degree less would be off by about a hundred times as much.
    assert estimated < 1e3 * true + 1e-11


def test_a_field_that_does_not_fall_off_is_not_trusted():
    values, _ = over_field(lambda x, y: np.sign(x - 0.4), 5)
    true = abs(variance(lambda x, y: np.sign(x - 0.4), 5) - 4.0 * 0.4 * 0.6)
    assert field_error(values).cov[0, 0] > true
