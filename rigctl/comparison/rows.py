"""The rows of a comparison: one number by the model and by the frames, how far apart, and whether that is too far."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from model.moments import Moments
from model.numerics import ndtri
from model.processing.agreement import holm_rejections, two_sided_p_value
from model.processing.reconstruction import channel_ratios
from model.processing.samples import Sample
from model.quantities import difference, is_counts, ratio_name
from rigctl.prediction.propagated_inputs import NumberKey

if TYPE_CHECKING:
    from model.prediction import Quantities, RegionPrediction
    from rigctl.measurement.region_numbers import MeasuredQuantities, MeasuredRegion

# Chance with which a disagreement is to be seen.
_POWER = 0.9
# A difference that is seen only where it is larger than this share of a number tells nothing of it.
_USELESS_SHARE = 0.5
_SPATIAL, _OF_PIXELS = ("std", "std_spatial_mean"), ("dolp_pixels", "dolp_snr")
_DEVIATIONS = (*_SPATIAL, "std_temporal")
# The farthest that an AoLP can be off is twice this; numbers that may be nothing by nature have no size of their own.
_TURN_DEG, _SIGNED = 45.0, ("s1", "s2", "s1n", "s2n")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One number by the model and by the frames.

    Attributes
    ----------
    region, quantity, statistic : str
        Which number, for instance ("asphalt", "dn_45", "std_temporal").
    predicted, measured : float
        In DN, degrees or without unit, as the quantity has it.
    std_error : float or None
        Of the measurement; of a deviation that came out below its prediction, as large as the prediction has it.
    std_error_inputs : float or None
        Of the prediction, from the uncertainty of what it rests on.
    z_measurement : float or None
        Difference over `std_error`.
    z : float or None
        Difference over both errors together; the decision is taken from this one.
    agrees : bool or None
        By Holm's rule over all rows. None: not a test, since the prediction was made from this very number.
    smallest_difference_90 : float or None
        That would have been called a disagreement with a chance of 90 %, were this row the only one that is off.
    """

    region: str
    quantity: str
    statistic: str
    predicted: float
    measured: float
    std_error: float | None = None
    std_error_inputs: float | None = None
    z_measurement: float | None = None
    z: float | None = None
    agrees: bool | None = None
    smallest_difference_90: float | None = None

    @property
    def is_weak(self) -> bool:
        """Whether only a difference larger than half the number (of AoLP, of 45 deg) would have been seen."""
        seen = self.smallest_difference_90
        size = _TURN_DEG if self.quantity == "aolp_deg" else abs(self.predicted)
        return seen is not None and self.quantity not in _SIGNED and seen > _USELESS_SHARE * size

    @property
    def key(self) -> NumberKey:
        """Which number it is."""
        return NumberKey(self.region, self.quantity, self.statistic)


def pair(region: str, predicted: "Quantities", measured: "MeasuredQuantities") -> Iterable[Row]:
    """Return a row for each number that both sides have.

    The error that a deviation has by its own pixels is small where it came out small by chance: taken as it is, it
    calls four times as many deviations of 1600 pixels too small as chance has it, a hundred times as many of 100. So
    it is that of the larger one, of measured and predicted.
    """
    for quantity, statistics in predicted.items():
        for statistic, value in statistics.items():
            sample = measured.get(quantity, {}).get(statistic)
            if sample is not None:
                yield Row(
                    region=region,
                    quantity=quantity,
                    statistic=statistic,
                    predicted=value,
                    measured=sample.value,
                    std_error=_error_beside(sample, value) if statistic in _DEVIATIONS else sample.std_error,
                )


def _error_beside(deviation: Sample, predicted: float) -> float:
    """Return the error of a measured deviation, or that of a predicted one that is larger."""
    return deviation.std_error * max(predicted / deviation.value, 1.0) if deviation.value > 0.0 else deviation.std_error


def off_prediction(row: Row, value: float) -> float:
    """Return how far a value of a row's quantity is above its prediction; of an AoLP, the shorter way round."""
    return difference(row.quantity, value, row.predicted)


def scored(row: Row, std_error_inputs: float) -> Row:
    """Return the row with its scores; without one where neither side has an error."""
    measured_error = row.std_error or 0.0
    both = float(np.hypot(measured_error, std_error_inputs))
    off = off_prediction(row, row.measured)
    return replace(
        row,
        std_error_inputs=float(std_error_inputs),
        z_measurement=off / measured_error if measured_error > 0.0 else None,
        z=off / both if both > 0.0 else None,
    )


def decide(rows: tuple[Row, ...], *, alpha: float) -> tuple[Row, ...]:
    """Return the rows with a decision each, by Holm's rule over all that are tests, and what each could have seen."""
    tests = [k for k, row in enumerate(rows) if row.z is not None]
    rejected = holm_rejections(two_sided_p_value([rows[k].z or 0.0 for k in tests]), alpha=alpha)
    verdicts = dict(zip(tests, rejected.tolist(), strict=True))
    # The first step of Holm's rule: a single row that is off has to pass it.
    seen = -float(ndtri(0.5 * alpha / max(len(tests), 1))) + float(ndtri(_POWER))
    return tuple(
        replace(row, agrees=not verdicts[k], smallest_difference_90=seen * error_of_both(row)) if k in verdicts else row
        for k, row in enumerate(rows)
    )


def error_of_both(row: Row) -> float:
    """Return the standard error of both sides together."""
    return float(np.hypot(row.std_error or 0.0, row.std_error_inputs or 0.0))


def with_ratios(predictions: Mapping[str, "RegionPrediction"]) -> dict[str, "RegionPrediction"]:
    """Return predictions with a ratio for each channel beside its counts; none where there is no light."""
    return {name: _with_ratios(prediction) for name, prediction in predictions.items()}


def measured_with_ratios(region: "MeasuredRegion") -> "MeasuredQuantities":
    """Return what a region measured, with a ratio for each channel; none where there is no light."""
    moments = region.channels_mean
    names = [name for name in region.quantities if is_counts(name)]
    if not moments.mean.mean() > 0.0:
        return region.quantities
    samples = (Sample(value=float(v), std_error=float(e)) for v, e in zip(*channel_ratios(moments), strict=True))
    return region.quantities | {ratio_name(name): {"mean": sample} for name, sample in zip(names, samples, strict=True)}


def predictable(measured: "MeasuredQuantities", *, is_mosaic: bool, is_interpolated: bool) -> "MeasuredQuantities":
    """Return what a scene's prediction is set beside: it knows of pixels that see one point behind all angles.

    Behind the polarizers of a mosaic each angle has pixels of its own. What their texture and response have in common
    is not known, nor what interpolation leaves of them: then deviations over the pixels are no tests.
    """
    if not is_mosaic:
        return measured
    return {
        quantity: {
            statistic: sample
            for statistic, sample in statistics.items()
            if statistic not in _SPATIAL or (is_counts(quantity) and not is_interpolated)
        }
        for quantity, statistics in measured.items()
        if quantity not in _OF_PIXELS
    }


def _with_ratios(prediction: "RegionPrediction") -> "RegionPrediction":
    mean = prediction.channels.mean_dn
    if not mean.mean() > 0.0:
        return prediction
    names = [name for name in prediction.quantities if is_counts(name)]
    ratios = channel_ratios(Moments(mean=mean, cov=np.zeros((mean.size, mean.size))))[0]
    found = {ratio_name(name): {"mean": float(ratio)} for name, ratio in zip(names, ratios, strict=True)}
    return replace(prediction, quantities=prediction.quantities | found)
