import numpy as np
import pytest

from model.prediction import budget, shift_cause
from model.processing.reconstruction import design

PLAN = design(np.deg2rad([0.0, 45.0, 90.0, 135.0]), np.inf)


def test_additive_noise_makes_the_known_deviations():
    stokes = np.array([1000.0, 300.0, 400.0])
    found = budget(PLAN.system @ stokes, {"read": np.eye(4)}, plan=PLAN)
    # Modified Pickering, sigma = 1: cov S = diag(1, 2, 2), so var P = (2 + P^2) / S0^2 and var psi = 2 / (4 Q^2).
    assert found["dolp"]["read"] == pytest.approx(np.sqrt(2.25) / 1000.0)
    assert found["s0"]["read"] == pytest.approx(1e-3)
    assert found["aolp_deg"]["read"] == pytest.approx(np.rad2deg(np.sqrt(2.0) / 1000.0))


def test_a_common_factor_moves_s0_alone():
    mean = PLAN.system @ np.array([1000.0, 300.0, 400.0])
    found = budget(mean, {"scale": 1e-4 * np.outer(mean, mean)}, plan=PLAN)
    assert found["s0"]["scale"] == pytest.approx(0.01)
    # The root of rounding of 1e-4.
    assert found["dolp"]["scale"] < 1e-9


def test_unpolarised_light_has_no_angle():
    found = budget(PLAN.system @ np.array([1000.0, 0.0, 0.0]), {"read": np.eye(4)}, plan=PLAN)
    assert set(found) == {"s0", "s1n", "s2n"}


def test_no_light_is_refused():
    with pytest.raises(ValueError, match="must be above 0"):
        budget(np.zeros(4), {"read": np.eye(4)}, plan=PLAN)


def test_a_shift_acts_by_the_mean_gradient():
    down, right = np.mgrid[0:20, 0:30].astype(float)
    pictures = np.stack([3.0 * right + 2.0 * down, 0.0 * down])
    inside = np.zeros((20, 30), dtype=bool)
    inside[5:10, 5:10] = True
    found = shift_cause(pictures, inside, shift_pixels=np.array([[0.5, 1.0], [0.5, 1.0]]))
    np.testing.assert_allclose(found, np.diag([1.5**2 + 2.0**2, 0.0]), atol=1e-12)
