"""Error against time of the computation of a scene.

`accuracy_curves` measures the time of a prediction and its true error against far finer settings for several
tolerances, for each numerical setting alone, and for fixed choices of the paper and the user; and the floor below which
a tolerance is useless because of uncertain inputs.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast, get_args

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import (
    DETECTION,
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
from model.accuracy.effect_check import kind_of
from model.accuracy.errors import LitCase, error_budgets, light_errors
from model.accuracy.plan import NUMERICAL_SETTINGS, WAVELENGTHS, Plan, settings_at
from model.accuracy.predict import ESTIMATES, Predicted, predict
from model.atmosphere.sky import Fidelity
from model.prediction import predict_with_errors
from model.processing.dolp_studies import rx_draws
from model.scene.field import TileRule
from model.scene.scene import LitScene
from rigctl.errors import ConfigError
from rigctl.prediction.predict import ScenePredictor
from rigctl.scene.scene import Scene, rig_errors, with_value

Clock = Callable[[], float]
Truth = Mapping[Reading, Value]

EVERY_10_DEG, PLANNED_GRID = "sky kept every 10 deg", "the planner's coarsest sky"
_PLANNED = 1e-2  # tolerance of settings whose grid alone is asked for
# Stated or implied by [MK14].
_TILES = {9: 3, 25: 5, 100: 10}
_DRAWS = (1_000, 10_000, 100_000, 1_000_000)
_SEED = 2014
_LEAST_EXCEEDING = 1.0


@dataclass(frozen=True, kw_only=True)
class NamedChoice:
    """A fixed choice of settings without an error estimate."""

    name: str  #: In words.
    seconds: float  #: Of the whole chain, without cached results [s].
    error: float  #: Largest true error of any number, and its key; 0 and None if no number differs.
    reading: Reading | None
    by_user: bool = False  #: Whether the user added it.


def named_choices(
    scene: LitScene, fine: Settings, truth: Truth, also: Sequence[str] = (), *, clock: Clock = time.perf_counter
) -> Iterator[NamedChoice]:
    """Yield the choices of the paper and of the user, each replacing one fine setting.

    [MK14] eq. (3), (8), (24), (25), section V.
    """
    own = [(text, settings_by(text, fine)) for text in also]
    for count, per_side in _TILES.items():
        tiled = replace(fine, tiles_per_side=per_side, tile_rule="midpoint", negligible_spread=0.0)
        yield _evaluated(f"K = {count} midpoint tiles", scene, tiled, truth, clock)
    planned = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), _PLANNED)
    grids = {EVERY_10_DEG: (9, 36), PLANNED_GRID: (planned.sky_zeniths, planned.sky_azimuths)}
    for name, (zeniths, azimuths) in grids.items():
        grid = replace(fine, sky_zeniths=zeniths, sky_azimuths=azimuths)
        yield _evaluated(name, scene, grid, truth, clock)
    yield _evaluated(
        "one effective wavelength", scene, replace(fine, wavelengths=1, split_at_kinks=False), truth, clock
    )
    yield from _single_scattering(scene, fine, truth, clock)
    result = evaluate(scene, fine, clock=clock)
    yield _first_order(result, truth)
    for draws in _DRAWS:
        yield from _drawn(result, truth, draws, clock)
    for text, settings in own:
        yield replace(_evaluated(text, scene, settings, truth, clock), by_user=True)


# Settings that a user may choose: the kind of number and its limits.
_ALSO: Mapping[str, tuple[type[int] | type[float], float, float]] = {
    "tiles_per_side": (int, 1, 50),
    "wavelengths": (int, 1, 20),
    "streams": (int, 4, 64),
    "sky_zeniths": (int, 4, 200),
    "sky_azimuths": (int, 4, 200),
    "hemisphere_tolerance": (float, 1e-8, 0.1),
    "dolp_tolerance": (float, 1e-13, 0.1),
    "roc_tolerance": (float, 1e-12, 0.01),
}
_RULE, _RULES = "rule", get_args(TileRule)


def settings_by(text: str, settings: Settings) -> Settings:
    """Return settings changed by a text such as "tiles_per_side=3,rule=midpoint"."""
    for part in text.split(","):
        key, _, value = (piece.strip() for piece in part.partition("="))
        if key not in (*_ALSO, _RULE) or not value:
            keys = ", ".join((*_ALSO, _RULE))
            raise ConfigError(f"--also: is {text!r}, must be KEY=VALUE,... with keys {keys}")
        try:
            settings = _with_setting(settings, key, value)
        except ValueError as error:
            raise ConfigError(f"--also: {key} = {value!r}: {error}") from error
    return settings


def _with_setting(settings: Settings, key: str, text: str) -> Settings:
    if key == _RULE:
        if text not in _RULES:
            raise ValueError(f"allowed are {', '.join(_RULES)}")
        return replace(settings, tile_rule=cast("TileRule", text))
    kind, least, most = _ALSO[key]
    try:
        number: Any = kind(text)
    except ValueError as error:
        raise ValueError(f"must be a {'whole ' if kind is int else ''}number, {least:g} to {most:g}") from error
    if not least <= number <= most:
        raise ValueError(f"allowed is {least:g} to {most:g}")
    if key == "streams":
        return replace(settings, solver=replace(settings.solver, nodes=number))
    if key == "tiles_per_side":
        return replace(settings, tiles_per_side=number, negligible_spread=0.0)
    return replace(settings, **{key: number})


def _evaluated(name: str, scene: LitScene, settings: Settings, truth: Truth, clock: Clock) -> NamedChoice:
    result = evaluate(scene, settings, clock=clock)
    own = result.readings
    return _choice(name, sum(result.stage_s.values()), differences(own, truth))


def _choice(name: str, seconds: float, errors: Mapping[Reading, float]) -> NamedChoice:
    finite = {key: error for key, error in errors.items() if np.isfinite(error)}
    worst = max(finite, key=lambda key: finite[key], default=None)
    error = 0.0 if worst is None else finite[worst]
    return NamedChoice(name=name, seconds=seconds, error=error, reading=worst if error > 0.0 else None)


def _single_scattering(scene: LitScene, fine: Settings, truth: Truth, clock: Clock) -> Iterator[NamedChoice]:
    if scene.air is not None and scene.air.is_solved and scene.air.alternative is None:
        alone = replace(scene, air=replace(scene.air, fidelity=Fidelity.SINGLE))
        yield _evaluated("single scattering", alone, fine, truth, clock)


def _first_order(result: ChainResult, truth: Truth) -> NamedChoice:
    """Mean and deviation of DoLP by [MK14] eq. (24), (25), which a prediction has beside the exact ones."""
    errors = {}
    for region, prediction in result.predictions.items():
        for statistic in ("mean", "std"):
            key = Reading(region, "dolp_pixels", statistic)
            first = prediction.quantities.get("dolp", {}).get(statistic)
            if first is not None and key in truth:
                errors[key] = abs(first - truth[key].number) / (truth[key].scale or 1.0)
    return _choice("first-order DoLP", sum(result.stage_s.values()), errors)


def _drawn(result: ChainResult, truth: Truth, draws: int, clock: Clock) -> Iterator[NamedChoice]:
    """ROC from random vectors instead of the integral."""
    generator, errors, start = np.random.default_rng(_SEED), {}, clock()
    for pair in result.detections:
        target, background = (result.predictions[name].stokes_dn for name in (pair.target, pair.background))
        # Least draws above a threshold.
        rates = [rate for rate in pair.p_false_alarm if rate * draws >= _LEAST_EXCEEDING]
        try:
            detected, _ = rx_draws(
                rates,
                target.mean,
                target.cov,
                background.mean,
                background.cov,
                draws=draws,
                generator=generator,
            )
        except ValueError:
            continue
        for rate, found in zip(rates, np.atleast_1d(detected), strict=True):
            key = Reading(f"{pair.target} on {pair.background}", "p_detection", f"{rate:g}")
            if key in truth:
                errors[key] = abs(float(found) - truth[key].number)
    if errors:
        chain = sum(seconds for stage, seconds in result.stage_s.items() if stage != DETECTION)
        yield _choice(f"ROC of {draws:.0e} draws".replace("e+0", "e"), chain + clock() - start, errors)


FloatArray = NDArray[np.float64]

# Tolerance of the reference over the smallest one shown.
_FINER = 0.1
# Levels of a setting below that of the plan.
_BELOW = 2
WHOLE_CHAIN = "whole chain"
# Kinds of numbers, by the meaning of a tolerance.
KINDS = {
    "radiance": "radiance and counts",
    "ratios": "DoLP, s1, s2",
    "deviations": "deviations and SNR",
    "detection": "probability of detection",
}


@dataclass(frozen=True, kw_only=True)
class CurvePoint:
    """One evaluation."""

    varied: str  #: Varied numerical setting; `WHOLE_CHAIN` for a prediction to a tolerance.
    level: str  #: To what.
    seconds: float  #: Without cached results [s].
    #: Largest error of any reading that is guaranteed: true and as estimated. Of one setting its own, against finer
    #: levels of it alone.
    true: float
    estimated: float
    whole: float  #: Largest true error of all settings together, against finer settings of all.


@dataclass(frozen=True, kw_only=True)
class DigitPoint:
    """Cost of one kind of number: its largest true error, and the time for all numbers [s]."""

    quantity: str
    error: float
    seconds: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Curves:
    """Curves of error against time for a scene."""

    points: tuple[CurvePoint, ...]  #: Of the whole chain and of each setting.
    predictions: tuple[Predicted, ...]
    #: Standard deviation of each reading from the uncertain inputs, in the units of a tolerance.
    floor: dict[Reading, float]
    reference_s: float  #: Time of the finest settings [s].
    named: tuple[NamedChoice, ...] = ()  #: The paper's choices and the user's.
    digits: tuple[DigitPoint, ...] = ()  #: True errors of each kind of number at each tolerance.

    @property
    def front(self) -> tuple[CurvePoint, ...]:
        """Pareto front: points without a faster and better one, from fast to good."""
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
    """Yield the current work in words, and finally the curves."""
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
    truth = reference.readings
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
    """Return whether a fixed choice lies below and to the left of the true errors of tolerances, as they are drawn."""
    chain = [point for point in curves.points if point.varied == WHOLE_CHAIN and point.true > 0.0]
    if not choice.error > 0.0 or not chain:
        return False
    seconds, errors = np.log([(point.seconds, point.true) for point in sorted(chain, key=lambda one: one.seconds)]).T
    at = np.log(choice.seconds)
    drawn = np.interp(at, seconds, errors, left=np.inf, right=-np.inf)
    is_better_than_a_point = np.any((at <= seconds) & (np.log(choice.error) <= errors))
    return bool(is_better_than_a_point or (np.isfinite(drawn) and np.log(choice.error) <= drawn))


def estimates_share(found: Predicted) -> float:
    """Return the share of a prediction's time that its error estimates take."""
    total = sum(found.stage_s.values())
    return found.stage_s[ESTIMATES] / total if total > 0.0 else 0.0


