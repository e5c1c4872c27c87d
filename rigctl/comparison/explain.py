"""Residuals of a comparison attributed to its inputs: the input that would explain them, and others that could as well.

Each uncertain input is moved as far as it removes the residuals best (a Bayesian update, to first order). The rows that
count are those that are not functions of one another, with the covariance of their measurement.

`unstated_effects` does the same for effects of the light that the scene file does not state.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.effects.effect import Effect
from model.prediction import RegionPrediction
from model.processing import agreement as bayesian_update
from model.processing.agreement import Propagation, chi_square_tail, deviations_cov
from rigctl.base.numbers import percent, to_digits
from rigctl.comparison.rows import Row, error_of_both, off_prediction, with_ratios
from rigctl.measure.measure import Measurement
from rigctl.prediction.predict import NumberKey
from rigctl.scene.effects import statement_of
from rigctl.scene.scene import Inputs, parameters

FloatArray = NDArray[np.float64]

_STOKES = ("s0", "s1", "s2")


# An input is left out if the data resolve less than this share of its variance.
_LEAST_SEEN = 1e-3
# Residuals after a move are acceptable above this p-value.
_ACCEPTED = 0.01
# Residuals need no explanation above this p-value, unless the score of an input is above so many standard deviations.
_UNREMARKABLE, _WORTH_A_WORD = 0.05, 3.0
# Inputs that often cause a disagreement, the most frequent first.
_OFTEN_THE_CAUSE = (
    "sensor.f_number",
    "rig.polarizer_offset_deg",
    "rig.exposure_ratio",
    "sensor.optics_transmittance",
    "sensor.quantum_efficiency",
    "sensor.extinction_ratio",
)
# With more names than this, only their number is given.
_NAMED = 4


@dataclass(frozen=True, kw_only=True)
class InputMove:
    """One input, and the effect of its move on the residuals."""

    name: str  #: as in the scene file
    value: float  #: as stated, in the units of the file
    std: float
    move_std: float  #: move that removes as much of the residuals as possible, in its standard uncertainties
    moved_value: float  #: value after the move
    score: float  #: root of the fall in chi-square by the move; standard normal if everything stated is right
    p_value_left: float  #: p-value of the remaining residuals
    removes: bool  #: whether the remaining residuals are acceptable
    seen: float  #: share of its stated variance that the data resolve, 0 to 1
    #: Inputs that could look the same: if this input is off by five standard uncertainties, they outrank it in more
    #: than 5 % of cases.
    indistinguishable_from: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class FittedInput:
    """One input after a joint update of all: fitted to this run, not measured in another way."""

    name: str
    value: float
    std: float
    moved_std: float


@dataclass(frozen=True, kw_only=True)
class InputAttribution:
    """Residuals of a comparison, attributed to inputs."""

    chi_square: float  #: of the residuals, in the errors of measurement and inputs together
    degrees_of_freedom: int
    p_value: float
    moves: tuple[InputMove, ...]  #: the input that explains most first
    fitted: tuple[FittedInput, ...]  #: all inputs updated at once, each held by its stated uncertainty
    unseen: tuple[str, ...]  #: inputs that the data do not resolve
    remark: str  #: the result in a sentence

    @property
    def best(self) -> InputMove | None:
        """The input that explains most."""
        return self.moves[0] if self.moves else None


def attribute_residuals(
    rows: Sequence[Row], *, propagation: Propagation, inputs: Inputs, measurement: Measurement
) -> InputAttribution | None:
    """Return the inputs that would explain the residuals of rows; None where no input has an uncertainty."""
    if not inputs.names:
        return None
    places, cov = _evidence(rows, measurement)
    chosen = [rows[k] for k in places]
    std = np.sqrt(np.diag(inputs.cov))
    of_prediction, of_measurement = _straightened(chosen)
    residual = np.array([off_prediction(row, row.measured) for row in chosen])
    found = bayesian_update.update_inputs(
        0.5 * (of_prediction + of_measurement) * residual,
        measurement_cov=cov * np.outer(of_measurement, of_measurement),
        effects=propagation.effects[places] * of_prediction[:, None],
        input_correlation=inputs.cov / np.outer(std, std),
    )
    moves = tuple(_move(found, inputs, std, k) for k in found.order if found.seen[k] >= _LEAST_SEEN)
    seen = {move.name for move in moves}
    exact = {parameter.key for parameter in parameters(inputs.scene) if parameter.std == 0.0}
    return InputAttribution(
        chi_square=found.chi_square,
        degrees_of_freedom=found.degrees_of_freedom,
        p_value=found.p_value,
        moves=moves,
        fitted=tuple(_fitted(found, inputs, std)),
        unseen=tuple(name for name in inputs.names if name not in seen),
        remark=_remark(moves, found.p_value, [key for key in _OFTEN_THE_CAUSE if key in exact]),
    )


def _evidence(rows: Sequence[Row], measurement: Measurement) -> tuple[NDArray[np.intp], FloatArray]:
    """Return the positions of rows that are not functions of one another, and the covariance of their measurement.

    These are mean counts of every channel, their temporal deviations, and the spatial deviations of the Stokes
    parameters. All other rows follow from these.

    Sample means and deviations of Gaussian pixels are independent. Means of one region share pixels; those of all
    regions share the error of the dark level. Temporal deviations are of frames that are independent; spatial ones of
    Stokes parameters go together as far as their pixels do.
    """
    place = {row.key: k for k, row in enumerate(rows)}
    groups = [
        (names, statistic)
        for region in measurement.regions
        for names, statistic in (
            ([(region, name) for name in measurement.grid.channel_names], "mean"),
            ([(region, name) for name in measurement.grid.channel_names], "std_temporal"),
            ([(region, name) for name in _STOKES], "std_spatial_mean"),
        )
    ]
    wanted = [NumberKey(*name, statistic) for names, statistic in groups for name in names]
    found = [key for key in wanted if key in place]
    position = {key: k for k, key in enumerate(found)}
    cov = np.diag([(rows[place[key]].std_error or 0.0) ** 2 for key in found])
    _fill_means(cov, position, measurement)
    _fill_deviations(cov, position, measurement)
    return np.array([place[key] for key in found], dtype=np.intp), cov


def _fill_means(cov: FloatArray, position: dict[NumberKey, int], measurement: Measurement) -> None:
    names = measurement.grid.channel_names
    level = measurement.frames.dark_level.std_error_dn * measurement.grid.to_unit
    at = {
        region: [position[NumberKey(region, name, "mean")] for name in names]
        for region in measurement.regions
        if NumberKey(region, names[0], "mean") in position
    }
    for one, here in at.items():
        for other, there in at.items():
            cov[np.ix_(here, there)] = (
                measurement.regions[one].channels_mean.cov if one == other else np.outer(level, level)
            )


def _fill_deviations(cov: FloatArray, position: dict[NumberKey, int], measurement: Measurement) -> None:
    for name, region in measurement.regions.items():
        keys = [NumberKey(name, quantity, "std_spatial_mean") for quantity in _STOKES]
        if any(key not in position for key in keys):
            continue
        here = [position[key] for key in keys]
        errors = np.sqrt(np.diag(cov))[here]
        # Without any spread of some parameter there is no correlation.
        if np.all(np.ptp(region.stokes_pixels_mean, axis=1) > 0.0):
            cov[np.ix_(here, here)] = deviations_cov(errors, np.corrcoef(region.stokes_pixels_mean))


def _straightened(rows: Sequence[Row]) -> tuple[FloatArray, FloatArray]:
    """Return factors on changes of rows that make the response to inputs a straight line.

    The light moves temporal variances in proportion, and deviations as its root: a deviation s counts as s^2, with the
    slope 2 s, taken at the prediction and at the measurement. Over five standard uncertainties of the light the bend of
    a deviation is far above its error.
    """
    bent = np.array([row.statistic == "std_temporal" for row in rows])
    predicted, measured = (np.array([getattr(row, side) for row in rows]) for side in ("predicted", "measured"))
    return np.where(bent, 2.0 * predicted, 1.0), np.where(bent, 2.0 * measured, 1.0)


def _move(found: bayesian_update.InputUpdate, inputs: Inputs, std: FloatArray, k: int) -> InputMove:
    left = chi_square_tail(float(found.chi_square_left[k]), found.degrees_of_freedom - 1)
    return InputMove(
        name=inputs.names[k],
        value=float(inputs.values[k]),
        std=float(std[k]),
        move_std=float(found.move[k]),
        moved_value=float(inputs.values[k] + found.move[k] * std[k]),
        score=float(found.score[k]),
        p_value_left=left,
        removes=left > _ACCEPTED,
        seen=float(found.seen[k]),
        indistinguishable_from=tuple(inputs.names[j] for j in found.confused_with(k) if found.seen[j] >= _LEAST_SEEN),
    )


def _fitted(found: bayesian_update.InputUpdate, inputs: Inputs, std: FloatArray) -> Iterable[FittedInput]:
    for k, name in enumerate(inputs.names):
        yield FittedInput(
            name=name,
            value=float(inputs.values[k] + found.joint_move[k] * std[k]),
            std=float(found.joint_std[k] * std[k]),
            moved_std=float(found.joint_move[k]),
        )


def _remark(moves: Sequence[InputMove], p_value: float, left_out: Sequence[str]) -> str:
    if not moves:
        return "no input that has a stated uncertainty acts on what was measured"
    best = moves[0]
    if p_value > _UNREMARKABLE and abs(best.score) < _WORTH_A_WORD:
        return "the residuals agree with the stated errors, so nothing has to be explained"
    if not best.removes:
        if left_out:
            return f"none of the stated inputs; not considered, because no uncertainty is given: {', '.join(left_out)}"
        return "none of the stated inputs; look at what the run shows of itself"
    text = (
        f"{best.name} would remove them by moving {best.move_std:+.1f} of its standard uncertainties, from "
        f"{best.value:.4g} to {best.moved_value:.4g}"
    )
    others = best.indistinguishable_from
    if len(others) > _NAMED:
        return f"{text}; these data hardly depend on it; {len(others)} other inputs could have the same effect"
    return f"{text}; these data cannot distinguish it from {', '.join(others)}" if others else text


@dataclass(frozen=True, kw_only=True)
class UnstatedEffect:
    """An effect that is not stated in the scene file, compared with the residuals."""

    effect: Effect
    range: str  #: its usual range, or the size that the run shows, in words
    is_shown: bool  #: whether the run shows its size
    errors: float  #: largest change of a tested number, over the standard error of that row
    removes: (
        float  #: share of the residuals' chi-square that it removes, at the size within its range that removes most
    )


# An effect that removes less of the residuals than this is not their cause.
_EXPLAINS = 0.5


def unstated_effects(
    rows: Sequence[Row],
    whole: Mapping[str, RegionPrediction],
    others: Iterable[tuple[Effect, Mapping[str, RegionPrediction]]],
    shown: Mapping[Effect, tuple[float, float]],
) -> tuple[UnstatedEffect, ...]:
    """Return the effects that are not stated with their change of the tested rows, the largest first.

    Predictions are without them and with each at both ends of its range; `shown` is the size of those that the run
    shows, and its standard error.
    """
    tested = [row for row in rows if row.agrees is not None and error_of_both(row) > 0.0]
    if not tested:
        return ()
    errors = np.array([error_of_both(row) for row in tested])
    residual = np.array([off_prediction(row, row.measured) for row in tested]) / errors

    def off(predictions: Mapping[str, RegionPrediction]) -> FloatArray:
        numbers = [predictions[row.region].quantities[row.quantity].get(row.statistic, np.nan) for row in tested]
        found = np.array([off_prediction(row, number) for row, number in zip(tested, numbers, strict=True)])
        return np.asarray(np.nan_to_num(found / errors))

    # At the upper end of each range.
    ends = {effect: off(with_ratios(predictions)) - off(with_ratios(whole)) for effect, predictions in others}
    found = [
        UnstatedEffect(
            effect=effect,
            range=_shown(*shown[effect]) if effect in shown else statement_of(effect).words,
            is_shown=effect in shown,
            errors=float(np.max(np.abs(changes))),
            removes=_removed(residual, changes, has_sign=effect is Effect.DRIFT),
        )
        for effect, changes in ends.items()
    ]
    return tuple(sorted(found, key=lambda one: -one.errors))


def _removed(residual: FloatArray, changes: FloatArray, *, has_sign: bool) -> float:
    """Return the share of a chi-square that changes remove, at the factor up to 1 that removes most."""
    length, size = float(residual @ residual), float(changes @ changes)
    if length == 0.0 or size == 0.0:
        return 0.0
    factor = float(np.clip(changes @ residual / size, -1.0 if has_sign else 0.0, 1.0))
    left = residual - factor * changes
    return max(1.0 - float(left @ left) / length, 0.0)


def _shown(value: float, error: float) -> str:
    return f"the run shows {to_digits(value, error)} +- {to_digits(error, error)}"


def unstated_lines(found: Sequence[UnstatedEffect], *, disagrees: bool) -> Iterable[str]:
    """Yield the effects that are not stated and could move a number beyond its error, or fit the residuals."""
    large = [f"{one.effect} ({one.errors:.2g} standard errors for {one.range})" for one in found if one.errors > 1.0]
    if large:
        yield f"Not stated in the scene file, but able to move a tested number: {', '.join(large)}"
    likely = sorted((one for one in found if one.removes > _EXPLAINS), key=lambda one: -one.removes)
    if disagrees and likely:
        named = ", ".join(f"{one.effect} ({percent(one.removes)} of their chi-square; {one.range})" for one in likely)
        yield f"Effects that are not stated and could explain the residuals: {named}"
