"""A comparison of a run with the model as people and programs read it: rows, tables, figures, JSON, page and files.

The page begins with the verdict in one sentence, a summary in which every number has its error, and maps of S0, DoLP
and AoLP. After a disagreement the verdict states the likeliest cause with its size. `ROW_COLUMNS` declares a row for
the page, the terminal, CSV and JSON.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from importlib.metadata import version
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.processing import dolp
from model.processing.dolp_studies import normalized_density
from model.processing.reconstruction import aolp_is_defined
from model.quantities import FOLLOWED, QUANTITIES, angle_of
from model.stokes import dolp as degree_of_polarization
from rigctl.base.numbers import NOTHING, chance, p_value, plus_minus, signed, size, to_digits
from rigctl.calibrations.kinds import MeasuredOverFrames
from rigctl.comparison.checks import ADVICE, not_judged, refusals, reservations, titled_texts, unjudged_lines
from rigctl.comparison.compare import ALLOWED_SHARE
from rigctl.comparison.rows import FAULTS, error_of_both, off_prediction
from rigctl.console import LEFT_OUT, is_anonymous, is_personal, rewritten
from rigctl.files.scene_file import NoiseSection
from rigctl.measure.faults import UNSEEN
from rigctl.prediction.predict import NO_NOISE
from rigctl.report.document import Block, Column, Picture, Report, Section, Shown, Table, Verbatim, text_columns
from rigctl.report.drawing import (
    MEASURED,
    PREDICTED,
    legend_beside,
    legend_of_all,
    picture_pngs,
    placed_axes,
    png,
    subplots,
)
from rigctl.report.effects import taken_table
from rigctl.report.light import light_figure, share_table
from rigctl.report.measurement import (
    annotation_sections,
    annotations_of,
    aolp_map,
    diagnosis_json,
    measurement_json,
    pixels_json,
    residual_picture,
    scene_maps,
)
from rigctl.report.prediction import SCHEMA_VERSION, STATISTICS, detection_table, prediction_json, strength_table
from rigctl.version import VERSION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from model.moments import Moments
    from model.prediction import RegionPrediction
    from model.scene.field import FieldLight
    from rigctl.calibrations.noise import NoiseParameters
    from rigctl.comparison.checks import Check, Trend
    from rigctl.comparison.compare import Comparison, NumericalAccuracy
    from rigctl.comparison.explain import FittedInput, InputAttribution, InputMove
    from rigctl.comparison.rows import RegionBudget, Row
    from rigctl.console import Json
    from rigctl.files.regions import Region
    from rigctl.measure.faults import FaultTerm
    from rigctl.measure.measure import Measurement
    from rigctl.report.files import Content


# Smaller errors are rounding.
_ROUNDING = 1e-12
_LARGEST_SCORE = 10.0
# Of the second digit of an error, to which numbers are shown.
_HALF_A_DIGIT = 0.005
Budgets = Mapping[str, "RegionBudget"]  # by region
_VERDICTS = {True: "agrees", False: "DISAGREES", None: "no test"}
_TREND_WORDS = {True: "predicted", False: "NOT predicted", None: "not known"}


def predicted_text(row: Row) -> str:
    """Return the prediction to the digits that the errors allow."""
    return _undefined(row, row.std_error_inputs) or to_digits(row.predicted, error_of_both(row))


def measured_text(row: Row) -> str:
    """Return the measured number to the digits that the errors allow."""
    return _undefined(row, row.std_error) or to_digits(row.measured, error_of_both(row))


def score_text(row: Row) -> str:
    """Return the score of a row; above 10 only its sign, because its size depends on unknown tails of distributions."""
    if row.z is None:
        return NOTHING
    return f"{row.z:+z.1f}" if abs(row.z) <= _LARGEST_SCORE else ">10" if row.z > 0.0 else "<-10"


def _undefined(row: Row, std_error: float | None) -> str:
    """Return the word for an AoLP that may be any angle; nothing for other numbers."""
    if (row.quantity, row.statistic) != ("aolp_deg", "mean") or std_error is None:
        return ""
    return "" if aolp_is_defined(np.radians(std_error)) else "undefined"


def _with_error(text: str, std_error: float | None, value: float) -> str:
    """Return a number with its own standard error, both to two digits of that error; as it is without one."""
    if text == "undefined" or not std_error or std_error < _ROUNDING:
        return text
    return f"{to_digits(value, std_error)}\N{NO-BREAK SPACE}± {to_digits(std_error, std_error)}"


def _detectable(row: Row) -> str:
    return NOTHING if row.smallest_difference_90 is None else f"{row.smallest_difference_90:.2g}"


# Keys are those of `Row`. A page has a table for each region; the terminal is narrow.
ROW_COLUMNS: tuple[Column[Row], ...] = (
    Column(title="region", key="region", left=True, shown=Shown.TERMINAL | Shown.PROGRAMS),
    Column(title="quantity", key="quantity", left=True),
    Column(title="statistic", key="statistic", left=True),
    Column(
        title="predicted",
        key="predicted",
        text=lambda row: _with_error(predicted_text(row), row.std_error_inputs, row.predicted),
        brief=predicted_text,
    ),
    Column(
        title="measured",
        key="measured",
        text=lambda row: _with_error(measured_text(row), row.std_error, row.measured),
        brief=measured_text,
    ),
    Column(key="std_error", shown=Shown.PROGRAMS),
    Column(key="std_error_inputs", shown=Shown.PROGRAMS),
    Column(key="z_measurement", shown=Shown.PROGRAMS),
    Column(title="z", key="z", text=score_text),
    Column(
        title="verdict",
        key="agrees",
        text=lambda row: _VERDICTS[row.agrees],
        left=True,
        shown=Shown.PAGE | Shown.PROGRAMS,
    ),
    Column(title="detectable", key="smallest_difference_90", text=_detectable, shown=Shown.PAGE | Shown.PROGRAMS),
)
_BY_KEY = {column.key: column for column in ROW_COLUMNS}


def row_table(rows: Iterable[Row]) -> Table[Row]:
    """Return rows with errors, score and verdict."""
    return Table(columns=ROW_COLUMNS, rows=tuple(rows), is_off=_disagrees)


def mixed_row_table(rows: Iterable[Row]) -> Table[Row]:
    """Return rows of several regions for a page, each with its region."""
    columns: tuple[Column[Row], ...] = (
        Column(title="number", text=lambda row: f"{row.region}: {row.quantity}", left=True),
        *(_BY_KEY[key] for key in ("statistic", "measured", "predicted", "z")),
    )
    return Table(columns=columns, rows=tuple(rows), is_off=_disagrees)


def numbers_columns() -> tuple[Column[Row], ...]:
    """Return the columns next to those that name the number."""
    return tuple(column for column in ROW_COLUMNS if column.key not in ("region", "quantity", "statistic"))


def _disagrees(row: Row) -> bool:
    return row.agrees is False


# Quantities of the summary, and their titles there.
_SUMMARY = {"s0": "S0 [{unit}]", "dolp": "DoLP", "aolp_deg": "AoLP [deg]", "dolp_snr": "DoLP SNR"}
# Of more indistinguishable inputs than this only the number is shown.
_NAMED = 4
_SHOWN_MOVES = 12
_Known = tuple[str, MeasuredOverFrames[float]]


def summary_table(comparison: Comparison) -> Table[Row]:
    """Return S0, DoLP, AoLP and DoLP SNR of each region, measured and predicted, with the difference in errors."""
    unit = comparison.measurement.grid.unit
    means = {(row.region, row.quantity): row for row in comparison.rows if row.statistic == "mean"}
    keys = [(region, quantity) for region in comparison.measurement.regions for quantity in _SUMMARY]
    rows = [means[key] for key in keys if key in means]
    first = {row.region: row.quantity for row in reversed(rows)}
    columns: tuple[Column[Row], ...] = (
        Column(title="region", text=lambda row: row.region if first[row.region] == row.quantity else "", left=True),
        Column(title="quantity", text=lambda row: _SUMMARY[row.quantity].format(unit=unit), left=True),
        _BY_KEY["measured"],
        Column(title="predicted", text=lambda row: _BY_KEY["predicted"].text_of(row) + _numerical(comparison, row)),
        _BY_KEY["z"],
    )
    return Table(columns=columns, rows=tuple(rows), is_off=_disagrees)


def _numerical(comparison: Comparison, row: Row) -> str:
    """Return the numerical error of a prediction from exact inputs, if it shows in the digits of the prediction."""
    if row.std_error_inputs or comparison.accuracy is None:
        return ""
    error = comparison.accuracy.predicted.error_of(row.region, row.quantity, row.statistic) or 0.0
    return f" ± {error:.0e}" if error > _HALF_A_DIGIT * error_of_both(row) else ""


def trend_table(trends: Sequence[Trend]) -> Table[Trend]:
    """Return whether the order of numbers is as predicted."""
    columns: tuple[Column[Trend], ...] = (
        Column(title="quantity", text=lambda found: found.quantity, left=True),
        Column(title="over", text=lambda found: found.over, left=True),
        Column(title="numbers", text=lambda found: str(found.order.numbers)),
        Column(title="pairs known", text=lambda found: f"{found.order.known_pairs} of {found.order.pairs}"),
        Column(title="in order", text=lambda found: str(found.order.concordant)),
        Column(title="Kendall's tau", text=lambda found: f"{found.order.tau:+.2f}"),
        Column(title="chance", text=lambda found: chance(found.order.p_value)),
        Column(title="trend", text=lambda found: _TREND_WORDS[found.predicted], left=True),
    )
    return Table(columns=columns, rows=tuple(trends), is_off=lambda found: found.predicted is False)


def check_table(checks: Sequence[Check]) -> Table[Check]:
    """Return the checks of the run."""
    columns: tuple[Column[Check], ...] = (
        Column(title="check", text=lambda check: check.name, left=True),
        Column(title="verdict", text=lambda check: check.verdict, left=True),
        Column(title="found", text=lambda check: check.text, left=True, wide=True),
    )
    return Table(columns=columns, rows=tuple(checks), is_off=lambda check: check.verdict in ("flagged", "refused"))


def budget_table(budgets: Budgets, quantity: str) -> Table[tuple[str, dict[str, float]]]:
    """Return the standard uncertainty of a quantity by region and cause."""
    rows = tuple((region, parts[quantity]) for region, parts in budgets.items() if quantity in parts)
    causes = dict.fromkeys(cause for _, parts in rows for cause in parts)
    columns: tuple[Column[tuple[str, dict[str, float]]], ...] = (
        Column(title="region", text=lambda row: row[0], left=True),
        *(Column(title=cause, text=partial(_part, cause=cause)) for cause in causes),
        Column(title="all", text=lambda row: size(_total(row[1]))),
    )
    return Table(columns=columns, rows=rows)


def _part(row: tuple[str, dict[str, float]], cause: str) -> str:
    return size(row[1].get(cause, 0.0))


def _total(parts: Mapping[str, float]) -> float:
    return float(np.linalg.norm(list(parts.values())))


def disagreeing(comparison: Comparison, most: int) -> list[Row]:
    """Return the rows that disagree, the farthest first."""
    return sorted(comparison.disagreements, key=lambda row: -abs(row.z or 0.0))[:most]


def move_table(attribution: InputAttribution) -> Table[InputMove]:
    """Return the inputs as attributions, the likeliest first."""
    columns: tuple[Column[InputMove], ...] = (
        Column(title="input", text=lambda move: move.name, left=True),
        Column(title="stated", text=lambda move: f"{to_digits(move.value, move.std)} ± {move.std:.2g}"),
        Column(title="would move by [its std]", text=lambda move: f"{move.move_std:+.1f}"),
        Column(title="to", text=lambda move: to_digits(move.moved_value, move.std)),
        Column(title="score", text=lambda move: f"{move.score:+.1f}"),
        Column(title="p-value left", text=_chance),
        Column(title="seen by the data", text=lambda move: f"{move.seen:.0%}"),
        Column(title="not distinguished from", text=_confused, left=True, wide=True),
    )
    return Table(columns=columns, rows=attribution.moves[:_SHOWN_MOVES])


def fitted_table(attribution: InputAttribution) -> Table[FittedInput]:
    """Return all inputs after the joint update."""
    columns: tuple[Column[FittedInput], ...] = (
        Column(title="input", text=lambda found: found.name, left=True),
        Column(title="fitted value", text=lambda found: to_digits(found.value, found.std)),
        Column(title="its std", text=lambda found: f"{found.std:.2g}"),
        Column(title="moved by [stated std]", text=lambda found: f"{found.moved_std:+.2f}"),
    )
    return Table(columns=columns, rows=attribution.fitted)


def _chance(move: InputMove) -> str:
    return chance(move.p_value_left) + (" (removed)" if move.removes else "")


def _confused(move: InputMove) -> str:
    names = move.indistinguishable_from
    if not names:
        return NOTHING
    return ", ".join(names) if len(names) <= _NAMED else f"{len(names)} others"


def fault_table(terms: Sequence[FaultTerm]) -> Table[FaultTerm]:
    """Return faults with their size, the shifts that they cause, and the faults with which they can be confused."""
    columns: tuple[Column[FaultTerm], ...] = (
        Column(title="fault", text=lambda term: term.title, left=True),
        Column(title="size", text=lambda term: _number(term.value)),
        Column(title="error", text=lambda term: _number(term.std_error)),
        Column(title="unit", text=lambda term: term.unit, left=True),
        Column(title="moves DoLP by", text=lambda term: _number(term.dolp_shift)),
        Column(title="AoLP by [deg]", text=lambda term: _number(term.aolp_shift_deg)),
        Column(title="result", text=_fault_result, left=True, wide=True),
    )
    return Table(columns=columns, rows=tuple(terms), is_off=lambda term: term.named)


def _number(value: float | None) -> str:
    return NOTHING if value is None else f"{value:.3g}"


def _fault_result(term: FaultTerm) -> str:
    if not term.testable:
        return f"not testable: {term.reason}"
    score = None if term.value is None or not term.std_error else term.value / term.std_error
    result = "found" if term.named else f"not found ({signed(score)} errors)"
    return result + (f"; cannot be distinguished from {', '.join(term.confused_with)}" if term.confused_with else "")


def parameter_table(noise: NoiseParameters) -> Table[_Known]:
    """Return the numbers of the noise calibration that a comparison used, with their errors."""
    columns: tuple[Column[_Known], ...] = (
        Column(title="noise calibration", text=lambda row: row[0], left=True),
        Column(title="value", text=lambda row: to_digits(row[1].value, row[1].std_error)),
        Column(title="its standard error", text=lambda row: f"{row[1].std_error:.2g}"),
    )
    rows = tuple((name, found) for name in NoiseSection.model_fields if (found := noise.known.get(name)) is not None)
    return Table(columns=columns, rows=rows)


def compared_json(comparison: Comparison) -> dict[str, Json]:
    """Return the content of comparison.json."""
    measurement, rows = comparison.measurement, _rows_by_name(comparison.rows)
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": comparison.kind,
        "agrees": comparison.agrees,
        "verdict": comparison.verdict,
        "flags": [check.name for check in comparison.flags],
        "alpha": comparison.alpha,
        "scale": None if comparison.scale is None else asdict(comparison.scale),
        "disagreements": row_table(comparison.disagreements).json(),
        "diagnosis": {
            "points_to": list(comparison.points_to),
            "advice": [ADVICE[cause] for cause in comparison.points_to],
            **diagnosis_json(comparison.run.diagnosis),
        },
        "statistics": STATISTICS,
        "unit": measurement.grid.unit,
        "regions": {name: asdict(verdict) | rows.get(name, {}) for name, verdict in comparison.regions.items()},
        "rows": row_table(comparison.rows).json(),
        "pixels": {name: pixels_json(region) for name, region in measurement.regions.items()},
        "explanation": None if comparison.attribution is None else asdict(comparison.attribution),
        "trends": [_trend_json(found) for found in comparison.trends],
        "budget": comparison.budgets,
        "checks": [asdict(check) for check in comparison.checks],
        "unstated_effects": [
            {"effect": one.effect.value} | {key: value for key, value in vars(one).items() if key != "effect"}
            for one in comparison.unstated
        ],
        "remarks": list(comparison.remarks),
        "not_tested": list(comparison.not_tested),
        "accuracy": None if comparison.accuracy is None else _accuracy(comparison.accuracy),
        "provenance": provenance_json(comparison),
        **comparison.run.calibrations.selected.as_json(),
        **annotations_of(measurement.run, measurement.grid.left_out),
    }


def _accuracy(found: NumericalAccuracy) -> Json:
    """Return the numerical settings that a comparison chose, and their largest error as a share of a row's error."""
    return {
        "tolerance": found.tolerance,
        "settings": found.settings,
        "share_of_standard_error": found.share,
        "row": None if found.row is None else "/".join(found.row),
        "allowed_share": ALLOWED_SHARE,
        "is_kept": found.is_kept,
        "is_promised": not found.predicted.estimated_only,
        "left_out": sorted(found.left_out),
    }


