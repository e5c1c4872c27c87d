"""The tables of a comparison beside its rows: regions in short, trends, checks, uncertainty budget."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rigctl.comparison.checks import Check
from rigctl.comparison.comparison import Comparison
from rigctl.comparison.rows import Row
from rigctl.comparison.trends import Trend
from rigctl.comparison.uncertainty_budget import RegionBudget
from rigctl.measurement.measurement import Measurement
from rigctl.reports.table import NOTHING, Column, Table
from rigctl.reports.tables.row_table import measured_text, predicted_text

# Heading, quantity and unit of the means that stand first.
_SUMMARY = (("DoLP", "dolp", ""), ("AoLP", "aolp_deg", " [deg]"), ("DoLP SNR", "dolp_snr", ""))
# No number of a report is known so well.
_ROUNDING = 1e-12


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
        Column(title="chance", text=lambda found: f"{found.order.p_value:.2g}"),
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
        Column(title="all", text=lambda found: f"{np.linalg.norm(list(found.parts[quantity].values())):.1e}"),
    )
    return Table(columns=columns, rows=tuple(found for found in budgets if quantity in found.parts))


def _trend(found: Trend) -> str:
    return {True: "predicted", False: "NOT predicted", None: "not known"}[found.predicted]


def _share(found: RegionBudget, quantity: str, cause: str) -> str:
    """Return a part of a budget; what is left of rounding is nothing."""
    std = found.parts[quantity].get(cause, 0.0)
    return f"{std:.1e}" if std > _ROUNDING else "0"


def disagreeing(comparison: Comparison, most: int) -> list[Row]:
    """Return the rows that disagree, the farthest first."""
    return sorted(comparison.disagreements, key=lambda row: -abs(row.z or 0.0))[:most]
