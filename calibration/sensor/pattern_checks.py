"""Findings in the fixed pattern that speak against a calibration, each by its own name."""

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Estimate
from calibration.flags import Flag
from calibration.sensor.fixed_pattern import FixedPattern
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.spectrogram import spectral_peak

_DEFECT_SHARE = 1e-3
_DEFECT_VARIANCE = 0.05
_LONG_STACK = 16
_WINDOW, _OUTLIER, _LEAST_PIXELS = 15, 5.0, 1000
# Variance of white noise that a local mean leaves.
_LOCAL_SHARE = 1.0 - 1.0 / _WINDOW**2
_LIGHT_SIGMA, _LIGHT_SHARE = 5.0, 1e-4


def pattern_flags(pattern: FixedPattern) -> tuple[Flag, ...]:
    """Return what is odd in the fixed pattern.

    Parameters
    ----------
    pattern : FixedPattern
        Of a dark and a flat stack.
    """
    found = (_light_in_darks(pattern), _periodic_pattern(pattern), _defect_pixels(pattern), _short_stack(pattern))
    return tuple(flag for flag in found if flag is not None)


def light_in_darks_dn(pattern: FixedPattern) -> Estimate | None:
    """Return the light in the dark stack by the pattern of the response to light in it [DN], None where none is seen.

    Parameters
    ----------
    pattern : FixedPattern
        Of a dark and a flat stack.

    Notes
    -----
    Dark current has its own pattern from pixel to pixel, light has that of the response (PRNU), and so has dark current
    where each pixel has a gain of its own. With r the relative response, d the dark mean less its local mean,
    cov(d, r) = light var(r) - noise / signal, where the noise of the dark mean enters r by the dark that was taken off.
    """
    dark, response = (_local(one) for one in (pattern.dark.mean_dn, _response(pattern)))
    noise_dn2 = float(np.mean(pattern.dark.temporal_variance_dn2)) / pattern.n_dark_frames
    flat_noise_dn2 = float(np.mean(pattern.flat.temporal_variance_dn2)) / pattern.n_flat_frames
    kept = (np.abs(dark) < _OUTLIER * _robust_std(dark)) & (np.abs(response) < _OUTLIER * _robust_std(response))
    d, r = dark[kept].astype(np.float64), response[kept].astype(np.float64)
    of_response = float(r.var()) - _LOCAL_SHARE * (noise_dn2 + flat_noise_dn2) / pattern.signal_dn**2
    if d.size < _LEAST_PIXELS or of_response <= 0.0:
        return None
    together = float(np.mean((d - d.mean()) * (r - r.mean()))) + _LOCAL_SHARE * noise_dn2 / pattern.signal_dn
    light_dn = together / of_response
    error_dn = float(np.sqrt(d.var() * r.var() / d.size)) / of_response
    if light_dn < _LIGHT_SIGMA * error_dn or light_dn < _LIGHT_SHARE * pattern.signal_dn:
        return None
    return Estimate(value=light_dn, std_error=error_dn, n=pattern.n_dark_frames)


def _light_in_darks(pattern: FixedPattern) -> Flag | None:
    light = light_in_darks_dn(pattern)
    if light is None:
        return None
    return Flag(
        name="light_in_darks",
        message=f"dark frames show the pattern that pixels have in the light, as {light.value:.3g} +- "
        f"{light.std_error:.2g} DN of light would (more than {_LIGHT_SIGMA:.0f} standard errors): light got in, or "
        f"each pixel has a gain of its own; the dark current cannot be told from it: cover the lens, and take the dark "
        f"frames again",
    )


def _response(pattern: FixedPattern) -> NDArray[np.float32]:
    response: NDArray[np.float32] = (pattern.flat.mean_dn - pattern.dark.mean_dn) / np.float32(pattern.signal_dn)
    return response


def _local(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a picture less its local mean, without rows and columns."""
    local: NDArray[np.float32] = picture - cv2.blur(picture, (_WINDOW, _WINDOW))
    local -= np.median(local, axis=0, keepdims=True)
    local -= np.median(local, axis=1, keepdims=True)
    return local


def _robust_std(picture: NDArray[np.float32]) -> float:
    return 1.4826 * float(np.median(np.abs(picture)))


def _periodic_pattern(pattern: FixedPattern) -> Flag | None:
    spectra = {
        "along dark rows": (pattern.dark_rows, pattern.dark_variance_dn2),
        "down dark columns": (pattern.dark_columns, pattern.dark_variance_dn2),
        "along rows with light": (pattern.response_rows, pattern.response_variance),
        "down columns with light": (pattern.response_columns, pattern.response_variance),
    }
    peaks = {
        name: peak
        for name, (spectrum, variance) in spectra.items()
        if (peak := spectral_peak(spectrum, variance=variance)) is not None
    }
    if not peaks:
        return None
    where = ", ".join(
        f"{name} at {peak.frequency_per_pixel:.4g} cycles a pixel ({peak.share:.0%} of its variance)"
        for name, peak in peaks.items()
    )
    return Flag(
        name="periodic_pattern",
        message=f"the fixed pattern has a period: {where}; DSNU or PRNU hold it, and say less of single pixels: "
        f"look for interference by supply or cables, several readout channels, or fringes of a window",
    )


def _defect_pixels(pattern: FixedPattern) -> Flag | None:
    share = pattern.defects.n_defect / pattern.defects.mask.size
    if share <= _DEFECT_SHARE:
        return None
    kinds = ", ".join(f"{count} {name}" for name, count in pattern.defects.counts.items() if count)
    return Flag(
        name="defect_pixels",
        message=f"{share:.2%} of the pixels are not like the others ({kinds}; more than {_DEFECT_SHARE:.1%}): the best "
        f"DSNU and PRNU leave out those that are 6 standard deviations off, those of EMVA 1288 hold all; leave them "
        f"out of regions: the defect map says which",
    )


def left_out_flags(dark: LevelStatistics, flat: LevelStatistics) -> tuple[Flag, ...]:
    """Return a flag if single pixels make a good part of the fixed pattern.

    Parameters
    ----------
    dark, flat : LevelStatistics
        The levels that DSNU and PRNU are taken from.
    """
    shares = {
        name: 1.0 - level.ordinary.variance_dn2 / level.spatial_variance_dn2
        for name, level in (("dark", dark), ("flat", flat))
        if level.ordinary.left_out and level.spatial_variance_dn2 > 0.0
    }
    if not shares or max(shares.values()) < _DEFECT_VARIANCE:
        return ()
    counts = {"dark": dark.ordinary.left_out, "flat": flat.ordinary.left_out}
    where = " and ".join(
        f"{counts[name]} in the {name} stack ({share:.0%} of its variance)" for name, share in shares.items()
    )
    message = (
        f"single pixels are more than 6 standard deviations from all others: {where}: hot, dead or "
        f"otherwise defect; the best DSNU and PRNU leave them out, those of EMVA 1288 hold them; leave them out of "
        f"regions: --defects writes which"
    )
    return (Flag(name="defect_pixels", message=message),)


def _short_stack(pattern: FixedPattern) -> Flag | None:
    if min(pattern.n_dark_frames, pattern.n_flat_frames) >= _LONG_STACK:
        return None
    return Flag(
        name="short_stack",
        message=f"the fixed pattern is from {pattern.n_flat_frames} flats and {pattern.n_dark_frames} darks, less than "
        f"the {_LONG_STACK} of EMVA 1288; its temporal noise is taken off, but defects and maps show it: take longer "
        f"stacks at half of saturation and in the dark",
    )