def _rows_by_name(rows: Iterable[Row]) -> dict[str, dict[str, dict[str, Json]]]:
    """Return rows by region, quantity and statistic."""
    regions: dict[str, dict[str, dict[str, Json]]] = {}
    for row in rows:
        numbers = Table(columns=numbers_columns(), rows=(row,)).json()[0]
        regions.setdefault(row.region, {}).setdefault(row.quantity, {})[row.statistic] = numbers
    return regions


def _trend_json(found: Trend) -> dict[str, Json]:
    share = found.order.share_concordant
    return {"quantity": found.quantity, "over": found.over, "predicted": found.predicted, "share_concordant": share} | (
        asdict(found.order)
    )


FloatArray = NDArray[np.float64]
Law = Callable[[FloatArray], FloatArray]

_BINS = 60
# Two pixels of the figure apart.
_LAW_POINTS = 150
# Titles of budgets; that of S0 is relative.
_TITLES = {name: QUANTITIES[name].label for name in FOLLOWED} | {"s0": "S0 (share of itself)"}
# Colours after Okabe and Ito, told apart by colour-blind readers; hatches tell them apart in grey. A cause has the same
# in every report.
_LOOKS = {
    "shot": ("#0072b2", ""),
    "read": ("#56b4e9", "//"),
    "fixed pattern": ("#009e73", ""),
    "texture": ("#f0e442", "xx"),
    "texture and fixed pattern": ("#f0e442", "xx"),
    "noise and texture": ("#0072b2", "\\\\"),
    "dark level": ("#999999", ""),
    "registration": ("#999999", ".."),
    FAULTS: ("#000000", "//"),
    "repeatability": ("#666666", "xx"),
    "angle": ("#e69f00", "//"),
    "drift": ("#cc79a7", ""),
    "inputs": ("#d55e00", ""),
}
# A cause below this share of the largest of a panel is not drawn to scale but at the edge.
_SHOWN_DECADES = 3.0
# Largest width of a letter.
_NAME_INCH = 0.1


