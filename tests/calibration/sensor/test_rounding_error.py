"""Errors of rounding beside sums over the samples that a normal law gives."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

from calibration.sensor.levels import (
    least_noise_dn2,
    mean_rounding_error_dn,
    spatial_rounding_error_dn2,
    variance_rounding_error_dn2,
)

FloatArray = NDArray[np.float64]
PLACES_DN = np.linspace(0.0, 1.0, 50, endpoint=False)
COUNTS = np.arange(-6.0, 8.0)


def rounded(noise_dn2: float, places_dn: FloatArray = PLACES_DN) -> tuple[FloatArray, FloatArray]:
    """Mean and variance of the whole counts that noise about each place is rounded to."""
    at = (COUNTS[:, None] - places_dn) / np.sqrt(noise_dn2)
    half = 0.5 / np.sqrt(noise_dn2)
    share = ndtr(at + half) - ndtr(at - half)
    mean = COUNTS @ share
    return mean, np.square(COUNTS) @ share - np.square(mean)


@pytest.mark.parametrize("noise_dn2", [0.06, 0.1, 0.16, 0.25])
def test_first_harmonics_are_nearly_all_of_it(noise_dn2: float) -> None:
    mean, variance = rounded(noise_dn2)
    noise, none = np.array(noise_dn2), np.array(0.0)
    assert np.std(mean - PLACES_DN) == pytest.approx(float(mean_rounding_error_dn(noise)), rel=0.05)
    found = np.sqrt(np.mean(np.square(variance - noise_dn2 - 1.0 / 12.0)))
    assert found == pytest.approx(float(variance_rounding_error_dn2(noise, none)), rel=0.05)


@pytest.mark.parametrize("noise_dn2", [0.08, 0.1, 0.16, 0.25, 0.5])
def test_a_measured_variance_promises_no_more_dither_than_there_is(noise_dn2: float) -> None:
    variance = rounded(noise_dn2)[1]
    least = least_noise_dn2(variance, np.zeros_like(variance))
    # The second harmonic tells where noise is a quarter of a count and less.
    assert least.max() <= noise_dn2 + 0.01
    # Half-way between two counts it is the noise itself; where nothing is hidden all over.
    assert least[len(PLACES_DN) // 2] == pytest.approx(noise_dn2, abs=0.01)


@pytest.mark.parametrize(("noise_dn2", "pattern_dn"), [(0.1, 0.12), (0.13, 0.2), (0.2, 0.3)])
def test_pixels_are_pushed_together_or_apart(noise_dn2: float, pattern_dn: float) -> None:
    nodes, weights = np.polynomial.hermite_e.hermegauss(40)
    weights = weights / weights.sum()
    off = []
    for place_dn in PLACES_DN:
        means = rounded(noise_dn2, place_dn + pattern_dn * nodes)[0]
        off.append(weights @ np.square(means) - (weights @ means) ** 2 - pattern_dn**2)
    stated = spatial_rounding_error_dn2(np.array(noise_dn2), np.array(pattern_dn**2))
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(float(stated), rel=0.1)
