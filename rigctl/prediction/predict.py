"""Prediction of a scene file without a run.

`ScenePredictor` predicts a scene with any of its numbers changed, with the settings of the file or to a tolerance.
Other functions give the distribution of DoLP and RX detection between regions (`performance_of`), standard
uncertainties of predicted numbers from the inputs (`predicted_uncertainty`), whole ROC curves of a pair of regions, and
the axes of a sweep.
"""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.prediction import (
    LEAST_S0_DN,
    PairDetection,
    PolarizationStrength,
    RegionPrediction,
    detections_of_cases,
    detections_of_sweep,
    polarization_strength,
    predict,
    predict_with_errors,
)
from model.processing.agreement import Propagation, propagate
from model.quantities import difference
from model.scene.scene import Readout
from rigctl.errors import ConfigError, DataError, as_config_error
from rigctl.files.choices import ROC_KINDS, RocKind
from rigctl.scene.light import SceneLight, build_scenario, camera_view, lit_scene, readout_of
from rigctl.scene.scene import (
    Inputs,
    acting_effects,
    forced_effects,
    gather,
    only_uncertain,
    require_within,
    rig_errors,
    scene_of_file,
    with_values,
)

if TYPE_CHECKING:
    from model.accuracy.chain import Clock, Settings
    from model.accuracy.predict import Predicted, Predictions
    from model.effects.effect import EffectPlan
    from model.scene.field import FieldLight, Source
    from model.scene.scene import LitScene
    from rigctl.calibrations.noise import NoiseParameters
    from rigctl.files.choices import EffectRule
    from rigctl.files.scene_file import SceneFile
    from rigctl.scene.scene import Scene


# Of sweeps and studies to which none was given.
DEFAULT_TOLERANCE = 0.01


def _with_changes(scene: "Scene", changed: Mapping[str, float]) -> "Scene":
    """Return a scene with a changed number, and a remark on the change."""
    found = with_values(scene, changed)
    require_within(scene, changed, option="changed")
    said = ", ".join(f"{key} = {value:g}" for key, value in changed.items())
    return replace(found, changed=(f"changed: {said}, unlike the scene file",))


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenePrediction:
    """Predictions of a scene."""

    predictions: dict[str, RegionPrediction]  #: Predictions by region.
    lights: dict[str, "FieldLight"]  #: Light by region, for regions with a material.
    #: Position of sun and camera, and irradiance [deg, W m-2 in band], of a scene with such a region; else empty.
    geometry: dict[str, float]
    remarks: tuple[str, ...]  #: Assumptions and least certain inputs.


def predict_scene(
    scene: "Scene",
    *,
    readout: Readout,
    exposure_s: float | None = None,
    light: SceneLight,
    source: "Source" = "total",
    settings: "Settings | None" = None,
) -> dict[str, RegionPrediction]:
    """Return the prediction of each region of a scene, with the errors of its rig."""
    scenario = build_scenario(
        scene, readout=readout, exposure_s=exposure_s, light=light, source=source, settings=settings
    )
    errors = rig_errors(scene)
    return predict(scenario) if errors is None else predict_with_errors(scenario, errors)


