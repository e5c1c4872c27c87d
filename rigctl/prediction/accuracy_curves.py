"""Error against time for a scene: of the whole chain, of each numerical setting, and the floor of uncertain inputs."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import (
    ChainResult,
    LightStore,
    Reading,
    Readings,
    Settings,
    Value,
    differences,
    evaluate,
    readings,
)
from model.accuracy.effect_estimates import kind_of, readings_of
from model.accuracy.errors import error_budget, light_errors
from model.accuracy.plan import NUMERICAL_SETTINGS, WAVELENGTHS, Plan, settings_at
from model.accuracy.predict import ESTIMATES, AccuratePrediction, predict
from model.prediction import predict_with_errors
from model.scene.scene import LitScene
from rigctl.errors import ConfigError
from rigctl.prediction.paper_choices import NamedChoice, named_choices, settings_by
from rigctl.prediction.scene_prediction import ScenePredictor
from rigctl.scene.parameters import with_value
from rigctl.scene.rig_inputs import rig_errors
from rigctl.scene.scene_record import Scene

FloatArray = NDArray[np.float64]
Clock = Callable[[], float]

# The reference is of a tenth of the smallest tolerance shown.
_FINER = 0.1
# Levels of a setting that are shown below that of the plan.
_BELOW = 2
WHOLE_CHAIN = "whole chain"
# Kinds of numbers, by what a tolerance means for them.
KINDS = {
    "radiance": "radiance and counts",
    "ratios": "DoLP, s1, s2",
    "deviations": "deviations and SNR",
    "detection": "probability of detection",
}


@dataclass(frozen=True, kw_only=True)
class CurvePoint:
    """One evaluation.

    Attributes
    ----------
    varied
        Which numerical setting was varied; `WHOLE_CHAIN` for a prediction to a tolerance.
    level
        To what.
    seconds
        That it took, without anything kept from another.
    true, estimated
        Largest error of any reading that is guaranteed: true and as estimated. Of one setting its own, against finer
        levels of it alone.
    whole
        Largest true error of all settings together, against finer settings of all.
    """

    varied: str
    level: str
    seconds: float
    true: float
    estimated: float
    whole: float


@dataclass(frozen=True, kw_only=True)
class DigitPoint:
    """What one kind of number costs: its largest true error, and the time that it took with all others [s]."""

    quantity: str
    error: float
    seconds: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Curves:
    """Curves of error against time for a scene.

    Attributes
    ----------
    points
        Of the whole chain and of each setting.
    stages
        For each tolerance its prediction.
    floor
        Reading to the standard deviation that the uncertain inputs give it, in the units of a tolerance.
    reference_s
        Time of the finest settings [s].
    named
        The paper's choices and the user's.
    digits
        True errors of each kind of number at each tolerance.
    """

    points: tuple[CurvePoint, ...]
    predictions: tuple[AccuratePrediction, ...]
    floor: dict[Reading, float]
    reference_s: float
    named: tuple[NamedChoice, ...] = ()
    digits: tuple[DigitPoint, ...] = ()

    @property
    def front(self) -> tuple[CurvePoint, ...]:
        """Points than which none is both faster and better, from fast to good."""
        found: list[CurvePoint] = []
        for point in sorted(self.points, key=lambda one: (one.seconds, one.whole)):
            if not found or point.whole < found[-1].whole:
                found.append(point)
        return tuple(found)


def accuracy_curves(
    predictor: ScenePredictor,
    tolerances: Sequence[float],
    *,
    also: Sequence[str] = (),
    clock: Clock = time.process_time,
) -> Iterator[str | Curves]:
    """Yield what is being done, in words, and last the curves.

    Parameters
    ----------
    predictor : ScenePredictor
        The scene.
    tolerances : sequence of float
        To be shown, 1e-5 to 0.1.
    also : sequence of str
        Choices of the user, such as "tiles_per_side=3,rule=midpoint".
    clock
        Seconds, rising.
    """
    scene = predictor.lit_scene()
    coarsest = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), max(tolerances))
    for text in also:
        settings_by(text, coarsest)
    yield "floor of the inputs"
    floor = input_floor(predictor)
    predictions = []
    for tolerance in sorted(tolerances, reverse=True):
        yield f"tolerance {tolerance:g}"
        predictions.append(_fastest(scene, tolerance, clock))
    yield "finest settings"
    finest = _finer_settings(scene, predictions[-1], _FINER * min(tolerances))
    reference = evaluate(scene, finest, clock=clock)
    truth = readings_of(reference)
    points = [_of_chain(found, truth) for found in predictions]
    middle = predictions[(len(predictions) - 1) // 2]
    for name in NUMERICAL_SETTINGS:
        yield name
        points += _of_setting(scene, name, middle, truth, clock)
    yield "the paper's choices"
    fine = _finer_settings(scene, middle, middle.tolerance)
    named = tuple(named_choices(scene, fine, truth, also, clock=clock))
    yield Curves(
        points=tuple(points),
        predictions=tuple(predictions),
        floor=floor,
        reference_s=sum(reference.stage_s.values()),
        named=named,
        digits=tuple(one for found in predictions for one in _digits(found, truth)),
    )


def faster_and_better(choice: NamedChoice, curves: Curves) -> bool:
    """Return whether a fixed choice is faster than a tolerance, and its error no larger than the true one of that."""
    chain = [point for point in curves.points if point.varied == WHOLE_CHAIN]
    return choice.error > 0.0 and any(choice.seconds <= point.seconds and choice.error <= point.true for point in chain)


def estimates_share(found: AccuratePrediction) -> float:
    """Return the share of a prediction's time that its error estimates take."""
    total = sum(found.stage_s.values())
    return found.stage_s[ESTIMATES] / total if total > 0.0 else 0.0


