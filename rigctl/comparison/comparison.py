"""Model beside measurement, row by row, with a decision over all rows."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import Settings
from model.effects.names import Effect, EffectPlan
from model.prediction import RegionPrediction
from model.processing.agreement import Propagation
from model.scene.field import FieldLight
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.calibrations.radiometric_file import RadiometricResponse
from rigctl.comparison.checks import Check
from rigctl.comparison.diagnosis import Diagnosis, diagnose
from rigctl.comparison.input_attribution import InputAttribution, attribute_residuals
from rigctl.comparison.remarks import model_warnings, not_tested, overruled
from rigctl.comparison.rows import Row, decide, measured_with_ratios, pair, predictable, scored
from rigctl.comparison.run_prediction import run_predictor
from rigctl.comparison.scale import Scale, scale_inputs
from rigctl.comparison.trends import Trend, trends_of
from rigctl.comparison.uncertainty_budget import RegionBudget, scene_budget
from rigctl.comparison.verdict import AGREES, RegionVerdict, VerdictName, region_verdicts, verdict_of
from rigctl.errors import ConfigError
from rigctl.files.choices import ScaleKind
from rigctl.files.regions import Region
from rigctl.files.scene_file import SceneFile
from rigctl.measurement.measurement import Measurement
from rigctl.measurement.picked_calibrations import PickedCalibrations
from rigctl.measurement.run_diagnosis import RunDiagnosis
from rigctl.prediction.performance import Performance, performance_of
from rigctl.prediction.propagated_inputs import curved_inputs, propagate_numbers
from rigctl.scene.scene_inputs import Inputs, only_uncertain
from rigctl.scene.scene_light import SceneLight
from rigctl.storage.bounded_file import sha256_of

if TYPE_CHECKING:
    from rigctl.comparison.numerical_accuracy import NumericalAccuracy

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
    settings: Settings | None = None,
    light: SceneLight | None = None,
    coarser: Comparison | None = None,
) -> Comparison:
    """Return what a scene file predicts for a run beside what the run shows.

    Parameters
    ----------
    measurement : Measurement
        With the regions of the scene file.
    scene : SceneFile
        What the model is told. Angles, cycles and exposure are the run's own.
    noise : NoiseParameters or None
        A noise calibration.
    alpha : float
        Family-wise error rate: chance of any false disagreement.
    scale : {"absolute", "panel", "free"}
        What the counts are scaled by: the scene file, a radiometric calibration, or the run itself.
    radiometric : RadiometricResponse or None
        A radiometric calibration, for "panel".
    settings : Settings or None
        Numerical settings in place of those of the scene file.
    light : SceneLight or None
        Keeps skies between calls.
    coarser : Comparison or None
        The same with coarser settings, from which is taken what the inputs' uncertainties make of the rows: most of
        the time goes into that, and few of its digits count.

    Raises
    ------
    ConfigError
        Scale and calibration do not go together.
    DataError
        The run cannot be predicted: exposures differ or are not known.
    """
    predictor = run_predictor(measurement, scene=scene, noise=noise)
    predictor = replace(predictor, settings=settings, light=predictor.light if light is None else light)
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
        *overruled(scene, measurement, predictor.exposure_s),
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
        not_tested=not_tested(measurement, scene, scaled_by, uncertain),
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
