"""Numerical settings that a comparison chooses for itself, so that its rows' own errors are far above those of them.

Model beside measurement, row by row, with a decision over all rows.

Model beside measurement without a scene: a run's own means and texture through noise model and DoLP law.

Many runs of one rig, such as an afternoon: both sides against time and sun, residuals, drift, trend.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property
from math import hypot, inf, radians
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import Reading
from model.accuracy.effect_check import kind_of
from model.accuracy.plan import NUMERICAL_SETTINGS
from model.accuracy.predict import SMALLEST, Predicted, predict
from model.effects.names import LIGHT, Effect, EffectPlan, EffectRule
from model.prediction import Quantities, RegionPrediction, predict_region
from model.processing.agreement import DriftLine, Propagation, drift_line, propagate_inputs
from model.processing.samples import Sample, check_dolp_distribution, deviation
from model.quantities import CIRCULAR, FOLLOWED, SHARES, angle_of, counts_name, is_counts
from model.scene.field import FieldLight
from model.sensor import ChannelMoments
from rigctl.base.durable import sha256_of
from rigctl.calibrations.noise import NoiseParameters
from rigctl.calibrations.radiometric import RadiometricResponse
from rigctl.comparison.checks import (
    AGREES,
    Check,
    Diagnosis,
    RegionVerdict,
    Trend,
    VerdictName,
    diagnose,
    region_verdicts,
    trend,
    trends_of,
    verdict_of,
)
from rigctl.comparison.explain import InputAttribution, attribute_residuals
from rigctl.comparison.predict_run import RunPredictor, run_predictor
from rigctl.comparison.remarks import model_warnings, not_tested, overruled
from rigctl.comparison.rows import (
    RegionBudget,
    Row,
    decide,
    error_of_both,
    measured_with_ratios,
    off_prediction,
    pair,
    predictable,
    run_budget,
    scene_budget,
    scored,
    with_ratios,
)
from rigctl.comparison.scale import Scale, scale_inputs
from rigctl.errors import ConfigError, DataError, as_config_error
from rigctl.files.choices import ScaleKind
from rigctl.files.regions import Region
from rigctl.files.scene_file import SceneFile
from rigctl.measure.calibrations import PickedCalibrations
from rigctl.measure.diagnose import RunDiagnosis
from rigctl.measure.measure import MeasuredRegion, Measurement, TemporalNoise, temporal_noise, temporal_variance
from rigctl.prediction.predict import NumberKey, Performance, curved_inputs, performance_of, propagate_numbers
from rigctl.runs.folder import Run
from rigctl.scene.effects import plan_effects
from rigctl.scene.light import lit_scene, sensor_of
from rigctl.scene.reading import acting_effects
from rigctl.scene.scene import Inputs, only_uncertain

# Of any row's standard error: in quadrature that is 5 % more.
ALLOWED_SHARE = 0.3
# Where a comparison begins; most need no more.
FIRST_TOLERANCE = 0.01
# A next tolerance aims at this share of what is allowed, and is at least twice as small.
_AIM, _LEAST_STEP = 0.7, 0.5
_RATIO = "ratio_"
# Share of an error of S0 that a ratio of counts keeps, where sensors are not linear; they are known to percents.
_NOT_LINEAR = 0.03
# Settings that take longer, as the planner counts, are not tried: predictions of such a scene take minutes.
_LONGEST_S = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class NumericalAccuracy:
    """A prediction of a run to a tolerance, and what its errors are beside those of the rows."""

    tolerance: float  #: Of effects that are left out and numerical settings together.
    found: Predicted  #: Settings, and errors as they were estimated.
    effects: EffectPlan  #: What the run calls for.
    left_out: frozenset[Effect]  #: Effects of the light that the plan leaves out, and that are there.
    share: float = 0.0  #: Largest numerical error over the standard error of its row; 0 where no row has one.
    row: NumberKey | None = None  #: Where that is.

    @property
    def is_kept(self) -> bool:
        """Whether every row's numerical error is below the allowed share of its standard error."""
        return self.share <= ALLOWED_SHARE

    @property
    def next_tolerance(self) -> float | None:
        """What to try next; None where this does, nothing smaller would, or it would take minutes."""
        if self.is_kept or self.tolerance <= SMALLEST or self.share == inf or self.is_dear:
            return None
        return max(self.tolerance * min(_LEAST_STEP, _AIM * ALLOWED_SHARE / self.share), SMALLEST)

    @property
    def is_dear(self) -> bool:
        """Whether finer settings would take minutes."""
        return self.found.expected_s > _LONGEST_S

    @property
    def settings(self) -> dict[str, str]:
        """Each numerical setting with its level, in words."""
        return {name: knob.levels[self.found.plan[name]].label for name, knob in NUMERICAL_SETTINGS.items()}

    @property
    def remark(self) -> str:
        """All that in one line."""
        where = "" if self.row is None else f" ({self.row.region} {self.row.quantity} {self.row.statistic})"
        kind = "estimated, for spheres not promised, " if self.found.estimated_only else ""
        text = (
            f"numerical tolerance {self.tolerance:.1e}, chosen for the errors of this comparison: the largest "
            f"numerical error is {kind}{self.share:.2g} of its row's standard error{where}"
        )
        if self.is_kept:
            return text
        why = "finer settings take minutes" if self.is_dear else "no tolerance that was tried gave it"
        return f"{text}; wanted were {ALLOWED_SHARE:g}, but {why}"

    def beside(self, rows: Iterable[Row], predictions: Mapping[str, RegionPrediction]) -> "NumericalAccuracy":
        """Return this beside the rows of a comparison that was made with its settings."""
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
        found = self._in_tolerance(region, quantity, statistic)
        if statistic == "mean" and quantity in SHARES:
            return found
        scale = (
            numbers["s0"]["mean"] if statistic == "mean" and quantity in ("s1", "s2") else numbers[quantity][statistic]
        )
        return found * abs(scale)

    def _error_of_ratio(self, region: str, quantity: str, numbers: Quantities) -> float:
        """Of counts over their mean: an error of S0 cancels but for what is not linear, one of (s1, s2) does not."""
        ratio, counts = abs(numbers[quantity]["mean"]), [name for name in numbers if is_counts(name)]
        own = self._in_tolerance(region, counts_name(angle_of(quantity.removeprefix(_RATIO))), "mean")
        of_counts = ratio * (own + max(self._in_tolerance(region, name, "mean") for name in counts))
        turned = hypot(*(self._in_tolerance(region, name, "mean") for name in ("s1n", "s2n")))
        # The mean of the channels over that of unpolarised light: they are (S0 + S1 cos + S2 sin) / 2.
        level = 2.0 * sum(numbers[name]["mean"] for name in counts) / len(counts) / numbers["s0"]["mean"]
        return min(of_counts, turned * (1.0 + ratio) / level + _NOT_LINEAR * of_counts)

    def _error_of_angle(self, region: str, statistic: str, dolp: float, number: float) -> float:
        """Of the mean: half the angle by which (s1, s2) may turn; of a deviation: as of theirs, and of DoLP."""
        turned = hypot(*(self._in_tolerance(region, name, "mean") for name in ("s1n", "s2n")))
        if statistic == "mean":
            return 0.5 * turned / dolp / radians(1.0) if dolp > 0.0 else inf
        of_deviations = max(self._in_tolerance(region, name, statistic) for name in ("s1n", "s2n"))
        return abs(number) * (of_deviations + (turned / dolp if dolp > 0.0 else inf))

    def _in_tolerance(self, region: str, quantity: str, statistic: str) -> float:
        """Numerical error and what left out effects may change, in the units of a tolerance."""
        key = Reading(region, quantity, statistic)
        spent = float(getattr(self.effects.spent, kind_of(key))) if self.left_out else 0.0
        return self.found.budget.total.get(key, inf) + spent


