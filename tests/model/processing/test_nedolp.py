import numpy as np

from model.processing.nedolp import noise_equivalent


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
