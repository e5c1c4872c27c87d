"""Numerical settings that a comparison chooses for itself, so that its rows' own errors are far above those of them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import hypot, inf, radians

from model.accuracy.chain import Reading
from model.accuracy.effect_estimates import kind_of
from model.accuracy.plan import NUMERICAL_SETTINGS
from model.accuracy.predict import SMALLEST, AccuratePrediction, predict
from model.effects.names import Effect, EffectPlan, EffectRule
from model.effects.planner import LIGHT
from model.prediction import Quantities, RegionPrediction
from model.quantities import SHARES, angle_of, counts_name, is_counts
from rigctl.comparison.rows import Row, error_of_both
from rigctl.comparison.run_prediction import RunPredictor
from rigctl.errors import as_config_error
from rigctl.prediction.propagated_inputs import NumberKey
from rigctl.scene.effect_choice import acting_effects
from rigctl.scene.effect_plan import plan_effects
from rigctl.scene.model_scene import lit_scene, sensor_of

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
    """A prediction of a run to a tolerance, and what its errors are beside those of the rows.

    Attributes
    ----------
    tolerance : float
        Of effects that are left out and numerical settings together.
    found : AccuratePrediction
        Settings, and errors as they were estimated.
    effects : EffectPlan
        What the run calls for.
    left_out : frozenset of Effect
        Effects of the light that the plan leaves out, and that are there.
    share : float
        Largest numerical error over the standard error of its row; 0 where no row has one.
    row : NumberKey or None
        Where that is.
    """

    tolerance: float
    found: AccuratePrediction
    effects: EffectPlan
    left_out: frozenset[Effect]
    share: float = 0.0
    row: NumberKey | None = None

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
        """Return this beside the rows of a comparison that was made with its settings.

        Parameters
        ----------
        rows : iterable of Row
            With their errors.
        predictions : mapping
            Region to the prediction that they compare.
        """
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
    """Return the prediction of a run to a tolerance.

    Parameters
    ----------
    run : RunPredictor
        The run; what is solved is kept in its light.
    tolerance : float
        1e-6 to 0.1.
    rule : {"safe", "estimated", "all"}
        Which effects of the light are left out; those behind the lens cost nothing, and act.

    Raises
    ------
    ConfigError
        A number of the scene is outside its range.
    """
    scene = run.inputs.scene
    planned = plan_effects(
        scene,
        tolerance=tolerance,
        rule="safe" if rule == "all" else rule,
        light=run.light,
        readout=run.readout,
        exposure_s=run.exposure_s,
    )
    there = {one.effect for one in planned.plan.decisions if one.bound.largest > 0.0}
    acting = acting_effects(scene)
    left_out = frozenset() if rule == "all" else ((acting & LIGHT & there) - planned.plan.active)
    spent = planned.plan.spent.largest if left_out else 0.0
    with as_config_error(f"scene {scene.name}"):
        found = predict(
            lit_scene(scene, sensor=sensor_of(scene, run.exposure_s), readout=run.readout),
            tolerance=max(tolerance - spent, SMALLEST),
            effects=acting - left_out,
            estimated_only=True,
            store=run.light.lights,
        )
    return NumericalAccuracy(tolerance=tolerance, found=found, effects=planned.plan, left_out=left_out)
