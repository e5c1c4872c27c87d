import numpy as np
import pytest

from model.atmosphere.sky import SolarBand, distance_factor


def test_distance_on_the_25th_of_may():
    # Ephemeris: 0.9748; Spencer's series is within 1e-3 of it.
    assert distance_factor(day_of_year=145) == pytest.approx(0.9748, abs=1e-3)


def test_the_sun_is_nearest_in_january():
    days = np.arange(1, 366)
    factors = [distance_factor(day_of_year=day) for day in days]
    assert days[np.argmax(factors)] <= 6
    assert np.mean(factors) == pytest.approx(1.0, abs=3e-4)  # 1 + 3/2 e^2 - ... over time


@pytest.mark.parametrize("day", [0.5, 367.0, np.nan])
def test_days_outside_the_year_are_refused(day):
    with pytest.raises(ValueError, match="day_of_year"):
        distance_factor(day_of_year=day)


def band(**change):
    wavelength = np.linspace(400e-9, 500e-9, 11)
    given = {"wavelength_m": wavelength, "irradiance_w_per_m3": np.full(11, 2e9), "response": np.ones(11)}
    return SolarBand(**(given | change))


def test_shares_of_the_samples_sum_to_the_band():
    response = np.linspace(0.0, 1.0, 11)
    assert float(np.sum(band(response=response).shares)) == pytest.approx(100.0)  # mean response 1/2


def test_integral_over_the_band():
    assert float(band().integral(np.ones(11))) == pytest.approx(200.0)


def test_limits_enclose_the_response():
    response = np.zeros(11)
    response[3:6] = 1.0
    assert band(response=response).limits_m == pytest.approx((420e-9, 460e-9))


@pytest.mark.parametrize(
    "change",
    [
        {"response": np.zeros(11)},
        {"response": np.full(11, 1.1)},
        {"irradiance_w_per_m3": np.full(11, -1.0)},
        {"irradiance_w_per_m3": np.ones(10)},
        {"wavelength_m": np.linspace(500e-9, 400e-9, 11)},
    ],
)
def test_impossible_bands_are_refused(change):
    with pytest.raises(ValueError, match="SolarBand"):
        band(**change)
