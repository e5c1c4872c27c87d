"""Mean, temporal and spatial variance of one level of light, in one pass over its frames."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.sensor.frame_sums import FrameSums
from calibration.sensor.image_lag import ImageLag
from calibration.sensor.ordinary_pixels import OrdinaryPattern, ordinary_pattern
from calibration.sensor.pattern_parts import PatternParts, mosaic_contrast, pattern_parts, small_scale_variance
from calibration.sensor.row_column_noise import RowColumnNoise
from calibration.sensor.sample_tally import SampleTally
from calibration.sensor.variance_moments import VarianceMoments, variance_moments

LevelKind = Literal["dark", "flat"]

_LEAST_PIXELS = 4
_SHARED_SIGMA = 5.0


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelPicture:
    """A level pixel by pixel.

    Attributes
    ----------
    mean_dn : (H, W) array of float32
        Mean over frames; pixels with an outlier have the mean of the others [DN].
    temporal_variance_dn2 : (H, W) array of float32
        Variance in time, from consecutive differences [DN^2].
    outlier : (H, W) array of bool
        The pixel jumped by more than noise does.
    """

    mean_dn: NDArray[np.float32]
    temporal_variance_dn2: NDArray[np.float32]
    outlier: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class LevelStatistics:
    """Statistics of one level: frames of one kind, exposure and illumination.

    Attributes
    ----------
    kind : {"dark", "flat"}
        Without light, or with even light.
    exposure_s : float or None
        Exposure time [s], None where it is not known.
    photons : float or None
        Mean photons that a pixel received, as somebody measured them; None where they are not known.
    n_frames : int
        At least 2.
    shape : (int, int)
        Rows and columns.
    n_pixels : int
        Pixels without an outlier; mean and variances are theirs.
    mean_dn : float
        Mean of all frames [DN].
    frame_means_dn : tuple of float
        Mean of each frame, outliers too [DN].
    temporal_variance_dn2, temporal_std_error_dn2 : float
        Mean over pixels of the variance in time, rounding included [DN^2].
    spatial_variance_dn2, spatial_std_error_dn2 : float
        Variance from pixel to pixel of what stays the same in time [DN^2]; may be below 0 by its error. The
        error counts the pixels as drawn from a larger population.
    temporal_spatial_cov_dn4 : float
        Covariance of the errors of these two [DN^4].
    small_scale_variance_dn2 : float
        The spatial variance without what is smooth on a sixteenth of the picture [DN^2].
    ordinary : OrdinaryPattern
        The spatial variance without defect pixels.
    mosaic_contrast : float
        Largest difference of the means of the four pixels of a 2 x 2 cell, relative to the mean.
    pattern : PatternParts
        The spatial variance by rows, columns and pixels.
    row_column : RowColumnNoise
        What pixels share of the noise in time.
    samples : SampleTally
        The samples as integers.
    lag : ImageLag or None
        What goes over from frame to frame; None with two frames, or without noise.
    picture : LevelPicture or None
        Pixel by pixel, where that was asked for.
    """

    kind: LevelKind
    exposure_s: float | None
    photons: float | None
    n_frames: int
    shape: tuple[int, int]
    n_pixels: int
    mean_dn: float
    frame_means_dn: tuple[float, ...]
    temporal_variance_dn2: float
    temporal_std_error_dn2: float
    spatial_variance_dn2: float
    spatial_std_error_dn2: float
    temporal_spatial_cov_dn4: float
    small_scale_variance_dn2: float
    ordinary: OrdinaryPattern
    mosaic_contrast: float
    pattern: PatternParts
    row_column: RowColumnNoise
    samples: SampleTally
    lag: ImageLag | None = None
    picture: LevelPicture | None = None


def level_statistics(
    frames: Iterable[NDArray[np.uint16]],
    *,
    kind: LevelKind,
    exposure_s: float | None,
    photons: float | None = None,
    keep_picture: bool = False,
) -> LevelStatistics:
    """Return the statistics of one level.

    Parameters
    ----------
    frames : iterable of (H, W) arrays of uint16
        In the order in which they were taken; at least two, all of one size [DN]. Each is looked at once.
    kind : {"dark", "flat"}
        Without light, or with even light.
    exposure_s : float or None
        Exposure time of each frame [s], None where it is not known.
    photons : float or None
        Mean photons that a pixel receives in a frame, None where they are not known.
    keep_picture : bool
        Whether the mean and the variance of each pixel are to be kept too.

    Raises
    ------
    CalibrationError
        Fewer than two frames, frames of different size, or hardly any pixels.

    Notes
    -----
    The temporal variance is half the mean square of the differences of consecutive frames, each with its mean
    taken off: light that flickers as a whole, and slow drift, leave it alone. The spatial variance is the
    variance of the mean picture less the temporal variance over the number of frames. Standard errors come
    from how the squares scatter from pixel to pixel, not from an assumed law, and hold noise that whole rows or columns
    share; other noise that neighbours share makes them too small.

    A pixel with a difference beyond 6 standard deviations (cosmic hit, telegraph noise) is left out of this
    level. Memory: a few pictures, however many frames there are. Squares are taken in single precision: 1e-7 of
    each, and of the variance less.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, sections 6.6 and 8.2; here with more than one pair a level.
    """
    sequence = iter(frames)
    first = next(sequence, None)
    if first is None:
        raise CalibrationError(f"a level needs at least two frames, to see noise; this {kind} has none")
    if first.ndim != 2 or first.size < _LEAST_PIXELS:
        raise CalibrationError(
            f"a frame has to be (rows, columns) with {_LEAST_PIXELS} pixels or more, not {first.shape}"
        )
    sums = FrameSums(first)
    for frame in sequence:
        sums.add(frame)
    return _statistics(sums, kind=kind, exposure_s=exposure_s, photons=photons, keep_picture=keep_picture)


def _statistics(
    sums: FrameSums, *, kind: LevelKind, exposure_s: float | None, photons: float | None, keep_picture: bool
) -> LevelStatistics:
    n_frames, row_column = sums.n_frames, sums.row_column
    if row_column is None:
        raise CalibrationError(f"a level needs at least two frames, to see noise; this {kind} has {n_frames}")
    mean_dn = sums.mean_dn()
    deviations = sums.deviations(mean_dn)
    moments = variance_moments(sums.kept(sums.squares()), sums.kept(deviations), n_frames=n_frames)
    small = small_scale_variance(deviations)
    of_rows_dn2 = _shared_by_rows_dn2(row_column, sums.shape)
    return LevelStatistics(
        kind=kind,
        exposure_s=exposure_s,
        photons=photons,
        n_frames=n_frames,
        shape=sums.shape,
        n_pixels=moments.n_pixels,
        mean_dn=mean_dn,
        frame_means_dn=sums.frame_means_dn,
        temporal_variance_dn2=moments.temporal_dn2,
        temporal_std_error_dn2=float(np.sqrt(moments.temporal_error_dn4 + of_rows_dn2**2 / (n_frames - 1))),
        spatial_variance_dn2=moments.spatial_dn2,
        spatial_std_error_dn2=float(np.sqrt(moments.spatial_error_dn4 + (of_rows_dn2 / n_frames) ** 2)),
        temporal_spatial_cov_dn4=moments.covariance_dn4,
        small_scale_variance_dn2=moments.spatial_dn2 if small is None else small - moments.temporal_dn2 / n_frames,
        ordinary=_ordinary(sums, deviations, moments, small_scale_dn2=small, of_rows_dn2=of_rows_dn2),
        mosaic_contrast=mosaic_contrast(deviations, mean_dn=mean_dn),
        pattern=pattern_parts(
            deviations,
            spatial_variance_dn2=moments.spatial_dn2,
            noise_dn2=moments.temporal_dn2 / n_frames,
        ),
        row_column=row_column,
        samples=sums.samples,
        lag=sums.lag,
        picture=_picture(sums, deviations + np.float32(mean_dn)) if keep_picture else None,
    )


def _ordinary(
    sums: FrameSums,
    deviations: NDArray[np.float32],
    moments: VarianceMoments,
    *,
    small_scale_dn2: float | None,
    of_rows_dn2: float,
) -> OrdinaryPattern:
    """Return the spatial variance without defect pixels, its error with the noise that rows share."""
    found = ordinary_pattern(
        sums.squares(),
        deviations,
        kept=sums.kept_mask(),
        moments=moments,
        small_scale_dn2=small_scale_dn2,
        n_frames=sums.n_frames,
    )
    return replace(found, std_error_dn2=float(np.hypot(found.std_error_dn2, of_rows_dn2 / sums.n_frames)))


def _shared_by_rows_dn2(found: RowColumnNoise, shape: tuple[int, int]) -> float:
    """Return the error of a variance by noise that rows and columns share, of which there are few [DN^2]."""
    rows, columns = (
        variance if variance > _SHARED_SIGMA * error else 0.0
        for variance, error in (
            (found.row_variance_dn2, found.row_std_error_dn2),
            (found.column_variance_dn2, found.column_std_error_dn2),
        )
    )
    return float(np.hypot(rows * np.sqrt(2.0 / shape[0]), columns * np.sqrt(2.0 / shape[1])))


def _picture(sums: FrameSums, mean_picture: NDArray[np.float32]) -> LevelPicture:
    return LevelPicture(
        mean_dn=mean_picture,
        temporal_variance_dn2=sums.temporal_variance(),
        outlier=sums.outlier_mask(),
    )
