"""The numbers of a scene file that only say how many counts a radiance makes, and what takes their place."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model.sensor import counts_per_radiance
from rigctl.errors import DataError
from rigctl.scene.model_scene import sensor_of
from rigctl.scene.parameter_table import EFFICIENCY, GAIN, TRANSMITTANCE
from rigctl.scene.scene_inputs import Inputs
from rigctl.scene.scene_record import Scene

FloatArray = NDArray[np.float64]

# A scale that is measured holds all of them; the gain is not one, since noise rests on it too.
_THROUGHPUT = (
    EFFICIENCY,
    TRANSMITTANCE,
    "sensor.pixel_pitch_um",
    "sensor.f_number",
    "sensor.wavelength_nm",
    "sensor.polarizer_transmittance",
)


def modelled_response(scene: Scene, *, exposure_s: float) -> float:
    """Return the counts per unit of unpolarized radiance by the sensor of a scene [DN per W m-2 sr-1]."""
    return counts_per_radiance(sensor_of(scene, exposure_s))


def without_throughput(inputs: Inputs, *, gain: bool = False) -> Inputs:
    """Return the inputs with the numbers of the throughput taken as exact, and with `gain` that of the gain too."""
    exact = (*_THROUGHPUT, GAIN) if gain else _THROUGHPUT
    keep = np.array([0.0 if name in exact else 1.0 for name in inputs.names])
    return replace(inputs, cov=inputs.cov * np.outer(keep, keep))


def rescaled(inputs: Inputs, factor: float, *, variance: float, common: FloatArray) -> Inputs:
    """Return the inputs with a factor on the counts per radiance in place of what the scene file says of it.

    Parameters
    ----------
    inputs : Inputs
        Of scene file and noise calibration.
    factor : float
        On the electrons that a radiance makes, > 0.
    variance : float
        Of its logarithm, with all that goes into `common`.
    common : (k,) array
        Covariance of its logarithm with each input.

    Raises
    ------
    DataError
        More electrons than photons would be needed.

    Notes
    -----
    Transmittance and quantum efficiency are only known as their product, which stands under the latter's name.
    """
    place = {name: k for k, name in enumerate(inputs.names)}
    efficiency = inputs.values[place[EFFICIENCY]] * inputs.values[place[TRANSMITTANCE]] * factor
    if efficiency > 1.0:
        raise DataError(
            f"the scale of the counts needs {efficiency:.3g} electrons per photon, more than there can be: check gain, "
            "exposure, f-number and pixel pitch of scene file and calibrations, and the radiance of the panel"
        )
    fixed = without_throughput(inputs)
    values, cov = fixed.values.copy(), fixed.cov.copy()
    values[place[TRANSMITTANCE]], values[place[EFFICIENCY]] = 1.0, efficiency
    row = efficiency * common * np.array([0.0 if name in _THROUGHPUT else 1.0 for name in inputs.names])
    cov[place[EFFICIENCY], :] = cov[:, place[EFFICIENCY]] = row
    cov[place[EFFICIENCY], place[EFFICIENCY]] = efficiency**2 * variance
    return replace(fixed, scene=fixed.at(values), values=values, cov=cov, fitted=(EFFICIENCY,))