def channel_bars(rows: tuple[Row, ...], *, unit: str) -> bytes:
    """Return mean and deviation of the counts by channel, predicted next to measured, as [MK14] Fig. 7."""
    regions = list(dict.fromkeys(row.region for row in rows))
    size = 3.6 * len(regions) + 0.2, 5.6
    figure, axes = placed_axes(2, len(regions), size=size, margins=(0.85, 0.1, 0.85, 0.3), apart=(0.9, 0.8))
    for column, region in enumerate(regions):
        for line, (statistic, title) in enumerate((("mean", "mean"), ("std", "deviation over pixels, one frame"))):
            ax = axes[line * len(regions) + column]
            chosen = [r for r in rows if r.region == region and r.quantity[:3] == "dn_" and r.statistic == statistic]
            _bars(ax, chosen)
            ax.set_title(f"{region}: {title}", fontsize=9)
            ax.set_xlabel("polarizer angle [deg]")
            ax.set_ylabel(f"counts above dark [{unit}]")
    legend_of_all(figure, axes[0])
    return png(figure)


def histograms(measurement: Measurement, predictions: dict[str, RegionPrediction]) -> bytes:
    """Return histograms of s1, s2 and DoLP of each region's pixels with their exact laws, as [MK14] Fig. 8."""
    names = [name for name in predictions if name in measurement.regions]
    size = 11.0, 2.9 * len(names) + 0.35
    figure, axes = placed_axes(len(names), 3, size=size, margins=(0.7, 0.1, 0.85, 0.3), apart=(0.75, 0.8))
    for line, name in enumerate(names):
        pixels, stokes = measurement.regions[name].stokes_pixels, predictions[name].stokes_dn
        lit = pixels[:, pixels[0] > 0.0]
        if not lit.size:
            continue
        step = 1.0 / float(np.median(lit[0]))
        for column, component in enumerate((1, 2)):
            ax = axes[3 * line + column]
            _histogram(ax, lit[component] / lit[0], _ratio_law(stokes, component), step=step, title=name)
            ax.set_xlabel(f"s{component} = S{component}/S0")
        _histogram(axes[3 * line + 2], degree_of_polarization(lit.T), _dolp_law(stokes), step=step, title=name)
        axes[3 * line + 2].set_xlabel("DoLP")
    legend_of_all(figure, axes[0])
    return png(figure)


