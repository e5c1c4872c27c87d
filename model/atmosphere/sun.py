"""The Sun above the atmosphere: its distance, and its spectrum in the band of a sensor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


def distance_factor(*, day_of_year: float) -> float:
    """Irradiance outside the atmosphere over that at the mean distance of the Sun, (R0/R)^2.

    Parameters
    ----------
    day_of_year
        1 on the first of January, up to 367.

    Raises
    ------
    ValueError
        The day is outside its range.

    Notes
    -----
    Within 1e-3 of an ephemeris.

    References
    ----------
    Spencer, Search 2 (1971) 172.
    """
    if not 1.0 <= day_of_year < 367.0:
        raise ValueError(f"day_of_year = {day_of_year!r}, allowed is 1 to 367")
    angle = 2.0 * np.pi * (day_of_year - 1.0) / 365.0
    first = 1.000110 + 0.034221 * np.cos(angle) + 0.001280 * np.sin(angle)
    return float(first + 0.000719 * np.cos(2.0 * angle) + 0.000077 * np.sin(2.0 * angle))


@dataclass(frozen=True, kw_only=True)
class SolarBand:
    """Spectrum of the Sun outside the atmosphere in the band of a sensor.

    Attributes
    ----------
    wavelength_m
        Samples [m], shape (N,), increasing, two or more.
    irradiance_w_per_m3
        Spectral irradiance at the actual distance of the Sun [W m-2 per m of wavelength], 0 or more.
    response
        Relative response of the sensor, 0 to 1; 1 throughout gives the radiation in the band itself.
    """

    wavelength_m: NDArray[np.float64]
    irradiance_w_per_m3: NDArray[np.float64]
    response: NDArray[np.float64]

    def __post_init__(self) -> None:
        count = np.size(self.wavelength_m)
        shapes = {np.shape(self.wavelength_m), np.shape(self.irradiance_w_per_m3), np.shape(self.response)}
        if count < 2 or shapes != {(count,)} or not np.all(np.diff(self.wavelength_m) > 0.0):
            raise ValueError("SolarBand: wants three arrays of one length, 2 or more, over increasing wavelength_m")
        if not np.all((self.irradiance_w_per_m3 >= 0.0) & np.isfinite(self.irradiance_w_per_m3)):
            raise ValueError("SolarBand: irradiance_w_per_m3 must be finite and 0 or more")
        if not np.all((self.response >= 0.0) & (self.response <= 1.0)) or not np.any(self.weighted > 0.0):
            raise ValueError("SolarBand: response must be 0 to 1, and somewhere above 0 where the Sun shines")

    @property
    def weighted(self) -> NDArray[np.float64]:
        """Spectral irradiance times response [W m-3]."""
        return self.irradiance_w_per_m3 * self.response

    @property
    def limits_m(self) -> tuple[float, float]:
        """Shortest and longest wavelength with a response, with the sample beyond on either side [m]."""
        used = np.flatnonzero(self.response > 0.0)
        first, last = max(used[0] - 1, 0), min(used[-1] + 1, self.response.size - 1)
        return float(self.wavelength_m[first]), float(self.wavelength_m[last])

    @property
    def shares(self) -> NDArray[np.float64]:
        """Irradiance that each sample stands for by the trapezoidal rule, shape (N,) [W m-2]."""
        reach = np.diff(self.wavelength_m)
        return np.asarray(self.weighted * 0.5 * (np.append(reach, 0.0) + np.append(0.0, reach)))

    def integral(self, factor: NDArray[np.float64]) -> NDArray[np.float64]:
        """Irradiance in the band after a spectral factor (..., N) [W m-2], by the trapezoidal rule."""
        return np.asarray(np.sum(self.shares * factor, axis=-1))
