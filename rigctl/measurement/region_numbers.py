"""Numbers of one region by its pixels: every quantity of the report, with its standard error."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments, propagate_linear
from model.processing import dolp
from model.processing.mosaic import Interpolation, deviation_inflation
from model.processing.reconstruction import Design, aolp_moments_rad, normalized_moments
from model.processing.samples import (
    Repeatability,
    RepeatedPixels,
    Sample,
    deviation,
    effective_pixels,
    mean_moments,
    mean_over_deviation,
    region_mean_moments,
)
from model.stokes import dolp as degree_of_polarization
from rigctl.errors import DataError

FloatArray = NDArray[np.float64]

# quantity -> statistic -> sample; the same names as in `model.prediction.Quantities`.
MeasuredQuantities = dict[str, dict[str, Sample]]

# Fewer pixels than this give no fourth moment worth the name.
LEAST_PIXELS = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredRegion:
    """A region by its pixels.

    Attributes
    ----------
    pixels, excluded, edge : int
        Pixels used, pixels of the region left out as saturated or missing, and those left out along its border.
    independent_pixels : float
        How many independent ones they are worth for S0: errors of deviations take this number.
    channels_mean : Moments
        Mean of each angle over pixels and cycles, and the covariance of that mean.
    scatter_cov : (N, N) array
        Of the mean of each angle by the scatter of the pixels alone.
    channel_pixels, channel_pixels_mean : (N, P) array
        Counts of each pixel behind each angle, of the first cycle and of the mean of all.
    stokes_pixels, stokes_pixels_mean : (3, P) array
        Stokes parameters of each pixel, likewise.
    repeatability : Repeatability
        Relative errors of the means by what differs from cycle to cycle; 0 with one cycle.
    first_half : (P,) array of bool
        Every other pixel, as on a chessboard: what is estimated from one half can be tested on the other.
    quantities : mapping
        Everything a prediction is set beside.
    """

    pixels: int
    excluded: int
    edge: int
    independent_pixels: float
    channels_mean: Moments
    scatter_cov: FloatArray
    channel_pixels: FloatArray
    channel_pixels_mean: FloatArray
    stokes_pixels: FloatArray
    stokes_pixels_mean: FloatArray
    first_half: NDArray[np.bool_]
    inside: NDArray[np.bool_]
    repeatability: Repeatability
    quantities: MeasuredQuantities


def measure_region(
    *,
    name: str,
    pixels: RepeatedPixels,
    inside: NDArray[np.bool_],
    excluded: int,
    edge: int,
    channel_names: tuple[str, ...],
    plan: Design,
    level_std_error: FloatArray,
    relative_error: FloatArray,
    own_error: FloatArray | float = 0.0,
    interpolation: Interpolation = "none",
) -> MeasuredRegion:
    """Return the numbers of a region.

    Parameters
    ----------
    name : str
        For messages.
    pixels : RepeatedPixels
        Of N angles and P pixels; dark level off.
    inside : (H, W) array of bool
        Where the P pixels are.
    excluded, edge : int
        How many pixels of the region are left out as saturated or missing, and along its border.
    channel_names : tuple of str
        Of the N angles.
    plan : Design
        Angles and inverse.
    level_std_error : (N,) array
        Standard error of the dark level that was taken off, one cause for all angles.
    relative_error : (N,) array
        Relative standard error of each angle's throughput, independent of the others.
    own_error : (N,) array or float
        Standard error of each angle's own level, independent of the others: of a dark level or a shift of its own.
    interpolation : {"none", "bilinear"}
        What the frames were made of a mosaic by: then neighbours share their noise.

    Raises
    ------
    DataError
        Fewer than 16 pixels are left.
    """
    count = pixels.mean.shape[1]
    require_pixels(name, count, excluded=excluded, edge=edge)
    independent = _independent_pixels(pixels.mean, inside, plan)
    inflation = count / independent
    scattered = region_mean_moments(pixels.mean, inside)
    channels_mean = _with_level_errors(scattered, level_std_error, relative_error, own_error)
    channels_mean = replace(channels_mean, cov=channels_mean.cov + pixels.repeatability.cov(channels_mean.mean))
    stokes_pixels = np.asarray(plan.inverse @ pixels.first)
    quantities = _of_vectors(
        pixels, channel_names, channels_mean, plan, inflation, deviation_inflation(interpolation)
    ) | _of_pixel_dolp(stokes_pixels, inflation)
    return MeasuredRegion(
        pixels=count,
        excluded=excluded,
        edge=edge,
        independent_pixels=independent,
        channels_mean=channels_mean,
        scatter_cov=scattered.cov,
        channel_pixels=pixels.first,
        channel_pixels_mean=pixels.mean,
        stokes_pixels=stokes_pixels,
        stokes_pixels_mean=np.asarray(plan.inverse @ pixels.mean),
        inside=inside,
        repeatability=pixels.repeatability,
        # Whole cells where neighbours share samples: their pixels are not alike.
        first_half=np.sum(np.array(np.nonzero(inside)) // (1 if interpolation == "none" else 2), axis=0) % 2 == 0,
        quantities=quantities,
    )


def require_pixels(name: str, left: int, *, excluded: int, edge: int) -> None:
    """Refuse a region of which too few pixels are left."""
    if left < LEAST_PIXELS:
        raise DataError(
            f"region {name}: {left} pixels are left of {left + excluded + edge} "
            f"({excluded} are saturated or missing, {edge} lie along its border); at least {LEAST_PIXELS} are needed"
        )


def _independent_pixels(mean: FloatArray, inside: NDArray[np.bool_], plan: Design) -> float:
    image = np.zeros(inside.shape)
    image[inside] = plan.inverse[0] @ mean
    return effective_pixels(image, inside)


def _with_level_errors(
    moments: Moments,
    level_std_error: FloatArray,
    relative_error: FloatArray,
    own_error: FloatArray | float,
) -> Moments:
    own = np.square(moments.mean * relative_error) + np.square(own_error)
    common = np.outer(level_std_error, level_std_error) + np.diag(own)
    return Moments(mean=moments.mean, cov=moments.cov + common)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Vectors:
    """Channels or Stokes parameters of the pixels: of the first cycle and the mean of all, and their temporal noise."""

    names: tuple[str, ...]
    first: FloatArray
    mean: FloatArray
    temporal: tuple[Sample, ...]


def _of_vectors(
    pixels: RepeatedPixels,
    channel_names: tuple[str, ...],
    channels_mean: Moments,
    plan: Design,
    inflation: float,
    of_noise: float,
) -> MeasuredQuantities:
    """Return the numbers of channels and Stokes parameters, and of the mean Stokes vector."""
    channels = _Vectors(names=channel_names, first=pixels.first, mean=pixels.mean, temporal=pixels.temporal)
    stokes = _Vectors(
        names=("s0", "s1", "s2"),
        first=pixels.stokes_first,
        mean=pixels.stokes_mean,
        temporal=pixels.temporal_stokes,
    )
    stokes_mean = propagate_linear(channels_mean, plan.inverse)
    found = _linear(channels, channels_mean, inflation, of_noise)
    return found | _linear(stokes, stokes_mean, inflation, of_noise) | _of_mean_stokes(stokes_mean)


def _linear(vectors: _Vectors, mean: Moments, inflation: float, of_noise: float) -> MeasuredQuantities:
    """Return mean and deviations of channels or Stokes parameters.

    `inflation` is of errors of what varies over the pixels, `of_noise` of what varies with time.
    """
    found: MeasuredQuantities = {}
    for k, name in enumerate(vectors.names):
        found[name] = {
            "mean": Sample(value=float(mean.mean[k]), std_error=float(np.sqrt(mean.cov[k, k]))),
            "std": _inflated(deviation(vectors.first[k]), inflation),
            "std_spatial_mean": _inflated(deviation(vectors.mean[k]), inflation),
        }
        if vectors.temporal:
            found[name]["std_temporal"] = _inflated(vectors.temporal[k], of_noise)
    return found


def _of_mean_stokes(stokes: Moments) -> MeasuredQuantities:
    if stokes.mean[0] <= 0.0:
        return {}
    normalized = normalized_moments(stokes)
    errors = np.sqrt(np.diag(normalized.cov))
    found = {
        name: {"mean": Sample(value=float(normalized.mean[k]), std_error=float(errors[k]))}
        for k, name in enumerate(("s1n", "s2n"))
    }
    if not np.any(stokes.mean[1:]):
        return found
    degree = dolp.first_order(stokes.mean, stokes.cov)
    angle = aolp_moments_rad(stokes)
    found["dolp"] = {"mean": Sample(value=float(degree.mean), std_error=float(np.sqrt(degree.variance)))}
    found["aolp_deg"] = {
        "mean": Sample(value=float(np.rad2deg(angle.mean[0])), std_error=float(np.rad2deg(np.sqrt(angle.cov[0, 0]))))
    }
    return found


def _of_pixel_dolp(stokes_pixels: FloatArray, inflation: float) -> MeasuredQuantities:
    """Return what the DoLP of single pixels gives; nothing where a pixel has no light, since it has none then."""
    if np.any(stokes_pixels[0] <= 0.0):
        return {}
    values = np.asarray(degree_of_polarization(stokes_pixels.T))
    mean = mean_moments(values[None, :])
    mean_error = float(np.sqrt(mean.cov[0, 0]))
    found: MeasuredQuantities = {
        "dolp_pixels": {
            "mean": _inflated(Sample(value=float(mean.mean[0]), std_error=mean_error), inflation),
            "std": _inflated(deviation(values), inflation),
        }
    }
    if np.ptp(values) > 0.0:
        found["dolp_snr"] = {"mean": _inflated(mean_over_deviation(values), inflation)}
    return found


def _inflated(sample: Sample, inflation: float) -> Sample:
    return Sample(value=sample.value, std_error=sample.std_error * float(np.sqrt(inflation)))
