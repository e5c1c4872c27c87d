"""Position of the sun against NREL's algorithm and published times; its spectrum in a band against ASTM G173."""

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pandas as pd
import pytest
from pvlib import solarposition, spectrum

from rigctl.files.place import Place
from rigctl.scene.sun import response_band, sun_position

EDT = timezone(timedelta(hours=-4))
ROCHESTER = Place(latitude_deg=43.085, longitude_deg=-77.68, elevation_m=168.0)


def at(hour, minute, second):
    return sun_position(datetime(2010, 5, 25, hour, minute, second, tzinfo=EDT), ROCHESTER)


# On 2010-05-25 in Rochester by NREL's algorithm; times are rounded to 10 s, in which the sun moves by 0.03 deg at most
# in zenith angle, and by 0.10 deg in azimuth at noon.
@pytest.mark.parametrize(
    ("time", "zenith_deg", "within_deg", "azimuth_deg"),
    [
        ((13, 7, 40), 22.067, 0.01, 180.0),
        ((10, 9, 40), 43.0, 0.03, 106.45),
        ((16, 5, 40), 43.0, 0.03, 253.60),
        ((12, 11, 20), 25.0, 0.016, None),
        ((14, 3, 50), 25.0, 0.016, None),
        ((9, 30, 30), 50.0, 0.016, None),
    ],
)
def test_table_of_rochester(time, zenith_deg, within_deg, azimuth_deg):
    found = at(*time)
    assert np.degrees(found.zenith_rad) == pytest.approx(zenith_deg, abs=within_deg)
    if azimuth_deg is not None:
        assert np.degrees(found.azimuth_rad) == pytest.approx(azimuth_deg, abs=0.10 if time[0] == 13 else 0.03)


def test_the_sun_does_not_reach_22_deg_that_day():
    zenith = [np.degrees(at(13, minute, second).zenith_rad) for minute in range(3, 13) for second in range(0, 60, 10)]
    assert min(zenith) == pytest.approx(22.067, abs=0.001)
    assert 18 + int(np.argmin(zenith)) == pytest.approx(7 * 6 + 4, abs=2)  # 13:07:40, in 10 s


def test_time_zones_are_only_words_and_have_to_be_there():
    noon = at(13, 7, 40)
    assert sun_position(datetime(2010, 5, 25, 17, 7, 40, tzinfo=UTC), ROCHESTER) == noon
    # Four digits of some time of that day, in which it falls by 3e-4.
    assert noon.distance_factor == pytest.approx(0.9748, abs=2e-4)
    assert 0.0 <= noon.azimuth_rad < at(20, 0, 0).azimuth_rad < 2.0 * np.pi
    with pytest.raises(ValueError, match="has no zone"):
        sun_position(datetime(2010, 5, 25, 13, 7, 40), ROCHESTER)


def test_nrels_algorithm_gives_the_same_over_years_and_sites():
    # Its authors state 3e-4 deg; it takes UTC for the rotation too. Seen on 400 draws: 2.3e-4 deg, 3.4e-6 in distance.
    draws = np.random.default_rng(5)
    for _ in range(40):
        time = datetime(1990, 1, 1, tzinfo=UTC) + timedelta(days=float(draws.uniform(0.0, 60.0 * 365.0)))
        place = Place(
            latitude_deg=float(draws.uniform(-89.0, 89.0)),
            longitude_deg=float(draws.uniform(-180.0, 180.0)),
            elevation_m=float(draws.uniform(0.0, 4000.0)),
        )
        ours, when = sun_position(time, place), pd.DatetimeIndex([time])
        theirs = solarposition.get_solarposition(
            when, place.latitude_deg, place.longitude_deg, altitude=place.elevation_m
        ).iloc[0]
        turned_deg = (np.degrees(ours.azimuth_rad) - theirs["azimuth"] + 180.0) % 360.0 - 180.0
        assert np.degrees(ours.zenith_rad) == pytest.approx(theirs["zenith"], abs=1e-3)
        assert turned_deg * np.sin(ours.zenith_rad) == pytest.approx(0.0, abs=1e-3)
        distance_au = float(np.asarray(solarposition.nrel_earthsun_distance(when))[0])
        assert ours.distance_factor == pytest.approx(distance_au**-2, rel=5e-6)


def band(*wavelength_nm, response=None, distance_factor=1.0):
    answers = np.ones(len(wavelength_nm)) if response is None else np.array(response)
    return response_band(
        wavelength_nm=np.array(wavelength_nm, dtype=float), response=answers, distance_factor=distance_factor
    )


def integral(found):
    return float(found.integral(np.ones(found.response.size)))


# ASTM G173 outside the atmosphere, integrated between limits [W m-2], four digits.
@pytest.mark.parametrize(("limits", "irradiance"), [((400, 700), 530.0), ((380, 780), 655.9), ((350, 1000), 895.5)])
def test_irradiance_of_flat_bands(limits, irradiance):
    assert integral(band(*limits)) == pytest.approx(irradiance, abs=0.06)
    assert integral(band(*limits, distance_factor=0.9748)) == pytest.approx(0.9748 * irradiance, abs=0.06)


def test_a_triangle_weighs_half_of_what_it_spans():
    ratio = integral(band(500, 550, 600, response=[0.0, 1.0, 0.0])) / integral(band(500, 600))
    assert ratio == pytest.approx(0.5, abs=0.01)  # the spectrum varies by some per cent within


def test_limits_between_samples_of_the_spectrum_count_exactly():
    assert band(500.25, 600.75).wavelength_m[[0, -1]] * 1e9 == pytest.approx([500.25, 600.75])


@pytest.mark.parametrize(
    ("wavelengths", "word"),
    [([290.0, 500.0], "300 to 1060"), ([400.0, 1100.0], "300 to 1060"), ([500.0, 400.0], "rising")],
)
def test_bands_beyond_the_atmospheres_tables_are_refused(wavelengths, word):
    with pytest.raises(ValueError, match=word):
        band(*wavelengths)


def test_the_table_is_that_of_the_standard():
    theirs = spectrum.get_reference_spectra(standard="ASTM G173-03")["extraterrestrial"].loc[300.0:1060.0]
    ours = band(300.0, 1060.0)
    np.testing.assert_allclose(ours.wavelength_m * 1e9, theirs.index, rtol=1e-12)
    np.testing.assert_allclose(ours.irradiance_w_per_m3 / 1e9, theirs, rtol=1e-12)