def accuracy_at(run: RunPredictor, tolerance: float, rule: EffectRule) -> NumericalAccuracy:
    """Return the prediction of a run to a tolerance."""
    scene = run.inputs.scene
    planned = plan_effects(
        scene,
        tolerance=tolerance,
        readout=run.readout,
        exposure_s=run.exposure_s,
    )
    there = {one.effect for one in planned.plan.decisions if one.bound.largest > 0.0}
    acting = acting_effects(scene)
    left_out = frozenset() if rule == "all" else ((acting & LIGHT & there) - planned.plan.active)
    spent = planned.plan.spent.largest if left_out else 0.0
    with as_config_error(f"scene {scene.name}"):
        (found,) = predict(
            [lit_scene(scene, sensor=sensor_of(scene, run.exposure_s), readout=run.readout)],
            tolerance=max(tolerance - spent, SMALLEST),
            effects=acting - left_out,
            estimated_only=True,
            store=run.light.lights,
        ).cases
    return NumericalAccuracy(tolerance=tolerance, found=found, effects=planned.plan, left_out=left_out)


FloatArray = NDArray[np.float64]

# So many numbers of a region that are hardly tested are said at the head of a report; all stand in its tables.
_MOST_SAID = 4


@dataclass(frozen=True, kw_only=True)
class UsedFile:
    """A file that a result rests on."""

    path: Path
    sha256: str


