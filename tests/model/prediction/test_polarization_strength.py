import numpy as np
import pytest

from model.prediction import noise_equivalent, polarization_strength
from tests.model.prediction.test_pair_detection import predicted


def test_half_of_the_pixels_lie_below_the_median():
    strength = polarization_strength(predicted(a=((20.0, 5.0, 1.0), 0.01))["a"])
    assert list(strength.quantiles) == sorted(strength.quantiles)
    # Close to normal at this signal: the median is close to DoLP of the mean, off by the order of NEDoLP^2 / DoLP.
    assert strength.quantiles[1] == pytest.approx(np.hypot(5, 1) / 20, abs=2 * strength.nedolp**2 / 0.25)


def test_noise_floor_does_not_hold_texture():
    plain = polarization_strength(predicted(a=((20.0, 5.0, 1.0), 0.0))["a"])
    textured = polarization_strength(predicted(a=((20.0, 5.0, 1.0), 0.05))["a"])
    assert textured.nedolp == pytest.approx(plain.nedolp, rel=1e-12)


def test_unpolarised_light_shows_its_noise_floor():
    prediction = predicted(a=((20.0, 0.0, 0.0), 0.0))["a"]
    strength = polarization_strength(prediction)
    # Rice: mean over deviation of a component is sqrt(pi / 2), up to the square of the noise of S0.
    assert strength.unpolarised_mean == pytest.approx(np.sqrt(np.pi / 2) * strength.nedolp, rel=1e-3)
    assert prediction.quantities["dolp_pixels"]["mean"] == pytest.approx(strength.unpolarised_mean, rel=1e-6)


def test_additive_noise_of_modified_pickering():
    # Channels of 500 with deviation 2: S0 = 1000, covariance 4 diag(1, 2, 2).
    found = noise_equivalent((1000.0, 0.0, 0.0), 4.0 * np.diag([1.0, 2.0, 2.0]))
    # 1 / (sqrt 2 snr) of one channel.
    np.testing.assert_allclose(found.first_order, 1.0 / (np.sqrt(2.0) * 250.0), rtol=1e-14)


def test_shot_noise_of_modified_pickering():
    found = noise_equivalent((1e4, 0.0, 0.0), 1e4 * np.diag([0.5, 1.0, 1.0]))
    np.testing.assert_allclose(found.first_order, 1e-2, rtol=1e-14)


def test_exact_values_of_unpolarized_light():
    found = noise_equivalent((1.0, 0.4, 0.1), np.diag([0.0, 1e-4, 1e-4]))
    np.testing.assert_allclose(found.mean, 1.25331413731550025e-2, rtol=1e-9)
    np.testing.assert_allclose(found.std, 0.655136377562033553e-2, rtol=1e-9)


def test_worst_direction_is_the_long_axis():
    found = noise_equivalent((1.0, 0.0, 0.0), np.diag([0.0, 9e-4, 1e-4]))
    np.testing.assert_allclose([found.worst_direction, found.first_order], [0.03, np.sqrt(5e-4)], rtol=1e-14)
