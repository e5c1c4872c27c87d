"""Tables of numbers for the terminal."""

from collections.abc import Iterable, Mapping

from rich.table import Table

from rigctl.comparison.rows import Row
from rigctl.reports.number_text import to_digits

_STATISTICS = ("mean", "std", "std_temporal", "std_spatial_mean")


def quantity_tables(regions: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Iterable[Table]:
    """Return a table for each region: a row a quantity, a column a statistic."""
    for name, quantities in regions.items():
        table = Table(title=name, title_justify="left", box=None, pad_edge=False)
        table.add_column("quantity")
        for statistic in _STATISTICS:
            table.add_column(statistic, justify="right")
        for quantity, statistics in quantities.items():
            table.add_row(quantity, *(_with_error(statistics, statistic) for statistic in _STATISTICS))
        yield table


def row_table(rows: Iterable[Row], *, title: str) -> Table:
    """Return a table of rows of a comparison."""
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for column in ("region", "quantity", "statistic"):
        table.add_column(column)
    for column in ("predicted", "measured", "z"):
        table.add_column(column, justify="right")
    for row in rows:
        z = "" if row.z is None else f"{row.z:+.1f}"
        table.add_row(row.region, row.quantity, row.statistic, f"{row.predicted:.6g}", f"{row.measured:.6g}", z)
    return table


def _with_error(statistics: Mapping[str, float], statistic: str) -> str:
    if statistic not in statistics:
        return ""
    error = statistics.get(f"{statistic}_std_error", statistics.get(f"{statistic}_std_error_inputs"))
    value = statistics[statistic]
    return f"{value:.6g}" if error is None else f"{to_digits(value, error)} ± {to_digits(error, error)}"