def _fastest(scene: LitScene, tolerance: float, clock: Clock) -> AccuratePrediction:
    """Return the faster of two predictions: a time is what it takes, not what else the machine does."""
    found = [predict(scene, tolerance=tolerance, clock=clock) for _ in range(2)]
    return min(found, key=lambda one: sum(one.stage_s.values()))


def steps(tolerances: Sequence[float]) -> int:
    """Return how many steps `accuracy_curves` takes."""
    return len(tolerances) + len(NUMERICAL_SETTINGS) + 3


def input_floor(predictor: ScenePredictor) -> dict[Reading, float]:
    """Return the deviation that the uncertain inputs give each reading, in the units of a tolerance.

    Parameters
    ----------
    predictor : ScenePredictor
        Its inputs have a covariance.

    References
    ----------
    Definition: central differences of one standard deviation, and the covariance of the inputs.
    """
    inputs, store = predictor.inputs, LightStore()
    deviations = np.sqrt(np.diag(inputs.cov))
    used = np.flatnonzero(deviations > 0.0)
    coarse = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), 1e-2)

    def at(scene: Scene) -> Readings:
        result, errors = evaluate(predictor.lit_scene(scene), coarse, store=store), rig_errors(scene)
        if errors is None:
            return readings_of(result)
        # What is not known of the rig moves all but the chances of detection, which no rig's error is carried to.
        return readings(result.scenario, predict_with_errors(result.scenario, errors), result.detections)

    def tried(name: str, value: float) -> Readings | None:
        try:
            return at(with_value(predictor.scene, name, value))
        except (ConfigError, ValueError):
            return None

    base = at(predictor.scene)
    slopes = np.zeros((len(base), inputs.values.size))
    for place in used.tolist():
        name, value, step = inputs.names[place], float(inputs.values[place]), float(deviations[place])
        low = max(value - step, float(inputs.least[place]))
        sides = [(moved, found) for moved in (value + step, low) if (found := tried(name, moved)) is not None]
        # Where one side is not possible, such as an albedo above 1, the other tells alone.
        (high, above), (low, below) = (*sides, (value, base))[:2]
        slopes[:, place] = [_slope(base[key], above.get(key), below.get(key), high - low) for key in base]
    variances = np.einsum("qi,ij,qj->q", slopes, inputs.cov, slopes)
    return dict(zip(base, np.sqrt(np.maximum(variances, 0.0)).tolist(), strict=True))


