"""Predictions of a scene over a range of one of its numbers, or over a grid of several."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.accuracy.predict import Predictions
from model.prediction import PairDetection, Quantities, RegionPrediction, detections_of_sweep, reason_missing
from rigctl.errors import ConfigError
from rigctl.files.choices import EffectRule, RocKind
from rigctl.prediction.predict import SWEPT_RATES, Axis, RocPair, ScenePredictor, roc_curves_of_sweep
from rigctl.scene.scene import Scene, require_within, with_values

FloatArray = NDArray[np.float64]

# Numbers of light and air, which change least often so that no sky is solved twice.
SKY_KEYS = ("sun.", "atmosphere.", "sensor.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """Predictions at each point of a grid; the last axis varies fastest."""

    axes: tuple[Axis, ...]  #: One or more.
    quantities: tuple[dict[str, Quantities], ...]  #: For each point, quantities by region.
    #: For each point, every ordered pair of regions at `SWEPT_RATES`.
    detections: tuple[tuple[PairDetection, ...], ...]
    rocs: dict[RocKind, tuple[PairDetection, ...]]  #: A curve for each point by kind; empty unless requested.
    warnings: tuple[tuple[tuple[int, ...], str], ...]  #: Of predictions and detection: place along each axis, text.
    missing: tuple[tuple[tuple[int, ...], str, str], ...]  #: Missing numbers: place, name and reason.

    @property
    def key(self) -> str:
        """The numbers that change, in words."""
        return ", ".join(axis.key for axis in self.axes)

    @property
    def values(self) -> FloatArray:
        """Values along the first axis."""
        return self.axes[0].values

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each axis."""
        return tuple(axis.values.size for axis in self.axes)

    @property
    def regions(self) -> tuple[str, ...]:
        """The regions, in the order of the scene file."""
        return tuple(self.quantities[0])

    def series(self, region: str, quantity: str, statistic: str) -> FloatArray:
        """Return one number of a region at each point, in the shape of the grid; nan if missing."""
        found = [step[region].get(quantity, {}).get(statistic, math.nan) for step in self.quantities]
        return np.array(found, dtype=np.float64).reshape(self.shape)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Target and background of each pair."""
        return tuple((found.target, found.background) for found in self.detections[0])

    def detection(self, pair: tuple[str, str], p_false_alarm: float) -> FloatArray:
        """Return the probability of detection of a pair at each point, at one of `SWEPT_RATES`."""
        place, rate = self.pairs.index(pair), SWEPT_RATES.index(p_false_alarm)
        found = [step[place].p_detection[rate] for step in self.detections]
        return np.array(found, dtype=np.float64).reshape(self.shape)


def sweep_over(predictor: ScenePredictor, axes: tuple[Axis, ...], *, roc: RocPair | None = None) -> Sweep:
    """Return the prediction at each point of a grid."""
    scenes = swept_scenes(predictor.scene, axes)
    slow = [k for k, axis in enumerate(axes) if axis.key.startswith(SKY_KEYS)]
    found: dict[tuple[int, ...], dict[str, RegionPrediction]] = {}
    for index in sorted(scenes, key=lambda index: tuple(index[k] for k in slow)):
        found[index] = predictor.predictions_of(scenes[index])
        # The model reports impossible values better than a range; the others are also checked against the range.
        require_within(predictor.scene, _at(axes, index), option="RANGES")
    return sweep_of(axes, [found[index] for index in scenes], roc=roc)


def swept_scenes(scene: Scene, axes: tuple[Axis, ...]) -> dict[tuple[int, ...], Scene]:
    """Return the scene at each point of a grid, by its place along each axis, the last axis fastest."""
    shape = tuple(axis.values.size for axis in axes)
    return {index: _changed(scene, _at(axes, index)) for index in np.ndindex(shape)}


def sweep_of(
    axes: tuple[Axis, ...], predictions: Sequence[Mapping[str, RegionPrediction]], *, roc: RocPair | None = None
) -> Sweep:
    """Return a sweep from the predictions of its points."""
    detections = detections_of_sweep(predictions, SWEPT_RATES)
    curves = {} if roc is None else roc_curves_of_sweep(predictions, roc)
    indices = list(np.ndindex(tuple(axis.values.size for axis in axes)))
    rocs = list(zip(*curves.values(), strict=True)) if curves else [() for _ in indices]
    points = list(zip(indices, predictions, detections, rocs, strict=True))
    return Sweep(
        axes=axes,
        quantities=tuple({name: region.quantities for name, region in one.items()} for one in predictions),
        detections=detections,
        rocs=curves,
        warnings=tuple(
            (index, message)
            for index, found, pairs, roc_pairs in points
            for message in _warnings(found, pairs, roc_pairs)
        ),
        missing=tuple(
            (index, number, reason) for index, found, pairs, _ in points for number, reason in _missing(found, pairs)
        ),
    )


def _at(axes: tuple[Axis, ...], index: tuple[int, ...]) -> dict[str, float]:
    return {axis.key: float(axis.values[k]) for axis, k in zip(axes, index, strict=True)}


def _changed(scene: Scene, numbers: dict[str, float]) -> Scene:
    try:
        return with_values(scene, numbers)
    except ConfigError as error:
        raise ConfigError(f"RANGES: {error}") from error


def _warnings(
    found: Mapping[str, RegionPrediction], detections: Iterable[PairDetection], rocs: Iterable[PairDetection]
) -> Iterable[str]:
    for name, region in found.items():
        yield from (f"{name}: {warning}" for warning in region.warnings)
    # The same pair may be among both.
    pairs = (f"{pair.target} on {pair.background}: {text}" for pair in (*detections, *rocs) for text in pair.warnings)
    yield from dict.fromkeys(pairs)


def _missing(found: Mapping[str, RegionPrediction], detections: Iterable[PairDetection]) -> Iterable[tuple[str, str]]:
    for name, region in found.items():
        yield from ((f"{name}.{quantity}", reason) for quantity, reason in reason_missing(region).items())
    for pair in detections:
        if math.isnan(pair.auc):
            yield f"{pair.target}_on_{pair.background}.p_detection", "; ".join(pair.warnings)


def sweep_to_tolerance(
    predictor: ScenePredictor,
    axes: tuple[Axis, ...],
    tolerance: float,
    *,
    roc: RocPair | None = None,
    rule: EffectRule = "safe",
    estimated_only: bool = False,
) -> tuple[Sweep, Predictions]:
    """Return the prediction at each point of a grid to a numerical error, and how this was achieved."""
    scenes = swept_scenes(predictor.scene, axes)
    shape = tuple(axis.values.size for axis in axes)
    series = predictor.series_to_tolerance(
        list(scenes.values()), tolerance, shape=shape, rule=rule, estimated_only=estimated_only
    )
    for index in scenes:
        require_within(predictor.scene, _at(axes, index), option="RANGES")
    return sweep_of(axes, [case.result.predictions for case in series.cases], roc=roc), series
