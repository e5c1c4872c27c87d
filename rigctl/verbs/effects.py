"""`rigctl effects`: which effects of the model a scene calls for, and what each effect of a simulated camera costs."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console.failures import EXIT_OWN_FAULT
from rigctl.console.json_text import Json
from rigctl.console.terminal import note, solving_shown, warn
from rigctl.errors import ConfigError
from rigctl.verbs.options import EffectOptions, FilePath, Writes
from rigctl.verbs.result import Part, Result

if TYPE_CHECKING:
    from model.accuracy.effect_check import CheckedEffect
    from model.effects.names import Decision, EffectPlan
    from rigctl.report.table import Table
    from rigctl.rig.simulation import RenderingCost, RenderingCosts
    from rigctl.scene.effects import Verification

    Row = tuple[Decision, CheckedEffect | None]

# Numbers that an effect changes: field of `model.effects.names.Bound`, and its name in the table.
_KINDS = {"radiance": "counts", "ratios": "DoLP, s1, s2", "deviations": "noise, SNR", "detection": "P_D"}
_LEAST_SHOWN = 1e-10


def effects(
    file: FilePath,
    /,
    *,
    tolerance: Annotated[float, Parameter(validator=Number(gte=1e-9, lte=1.0))] = 0.01,
    verify: bool = False,
    noise: FilePath | None = None,
    wide: bool = False,
    out: Annotated[FilePath | None, Writes(kind="folder", names=("effects.png", "effects.json"))] = None,
    **options: Unpack[EffectOptions],
) -> "EffectsResult | RenderingResult":
    """List the effects of the model, largest first: which act in a scene, which are left out, and why.

    An effect is left out while the sum of the bounds of all that are left out stays within half of the tolerance. A
    bound is the most that leaving the effect out can change: counts and radiance (relative), DoLP, S1/S0 and S2/S0
    (absolute), standard deviations and SNR (relative), probabilities of detection (absolute).

    Of a rig file with [simulation]: the effects that the simulated camera's pictures go through, and the time of each.

    Example: rigctl effects examples/scene-panels.toml --tolerance 0.02 --verify

    Example: rigctl effects examples/rig-effects.toml

    Parameters
    ----------
    file : path
        Scene file, or rig file.
    tolerance : float
        Of a prediction; effects may take half of it.
    verify : bool
        Evaluate the chain with and without each effect: its true change, and its time. A bound that does not hold is a
        fault of the program (exit code 70).
    noise : path
        Noise calibration in place of the assumed noise.
    wide : bool
        Show the bound of every kind of number, its place in the chain and its cost.
    out : path
        Folder for effects.png, a chart of the bounds against the tolerance, and effects.json.
    **options
        Which effects are forced, see `EffectOptions`.

    Returns
    -------
    EffectsResult or RenderingResult
        Decisions on the effects of a scene; times of the effects of a simulated camera.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, a number is outside its range, or there is no such effect.
    """
    from rigctl.files.toml import has_any_key

    if has_any_key(Path(file), "stage", "camera", "simulation"):
        return _rendering(Path(file))
    from rigctl.calibrations.noise import read_noise_file
    from rigctl.files.scene_file import load_scene
    from rigctl.scene.effects import plan_effects, verify_effects
    from rigctl.scene.reading import scene_of_file, with_choices

    chosen = with_choices(
        load_scene(Path(file)),
        switched_on=tuple(options.get("switched_on", ())),
        left_out=tuple(options.get("left_out", ())),
    )
    record = scene_of_file(chosen, None if noise is None else read_noise_file(Path(noise)))
    with solving_shown() as tell:
        planned = plan_effects(record, tolerance=tolerance, rule=options.get("effects") or "safe")
        checked = verify_effects(planned, tell=tell) if verify else None
    found = EffectsResult(plan=planned.plan, checked=checked, remarks=planned.remarks, is_wide=wide)
    if checked is not None and checked.violations:
        names = ", ".join(one.effect.value for one in checked.violations)
        warn(f"a bound does not hold: {names}. This is a fault of the program: please report the scene")
    if out is not None:
        note(f"{' and '.join(found.write(Path(out)))} in {out}")
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectsResult(Result):
    """Decisions on all effects of the model for a scene."""

    plan: "EffectPlan"
    checked: "Verification | None"  #: true changes, where they were evaluated
    remarks: tuple[str, ...]  #: what is assumed
    is_wide: bool = False  #: whether the bounds of every kind are shown

    @property
    def exit_code(self) -> int:
        """70 where a bound does not hold."""
        return EXIT_OWN_FAULT if self.checked is not None and self.checked.violations else 0

    def content(self) -> Iterable[Part]:
        """Return how many effects act and what the others change, the table, and what verification found."""
        yield self._answer()
        yield from self._wide_tables() if self.is_wide else [self._table()]
        yield from self.remarks
        if self.checked is not None:
            yield self._verified(self.checked)
        yield self._chart

    def _answer(self) -> str:
        decisions, spent = self.plan.decisions, self.plan.spent
        count, acting = len(decisions), sum(one.acts for one in decisions)
        asked = sum(one.forced and not one.acts for one in decisions)
        others = count - acting - asked
        first = f"{acting} of {count} effects act"
        by_request = f"; {asked} left out by request" if asked else ""
        if not others:
            return f"{first}{by_request}."
        if spent.largest == 0.0:
            return f"{first}{by_request}; the other {others} change nothing."
        most = f"DoLP by at most {_size(spent.ratios)}"
        if spent.largest > spent.ratios:
            most += f" and no number by more than {_size(spent.largest)}"
        return f"{first}{by_request}; the other {others} together change {most} (allowed: {self.plan.tolerance:.2g})."

    def _rows(self) -> "tuple[Row, ...]":
        found = {} if self.checked is None else {one.effect: one for one in self.checked.checked}
        rows = [(one, found.get(one.effect)) for one in self.plan.decisions]
        return tuple(sorted(rows, key=lambda row: (not row[0].acts, -row[0].bound.largest, -_actual(row[1]))))

    def _table(self) -> "Table[Row]":
        from rigctl.report.table import Column, Table

        columns: list[Column[Row]] = [
            Column(title="effect", text=lambda row: row[0].effect.value, left=True),
            Column(title="decision", text=_decision, left=True),
            Column(title="at most", text=_at_most),
            Column(title="of", text=lambda row: _largest_kind(row[0]), left=True),
            Column(title="reason", text=self._reason, left=True),
        ]
        if self.checked is not None:
            columns.insert(3, Column(title="truly", text=lambda row: _true(row[1])))
        return Table(columns=tuple(columns), rows=self._rows())

    def _wide_tables(self) -> "Iterable[Table[Row]]":
        from model.effects.planner import EFFECTS
        from rigctl.report.table import Column, Table

        columns: list[Column[Row]] = [
            Column(title="effect", text=lambda row: row[0].effect.value, left=True),
            Column(title="decision", text=_decision, left=True),
            *(Column(title=title, text=partial(_bound, kind=kind)) for kind, title in _KINDS.items()),
        ]
        if self.checked is not None:
            columns += [Column(title="truly", text=lambda row: _true(row[1])), Column(title="time", text=_time)]
        yield Table(columns=tuple(columns), rows=self._rows())
        sources: tuple[Column[Row], ...] = (
            columns[0],
            Column(title="changes", text=lambda row: EFFECTS[row[0].effect].changes, left=True),
            Column(title="cost", text=lambda row: EFFECTS[row[0].effect].cost, left=True),
            Column(title="decided by", text=lambda row: row[0].reason, left=True),
        )
        yield Table(columns=sources, rows=self._rows())

    def _reason(self, row: "Row") -> str:
        from model.effects.names import LIGHT

        one = row[0]
        if one.forced:
            return "by request"
        if one.effect not in LIGHT:
            return one.reason if one.acts else ""
        if not one.acts:
            return "" if one.bound.largest == 0.0 else "within what is allowed"
        if self.plan.rule == "all":
            return "all act"
        return "above what is left" if math.isfinite(one.bound.largest) else "no useful bound"

    def _verified(self, checked: "Verification") -> str:
        saved = max(1.0 - checked.planned_s / checked.all_s, 0.0)
        held = "every bound holds" if not checked.violations else f"{len(checked.violations)} bounds do NOT hold"
        return (
            f"Verified: {held}; {checked.planned_s:.3g} s with the effects that act, {checked.all_s:.3g} s with all "
            f"({saved:.0%} saved)."
        )

    def as_json(self) -> dict[str, Json]:
        """Return what effects.json holds."""
        from rigctl.report.effects import effects_json

        return effects_json(self.plan, self.checked) | {"remarks": list(self.remarks)}

    def write(self, folder: Path) -> tuple[str, ...]:
        """Write the chart and the numbers into a folder; return the names of the files."""
        from rigctl.report.data_files import json_file
        from rigctl.report.output import write_folder

        return write_folder(folder, {"effects.png": self._chart(), "effects.json": json_file(self.as_json())})

    def _chart(self) -> bytes:
        """Return a bar for the bound of each effect, against what is allowed, on a logarithmic axis."""
        from model.effects.names import LIGHT
        from rigctl.report.drawing import MEASURED, PREDICTED, png, subplots

        shown = [row for row in self._rows() if row[0].effect in LIGHT and row[0].bound.largest > _LEAST_SHOWN]
        rows = shown[::-1]
        finite = [row[0].bound.largest for row in rows if math.isfinite(row[0].bound.largest)]
        right = 10.0 * max([*finite, self.plan.tolerance, 1.0])
        figure, (axes,) = subplots(1, 1, size=(8.0, 1.6 + 0.3 * len(rows)))
        for place, (one, checked) in enumerate(rows):
            axes.barh(place, min(one.bound.largest, right), color=MEASURED if one.acts else PREDICTED, height=0.6)
            if not math.isfinite(one.bound.largest):
                axes.text(right, place, "no bound ", ha="right", va="center", color="white", fontsize=8)
            if checked is not None and _LEAST_SHOWN < checked.actual.largest < math.inf:
                axes.plot(checked.actual.largest, place, "k|", markersize=12)
        if self.plan.tolerance > 0.0:
            axes.axvline(self.plan.tolerance, color="black", linestyle="--")
        axes.set_yticks(range(len(rows)), [row[0].effect.value for row in rows])
        axes.set_xscale("log")
        axes.set_xlim(_LEAST_SHOWN, right)
        axes.set_xlabel("most that leaving the effect out can change any number")
        true = "" if self.checked is None else "; |: true change"
        axes.set_title(f"orange: acts; blue: left out; dashed: allowed, {self.plan.tolerance:.2g}{true}", fontsize=9)
        return png(figure)


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderingResult(Result):
    """Effects of a simulated camera's pictures, with the time of each."""

    costs: "RenderingCosts"

    def content(self) -> Iterable[Part]:
        """Return how many effects act and their time, and the table."""
        from rigctl.report.table import Column, Table

        total_s = sum(one.cost_s for one in self.costs.costs)
        columns: tuple[Column[RenderingCost], ...] = (
            Column(title="effect", text=lambda row: row.effect, left=True),
            Column(title="acts on", text=lambda row: row.place, left=True),
            Column(title="ms a frame", text=lambda row: f"{1e3 * row.cost_s:.2f}"),
        )
        yield (
            f"{len(self.costs.costs)} effects act on the simulated pictures and take {1e3 * total_s:.1f} of "
            f"{1e3 * self.costs.frame_s:.1f} ms a frame (medians of {self.costs.frames} frames)."
        )
        yield Table(columns=columns, rows=self.costs.costs)
        yield "Effects that the rig file does not name are not computed."

    def as_json(self) -> dict[str, Json]:
        """Return the same for programs."""
        effects: list[Json] = [
            {"effect": one.effect, "place": one.place, "cost_s": one.cost_s} for one in self.costs.costs
        ]
        return {"rendering": effects, "frame_s": self.costs.frame_s, "frames": self.costs.frames}


