"""Performance of a sensor by its noise parameters: threshold, dynamic range, SNR, dark current by variance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Estimate
from calibration.sensor.dark_signal import QUANTISATION_VAR_DN2, DarkSignal
from calibration.sensor.photon_transfer import PhotonTransfer

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Performance:
    """Figures of merit; None is what the frames cannot give.

    Attributes
    ----------
    threshold_e : Estimate or None
        Absolute sensitivity threshold: electrons in a pixel at which the temporal SNR is 1.
    dynamic_range : Estimate or None
        Saturation over that threshold.
    snr_max : Estimate or None
        Temporal SNR of a pixel at saturation, square root of its electrons.
    dark_current_variance_e_per_s : Estimate or None
        Dark current by the growth of the dark variance [e-/s].
    dark_current_disagreement : float or None
        Dark current by the mean less that by the variance, over the standard error of the difference.
    quantum_efficiency : Estimate or None
        Electrons per photon, where the photons of the levels are stated. What these photons are uncertain by is not in
        its error.
    """

    threshold_e: Estimate | None
    dynamic_range: Estimate | None
    snr_max: Estimate | None
    dark_current_variance_e_per_s: Estimate | None
    dark_current_disagreement: float | None
    quantum_efficiency: Estimate | None


def performance(
    transfer: PhotonTransfer,
    dark: DarkSignal,
    *,
    gain: Estimate,
    read_noise_e: Estimate | None,
    saturation_e: Estimate | None,
) -> Performance:
    """Return the figures of merit of a sensor.

    Parameters
    ----------
    transfer : PhotonTransfer
        The photon-transfer curve.
    dark : DarkSignal
        The dark levels.
    gain : Estimate
        [DN/e-].
    read_noise_e, saturation_e : Estimate or None
        [e-].

    Notes
    -----
    Rounding counts as noise here: it is in what a pixel gives. In the dynamic range the gain cancels but for half an
    electron, so its error is that of saturation and of the dark noise in counts.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear; the threshold here without its approximation.
    """
    threshold = None if read_noise_e is None else _threshold(gain, read_noise_e)
    by_variance = _dark_current_by_variance(dark, gain, n=0 if read_noise_e is None else read_noise_e.n)
    return Performance(
        threshold_e=threshold,
        dynamic_range=_dynamic_range(transfer, gain, saturation_e, threshold),
        snr_max=None if saturation_e is None else _root(saturation_e),
        dark_current_variance_e_per_s=by_variance,
        dark_current_disagreement=None if by_variance is None else _disagreement(dark, gain, by_variance),
        quantum_efficiency=_quantum_efficiency(transfer, gain),
    )


def temporal_noise_e(signal_e: FloatArray, *, read_noise_e: float, gain_dn_per_e: float) -> FloatArray:
    """Return the noise in time of a pixel, rounding included [e-]: electrons of the signal, read noise, 1/12 DN^2.

    Parameters
    ----------
    signal_e
        Mean signal, any shape, 0 or more [e-].
    read_noise_e
        0 or more [e-].
    gain_dn_per_e
        Above 0 [DN/e-].

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, section 2.
    """
    noise: FloatArray = np.sqrt(signal_e + read_noise_e**2 + QUANTISATION_VAR_DN2 / gain_dn_per_e**2)
    return noise


def total_noise_e(temporal_e: FloatArray, signal_e: FloatArray, *, prnu: float, dsnu_e: float) -> FloatArray:
    """Return the noise in time and from pixel to pixel together [e-]; signal in electrons.

    Parameters
    ----------
    temporal_e, signal_e
        Noise in time and mean signal, any shape, 0 or more [e-].
    prnu
        Relative deviation of the pixels' response, 0 or more.
    dsnu_e
        Deviation of their dark signal, 0 or more [e-].

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, section 4.
    """
    noise: FloatArray = np.sqrt(np.square(temporal_e) + dsnu_e**2 + np.square(prnu * signal_e))
    return noise


def _threshold(gain: Estimate, read_noise_e: Estimate) -> Estimate:
    variance_e2 = read_noise_e.value**2 + QUANTISATION_VAR_DN2 / gain.value**2
    root = float(np.sqrt(0.25 + variance_e2))
    # The read noise's error holds the gain's already.
    error = read_noise_e.value * read_noise_e.std_error / root
    return Estimate(value=0.5 + root, std_error=error, n=read_noise_e.n)


def _dynamic_range(
    transfer: PhotonTransfer, gain: Estimate, saturation_e: Estimate | None, threshold_e: Estimate | None
) -> Estimate | None:
    if saturation_e is None or threshold_e is None or transfer.saturation is None:
        return None
    value = saturation_e.value / threshold_e.value
    relative_gain = gain.std_error / gain.value
    of_saturation = transfer.saturation.std_error_dn / transfer.saturation.signal_dn
    of_threshold = np.sqrt(max((threshold_e.std_error / threshold_e.value) ** 2 - relative_gain**2, 0.0))
    return Estimate(
        value=value,
        std_error=value * float(np.hypot(of_saturation, of_threshold)),
        n=max(saturation_e.n, threshold_e.n),
    )


def _root(saturation_e: Estimate) -> Estimate:
    value = float(np.sqrt(saturation_e.value))
    return Estimate(value=value, std_error=0.5 * saturation_e.std_error / value, n=saturation_e.n)


def _dark_current_by_variance(dark: DarkSignal, gain: Estimate, *, n: int) -> Estimate | None:
    fit = dark.variance_fit
    if fit is None or not dark.has_slope or n == 0:
        return None
    value = float(fit.parameters[1]) / gain.value**2
    own = float(np.sqrt(fit.covariance[1, 1])) / gain.value**2
    return Estimate(value=value, std_error=float(np.hypot(own, 2.0 * value * gain.std_error / gain.value)), n=n)


def _disagreement(dark: DarkSignal, gain: Estimate, by_variance: Estimate) -> float:
    by_mean = float(dark.mean_fit.parameters[1]) / gain.value
    error = np.hypot(float(np.sqrt(dark.mean_fit.covariance[1, 1])) / gain.value, by_variance.std_error)
    return (by_mean - by_variance.value) / float(error)


def _quantum_efficiency(transfer: PhotonTransfer, gain: Estimate) -> Estimate | None:
    curve = transfer.linearity
    if curve is None or curve.dn_per_photon is None:
        return None
    value = float(curve.dn_per_photon / gain.value)
    relative = np.hypot(curve.dn_per_photon_std_error / curve.dn_per_photon, gain.std_error / gain.value)
    return Estimate(value=value, std_error=float(value * relative), n=gain.n)
