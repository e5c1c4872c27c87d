"""Bend of a photon-transfer curve beyond the response of the sensor: charge that spreads to neighbours."""

from dataclasses import dataclass

import numpy as np

from calibration.sensor.photon_transfer import PhotonTransfer


@dataclass(frozen=True, kw_only=True)
class BrighterFatter:
    """Relative change of the temporal variance by spreading charge.

    Attributes
    ----------
    value, std_error : float
        At `signal_dn`; below 0 where charge of a bright pixel goes to its neighbours.
    signal_dn : float
        Signal of the brightest point of the fit [DN].
    """

    value: float
    std_error: float
    signal_dn: float


def brighter_fatter(transfer: PhotonTransfer) -> BrighterFatter | None:
    """Return the bend of the curve that the response of the sensor does not explain; None without a response.

    Parameters
    ----------
    transfer
        The fitted curve.

    Notes
    -----
    The quadratic term of the curve less three times that of the response, in parts of the gain; to first order,
    and its two errors as if independent.

    References
    ----------
    Astier et al., A&A 629, A36 (2019), doi:10.1051/0004-6361/201935508: variance = gain signal (1 + a signal).
    """
    curve = transfer.linearity
    if curve is None or len(transfer.fit.parameters) < 2:
        return None
    top_dn, gain = transfer.top_dn, transfer.gain_dn_per_e
    own, response = np.sqrt(transfer.fit.covariance[1, 1]) / gain, 3.0 * np.sqrt(curve.covariance[0, 0])
    return BrighterFatter(
        value=(transfer.bend / gain - 3.0 * curve.quadratic_per_dn) * top_dn,
        std_error=float(np.hypot(own, response)) * top_dn,
        signal_dn=top_dn,
    )
