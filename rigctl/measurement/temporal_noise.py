"""What a noise calibration says of the temporal variance of a run's frames."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.sensor.sensor import SensorNoise
from model.sensor.temporal_noise import temporal_variance_dn2
from rigctl.errors import DataError
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


def temporal_noise(noise: dict[str, Any]) -> TemporalNoise:
    """Return what temporal noise rests on, of a noise calibration as its file holds it.

    Raises
    ------
    DataError
        The calibration has no read noise.
    """
    if noise["read_noise_e"] is None:
        raise DataError("the noise calibration has no read_noise_e: it cannot predict a temporal deviation")
    remarks = []
    values = [0.0 if noise[name] is None else float(noise[name]["value"]) for name in INPUTS]
    if noise["dark_current_e_per_s"] is None:
        remarks.append("dark current: not calibrated, taken as 0")
    elif values[2] < 0.0:
        remarks.append(f"dark current: the calibration's {values[2]:.3g} e-/s is below 0 by its error; 0 is used")
        values[2] = 0.0
    return TemporalNoise(values=np.array(values), cov=_covariance(noise), remarks=tuple(remarks))


def temporal_variance(measurement: Measurement, region: MeasuredRegion, values: FloatArray) -> FloatArray:
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


def _covariance(noise: dict[str, Any]) -> FloatArray:
    errors = [0.0 if noise[name] is None else float(noise[name]["std_error"]) for name in INPUTS]
    cov = np.diag(np.square(errors))
    joint = noise.get("covariance")
    if joint is None:
        return cov
    places = {name: k for k, name in enumerate(joint["names"])}
    known = [(k, places[name]) for k, name in enumerate(INPUTS) if name in places]
    for here, there in known:
        for also_here, also_there in known:
            cov[here, also_here] = joint["matrix"][there][also_there]
    return cov
