"""The RX detector on the Stokes parameters of a run: map, measured ROC with its band, predicted ROC."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments
from model.numerics import betaincinv
from model.processing.detection import rx_roc, sample_roc, sample_threshold
from rigctl.errors import DataError
from rigctl.measure.measure import Measurement
from rigctl.prediction.predict import FALSE_ALARM_RATES

FloatArray = NDArray[np.float64]

DIM = 3
BAND_LEVEL = 0.95
_OWN_MOMENTS = "the regions' own sample moments: tests the Gaussian law, not the scene"
# Below so many false alarms in the background region the empirical curve says nothing.
_LEAST_EXCEEDANCES = 5
_POINTS = 200


@dataclass(frozen=True, kw_only=True, eq=False)
class RxOnRun:
    """RX detection of a target on one cycle of a run."""

    background: str  #: regions
    target: str
    #: D of each pixel, from mean and covariance of the background region; NaN where it has no meaning.
    statistic: FloatArray
    n_background: int  #: pixels of the regions
    n_target: int
    p_false_alarm: FloatArray  #: Of the curves below, ascending.
    #: For a pixel outside of the background region, whose moments are estimated from its n pixels.
    threshold: FloatArray
    #: Share of the target's pixels above the threshold, with its 95 % band (Clopper-Pearson, for the number of
    #: independent pixels).
    empirical_p_detection: FloatArray
    band_low: FloatArray
    band_high: FloatArray
    #: Share of the background's own pixels above the threshold for pixels of the sample: what p_false_alarm came to.
    empirical_p_false_alarm: FloatArray
    predicted_p_detection: FloatArray  #: By the exact distribution.
    auc: float  #: Area under the predicted curve of a known background.
    predicted_from: str  #: Where the moments of the prediction come from.
    warnings: tuple[str, ...]  #: What limits the result.
    band_level: float = BAND_LEVEL  #: Of the band.


def detect(
    measurement: Measurement,
    stokes: FloatArray,
    *,
    background: str,
    target: str,
    predicted: dict[str, Moments] | None = None,
) -> RxOnRun:
    """Return what the RX detector does with two regions of a run."""
    pixels = {name: _pixels(measurement, name) for name in (background, target)}
    mean, cov = pixels[background].mean(axis=1), np.cov(pixels[background])
    n = pixels[background].shape[1]
    lowest = _LEAST_EXCEEDANCES / n
    p_false_alarm = np.union1d(np.geomspace(lowest, 0.5, _POINTS), [p for p in FALSE_ALARM_RATES if p >= lowest])
    own = {name: Moments(mean=p.mean(axis=1), cov=np.cov(p)) for name, p in pixels.items()}
    moments = own if predicted is None else predicted
    four = (moments[target].mean, moments[target].cov, moments[background].mean, moments[background].cov)
    try:
        curve, known = sample_roc(p_false_alarm, *four, n), rx_roc(np.array([0.01]), *four)
    except ValueError as error:
        raise DataError(f"the background {background} cannot be a background: {error}") from error
    scores = {name: _statistic(p, mean, cov) for name, p in pixels.items()}
    detected = np.array([np.sum(scores[target] > level) for level in curve.threshold])
    inside = sample_threshold(p_false_alarm, n, DIM, pixel_in_sample=True)
    region = measurement.regions[target]
    low, high = _band(detected, region.pixels, region.independent_pixels)
    return RxOnRun(
        background=background,
        target=target,
        statistic=_map(measurement, stokes, mean, cov),
        n_background=n,
        n_target=pixels[target].shape[1],
        p_false_alarm=p_false_alarm,
        threshold=np.asarray(curve.threshold),
        empirical_p_detection=detected / pixels[target].shape[1],
        band_low=low,
        band_high=high,
        empirical_p_false_alarm=np.array([np.mean(scores[background] > level) for level in inside]),
        predicted_p_detection=np.asarray(curve.p_detection),
        auc=float(known.auc),
        predicted_from=_OWN_MOMENTS if predicted is None else "the scene file",
        warnings=curve.warnings,
    )


def _pixels(measurement: Measurement, name: str) -> FloatArray:
    if name not in measurement.regions:
        raise DataError(f"there is no region {name!r}; there are: {', '.join(measurement.regions) or 'none'}")
    return measurement.regions[name].stokes_pixels


def _statistic(pixels: FloatArray, mean: FloatArray, cov: FloatArray) -> FloatArray:
    """Return D = z' cov^-1 z of pixels (3, P)."""
    off = pixels - mean[:, None]
    return np.asarray(np.einsum("ip,ip->p", off, np.linalg.solve(cov, off)))


def _map(measurement: Measurement, stokes: FloatArray, mean: FloatArray, cov: FloatArray) -> FloatArray:
    values = _statistic(stokes.reshape(DIM, -1), mean, cov).reshape(stokes.shape[1:])
    return np.where(measurement.frames.usable, values, np.nan)


def _band(detected: NDArray[np.int64], pixels: int, independent: float) -> tuple[FloatArray, FloatArray]:
    """Return the Clopper-Pearson interval of a share, with counts scaled to the number of independent pixels."""
    hits, tail = detected * independent / pixels, (1.0 - BAND_LEVEL) / 2.0
    low = np.where(hits > 0, betaincinv(np.maximum(hits, 1e-9), independent - hits + 1.0, tail), 0.0)
    high = np.where(hits < independent, betaincinv(hits + 1.0, np.maximum(independent - hits, 1e-9), 1.0 - tail), 1.0)
    return low, high
