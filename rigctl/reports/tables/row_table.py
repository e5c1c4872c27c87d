"""The rows of a comparison, wherever they are shown: report, terminal, CSV and JSON take their columns from here."""

from collections.abc import Iterable
from dataclasses import replace

from rigctl.comparison.rows import Row, error_of_both
from rigctl.numbers.number_text import NOTHING, signed, to_digits
from rigctl.reports.table import Column, Shown, Table

# No error of a report is so small but by rounding.
_ROUNDING = 1e-12
_VERDICTS = {True: "agrees", False: "DISAGREES", None: "no test"}


def error_of(row: Row) -> float:
    """Return the standard error of both sides together."""
    return error_of_both(row)


def predicted_text(row: Row) -> str:
    """Return the prediction to the digits that the errors allow."""
    return to_digits(row.predicted, error_of(row))


def measured_text(row: Row) -> str:
    """Return the measured number to the digits that the errors allow."""
    return to_digits(row.measured, error_of(row))


def _with_region(row: Row) -> str:
    return f"{row.region}: {row.quantity}"


def _two_digits(number: float | None) -> str:
    if number is None:
        return NOTHING
    return f"{number:.2g}" if abs(number) > _ROUNDING else "0"


# A report has a table for each region, and both scores; the terminal is narrow. Keys are those of `Row`.
ROW_COLUMNS: tuple[Column[Row], ...] = (
    Column(title="region", key="region", left=True, shown=Shown.TERMINAL | Shown.PROGRAMS),
    Column(title="quantity", key="quantity", left=True),
    Column(title="statistic", key="statistic", left=True),
    Column(title="predicted", key="predicted", text=predicted_text, brief=lambda row: f"{row.predicted:.6g}"),
    Column(title="measured", key="measured", text=measured_text, brief=lambda row: f"{row.measured:.6g}"),
    Column(
        title="error, measured",
        key="std_error",
        text=lambda row: _two_digits(row.std_error),
        shown=Shown.PAGE | Shown.PROGRAMS,
    ),
    Column(
        title="error, inputs",
        key="std_error_inputs",
        text=lambda row: _two_digits(row.std_error_inputs),
        shown=Shown.PAGE | Shown.PROGRAMS,
    ),
    Column(
        title="z, measured",
        key="z_measurement",
        text=lambda row: signed(row.z_measurement),
        shown=Shown.PAGE | Shown.PROGRAMS,
    ),
    Column(title="z, both", key="z", text=lambda row: signed(row.z), shown=Shown.PAGE | Shown.PROGRAMS),
    Column(title="z", text=lambda row: "" if row.z is None else f"{row.z:+.1f}", shown=Shown.TERMINAL),
    Column(
        title="verdict",
        key="agrees",
        text=lambda row: _VERDICTS[row.agrees],
        left=True,
        shown=Shown.PAGE | Shown.PROGRAMS,
    ),
    Column(
        title="seen at 90 %",
        key="smallest_difference_90",
        text=lambda row: _two_digits(row.smallest_difference_90),
        shown=Shown.PAGE | Shown.PROGRAMS,
    ),
)


def row_table(rows: Iterable[Row]) -> Table[Row]:
    """Return rows with both errors, both scores and the verdict."""
    return Table(columns=ROW_COLUMNS, rows=tuple(rows), is_off=_disagrees)


def mixed_row_table(rows: Iterable[Row]) -> Table[Row]:
    """Return rows of several regions for a page, each with its region."""
    columns = tuple(
        replace(column, text=_with_region) if column.key == "quantity" else column for column in ROW_COLUMNS
    )
    return Table(columns=columns, rows=tuple(rows), is_off=_disagrees)


def numbers_columns() -> tuple[Column[Row], ...]:
    """Return the columns beside those that name the number."""
    return tuple(column for column in ROW_COLUMNS if column.key not in ("region", "quantity", "statistic"))


def _disagrees(row: Row) -> bool:
    return row.agrees is False