class ScenePredictor:
    """A scene for predictions with any of its numbers changed."""

    def __init__(
        self,
        scene: "SceneFile",
        noise: "NoiseParameters | None",
        *,
        light: SceneLight | None = None,
        source: "Source" = "total",
        scaled: Callable[[Inputs], Inputs] | None = None,
        changes: Mapping[str, float] | None = None,
    ) -> None:
        """Take a scene file, a noise calibration, and other changes of its inputs, such as a radiometric calibration.

        `changes` replace numbers of file and noise calibration.
        """
        if source != "total" and not scene.has_materials:
            raise ConfigError(f"--light {source}: no region of {scene.name} has a material")
        stated = scene_of_file(scene, noise)
        if changes:
            stated = _with_changes(stated, changes)
        self._light, self._source = SceneLight() if light is None else light, source
        self._inputs = gather(stated) if scaled is None else scaled(gather(stated))
        # The processing uses the stated value, even if the true one differs.
        self._readout = readout_of(stated)

    @property
    def scene(self) -> "Scene":
        """The scene as file and calibration have it."""
        return self._inputs.scene

    @property
    def inputs(self) -> Inputs:
        """Its numbers with their covariance."""
        return self._inputs

    @property
    def remarks(self) -> tuple[str, ...]:
        """Assumptions, ignored settings, and least certain properties of the air."""
        return (*self.scene.remarks, *self._light.remarks(self.scene))

    def predictions(self, changed: Mapping[str, float] | None = None) -> dict[str, RegionPrediction]:
        """Return the prediction with some numbers changed, by their keys."""
        return self.predictions_of(with_values(self.scene, changed or {}))

    def predictions_of(self, scene: "Scene") -> dict[str, RegionPrediction]:
        """Return the prediction of this scene with some numbers changed."""
        with as_config_error(f"scene {scene.name}"):
            return predict_scene(scene, readout=self._readout, light=self._light, source=self._source)

    def tolerance_of_series(self, changed: Iterable[str]) -> float | None:
        """Return the tolerance of a sweep or study that states none.

        None where no light is computed, where the rig differs from its record, and where the scene states the paper's
        rule for the field of view: nothing is promised of such scenes.
        """
        scene = self.scene
        is_recorded = rig_errors(scene) is None and not any(key.startswith("rig.") for key in changed)
        is_papers = scene.field_of_view is not None and scene.field_of_view.rule == "midpoint"
        return DEFAULT_TOLERANCE if scene.has_materials and is_recorded and not is_papers else None

    def lit_scene(self, scene: "Scene | None" = None) -> "LitScene":
        """Return the scene as a record of the model."""
        return lit_scene(self.scene if scene is None else scene, readout=self._readout, source=self._source)

    def effect_plan(
        self, tolerance: float, *, rule: "EffectRule" = "safe", of: "LitScene | None" = None
    ) -> "EffectPlan":
        """Return the effects that the scene needs; leaving out others may use half of the tolerance.

        Effects of sensor and session act where they are stated.
        """
        # Imported here, because it takes a quarter of a second and most predictions have no tolerance.
        from rigctl.scene.effects import plan_for_prediction

        with as_config_error(f"scene {self.scene.name}"):
            return plan_for_prediction(
                self.lit_scene() if of is None else of,
                tolerance=tolerance,
                forced=forced_effects(self.scene),
                rule=rule,
            )

    def to_tolerance(
        self,
        tolerance: float,
        *,
        effects: "EffectPlan | None" = None,
        estimated_only: bool = False,
        clock: "Clock" = time.perf_counter,
    ) -> "Predicted":
        """Return the prediction of the scene to a stated numerical error."""
        from model.accuracy import predict as to_tolerance

        _require_recorded_rig(self.scene)
        active = acting_effects(self.scene) if effects is None else effects.active
        spent = 0.0 if effects is None else effects.spent.largest
        with as_config_error(f"scene {self.scene.name}"):
            found = to_tolerance.predict(
                [self.lit_scene()],
                tolerance=tolerance - spent,
                effects=active,
                estimated_only=estimated_only,
                store=self._light.lights,
                clock=clock,
            )
        return found.cases[0]

    def with_unstated(self, effects: "EffectPlan", found: "Predicted") -> "EffectPlan":
        """Return a plan with the sizes of effects that are not stated, at the settings of a prediction."""
        from model.accuracy.effect_check import with_changes

        with as_config_error(f"scene {self.scene.name}"):
            return with_changes(
                self.lit_scene(), effects, found.result.settings, store=self._light.lights, acting=False
            )

    def series_to_tolerance(
        self,
        scenes: Sequence["Scene"],
        tolerance: float,
        *,
        shape: tuple[int, ...] | None = None,
        points: NDArray[np.float64] | None = None,
        rule: "EffectRule" = "safe",
        estimated_only: bool = False,
    ) -> "Predictions":
        """Return the predictions of this scene with some numbers changed, to a numerical error.

        They change step by step along a grid of a `shape`, or are scattered: `points` are the numbers of each scene.
        """
        from model.accuracy import predict as to_tolerance

        for scene in scenes:
            _require_recorded_rig(scene)
        with as_config_error(f"scene {self.scene.name}"):
            return to_tolerance.predict(
                [self.lit_scene(scene) for scene in scenes],
                tolerance=tolerance,
                shape=shape,
                points=points,
                effects=acting_effects(self.scene),
                planned=None if rule == "all" else lambda lit: self.effect_plan(tolerance, rule=rule, of=lit),
                estimated_only=estimated_only,
                store=self._light.lights,
            )

    def predict(self) -> ScenePrediction:
        """Return the prediction of the unchanged scene."""
        scene, predictions = self.scene, self.predictions()
        materials = [region for region in scene.regions if region.material is not None]
        return ScenePrediction(
            predictions=predictions,
            lights={region.name: self._light.region(scene, region) for region in materials},
            geometry=self._geometry() if materials else {},
            remarks=self.remarks,
        )

    def _geometry(self) -> dict[str, float]:
        illumination, view = self._light.illumination(self.scene), camera_view(self.scene)
        phi_deg = np.degrees(illumination.sun_azimuth_rad - view.azimuth_rad)
        return {
            "sun_zenith_deg": float(np.degrees(illumination.sun_zenith_rad)),
            "sun_azimuth_deg": float(np.degrees(illumination.sun_azimuth_rad)) % 360.0,
            "camera_zenith_deg": float(np.degrees(view.zenith_rad)),
            "camera_azimuth_deg": float(np.degrees(view.azimuth_rad)) % 360.0,
            "phi_deg": 180.0 - float(180.0 - phi_deg) % 360.0,
            "direct_irradiance": illumination.lighting.direct_irradiance,
            "sky_irradiance": illumination.sky_irradiance,
        }


