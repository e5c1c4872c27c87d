"""A sweep to a stated numerical error."""

import numpy as np
from numpy.typing import NDArray

from model.accuracy.series_to_tolerance import SeriesPrediction
from model.prediction.region_performance import pair_detections
from rigctl.prediction.performance import SWEPT_RATES
from rigctl.prediction.scene_prediction import ScenePredictor
from rigctl.prediction.sweep import Sweep, swept_scene


def sweep_to_tolerance(
    predictor: ScenePredictor,
    key: str,
    values: NDArray[np.float64],
    tolerance: float,
    *,
    estimated_only: bool = False,
) -> tuple[Sweep, SeriesPrediction]:
    """Return what the model says over a range of one number to a numerical error, and how that was kept.

    Parameters
    ----------
    predictor : ScenePredictor
        The scene.
    key : str
        Of the number.
    values : array
        In the unit of the file, in an order in which it changes smoothly.
    tolerance : float
        Largest error of any number, 1e-6 to 0.1.
    estimated_only : bool
        Take errors that nothing promises as they are estimated.

    Raises
    ------
    ConfigError
        There is no such number, or a value is outside its range.
    """
    scenes = [swept_scene(predictor.scene, key, value) for value in values.tolist()]
    series = predictor.series_to_tolerance(scenes, tolerance, estimated_only=estimated_only)
    steps = [case.result.predictions for case in series.cases]
    found = Sweep(
        key=key,
        values=values,
        quantities=tuple({name: region.quantities for name, region in step.items()} for step in steps),
        detections=tuple(pair_detections(step, SWEPT_RATES) for step in steps),
    )
    return found, series
