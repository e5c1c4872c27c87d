"""Saturation as the peak of the variance, on clipped normal noise, whose moments are known."""

import numpy as np
import pytest
from scipy.special import ndtr

from calibration.sensor.curves import saturation_level

GAIN_DN_PER_E = 0.25
CEILING_DN = 4000.0


def clipped_curve(light_dn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of min(N(light, gain * light), ceiling)."""
    sigma = np.sqrt(GAIN_DN_PER_E * light_dn)
    alpha = (CEILING_DN - light_dn) / sigma
    density = np.exp(-0.5 * alpha**2) / np.sqrt(2.0 * np.pi)
    mean = light_dn * ndtr(alpha) - sigma * density + CEILING_DN * ndtr(-alpha)
    square = (
        (light_dn**2 + sigma**2) * ndtr(alpha)
        - sigma * (light_dn + CEILING_DN) * density
        + CEILING_DN**2 * ndtr(-alpha)
    )
    return mean, square - mean**2


def true_saturation_dn() -> float:
    mean, variance = clipped_curve(np.linspace(3000.0, 4200.0, 24_001))
    return float(mean[np.argmax(variance)])


@pytest.mark.parametrize("step_dn", [90.0, 137.0, 210.0, 333.0])
@pytest.mark.parametrize("start", [0.0, 0.25, 0.5, 0.75])
def test_the_interval_holds_the_peak(step_dn: float, start: float) -> None:
    mean, variance = clipped_curve(np.arange(300.0 + start * step_dn, 5000.0, step_dn))
    level = saturation_level(signal_dn=mean, variance_dn2=variance)
    assert level is not None
    # A value evenly likely in an interval is never further than sqrt(3) standard deviations from its middle.
    assert abs(level.signal_dn - true_saturation_dn()) <= np.sqrt(3.0) * level.std_error_dn
    # Two steps at most: the level with the largest variance may be past the peak, and the next one not yet fallen.
    assert level.std_error_dn <= 2.0 * step_dn / np.sqrt(12.0)


def test_a_sweep_that_ends_too_early_has_none() -> None:
    mean, variance = clipped_curve(np.arange(300.0, 2400.0, 100.0))
    assert saturation_level(signal_dn=mean, variance_dn2=variance) is None


def test_a_dip_within_the_scatter_of_points_is_not_saturation() -> None:
    mean, variance = clipped_curve(np.arange(300.0, 2400.0, 300.0))
    variance[-1] = 0.97 * variance[-2]
    assert saturation_level(signal_dn=mean, variance_dn2=variance) is None
