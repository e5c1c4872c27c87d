"""One factor between numbers that were measured and numbers that were predicted, both with errors."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeScale:
    """A factor on predictions.

    Attributes
    ----------
    value : float
        The factor.
    variance : float
        Of the error of its logarithm.
    common : (k,) array
        Covariance of that error with the error of each input of the prediction.
    """

    value: float
    variance: float
    common: FloatArray


def fit_free_scale(
    *,
    measured: FloatArray,
    measured_error: FloatArray,
    predicted: FloatArray,
    jacobian: FloatArray,
    input_cov: FloatArray,
) -> FreeScale:
    """Return the factor that brings predictions to what was measured.

    Parameters
    ----------
    measured, measured_error : (n,) arrays
        Numbers and their independent standard errors, > 0.
    predicted : (n,) array
        The same by a model.
    jacobian : (n, k) array
        Its derivatives by the model's inputs.
    input_cov : (k, k) array
        Covariance of the inputs.

    Raises
    ------
    CalibrationError
        A number or an error is not above 0.

    Notes
    -----
    Generalised least squares of the logarithms, to first order in the errors. What is uncertain of the inputs makes the
    factor uncertain in the other sense, and both together leave a scaled prediction better known than either; so the
    covariance with the inputs is part of the result.

    References
    ----------
    Aitken, Proc. Roy. Soc. Edinburgh 55, 42 (1936), doi:10.1017/S0370164600014346.
    """
    if min(measured.min(), predicted.min(), measured_error.min()) <= 0.0:
        raise CalibrationError("a region has no light or no noise, measured or predicted: no factor can be fitted")
    relative = jacobian / predicted[:, None]
    noise = np.diag(np.square(measured_error / measured))
    inverse = np.linalg.inv(noise + relative @ input_cov @ relative.T)
    weights = inverse.sum(axis=0) / inverse.sum()
    logarithm = float(weights @ np.log(measured / predicted))
    common = -input_cov @ (weights @ relative)
    variance = float(weights @ noise @ weights - (weights @ relative) @ common)
    return FreeScale(value=float(np.exp(logarithm)), variance=variance, common=common)