def scores_png(comparison: Comparison) -> bytes:
    """Return a figure of every row's standard score, with those that disagree marked."""
    tested = [row for row in comparison.rows if row.z is not None]
    names = list(dict.fromkeys(row.region for row in tested))
    figure, axes = subplots(1, 1, size=(11.0, 0.9 + 0.55 * len(names)))
    axes[0].axvspan(-2, 2, color="0.92", label="two standard errors")
    for agrees, colour, label in ((True, PREDICTED, "agrees"), (False, MEASURED, "disagrees")):
        chosen = [row for row in tested if row.agrees is agrees]
        heights = [names.index(row.region) for row in chosen]
        values = [row.z or 0.0 for row in chosen]
        if not chosen:
            continue
        axes[0].scatter(values, heights, s=18, c=colour, marker="o" if agrees else "x", label=label, zorder=3)
    axes[0].set_yticks(range(len(names)), names)
    axes[0].invert_yaxis()
    farthest = max([5.0, *(1.3 * abs(row.z or 0.0) for row in tested)])
    axes[0].set_xscale("symlog", linthresh=5.0)
    axes[0].set_xlim(-farthest, farthest)
    axes[0].xaxis.set_major_formatter("{x:g}")
    axes[0].set_ylim(-0.6, len(names) - 0.4)
    axes[0].set_xlabel("(measured - predicted) / standard error of both")
    legend_beside(axes[0])
    return png(figure)


def _bars(ax: Axes, rows: list[Row]) -> None:
    places = np.arange(len(rows))
    ax.bar(places - 0.2, [row.predicted for row in rows], 0.38, color=PREDICTED, label="predicted")
    ax.bar(places + 0.2, [row.measured for row in rows], 0.38, color=MEASURED, label="measured")
    both = [error_of_both(row) for row in rows]
    ax.errorbar(places + 0.2, [row.measured for row in rows], yerr=both, fmt="none", ecolor="black", capsize=3)
    ax.set_xticks(places, [angle_of(row.quantity) for row in rows])


