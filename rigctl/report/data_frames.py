"""Numbers as tables of pandas or polars, one per row; these packages are imported on demand."""

import importlib
from collections.abc import Iterable, Mapping
from typing import Any, Literal

from rigctl.measure.measure import MeasuredQuantities
from rigctl.report.table import AnyTable, Column, Shown, Table

Backend = Literal["pandas", "polars"]
BACKENDS = ("pandas", "polars")
Number = tuple[str, str, str, float, float | None]


def optional(name: str) -> Any:
    """Return an optional package."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(f"{name} is not installed; install it with: pip install 'rigctl[notebook]'") from error


def data_frame(table: AnyTable, backend: Backend = "pandas") -> Any:
    """Return the columns of a table for programs as a data frame."""
    if backend not in BACKENDS:
        raise ValueError(f"backend is {backend!r}; allowed are {', '.join(BACKENDS)}")
    columns = {column.key: [column.value_of(row) for row in table.rows] for column in table.shown(Shown.CSV)}
    return optional(backend).DataFrame(columns)


def number_table(numbers: Iterable[Number], *, error: str) -> Table[Number]:
    """Return numbers of regions as rows: region, quantity, statistic, value and its error under a given name."""
    columns: tuple[Column[Number], ...] = (
        Column(key="region", value=lambda number: number[0]),
        Column(key="quantity", value=lambda number: number[1]),
        Column(key="statistic", value=lambda number: number[2]),
        Column(key="value", value=lambda number: number[3]),
        Column(key=error, value=lambda number: number[4]),
    )
    return Table(columns=columns, rows=tuple(numbers))


def measured_numbers(regions: Mapping[str, MeasuredQuantities]) -> Iterable[Number]:
    """Yield every measured number with its standard error."""
    for region, quantities in regions.items():
        for quantity, statistics in quantities.items():
            for statistic, sample in statistics.items():
                yield region, quantity, statistic, sample.value, sample.std_error
