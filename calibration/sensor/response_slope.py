"""Slope of the response at a signal: answer of a bright pixel to a little more light, beside signal over light."""

from dataclasses import dataclass

import numpy as np

from calibration.sensor.brighter_fatter import brighter_fatter
from calibration.sensor.linearity import LinearityCurve
from calibration.sensor.photon_transfer import PhotonTransfer

_NEWTON_STEPS = 6
_TERMS = 3


@dataclass(frozen=True, kw_only=True)
class ResponseSlope:
    """Slope of the response at a signal, relative to signal over light.

    Attributes
    ----------
    value, std_error : float
        1 for a linear sensor.
    """

    value: float
    std_error: float


def response_slope(transfer: PhotonTransfer, signal_dn: float) -> ResponseSlope:
    """Return (d signal / d light) / (signal / light): contrast between pixels is seen as many times as large.

    Parameters
    ----------
    transfer : PhotonTransfer
        The photon-transfer curve, and the response of the sensor where it is known.
    signal_dn : float
        Signal, dark taken off, > 0 [DN].

    Notes
    -----
    From mean against light, or from the photon-transfer curve, whichever is known better. A lamp that drifts evenly
    bends the first as a sensor does, charge that spreads bends the second; what they disagree by is in the error of the
    first. Where light is not known: from the curve; with fewer levels than show a bend, 1.

    For signal = x (1 + b x + c x^2): the curve has the relative terms 3 b and 5 c - 2 b^2 (`LinearityCurve`).
    """
    by_noise = _by_noise(transfer, signal_dn)
    if transfer.linearity is None:
        return by_noise
    by_light = _by_light(transfer, transfer.linearity, signal_dn)
    return min(by_light, by_noise, key=lambda slope: slope.std_error) if by_noise.std_error else by_light


def _by_light(transfer: PhotonTransfer, curve: LinearityCurve, signal_dn: float) -> ResponseSlope:
    gradient = np.array([signal_dn, 2.0 * signal_dn**2])
    variance = float(gradient @ curve.covariance @ gradient)
    beyond = brighter_fatter(transfer)
    if beyond is not None:
        variance += (beyond.value * signal_dn / beyond.signal_dn / 3.0) ** 2
    return ResponseSlope(value=_value(curve, signal_dn), std_error=float(np.sqrt(variance)))


def _value(curve: LinearityCurve, signal_dn: float) -> float:
    light = signal_dn
    for _ in range(_NEWTON_STEPS):
        light -= (_signal(curve, light) - signal_dn) / _slope(curve, light)
    return _slope(curve, light) * light / signal_dn


def _signal(curve: LinearityCurve, light_dn: float) -> float:
    return light_dn * (1.0 + (curve.quadratic_per_dn + curve.cubic_per_dn2 * light_dn) * light_dn)


def _slope(curve: LinearityCurve, light_dn: float) -> float:
    return 1.0 + (2.0 * curve.quadratic_per_dn + 3.0 * curve.cubic_per_dn2 * light_dn) * light_dn


def _by_noise(transfer: PhotonTransfer, signal_dn: float) -> ResponseSlope:
    terms = len(transfer.fit.parameters)
    if terms == 1:
        return ResponseSlope(value=1.0, std_error=0.0)
    quadratic = transfer.bend / transfer.gain_dn_per_e / 3.0
    cubic = (transfer.cubic / transfer.gain_dn_per_e + 2.0 * quadratic**2) / 5.0 if terms == _TERMS else 0.0
    gradient = np.array([signal_dn / 3.0, 2.0 * signal_dn**2 / 5.0])[: terms - 1] / transfer.gain_dn_per_e
    variance = float(gradient @ transfer.fit.covariance[1:, 1:] @ gradient)
    return ResponseSlope(
        value=1.0 + (quadratic + 2.0 * cubic * signal_dn) * signal_dn, std_error=float(np.sqrt(variance))
    )