def _histogram(ax: Axes, values: FloatArray, law: Law, *, step: float, title: str) -> None:
    low, high = float(values.min()), float(values.max())
    density, edges = np.histogram(values, bins=_edges(low, high, step), density=True)
    # One artist; a bar each takes longer than all else of the figure.
    ax.stairs(density, edges, fill=True, color=MEASURED, alpha=0.55, label="measured pixels")
    x = np.linspace(low, high, _LAW_POINTS)
    try:
        ax.plot(x, law(x), color=PREDICTED, linewidth=1.8, label="predicted law")
    except (ValueError, ArithmeticError) as error:
        ax.annotate(f"no law: {error}", (0.02, 0.95), xycoords="axes fraction", fontsize=6, va="top", wrap=True)
    ax.set_title(title, fontsize=9)
    ax.set_ylabel("density")
    ax.locator_params(axis="x", nbins=5)


def _edges(low: float, high: float, step: float) -> FloatArray:
    """Return edges of bins that are a whole multiple of one count's step wide; others would make false spikes."""
    width = step * max(1.0, np.ceil((high - low) / _BINS / step))
    start = np.floor(low / width) - 0.5
    return np.asarray((start + np.arange(int(np.ceil((high - low) / width)) + 3)) * width)


def _ratio_law(stokes: Moments, component: int) -> Law:
    return lambda x: normalized_density(x, stokes.mean, stokes.cov, component=component)


def _dolp_law(stokes: Moments) -> Law:
    return lambda x: np.asarray(dolp.pdf(x, stokes.mean, stokes.cov))


