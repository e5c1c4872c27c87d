"""How much of the uncertainty of a region's mean each cause makes."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from model.channels import ChannelMoments
from model.moments import Moments, propagate_linear
from model.processing import dolp
from model.processing.reconstruction import Design
from model.processing.stokes_ratios import aolp_moments_rad, normalized_moments

FloatArray = NDArray[np.float64]


def noise_causes(
    channels: ChannelMoments, *, gain_dn_per_e: float, noise_factor: float, pixels: float, cycles: int
) -> dict[str, FloatArray]:
    """Return the covariance of the mean of a region's channels, by cause.

    Parameters
    ----------
    channels
        Moments of single pixels, N channels.
    gain_dn_per_e
        Gain of the sensor, > 0.
    noise_factor
        Kn of [MK14] eq. (32), >= 0.
    pixels
        Independent pixels that the mean is taken over, > 0.
    cycles
        Frames a channel, >= 1.

    Returns
    -------
    dict
        "shot" (of light and dark current), "read" (with rounding to whole counts), "fixed pattern" and "texture" to
        covariance, shape (N, N) [DN^2].

    References
    ----------
    [MK14] eq. (10), (19), (20).
    """
    temporal = np.asarray(channels.temporal_var_dn2)
    shot = np.minimum(noise_factor**2 * gain_dn_per_e * (channels.mean_dn + channels.dark_signal_dn), temporal)
    frames = pixels * cycles
    return {
        "shot": np.diag(shot) / frames,
        "read": np.diag(temporal - shot) / frames,
        "fixed pattern": np.asarray(channels.fixed_pattern_cov_dn2) / pixels,
        "texture": np.asarray(channels.scene_cov_dn2) / pixels,
    }


def budget(mean_dn: FloatArray, causes: Mapping[str, FloatArray], *, plan: Design) -> dict[str, dict[str, float]]:
    """Return the standard uncertainty that each cause gives the polarization of a region's mean.

    Parameters
    ----------
    mean_dn
        Mean channels, shape (N,), dark level taken off.
    causes
        Name to covariance of that mean, shape (N, N).
    plan
        Angles and inverse.

    Returns
    -------
    dict
        Quantity ("s0" as a share of S0, "s1n", "s2n", "dolp", "aolp_deg") to cause to standard uncertainty, to first
        order; without polarization there is no "dolp" and no "aolp_deg".

    Raises
    ------
    ValueError
        There is no light.

    References
    ----------
    [MK14] eq. (22), (25).
    """
    found: dict[str, dict[str, float]] = {}
    for cause, cov in causes.items():
        stokes = propagate_linear(Moments(mean=mean_dn, cov=0.5 * (cov + cov.T)), plan.inverse)
        if not stokes.mean[0] > 0.0:
            raise ValueError(f"S0 is {stokes.mean[0]:.3g}; a share of it needs light")
        for quantity, std in _deviations(stokes).items():
            found.setdefault(quantity, {})[cause] = std
    return found


def _deviations(stokes: Moments) -> dict[str, float]:
    normalized = np.sqrt(np.diag(normalized_moments(stokes).cov))
    found = {
        "s0": float(np.sqrt(stokes.cov[0, 0]) / stokes.mean[0]),
        "s1n": float(normalized[0]),
        "s2n": float(normalized[1]),
    }
    if np.any(stokes.mean[1:]):
        found["dolp"] = float(np.sqrt(dolp.first_order(stokes.mean, stokes.cov).variance))
        found["aolp_deg"] = float(np.rad2deg(np.sqrt(aolp_moments_rad(stokes).cov[0, 0])))
    return found
