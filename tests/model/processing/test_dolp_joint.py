import numpy as np
import pytest

from model.processing import dolp
from model.processing.dolp_distribution.joint import aolp_pdf, aolp_statistics, joint_pdf
from tests.model.oracles import covariance

MEAN = np.array([1.0, 0.3, 0.1])
COV = covariance((0.2, 0.22, 0.14), r01=0.4, r12=0.3)
HALF_TURN = np.pi * np.arange(64) / 64


def test_joint_density_integrates_over_the_angle_to_that_of_dolp():
    x = np.linspace(0.05, 2.0, 9)
    # Periodic trapezoidal rule: spectral; the angle's law is 20 of its steps wide.
    integral = np.sum(joint_pdf(x[:, None], HALF_TURN, MEAN, COV), axis=1) * np.pi / 64
    np.testing.assert_allclose(integral, dolp.pdf(x, MEAN, COV), rtol=1e-9)


def test_density_of_the_angle_integrates_to_one():
    assert np.sum(aolp_pdf(HALF_TURN, MEAN, COV)) * np.pi / 64 == pytest.approx(1.0, rel=1e-12)


def test_angle_statistics_are_those_of_the_density():
    fine = np.pi * np.arange(512) / 512
    resultant = np.sum(aolp_pdf(fine, MEAN, COV) * np.exp(2j * fine)) * np.pi / 512
    found = aolp_statistics(MEAN, COV)
    np.testing.assert_allclose(found.resultant, abs(resultant), rtol=1e-12)
    np.testing.assert_allclose(found.mean_rad, np.angle(resultant) / 2, rtol=1e-12)
    np.testing.assert_allclose(found.std_rad, np.sqrt(-0.5 * np.log(abs(resultant))), rtol=1e-11)


@pytest.mark.parametrize("scale", [1e-4, 1e-6])
def test_narrow_angle_has_the_first_order_deviation(scale):
    found = aolp_statistics(MEAN, scale**2 * COV)
    # The next order is (scale / DoLP)^2.
    np.testing.assert_allclose(found.std_rad, found.first_order_std_rad, rtol=20.0 * scale**2 + 1e-9)


def test_angle_of_unpolarized_light_has_no_preference():
    assert aolp_statistics((1.0, 0.0, 0.0), 0.1 * np.eye(3)).resultant < 1e-14


def test_thin_unpolarized_law_points_along_its_long_axis():
    found = aolp_statistics((1.0, 0.0, 0.0), covariance((0.1, 0.1, 1e-5), psi_deg=30.0))
    # Both ends of the axis are as likely: doubled angles 60 and 240 deg cancel.
    assert found.resultant < 1e-12


def test_joint_density_refuses_a_line():
    with pytest.raises(ValueError, match="no joint density"):
        joint_pdf(0.3, 0.1, MEAN, np.outer(MEAN, MEAN))


def test_angle_refuses_a_singular_covariance():
    with pytest.raises(ValueError, match="singular"):
        aolp_statistics(MEAN, np.diag([0.1, 0.1, 0.0]))


def test_negative_degree_is_refused():
    with pytest.raises(ValueError, match="negative"):
        joint_pdf(-0.1, 0.0, MEAN, COV)
