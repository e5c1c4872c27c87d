"""How contrast between pixels is seen through a response that is not linear."""

import numpy as np
import pytest

from calibration.sensor.curves import PhotonTransfer, response_slope
from calibration.sensor.noise import calibrate_noise
from tests.calibration.sensor.synthetic_sensor import EXPOSURES_S, SIGNALS_E, SyntheticCamera, SyntheticSensor

FULL_DN = 4035.0
SIGNAL_DN = 1500.0


def transfer(*, low: float, light_known: bool = True, n: int = len(SIGNALS_E)) -> PhotonTransfer:
    """Return the curve of a sensor whose response is a parabola, `low` at saturation."""
    sensor = SyntheticSensor(response=lambda dn: dn * (1.0 - low * dn / FULL_DN), shape=(160, 160))
    camera = SyntheticCamera(sensor, 31)
    if light_known:
        levels = camera.sweep(signals_e=SIGNALS_E[-n:], exposures_s=EXPOSURES_S[-n:])
    else:
        levels = [camera.level(2, kind="flat", light_e=light_e, exposure_s=None) for light_e in SIGNALS_E[-n:]]
        levels.append(camera.level(16, kind="dark", light_e=0.0, exposure_s=None))
    return calibrate_noise(levels, bit_depth=12).transfer


def truth(low: float) -> float:
    """Return slope over ratio where signal = x (1 - low x / full) is SIGNAL_DN."""
    x = FULL_DN / (2.0 * low) * (1.0 - np.sqrt(1.0 - 4.0 * low * SIGNAL_DN / FULL_DN))
    return float((1.0 - 2.0 * low * x / FULL_DN) / (1.0 - low * x / FULL_DN))


@pytest.mark.parametrize("light_known", [True, False])
@pytest.mark.parametrize("low", [0.02, 0.06])
def test_the_slope_of_a_parabola(low: float, light_known: bool) -> None:
    found = response_slope(transfer(low=low, light_known=light_known), SIGNAL_DN)
    # 4 sigma; terms of third order, up to (0.06 * 0.4)^2 * 5, are left out where light is not known.
    assert abs(found.value - truth(low)) < 4.0 * found.std_error + 5.0 * (low * SIGNAL_DN / FULL_DN) ** 2
    # Known well enough to tell that it is not 1.
    assert found.value + found.std_error < 1.0


def test_a_linear_sensor_has_one() -> None:
    found = response_slope(transfer(low=1e-9), SIGNAL_DN)
    assert abs(found.value - 1.0) < 4.0 * found.std_error


def test_few_levels_say_nothing() -> None:
    found = response_slope(transfer(low=0.02, light_known=False, n=4), SIGNAL_DN)
    assert (found.value, found.std_error) == (1.0, 0.0)
