"""Where the sun stands at a time and a place, by pvlib."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from rigctl.angles import wrapped


@dataclass(frozen=True, kw_only=True)
class SunPosition:
    """Where the sun stands.

    Attributes
    ----------
    zenith_rad : float
        Geometric, without refraction [rad].
    azimuth_rad : float
        Clockwise from north [rad].
    distance_factor : float
        Irradiance outside the atmosphere over that at the mean distance.
    """

    zenith_rad: float
    azimuth_rad: float
    distance_factor: float


def sun_moved_by_place(time: datetime, place: Mapping[str, float], name: str, *, by: float) -> tuple[float, float]:
    """Return by how much zenith and azimuth of the sun change where one number of the place does, half a step each way.

    Parameters
    ----------
    time : datetime
        With a time zone.
    place : mapping
        latitude_deg, longitude_deg and elevation_m.
    name : str
        Which of them.
    by : float
        Change, in the unit of that number, above 0.

    Returns
    -------
    tuple of float
        Of the zenith angle and of the azimuth, the shorter way round [rad].

    References
    ----------
    Definition: a central difference.
    """
    before, after = (sun_position(time, **_moved(place, name, 0.5 * step)) for step in (-by, by))
    turned = wrapped(after.azimuth_rad - before.azimuth_rad, turn=2.0 * np.pi)
    return after.zenith_rad - before.zenith_rad, float(turned)


def _moved(place: Mapping[str, float], name: str, step: float) -> dict[str, float]:
    return {**place, name: place[name] + step}


def sun_position(time: datetime, *, latitude_deg: float, longitude_deg: float, elevation_m: float) -> SunPosition:
    """Return where the sun stands.

    Parameters
    ----------
    time : datetime
        With a time zone.
    latitude_deg, longitude_deg : float
        North and east are positive [deg].
    elevation_m : float
        Above sea level [m].

    Raises
    ------
    ValueError
        The time has no zone.

    Notes
    -----
    Refraction, which lifts the sun by 0.02 deg at 50 deg from the zenith, is left out: the atmosphere has none either.

    References
    ----------
    Reda & Andreas, Solar Energy 76 (2004) 577, doi:10.1016/j.solener.2003.12.003, as pvlib has it.
    """
    if time.tzinfo is None:
        raise ValueError(f"time = {time.isoformat()} has no zone; write 2010-05-25T13:07:40-04:00, or ...17:07:40Z")
    # Imported here: it brings pandas, which the rest of the program does without.
    import pandas as pd
    from pvlib import solarposition

    when = pd.DatetimeIndex([time])
    found = solarposition.get_solarposition(when, latitude_deg, longitude_deg, altitude=elevation_m)
    distance_au = float(np.asarray(solarposition.nrel_earthsun_distance(when))[0])
    return SunPosition(
        zenith_rad=float(np.radians(found["zenith"].iloc[0])),
        azimuth_rad=float(np.radians(found["azimuth"].iloc[0])),
        distance_factor=distance_au**-2,
    )
