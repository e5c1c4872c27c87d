"""Tables of the numbers of regions, a table a region."""

from collections.abc import Iterable, Mapping
from functools import partial
from math import isfinite
from typing import Any

from rigctl.files.choices import SnrKind
from rigctl.reports.number_text import NO_NUMBER, to_digits
from rigctl.reports.table import Column, Table

_STATISTICS = ("mean", "std", "std_temporal", "std_spatial_mean")
Statistics = Mapping[str, float]


def quantity_tables(regions: Mapping[str, Mapping[str, Statistics]], *, snr: SnrKind = "exact") -> Iterable[Table[Any]]:
    """Return a table for each region: a row a quantity, a column a statistic.

    `snr` says which DoLP SNR is shown; that to first order has a row of its own.
    """
    columns: tuple[Column[tuple[str, Statistics]], ...] = (
        Column(title="quantity", text=lambda row: row[0], left=True),
        *(Column(title=statistic, text=partial(_with_error, statistic=statistic)) for statistic in _STATISTICS),
    )
    for name, quantities in regions.items():
        yield Table(title=name, columns=columns, rows=tuple(_rows(quantities, snr)))


def _rows(quantities: Mapping[str, Statistics], snr: SnrKind) -> Iterable[tuple[str, Statistics]]:
    for name, statistics in quantities.items():
        if name != "dolp_snr" or snr != "first-order":
            yield name, statistics
        if name == "dolp_snr" and snr != "exact" and "first_order" in statistics:
            yield "dolp_snr (first order)", {"mean": statistics["first_order"]}


def _with_error(row: tuple[str, Statistics], statistic: str) -> str:
    statistics = row[1]
    if statistic not in statistics:
        return ""
    error = statistics.get(f"{statistic}_std_error", statistics.get(f"{statistic}_std_error_inputs"))
    value = statistics[statistic]
    if not isfinite(value):
        return NO_NUMBER
    return f"{value:.6g}" if error is None else f"{to_digits(value, error)} ± {to_digits(error, error)}"
