"""The scale-free rows of single channels: counts behind an angle over the mean of all angles."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from model.moments import Moments
from model.prediction.prediction import RegionPrediction
from model.prediction.quantity_table import is_counts, ratio_name
from model.processing.sample_moments import Sample
from model.processing.stokes_ratios import channel_ratios
from rigctl.measurement.region_numbers import MeasuredQuantities, MeasuredRegion


def with_ratios(predictions: Mapping[str, RegionPrediction]) -> dict[str, RegionPrediction]:
    """Return predictions with a ratio for each channel beside its counts; none where there is no light."""
    return {name: _with_ratios(prediction) for name, prediction in predictions.items()}


def measured_with_ratios(region: MeasuredRegion) -> MeasuredQuantities:
    """Return what a region measured, with a ratio for each channel; none where there is no light."""
    moments = region.channels_mean
    names = [name for name in region.quantities if is_counts(name)]
    if not moments.mean.mean() > 0.0:
        return region.quantities
    samples = (Sample(value=float(v), std_error=float(e)) for v, e in zip(*channel_ratios(moments), strict=True))
    return region.quantities | {ratio_name(name): {"mean": sample} for name, sample in zip(names, samples, strict=True)}


def _with_ratios(prediction: RegionPrediction) -> RegionPrediction:
    mean = prediction.channels.mean_dn
    if not mean.mean() > 0.0:
        return prediction
    names = [name for name in prediction.quantities if is_counts(name)]
    ratios = channel_ratios(Moments(mean=mean, cov=np.zeros((mean.size, mean.size))))[0]
    found = {ratio_name(name): {"mean": float(ratio)} for name, ratio in zip(names, ratios, strict=True)}
    return replace(prediction, quantities=prediction.quantities | found)
