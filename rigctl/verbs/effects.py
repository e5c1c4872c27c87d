"""`rigctl effects`: effects of the model that matter in a scene, and the cost of effects of a simulated camera."""

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.base.numbers import change_text
from rigctl.console import Json, note, solving_shown
from rigctl.errors import ConfigError
from rigctl.verbs.options import EffectOptions, FilePath, Files, Part, Result, Writes

if TYPE_CHECKING:
    from model.accuracy.effect_check import CheckedEffect
    from model.effects.effect import Bound, Decision, EffectPlan
    from rigctl.report.document import Table
    from rigctl.scene.effects import Verification

    Row = tuple[Decision, CheckedEffect | None]

# Changes below this are not drawn.
_ENDS = 2
_LEAST_DRAWN = 1e-10


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
    """List the effects of the model, largest first, and whether each matters in a scene.

    An effect acts, is left out, or is not stated in the scene file. The size of an effect that acts is found by leaving
    it out; the size of an effect that is not stated, by adding it at both ends of its usual range. Effects of the light
    are left out if their bounds together stay within half of the tolerance. Changes of counts, radiance, standard
    deviations and SNR (noise) are relative; changes of DoLP, S1/S0, S2/S0 and detection probability (P_D) are absolute.

    For a rig file with [simulation], the command lists the effects in the simulated camera's pictures, and their cost.

    Example: rigctl effects examples/scene-panels.toml --tolerance 0.02 --verify

    Example: rigctl effects examples/rig-effects.toml

    Parameters
    ----------
    file : path
        Scene file, or rig file.
    tolerance : float
        Tolerance of a prediction; effects that are left out may use half of it.
    verify : bool
        Compute the scene with and without each effect, and show the true change and the time. The exit code is 1 if
        a bound does not hold.
    noise : path
        Noise calibration file, in place of the assumed noise.
    wide : bool
        Also show the bounds for every kind of number, and the cost of each effect.
    out : path
        Folder for effects.png (chart of the bounds against the tolerance) and effects.json.
    **options
        Effects that are forced, see `EffectOptions`.
    """
    from rigctl.files.toml import has_any_key

    if has_any_key(Path(file), "stage", "camera", "simulation"):
        return _rendering(Path(file))
    from rigctl.calibrations.noise import read_noise_file
    from rigctl.files.scene_file import load_scene
    from rigctl.scene.effects import plan_effects, verify_effects, with_sizes
    from rigctl.scene.scene import scene_of_file, with_choices

    chosen = with_choices(
        load_scene(Path(file)),
        switched_on=tuple(options.get("switched_on", ())),
        left_out=tuple(options.get("left_out", ())),
    )
    record = scene_of_file(chosen, None if noise is None else read_noise_file(Path(noise)))
    with solving_shown() as tell:
        planned = plan_effects(record, tolerance=tolerance, rule=options.get("effects") or "safe")
        planned = with_sizes(planned, tell=tell)
        checked = verify_effects(planned, tell=tell) if verify else None
    found = EffectsResult(plan=planned.plan, checked=checked, remarks=planned.remarks, is_wide=wide)
    if out is not None:
        note(f"written: {' and '.join(found.write(Path(out)))} in {out}", below=True)
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectsResult(Result):
    """Decisions on all effects of the model for a scene."""

    plan: "EffectPlan"
    checked: "Verification | None"  #: true changes, if they were computed
    remarks: tuple[str, ...]  #: assumptions
    is_wide: bool = False  #: show the bounds for every kind of number

    @property
    def exit_code(self) -> int:
        """1 if a bound does not hold."""
        return 1 if self.checked is not None and self.checked.violations else 0

    def content(self) -> Iterable[Part]:
        """Return a summary, the table, lines to add to the scene file, and the verification."""
        from rigctl.report.effects import unstated_line

        yield self._answer()
        yield from filter(None, [unstated_line(self.plan)])
        yield from self._wide_tables() if self.is_wide else [self._table()]
        yield from self._lines_to_add()
        yield from self.remarks
        if self.checked is not None:
            yield self._verified(self.checked)
        yield self._chart

    def _answer(self) -> str:
        decisions, spent = self.plan.decisions, self.plan.spent
        count = Counter(one.answer for one in decisions)
        asked = sum(one.forced and one.answer == "left out" for one in decisions)
        others = count["left out"] - asked
        text = f"{count['acts']} of {len(decisions)} effects act"
        if asked:
            text += f"; {asked} left out by request"
        if others and spent.largest == 0.0:
            text += f"; {others} change{'s' * (others == 1)} nothing here"
        elif others:
            text += f"; {others} left out, which together change DoLP by at most {change_text(spent.ratios)}"
            if spent.largest > spent.ratios:
                text += f" and no number by more than {change_text(spent.largest)}"
            text += f" (allowed: {self.plan.tolerance:.2g})"
        return f"{text}; {count['not stated']} not stated." if count["not stated"] else f"{text}."

    def _rows(self) -> "tuple[Row, ...]":
        found = {} if self.checked is None else {one.effect: one for one in self.checked.checked}
        rows = [(one, found.get(one.effect)) for one in self.plan.decisions]
        return tuple(sorted(rows, key=lambda row: -row[0].change.largest))

    def _table(self) -> "Table[Row]":
        from rigctl.report.document import Column, Table

        columns: list[Column[Row]] = [
            Column(title="effect", text=lambda row: row[0].effect.value, left=True),
            Column(title="answer", text=lambda row: row[0].answer, left=True),
            Column(title="change", text=_change),
            Column(title="of", text=lambda row: _largest_kind(row[0].change), left=True),
            Column(title="of DoLP", text=lambda row: change_text(row[0].change.ratios)),
            Column(title="why", text=lambda row: _why(row[0]), left=True),
        ]
        if self.checked is not None:
            columns.insert(5, Column(title="truly", text=_true))
        return Table(columns=tuple(columns), rows=self._rows())

    def _wide_tables(self) -> "Iterable[Table[Row]]":
        from model.effects.planner import EFFECTS
        from rigctl.report.document import Column, Table
        from rigctl.report.effects import KINDS

        columns: list[Column[Row]] = [
            Column(title="effect", text=lambda row: row[0].effect.value, left=True),
            Column(title="answer", text=lambda row: row[0].answer, left=True),
            *(Column(title=title, text=partial(_of_kind, kind=kind)) for kind, title in KINDS.items()),
            *(Column(title=f"{title} <=", text=partial(_bound, kind=kind)) for kind, title in KINDS.items()),
        ]
        if self.checked is not None:
            columns += [Column(title="truly", text=_true), Column(title="time", text=_time)]
        yield Table(columns=tuple(columns), rows=self._rows())
        sources: tuple[Column[Row], ...] = (
            columns[0],
            Column(title="changes", text=lambda row: EFFECTS[row[0].effect].changes, left=True),
            Column(title="cost", text=lambda row: EFFECTS[row[0].effect].cost, left=True),
            Column(title="decided by", text=lambda row: row[0].reason, left=True),
        )
        yield Table(columns=sources, rows=self._rows())

    def _lines_to_add(self) -> Iterable[str]:
        """Yield the lines of a scene file for the effects that are not stated."""
        from rigctl.scene.effects import statement_of

        lines: dict[str, list[str]] = {}
        for one in self.plan.unstated_above(self.plan.tolerance):
            found = statement_of(one.effect)
            lines.setdefault(found.table, []).append(found.line)
        if lines:
            yield "To state them, add to the scene file, with your own numbers:"
        for table, some in lines.items():
            yield "\n".join([f"  {table}", *(f"  {line}" for line in some)])

    def _verified(self, checked: "Verification") -> str:
        saved = max(1.0 - checked.planned_s / checked.all_s, 0.0)
        failed = [f"{one.effect} (bound {one.bound.in_words}; is {one.actual.in_words})" for one in checked.violations]
        held = (
            f"does NOT hold: the bound of {'; '.join(failed)}. Please report the scene"
            if failed
            else "every bound holds"
        )
        return (
            f"Verified: {held}; {checked.planned_s:.3g} s with the effects that act, {checked.all_s:.3g} s with all "
            f"({saved:.0%} saved)."
        )

    def as_json(self) -> dict[str, Json]:
        """Return the content of effects.json."""
        from rigctl.report.effects import effects_json

        return effects_json(self.plan, self.checked) | {"remarks": list(self.remarks)}

    def output_files(self) -> Files:
        """Return the chart and the numbers."""
        return {"effects.png": self._chart(), "effects.json": self.as_json()}

    def _chart(self) -> bytes:
        """Return a chart of the change by each effect and the allowed change, on a logarithmic axis."""
        from rigctl.report.drawing import MEASURED, PREDICTED, png, subplots

        colours = {"acts": MEASURED, "left out": PREDICTED, "not stated": "grey"}
        rows = [row for row in self._rows() if row[0].change.largest > _LEAST_DRAWN][::-1]
        finite = [row[0].change.largest for row in rows if math.isfinite(row[0].change.largest)]
        right = 10.0 * max([*finite, self.plan.tolerance, 1.0])
        figure, (axes,) = subplots(1, 1, size=(8.0, 1.8 + 0.3 * len(rows)))
        for place, (one, checked) in enumerate(rows):
            axes.barh(place, min(one.change.largest, right), color=colours[one.answer], height=0.6)
            if not math.isfinite(one.change.largest):
                axes.text(right, place, "any amount ", ha="right", va="center", color="white", fontsize=8)
            if checked is not None and _LEAST_DRAWN < checked.actual.largest < math.inf:
                axes.plot(checked.actual.largest, place, "k|", markersize=12)
        if self.plan.tolerance > 0.0:
            axes.axvline(self.plan.tolerance, color="black", linestyle="--")
        axes.set_yticks(range(len(rows)), [row[0].effect.value for row in rows])
        axes.set_xscale("log")
        axes.set_xlim(_LEAST_DRAWN, right)
        axes.set_xlabel("largest change of any number: bound of what is left out, size of the others")
        true = "" if self.checked is None else "; |: true change"
        axes.set_title(
            f"orange: acts; blue: left out; grey: not stated; dashed: allowed, {self.plan.tolerance:.2g}{true}",
            fontsize=9,
        )
        return png(figure)


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderingResult(Result):
    """Effects of a simulated camera's pictures, with the time of each."""

    #: Name of each effect, place in the chain, and median time per frame [s].
    costs: "tuple[tuple[str, str, float], ...]"
    frame_s: float  #: of a whole frame
    frames: int

    def content(self) -> Iterable[Part]:
        """Return how many effects act and their time, and the table."""
        from rigctl.report.document import Column, Table

        total_s = sum(cost_s for _, _, cost_s in self.costs)
        columns: tuple[Column[tuple[str, str, float]], ...] = (
            Column(title="effect", text=lambda row: row[0], left=True),
            Column(title="acts on", text=lambda row: row[1], left=True),
            Column(title="ms a frame", text=lambda row: f"{1e3 * row[2]:.2f}"),
        )
        yield (
            f"{len(self.costs)} effects act on the simulated pictures and take {1e3 * total_s:.1f} of "
            f"{1e3 * self.frame_s:.1f} ms a frame (medians of {self.frames} frames)."
        )
        yield Table(columns=columns, rows=self.costs)
        yield "Effects that the rig file does not name are not computed."

    def as_json(self) -> dict[str, Json]:
        """Return the same for programs."""
        effects: list[Json] = [{"effect": name, "place": place, "cost_s": cost_s} for name, place, cost_s in self.costs]
        return {"rendering": effects, "frame_s": self.frame_s, "frames": self.frames}


