"""Rows of a comparison: a number by the model and by the frames, their difference, and whether it is too large.

Holm's rule over all rows decides, so that alpha is the chance that a sound run is called a disagreement. The second
part is the uncertainty budget: the share of each cause in the error of a region's polarization.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments
from model.numerics import ndtri
from model.prediction import RegionPrediction, budget, noise_causes, shift_cause
from model.processing.agreement import Propagation, holm_rejections, two_sided_p_value
from model.processing.dolp_interval import chi_square, joint_score, student_score
from model.processing.mosaic import reach_px
from model.processing.reconstruction import channel_ratios, normalized_moments, stokes_moments
from model.processing.samples import Sample
from model.quantities import QUANTITIES, difference, is_counts, ratio_name
from model.sensor import ChannelMoments
from rigctl.files.regions import inner_masks, masks
from rigctl.measure.diagnose import MeasuredRun, RunDiagnosis
from rigctl.measure.measure import MeasuredRegion, Measurement
from rigctl.prediction.predict import NumberKey
from rigctl.scene.scene import ANGLE, DRIFT, OFFSET, Inputs

if TYPE_CHECKING:
    from model.prediction import Quantities
    from rigctl.measure.measure import MeasuredQuantities

FloatArray = NDArray[np.float64]

# Probability of detection that the smallest detectable difference refers to.
_POWER = 0.9
# A number is hardly tested if only a difference above this share of it is detected.
_USELESS_SHARE = 0.5
_SPATIAL, _OF_PIXELS = ("std", "std_spatial_mean"), ("dolp_pixels", "dolp_snr")
_DEVIATIONS = (*_SPATIAL, "std_temporal")
# Half of the largest difference of two AoLP.
_TURN_DEG = 45.0


@dataclass(frozen=True, kw_only=True)
class Row:
    """One number by the model and by the frames."""

    region: str  #: With quantity and statistic the name of the number, such as ("asphalt", "dn_45", "std_temporal").
    quantity: str
    statistic: str
    predicted: float  #: In the unit of the quantity.
    measured: float
    #: Of the measurement; of a deviation below its prediction, that of the prediction.
    std_error: float | None = None
    freedom: float = np.inf  #: Degrees of freedom that `std_error` rests on.
    std_error_inputs: float | None = None  #: Of the prediction, by the uncertainty of its inputs.
    z_measurement: float | None = None  #: Difference over `std_error`.
    #: Difference over both errors together, as a normal score; it decides.
    z: float | None = None
    #: By Holm's rule over all rows. None: not a test, as the prediction was made from this very number.
    agrees: bool | None = None
    #: Smallest difference that is detected with a probability of 90 % if no other row is off.
    smallest_difference_90: float | None = None

    @property
    def is_weak(self) -> bool:
        """True if only a difference above half of the number (of AoLP, of 45 deg) is detected."""
        seen = self.smallest_difference_90
        size = _TURN_DEG if self.quantity == "aolp_deg" else abs(self.predicted)
        # A number with a sign may be 0 by nature and has no size of its own.
        is_signed = self.quantity in QUANTITIES and QUANTITIES[self.quantity].is_signed
        return seen is not None and not is_signed and seen > _USELESS_SHARE * size

    @property
    def key(self) -> NumberKey:
        """Name of the number."""
        return NumberKey(self.region, self.quantity, self.statistic)


def pair(region: str, predicted: "Quantities", measured: "MeasuredQuantities") -> Iterable[Row]:
    """Return a row for each number that both sides have.

    The error of a deviation is proportional to it, and so is too small where the deviation is small by chance: four
    times as many deviations of 1600 pixels, a hundred times as many of 100, would be called too small as there should
    be. Therefore it is the error of the larger one of measured and predicted deviation.
    """
    for quantity, statistics in predicted.items():
        for statistic, value in statistics.items():
            sample = measured.get(quantity, {}).get(statistic)
            if sample is not None:
                yield Row(
                    region=region,
                    quantity=quantity,
                    statistic=statistic,
                    predicted=value,
                    measured=sample.value,
                    std_error=_error_beside(sample, value) if statistic in _DEVIATIONS else sample.std_error,
                    freedom=sample.freedom,
                )


def _error_beside(deviation: Sample, predicted: float) -> float:
    """Return the error of a measured deviation, or that of a predicted one that is larger."""
    return deviation.std_error * max(predicted / deviation.value, 1.0) if deviation.value > 0.0 else deviation.std_error


def off_prediction(row: Row, value: float) -> float:
    """Return how far a value of a row's quantity is above its prediction; of an AoLP, the shorter way round."""
    return difference(row.quantity, value, row.predicted)