def _require_recorded_rig(scene: "Scene") -> None:
    if rig_errors(scene) is not None:
        raise ConfigError(
            f"scene {scene.name}: --tolerance needs a rig as recorded; leave the values of [rig] at "
            "polarizer_offset_deg = 0, exposure_ratio = 1 (uncertainties may stay)"
        )


def model_warnings(predictions: Mapping[str, RegionPrediction]) -> Iterable[str]:
    """Yield limits of the model by region."""
    for name, prediction in predictions.items():
        yield from (f"{name}: {warning}" for warning in prediction.warnings)


# Usual probabilities of false alarm. A measured ROC has a point at each that its pixels allow.
FALSE_ALARM_RATES = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
# Those with a probability of detection in a prediction, and in a sweep.
STATED_RATES, SWEPT_RATES = FALSE_ALARM_RATES[1:4], FALSE_ALARM_RATES[1:]

# Reason for a missing NEDoLP.
NO_NOISE = "without a noise calibration temporal noise cannot be separated from texture"


@dataclass(frozen=True, kw_only=True, eq=False)
class Performance:
    """Polarization and detection by the model, of single pixels of one cycle."""

    #: Quantiles of DoLP by region; None without light.
    strengths: dict[str, PolarizationStrength | None]
    detections: tuple[PairDetection, ...]  #: Every ordered pair of regions, at `STATED_RATES`.


def performance_of(predictions: Mapping[str, RegionPrediction]) -> Performance:
    """Return the distribution of DoLP of every region, and the detection of each region on every other."""
    return Performance(
        strengths={name: _strength(prediction) for name, prediction in predictions.items()},
        detections=detections_of_sweep((predictions,), STATED_RATES)[0],
    )


def _strength(prediction: RegionPrediction) -> PolarizationStrength | None:
    if not prediction.stokes_dn.mean[0] > LEAST_S0_DN:
        return None
    try:
        return polarization_strength(prediction)
    except ArithmeticError:
        # Quantiles of a law without a quadrature; the region's other numbers are kept.
        return None


FloatArray = NDArray[np.float64]


class NumberKey(NamedTuple):
    """Key of a number of a prediction or of a measurement."""

    region: str
    quantity: str
    statistic: str


