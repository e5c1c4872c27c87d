"""Position of the sun at a time and a place, and its spectrum in the band of a sensor.

The position is that of the International Astronomical Union's routines; the spectrum ASTM G173 outside the atmosphere.
"""

import warnings
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.sky import SolarBand
from rigctl.errors import ConfigError
from rigctl.files.place import Place, SiteSection
from rigctl.files.scene_file import SensorSection

FloatArray = NDArray[np.float64]

_DAY_S = 86400.0
# Julian date of the midnight at which day 0 of Python's calendar begins.
_JULIAN_DAY_OF_YEAR_1 = 1721424.5
# Motion of the pole, at most 0.0001 deg, is neglected.
_POLE_RAD = (0.0, 0.0)
# Pressure [hPa], temperature [degC], humidity, wavelength [um]: without pressure there is no refraction.
_NO_AIR = (0.0, 0.0, 0.0, 0.55)


@dataclass(frozen=True, kw_only=True)
class SunPosition:
    """Position of the sun."""

    zenith_rad: float  #: Geometric, without refraction [rad].
    azimuth_rad: float  #: Clockwise from north [rad].
    distance_factor: float  #: Irradiance outside the atmosphere over that at the mean distance.


def sun_position(time: datetime, place: Place) -> SunPosition:
    """Return the position of the sun.

    Refraction, 0.02 deg at 50 deg from the zenith, is neglected, as in the atmosphere. UTC replaces the Earth's
    rotation, from which it differs by at most 0.9 s: 0.004 deg. Future leap seconds, each with the same effect, are
    unknown.

    Standards of Fundamental Astronomy, IAU (2006 precession, 2000A nutation), as ERFA has them (apco13, ab, atioq).
    """
    if time.tzinfo is None:
        raise ValueError(f"time = {time.isoformat()} has no zone; write 2010-05-25T13:07:40-04:00, or ...17:07:40Z")
    import erfa

    day = _julian_date(time)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*dubious year", category=erfa.ErfaWarning)
        observer, _ = erfa.apco13(
            *day,
            0.0,  # UT1 - UTC [s]
            np.radians(place.longitude_deg),
            np.radians(place.latitude_deg),
            place.elevation_m,
            *_POLE_RAD,
            *_NO_AIR,
        )
    # From the observer to the sun, corrected for aberration (20 arc seconds), precession and nutation.
    toward = erfa.ab(-observer["eh"], observer["v"], observer["em"], observer["bm1"])
    right_ascension, declination = erfa.c2s(erfa.rxp(observer["bpn"], toward))
    azimuth_rad, zenith_rad, *_ = erfa.atioq(right_ascension, declination, observer)
    from_sun, _ = erfa.epv00(*day)  # of the Earth's centre, the same for every place [au]
    return SunPosition(
        zenith_rad=float(zenith_rad),
        azimuth_rad=float(azimuth_rad),
        distance_factor=1.0 / float(np.sum(from_sun["p"] ** 2)),
    )


def _julian_date(time: datetime) -> tuple[float, float]:
    """Return the Julian date of the last midnight UTC and the part of the day since, as two numbers."""
    utc = time.astimezone(UTC)
    midnight = utc.replace(hour=0, minute=0, second=0, microsecond=0)
    return _JULIAN_DAY_OF_YEAR_1 + utc.toordinal(), (utc - midnight).total_seconds() / _DAY_S


NM_PER_M = 1e9
# Range of the atmosphere's tables.
SHORTEST_NM, LONGEST_NM = 300.0, 1060.0


def response_band(*, wavelength_nm: FloatArray, response: FloatArray, distance_factor: float) -> SolarBand:
    """Return the sun's spectrum with a sensor's response, linear between the points of its table and 0 beyond."""
    if wavelength_nm.size < 2 or np.any(np.diff(wavelength_nm) <= 0.0):
        raise ValueError("the sensor's response: wavelength_nm must hold two or more rising numbers")
    if wavelength_nm[0] < SHORTEST_NM or wavelength_nm[-1] > LONGEST_NM:
        raise ValueError(
            f"the sensor's response: wavelength_nm runs from {wavelength_nm[0]:g} to {wavelength_nm[-1]:g} nm, "
            f"allowed is {SHORTEST_NM:g} to {LONGEST_NM:g} nm"
        )
    spectrum_nm, irradiance = _extraterrestrial()
    inside = (spectrum_nm > wavelength_nm[0]) & (spectrum_nm < wavelength_nm[-1])
    # numpy's union imports masked arrays, a tenth of a short prediction.
    nodes_nm = np.array(sorted({*spectrum_nm[inside].tolist(), *wavelength_nm.tolist()}))
    return SolarBand(
        wavelength_m=nodes_nm / NM_PER_M,
        irradiance_w_per_m3=distance_factor * NM_PER_M * np.interp(nodes_nm, spectrum_nm, irradiance),
        response=np.interp(nodes_nm, wavelength_nm, response),
    )


@cache
def _extraterrestrial() -> tuple[FloatArray, FloatArray]:
    """Wavelengths [nm] and irradiance [W m-2 nm-1] at the mean distance of the sun."""
    table = (files("rigctl") / "data" / "astm-g173-extraterrestrial.csv").read_text(encoding="ascii")
    wavelength_nm, irradiance = np.loadtxt(table.splitlines(), delimiter=",", skiprows=2, unpack=True)
    return wavelength_nm, irradiance


def band_points(sensor: SensorSection, scene_name: str) -> tuple[tuple[float, float], ...]:
    """Return wavelengths [nm] and relative response of a scene's sensor."""
    if sensor.response is not None:
        return tuple(zip(sensor.response.wavelength_nm, sensor.response.response, strict=True))
    if sensor.band_nm is None:
        raise ConfigError(f"scene {scene_name}: the sensor needs band_nm or response")
    return tuple((wavelength_nm, 1.0) for wavelength_nm in sensor.band_nm)


def sun_covariance_deg2(site: SiteSection, time: datetime) -> FloatArray:
    """Return the covariance of zenith and azimuth of the sun from the uncertainty of the site, shape (2, 2) [deg^2]."""
    moved = []
    for number in fields(site.std):
        if (step := getattr(site.std, number.name)) > 0.0:
            at = getattr(site.place, number.name)
            before, after = (
                sun_position(time, replace(site.place, **{number.name: at + 0.5 * by})) for by in (-step, step)
            )
            turned = (after.azimuth_rad - before.azimuth_rad + np.pi) % (2.0 * np.pi) - np.pi
            moved.append([after.zenith_rad - before.zenith_rad, turned])
    moved_deg = np.rad2deg(np.array(moved).reshape(-1, 2))
    return np.asarray(moved_deg.T @ moved_deg)
