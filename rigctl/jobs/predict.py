"""Predicting a scene: what the model says of each region, to a tolerance or with the uncertainty of its inputs."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.calibrations.made_for import MadeFor
from rigctl.calibrations.rig_picks import NONE, RigPicks, picked_for_scene
from rigctl.comparison.remarks import model_warnings
from rigctl.errors import ConfigError
from rigctl.files.choices import EffectRule, Engine, LightPart, RocKind, SnrKind
from rigctl.files.scene_file import SceneFile, scene_file
from rigctl.numbers.utc_time import utc_text
from rigctl.prediction.performance import Performance, performance_of
from rigctl.prediction.predicted_uncertainty import PredictedUncertainty, predicted_uncertainty
from rigctl.prediction.roc_curves import RocPair, parse_roc, roc_curves
from rigctl.prediction.scene_prediction import ScenePrediction, ScenePredictor
from rigctl.prediction.sweep_axes import Axis
from rigctl.scene.effect_choice import with_choices
from rigctl.scene.scene_inputs import Inputs, only_uncertain
from rigctl.scene.scene_light import SceneLight
from rigctl.scene.skies.engine import require_engine

if TYPE_CHECKING:
    from model.accuracy.predict import AccuratePrediction
    from model.accuracy.series import SeriesPrediction
    from model.effects.names import EffectPlan
    from model.prediction import PairDetection, RegionPrediction
    from rigctl.calibrations.noise.noise_file import NoiseParameters
    from rigctl.prediction.sweep import Sweep


Scaling = Callable[[Inputs], Inputs]


@dataclass(frozen=True, kw_only=True)
class PredictRequest:
    """A scene that is to be predicted.

    Attributes
    ----------
    scene : Path or SceneFile
        Scene file.
    noise, radiometric : Path or None
        Calibrations, in place of assumed noise, and of optics and efficiency.
    light : {"total", "reflected", "reflected_sun", "reflected_sky", "path"}
        Predicts as if only that part of the light of materials came.
    engine : {"own", "sasktran2"}
        What solves the sky.
    switched_on, left_out : tuple of str
        Effects that act, or do not, whatever they change.
    rule : {"safe", "estimated", "all"}
        What decides of the others where a tolerance leaves any out: bounds, estimates, or nothing.
    changes : mapping
        Numbers of the scene in the place of those of the file and of the calibrations, by their keys.
    roc : str or None
        ``TARGET,BACKGROUND``: the pair of which whole ROC curves are found.
    store : Path or None
        Store of calibrations; None is the one beside the scene file.
    picks : bool
        Pick the noise calibration from the store, where none is named and there is one.
    """

    scene: Path | SceneFile
    noise: Path | None = None
    radiometric: Path | None = None
    light: LightPart = "total"
    engine: Engine = "own"
    switched_on: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    rule: EffectRule = "safe"
    changes: Mapping[str, float] = field(default_factory=dict)
    roc: str | None = None
    store: Path | None = None
    picks: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedScene:
    """Prediction of a scene.

    Attributes
    ----------
    found : ScenePrediction
        Of each region.
    performance : Performance
        What that is worth for detection.
    uncertain_inputs : tuple of str
        Inputs that have a stated uncertainty.
    uncertainty : PredictedUncertainty or None
        What they make of each number, where that was asked.
    doubts : tuple of str
        About the calibrations.
    rocs : mapping
        Kind to the whole curve; empty where none was asked for.
    picked : RigPicks
        What was picked from the store of calibrations.
    """

    found: ScenePrediction
    performance: Performance
    uncertain_inputs: tuple[str, ...]
    uncertainty: PredictedUncertainty | None
    doubts: tuple[str, ...]
    rocs: dict[RocKind, "PairDetection"]
    picked: RigPicks = field(default_factory=RigPicks)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is to be said of the regions and their detection."""
        return _warnings(self.found.predictions, self.performance, self.rocs)

    @property
    def remarks(self) -> tuple[str, ...]:
        """All that is to be said: of the calibrations, the scene, the regions and their detection."""
        return (*self.doubts, *self.found.remarks, *self.warnings)


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedToTolerance:
    """Prediction of a scene to a stated numerical error, and the effects that it took for that.

    Attributes
    ----------
    found : AccuratePrediction
        Of each region, with its errors.
    effects : EffectPlan
        Which act.
    remarks : tuple of str
        Of the scene and of the effects that are left out.
    performance, doubts, rocs, picked
        As in `PredictedScene`.
    """

    found: "AccuratePrediction"
    effects: "EffectPlan"
    performance: Performance
    remarks: tuple[str, ...]
    doubts: tuple[str, ...]
    rocs: dict[RocKind, "PairDetection"]
    picked: RigPicks = field(default_factory=RigPicks)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is to be said of the regions and their detection."""
        return _warnings(self.found.result.predictions, self.performance, self.rocs)


@dataclass(frozen=True, kw_only=True, eq=False)
class SweptScene:
    """Predictions of a scene through a range of one of its numbers."""

    found: "Sweep"
    remarks: tuple[str, ...]
    doubts: tuple[str, ...]
    accuracy: "SeriesPrediction | None" = None
    picked: RigPicks = field(default_factory=RigPicks)


def _warnings(
    predictions: Mapping[str, "RegionPrediction"], performance: Performance, rocs: Mapping[RocKind, "PairDetection"]
) -> tuple[str, ...]:
    """Return the warnings of predictions and of detection, each once."""
    pairs = (*performance.detections, *rocs.values())
    of_pairs = (f"{pair.target} on {pair.background}: {text}" for pair in pairs for text in pair.warnings)
    return tuple(dict.fromkeys((*model_warnings(predictions), *of_pairs)))


# Told the optical depth of each wavelength that is solved.
Tell = Callable[[float], None]


def predict_scene(request: PredictRequest, *, uncertainty: bool = False, tell: Tell | None = None) -> PredictedScene:
    """Return what the model says of a scene.

    Parameters
    ----------
    request : PredictRequest
        The scene.
    uncertainty : bool
        Whether to find what the stated uncertainties of the inputs make of each number.
    tell : callable or None
        Told the optical depth of each wavelength that is solved.

    Raises
    ------
    ConfigError, DataError
        A file is wrong or does not fit, or there is no prediction.
    """
    predictor, doubts, picked = _predictor(request, tell)
    pair = _pair(request, predictor)
    found = predictor.predict()
    return PredictedScene(
        found=found,
        performance=performance_of(found.predictions),
        uncertain_inputs=only_uncertain(predictor.inputs).names,
        uncertainty=predicted_uncertainty(predictor, found.predictions) if uncertainty else None,
        doubts=doubts,
        rocs={} if pair is None else roc_curves(found.predictions, pair),
        picked=picked,
    )


def predict_scene_to(
    request: PredictRequest, *, tolerance: float, estimated_only: bool = False, tell: Tell | None = None
) -> PredictedToTolerance:
    """Return what the model says of a scene, to a stated numerical error.

    Parameters
    ----------
    request : PredictRequest
        The scene.
    tolerance : float
        Of effects that are left out and numerical settings together, 1e-6 to 0.1.
    estimated_only : bool
        Take errors that nothing promises as they are estimated.
    tell : callable or None
        Told the optical depth of each wavelength that is solved.

    Raises
    ------
    ConfigError, DataError
        A file is wrong or does not fit, or the tolerance cannot be had.
    """
    predictor, doubts, picked = _predictor(request, tell)
    pair = _pair(request, predictor)
    effects = predictor.effect_plan(tolerance, rule=request.rule)
    found = predictor.to_tolerance(tolerance, effects=effects, estimated_only=estimated_only)
    return PredictedToTolerance(
        found=found,
        effects=effects,
        performance=performance_of(found.result.predictions),
        remarks=(*predictor.remarks, *effects.remarks),
        doubts=doubts,
        rocs={} if pair is None else roc_curves(found.result.predictions, pair),
        picked=picked,
    )


def sweep_scene(
    request: PredictRequest,
    axes: tuple[Axis, ...],
    *,
    out: Path | None = None,
    snr: SnrKind = "exact",
    tolerance: float | None = None,
    estimated_only: bool = False,
    tell: Tell | None = None,
) -> SweptScene:
    """Return what the model says of a scene at each value of one of its numbers, or on a grid of several.

    Parameters
    ----------
    request : PredictRequest
        The scene.
    axes : tuple of Axis
        Its numbers that change, and their values.
    out : Path or None
        Folder for sweep.csv, sweep.json and sweep.png, roc.csv and roc.png.
    snr : {"exact", "first-order", "both"}
        DoLP SNR of the plot.
    tolerance : float or None
        Largest numerical error, 1e-6 to 0.1; None: with the settings of the scene file.
    estimated_only : bool
        Take errors that nothing promises as they are estimated.
    tell : callable or None
        Told the optical depth of each wavelength that is solved.

    Raises
    ------
    ConfigError, DataError
        A file is wrong or does not fit, or there is no such number, or it is outside its range.
    """
    from rigctl.prediction.sweep import sweep_over, sweep_to_tolerance

    twice = [axis.key for axis in axes if axis.key in request.changes]
    if twice:
        raise ConfigError(f"--sweep: {twice[0]} is set by --set as well; leave one of them out")
    predictor, doubts, picked = _predictor(request, tell)
    pair, accuracy = _pair(request, predictor), None
    if tolerance is None:
        found = sweep_over(predictor, axes, roc=pair)
    else:
        found, accuracy = sweep_to_tolerance(
            predictor, axes, tolerance, roc=pair, rule=request.rule, estimated_only=estimated_only
        )
    remarks = predictor.remarks
    if out is not None:
        from rigctl.reports.outputs.prediction_files import write_sweep  # half a second, wanted for plots only

        write_sweep(found, out, remarks=(*doubts, *remarks), snr=snr)
    return SweptScene(found=found, remarks=remarks, doubts=doubts, accuracy=accuracy, picked=picked)


def _pair(request: PredictRequest, predictor: ScenePredictor) -> RocPair | None:
    names = tuple(region.name for region in predictor.scene.regions)
    return None if request.roc is None else parse_roc(request.roc, names)


def _predictor(request: PredictRequest, tell: Tell | None = None) -> tuple[ScenePredictor, tuple[str, ...], RigPicks]:
    """Return what predicts the scene, and what is doubtful of the calibrations."""
    scene = with_choices(scene_file(request.scene), switched_on=request.switched_on, left_out=request.left_out)
    require_engine(request.engine, tier=None if scene.atmosphere is None else scene.atmosphere.tier)
    # A prediction names no camera, so that only format and age can be unfit.
    used = MadeFor(bit_depth=scene.sensor.bit_depth, taken_utc=utc_text(time.time_ns()))
    place = request.scene if isinstance(request.scene, Path) else None
    picked = picked_for_scene(place, used, request.store, request.noise) if request.picks else RigPicks()
    file = picked.files.get("noise", None if request.noise == NONE else request.noise)
    noise, doubts = (None, ()) if file is None else _noise(file, used)
    scaled: Scaling | None = None
    if request.radiometric is not None:
        scaled, more = _scaling(request.radiometric, used)
        doubts += more
    light = SceneLight(engine=request.engine, tell=tell)
    predictor = ScenePredictor(scene, noise, light=light, source=request.light, scaled=scaled, changes=request.changes)
    return predictor, doubts, picked


# Calibrations bring run folders and measurement, a tenth of a second that a prediction without one does not need.


def _noise(file: Path, used: MadeFor) -> tuple["NoiseParameters", tuple[str, ...]]:
    from rigctl.calibrations.noise.noise_file import read_noise_file, require_noise_fits

    noise = read_noise_file(file)
    return noise, require_noise_fits(noise, used)


def _scaling(file: Path, used: MadeFor) -> tuple[Scaling, tuple[str, ...]]:
    from rigctl.calibrations.radiometric_file import read_radiometric_file, require_radiometric_fits
    from rigctl.comparison.scale import with_panel_scale

    response = read_radiometric_file(file)
    return partial(with_panel_scale, radiometric=response), require_radiometric_fits(response, used)