def _rendering(path: Path) -> RenderingResult:
    from rigctl.files.rig_file import load_rig
    from rigctl.rig.simulation import rendering_costs

    simulation = load_rig(path).simulation
    if simulation is None:
        raise ConfigError(f"{path}: has no [simulation]: only pictures of a simulated camera have effects to list")
    costs, frame_s, frames = rendering_costs(simulation)
    return RenderingResult(costs=costs, frame_s=frame_s, frames=frames)


def _largest_kind(found: "Bound") -> str:
    from rigctl.report.effects import KINDS

    largest = max(KINDS, key=lambda kind: getattr(found, kind))
    return KINDS[largest] if found.largest > 0.0 else ""


def _why(one: "Decision") -> str:
    """Return the reason in a few words."""
    from rigctl.scene.effects import statement_of

    if one.forced:
        return "by request"
    if one.answer == "not stated":
        # The scene cannot have an end of the usual range, such as a field above the horizon.
        return statement_of(one.effect).words if len(one.changes) == _ENDS else "too near a limit"
    if one.reason.startswith("sum"):
        return "above allowed" if one.acts else "within allowed"
    return one.reason


def _change(row: "Row") -> str:
    """Return the size of an effect; its bound if it is left out."""
    one = row[0]
    if one.answer == "not stated" and not one.changes:
        return "?"
    text = change_text(one.change.largest)
    return f"<={text}" if not one.acts and not one.changes and one.bound.largest > 0.0 else text


def _of_kind(row: "Row", *, kind: str) -> str:
    return change_text(getattr(row[0].change, kind)) if row[0].changes else ""


def _bound(row: "Row", *, kind: str) -> str:
    from model.effects.effect import LIGHT

    return change_text(getattr(row[0].bound, kind)) if row[0].effect in LIGHT else ""


def _true(row: "Row") -> str:
    one, checked = row
    return "" if checked is None or one.answer == "not stated" else change_text(checked.actual.largest)


def _time(row: "Row") -> str:
    checked = row[1]
    return "" if checked is None else f"{1e3 * max(checked.with_s - checked.without_s, 0.0):.2g} ms"
