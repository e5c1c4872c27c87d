"""Uncertainty budget of a region's mean, by cause."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from model.processing.reconstruction import Design
from model.sensor.channels import ChannelMoments

FloatArray = NDArray[np.float64]

# A degree of polarization below this is what rounding leaves of none.
_ROUNDING = 1e-12


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
    [MK14] eq. (22), (25); the signs and squares of (25)-(28) as derivatives of DoLP by S0, S1 and S2.
    """
    gradients = _gradients(plan.inverse @ mean_dn)
    return {
        quantity: {cause: _deviation(plan.inverse.T @ gradient, cov) for cause, cov in causes.items()}
        for quantity, gradient in gradients.items()
    }


def shift_cause(pictures: FloatArray, inside: NDArray[np.bool_], *, shift_pixels: FloatArray) -> FloatArray:
    """Return the covariance that shifts between pictures give the mean of a region in each of them.

    Parameters
    ----------
    pictures
        Mean picture of each channel, shape (N, H, W).
    inside
        Pixels of the region, shape (H, W).
    shift_pixels
        How far each picture may lie from its place, in x and y, shape (N, 2).

    Returns
    -------
    array of float64, shape (N, N)
        Diagonal: the mean gradient of the region times the shift, squared.

    References
    ----------
    Definition, to first order in the shift.
    """
    images = np.asarray(pictures, dtype=np.float64)
    down, right = (np.asarray(np.gradient(images, axis=axis)) for axis in (1, 2))
    moved = np.stack([right[:, inside].mean(axis=1), down[:, inside].mean(axis=1)], axis=1) * shift_pixels
    return np.diag(np.sum(moved**2, axis=1))


def _deviation(gradient: FloatArray, cov: FloatArray) -> float:
    # What is common to all channels leaves only rounding of a ratio, of either sign.
    return math.sqrt(max(float(gradient @ cov @ gradient), 0.0))


def _gradients(stokes: FloatArray) -> dict[str, FloatArray]:
    """Return the derivatives of each quantity by S0, S1 and S2."""
    s0, s1, s2 = stokes
    if not s0 > 0.0:
        raise ValueError(f"S0 is {s0:.3g}; a share of it needs light")
    found = {
        "s0": np.array([1.0, 0.0, 0.0]) / s0,
        "s1n": np.array([-s1 / s0, 1.0, 0.0]) / s0,
        "s2n": np.array([-s2 / s0, 0.0, 1.0]) / s0,
    }
    polarised = float(np.hypot(s1, s2))
    if polarised > _ROUNDING * s0:
        found["dolp"] = np.array([-polarised / s0, s1 / polarised, s2 / polarised]) / s0
        found["aolp_deg"] = (90.0 / np.pi) * np.array([0.0, -s2, s1]) / polarised**2
    return found