def _fastest(scene: LitScene, tolerance: float, clock: Clock) -> Predicted:
    """Return the faster of two predictions, to exclude other load of the machine."""
    found = [predict([scene], tolerance=tolerance, clock=clock).cases[0] for _ in range(2)]
    return min(found, key=lambda one: sum(one.stage_s.values()))


def steps(tolerances: Sequence[float]) -> int:
    """Return the number of steps of `accuracy_curves`."""
    return len(tolerances) + len(NUMERICAL_SETTINGS) + 3


def input_floor(predictor: ScenePredictor) -> dict[Reading, float]:
    """Return the deviation of each reading from the uncertain inputs, in the units of a tolerance.

    Definition: central differences of one standard deviation, and the covariance of the inputs.
    """
    inputs, store = predictor.inputs, LightStore()
    deviations = np.sqrt(np.diag(inputs.cov))
    used = np.flatnonzero(deviations > 0.0)
    coarse = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), 1e-2)

    def at(scene: Scene) -> Readings:
        result, errors = evaluate(predictor.lit_scene(scene), coarse, store=store), rig_errors(scene)
        if errors is None:
            return result.readings
        # Errors of the rig affect all readings except probabilities of detection.
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
        # If one side is impossible, such as an albedo above 1, the other is used.
        (high, above), (low, below) = (*sides, (value, base))[:2]
        slopes[:, place] = [_slope(base[key], above.get(key), below.get(key), high - low) for key in base]
    variances = np.einsum("qi,ij,qj->q", slopes, inputs.cov, slopes)
    return dict(zip(base, np.sqrt(np.maximum(variances, 0.0)).tolist(), strict=True))


