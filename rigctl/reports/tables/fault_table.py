"""The table of what a run says of its own faults."""

from collections.abc import Sequence

from rigctl.measurement.run_diagnosis import FaultTerm
from rigctl.reports.number_text import signed
from rigctl.reports.table import NOTHING, Column, Table


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
