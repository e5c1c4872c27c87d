import numpy as np
import pytest

from model.processing.drift_line import drift_line


def test_the_slope_is_that_of_weighted_least_squares():
    x, y, s = np.array([0.0, 1.0, 3.0, 4.0]), np.array([1.0, 2.5, 6.0, 9.5]), np.array([1.0, 0.5, 0.5, 2.0])
    basis = np.column_stack([np.ones(4), x]) / s[:, None]
    cov = np.linalg.inv(basis.T @ basis)
    found = drift_line(x, y, s)
    assert found.slope == pytest.approx((cov @ basis.T @ (y / s))[1], rel=1e-12)
    assert found.std_error == pytest.approx(np.sqrt(cov[1, 1]), rel=1e-12)
    assert found.degrees_of_freedom == 2


@pytest.mark.parametrize(("x", "s"), [([0, 1], [1, 1]), ([1, 1, 1], [1, 1, 1]), ([0, 1, 2], [1, 0, 1])])
def test_what_has_no_slope_is_refused(x, s):
    with pytest.raises(ValueError, match="three numbers or more"):
        drift_line(x, np.zeros(len(x)), s)