def _slope(value: Value, above: Value | None, below: Value | None, step: float) -> float:
    if above is None or below is None or value.scale == 0.0 or step == 0.0:
        return 0.0
    return (above.number - below.number) / (step * value.scale)


def _of_chain(found: Predicted, truth: Readings) -> CurvePoint:
    true = differences(found.result.readings, truth)
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


def _digits(found: Predicted, truth: Readings) -> Iterator[DigitPoint]:
    """Yield the largest true error of each kind of number that is guaranteed."""
    seconds, worst = sum(found.stage_s.values()), dict.fromkeys(KINDS, 0.0)
    for key, error in differences(found.result.readings, truth).items():
        if key not in found.not_guaranteed and np.isfinite(error):
            kind = kind_of(key)
            worst[kind] = max(worst[kind], error)
    for kind, error in worst.items():
        yield DigitPoint(quantity=KINDS[kind], error=error, seconds=seconds)


def _of_setting(scene: LitScene, varied: str, middle: Predicted, whole: Readings, clock: Clock) -> list[CurvePoint]:
    """One setting over its levels around that of a plan; the finest is the reference.

    Other settings are finer than in the plan, so that their errors do not affect the curve.
    """
    top = min(middle.plan[varied] + 2, len(NUMERICAL_SETTINGS[varied].levels) - 1)
    levels = range(max(middle.plan[varied] - _BELOW, 0), top + 1)
    others = _finer(middle.plan)
    found = [_at_level(scene, {**others, varied: level}, middle.tolerance, clock) for level in levels]
    truth = found[-1][0].readings
    points = []
    for level, (result, errors) in zip(levels, found[:-1], strict=False):
        own = result.readings
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
    """Largest difference of common readings."""
    return max((error for error in differences(own, truth).values() if np.isfinite(error)), default=0.0)


def _at_level(
    scene: LitScene, plan: Plan, tolerance: float, clock: Clock
) -> tuple[ChainResult, dict[str, dict[Reading, float]]]:
    store = LightStore()
    result = evaluate(scene, settings_at(plan, tolerance, face_m=scene.sensor_height_m), store=store, clock=clock)
    (lights,) = light_errors(((scene, result),), plan, store, tolerance=tolerance)
    (budget,) = error_budgets((LitCase(scene=scene, result=result, lights=lights),), tolerance=tolerance)
    return result, {name: dict(errors) for name, errors in budget.by_setting.items()}


def _finer(plan: Plan) -> dict[str, int]:
    """Return a plan one level finer in each setting, the wavelengths two: about a tenth of the errors that count."""
    more = dict.fromkeys(NUMERICAL_SETTINGS, 1) | {WAVELENGTHS: 2}
    return {name: min(plan[name] + more[name], len(one.levels) - 1) for name, one in NUMERICAL_SETTINGS.items()}


def _finer_settings(scene: LitScene, found: Predicted, tolerance: float) -> Settings:
    return settings_at(_finer(found.plan), tolerance, face_m=scene.sensor_height_m)