def scored(row: Row, std_error_inputs: float) -> Row:
    """Return the row with its scores; without one where neither side has an error."""
    measured_error = row.std_error or 0.0
    both = float(np.hypot(measured_error, std_error_inputs))
    off = off_prediction(row, row.measured)
    return replace(
        row,
        std_error_inputs=float(std_error_inputs),
        z_measurement=off / measured_error if measured_error > 0.0 else None,
        z=student_score(off / both, row.freedom * (both / measured_error) ** 4 if measured_error > 0.0 else np.inf)
        if both > 0.0
        else None,
    )


# Below this squared signal-to-noise ratio DoLP and AoLP are not normal; the score of both is then that of (S1, S2).
_LEAST_CHI_SQUARE = 36.0
# Largest effect of whole counts on the DoLP of pixels, in its standard errors, that a test of its law allows.
_COARSE = 0.25


def with_joint_scores(
    rows: Sequence[Row], predictions: Mapping[str, RegionPrediction], measurement: Measurement, cov: FloatArray
) -> tuple[Row, ...]:
    """Return rows with other scores where polarization is weak or counts are coarse.

    DoLP and AoLP of hardly polarized light are scored as (S1, S2) together, in DoLP's row; AoLP has no score then. The
    DoLP of pixels has none where steps of whole counts show in it. `cov` is what the inputs give the rows.
    """
    found = list(rows)
    for name, prediction in predictions.items():
        if name not in measurement.regions:
            continue
        region, place = measurement.regions[name], {row.key: k for k, row in enumerate(rows) if row.region == name}
        s1, s2, degree, angle = (
            place.get(NumberKey(name, quantity, "mean")) for quantity in ("s1n", "s2n", "dolp", "aolp_deg")
        )
        if s1 is not None and s2 is not None and degree is not None:
            of_inputs = cov[np.ix_([s1, s2], [s1, s2])]
            together = normalized_moments(stokes_moments(measurement.plan, region.channels_mean)).cov + of_inputs
            predicted = np.array([rows[s1].predicted, rows[s2].predicted])
            if chi_square(predicted, together) < _LEAST_CHI_SQUARE:
                off = np.array([rows[s1].measured, rows[s2].measured]) - predicted
                found[degree] = replace(rows[degree], z=joint_score(off, together, rows[degree].freedom))
                if angle is not None:
                    found[angle] = replace(rows[angle], z=None)
        if is_coarse(prediction, region, measurement):
            for k in (k for key, k in place.items() if key.quantity in _OF_PIXELS):
                found[k] = replace(found[k], z=None)
    return tuple(found)


def is_coarse(prediction: RegionPrediction, region: MeasuredRegion, measurement: Measurement) -> bool:
    """Return whether whole counts show in the DoLP of a region's pixels.

    (S1, S2) then lie on a grid, which the law does not describe. The effect on mean and deviation of the length is
    proportional to the density of the law at 0, where the length has its corner (found by summing over grids). Where
    noise is below one count, rounding also moves the counts of single pixels.
    """
    if region.is_by_law:
        return True
    step = float(measurement.grid.to_unit.max())
    mean, cov = prediction.stokes_dn.mean[1:] / step, prediction.stokes_dn.cov[1:, 1:] / step**2
    width = float(np.linalg.det(cov)) ** 0.25
    if not width > 0.0:
        return True
    density = np.exp(-0.5 * chi_square(mean, cov)) / (2.0 * np.pi * width**2)
    return bool(density * np.sqrt(region.independent_pixels) / width > _COARSE)