def used_file(path: Path) -> UsedFile:
    """Return a file with its hash."""
    return UsedFile(path=path, sha256=sha256_of(path))


@dataclass(frozen=True, kw_only=True)
class EffectsTaken:
    """Effects of the model: the decisions at the tolerance that a report shows, and those that a comparison took."""

    plan: EffectPlan
    taken: frozenset[Effect]


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Measurement of a run and what the model predicts for it, number by number, with a verdict."""

    #: "scene": predicted from a scene file. "closed loop": predicted from the run's own means and texture.
    kind: Literal["scene", "closed loop"]
    measurement: Measurement
    alpha: float  #: family-wise error rate: chance that any row is called a disagreement where all agree
    rows: tuple[Row, ...]
    diagnosis: Diagnosis  #: where the disagreements point
    predictions: dict[str, RegionPrediction]  #: by region
    remarks: tuple[str, ...]  #: what was assumed, overruled or left out
    not_tested: tuple[str, ...]  #: what this comparison says nothing about
    scale: Scale | None = None  #: what the counts of the prediction were scaled by; None without a scene
    inputs: Inputs | None = None  #: the inputs that have an uncertainty; None without a scene
    propagation: Propagation | None = None  #: what their uncertainty does to the rows
    #: What would explain the residuals; None where no input has an uncertainty.
    attribution: InputAttribution | None = None
    trends: tuple[Trend, ...] = ()  #: whether the order of numbers is as predicted; empty without a scene
    budgets: tuple[RegionBudget, ...] = ()  #: of the uncertainty of each region's polarization, by cause
    checks: tuple[Check, ...] = ()  #: whether the run is sound, before any model
    unjudged: dict[str, str] = field(default_factory=dict)  #: region that cannot be judged to the reason
    run_diagnosis: RunDiagnosis | None = None  #: faults that the redundancy of the run's angles shows
    lights: dict[str, FieldLight] = field(default_factory=dict)  #: of the regions that are given by a material
    outlines: tuple[Region, ...] = ()  #: regions as they were drawn
    noise: NoiseParameters | None = None  #: the noise calibration
    picked: PickedCalibrations | None = None  #: which calibrations were picked from the store
    effects: EffectsTaken | None = None  #: None without a scene
    accuracy: "NumericalAccuracy | None" = None  #: the numerical settings that were chosen; None without a scene
    files: dict[str, UsedFile] = field(
        default_factory=dict
    )  #: "scene", "noise", "manifest", ...: what it was made from

    @cached_property
    def performance(self) -> Performance:
        """What the predictions are worth for detection."""
        return performance_of(self.predictions)

    @property
    def verdict(self) -> VerdictName:
        """The verdict of all of it."""
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
        """What this comparison could hardly have seen, in words, region by region."""
        by_region: dict[str, list[Row]] = {}
        for row in self.rows:
            if row.agrees is not None and row.is_weak:
                by_region.setdefault(row.region, []).append(row)
        return tuple(f"{region}: {_weakly_tested(rows)}" for region, rows in by_region.items())

    @property
    def disagreements(self) -> tuple[Row, ...]:
        """The rows that disagree."""
        return tuple(row for row in self.rows if row.agrees is False)


def _weakly_tested(rows: Sequence[Row]) -> str:
    said = "; ".join(
        f"{row.quantity} {row.statistic} only if off by more than {row.smallest_difference_90:.2g}, of "
        f"{abs(row.predicted):.2g}"
        for row in rows[:_MOST_SAID]
    )
    more = "" if len(rows) <= _MOST_SAID else f"; and {len(rows) - _MOST_SAID} more"
    return f"a difference would have been seen (with a chance of 90 %) in {said}{more}"


def compare_with_scene(
    measurement: Measurement,
    *,
    scene: SceneFile,
    noise: NoiseParameters | None,
    alpha: float,
    scale: ScaleKind = "absolute",
    radiometric: RadiometricResponse | None = None,
) -> Comparison:
    """Compare a run with what a scene file predicts for it, with the numerical settings of the file."""
    predictor = run_predictor(measurement, scene=scene, noise=noise)
    return compare_with_prediction(measurement, predictor, alpha=alpha, scale=scale, radiometric=radiometric)


def compare_with_prediction(
    measurement: Measurement,
    predictor: RunPredictor,
    *,
    alpha: float,
    scale: ScaleKind = "absolute",
    radiometric: RadiometricResponse | None = None,
    coarser: Comparison | None = None,
) -> Comparison:
    """Compare a run with its prediction; errors of the inputs are those of a coarser comparison of the same rows."""
    predicted = predictor.predictions
    inputs, scaled_by = scale_inputs(
        scale, predictor.inputs, measurement=measurement, radiometric=radiometric, predicted=predicted
    )
    predictions = predicted(inputs.values)
    rows = tuple(_paired(predictions, measurement))
    uncertain = only_uncertain(inputs)
    propagation = _known_propagation(coarser, rows)
    if propagation is None:
        propagation = propagate_numbers({row.key: row.predicted for row in rows}, inputs, predicted)
    decided = _decided(rows, propagation, alpha)
    assumed = (
        *inputs.remarks,
        scaled_by.remark,
        *overruled(inputs.scene, measurement, predictor.exposure_s),
        *predictor.moved,
        *predictor.light.remarks(inputs.scene),
    )
    return Comparison(
        kind="scene",
        measurement=measurement,
        alpha=alpha,
        rows=decided,
        diagnosis=diagnose(decided),
        predictions=predictions,
        remarks=(*assumed, *model_warnings(predictions), *curved_inputs(propagation, uncertain)),
        not_tested=not_tested(measurement, inputs.scene, scaled_by, uncertain),
        scale=scaled_by,
        inputs=uncertain,
        propagation=propagation,
        attribution=attribute_residuals(decided, propagation=propagation, inputs=uncertain, measurement=measurement),
        trends=trends_of(decided, propagation.cov, measurement),
        budgets=scene_budget(
            predictions, measurement, inputs=inputs, rows=decided, propagation=propagation, uncertain=uncertain
        ),
        lights=predictor.lights(inputs.scene),
    )


def _known_propagation(coarser: Comparison | None, rows: tuple[Row, ...]) -> Propagation | None:
    """Return that of a coarser comparison, where it has the same rows."""
    if coarser is None or [row.key for row in coarser.rows] != [row.key for row in rows]:
        return None
    return coarser.propagation


def _decided(rows: tuple[Row, ...], propagation: Propagation, alpha: float) -> tuple[Row, ...]:
    errors = np.sqrt(np.maximum(np.diag(propagation.cov), 0.0))
    return decide(tuple(scored(row, error) for row, error in zip(rows, errors, strict=True)), alpha=alpha)


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


NOT_TESTED = (
    "means, and where one half of the pixels does not predict the other, deviations: rows without a verdict",
    "the scene: no radiance was predicted",
)

# Both sides come from the same pixels: where their difference is known so much better than either, they are one number.
_BESIDE_ITSELF = 0.1
_ONE_NUMBER = "so far above the noise that the law gives back what it was made from: a number would stand beside itself"


def compare_closed_loop(measurement: Measurement, *, noise: NoiseParameters | None, alpha: float) -> Comparison:
    """Return what each region's own channel means and texture predict beside what its pixels show."""
    calibrated = None if noise is None else temporal_noise(noise)
    rows: list[Row] = []
    remarks: list[str] = [] if calibrated is None else list(calibrated.remarks)
    predictions: dict[str, RegionPrediction] = {}
    unjudged: dict[str, str] = {}
    same: dict[str, list[str]] = {}
    for name, region in measurement.regions.items():
        try:
            loop = _RegionLoop(name, region, measurement, calibrated)
            own, said = loop.rows(), loop.remarks()
        except (ValueError, ArithmeticError) as error:
            unjudged[name] = f"its numbers cannot be predicted: {error}"
            continue
        predictions[name] = loop.prediction
        rows += own
        remarks += said
        same.setdefault(loop.beside_themselves(), []).append(name)
    decided, light = decide(tuple(rows), alpha=alpha), measurement.run.session.simulated_light
    return Comparison(
        kind="closed loop",
        measurement=measurement,
        alpha=alpha,
        rows=decided,
        diagnosis=diagnose(decided, is_of_law=True),
        predictions=predictions,
        unjudged=unjudged,
        budgets=run_budget(
            predictions, measurement, gain_dn_per_e=None if calibrated is None else float(calibrated.values[0])
        ),
        remarks=tuple(remarks),
        not_tested=(
            *NOT_TESTED,
            *(f"{', '.join(regions)}: {numbers}: {_ONE_NUMBER}" for numbers, regions in same.items() if numbers),
            *(("temporal noise: no noise calibration was given",) if calibrated is None else ()),
            *(() if light is None else light.caution),
        ),
    )


