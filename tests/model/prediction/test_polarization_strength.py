from dataclasses import replace

import numpy as np
import pytest

from model.moments import Moments
from model.prediction import polarization_strength
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


@pytest.mark.parametrize(
    ("s0", "noise", "nedolp"),
    [
        # Channels of 500 with deviation 2: S0 = 1000, covariance 4 diag(1, 2, 2); 1 / (sqrt 2 snr) of one channel.
        (1000.0, 4.0 * np.diag([1.0, 2.0, 2.0]), 1.0 / (np.sqrt(2.0) * 250.0)),
        # Shot noise.
        (1e4, 1e4 * np.diag([0.5, 1.0, 1.0]), 1e-2),
    ],
)
def test_noise_floor_of_modified_pickering(s0, noise, nedolp):
    prediction = predicted(a=((20.0, 0.0, 0.0), 0.0))["a"]
    stokes = Moments(mean=np.array([s0, 0.0, 0.0]), cov=noise)
    found = polarization_strength(replace(prediction, stokes_dn=stokes, stokes_noise_dn2=noise))
    assert found.nedolp == pytest.approx(nedolp, rel=1e-14)
    # Rice; S0 fluctuates too, which adds its relative variance.
    assert found.unpolarised_mean == pytest.approx(1.25331413731550025 * nedolp, rel=noise[0, 0] / s0**2 + 1e-6)
