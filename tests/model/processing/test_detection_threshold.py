"""Threshold and false alarm probability of the RX detector."""

import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from model.processing.detection import rx_threshold

# 18 digits, from the closed form in extended precision
TABLE = {
    0.5: 2.36597388437533827,
    0.1: 6.2513886311703232,
    1e-2: 11.3448667301443719,
    1e-3: 16.2662361962381309,
    1e-4: 21.1075134661602137,
    1e-5: 25.9017497456620512,
    1e-6: 30.6648497062135992,
    1e-9: 44.8412753305624016,
    1e-12: 58.9197556832021534,
}


@pytest.mark.parametrize("p", list(TABLE))
def test_threshold_table(p: float) -> None:
    # the probability is a double too: 1e-16 of it moves the threshold by 2e-16/threshold at most
    assert_allclose(rx_threshold(p), TABLE[p], rtol=1e-15)


def test_false_alarms_come_back_from_1e_300_to_1() -> None:
    p = np.concatenate([10.0 ** np.arange(-300.0, 0.0, 7.0), 1.0 - 10.0 ** np.arange(-1.0, -13.0, -1.0)])
    # half a unit in the last place of a threshold of 1390 is worth 6e-14 of the probability
    back = [float(mp.gammainc(1.5, mp.mpf(one) / 2, regularized=True)) for one in rx_threshold(p)]
    assert_allclose(back, p, rtol=1e-13)


def test_two_channels_are_exponential() -> None:
    assert_allclose(rx_threshold(1e-5, 2), -2.0 * np.log(1e-5), rtol=1e-15)


@pytest.mark.parametrize("p", [-1e-9, 1.0 + 1e-9, np.nan])
def test_no_probability_is_refused(p: float) -> None:
    with pytest.raises(ValueError, match="p_false_alarm"):
        rx_threshold([0.1, p])


def test_dimension_below_1_is_refused() -> None:
    with pytest.raises(ValueError, match="dim"):
        rx_threshold(0.1, 0)
