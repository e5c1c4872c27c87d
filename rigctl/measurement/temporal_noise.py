"""Temporal variance of a run's frames by a noise calibration."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from model.sensor import SensorNoise, temporal_variance_dn2
from rigctl.errors import DataError

if TYPE_CHECKING:
    from rigctl.calibrations.noise.noise_file import NoiseParameters
    from rigctl.measurement.measurement import Measurement
    from rigctl.measurement.region_numbers import MeasuredRegion

FloatArray = NDArray[np.float64]

# What a temporal deviation rests on, in the order of the vector that is varied.
INPUTS = ("gain_dn_per_e", "read_noise_e", "dark_current_e_per_s")


@dataclass(frozen=True, kw_only=True, eq=False)
class TemporalNoise:
    """The numbers of a calibration that temporal noise rests on.

    Attributes
    ----------
    values : (3,) array
        Gain [DN/e-], read noise [e-] and dark current [e-/s].
    cov : (3, 3) array
        Their covariance.
    remarks : tuple of str
        What was set aside.
    """

    values: FloatArray
    cov: FloatArray
    remarks: tuple[str, ...]


def temporal_noise(noise: "NoiseParameters") -> TemporalNoise:
    """Return what temporal noise rests on, by a noise calibration.

    Raises
    ------
    DataError
        The calibration has no read noise.
    """
    if noise.read_noise_e is None:
        raise DataError("the noise calibration has no read_noise_e: it cannot predict a temporal deviation")
    remarks = []
    dark = noise.dark_current_e_per_s
    if dark is None:
        remarks.append("dark current: not calibrated, taken as 0")
    elif dark.value < 0.0:
        remarks.append(f"dark current: the calibration's {dark.value:.3g} e-/s is below 0 by its error; 0 is used")
    sensor = noise.sensor_noise()
    return TemporalNoise(
        values=np.array([sensor.gain_dn_per_e, sensor.read_noise_e, sensor.dark_current_e_per_s]),
        cov=noise.covariance_of(INPUTS),
        remarks=tuple(remarks),
    )


def temporal_variance(measurement: "Measurement", region: "MeasuredRegion", values: FloatArray) -> FloatArray:
    """Return the temporal variance of each channel of a region at its measured signal, shape (N,) [grid.unit^2].

    Parameters
    ----------
    measurement, region
        Exposures and mean signal.
    values : (3,) array
        Gain, read noise and dark current, as in `TemporalNoise`.

    Raises
    ------
    DataError
        The exposure is not known.
    """
    grid = measurement.grid
    if grid.exposures_s is None:
        raise DataError(f"{measurement.run.path}: its exposure is not known: the noise cannot be predicted")
    gain, read_noise, dark_current = values.tolist()
    noise = SensorNoise(
        gain_dn_per_e=gain, read_noise_e=read_noise, dark_current_e_per_s=dark_current, black_level_dn=0.0
    )
    signal_dn = region.channels_mean.mean / grid.to_unit
    variance = temporal_variance_dn2(signal_dn, noise=noise, exposure_s=grid.exposures_s)
    return np.asarray(variance * grid.to_unit**2 * measurement.noise_factor)