def propagate_numbers(
    numbers: Mapping[NumberKey, float],
    inputs: Inputs,
    predicted: Callable[[FloatArray], Mapping[str, RegionPrediction]],
) -> Propagation:
    """Return the propagation of the uncertain inputs to predicted numbers, in their order."""
    uncertain = np.flatnonzero(np.diag(inputs.cov) > 0.0)

    def off(some: FloatArray) -> FloatArray:
        values = inputs.values.copy()
        values[uncertain] = some
        try:
            regions = predicted(values)
        except ConfigError as error:
            # For the propagation: these inputs are impossible together. It takes the other side, and names the input.
            raise ValueError(str(error)) from error
        return np.array([difference(key.quantity, _value(key, regions), number) for key, number in numbers.items()])

    found = only_uncertain(inputs)
    try:
        fitted = [k for k, name in enumerate(found.names) if name in found.fitted]
        return propagate(off, found.values, found.cov, least=found.least, most=found.most, fitted=fitted)
    except ValueError as error:
        raise ConfigError(f"the uncertainties of the inputs ({', '.join(found.names)}): {error}") from error


def curved_inputs(propagation: Propagation, uncertain: Inputs) -> Iterable[str]:
    """Return the inputs propagated by quadrature, and those by slopes for lack of room."""
    if propagation.curved:
        names = ", ".join(uncertain.names[k] for k in propagation.curved)
        yield f"curved within its uncertainty, hence propagated by quadrature: {names}"
    if propagation.limited:
        names = ", ".join(uncertain.names[k] for k in propagation.limited)
        yield f"propagated by a slope, because it is near its limit: {names}"


def correlated_pairs(uncertain: Inputs) -> list[tuple[str, str, float]]:
    """Return the pairs of inputs with correlated errors, strongest first."""
    std = np.sqrt(np.diag(uncertain.cov))
    correlation = uncertain.cov / np.outer(std, std)
    pairs = [(i, k) for k in range(len(std)) for i in range(k) if correlation[i, k] != 0.0]
    rows = [(uncertain.names[i], uncertain.names[k], float(correlation[i, k])) for i, k in pairs]
    return sorted(rows, key=lambda row: -abs(row[2]))


def _value(key: NumberKey, regions: Mapping[str, RegionPrediction]) -> float:
    try:
        return regions[key.region].quantities[key.quantity][key.statistic]
    except KeyError as error:
        raise DataError(
            f"{key.region}: {key.quantity} {key.statistic} does not exist everywhere within the uncertainty of the "
            "inputs; the light may be too weak there, or the uncertainty too large"
        ) from error


# Relative change, of a number or of 1, due to rounding.
_ROUNDING = 1e-12
# Numbers by region, quantity and statistic.
Nested = dict[str, dict[str, dict[str, float]]]


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedUncertainty:
    """Standard uncertainties of predicted numbers."""

    std_errors: Nested  #: Standard uncertainty from all inputs, by region, quantity and statistic.
    inputs: tuple[str, ...]  #: Those that have an uncertainty.
    #: Change by one standard uncertainty of each input alone, by region, quantity and statistic, shape (k,).
    effects: dict[NumberKey, FloatArray]
    remarks: tuple[str, ...]  #: Inputs with a curved response or at a limit.
    #: Pairs of inputs with correlated errors, strongest first; the effects are of each alone.
    correlations: tuple[tuple[str, str, float], ...] = ()

    def ranked(self, region: str, quantity: str) -> list[tuple[str, float]]:
        """Return inputs with the change of a mean by one standard uncertainty, largest first."""
        found = self.effects.get(NumberKey(region, quantity, "mean"), np.zeros(len(self.inputs)))
        return [(self.inputs[k], float(found[k])) for k in np.argsort(-np.abs(found), kind="stable") if found[k] != 0.0]


