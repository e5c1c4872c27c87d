"""Counts over what was predicted: drawn many times with known truth."""

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.radiometric import PanelScale, panel_scale
from calibration.results import CalibrationError

FloatArray = NDArray[np.float64]

PREDICTED = np.array([1000.0, 1200.0, 900.0, 700.0])
NOISE_DN, LIGHT = 0.5, 0.03
SCALE = 1.12
CAMERA = np.eye(4) * NOISE_DN**2
SUN = np.outer(PREDICTED, PREDICTED) * LIGHT**2


def drawn(seed: int, *, gain: FloatArray | None = None) -> PanelScale:
    """The truth is fixed; the prediction is off by one factor, the measurement by noise."""
    draws = np.random.default_rng(seed)
    told = PREDICTED * (1.0 + LIGHT * draws.standard_normal())
    signal = SCALE * PREDICTED * (1.0 if gain is None else gain) + NOISE_DN * draws.standard_normal(4)
    return panel_scale(signal, CAMERA, told, np.outer(told, told) * LIGHT**2)


def test_the_scale_is_found_with_its_error() -> None:
    scores = np.array([(one.common - SCALE) / one.common_error for one in map(drawn, range(400))])
    # Normal up to second order in 3 %: mean within 4 / sqrt(400) and the second order's 0.03, variance within 5 sigma.
    assert abs(scores.mean()) < 0.2 + 0.03
    assert scores.var() == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / 400.0))


def test_channels_agree_where_they_do() -> None:
    # Binomial of 400 with 1e-3: 4 and more with a chance of 8e-4.
    assert sum(not drawn(seed).channels_agree for seed in range(400)) < 4


def test_a_channel_that_passes_less_is_noticed_though_the_light_is_uncertain() -> None:
    # 1 % of 1008 DN is 20 times the noise, and a third of what is uncertain of the sun.
    assert not drawn(1, gain=np.array([1.0, 1.0, 0.99, 1.0])).channels_agree


def test_the_light_is_most_of_the_error() -> None:
    found = drawn(1)
    assert found.measurement_error < 0.01 * found.common_error
    assert found.common_error == pytest.approx(LIGHT * found.common, rel=1e-3)
    assert found.channel_error == pytest.approx(np.full(4, LIGHT) * found.channel, rel=1e-3)


@pytest.mark.parametrize("dark", ["signal", "prediction"])
def test_a_panel_in_the_dark_is_refused(dark: str) -> None:
    none = PREDICTED * np.array([1.0, 0.0, 1.0, 1.0])
    arguments = (none, CAMERA, PREDICTED, SUN) if dark == "signal" else (PREDICTED, CAMERA, none, SUN)
    with pytest.raises(CalibrationError, match="without light"):
        panel_scale(*arguments)
