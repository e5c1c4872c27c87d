"""The fixed pattern and the figures of merit as ``noise.json`` holds them."""

from dataclasses import asdict
from typing import Any

import numpy as np

from calibration.sensor.defects import Defect
from calibration.sensor.fixed_pattern import FixedPattern
from calibration.sensor.noise import NoiseCalibration
from calibration.sensor.pattern_histogram import PatternHistogram
from calibration.sensor.spectrogram import Spectrogram

# So many defects are listed one by one; the map has all.
_LISTED = 1000


def performance_json(noise: NoiseCalibration) -> dict[str, Any]:
    """Return the figures of merit."""
    return asdict(noise.performance)


def dark_json(noise: NoiseCalibration) -> list[dict[str, Any]]:
    """Return what each dark level gave."""
    return [
        {
            "exposure_s": level.exposure_s,
            "mean_dn": level.mean_dn,
            "temporal_variance_dn2": level.temporal_variance_dn2,
            "temporal_std_error_dn2": level.temporal_std_error_dn2,
            "n": level.n_frames,
        }
        for level in noise.darks
    ]


def pattern_json(pattern: FixedPattern) -> dict[str, Any]:
    """Return spectrograms, histograms and defects."""
    return {
        "signal_dn": pattern.signal_dn,
        "n_dark_frames": pattern.n_dark_frames,
        "n_flat_frames": pattern.n_flat_frames,
        "spectrograms": {
            "dark_rows_dn": _spectrum(pattern.dark_rows),
            "dark_columns_dn": _spectrum(pattern.dark_columns),
            "response_rows": _spectrum(pattern.response_rows),
            "response_columns": _spectrum(pattern.response_columns),
        },
        "histograms": {
            "dark_dn": _histogram(pattern.dark_histogram),
            "response": _histogram(pattern.response_histogram),
        },
        "defects": _defects(pattern),
    }


def _spectrum(found: Spectrogram) -> dict[str, Any]:
    return {
        "frequency_per_pixel": [round(float(value), 6) for value in found.frequency_per_pixel],
        "amplitude": [float(f"{value:.5g}") for value in found.amplitude],
    }


def _histogram(found: PatternHistogram) -> dict[str, Any]:
    return {
        "centres": [float(f"{value:.6g}") for value in found.centres],
        "counts": found.counts.tolist(),
        "sigma": found.sigma,
    }


def _defects(pattern: FixedPattern) -> dict[str, Any]:
    found = pattern.defects
    rows, columns = np.nonzero(found.mask)
    return {
        "n": found.n_defect,
        "counts": found.counts,
        "dark_limit_dn": found.dark_limit_dn,
        "response_limit": found.response_limit,
        "noise_limit_dn2": found.noise_limit_dn2,
        "kinds": {str(defect.name).lower(): defect.value for defect in Defect},
        "listed": [
            {"x": int(x), "y": int(y), "kind": int(found.mask[y, x])}
            for y, x in zip(rows[:_LISTED], columns[:_LISTED], strict=True)
        ],
    }