def _rendering(path: Path) -> RenderingResult:
    from rigctl.files.rig_file import load_rig
    from rigctl.rig.simulation import rendering_costs

    simulation = load_rig(path).simulation
    if simulation is None:
        raise ConfigError(f"{path}: has no [simulation]: a real camera's pictures go through no effects of ours")
    return RenderingResult(costs=rendering_costs(simulation))


def _decision(row: "Row") -> str:
    one = row[0]
    if one.acts:
        return "acts"
    return "left out" if one.forced or one.bound.largest > 0.0 else "not stated"


def _largest_kind(one: "Decision") -> str:
    values = {kind: getattr(one.bound, kind) for kind in _KINDS}
    largest = max(values, key=lambda kind: values[kind])
    # What has no bound at all is not of one kind.
    return _KINDS[largest] if 0.0 < values[largest] < math.inf else ""


def _bound(row: "Row", *, kind: str) -> str:
    return _size(getattr(row[0].bound, kind))


def _at_most(row: "Row") -> str:
    """Return the bound; nothing of an effect of sensor or session, which acts where it is stated, without a bound."""
    from model.effects.names import LIGHT

    one = row[0]
    return "-" if one.acts and one.effect not in LIGHT else _size(one.bound.largest)


def _actual(checked: "CheckedEffect | None") -> float:
    return 0.0 if checked is None else checked.actual.largest


def _true(checked: "CheckedEffect | None") -> str:
    return "" if checked is None else _size(checked.actual.largest)


def _time(row: "Row") -> str:
    checked = row[1]
    return "" if checked is None else f"{1e3 * max(checked.with_s - checked.without_s, 0.0):.2g} ms"


def _size(value: float) -> str:
    """Return a change in words: none, no bound, or two digits; what no double of 0.1 could show is 0."""
    if not math.isfinite(value):
        return "any"
    return "0" if value < _LEAST_SHOWN else f"{value:.2g}"
