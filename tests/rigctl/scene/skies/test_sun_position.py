from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pandas as pd
import pytest
from pvlib import solarposition

from rigctl.files.place import Place
from rigctl.scene.sun import sun_position

EDT = timezone(timedelta(hours=-4))
ROCHESTER = Place(latitude_deg=43.085, longitude_deg=-77.68, elevation_m=168.0)


def at(hour, minute, second):
    return sun_position(datetime(2010, 5, 25, hour, minute, second, tzinfo=EDT), ROCHESTER)


# Zenith angle and azimuth on 2010-05-25 in Rochester by NREL's algorithm; the times are rounded to 10 s, in which the
# sun moves by 0.03 deg at most in zenith angle, and by 0.10 deg in azimuth at noon.
@pytest.mark.parametrize(
    ("time", "zenith_deg", "azimuth_deg"),
    [
        ((13, 7, 40), 22.067, 180.0),
        ((10, 9, 40), 43.0, 106.45),
        ((16, 5, 40), 43.0, 253.60),
    ],
)
def test_table_of_rochester(time, zenith_deg, azimuth_deg):
    found = at(*time)
    assert np.degrees(found.zenith_rad) == pytest.approx(zenith_deg, abs=0.01 if time[0] == 13 else 0.03)
    assert np.degrees(found.azimuth_rad) == pytest.approx(azimuth_deg, abs=0.10 if time[0] == 13 else 0.03)


def test_the_sun_does_not_reach_22_deg_that_day():
    zenith = [np.degrees(at(13, minute, second).zenith_rad) for minute in range(3, 13) for second in range(0, 60, 10)]
    assert min(zenith) == pytest.approx(22.067, abs=0.001)
    assert 13 * 360 + 18 + int(np.argmin(zenith)) == pytest.approx(13 * 360 + 7 * 6 + 4, abs=2)  # 13:07:40, in 10 s


@pytest.mark.parametrize(("time", "zenith_deg"), [((12, 11, 20), 25.0), ((14, 3, 50), 25.0), ((9, 30, 30), 50.0)])
def test_times_of_round_zenith_angles(time, zenith_deg):
    # Half of the 10 s to which the times are rounded: 0.015 deg.
    assert np.degrees(at(*time).zenith_rad) == pytest.approx(zenith_deg, abs=0.016)


def test_distance_on_day_145():
    # Four digits of some time of that day, in which it falls by 3e-4.
    assert at(13, 7, 40).distance_factor == pytest.approx(0.9748, abs=2e-4)


def test_time_zones_are_only_words():
    utc = sun_position(datetime(2010, 5, 25, 17, 7, 40, tzinfo=UTC), ROCHESTER)
    assert utc == at(13, 7, 40)


def test_a_time_without_zone_is_refused():
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


def test_azimuths_are_in_a_turn():
    noon, later = at(13, 7, 40), at(20, 0, 0)
    assert 0.0 <= noon.azimuth_rad < later.azimuth_rad < 2.0 * np.pi