def decide(rows: tuple[Row, ...], *, alpha: float) -> tuple[Row, ...]:
    """Return the rows with decisions by Holm's rule over all tests, and the smallest difference that each detects."""
    tests = [k for k, row in enumerate(rows) if row.z is not None]
    rejected = holm_rejections(two_sided_p_value([rows[k].z or 0.0 for k in tests]), alpha=alpha)
    verdicts = dict(zip(tests, rejected.tolist(), strict=True))
    # The first step of Holm's rule: a single row that is off has to pass it.
    seen = -float(ndtri(0.5 * alpha / max(len(tests), 1))) + float(ndtri(_POWER))
    return tuple(
        replace(row, agrees=not verdicts[k], smallest_difference_90=seen * error_of_both(row)) if k in verdicts else row
        for k, row in enumerate(rows)
    )


def error_of_both(row: Row) -> float:
    """Return the standard error of both sides together."""
    return float(np.hypot(row.std_error or 0.0, row.std_error_inputs or 0.0))


def with_ratios(predictions: Mapping[str, "RegionPrediction"]) -> dict[str, "RegionPrediction"]:
    """Return predictions with the ratio of each channel to the mean of all; unchanged without light."""
    return {name: _with_ratios(prediction) for name, prediction in predictions.items()}


def predictable(measured: "MeasuredQuantities", *, is_mosaic: bool, is_interpolated: bool) -> "MeasuredQuantities":
    """Return the measured numbers that a scene's prediction describes: pixels that see one point at all angles.

    In a mosaic each angle has pixels of its own. The correlation of their texture and response is not known, nor is the
    effect of interpolation on them: deviations over the pixels are then not tested.
    """
    if not is_mosaic:
        return measured
    return {
        quantity: {
            statistic: sample
            for statistic, sample in statistics.items()
            if statistic not in _SPATIAL or (is_counts(quantity) and not is_interpolated)
        }
        for quantity, statistics in measured.items()
        if quantity not in _OF_PIXELS
    }


def _with_ratios(prediction: "RegionPrediction") -> "RegionPrediction":
    mean = prediction.channels.mean_dn
    if not mean.mean() > 0.0:
        return prediction
    names = [name for name in prediction.quantities if is_counts(name)]
    ratios = channel_ratios(Moments(mean=mean, cov=np.zeros((mean.size, mean.size))))[0]
    found = {ratio_name(name): {"mean": float(ratio)} for name, ratio in zip(names, ratios, strict=True)}
    return replace(prediction, quantities=prediction.quantities | found)


# Name of the cause: all faults that the run shows, together.
FAULTS = "faults of the run"


# Standard uncertainty of a region's polarization, by quantity and cause; that of S0 as a share of it.
RegionBudget = dict[str, dict[str, float]]


def scene_budgets(
    predictions: Mapping[str, RegionPrediction],
    measurement: Measurement,
    *,
    inputs: Inputs,
    rows: tuple[Row, ...],
    propagation: Propagation,
    uncertain: Inputs,
) -> dict[str, RegionBudget]:
    """Return the budget of every measured region of a comparison with a scene."""
    budgets = {}
    for name, prediction in predictions.items():
        if name not in measurement.regions:
            continue
        region = measurement.regions[name]
        causes = noise_causes(
            prediction.channels,
            gain_dn_per_e=inputs.scene.noise.gain_dn_per_e.value,
            noise_factor=inputs.scene.noise.noise_factor.value,
            pixels=region.independent_pixels,
            cycles=measurement.grid.cycles,
        )
        causes["dark level"] = _dark_level(measurement)
        causes |= _repeats(region)
        causes |= _inputs(name, rows, propagation, uncertain, measurement.grid.channel_names)
        budgets[name] = _budget(prediction.channels, causes, measurement)
    return budgets


def run_budgets(
    predictions: Mapping[str, RegionPrediction], measurement: Measurement, *, gain_dn_per_e: float | None
) -> dict[str, RegionBudget]:
    """Return the budget of every region of a comparison with the run's own moments.

    Without a calibration noise and texture cannot be told apart and stand as one.
    """
    budgets = {}
    for name, prediction in predictions.items():
        region = measurement.regions[name]
        causes = _run_causes(prediction.channels, region, measurement, gain_dn_per_e) | _repeats(region)
        causes["dark level"] = _dark_level(measurement)
        budgets[name] = _budget(prediction.channels, causes, measurement)
    return budgets