class _RegionLoop:
    """One region's own moments, and what follows from them."""

    def __init__(
        self, name: str, region: MeasuredRegion, measurement: Measurement, noise: TemporalNoise | None
    ) -> None:
        self._name, self._region, self._measurement, self._noise = name, region, measurement, noise
        self._cycles = measurement.grid.cycles
        if noise is None:
            # Nothing says what is noise and what is texture: the spread of one cycle holds both.
            temporal, self._texture = np.zeros_like(region.channels_mean.mean), np.cov(region.channel_pixels)
            self._texture_pixels = region.stokes_pixels
        else:
            temporal = self._temporal(noise.values)
            self._texture = np.cov(region.channel_pixels_mean) - np.diag(temporal) / self._cycles
            self._texture_pixels = region.stokes_pixels_mean
        # What the noise of one cycle adds to the spread of the mean of all.
        self._added_to_channels = np.diag(temporal) * (1.0 - 1.0 / self._cycles)
        self._added = self._stokes_cov(self._added_to_channels)
        self.prediction = with_ratios({name: self._predicted(temporal)})[name]

    def rows(self) -> list[Row]:
        """Return the region's rows: tests with scores, the rest without."""
        paired = list(pair(self._name, self.prediction.quantities, measured_with_ratios(self._region)))
        tests = [*self._temporal_rows(paired), *self._half_rows(), *self._law_rows]
        tested = {(row.quantity, row.statistic) for row in tests}
        fitted = [row for row in paired if (row.quantity, row.statistic) not in tested]
        return [*tests, *(replace(row, std_error_inputs=None) for row in fitted)]

    def remarks(self) -> list[str]:
        """Return why a region has no test of its DoLP, if so."""
        if "dolp_pixels" not in self._region.quantities:
            return [f"{self._name}: some pixels have no light, so their DoLP was not compared"]
        return [f"{self._name}: {warning}" for warning in self.prediction.warnings]

    def beside_themselves(self) -> str:
        """Return which numbers of the law stand beside themselves; empty where none does."""
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
            yield row if own is None or error < _BESIDE_ITSELF * own.std_error else scored(row, 0.0)

    def _law_rows_exist(self) -> bool:
        # Pixels that are all alike have no law.
        is_spread = bool(np.all(np.ptp(self._region.stokes_pixels, axis=1) > 0.0))
        return is_spread and all(
            "dolp_pixels" in found for found in (self._region.quantities, self.prediction.quantities)
        )

    def _half_rows(self) -> Iterable[Row]:
        """Return the spread over pixels: texture and noise of one half of the pixels predict it for the other half."""
        if self._noise is None:
            return
        region, names = self._region, self._measurement.grid.channel_names
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
    cov = propagate_inputs(function, noise.values, noise.cov, least=(0.0, 0.0, 0.0))
    return np.asarray(np.sqrt(np.diag(cov)))


