"""Rows of a comparison: a number by the model and by the frames, how far apart, and whether that is too far.

Holm's rule over all rows decides, so that alpha is the chance that a sound run is called a disagreement. Below the
rows stands the uncertainty budget: how much each cause makes of the error of a region's polarization.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.pictures import Registration
from model.moments import Moments
from model.numerics import ndtri
from model.prediction import RegionPrediction, budget, noise_causes, shift_cause
from model.processing.agreement import Propagation, holm_rejections, two_sided_p_value
from model.processing.dolp_interval import chi_square, joint_score, student_score
from model.processing.mosaic import reach_px
from model.processing.reconstruction import channel_ratios, normalized_moments, stokes_moments
from model.processing.samples import Sample
from model.quantities import difference, is_counts, ratio_name
from model.sensor import ChannelMoments
from rigctl.files.regions import Region, inner_masks, masks
from rigctl.measure.diagnose import RunDiagnosis
from rigctl.measure.measure import MeasuredRegion, Measurement
from rigctl.prediction.predict import NumberKey
from rigctl.scene.scene import ANGLE, DRIFT, OFFSET, Inputs

if TYPE_CHECKING:
    from model.prediction import Quantities
    from rigctl.measure.measure import MeasuredQuantities

FloatArray = NDArray[np.float64]

# Chance with which a disagreement is to be seen.
_POWER = 0.9
# A difference that is seen only where it is larger than this share of a number tells nothing of it.
_USELESS_SHARE = 0.5
_SPATIAL, _OF_PIXELS = ("std", "std_spatial_mean"), ("dolp_pixels", "dolp_snr")
_DEVIATIONS = (*_SPATIAL, "std_temporal")
# The farthest that an AoLP can be off is twice this; numbers that may be nothing by nature have no size of their own.
_TURN_DEG, _SIGNED = 45.0, ("s1", "s2", "s1n", "s2n")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One number by the model and by the frames."""

    region: str  #: Which number, for instance ("asphalt", "dn_45", "std_temporal").
    quantity: str
    statistic: str
    predicted: float  #: In DN, degrees or without unit, as the quantity has it.
    measured: float
    #: Of the measurement; of a deviation that came out below its prediction, as large as the prediction has it.
    std_error: float | None = None
    freedom: float = np.inf  #: Degrees of freedom that `std_error` rests on.
    std_error_inputs: float | None = None  #: Of the prediction, from the uncertainty of what it rests on.
    z_measurement: float | None = None  #: Difference over `std_error`.
    #: Difference over both errors together, as a normal score; the decision is taken from this one.
    z: float | None = None
    #: By Holm's rule over all rows. None: not a test, since the prediction was made from this very number.
    agrees: bool | None = None
    #: That would have been called a disagreement with a chance of 90 %, were this row the only one that is off.
    smallest_difference_90: float | None = None

    @property
    def is_weak(self) -> bool:
        """Whether only a difference larger than half the number (of AoLP, of 45 deg) would have been seen."""
        seen = self.smallest_difference_90
        size = _TURN_DEG if self.quantity == "aolp_deg" else abs(self.predicted)
        return seen is not None and self.quantity not in _SIGNED and seen > _USELESS_SHARE * size

    @property
    def key(self) -> NumberKey:
        """Which number it is."""
        return NumberKey(self.region, self.quantity, self.statistic)


def pair(region: str, predicted: "Quantities", measured: "MeasuredQuantities") -> Iterable[Row]:
    """Return a row for each number that both sides have.

    The error that a deviation has by its own pixels is small where it came out small by chance: taken as it is, it
    calls four times as many deviations of 1600 pixels too small as chance has it, a hundred times as many of 100. So
    it is that of the larger one, of measured and predicted.
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


# Below this signal to noise DoLP and AoLP are no normal numbers; the score of both is then that of (S1, S2).
_LEAST_CHI_SQUARE = 36.0
# What counts of whole numbers do to the DoLP of pixels, in its standard errors: more is no test of its law.
_COARSE = 0.25


def with_joint_scores(
    rows: Sequence[Row], predictions: Mapping[str, RegionPrediction], measurement: Measurement, cov: FloatArray
) -> tuple[Row, ...]:
    """Return rows that are scored as their laws are where polarization is weak, and counts are coarse.

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

    (S1, S2) then stand on a grid, of which the law knows nothing. What that does to the mean length and its deviation
    goes with the density of the law at 0, where the length has its corner: found by summing over grids. Where noise
    does not reach over a count, rounding moves the counts of single pixels besides.
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
    """Return the rows with a decision each, by Holm's rule over all that are tests, and what each could have seen."""
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
    """Return predictions with a ratio for each channel beside its counts; none where there is no light."""
    return {name: _with_ratios(prediction) for name, prediction in predictions.items()}


def predictable(measured: "MeasuredQuantities", *, is_mosaic: bool, is_interpolated: bool) -> "MeasuredQuantities":
    """Return what a scene's prediction is set beside: it knows of pixels that see one point behind all angles.

    Behind the polarizers of a mosaic each angle has pixels of its own. What their texture and response have in common
    is not known, nor what interpolation leaves of them: then deviations over the pixels are no tests.
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


# Name of the cause: what the faults that a run shows of itself could do, all of them together.
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
    budgets: Mapping[str, RegionBudget],
    measurement: Measurement,
    predictions: Mapping[str, RegionPrediction],
    *,
    regions: list[Region],
    registration: Registration | str,
    diagnosis: RunDiagnosis,
) -> dict[str, RegionBudget]:
    """Return budgets with what the run shows of itself: misregistration, and the faults of its diagnosis.

    Misregistration is left out where it is not known, or where a registration was given.
    """
    known = {name: parts for name, parts in budgets.items() if parts}
    shifts: dict[str, RegionBudget] = {}
    if measurement.shifts is None and not isinstance(registration, str):
        outer = masks(regions, width=measurement.grid.width, height=measurement.grid.height)
        inside = inner_masks(regions, outer, least_px=reach_px(measurement.run.session.interpolation))
        sizes = np.hypot(registration.shift_pixels, registration.std_error_pixels)
        for name in known:
            cause = shift_cause(measurement.channels, inside[name], shift_pixels=sizes)
            mean_dn = predictions[name].channels.mean_dn
            shifts[name] = budget(mean_dn, {"registration": cause}, plan=measurement.plan)
    return dict(budgets) | {
        name: {
            quantity: causes | shifts.get(name, {}).get(quantity, {}) | _faults(diagnosis, name, quantity)
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
    """Return the cause of what the rig does not repeat; none where nothing was repeated."""
    cov = region.repeatability.cov(region.channels_mean.mean)
    return {"repeatability": cov} if np.any(cov) else {}


def _dark_level(measurement: Measurement) -> FloatArray:
    level = measurement.dark_level.std_error_dn * measurement.grid.to_unit
    return np.outer(level, level)


def _inputs(
    region: str, rows: tuple[Row, ...], propagation: Propagation, uncertain: Inputs, channels: tuple[str, ...]
) -> dict[str, FloatArray]:
    """Return what the inputs do to the mean counts of a region: angle, drift of the light, and all others."""
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
