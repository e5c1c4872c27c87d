"""The sun's spectrum in the band of a sensor: ASTM G173 outside the atmosphere."""

from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.sky import SolarBand

FloatArray = NDArray[np.float64]

NM_PER_M = 1e9
# What the atmosphere's tables cover.
SHORTEST_NM, LONGEST_NM = 300.0, 1060.0


def response_band(*, wavelength_nm: FloatArray, response: FloatArray, distance_factor: float) -> SolarBand:
    """Return the sun's spectrum with a sensor's response, linear between the points of its table and 0 beyond.

    Parameters
    ----------
    wavelength_nm : (K,) array
        Ascending, 300 to 1060 [nm].
    response : (K,) array
        Relative, 0 to 1.
    distance_factor : float
        Irradiance outside the atmosphere over that at the mean distance.

    Raises
    ------
    ValueError
        The wavelengths or the response are outside their range.
    """
    if wavelength_nm.size < 2 or np.any(np.diff(wavelength_nm) <= 0.0):
        raise ValueError("the sensor's response: wavelength_nm must hold two or more rising numbers")
    if wavelength_nm[0] < SHORTEST_NM or wavelength_nm[-1] > LONGEST_NM:
        raise ValueError(
            f"the sensor's response: wavelength_nm runs from {wavelength_nm[0]:g} to {wavelength_nm[-1]:g} nm, "
            f"allowed is {SHORTEST_NM:g} to {LONGEST_NM:g} nm"
        )
    spectrum_nm, irradiance = _extraterrestrial()
    inside = (spectrum_nm > wavelength_nm[0]) & (spectrum_nm < wavelength_nm[-1])
    nodes_nm = np.union1d(spectrum_nm[inside], wavelength_nm)
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