_S_PER_H = 3600.0
_LEAST_RUNS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class SeriesPoint:
    """One run of a series."""

    name: str  #: of the run folder
    comparison: Comparison
    start: datetime | None  #: of its first frame
    sun_zenith_deg: float | None  #: as the prediction took it


@dataclass(frozen=True, kw_only=True)
class SeriesDrift:
    """Drift of the residual of a quantity of a region."""

    region: str
    quantity: str
    line: DriftLine

    @property
    def z(self) -> float:
        """Slope over its standard error."""
        return self.line.slope / self.line.std_error


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedSeries:
    """Many runs of one rig and their predictions from one scene."""

    points: tuple[SeriesPoint, ...]
    drifts: tuple[SeriesDrift, ...]
    trends: tuple[Trend, ...]
    alpha: float  #: family-wise error rate: chance of any false disagreement over all runs
    scene: UsedFile  #: the scene file of all

    @property
    def agrees(self) -> bool | None:
        """Whether every run agrees; None where none disagrees and one cannot be judged."""
        found = [point.comparison.agrees for point in self.points]
        if False in found:
            return False
        return None if None in found else True


def require_one_instrument(runs: Sequence[Run]) -> None:
    """Refuse runs that are not of one camera as it was set, one stage, and one axis of the polarizer."""
    first = _instrument(runs[0])
    strangers = []
    for run in runs[1:]:
        own = _instrument(run)
        wrong = [f"{what} {own[what]}, not {first[what]}" for what in first if own[what] != first[what]]
        if wrong:
            strangers.append(f"{run.path}: {', '.join(wrong)}")
    if strangers:
        raise DataError(f"these runs do not belong with {runs[0].path}: " + "; ".join(strangers))


