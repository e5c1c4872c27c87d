"""Position of the sun at a time and a place, by pvlib."""

from dataclasses import dataclass, fields, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from rigctl.files.place import Place


@dataclass(frozen=True, kw_only=True)
class SunPosition:
    """Position of the sun.

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


def sun_moved_by_place(time: datetime, place: Place, std: Place) -> NDArray[np.float64]:
    """Return by how much zenith and azimuth of the sun change with each number of the place that is uncertain.

    Parameters
    ----------
    time : datetime
        With a time zone.
    place, std : Place
        The place, and by how much each of its numbers changes, half of that each way; 0 is left out.

    Returns
    -------
    (k, 2) array
        Of zenith angle and azimuth, the shorter way round [rad], for each of the k numbers that change.
    """
    steps = {field.name: getattr(std, field.name) for field in fields(std)}
    moved = [_moved(time, place, name, step) for name, step in steps.items() if step > 0.0]
    return np.array(moved).reshape(-1, 2)


def _moved(time: datetime, place: Place, name: str, step: float) -> tuple[float, float]:
    before, after = (
        sun_position(time, replace(place, **{name: getattr(place, name) + 0.5 * by})) for by in (-step, step)
    )
    turned = (after.azimuth_rad - before.azimuth_rad + np.pi) % (2.0 * np.pi) - np.pi
    return after.zenith_rad - before.zenith_rad, float(turned)


def sun_position(time: datetime, place: Place) -> SunPosition:
    """Return the position of the sun.

    Parameters
    ----------
    time : datetime
        With a time zone.
    place : Place
        From where it is seen.

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
    found = solarposition.get_solarposition(when, place.latitude_deg, place.longitude_deg, altitude=place.elevation_m)
    distance_au = float(np.asarray(solarposition.nrel_earthsun_distance(when))[0])
    return SunPosition(
        zenith_rad=float(np.radians(found["zenith"].iloc[0])),
        azimuth_rad=float(np.radians(found["azimuth"].iloc[0])),
        distance_factor=distance_au**-2,
    )
