import numpy as np
import pytest

from model.accuracy.plan import decay
from model.numerics import gauss_legendre


def over_field(law, per_side):
    """Values of a law of x and y in 0 to 1 at the tiles, as one component."""
    x, y = np.meshgrid(*[gauss_legendre(per_side)[0]] * 2)
    return law(x, y).ravel()[:, np.newaxis] * np.array([1.0, 0.0, 0.0])


@pytest.mark.parametrize("per_side", [3, 4, 6])
@pytest.mark.parametrize("ratio", [0.05, 0.3])
def test_the_decay_of_a_field_is_that_of_its_degrees(per_side, ratio):
    def law(x, y):
        degrees = np.arange(per_side)
        factors = ratio**degrees * np.sqrt(2.0 * degrees + 1.0)
        return np.polynomial.legendre.legval(2.0 * x - 1.0, factors)

    assert decay(over_field(law, per_side)) == pytest.approx(ratio, rel=1e-6)


def test_two_tiles_a_side_tell_no_decay():
    assert decay(over_field(lambda x, y: 1.0 + x, 2)) is None


def test_a_field_without_any_light_tells_no_decay():
    assert decay(np.zeros((16, 3))) is None