def predicted_uncertainty(
    predictor: "ScenePredictor", predictions: Mapping[str, RegionPrediction]
) -> PredictedUncertainty:
    """Return the uncertainty of predictions from the inputs.

    `model.processing.agreement.propagate`.
    """
    numbers = {
        NumberKey(region, quantity, statistic): value
        for region, prediction in predictions.items()
        for quantity, statistics in prediction.quantities.items()
        for statistic, value in statistics.items()
    }
    inputs, uncertain = predictor.inputs, only_uncertain(predictor.inputs)
    found = propagate_numbers(numbers, inputs, lambda values: predictor.predictions_of(inputs.at(values)))
    errors = np.sqrt(np.maximum(np.diag(found.cov), 0.0)).tolist()
    nested: Nested = {}
    for key, error in zip(numbers, errors, strict=True):
        nested.setdefault(key.region, {}).setdefault(key.quantity, {})[key.statistic] = error
    return PredictedUncertainty(
        std_errors=nested,
        inputs=uncertain.names,
        effects={
            key: _without_rounding(effects, number)
            for (key, number), effects in zip(numbers.items(), found.effects, strict=True)
        },
        remarks=tuple(curved_inputs(found, uncertain)),
        correlations=tuple(correlated_pairs(uncertain)),
    )


def _without_rounding(effects: FloatArray, value: float) -> FloatArray:
    return np.where(np.abs(effects) > _ROUNDING * max(abs(value), 1.0), effects, 0.0)


# Six decades on a logarithmic axis, and the rest of the curve on an even one.
ROC_RATES = np.concatenate([np.logspace(-6.0, -1.0, 51), np.linspace(0.1, 1.0, 19)[1:]])


#: Target, and background.
RocPair = tuple[str, str]


def parse_roc(request: str, regions: tuple[str, ...]) -> RocPair:
    """Return the pair of a request ``TARGET,BACKGROUND``."""
    names = [name.strip() for name in request.split(",")]
    if len(names) != 2 or names[0] == names[1] or not set(names) <= set(regions):
        raise ConfigError(
            f"--roc: is {request!r}, must be TARGET,BACKGROUND, two of the scene's regions: {', '.join(regions)}"
        )
    return names[0], names[1]


def roc_curves(found: Mapping[str, RegionPrediction], pair: RocPair) -> dict[RocKind, PairDetection]:
    """Return the whole ROC of a pair for each kind of vector."""
    return {kind: curves[0] for kind, curves in roc_curves_of_sweep((found,), pair).items()}


def roc_curves_of_sweep(
    found: Sequence[Mapping[str, RegionPrediction]], pair: RocPair
) -> dict[RocKind, tuple[PairDetection, ...]]:
    """Return the whole ROC of a pair at each point of a sweep, for each kind of vector."""
    cases = [(*pair, one) for one in found]
    return {kind: detections_of_cases(cases, ROC_RATES, kind=kind) for kind in ROC_KINDS}


MOST_STEPS = 10_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """A number of the scene and its values, in the unit of the file."""

    key: str
    values: FloatArray


def parse_sweeps(requests: Sequence[str]) -> tuple[Axis, ...]:
    """Return the axes of a grid."""
    axes = tuple(Axis(key=key, values=values) for key, values in map(parse_sweep, requests))
    for key, times in Counter(axis.key for axis in axes).items():
        if times > 1:
            raise ConfigError(f"RANGES: {key} is given {times} times; a number has one range")
    points = math.prod(axis.values.size for axis in axes)
    if points > MOST_STEPS:
        raise ConfigError(f"RANGES: the grid has {points} points, allowed is {MOST_STEPS}")
    return axes


def parse_sweep(request: str) -> tuple[str, FloatArray]:
    """Return name and values of a request ``KEY=start:stop:n``."""
    key, _, span = request.partition("=")
    parts = span.split(":")
    wanted = f"RANGES: is {request!r}, must be KEY=start:stop:n, for instance sun.zenith_deg=10:80:8"
    try:
        start, stop, steps = float(parts[0]), float(parts[1]), int(parts[2])
    except (IndexError, ValueError) as error:
        raise ConfigError(wanted) from error
    if len(parts) != 3 or not key.strip() or not (math.isfinite(start) and math.isfinite(stop)):
        raise ConfigError(wanted)
    if not 1 <= steps <= MOST_STEPS:
        raise ConfigError(f"RANGES: has {steps} steps, allowed is 1 to {MOST_STEPS}")
    return key.strip(), np.linspace(start, stop, steps)
