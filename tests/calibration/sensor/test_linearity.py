"""Mean against light: the response of a sensor, its errors, and when there is none."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.sensor.curves import LINEARITY_LEVELS, LinearityCurve, fit_linearity
from calibration.sensor.levels import LevelStatistics
from tests.calibration.sensor.synthetic_sensor import SyntheticCamera, SyntheticSensor

FloatArray = NDArray[np.float64]

LIGHT = np.linspace(0.05, 0.8, 14)
FULL_DN = 4000.0
QUADRATIC, CUBIC = -0.01 / FULL_DN, -0.02 / FULL_DN**2
NOISE_DN = 0.5


@cache
def template() -> LevelStatistics:
    return SyntheticCamera(SyntheticSensor(shape=(8, 8)), 1).level(2, kind="flat", light_e=1000.0, exposure_s=0.01)


def response(x_dn: FloatArray) -> FloatArray:
    return x_dn * (1.0 + QUADRATIC * x_dn + CUBIC * x_dn**2)


def fitted(
    seed: int, *, flicker: float = 0.0, offset_s: float = 0.0, photons_per_s: float | None = None, lamp: float = 1.0
) -> LinearityCurve | None:
    """Levels of exposures that are `offset_s` longer than stated, the lamp `lamp` times as bright from halfway on."""
    draws = np.random.default_rng(seed)
    brightness = np.where(np.arange(len(LIGHT)) < 7, 1.0, lamp) * (1.0 + flicker * draws.standard_normal(len(LIGHT)))
    signal = response(FULL_DN * (LIGHT + offset_s) * brightness) + NOISE_DN * draws.standard_normal(len(LIGHT))
    flats = [
        replace(
            template(),
            exposure_s=float(light),
            photons=None if photons_per_s is None else float(photons_per_s * (light + offset_s) * bright),
        )
        for light, bright in zip(LIGHT, brightness, strict=True)
    ]
    return fit_linearity(flats, signal, noise_dn2=np.full(len(LIGHT), NOISE_DN**2))


@pytest.mark.parametrize(("flicker", "offset_s"), [(0.0, 0.0), (0.0, 0.004), (0.0, -0.004), (0.003, 0.0)])
def test_terms_have_the_errors_that_they_say(flicker: float, offset_s: float) -> None:
    scores = []
    for seed in range(60):
        found = fitted(seed, flicker=flicker, offset_s=offset_s)
        assert found is not None
        error = np.array([found.quadratic_per_dn - QUADRATIC, found.cubic_per_dn2 - CUBIC])
        scores.append(error / np.sqrt(np.diag(found.covariance)))
    # Scatter from 10 degrees of freedom: variance near 10 / 8; where there is none, the part of it that noise makes up
    # half of the time lowers it. 4 sigma of 60.
    assert np.all(np.abs(np.mean(scores, axis=0)) < 4.0 * np.sqrt(1.25 / 60.0))
    assert np.all(np.abs(np.var(scores, axis=0) - 1.0) < 4.0 * 1.25 * np.sqrt(3.0 / 60.0))


def test_what_the_response_does_to_the_variance() -> None:
    found = LinearityCurve(
        dn_per_photon=None,
        dn_per_photon_std_error=0.0,
        light="exposure",
        quadratic_per_dn=QUADRATIC,
        cubic_per_dn2=CUBIC,
        covariance=np.zeros((2, 2)),
        relative_scatter=0.0,
    )
    x = np.linspace(0.05, 0.5, 10) * FULL_DN
    slope = 1.0 + 2.0 * QUADRATIC * x + 3.0 * CUBIC * x**2
    signal = response(x)
    series = signal * (1.0 + 3.0 * QUADRATIC * signal + found.variance_cubic_per_dn2 * signal**2)
    # What is left out: products of three terms, at most 20 b c u^3 + 40 c^2 u^4 with b = 0.01, c = 0.02, u = 0.5.
    np.testing.assert_allclose(x * slope**2, series, rtol=0.0015)


def test_a_lamp_that_drifts_is_within_the_error_of_the_cubic_term() -> None:
    # signal = t (1 - a t + 2 a^2 t^2 ...) of a linear sensor, whose photon-transfer curve has no cubic term.
    drift = 1e-5
    found = LinearityCurve(
        dn_per_photon=None,
        dn_per_photon_std_error=0.0,
        light="exposure",
        quadratic_per_dn=-drift,
        cubic_per_dn2=2.0 * drift**2,
        covariance=np.zeros((2, 2)),
        relative_scatter=0.0,
    )
    assert abs(found.variance_cubic_per_dn2) < 1.8 * found.variance_cubic_error_per_dn2


def test_photons_count_where_the_lamp_was_changed() -> None:
    found = fitted(1, photons_per_s=1e5, lamp=1.2)
    assert found is not None
    assert found.light == "photons"
    assert abs(found.cubic_per_dn2 - CUBIC) < 5.0 * np.sqrt(found.covariance[1, 1])


def test_exposures_count_where_photons_say_the_same() -> None:
    found = fitted(1, photons_per_s=1e5)
    assert found is not None
    assert found.light == "exposure"


def test_an_unsteady_lamp_makes_the_errors_large() -> None:
    steady, unsteady = fitted(2), fitted(2, flicker=0.02)
    assert steady is not None
    assert unsteady is not None
    assert unsteady.variance_cubic_error_per_dn2 > 5.0 * steady.variance_cubic_error_per_dn2
    # Half of the largest, by its few degrees of freedom.
    assert unsteady.relative_scatter == pytest.approx(0.02, rel=0.6)


def test_few_exposures_give_no_response() -> None:
    n = LINEARITY_LEVELS - 1
    flats = [replace(template(), exposure_s=float(light)) for light in LIGHT[:n]]
    assert fit_linearity(flats, FULL_DN * LIGHT[:n], noise_dn2=np.ones(n)) is None


def test_one_exposure_gives_no_response() -> None:
    assert fit_linearity([template()] * 14, FULL_DN * LIGHT, noise_dn2=np.ones(14)) is None
