"""A run compared with the model, number by number, with one verdict.

With a scene (`compare_with_scene`), `rigctl.comparison.predict_run` predicts the run; `rigctl.comparison.rows` sets
each predicted number next to the measured one, with the errors of both, and decides by Holm's rule. Numerical settings
are chosen so that numerical errors are far below those of the rows. Without a scene (`compare_with_itself`), noise
model and DoLP law predict the run from its own means and texture. Checks of the run (`rigctl.comparison.checks`) tell
which regions can be judged at all.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import copysign, hypot, inf, radians
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import Reading
from model.accuracy.effect_check import kind_of, with_unstated
from model.accuracy.plan import NUMERICAL_SETTINGS
from model.accuracy.predict import SMALLEST, Predicted, predict
from model.effects.effect import LIGHT, Effect, EffectPlan, EffectRule
from model.prediction import Quantities, RegionPrediction, predict_region
from model.processing.agreement import Propagation, input_jacobian
from model.processing.samples import Sample, check_dolp_distribution, deviation
from model.quantities import angle_of, counts_name, error_scale, is_counts
from model.scene.field import FieldLight
from model.sensor import ChannelMoments
from rigctl.base.numbers import to_digits, wrapped
from rigctl.comparison.checks import (
    AGREES,
    Cause,
    Check,
    RegionVerdict,
    Trend,
    VerdictName,
    diagnose,
    nothing_tested,
    refused_regions,
    region_verdicts,
    run_checks,
    shown_effects,
    trends_of,
    verdict_of,
    without_decisions,
)
from rigctl.comparison.explain import (
    InputAttribution,
    UnstatedEffect,
    attribute_residuals,
    unstated_effects,
    unstated_lines,
)
from rigctl.comparison.predict_run import RunPredictor, run_predictor
from rigctl.comparison.rows import (
    RegionBudget,
    Row,
    decide,
    error_of_both,
    is_coarse,
    pair,
    predictable,
    run_budgets,
    scene_budgets,
    scored,
    with_joint_scores,
    with_ratios,
    with_run_errors,
)
from rigctl.comparison.scale import Scale, scale_inputs
from rigctl.console import Json
from rigctl.errors import ConfigError, as_config_error
from rigctl.files.choices import ScaleKind
from rigctl.measure.diagnose import MeasuredRun
from rigctl.measure.measure import (
    MeasuredRegion,
    Measurement,
    TemporalNoise,
    measured_with_ratios,
    temporal_noise,
    temporal_variance,
)
from rigctl.prediction.predict import (
    NumberKey,
    Performance,
    curved_inputs,
    model_warnings,
    performance_of,
    propagate_numbers,
)
from rigctl.runs.records import monitor_traces, read_events
from rigctl.scene.effects import plan_effects
from rigctl.scene.light import lit_scene
from rigctl.scene.scene import Inputs, Scene, acting_effects, only_uncertain

FloatArray = NDArray[np.float64]

# Largest numerical error as a share of a row's standard error: in quadrature that adds 5 %.
ALLOWED_SHARE = 0.3
# The first tolerance; most comparisons need no other.
_FIRST_TOLERANCE = 0.01
# A next tolerance aims at this share of what is allowed, and is at least twice as small.
_AIM, _LEAST_STEP = 0.7, 0.5
_RATIO = "ratio_"
# Share of an error of S0 that a ratio of counts keeps, as sensors are linear to a few percent.
_NOT_LINEAR = 0.03
# Finer settings are not tried where the planner expects them to take longer [s].
_LONGEST_S = 10.0
# How many hardly tested numbers of a region are listed at the head of a report; its tables have all.
_MOST_LISTED = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class NumericalAccuracy:
    """A prediction of a run to a tolerance, and its numerical errors compared with those of the rows."""

    tolerance: float  #: Of effects that are left out and numerical settings together.
    predicted: Predicted  #: Settings, and errors as they were estimated.
    effects: EffectPlan  #: Which effects the run calls for.
    left_out: frozenset[Effect]  #: Effects of the light that the plan leaves out, and that are there.
    taken: frozenset[Effect]  #: Effects that act.
    share: float = 0.0  #: Largest numerical error over the standard error of its row; 0 where no row has one.
    row: NumberKey | None = None  #: Where that is.

    @property
    def is_kept(self) -> bool:
        """Whether every row's numerical error is below the allowed share of its standard error."""
        return self.share <= ALLOWED_SHARE

    @property
    def next_tolerance(self) -> float | None:
        """Next tolerance to try; None where this one suffices, is the smallest, or finer settings take minutes."""
        if self.is_kept or self.tolerance <= SMALLEST or self.share == inf or self.is_dear:
            return None
        return max(self.tolerance * min(_LEAST_STEP, _AIM * ALLOWED_SHARE / self.share), SMALLEST)

    @property
    def is_dear(self) -> bool:
        """Whether finer settings would take minutes."""
        return self.predicted.expected_s > _LONGEST_S

    @property
    def settings(self) -> dict[str, str]:
        """Each numerical setting with its level, in words."""
        return {name: knob.levels[self.predicted.plan[name]].label for name, knob in NUMERICAL_SETTINGS.items()}

    @property
    def remark(self) -> str:
        """Tolerance, largest error and its row in one line."""
        where = "" if self.row is None else f" ({self.row.region} {self.row.quantity} {self.row.statistic})"
        kind = "estimated, for spheres not promised, " if self.predicted.estimated_only else ""
        text = (
            f"Numerical error: {kind}at most {self.share:.2g} of a standard error{where}, with a tolerance of "
            f"{self.tolerance:.2g} chosen for this comparison"
        )
        if self.is_kept:
            return text
        why = "finer settings take minutes" if self.is_dear else "no tolerance that was tried reached it"
        return f"{text}; the aim was {ALLOWED_SHARE:g}, but {why}"

    def of_rows(self, rows: Iterable[Row], predictions: Mapping[str, RegionPrediction]) -> "NumericalAccuracy":
        """Return the accuracy with its largest error among the rows of a comparison."""
        errors = {row.key: error_of_both(row) for row in rows if row.agrees is not None}
        shares = {
            key: self._error(key, predictions[key.region]) / error for key, error in errors.items() if error > 0.0
        }
        worst = max(shares, key=lambda key: shares[key], default=None)
        return replace(self, share=0.0 if worst is None else shares[worst], row=worst)

    def _error(self, key: NumberKey, prediction: RegionPrediction) -> float:
        """Numerical error of a row, in its own unit."""
        region, quantity, statistic = key.region, key.quantity, key.statistic
        numbers = prediction.quantities
        if quantity.startswith(_RATIO):
            return self._error_of_ratio(region, quantity, numbers)
        if quantity == "aolp_deg":
            return self._error_of_angle(region, statistic, numbers["dolp"]["mean"], numbers[quantity][statistic])
        scale = error_scale(quantity, statistic, numbers[quantity][statistic], numbers["s0"]["mean"])
        return scale * self.in_tolerance(region, quantity, statistic)

    def _error_of_ratio(self, region: str, quantity: str, numbers: Quantities) -> float:
        """Error of counts over their mean: an error of S0 cancels up to nonlinearity, one of (s1, s2) does not."""
        ratio, counts = abs(numbers[quantity]["mean"]), [name for name in numbers if is_counts(name)]
        own = self.in_tolerance(region, counts_name(angle_of(quantity.removeprefix(_RATIO))), "mean")
        of_counts = ratio * (own + max(self.in_tolerance(region, name, "mean") for name in counts))
        turned = hypot(*(self.in_tolerance(region, name, "mean") for name in ("s1n", "s2n")))
        # The mean of the channels over that of unpolarized light: they are (S0 + S1 cos + S2 sin) / 2.
        level = 2.0 * sum(numbers[name]["mean"] for name in counts) / len(counts) / numbers["s0"]["mean"]
        return min(of_counts, turned * (1.0 + ratio) / level + _NOT_LINEAR * of_counts)

    def _error_of_angle(self, region: str, statistic: str, dolp: float, number: float) -> float:
        """Error of AoLP: half the angle by which (s1, s2) may turn; of a deviation, also the error of theirs."""
        turned = hypot(*(self.in_tolerance(region, name, "mean") for name in ("s1n", "s2n")))
        if statistic == "mean":
            return 0.5 * turned / dolp / radians(1.0) if dolp > 0.0 else inf
        of_deviations = max(self.in_tolerance(region, name, statistic) for name in ("s1n", "s2n"))
        return abs(number) * (of_deviations + (turned / dolp if dolp > 0.0 else inf))

    def in_tolerance(self, region: str, quantity: str, statistic: str) -> float:
        """Return the numerical error plus the largest change by left out effects, in the units of a tolerance."""
        key = Reading(region, quantity, statistic)
        spent = float(getattr(self.effects.spent, kind_of(key))) if self.left_out else 0.0
        return self.predicted.budget.total.get(key, inf) + spent


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Measurement of a run and what the model predicts for it, number by number, with a verdict."""

    #: "scene": predicted from a scene file. "closed loop": predicted from the run's own means and texture.
    kind: Literal["scene", "closed loop"]
    run: MeasuredRun  #: measurement, regions, calibrations and faults of the run itself
    alpha: float  #: family-wise error rate: chance that any row is called a disagreement where all agree
    rows: tuple[Row, ...]
    points_to: tuple[Cause, ...]  #: causes that would show as the disagreements do; `ADVICE` has a sentence for each
    predictions: dict[str, RegionPrediction]  #: by region
    remarks: tuple[str, ...]  #: assumptions, settings of the file that the run overrules, effects left out
    not_tested: tuple[str, ...]  #: limits of this comparison
    scale: Scale | None = None  #: of the predicted counts; None without a scene
    inputs: Inputs | None = None  #: the inputs that have an uncertainty; None without a scene
    propagation: Propagation | None = None  #: errors of the rows by their uncertainty
    #: inputs that would explain the residuals; None where no input has an uncertainty
    attribution: InputAttribution | None = None
    unstated: tuple[UnstatedEffect, ...] = ()  #: effects that nobody stated, the largest first
    trends: tuple[Trend, ...] = ()  #: whether the order of numbers is as predicted; empty without a scene
    budgets: dict[str, RegionBudget]  #: uncertainty of each region's polarization by cause
    checks: tuple[Check, ...]  #: whether the run is sound, before any model
    unjudged: dict[str, str]  #: region that cannot be judged to the reason
    lights: dict[str, FieldLight] = field(default_factory=dict)  #: of the regions that are given by a material
    accuracy: NumericalAccuracy | None = None  #: effects and numerical settings that were chosen; None without a scene
    files: dict[str, dict[str, Json]] = field(default_factory=dict)  #: path and sha256 by role, such as "scene"

    @property
    def measurement(self) -> Measurement:
        """The numbers of the run."""
        return self.run.measurement

    @cached_property
    def performance(self) -> Performance:
        """Probability of detection and DoLP SNR by the predictions."""
        return performance_of(self.predictions)

    @property
    def verdict(self) -> VerdictName:
        """The verdict of the whole comparison."""
        return verdict_of(self.rows, self.checks, self.unjudged)

    @property
    def agrees(self) -> bool | None:
        """Whether it agrees, with reservations or without; None where it cannot be judged."""
        return AGREES[self.verdict]

    @property
    def regions(self) -> dict[str, RegionVerdict]:
        """The verdict of every region."""
        return region_verdicts(self.rows, self.checks, self.unjudged)

    @property
    def flags(self) -> tuple[Check, ...]:
        """The checks of the run that are flagged."""
        return tuple(check for check in self.checks if check.verdict == "flagged")

    @property
    def weak(self) -> tuple[str, ...]:
        """Differences that this comparison could hardly have detected, in words, region by region."""
        by_region: dict[str, list[Row]] = {}
        for row in self.rows:
            if row.agrees is not None and row.is_weak:
                by_region.setdefault(row.region, []).append(row)
        return tuple(f"{region}: {_weakly_tested(rows)}" for region, rows in by_region.items())

    @property
    def disagreements(self) -> tuple[Row, ...]:
        """The rows that disagree."""
        return tuple(row for row in self.rows if row.agrees is False)


# How many tolerances are tried after the first.
_MOST_TRIED = 3


def compare_with_scene(
    run: MeasuredRun,
    scene: Scene,
    *,
    alpha: float,
    scale: ScaleKind = "absolute",
    rule: EffectRule = "safe",
    tolerance: float | None = None,
    files: dict[str, dict[str, Json]] | None = None,
) -> Comparison:
    """Compare a run with a scene; the numerical tolerance to begin with is chosen unless it is given."""
    measurement, stated = run.measurement, run_predictor(run.measurement, scene)
    accuracy = accuracy_at(stated, tolerance or _FIRST_TOLERANCE, rule)
    found = _with_prediction(_at_accuracy(stated, accuracy), run, alpha=alpha, scale=scale)
    accuracy = accuracy.of_rows(found.rows, found.predictions)
    # The errors of the first rows decide the tolerance of a second prediction.
    finer = _finer(stated, accuracy, found, rule)
    if finer is not None:
        found = _with_prediction(_at_accuracy(stated, finer), run, alpha=alpha, scale=scale, coarser=found)
        accuracy = finer.of_rows(found.rows, found.predictions)
    predictor, inputs, uncertain, scale_used = found.predictor, found.inputs, only_uncertain(found.inputs), found.scale
    coarse = [
        name
        for name, prediction in found.predictions.items()
        if name in measurement.regions and is_coarse(prediction, measurement.regions[name], measurement)
    ]
    not_tested = (*_not_tested(measurement, inputs.scene, scale_used, uncertain), *_too_coarse(coarse))
    checks, unjudged = _judged(run, found.rows, not_tested)
    rows = without_decisions(found.rows, unjudged)
    unstated = _unstated(run, stated, accuracy, rows)
    budgets = scene_budgets(
        found.predictions,
        measurement,
        inputs=inputs,
        rows=found.rows,
        propagation=found.propagation,
        uncertain=uncertain,
    )
    return Comparison(
        kind="scene",
        run=run,
        alpha=alpha,
        rows=rows,
        points_to=diagnose(found.rows),
        predictions=found.predictions,
        remarks=(
            *_of_run(run),
            *inputs.scene.remarks,
            scale_used.remark,
            *_overruled(inputs.scene, measurement, predictor.exposure_s),
            *predictor.remarks,
            *predictor.light.remarks(inputs.scene),
            *model_warnings(found.predictions),
            *curved_inputs(found.propagation, uncertain),
            accuracy.remark,
            *unstated_lines(unstated, disagrees=any(row.agrees is False for row in rows)),
        ),
        not_tested=not_tested,
        scale=scale_used,
        inputs=uncertain,
        propagation=found.propagation,
        attribution=attribute_residuals(
            found.rows, propagation=found.propagation, inputs=uncertain, measurement=measurement
        ),
        unstated=unstated,
        trends=trends_of(found.rows, found.propagation.cov, measurement),
        budgets=with_run_errors(budgets, run, found.predictions),
        checks=checks,
        unjudged=unjudged,
        lights=predictor.lights(inputs.scene),
        accuracy=accuracy,
        files=files or {},
    )


class _Predicted(NamedTuple):
    """A run with its prediction: decided rows, and what they were made from."""

    predictor: RunPredictor
    inputs: Inputs
    scale: Scale
    predictions: dict[str, RegionPrediction]
    propagation: Propagation
    rows: tuple[Row, ...]


def _with_prediction(
    predictor: RunPredictor, run: MeasuredRun, *, alpha: float, scale: ScaleKind, coarser: _Predicted | None = None
) -> _Predicted:
    """Predict a run and decide its rows; errors of the inputs are those of a coarser prediction of the same rows."""
    measurement, predicted = run.measurement, predictor.predictions
    inputs, scale_used = scale_inputs(
        scale,
        predictor.inputs,
        measurement=measurement,
        radiometric=run.calibrations.radiometric,
        predicted=predicted,
    )
    predictions = predicted(inputs.values)
    rows = tuple(_paired(predictions, measurement))
    if coarser is not None and [row.key for row in coarser.rows] == [row.key for row in rows]:
        propagation = coarser.propagation
    else:
        propagation = propagate_numbers({row.key: row.predicted for row in rows}, inputs, predicted)
    errors = np.sqrt(np.maximum(np.diag(propagation.cov), 0.0))
    all_scored = tuple(scored(row, error) for row, error in zip(rows, errors, strict=True))
    decided = decide(with_joint_scores(all_scored, predictions, measurement, propagation.cov), alpha=alpha)
    return _Predicted(predictor, inputs, scale_used, predictions, propagation, decided)


def _at_accuracy(run: RunPredictor, accuracy: NumericalAccuracy) -> RunPredictor:
    return replace(run.without(accuracy.left_out), settings=accuracy.predicted.result.settings)


def _finer(
    run: RunPredictor, accuracy: NumericalAccuracy, found: _Predicted, rule: EffectRule
) -> NumericalAccuracy | None:
    """Return finer settings that bring the numerical errors far below those of the rows; None where none are needed."""
    chosen = accuracy
    for _ in range(_MOST_TRIED):
        if chosen.next_tolerance is None:
            break
        finer = accuracy_at(run, chosen.next_tolerance, rule).of_rows(found.rows, found.predictions)
        # Without finer settings, as for very deep air, a smaller tolerance changes nothing.
        if finer.share >= chosen.share:
            break
        chosen = finer
    return None if chosen is accuracy else chosen


def _judged(
    run: MeasuredRun, rows: Sequence[Row], not_tested: Sequence[str], unpredicted: Mapping[str, str] | None = None
) -> tuple[tuple[Check, ...], dict[str, str]]:
    """Return the checks of a run, and the regions that cannot be judged, each with the reason."""
    checks = (*run_checks(run), *nothing_tested(rows, not_tested))
    return checks, run.measurement.unmeasured | dict(unpredicted or {}) | refused_regions(checks)


def _of_run(run: MeasuredRun) -> tuple[str, ...]:
    """Return how the run was measured: its calibrations, its corrections, and what monitors recorded."""
    traces = monitor_traces(read_events(run.measurement.run.path))
    return (*run.calibrations.selected.lines, *run.remarks, *(trace.line for trace in traces))


def _paired(predictions: Mapping[str, RegionPrediction], measurement: Measurement) -> Iterable[Row]:
    for region, prediction in predictions.items():
        if region in measurement.unmeasured:
            continue
        if region not in measurement.regions:
            raise ConfigError(f"region {region} of the scene file was not measured")
        taken = measurement.run.session
        measured = predictable(
            measured_with_ratios(measurement.regions[region]),
            is_mosaic=taken.cell_deg is not None,
            is_interpolated=taken.interpolation != "none",
        )
        yield from pair(region, prediction.quantities, measured)


def _weakly_tested(rows: Sequence[Row]) -> str:
    listed = "; ".join(
        f"{row.quantity} {row.statistic} only if off by more than {to_digits(least, least)}, of {to_digits(size, size)}"
        for row in rows[:_MOST_LISTED]
        for least, size in ((row.smallest_difference_90 or 0.0, abs(row.predicted)),)
    )
    more = "" if len(rows) <= _MOST_LISTED else f"; and {len(rows) - _MOST_LISTED} more"
    return f"a difference would have been detected (with a probability of 90 %) in {listed}{more}"


def _unstated(
    run: MeasuredRun, predictor: RunPredictor, accuracy: NumericalAccuracy, rows: tuple[Row, ...]
) -> tuple[UnstatedEffect, ...]:
    """Return the effects that are not stated, of the sizes that the run shows or that are usual."""
    scene, shown = predictor.inputs.scene, shown_effects(run)
    with as_config_error(f"scene {scene.name}"):
        whole, others = with_unstated(
            lit_scene(scene, readout=predictor.readout, exposure_s=predictor.exposure_s),
            accuracy.effects,
            accuracy.predicted.result.settings,
            store=predictor.light.lights,
            ranges={effect: (value, value + copysign(2.0 * error, value)) for effect, (value, error) in shown.items()},
        )
    predicted = [(effect, other.predictions) for effect, other in others]
    return unstated_effects(rows, whole.predictions, predicted, shown)


def accuracy_at(run: RunPredictor, tolerance: float, rule: EffectRule) -> NumericalAccuracy:
    """Return the prediction of a run to a tolerance."""
    scene = run.inputs.scene
    planned = plan_effects(scene, tolerance=tolerance, readout=run.readout, exposure_s=run.exposure_s)
    present = {decision.effect for decision in planned.plan.decisions if decision.bound.largest > 0.0}
    acting = acting_effects(scene)
    left_out = frozenset() if rule == "all" else ((acting & LIGHT & present) - planned.plan.active)
    spent = planned.plan.spent.largest if left_out else 0.0
    with as_config_error(f"scene {scene.name}"):
        (predicted,) = predict(
            [planned.scene],
            tolerance=max(tolerance - spent, SMALLEST),
            effects=acting - left_out,
            estimated_only=True,
            store=run.light.lights,
        ).cases
    return NumericalAccuracy(
        tolerance=tolerance, predicted=predicted, effects=planned.plan, left_out=left_out, taken=acting - left_out
    )


# Angles that differ by less are one angle that a stage was sent to [deg].
_LANDING_DEG = 1.0
# Limits of every comparison with a simulated run.
NOT_OF_SIMULATION = (
    (
        "the scene part of the model against nature: a simulated scene whose truth was computed by the model, or "
        "stated in a file, agrees with it because both have one source"
    ),
    "any real device: stage, camera and light are simulated, with assumed numbers",
)


def _overruled(scene: Scene, measurement: Measurement, exposure_s: float) -> Iterable[str]:
    """Yield where the run overrules the scene file, and whether its extinction ratio is missing."""
    if abs(scene.acquisition.exposure_ms / 1000 - exposure_s) > 1e-6 * exposure_s:
        yield (
            f"exposure: {exposure_s * 1000:g} ms of the run, not {scene.acquisition.exposure_ms:g} ms of the scene file"
        )
    if scene.acquisition.cycles != measurement.grid.cycles:
        yield f"cycles: {measurement.grid.cycles} of the run, not {scene.acquisition.cycles} of the scene file"
    light = measurement.run.session.simulated_light
    yield from () if light is None else light.remarks
    stated_deg = np.sort(np.mod(scene.acquisition.angles_deg, 180.0))
    read_deg = np.rad2deg(measurement.grid.polarizer_angles_rad)
    if not _same_angles(stated_deg, read_deg):
        run, file = (", ".join(f"{angle:.4g}" for angle in angles) for angles in (read_deg, stated_deg))
        yield f"angles: {run} deg of the run, not {file} deg of the scene file"
    if np.isfinite(measurement.extinction_ratio):
        return
    yield "the processing takes the polarizer as ideal: the run states no extinction ratio"


def _same_angles(stated_deg: FloatArray, read_deg: FloatArray) -> bool:
    """Return whether axes are the same within the accuracy of a stage."""
    if stated_deg.size != read_deg.size:
        return False
    apart = wrapped(stated_deg - read_deg, turn=180.0)
    return bool(np.all(np.abs(apart) < _LANDING_DEG))


def _not_tested(measurement: Measurement, scene: Scene, scale: Scale, uncertain: Inputs) -> tuple[str, ...]:
    """Return the limits of a comparison with a scene."""
    given = [region.name for region in scene.regions if region.material is None]
    found = []
    if len(given) == len(scene.regions):
        found.append(
            "the radiance of the scene: the model was given it, it did not compute it from surface, sun and sky"
        )
    elif given:
        found.append(f"the radiance of {', '.join(given)}: the model was given it")
    light = measurement.run.session.simulated_light
    found.extend(() if light is None else light.caution)
    if measurement.run.session.origin == "simulated":
        found.extend(NOT_OF_SIMULATION)
    if scale.kind == "free":
        found.append("the scale of the counts: it was fitted to S0 of this run")
    if not uncertain.names:
        found.append(
            "the numbers of the scene file within their uncertainties: none is stated; write "
            "{ value = ..., std = ... } or { range = [..., ...] }"
        )
    if measurement.run.session.cell_deg is not None:
        found.append(
            "deviations of Stokes parameters and DoLP over the pixels: each angle of a mosaic has pixels of its own, "
            "and the correlation of their texture is not known"
        )
    if measurement.grid.cycles < 2:
        found.append("temporal noise: there is one cycle only")
    return tuple(found)


_NOT_TESTED = (
    "means, and deviations that the other half of the pixels does not predict: rows without a verdict",
    "the scene: no radiance was predicted",
)

# Both sides come from the same pixels: if the error of their difference is below this share of the error of the
# measurement, they are one number.
_ONE_NUMBER_SHARE = 0.1
_ONE_NUMBER = "so far above the noise that the law returns the measured number itself"


def _too_coarse(regions: Sequence[str]) -> tuple[str, ...]:
    """Return the regions in which whole counts are too coarse for the law of DoLP."""
    if not regions:
        return ()
    text = "the noise is only a few counts, so that (S1, S2) lie on a grid that the law of DoLP does not describe"
    return (f"the DoLP of single pixels of {', '.join(regions)}: {text}",)


def compare_with_itself(
    run: MeasuredRun, *, alpha: float, files: dict[str, dict[str, Json]] | None = None
) -> Comparison:
    """Compare the pixels of each region of a run with the prediction by its own channel means and texture."""
    measurement, noise = run.measurement, run.calibrations.noise
    calibrated = None if noise is None else temporal_noise(noise)
    rows: list[Row] = []
    remarks: list[str] = [] if calibrated is None else list(calibrated.remarks)
    predictions: dict[str, RegionPrediction] = {}
    unpredicted: dict[str, str] = {}
    same: dict[str, list[str]] = {}
    coarse: list[str] = []
    for name, region in measurement.regions.items():
        try:
            loop = _RegionLoop(name, region, measurement, calibrated)
            own_rows, own_remarks = loop.rows(), loop.remarks()
        except (ValueError, ArithmeticError) as error:
            unpredicted[name] = f"its numbers cannot be predicted: {error}"
            continue
        predictions[name] = loop.prediction
        coarse += [name] if loop.is_coarse else []
        rows += own_rows
        remarks += own_remarks
        same.setdefault(loop.one_number(), []).append(name)
    decided, light = decide(tuple(rows), alpha=alpha), measurement.run.session.simulated_light
    not_tested = (
        *_NOT_TESTED,
        *(f"{', '.join(regions)}: {numbers}: {_ONE_NUMBER}" for numbers, regions in same.items() if numbers),
        *_too_coarse(coarse),
        *(("temporal noise: no noise calibration was given",) if calibrated is None else ()),
        *(() if light is None else light.caution),
    )
    checks, unjudged = _judged(run, decided, not_tested, unpredicted)
    gain_dn_per_e = None if calibrated is None else float(calibrated.values[0])
    return Comparison(
        kind="closed loop",
        run=run,
        alpha=alpha,
        rows=without_decisions(decided, unjudged),
        points_to=diagnose(decided, is_of_law=True),
        predictions=predictions,
        remarks=(*_of_run(run), *remarks),
        not_tested=not_tested,
        budgets=with_run_errors(run_budgets(predictions, measurement, gain_dn_per_e=gain_dn_per_e), run, predictions),
        checks=checks,
        unjudged=unjudged,
        files=files or {},
    )


class _RegionLoop:
    """Moments of one region, and the rows that follow from them."""

    def __init__(
        self, name: str, region: MeasuredRegion, measurement: Measurement, noise: TemporalNoise | None
    ) -> None:
        self._name, self._region, self._measurement, self._noise = name, region, measurement, noise
        self._cycles = measurement.grid.cycles
        if noise is None:
            # Noise and texture cannot be told apart: the spread of one cycle holds both.
            temporal, self._texture = np.zeros_like(region.channels_mean.mean), np.cov(region.channel_pixels)
            self._texture_pixels = region.stokes_pixels
        else:
            temporal = self._temporal(noise.values)
            self._texture = np.cov(region.channel_pixels_mean) - np.diag(temporal) / self._cycles
            self._texture_pixels = region.stokes_pixels_mean
        # Noise of one cycle beyond that of the mean of all cycles.
        self._added_to_channels = np.diag(temporal) * (1.0 - 1.0 / self._cycles)
        self._added = self._stokes_cov(self._added_to_channels)
        self.prediction = with_ratios({name: self._predicted(temporal)})[name]
        self.is_coarse = is_coarse(self.prediction, region, measurement)

    def rows(self) -> list[Row]:
        """Return the region's rows: tests with scores, the rest without."""
        paired = list(pair(self._name, self.prediction.quantities, measured_with_ratios(self._region)))
        tests = [*self._temporal_rows(paired), *self._half_rows(), *self._law_rows]
        tested = {(row.quantity, row.statistic) for row in tests}
        fitted = [row for row in paired if (row.quantity, row.statistic) not in tested]
        return [*tests, *(replace(row, std_error_inputs=None) for row in fitted)]

    def remarks(self) -> list[str]:
        """Return the reasons for which the DoLP of a region is not tested."""
        if "std" not in self._region.quantities["s0"]:
            return []
        if "dolp_pixels" not in self._region.quantities:
            return [f"{self._name}: some pixels have no light, so their DoLP was not compared"]
        return [f"{self._name}: {warning}" for warning in self.prediction.warnings]

    def one_number(self) -> str:
        """Return the numbers of the law that are the measured ones themselves; empty if there are none."""
        return ", ".join(f"{row.quantity} {row.statistic}" for row in self._law_rows if row.z is None)

    def _temporal(self, values: FloatArray) -> FloatArray:
        return temporal_variance(self._measurement, self._region, values)

    def _stokes_cov(self, channel_cov: FloatArray) -> FloatArray:
        inverse = self._measurement.plan.inverse
        return np.asarray(inverse @ channel_cov @ inverse.T)

    def _predicted(self, temporal: FloatArray) -> RegionPrediction:
        channels = ChannelMoments(
            mean_dn=self._region.channels_mean.mean,
            dark_signal_dn=0.0,
            scene_cov_dn2=self._texture,
            temporal_var_dn2=temporal,
            fixed_pattern_cov_dn2=np.zeros_like(self._texture),
            saturation_probability=np.zeros_like(temporal),
            warnings=(),
        )
        grid = self._measurement.grid
        return predict_region(
            channels, plan=self._measurement.plan, channel_names=grid.channel_names, cycles=self._cycles
        )

    def _temporal_rows(self, paired: list[Row]) -> Iterable[Row]:
        if self._noise is None:
            return
        rows = [row for row in paired if row.statistic == "std_temporal"]
        errors = _errors(self._noise, lambda values: self._temporal_deviations(values, rows))
        for row, error in zip(rows, errors, strict=True):
            yield scored(row, float(error))

    def _temporal_deviations(self, values: FloatArray, rows: list[Row]) -> FloatArray:
        variances = np.diag(self._temporal(values))
        deviations = dict(zip(self._measurement.grid.channel_names, np.sqrt(np.diag(variances)), strict=True))
        stokes = np.sqrt(np.diag(self._stokes_cov(variances)))
        deviations |= dict(zip(("s0", "s1", "s2"), stokes, strict=True))
        return np.array([deviations[row.quantity] for row in rows])

    @cached_property
    def _law_rows(self) -> tuple[Row, ...]:
        return tuple(self._rows_of_law()) if self._law_rows_exist() else ()

    def _rows_of_law(self) -> Iterable[Row]:
        inflation = self._region.pixels / self._region.independent_pixels
        checks = check_dolp_distribution(self._region.stokes_pixels, self._texture_pixels, self._added)
        places = {"mean": ("dolp_pixels", "mean"), "std": ("dolp_pixels", "std"), "snr": ("dolp_snr", "mean")}
        for name, check in checks.items():
            quantity, statistic = places[name]
            error = check.std_error * float(np.sqrt(inflation))
            row = Row(
                region=self._name,
                quantity=quantity,
                statistic=statistic,
                predicted=check.predicted,
                measured=check.measured,
                std_error=error,
            )
            own = self._region.quantities.get(quantity, {}).get(statistic)
            yield row if own is None or error < _ONE_NUMBER_SHARE * own.std_error else scored(row, 0.0)

    def _law_rows_exist(self) -> bool:
        # Pixels that are all alike have no law.
        is_spread = bool(np.all(np.ptp(self._region.stokes_pixels, axis=1) > 0.0))
        return (not self.is_coarse and is_spread) and all(
            "dolp_pixels" in found for found in (self._region.quantities, self.prediction.quantities)
        )

    def _half_rows(self) -> Iterable[Row]:
        """Return the spread over pixels: texture and noise of one half of the pixels predict it for the other half."""
        region = self._region
        if self._noise is None or "std" not in region.quantities["s0"]:
            return
        names = self._measurement.grid.channel_names
        groups = (
            (names, region.channel_pixels, region.channel_pixels_mean, self._added_to_channels),
            (("s0", "s1", "s2"), region.stokes_pixels, region.stokes_pixels_mean, self._added),
        )
        for quantities, frame, mean, added in groups:
            for k, quantity in enumerate(quantities):
                source = deviation(mean[k, region.first_half])
                yield self._half_row(quantity, "std", source, float(added[k, k]), frame[k])
                yield self._half_row(quantity, "std_spatial_mean", source, 0.0, mean[k])

    def _half_row(self, quantity: str, statistic: str, source: Sample, added: float, pixels: FloatArray) -> Row:
        inflation = float(np.sqrt(self._region.pixels / self._region.independent_pixels))
        predicted = float(np.sqrt(source.value**2 + added))
        measured = deviation(pixels[~self._region.first_half])
        row = Row(
            region=self._name,
            quantity=quantity,
            statistic=statistic,
            predicted=predicted,
            measured=measured.value,
            std_error=measured.std_error * inflation,
        )
        return scored(row, source.value / predicted * source.std_error * inflation if predicted > 0.0 else 0.0)


def _errors(noise: TemporalNoise, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
    slopes = input_jacobian(function, noise.values, np.sqrt(np.diag(noise.cov)), least=(0.0, 0.0, 0.0))
    cov = slopes @ noise.cov @ slopes.T
    return np.asarray(np.sqrt(np.diag(cov)))