def budget_bars(budgets: Budgets) -> bytes:
    """Return bars of the standard uncertainty by cause, a panel a quantity, a group a region.

    Causes that are too small to be seen in any panel are left out; the tables have them.
    """
    quantities = [quantity for quantity in _TITLES if any(quantity in parts for parts in budgets.values())]
    by_quantity = {quantity: [parts.get(quantity, {}) for parts in budgets.values()] for quantity in quantities}
    all_causes = dict.fromkeys(cause for parts in budgets.values() for causes in parts.values() for cause in causes)
    causes = [cause for cause in all_causes if any(_is_seen(parts, cause) for parts in by_quantity.values())]
    height = 0.9 + 0.17 * len(budgets) * (len(causes) + 2)
    names = _NAME_INCH * max(map(len, budgets)) + 0.25
    lines = 0.2 * -(-(len(causes) + 1) // 5)
    size = 2.6 * len(quantities) + names, max(height, 2.4) + lines + 0.6
    margins = (names, 0.2, lines + 0.65, 0.1)
    figure, axes = placed_axes(1, len(quantities), size=size, margins=margins, apart=(0.35, 0.0))
    for ax, (quantity, parts) in zip(axes, by_quantity.items(), strict=True):
        _panel(ax, parts, quantity, causes)
    axes[0].set_yticks([_place(k, len(causes) / 2, causes) for k in range(len(budgets))], list(budgets))
    legend_of_all(figure, axes[0])
    return png(figure)


def _is_seen(parts: Sequence[Mapping[str, float]], cause: str) -> bool:
    return max(causes.get(cause, 0.0) for causes in parts) > _limits(parts)[0]


def _limits(parts: Sequence[Mapping[str, float]]) -> tuple[float, float]:
    """Return the ends of a panel's axis."""
    most = max(map(_total, parts))
    return (float(10.0 ** (np.floor(np.log10(most)) - _SHOWN_DECADES)), 3.0 * most) if most > 0.0 else (1e-12, 1e-9)


def _panel(ax: Axes, parts: Sequence[Mapping[str, float]], quantity: str, causes: list[str]) -> None:
    """Draw the bars of one quantity; `parts` are its causes, region by region."""
    from matplotlib.ticker import NullLocator

    low, high = _limits(parts)

    def draw(place: int, values: list[float], label: str, look: tuple[str, str]) -> None:
        at = [_place(k, place, causes) for k in range(len(parts))]
        widths = [max(value, low) - low for value in values]
        shape: dict[str, Any] = {"left": low, "color": look[0], "hatch": look[1], "edgecolor": "white"}
        ax.barh(at, widths, 0.85, linewidth=0.0, label=label, **shape)

    for place, cause in enumerate(causes, start=1):
        draw(place, [of_region.get(cause, 0.0) for of_region in parts], cause, _LOOKS[cause])
    draw(0, [_total(of_region) for of_region in parts], "all", ("black", ""))
    ax.set_xscale("log")
    ax.xaxis.set_minor_locator(NullLocator())
    # As text: powers are set as formulas, which takes longer than the rest of the panel.
    ax.xaxis.set_major_formatter(lambda value, _: f"1e{round(np.log10(value))}")
    ax.set_xlim(low, high)
    ax.invert_yaxis()
    ax.set_yticks([])
    ax.set_xlabel(f"std of {_TITLES[quantity]}", fontsize=9)
    ax.tick_params(axis="x", labelsize=8)


def _place(group: int, place: float, causes: list[str]) -> float:
    return group * (len(causes) + 2) + place


# How many disagreements the head of the report lists; its tables have all.
_SHOWN_DISAGREEMENTS = 12
_SIMULATED = "The frames are simulated; the numbers of the simulated sensor and scene are assumed."
_MODEL = "Model: Meng & Kerekes, IEEE TGRS 2014, doi:10.1109/TGRS.2014.2299272, [MK14] above."


def comparison_report(comparison: Comparison) -> Report:
    """Return the report of a comparison."""
    measurement = comparison.measurement
    simulated = measurement.run.session.origin == "simulated"
    return Report(
        title=f"Measurement versus model: {_run_name(measurement)}",
        source=_SIMULATED if simulated else "",
        verdict=verdict(comparison),
        good=comparison.agrees is True,
        sections=[
            _summary(comparison),
            _pictures(measurement, comparison.run.regions),
            *_attributed(comparison),
            *_disagreements(comparison),
            Section(title="Basis of the verdict", blocks=(tuple(_reasons(comparison)),)),
            *annotation_sections(measurement.run.annotations),
            *_residual_of_fit(measurement),
            *_both_sides_section(comparison, measurement),
            *_trends(comparison),
            *([light_section(comparison.lights)] if comparison.lights else []),
            *_uncertainty(comparison),
            *_effects(comparison.accuracy),
            *_by_itself(comparison),
            *_strength(comparison),
            *_numbers(comparison, measurement),
            *_limits_section(comparison),
            *_calibration(comparison.run.calibrations.noise),
            *_sources(comparison),
        ],
    )


def _run_name(measurement: Measurement) -> str:
    """Return the run's folder with the one above it, for many runs are called just "run"."""
    return "/".join(measurement.run.path.absolute().parts[-1 if is_anonymous() else -2 :])


def verdict(comparison: Comparison) -> str:
    """Return the verdict in a sentence, with its reservations, or with the likeliest cause of a disagreement."""
    if comparison.agrees is None:
        return f"{not_judged(comparison.checks).capitalize()}."
    tests = sum(row.agrees is not None for row in comparison.rows)
    untested = len(comparison.rows) - tests if comparison.kind == "closed loop" else 0
    not_counted = f"; {untested} that the prediction takes from the run itself are not counted" if untested else ""
    if comparison.agrees:
        reasons = reservations(comparison.checks, comparison.regions)
        reserved = f", with reservations ({reasons})" if reasons else ""
        found, cause = f"agree{reserved}: {tests} numbers tested at alpha = {comparison.alpha:g}", ""
    else:
        found = f"DISAGREE in {len(comparison.disagreements)} of {tests} numbers (alpha = {comparison.alpha:g})"
        cause = likeliest_cause(comparison)
    return f"Model and measurement {found}{not_counted}{f'; likeliest cause: {cause}' if cause else ''}."


def likeliest_cause(comparison: Comparison) -> str:
    """Return the likeliest cause of a disagreement and its size; empty if the rows point to no cause."""
    cause = next(iter(comparison.points_to), None)
    if cause == "axis-offset":
        off = _mean_of(
            [(off_prediction(row, row.measured), error_of_both(row)) for row in _means(comparison, "aolp_deg")]
        )
        return off and f"polarizer axis off by {off} deg"
    if cause == "axis-sense":
        return "the polarizer turns the other way (sense)"
    if cause in ("scale", "polarization"):
        rows = [row for row in _means(comparison, "s0" if cause == "scale" else "dolp") if row.predicted > 0.0]
        share = _mean_of(
            [(100.0 * (r.measured / r.predicted - 1.0), 100.0 * error_of_both(r) / r.predicted) for r in rows]
        )
        return share and f"{'light or counts' if cause == 'scale' else 'DoLP'} off by {share} %"
    return {"noise": "noise other than predicted", "not-normal": "a law other than predicted"}.get(cause or "", "")


def _means(comparison: Comparison, quantity: str) -> list[Row]:
    rows = [row for row in comparison.rows if (row.quantity, row.statistic) == (quantity, "mean")]
    return [row for row in rows if error_of_both(row) > 0.0]


def _mean_of(found: Sequence[tuple[float, float]]) -> str:
    """Return the weighted mean of numbers; its error is by their errors or by their scatter, the larger one."""
    if not found:
        return ""
    values, errors = np.array(found).T
    weights = 1.0 / errors**2
    mean = float(np.sum(weights * values) / np.sum(weights))
    scatter = float(np.sum(weights * (values - mean) ** 2)) / max(len(found) - 1, 1)
    error = float(np.sqrt(max(scatter, 1.0) / np.sum(weights)))
    return plus_minus(mean, error).replace("-", "−")


def _reasons(comparison: Comparison) -> Iterable[str]:
    yield from (f"Refused: {refusal}" for refusal in refusals(comparison.checks))
    yield from unjudged_lines(comparison.regions, comparison.checks)
    yield from (f"Hardly tested: {weak}" for weak in comparison.weak)
    tests = sum(row.agrees is not None for row in comparison.rows)
    yield (
        f"{tests} numbers were tested; {len(comparison.disagreements)} disagree. Holm's rule at alpha = "
        f"{comparison.alpha:g}: if all agree in truth, the chance that any one is called a disagreement is at most "
        f"{comparison.alpha:g}."
    )
    yield from (ADVICE[cause] for cause in comparison.points_to)
    yield from (f"{title[:1].upper()}{title[1:]}: {text}" for title, text in titled_texts(comparison.checks, "flagged"))


def _summary(comparison: Comparison) -> Section:
    regions = comparison.measurement.regions
    note = (
        "Means of the regions ± standard errors; the ± of a prediction from exact inputs is its numerical error. z is "
        "the difference over the errors of both sides, as a normal score. Where polarization is weak, the z of DoLP is "
        "that of S1 and S2 together, and AoLP has no z. Pixels: "
        f"{', '.join(f'{name} {region.pixels}' for name, region in regions.items())}."
    )
    return Section(title="", blocks=(summary_table(comparison), note))


def _pictures(measurement: Measurement, regions: Sequence[Region]) -> Section:
    maps = (*scene_maps(measurement.images, unit=measurement.grid.unit), aolp_map(measurement.images))
    titles = ("Map of S0", "Map of DoLP", "Map of AoLP")
    pngs = picture_pngs(maps, regions=regions)
    pictures = tuple(Picture(png=one, caption=title) for one, title in zip(pngs, titles, strict=True))
    return Section(title="", blocks=(pictures,))


def _residual_of_fit(measurement: Measurement) -> Iterable[Section]:
    if measurement.images.residual is not None:
        residual = Picture(
            png=residual_picture(measurement.images.residual),
            caption="Twice the residual of the fit over the light; at 0, 45, 90, 135 deg, the difference between the "
            "sums of orthogonal pairs. It is 0 for any light: structure in it is a fault of the run.",
        )
        yield Section(title="Fit residual", blocks=(residual,))


def _disagreements(comparison: Comparison) -> Iterable[Section]:
    if comparison.disagreements:
        worst = disagreeing(comparison, _SHOWN_DISAGREEMENTS)
        text = f"The {len(worst)} largest of {len(comparison.disagreements)}; the tables below list all."
        yield Section(title="Disagreements", blocks=(mixed_row_table(worst), text))


def _attributed(comparison: Comparison) -> Iterable[Section]:
    """Yield which inputs would explain the residuals; folded where all agrees, or where the verdict names a cause."""
    attribution = comparison.attribution
    if attribution is None:
        return
    method = (
        f"{attribution.remark[:1].upper()}{attribution.remark[1:]}. Chi-square of the residuals: "
        f"{attribution.chi_square:.1f} with {attribution.degrees_of_freedom} degrees of freedom, "
        f"{p_value(attribution.p_value)}, in the errors of measurement and inputs together. The table moves each "
        "input alone until it removes as much of the residuals as it can. It shows the move in standard uncertainties "
        "of the input; a score, which is standard normal if nothing is wrong; the p-value of the remaining residuals; "
        "the share of its stated variance that these data resolve; and inputs whose effect cannot be distinguished."
    )
    details: tuple[Block, ...] = (method,)
    if attribution.moves:
        details += (move_table(attribution),)
    if attribution.unseen:
        details += (("The data do not depend on " + ", ".join(attribution.unseen) + "."),)
    fitted = (
        "These values are FITTED to this run; nothing else measured them. All inputs are updated at once (Bayesian "
        "linear update), each constrained by its stated uncertainty. Do not compare this run with them."
    )
    details += (fitted, fitted_table(attribution))
    explains = attribution.best is not None and attribution.best.removes
    is_open = bool(comparison.disagreements) and (explains or not likeliest_cause(comparison))
    yield Section(title="Possible causes of the residuals", blocks=details, folded=not is_open, printed=is_open)


def _both_sides_section(comparison: Comparison, measurement: Measurement) -> Iterable[Section]:
    if not comparison.predictions:
        return
    if any(row.z is not None for row in comparison.rows):
        scores = Picture(
            png=scores_png(comparison),
            caption="Each tested number of a region: difference over the standard error of both sides. Numbers of one "
            "region share pixels and inputs and are not independent.",
        )
        yield Section(title="Standard scores", blocks=(scores,))
    bars = Picture(
        png=channel_bars(comparison.rows, unit=measurement.grid.unit),
        caption="Mean and deviation of the counts behind each polarizer angle (compare [MK14] Fig. 7). Error bars: one "
        "standard error of both sides.",
    )
    yield Section(title="Counts by channel", blocks=(bars,))
    laws = Picture(
        png=histograms(measurement, comparison.predictions),
        caption="Pixels of one cycle, and the exact laws that the model predicts (compare [MK14] Fig. 8).",
    )
    yield Section(title="Histograms", blocks=(laws,))


def _trends(comparison: Comparison) -> Iterable[Section]:
    if comparison.trends:
        note = (
            "Compares the order of numbers, not their size. The order of a pair is known if it differs by more than "
            "two standard errors on both sides. The trend is predicted if every known pair is in order. Chance is the "
            "probability of such an order by accident; a few numbers are weak evidence."
        )
        yield Section(title="Trends", blocks=(trend_table(comparison.trends), note))


def _uncertainty(comparison: Comparison) -> Iterable[Section]:
    known = {region: parts for region, parts in comparison.budgets.items() if parts}
    if not known:
        return
    picture = Picture(
        png=budget_bars(known),
        caption="Standard uncertainty of each region's mean by cause, to first order; the bar on top is all of them "
        "together. S0 as a share of itself.",
    )
    yield Section(
        title="Uncertainty budget",
        blocks=(picture, "Of DoLP, in numbers:", budget_table(known, "dolp")),
    )


def _effects(effects: NumericalAccuracy | None) -> Iterable[Section]:
    if effects is None:
        return
    note = (
        "The largest change from leaving an effect out: absolute for DoLP, s1 and s2, relative for the counts. An "
        "effect is called for if leaving it out could cost more than half of the numerical tolerance. A comparison "
        "takes every effect behind the lens and those of the light that are called for, except those left out by "
        "--without."
    )
    yield Section(title="Effects taken and skipped", blocks=(taken_table(effects), note))


def _by_itself(comparison: Comparison) -> Iterable[Section]:
    blocks: tuple[Block, ...] = (check_table(comparison.checks),)
    found = comparison.run.diagnosis
    if found is not None and found.terms:
        blocks += (
            (
                "More than three angles leave a residual, to which all faults are fitted at once; those that explain "
                f"it best come first. {UNSEEN[:1].upper()}{UNSEEN[1:]}."
            ),
            fault_table(found.terms),
        )
    yield Section(title="The run by itself", blocks=blocks)


def _strength(comparison: Comparison) -> Iterable[Section]:
    performance = comparison.performance
    strength = (
        "By the model, for single pixels of one cycle: quantiles of DoLP by its exact law; the method for mean and "
        "deviation of DoLP, with its estimated error; NEDoLP, the deviation of DoLP that unpolarized "
        "light of this intensity would show by temporal noise."
    )
    blocks: tuple[Block, ...] = (strength, strength_table(comparison.predictions, performance))
    if any(found is not None and found.nedolp is None for found in performance.strengths.values()):
        blocks += (f"NEDoLP is not known: {NO_NOISE}.",)
    detection = detection_table(performance)
    if detection.rows:
        text = (
            "Probability of detection by RX on Stokes parameters ([MK14] eq. 30), exact law, at a probability of false "
            "alarm of:"
        )
        blocks += (text, detection)
    yield Section(title="Strength of polarization, and detection", blocks=blocks)


def _numbers(comparison: Comparison, measurement: Measurement) -> Iterable[Section]:
    meanings = "; ".join(f"{name}: {text}" for name, text in STATISTICS.items())
    yield Section(
        title="All numbers",
        blocks=(
            (
                f"Counts and Stokes parameters in {measurement.grid.unit}, dark level taken off. ratio_ANGLE: "
                f"counts behind an angle over the mean of all. Deviations: {meanings}. Detectable: the smallest "
                "difference that the test finds with a probability of 90 %. Rows without a verdict are not "
                "tests: their prediction uses the measured number itself."
            ),
        ),
    )
    for name in measurement.regions:
        rows = [row for row in comparison.rows if row.region == name]
        yield Section(title=f"Numbers of {name}", blocks=(row_table(rows),), folded=True)


def _limits_section(comparison: Comparison) -> Iterable[Section]:
    yield Section(title="Not tested here", blocks=(comparison.not_tested,))
    if comparison.remarks:
        yield Section(title="Assumed, overruled, left out", blocks=(comparison.remarks,))


def _calibration(noise: NoiseParameters | None) -> Iterable[Section]:
    if noise is not None:
        yield Section(title="Calibration used", blocks=(parameter_table(noise),))


def _sources(comparison: Comparison) -> Iterable[Section]:
    yield Section(title="Source of the frames", blocks=(source_table(comparison), _MODEL))
    provenance = Verbatim(json.dumps(provenance_json(comparison), indent=2))
    yield Section(title="Provenance in full", blocks=(provenance,), folded=True, printed=False)


def light_section(lights: Mapping[str, FieldLight]) -> Section:
    """Return the section on the parts of the light of regions."""
    text = (
        "Radiance at the aperture in W m-2 sr-1 in band, as the model has it: S1 = horizontal - vertical, S2 = (+45) - "
        "(-45). Reflected light is given as it arrives at the camera; path is light that the air in front of the "
        "target adds."
    )
    picture = Picture(png=light_figure(lights), caption="Parts of the light at the aperture; the stroke is the total.")
    return Section(title="Parts of the light", blocks=(text, share_table(lights), picture))


def comparison_files(comparison: Comparison) -> dict[str, Content]:
    """Return numbers and reports of a comparison as files."""
    report = comparison_report(comparison)
    return {
        "prediction.json": prediction_json(comparison.predictions, comparison.performance, remarks=comparison.remarks),
        "measurement.json": measurement_json(comparison.measurement),
        "comparison.json": compared_json(comparison),
        "comparison.csv": row_table(comparison.rows),
        "report.html": report,
        "report.pdf": report,
    }


_LIBRARIES = ("numpy", "scipy", "matplotlib", "opencv-contrib-python-headless", "reportlab")


def provenance_json(found: Comparison) -> dict[str, Json]:
    """Return the provenance of a comparison as JSON, without absolute paths."""
    run = found.measurement.run
    named = {
        "program": f"rigctl {VERSION}",
        "run": {"path": str(run.path), "created_by": run.created_by, "created_utc": run.created_utc},
        "files": found.files,
        "settings": {"alpha": found.alpha, "scale": "absolute" if found.scale is None else found.scale.kind},
        # Last digits and single pixels may depend on these.
        "machine": {name: version(name) for name in _LIBRARIES}
        | {"python": platform.python_version(), "processor": platform.machine()},
        "session": run.session_json,
    }
    return dict(relative_paths(named))


def relative_paths(content: Any) -> Any:
    """Return the content of a report without absolute paths; without folders and personal values if anonymous."""

    def value(key: str, one: Json) -> Json:
        return LEFT_OUT if is_anonymous() and one is not None and is_personal(key) else one

    return rewritten(content, text=_relative_path, value=value)


def _relative_path(text: str) -> str:
    if is_anonymous() and "/" in text and "\n" not in text and "://" not in text:
        return PurePath(text).name
    if text.startswith("/") and "\n" not in text and len(text) < os.pathconf("/", "PC_PATH_MAX"):
        return os.path.relpath(text)
    return text


def source_table(found: Comparison) -> Table[tuple[str, str]]:
    """Return the source of the frames and their settings, for people."""
    measurement, grid = found.measurement, found.measurement.grid
    first = grid.records[0][0]
    exposures = "not known" if grid.exposures_s is None else ", ".join(f"{1000 * t:g}" for t in grid.exposures_s)
    facts = {
        "run": relative_paths(str(measurement.run.path)),
        "frames come from": measurement.run.session.origin or "not stated",
        "camera": f"{first.camera_model or 'not known'}, serial number {_serial(first.camera_serial)}",
        "stage": f"{first.stage_model or 'not known'}, serial number {_serial(first.stage_serial)}",
        "polarizer angles, measured [deg]": ", ".join(f"{a:.3f}" for a in np.degrees(grid.polarizer_angles_rad)),
        "extinction ratio of the polarizer": f"{measurement.extinction_ratio:g}",
        "cycles": str(grid.cycles),
        "exposure [ms]": exposures,
        "dark level": measurement.frames.dark_level.source,
        "saturated pixels in the picture": str(int(measurement.frames.saturated.sum())),
        "missing pixels in the picture": str(int(measurement.frames.missing.sum())),
        "first frame": first.start_utc or "not known",
    }
    return Table(columns=text_columns("what", "which", left=(0, 1), wide=1), rows=tuple(facts.items()))


def _serial(text: str | None) -> str:
    return LEFT_OUT if is_anonymous() else text or "not known"