def with_run_errors(
    budgets: Mapping[str, RegionBudget], run: MeasuredRun, predictions: Mapping[str, RegionPrediction]
) -> dict[str, RegionBudget]:
    """Return budgets with what the run shows of itself: misregistration, and the faults of its diagnosis.

    Misregistration is left out where it is not known, or where a registration was given.
    """
    measurement, registration = run.measurement, run.registration
    known = {name: parts for name, parts in budgets.items() if parts}
    shifts: dict[str, RegionBudget] = {}
    if measurement.shifts is None and not isinstance(registration, str):
        outer = masks(run.regions, width=measurement.grid.width, height=measurement.grid.height)
        inside = inner_masks(run.regions, outer, least_px=reach_px(measurement.run.session.interpolation))
        sizes = np.hypot(registration.shift_pixels, registration.std_error_pixels)
        for name in known:
            cause = shift_cause(measurement.channels, inside[name], shift_pixels=sizes)
            mean_dn = predictions[name].channels.mean_dn
            shifts[name] = budget(mean_dn, {"registration": cause}, plan=measurement.plan)
    return dict(budgets) | {
        name: {
            quantity: causes | shifts.get(name, {}).get(quantity, {}) | _faults(run.diagnosis, name, quantity)
            for quantity, causes in known[name].items()
        }
        for name in known
    }


def _faults(diagnosis: RunDiagnosis, region: str, quantity: str) -> dict[str, float]:
    """Return what the named faults of a run could do to DoLP and AoLP of a region; nothing for other quantities."""
    if not diagnosis.named or quantity not in ("dolp", "aolp_deg"):
        return {}
    shifts = [term.by_region.get(region, (None, None))[quantity == "aolp_deg"] for term in diagnosis.named]
    return {FAULTS: float(np.linalg.norm([shift or 0.0 for shift in shifts]))}


def _run_causes(
    channels: ChannelMoments, region: MeasuredRegion, measurement: Measurement, gain_dn_per_e: float | None
) -> dict[str, FloatArray]:
    if gain_dn_per_e is None or not measurement.grid.is_one_exposure:
        return {"noise and texture": region.scatter_cov}
    causes = noise_causes(
        channels,
        gain_dn_per_e=gain_dn_per_e,
        noise_factor=1.0,
        pixels=region.independent_pixels,
        cycles=measurement.grid.cycles,
    )
    pattern = causes.pop("fixed pattern")
    texture = causes.pop("texture")
    return causes | {"texture and fixed pattern": pattern + texture}


def _budget(channels: ChannelMoments, causes: Mapping[str, FloatArray], measurement: Measurement) -> RegionBudget:
    is_lit = (measurement.plan.inverse @ channels.mean_dn)[0] > 0.0
    return budget(channels.mean_dn, causes, plan=measurement.plan) if is_lit else {}


def _repeats(region: MeasuredRegion) -> dict[str, FloatArray]:
    """Return the covariance by imperfect repetition of the rig; empty without repetitions."""
    cov = region.repeatability.cov(region.channels_mean.mean)
    return {"repeatability": cov} if np.any(cov) else {}


def _dark_level(measurement: Measurement) -> FloatArray:
    level = measurement.frames.dark_level.std_error_dn * measurement.grid.to_unit
    return np.outer(level, level)


def _inputs(
    region: str, rows: tuple[Row, ...], propagation: Propagation, uncertain: Inputs, channels: tuple[str, ...]
) -> dict[str, FloatArray]:
    """Return the covariance of a region's mean counts by inputs: angle, drift of the light, and all others."""
    place = {row.key: k for k, row in enumerate(rows)}
    effects = propagation.effects[[place[NumberKey(region, channel, "mean")] for channel in channels]]
    std = np.sqrt(np.diag(uncertain.cov))
    correlation = uncertain.cov / np.outer(std, std)
    found = {}
    kinds = [_kind(name) for name in uncertain.names]
    for kind in dict.fromkeys(kinds):
        chosen = np.array([k == kind for k in kinds])
        own = effects[:, chosen]
        found[kind] = np.asarray(own @ correlation[np.ix_(chosen, chosen)] @ own.T)
    return found


def _kind(name: str) -> str:
    if name.startswith((OFFSET, ANGLE)):
        return "angle"
    if name == DRIFT:
        return "drift"
    return "inputs"
