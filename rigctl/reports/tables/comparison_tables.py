"""The tables of a comparison beside its rows: regions in short, trends, checks, faults, budget, inputs, noise."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rigctl.calibrations.checked_values import MeasuredOverFrames
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.comparison.checks import Check
from rigctl.comparison.comparison import Comparison
from rigctl.comparison.input_attribution import FittedInput, InputAttribution, InputMove
from rigctl.comparison.rows import Row
from rigctl.comparison.trends import Trend
from rigctl.comparison.uncertainty_budget import RegionBudget
from rigctl.files.scene_file import NoiseSection
from rigctl.measurement.fault_terms import FaultTerm
from rigctl.measurement.measurement import Measurement
from rigctl.numbers.number_text import NOTHING, chance, signed, size, to_digits
from rigctl.reports.table import Column, Table
from rigctl.reports.tables.row_table import measured_text, predicted_text

# Heading, quantity and unit of the means that stand first.
_SUMMARY = (("DoLP", "dolp", ""), ("AoLP", "aolp_deg", " [deg]"), ("DoLP SNR", "dolp_snr", ""))
# More names than this say no more than that an input is hardly seen.
_NAMED = 4
_SHOWN_MOVES = 12
_Known = tuple[str, MeasuredOverFrames[float]]


@dataclass(frozen=True, kw_only=True)
class _Region:
    name: str
    pixels: int
    rows: tuple[Row, ...]

    @property
    def wrong(self) -> int:
        return sum(row.agrees is False for row in self.rows)

    @property
    def tests(self) -> int:
        return sum(row.agrees is not None for row in self.rows)

    def mean(self, quantity: str) -> Row | None:
        return next((row for row in self.rows if (row.quantity, row.statistic) == (quantity, "mean")), None)


def summary_table(comparison: Comparison, measurement: Measurement) -> Table[_Region]:
    """Return a line a region: DoLP, AoLP and SNR of DoLP on both sides, and how many numbers disagree."""
    columns: tuple[Column[_Region], ...] = (
        Column(title="region", text=lambda region: region.name, left=True),
        Column(title="pixels", text=lambda region: str(region.pixels)),
        *(column for title, quantity, unit in _SUMMARY for column in _both_sides(title, quantity, unit)),
        Column(title="disagree", text=lambda region: f"{region.wrong} of {region.tests}"),
    )
    rows = tuple(
        _Region(name=name, pixels=region.pixels, rows=tuple(row for row in comparison.rows if row.region == name))
        for name, region in measurement.regions.items()
    )
    return Table(columns=columns, rows=rows, is_off=lambda region: region.wrong > 0)


def _both_sides(title: str, quantity: str, unit: str) -> Iterable[Column[_Region]]:
    yield Column(title=f"{title} predicted{unit}", text=partial(_mean, quantity=quantity, text=predicted_text))
    yield Column(title=f"measured{unit}", text=partial(_mean, quantity=quantity, text=measured_text))


def _mean(region: _Region, quantity: str, text: Callable[[Row], str]) -> str:
    row = region.mean(quantity)
    return NOTHING if row is None else text(row)


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
        Column(title="trend", text=_trend, left=True),
    )
    return Table(columns=columns, rows=tuple(trends), is_off=lambda found: found.predicted is False)


def check_table(checks: Sequence[Check]) -> Table[Check]:
    """Return what the run says of itself."""
    columns: tuple[Column[Check], ...] = (
        Column(title="check", text=lambda check: check.name, left=True),
        Column(title="verdict", text=lambda check: check.verdict, left=True),
        Column(title="found", text=lambda check: check.text, left=True, wide=True),
    )
    return Table(columns=columns, rows=tuple(checks), is_off=lambda check: check.verdict in ("flagged", "refused"))


def budget_table(budgets: Sequence[RegionBudget], quantity: str) -> Table[RegionBudget]:
    """Return the standard uncertainty of a quantity by region and cause."""
    causes = list(dict.fromkeys(cause for found in budgets for cause in found.parts.get(quantity, {})))
    columns: tuple[Column[RegionBudget], ...] = (
        Column(title="region", text=lambda found: found.region, left=True),
        *(Column(title=cause, text=partial(_share, quantity=quantity, cause=cause)) for cause in causes),
        Column(title="all", text=lambda found: size(float(np.linalg.norm(list(found.parts[quantity].values()))))),
    )
    return Table(columns=columns, rows=tuple(found for found in budgets if quantity in found.parts))


def _trend(found: Trend) -> str:
    return {True: "predicted", False: "NOT predicted", None: "not known"}[found.predicted]


def _share(found: RegionBudget, quantity: str, cause: str) -> str:
    """Return a part of a budget; what is left of rounding is nothing."""
    return size(found.parts[quantity].get(cause, 0.0))


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
        Column(title="chance of the rest", text=_chance),
        Column(title="seen by the data", text=lambda move: f"{move.seen:.0%}"),
        Column(title="cannot be told from", text=_confused, left=True, wide=True),
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
    return ", ".join(names) if len(names) <= _NAMED else f"{len(names)} others: hardly seen"


def fault_table(terms: Sequence[FaultTerm]) -> Table[FaultTerm]:
    """Return faults with their size, what they move, and what they cannot be told from."""
    columns: tuple[Column[FaultTerm], ...] = (
        Column(title="fault", text=lambda term: term.title, left=True),
        Column(title="size", text=lambda term: _number(term.value)),
        Column(title="error", text=lambda term: _number(term.std_error)),
        Column(title="unit", text=lambda term: term.unit, left=True),
        Column(title="moves DoLP by", text=lambda term: _number(term.dolp_shift)),
        Column(title="AoLP by [deg]", text=lambda term: _number(term.aolp_shift_deg)),
        Column(title="said", text=_said, left=True, wide=True),
    )
    return Table(columns=columns, rows=tuple(terms), is_off=lambda term: term.named)


def _number(value: float | None) -> str:
    return NOTHING if value is None else f"{value:.3g}"


def _said(term: FaultTerm) -> str:
    if not term.testable:
        return f"not testable: {term.reason}"
    found = "found" if term.named else f"not found ({signed(_score(term))} errors)"
    return found + (f"; not to be told from {', '.join(term.confused_with)}" if term.confused_with else "")


def _score(term: FaultTerm) -> float | None:
    return None if term.value is None or not term.std_error else term.value / term.std_error


def parameter_table(noise: NoiseParameters) -> Table[_Known]:
    """Return the numbers of a noise calibration that a comparison used, with their errors."""
    columns: tuple[Column[_Known], ...] = (
        Column(title="noise calibration", text=lambda row: row[0], left=True),
        Column(title="value", text=lambda row: to_digits(row[1].value, row[1].std_error)),
        Column(title="its standard error", text=lambda row: f"{row[1].std_error:.2g}"),
    )
    rows = tuple((name, found) for name in NoiseSection.model_fields if (found := noise.known.get(name)) is not None)
    return Table(columns=columns, rows=rows)