def _slope(value: Value, above: Value | None, below: Value | None, step: float) -> float:
    if above is None or below is None or value.scale == 0.0 or step == 0.0:
        return 0.0
    return (above.number - below.number) / (step * value.scale)


def _of_chain(found: AccuratePrediction, truth: Readings) -> CurvePoint:
    true = differences(readings_of(found.result), truth)
    guaranteed = [key for key in true if key not in found.not_guaranteed]
    largest = max((true[key] for key in guaranteed), default=np.nan)
    return CurvePoint(
        varied=WHOLE_CHAIN,
        level=f"tolerance {found.tolerance:g}",
        seconds=sum(found.stage_s.values()),
        true=largest,
        whole=largest,
        estimated=max((found.budget.total[key] for key in guaranteed), default=np.nan),
    )


def _digits(found: AccuratePrediction, truth: Readings) -> Iterator[DigitPoint]:
    """Yield the largest true error of each kind of number that is guaranteed."""
    seconds, worst = sum(found.stage_s.values()), dict.fromkeys(KINDS, 0.0)
    for key, error in differences(readings_of(found.result), truth).items():
        if key not in found.not_guaranteed and np.isfinite(error):
            kind = kind_of(key)
            worst[kind] = max(worst[kind], error)
    for kind, error in worst.items():
        yield DigitPoint(quantity=KINDS[kind], error=error, seconds=seconds)


def _of_setting(
    scene: LitScene, varied: str, middle: AccuratePrediction, whole: Readings, clock: Clock
) -> list[CurvePoint]:
    """One setting over its levels about that of a plan; the finest is the truth.

    The others are finer than the plan has them, so that what they leave does not show in the curve.
    """
    top = min(middle.plan[varied] + 2, len(NUMERICAL_SETTINGS[varied].levels) - 1)
    levels = range(max(middle.plan[varied] - _BELOW, 0), top + 1)
    others = _finer(middle.plan)
    found = [_at_level(scene, {**others, varied: level}, middle.tolerance, clock) for level in levels]
    truth = readings_of(found[-1][0])
    points = []
    for level, (result, errors) in zip(levels, found[:-1], strict=False):
        own = readings_of(result)
        points.append(
            CurvePoint(
                varied=varied,
                level=NUMERICAL_SETTINGS[varied].levels[level].label,
                seconds=sum(result.stage_s.values()),
                true=_largest(own, truth),
                whole=_largest(own, whole),
                estimated=max(errors[varied].values(), default=0.0),
            )
        )
    return points


def _largest(own: Readings, truth: Readings) -> float:
    """Largest difference of the readings that both have."""
    return max((error for error in differences(own, truth).values() if np.isfinite(error)), default=0.0)


def _at_level(
    scene: LitScene, plan: Plan, tolerance: float, clock: Clock
) -> tuple[ChainResult, dict[str, dict[Reading, float]]]:
    store = LightStore()
    result = evaluate(scene, settings_at(plan, tolerance, face_m=scene.sensor_height_m), store=store, clock=clock)
    lights = light_errors(scene, plan, result, store, tolerance=tolerance)
    budget = error_budget(scene, result, lights, tolerance=tolerance)
    return result, {name: dict(errors) for name, errors in budget.by_setting.items()}


def _finer(plan: Plan) -> dict[str, int]:
    """Return a plan one level finer in each setting, the wavelengths two: about a tenth of the errors that count."""
    more = dict.fromkeys(NUMERICAL_SETTINGS, 1) | {WAVELENGTHS: 2}
    return {name: min(plan[name] + more[name], len(one.levels) - 1) for name, one in NUMERICAL_SETTINGS.items()}


def _finer_settings(scene: LitScene, found: AccuratePrediction, tolerance: float) -> Settings:
    return settings_at(_finer(found.plan), tolerance, face_m=scene.sensor_height_m)
