"""The rise of temperature that doubles the dark current."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.estimate import number_with_error
from calibration.sensor.scatter_fit import fit_with_scatter

FloatArray = NDArray[np.float64]

_LEAST = 2
_RESOLVED_SIGMA = 3.0


@dataclass(frozen=True, kw_only=True)
class DoublingTemperature:
    """The doubling interval of a dark current.

    Attributes
    ----------
    value_k, std_error_k : float
        Rise of temperature that doubles the dark current [K].
    n_temperatures : int
        Temperatures it was made from.
    chi2_per_dof : float or None
        How the points fit an exponential; None with two of them.
    """

    value_k: float
    std_error_k: float
    n_temperatures: int
    chi2_per_dof: float | None


def doubling_temperature(
    temperature_c: FloatArray, dark_current: FloatArray, std_error: FloatArray
) -> DoublingTemperature:
    """Return the doubling interval of a dark current.

    Parameters
    ----------
    temperature_c : (n,) array
        Of the sensor, or of its housing in a steady state [degrees Celsius].
    dark_current, std_error : (n,) arrays
        At these temperatures, and their standard errors, in one unit.

    Raises
    ------
    CalibrationError
        Fewer than two temperatures, a current that is not three standard errors above 0, or one that does not grow.

    Notes
    -----
    A straight line through the logarithm, weighted by the relative errors; points that scatter more than these say
    widen the error.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, doubling temperature.
    """
    _require_resolved(temperature_c, dark_current, std_error)
    relative = std_error / dark_current
    centred = temperature_c - temperature_c.mean()
    fit = fit_with_scatter(
        np.column_stack([np.ones(len(centred)), centred]),
        np.log(dark_current),
        sampling_covariance=np.diag(np.square(relative)),
        scatter_shape=np.ones(len(centred)),
    )
    slope, error = float(fit.parameters[1]), float(np.sqrt(fit.covariance[1, 1]))
    if slope <= _RESOLVED_SIGMA * error:
        raise CalibrationError(
            f"the dark current does not grow with temperature: its logarithm by "
            f"{number_with_error(slope, error)} per K; take "
            f"temperatures that are further apart"
        )
    value = float(np.log(2.0)) / slope
    return DoublingTemperature(
        value_k=value,
        std_error_k=value * error / slope,
        n_temperatures=len(temperature_c),
        chi2_per_dof=fit.chi2_per_dof,
    )


def _require_resolved(temperature_c: FloatArray, dark_current: FloatArray, std_error: FloatArray) -> None:
    if len(np.unique(temperature_c)) < _LEAST:
        raise CalibrationError(
            f"there are {len(np.unique(temperature_c))} different temperatures; a doubling interval needs two, better "
            f"six"
        )
    for temperature, current, error in zip(temperature_c, dark_current, std_error, strict=True):
        if current <= _RESOLVED_SIGMA * error:
            raise CalibrationError(
                f"at {temperature:g} C the dark current is {number_with_error(current, error)}, not more than "
                f"{_RESOLVED_SIGMA:g} standard errors above 0: take longer dark exposures, or leave it out"
            )
