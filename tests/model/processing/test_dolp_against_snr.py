from dataclasses import replace

import numpy as np
import pytest

from model.processing.dolp_studies import dolp_against_snr

PAPER = (1.0, 0.5, 0.5)


def _study(snr, draws=40_000, seed=1):
    return dolp_against_snr(PAPER, snr, draws=draws, generator=np.random.default_rng(seed))


def test_shot_noise_gives_the_intensity_of_a_ratio():
    # Modified Pickering, shot noise: var S0 = S0 / 2, so SNR = sqrt(2 S0).
    assert _study([10.0], draws=10).s0_e == pytest.approx([50.0], rel=1e-12)


def test_exact_moments_meet_the_draws_where_counts_are_many():
    found = _study([30.0, 100.0])
    # 450 and more electrons: Poisson and Gaussian differ by less than the sampling error of 4e4 draws.
    assert np.all(np.abs(found.mean - found.drawn_mean) < 4 * found.drawn_mean_error)
    assert np.all(np.abs(found.std - found.drawn_std) < 4 * found.drawn_std_error)


def test_first_order_is_biased_at_20_db_and_the_exact_law_is_not():
    found = _study([10.0], draws=400_000)
    assert abs(found.first_mean[0] - found.drawn_mean[0]) > 20 * found.drawn_mean_error[0]
    assert abs(found.mean[0] - found.drawn_mean[0]) < 0.2 * abs(found.first_mean[0] - found.drawn_mean[0])


def test_first_order_is_the_limit_of_many_electrons():
    found = _study([1e4], draws=10)
    # What is left is of the order of the inverse square of the ratio.
    assert found.mean[0] == pytest.approx(found.first_mean[0], rel=1e-7)
    assert found.std[0] == pytest.approx(found.first_std[0], rel=1e-7)


def test_where_moments_do_not_exist_there_is_none_and_the_draws_are_counted():
    found = _study([1.0], draws=5000)
    assert np.isnan(found.mean[0])
    assert found.drawn_without_light[0] > 0


@pytest.mark.parametrize(("snr", "draws"), [([0.0], 100), ([[1.0]], 100), ([1.0], 1)])
def test_arguments_out_of_range_are_refused(snr, draws):
    with pytest.raises(ValueError, match="allowed are"):
        _study(snr, draws=draws)


@pytest.mark.parametrize("moment", ["mean", "std"])
def test_above_the_last_sum_the_law_of_poisson_counts_is_carried_on(moment):
    decibel = np.array([14.0, 16.0, 18.0, 20.0])
    found = dolp_against_snr((1.0, 0.5, 0.5), 10.0 ** (decibel / 20.0), draws=10, generator=np.random.default_rng(1))
    summed = getattr(found, f"poisson_{moment}")
    shorter = replace(found, **{f"poisson_{moment}": np.where(decibel > 18.0, np.nan, summed)})
    value, error = shorter.truth(moment)
    # Steps of 2 dB fall regularly: what the last one missed is no more than the one before missed.
    assert abs(value[-1] - summed[-1]) < error[-1] / 1.5
    assert abs(getattr(found, moment)[-1] - summed[-1]) > 3.0 * error[-1]
