"""One number of a scene through a range: what the model says at each value."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.prediction.prediction import Quantities
from model.prediction.region_performance import PairDetection, pair_detections
from rigctl.errors import ConfigError
from rigctl.prediction.performance import SWEPT_RATES
from rigctl.prediction.scene_prediction import ScenePredictor
from rigctl.scene.parameters import with_value
from rigctl.scene.scene_record import Scene

MOST_STEPS = 10_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """Predictions at each value of one number.

    Attributes
    ----------
    key : str
        Which number.
    values : (n,) array
        In the unit of the file.
    quantities : tuple of dict
        For each value, region to quantities.
    detections : tuple of tuple of PairDetection
        For each value, every ordered pair of regions at `SWEPT_RATES`.
    """

    key: str
    values: NDArray[np.float64]
    quantities: tuple[dict[str, Quantities], ...]
    detections: tuple[tuple[PairDetection, ...], ...]

    @property
    def regions(self) -> tuple[str, ...]:
        """The regions, in the order of the scene file."""
        return tuple(self.quantities[0])

    def series(self, region: str, quantity: str, statistic: str) -> NDArray[np.float64]:
        """Return one number of a region at each value; not a number where it does not exist."""
        found = [step[region].get(quantity, {}).get(statistic, math.nan) for step in self.quantities]
        return np.array(found, dtype=np.float64)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Target and background of each pair."""
        return tuple((found.target, found.background) for found in self.detections[0])

    def detection(self, pair: tuple[str, str], p_false_alarm: float) -> NDArray[np.float64]:
        """Return the probability of detection of a pair at each value, at one of `SWEPT_RATES`."""
        place, rate = self.pairs.index(pair), SWEPT_RATES.index(p_false_alarm)
        return np.array([step[place].p_detection[rate] for step in self.detections], dtype=np.float64)


def sweep(predictor: ScenePredictor, request: str) -> Sweep:
    """Return what the model says over a range of one number.

    Parameters
    ----------
    predictor : ScenePredictor
        The scene.
    request : str
        ``KEY=start:stop:n``: n values from start to stop, both included.

    Raises
    ------
    ConfigError
        The request cannot be read, there is no such number, or a value is outside its range.
    """
    key, values = parse_sweep(request)
    return sweep_over(predictor, key, values)


def sweep_over(predictor: ScenePredictor, key: str, values: NDArray[np.float64]) -> Sweep:
    """Return what the model says at each value of one number.

    Raises
    ------
    ConfigError
        There is no such number, or a value is outside its range.
    """
    scenes = [swept_scene(predictor.scene, key, value) for value in values.tolist()]
    steps = [predictor.predictions_of(scene) for scene in scenes]
    quantities = tuple({name: region.quantities for name, region in step.items()} for step in steps)
    detections = tuple(pair_detections(step, SWEPT_RATES) for step in steps)
    return Sweep(key=key, values=values, quantities=quantities, detections=detections)


def parse_sweep(request: str) -> tuple[str, NDArray[np.float64]]:
    """Return name and values of a request ``KEY=start:stop:n``.

    Raises
    ------
    ConfigError
        It cannot be read.
    """
    key, _, span = request.partition("=")
    parts = span.split(":")
    wanted = f"--sweep: is {request!r}, must be KEY=start:stop:n, for instance sun.zenith_deg=10:80:8"
    try:
        start, stop, steps = float(parts[0]), float(parts[1]), int(parts[2])
    except (IndexError, ValueError) as error:
        raise ConfigError(wanted) from error
    if len(parts) != 3 or not key.strip() or not (math.isfinite(start) and math.isfinite(stop)):
        raise ConfigError(wanted)
    if not 1 <= steps <= MOST_STEPS:
        raise ConfigError(f"--sweep: has {steps} steps, allowed is 1 to {MOST_STEPS}")
    return key.strip(), np.linspace(start, stop, steps)


def swept_scene(scene: Scene, key: str, value: float) -> Scene:
    """Return a scene at one value of a sweep.

    Raises
    ------
    ConfigError
        There is no such number, or the value is outside its range.
    """
    try:
        return with_value(scene, key, value)
    except ConfigError as error:
        raise ConfigError(f"--sweep: {error}") from error
