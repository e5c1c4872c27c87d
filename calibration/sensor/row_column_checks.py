"""Findings in noise that neighbours, rows, columns or successive frames share, each by its own name."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.flags import Flag
from calibration.sensor.ceiling import SATURATED_FRACTION
from calibration.sensor.dark_signal import QUANTISATION_LIMIT_DN2
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.level_names import level_names

FloatArray = NDArray[np.float64]

_SIGMA = 5.0
# Spreading charge correlates the noise of neighbours by a per cent at most.
_CORRELATION, _FILTERED = 0.02, 0.1
# Dark noise is of the amplifiers: neighbours share none of it.
_DARK_CORRELATION = 0.05
# Lag of a detector leaves less than a per cent of a frame in the next.
_MEMORY = 0.03
_STEADY = 0.05
# Two readout channels differ by a per cent or two, pixels behind colour filters by tens.
_MOSAIC, _COLOURS = 0.03, 0.1
_SHARED_VARIANCE, _BANDED = 0.05, 0.01
_BRIGHT = 0.25


def row_column_flags(levels: Sequence[LevelStatistics]) -> tuple[Flag, ...]:
    """Return what is odd in the noise of neighbours, and in the means of every second pixel.

    Parameters
    ----------
    levels : sequence of LevelStatistics
        Dark and flat levels.
    """
    found = (
        _correlated_noise(levels),
        _smoothed_darks(levels),
        _frames_go_together(levels),
        _colour_mosaic(levels),
        _row_noise(levels),
        _banded_light(levels),
    )
    return tuple(flag for flag in found if flag is not None)


def _bright_flats(levels: Sequence[LevelStatistics]) -> list[LevelStatistics]:
    """Return the flats below saturation in which photons make most of the noise."""
    flats = [v for v in levels if v.kind == "flat" and v.samples.max_fraction < SATURATED_FRACTION]
    darks = [level.mean_dn for level in levels if level.kind == "dark"]
    if not flats or not darks:
        return []
    dark_dn = float(np.mean(darks))
    limit_dn = _BRIGHT * (max(flat.mean_dn for flat in flats) - dark_dn)
    return [flat for flat in flats if flat.mean_dn - dark_dn >= limit_dn]


def _variance(level: LevelStatistics) -> float:
    # A level without noise is refused by another name.
    return level.temporal_variance_dn2 or 1.0


def _correlated_noise(levels: Sequence[LevelStatistics]) -> Flag | None:
    flats = _bright_flats(levels)
    if not flats:
        return None
    # What whole lines share is a finding of its own.
    horizontal = float(np.mean([v.row_column.horizontal - v.row_column.row_variance_dn2 / _variance(v) for v in flats]))
    vertical = float(np.mean([v.row_column.vertical - v.row_column.column_variance_dn2 / _variance(v) for v in flats]))
    error = float(np.mean([flat.row_column.std_error for flat in flats])) / np.sqrt(len(flats))
    largest = max(abs(horizontal), abs(vertical))
    if largest < _CORRELATION or largest < _SIGMA * error:
        return None
    return Flag(
        name="correlated_noise",
        message=f"the noise of neighbouring pixels goes together by {horizontal:+.3f} across and {vertical:+.3f} down "
        f"(at most {_CORRELATION} is expected): frames were filtered, interpolated from a colour mosaic, resized or "
        f"compressed with loss (JPEG), and the gain is too small by about twice their sum: switch noise reduction and "
        f"sharpening off, and save raw frames",
        refuses=largest > _FILTERED,
    )


def _smoothed_darks(levels: Sequence[LevelStatistics]) -> Flag | None:
    """Return a flag if dark noise, which a coder throws away first, is shared by neighbours."""
    darks = [v for v in levels if v.kind == "dark" and v.temporal_variance_dn2 > QUANTISATION_LIMIT_DN2]
    shares = [
        (
            one.row_column.horizontal - one.row_column.row_variance_dn2 / one.temporal_variance_dn2,
            one.row_column.vertical - one.row_column.column_variance_dn2 / one.temporal_variance_dn2,
            one.row_column.std_error,
        )
        for one in darks
    ]
    smoothed = [one for one in shares if max(abs(one[0]), abs(one[1])) > max(_DARK_CORRELATION, _SIGMA * one[2])]
    if not darks or len(smoothed) <= len(darks) // 2:
        return None
    horizontal, vertical = (float(np.median([one[axis] for one in shares])) for axis in (0, 1))
    return Flag(
        name="compressed_frames",
        message=f"the noise of neighbouring pixels of dark frames goes together by {horizontal:+.2f} along rows and "
        f"{vertical:+.2f} down columns (at most {_DARK_CORRELATION} either way is expected): frames were compressed "
        f"with loss or filtered, and the noise is not the sensor's: save raw frames, without noise reduction",
        refuses=True,
    )


def _frames_go_together(levels: Sequence[LevelStatistics]) -> Flag | None:
    # Rounding that hides the noise shows what is left of it in a few pixels only.
    noisy = [v for v in levels if v.temporal_variance_dn2 > QUANTISATION_LIMIT_DN2]
    # Light that changes shows the pixels' own response in every difference.
    steady = [v for v in noisy if np.ptp(v.frame_means_dn[:3]) < _STEADY * v.mean_dn]
    stacks = [v.lag for v in steady if v.lag is not None and v.samples.max_fraction < SATURATED_FRACTION]
    if not stacks:
        return None
    share = float(np.mean([lag.share for lag in stacks]))
    error = float(np.sqrt(np.sum([lag.std_error**2 for lag in stacks]))) / len(stacks)
    if share < _MEMORY or share < _SIGMA * error:
        return None
    return Flag(
        name="frames_go_together",
        message=f"the noise of a pixel goes together from one frame to the next by {share:+.3f} (at most {_MEMORY} is "
        f"expected): the camera averages frames in time (noise reduction), so that differences of frames show "
        f"{(1.0 - share) / (1.0 + share):.0%} of the noise, and the gain is too small by as much: switch noise "
        f"reduction off, and save raw frames",
        refuses=share > _FILTERED,
    )


def _colour_mosaic(levels: Sequence[LevelStatistics]) -> Flag | None:
    flats = _bright_flats(levels)
    darks = [level.mean_dn for level in levels if level.kind == "dark"]
    if not flats or not darks:
        return None
    flat = max(flats, key=lambda level: level.mean_dn)
    contrast = flat.mosaic_contrast * flat.mean_dn / (flat.mean_dn - float(np.mean(darks)))
    variance_dn2 = max(flat.spatial_variance_dn2, 0.0) + flat.temporal_variance_dn2 / flat.n_frames
    error = np.sqrt(variance_dn2 * 4.0 / flat.n_pixels) / flat.mean_dn
    if contrast < _MOSAIC or contrast < 2.0 * _SIGMA * error:
        return None
    return Flag(
        name="colour_mosaic",
        message=f"the four pixels of a 2 x 2 cell differ by {contrast:.0%} in their means, in even light (at most "
        f"{_MOSAIC:.0%} is expected): these are frames of a sensor behind a mosaic of colour or polarization filters, "
        f"and PRNU and saturation are those of the mixture: give the pixels of one colour (RAW files: --plane)",
        refuses=contrast > _COLOURS,
    )


def _row_noise(levels: Sequence[LevelStatistics]) -> Flag | None:
    darks = [level for level in levels if level.kind == "dark"]
    if not darks:
        return None
    variances = np.mean([_of_lines(level) for level in darks], axis=0)
    errors = np.mean([_errors_of_lines(level) for level in darks], axis=0)
    total = float(np.mean([level.temporal_variance_dn2 for level in darks]))
    shared = {
        line: float(np.sqrt(variance))
        for line, variance, error in zip(("row", "column"), variances, errors, strict=True)
        if variance > _SIGMA * error and variance > _SHARED_VARIANCE * total
    }
    if not shared:
        return None
    sizes = ", ".join(f"{size_dn:.2g} DN by {line}" for line, size_dn in shared.items())
    return Flag(
        name="row_noise",
        message=f"pixels of a line share noise that changes from frame to frame ({sizes}) in {level_names(darks)}: it "
        f"is in the read noise, whose standard error is then too small, and stripes will show in dim scenes; better "
        f"supply and shielding, or a correction by masked pixels, lower it",
    )


def _of_lines(level: LevelStatistics) -> FloatArray:
    return np.array([level.row_column.row_variance_dn2, level.row_column.column_variance_dn2])


def _errors_of_lines(level: LevelStatistics) -> FloatArray:
    return np.array([level.row_column.row_std_error_dn2, level.row_column.column_std_error_dn2])


def _banded_light(levels: Sequence[LevelStatistics]) -> Flag | None:
    flats = _bright_flats(levels)
    if not flats:
        return None
    # Lines that share noise in the dark are a finding of its own.
    in_dark = np.mean([_of_lines(level) for level in levels if level.kind == "dark"], axis=0)
    shares = np.mean([(_of_lines(flat) - in_dark) / _variance(flat) for flat in flats], axis=0)
    errors = np.mean([_errors_of_lines(flat) / _variance(flat) for flat in flats], axis=0) / np.sqrt(len(flats))
    worst = int(np.argmax(shares))
    share = float(shares[worst])
    if share < _BANDED or share < _SIGMA * errors[worst]:
        return None
    return Flag(
        name="banded_light",
        message=f"{share:.1%} of the noise in time of bright flats is common to whole rows or columns (at most "
        f"{_BANDED:.0%} is expected): a lamp on alternating current lights the rows of a rolling shutter unevenly, and "
        f"the gain is too large by as much: use a lamp on direct current, or exposures of whole periods",
        refuses=share > _FILTERED,
    )
