import numpy as np
import pytest

from model.prediction.polarization_strength import polarization_strength
from tests.model.prediction.test_region_performance import predicted


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
