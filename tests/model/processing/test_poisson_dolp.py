"""DoLP of few photo-electrons: against published values, drawn counts, and where it is refused."""

import numpy as np
import pytest

from model.processing import dolp
from model.processing.dolp_studies import poisson_dolp
from model.processing.reconstruction import MODIFIED_PICKERING_RAD, design

PLAN = design(MODIFIED_PICKERING_RAD)
SHAPE = np.array([1.0, 0.5, 0.5])


def light_of(snr: float) -> np.ndarray:
    # Four ideal channels of pairs: var S0 = S0 / 2.
    return SHAPE * snr**2 / 2.0


@pytest.mark.parametrize(("decibel", "mean", "std"), [(0.0, 1.6995, 0.5442), (10.0, 0.8758, 0.3585)])
def test_moments_are_those_of_the_plain_sum_at_0_and_10_db(decibel, mean, std):
    found = poisson_dolp(PLAN, light_of(10.0 ** (decibel / 20.0)))
    assert (found.mean, found.std) == (pytest.approx(mean, abs=6e-5), pytest.approx(std, abs=6e-5))
    assert found.error < 1e-12


def test_drawn_counts_have_these_moments():
    light = light_of(3.0)
    counts = np.random.default_rng(5).poisson((PLAN.system @ light)[:, None], (4, 100_000))
    stokes = PLAN.inverse @ counts
    values = np.hypot(stokes[1], stokes[2])[stokes[0] > 0] / stokes[0][stokes[0] > 0]
    found = poisson_dolp(PLAN, light)
    assert abs(values.mean() - found.mean) < 4.0 * found.std / np.sqrt(values.size)
    assert np.mean(stokes[0] <= 0) == pytest.approx(found.without_light, abs=4.0 * np.sqrt(found.without_light / 1e5))


def test_18_electrons_are_nearly_gaussian():
    light = light_of(6.0)
    cov = PLAN.inverse @ np.diag(PLAN.system @ light) @ PLAN.inverse.T
    gaussian = float(dolp.moments(light, cov, tolerance=1e-4).mean)
    # What Poisson's law adds is of third order: the bias of second order over the SNR.
    bias = gaussian - float(np.hypot(*SHAPE[1:]))
    assert abs(poisson_dolp(PLAN, light).mean - gaussian) < abs(bias) / 6.0


def test_no_light_behind_an_angle_is_no_trouble():
    found = poisson_dolp(PLAN, [2.0, 2.0, 0.0])
    assert np.isfinite(found.mean)


def test_too_much_light_and_light_below_0_are_refused():
    with pytest.raises(ValueError, match="combinations of counts"):
        poisson_dolp(PLAN, SHAPE * 1e4)
    with pytest.raises(ValueError, match="allowed is 0 and above"):
        poisson_dolp(PLAN, [1.0, 2.0, 0.0])
