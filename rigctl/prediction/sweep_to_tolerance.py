"""A sweep to a stated numerical error."""

from model.accuracy.series_to_tolerance import SeriesPrediction
from rigctl.prediction.roc_curves import RocPair
from rigctl.prediction.scene_prediction import ScenePredictor
from rigctl.prediction.sweep import Axis, Sweep, sweep_of, swept_scenes


def sweep_to_tolerance(
    predictor: ScenePredictor,
    axis: Axis,
    tolerance: float,
    *,
    roc: RocPair | None = None,
    estimated_only: bool = False,
) -> tuple[Sweep, SeriesPrediction]:
    """Return what the model says over a range of one number to a numerical error, and how that was kept.

    Parameters
    ----------
    predictor : ScenePredictor
        The scene.
    axis : Axis
        The number and its values, in an order in which it changes smoothly.
    tolerance : float
        Largest error of any number, 1e-6 to 0.1.
    roc : RocPair or None
        Of which the whole ROC is found at each value.
    estimated_only : bool
        Take errors that nothing promises as they are estimated.

    Raises
    ------
    ConfigError
        There is no such number, or a value is outside its range.
    """
    scenes = list(swept_scenes(predictor.scene, (axis,)).values())
    series = predictor.series_to_tolerance(scenes, tolerance, estimated_only=estimated_only)
    return sweep_of((axis,), [case.result.predictions for case in series.cases], roc=roc), series
