from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from rigctl.files.place import Place
from rigctl.scene.skies.sun_position import sun_position

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