def hours_of(points: Sequence[SeriesPoint]) -> list[float] | None:
    """Return the time of each run from the first [h]; None where a run does not say when it was."""
    starts = [point.start for point in points if point.start is not None]
    if len(starts) != len(points):
        return None
    return [(start - min(starts)).total_seconds() / _S_PER_H for start in starts]


def mean_row(point: SeriesPoint, region: str, quantity: str) -> Row | None:
    """Return the row of the mean of a quantity, if there is one."""
    wanted = NumberKey(region, quantity, "mean")
    return next((row for row in point.comparison.rows if row.key == wanted), None)


def drifts_of(points: Sequence[SeriesPoint]) -> tuple[SeriesDrift, ...]:
    """Return how residuals drift with time, per hour; nothing with fewer than three runs or without their times.

    Errors are those of the measurement: those of the inputs are common to all runs, and move all residuals alike.
    """
    hours = hours_of(points)
    if hours is None or len(points) < _LEAST_RUNS or np.ptp(hours) == 0.0:
        return ()
    found = []
    for region, quantity, rows in _complete(points):
        residuals = [off_prediction(row, row.measured) for row in rows]
        errors = [row.std_error or 0.0 for row in rows]
        if min(errors) > 0.0:
            found.append(SeriesDrift(region=region, quantity=quantity, line=drift_line(hours, residuals, errors)))
    return tuple(found)


def trends_over_runs(points: Sequence[SeriesPoint]) -> tuple[Trend, ...]:
    """Return whether the order of runs is as predicted, for each region and quantity that has an order."""
    if len(points) < _LEAST_RUNS:
        return ()
    return tuple(
        trend(
            rows,
            over=f"runs of {region}",
            predicted_cov=_joint_cov(points, rows),
            measured_cov=np.diag([(row.std_error or 0.0) ** 2 for row in rows]),
        )
        for region, quantity, rows in _complete(points)
        if quantity not in CIRCULAR
    )


def _complete(points: Sequence[SeriesPoint]) -> Iterable[tuple[str, str, list[Row]]]:
    """Return the quantities that every run has."""
    for region in points[0].comparison.measurement.regions:
        for quantity in FOLLOWED:
            rows = [mean_row(point, region, quantity) for point in points]
            known = [row for row in rows if row is not None]
            if len(known) == len(points):
                yield region, quantity, known


def _joint_cov(points: Sequence[SeriesPoint], rows: Sequence[Row]) -> NDArray[np.float64]:
    """Return the covariance of one prediction over the runs: the same inputs are off in all of them."""
    names = list(dict.fromkeys(n for p in points if p.comparison.inputs is not None for n in p.comparison.inputs.names))
    effects = np.zeros((len(points), len(names)))
    for k, (point, row) in enumerate(zip(points, rows, strict=True)):
        inputs, propagation = point.comparison.inputs, point.comparison.propagation
        if inputs is None or propagation is None:
            continue
        place = point.comparison.rows.index(row)
        for name, effect in zip(inputs.names, propagation.effects[place], strict=True):
            effects[k, names.index(name)] = effect
    return np.asarray(effects @ effects.T)


def _instrument(run: Run) -> dict[str, str]:
    """Return what runs of one series have in common, as it is said where they have not."""
    scene = next((record for record in run.frames if record.kind == "scene"), None)
    if scene is None:
        raise DataError(f"{run.path}: holds no scene frames")
    polarizer = run.session.polarizer
    return {
        "camera": repr((scene.camera_model, scene.camera_serial)),
        "gain [dB]": repr(scene.gain_db),
        "bit depth": repr(scene.bit_depth),
        "picture": repr((scene.width, scene.height)),
        "stage": repr((scene.stage_model, scene.stage_serial)),
        "polarizer sense": repr(polarizer.sense),
        "polarizer offset [deg]": repr(polarizer.offset_deg),
        "extinction ratio": repr(polarizer.extinction_ratio),
    }
