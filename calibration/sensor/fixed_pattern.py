"""The fixed pattern of a sensor pixel by pixel: spectrograms, histograms, defects."""

import math
from dataclasses import dataclass

import numpy as np

from calibration.sensor.defects import DefectMap, defect_map
from calibration.sensor.frame_statistics import LevelPicture, LevelStatistics
from calibration.sensor.pattern_histogram import PatternHistogram, pattern_histogram
from calibration.sensor.spectrogram import Spectrogram, spectrogram


@dataclass(frozen=True, kw_only=True, eq=False)
class FixedPattern:
    """Fixed pattern of two stacks.

    Attributes
    ----------
    dark, flat : LevelPicture
        The stacks themselves.
    n_dark_frames, n_flat_frames : int
        Frames of each.
    signal_dn : float
        Mean of the flat less that of the dark [DN].
    dark_variance_dn2, response_variance : float
        Spatial variance of the dark mean [DN^2], and of flat less dark, relative; noise in time taken off.
    dark_rows, dark_columns : Spectrogram
        Of the dark mean: horizontal and vertical frequencies [DN].
    response_rows, response_columns : Spectrogram
        Of flat less dark, relative to the signal.
    dark_histogram, response_histogram : PatternHistogram
        Of deviations from the neighbours, of the dark mean [DN] and of flat less dark, relative to the signal.
    defects : DefectMap
        Pixels that are not like the others.
    """

    dark: LevelPicture
    flat: LevelPicture
    n_dark_frames: int
    n_flat_frames: int
    signal_dn: float
    dark_variance_dn2: float
    response_variance: float
    dark_rows: Spectrogram
    dark_columns: Spectrogram
    response_rows: Spectrogram
    response_columns: Spectrogram
    dark_histogram: PatternHistogram
    response_histogram: PatternHistogram
    defects: DefectMap


def fixed_pattern(dark: LevelStatistics, flat: LevelStatistics) -> FixedPattern | None:
    """Return the fixed pattern of two levels of one exposure; None if either has no picture, or the flat no light.

    Parameters
    ----------
    dark, flat : LevelStatistics
        Stacks, with their pictures.
    """
    signal_dn = flat.mean_dn - dark.mean_dn
    if dark.picture is None or flat.picture is None or signal_dn <= 0.0:
        return None
    response = (flat.picture.mean_dn - dark.picture.mean_dn) / np.float32(signal_dn)
    return FixedPattern(
        dark=dark.picture,
        flat=flat.picture,
        n_dark_frames=dark.n_frames,
        n_flat_frames=flat.n_frames,
        signal_dn=signal_dn,
        dark_variance_dn2=dark.spatial_variance_dn2,
        response_variance=(flat.spatial_variance_dn2 - dark.spatial_variance_dn2) / signal_dn**2,
        dark_rows=spectrogram(dark.picture.mean_dn, along=1),
        dark_columns=spectrogram(dark.picture.mean_dn, along=0),
        response_rows=spectrogram(response, along=1),
        response_columns=spectrogram(response, along=0),
        dark_histogram=pattern_histogram(dark.picture.mean_dn, quantum=1.0 / dark.n_frames),
        response_histogram=pattern_histogram(
            response, quantum=1.0 / math.lcm(dark.n_frames, flat.n_frames) / signal_dn
        ),
        defects=defect_map(dark.picture, flat.picture, n_dark_frames=dark.n_frames),
    )
