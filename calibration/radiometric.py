"""Radiometric calibration: counts per radiance from a panel, and one free factor between two sets of numbers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.results import CalibrationError

# Counts per radiance, from a panel whose radiance is predicted

FloatArray = NDArray[np.float64]

# False-alarm probability of the test that channels agree.
_ALPHA = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class PanelScale:
    """Counts of a panel over the predicted ones."""

    #: (N,): ratio of each channel, and its standard error, errors of the prediction included
    channel: FloatArray
    channel_error: FloatArray
    common: float  #: ratio of the sums over the channels, and its standard error
    common_error: float
    measurement_error: float  #: the part of `common_error` that is the measurement's
    chi2: float  #: misfit of one ratio for all channels, N - 1 degrees of freedom
    channels_agree: bool  #: whether errors explain that (1 in 1000)


def panel_scale(
    signal_dn: FloatArray, signal_cov: FloatArray, predicted_dn: FloatArray, predicted_cov: FloatArray
) -> PanelScale:
    """Return the ratio of a panel's counts to the predicted ones.

    To first order in the errors. Errors of the panel's reflectance and of the sun are common to all channels, so more
    channels hardly improve the common ratio; the test of agreement uses only the other errors.
    """
    if np.min(signal_dn) <= 0.0 or np.min(predicted_dn) <= 0.0:
        raise CalibrationError("the panel has a channel without light: check the region, the dark level and the scene")
    from scipy.special import chdtrc  # `compare` imports this module for `fit_free_scale`, which needs no scipy

    channel = signal_dn / predicted_dn
    measured_cov = signal_cov / np.outer(predicted_dn, predicted_dn)
    light_cov = predicted_cov * np.outer(channel, channel) / np.outer(predicted_dn, predicted_dn)
    weights = predicted_dn / predicted_dn.sum()
    chi2 = _chi2(channel, measured_cov + light_cov)
    return PanelScale(
        channel=channel,
        channel_error=np.sqrt(np.diag(measured_cov + light_cov)),
        common=float(weights @ channel),
        common_error=float(np.sqrt(weights @ (measured_cov + light_cov) @ weights)),
        measurement_error=float(np.sqrt(weights @ measured_cov @ weights)),
        chi2=chi2,
        channels_agree=bool(chdtrc(max(1, len(channel) - 1), chi2) > _ALPHA),
    )


def _chi2(channel: FloatArray, cov: FloatArray) -> float:
    """Return the least chi-squared of differences between channels, from which common errors drop out."""
    differences = np.diff(np.eye(len(channel)), axis=0)
    apart = differences @ channel
    return float(apart @ np.linalg.solve(differences @ cov @ differences.T, apart))


# One factor between measured and predicted numbers, both with errors


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeScale:
    """A factor on predictions."""

    value: float  #: the factor
    variance: float  #: of the error of its logarithm
    common: FloatArray  #: (k,): covariance of that error with the error of each input of the prediction


def fit_free_scale(
    *,
    measured: FloatArray,
    measured_error: FloatArray,
    predicted: FloatArray,
    jacobian: FloatArray,
    input_cov: FloatArray,
) -> FreeScale:
    """Return the factor from predicted to measured numbers.

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
    Generalised least squares of the logarithms, to first order in the errors. Errors of inputs and factor are
    anticorrelated, which makes a scaled prediction more certain than either; so the result includes their covariance.

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
