"""How much inputs matter to the numbers of a study, as tables for terminal, CSV and JSON."""

from collections.abc import Callable, Sequence
from typing import Any

from rigctl.numbers.number_text import size, to_digits
from rigctl.reports.table import Column, Shown, Table
from rigctl.study.sensitivity import MorrisEffect, SobolIndex

_OF_NUMBER = (
    Column[Any](title="scene", key="scene", value=lambda row: row.number.scene, left=True),
    Column[Any](title="region", key="region", value=lambda row: row.number.region, left=True),
    Column[Any](title="number", key="quantity", value=lambda row: row.number.quantity, left=True),
    Column[Any](title="input", key="input", left=True),
)


def sobol_table(rows: Sequence[SobolIndex]) -> Table[SobolIndex]:
    """Return the shares of variance; of each number the input that makes most stands first."""
    return Table(
        columns=(
            *_OF_NUMBER,
            *_shares("first", "alone"),
            *_shares("total", "with others"),
            Column(title="why none", key="reason", left=True),
        ),
        rows=_ranked(rows, lambda row: row.total),
        title="share of the variance that each input makes, with 95 % limits",
    )


def morris_table(rows: Sequence[MorrisEffect]) -> Table[MorrisEffect]:
    """Return the effects; of each number the input that matters most stands first."""
    return Table(
        columns=(
            *_OF_NUMBER,
            Column(title="mean size", key="mean_size", text=lambda row: size(row.mean_size)),
            Column(title="mean", key="mean", text=lambda row: to_digits(row.mean, row.mean_error)),
            Column(title="+-", key="mean_error", text=lambda row: size(row.mean_error)),
            Column(title="deviation", key="deviation", text=lambda row: size(row.deviation)),
            Column(title="why none", key="reason", left=True),
        ),
        rows=_ranked(rows, lambda row: row.mean_size),
        title="what a step of each input through half of its law does",
    )


def _shares(key: str, title: str) -> tuple[Column[SobolIndex], ...]:
    low, high = f"{key}_low", f"{key}_high"

    def text(row: SobolIndex) -> str:
        limits = f"{getattr(row, low):.2f} to {getattr(row, high):.2f}"
        return "" if row.reason else f"{getattr(row, key):.2f} ({limits})"

    return (
        Column(title=title, key=key, text=text),
        Column(key=low, shown=Shown.PROGRAMS),
        Column(key=high, shown=Shown.PROGRAMS),
    )


def _ranked(rows: Sequence[Any], by: Callable[[Any], float]) -> tuple[Any, ...]:
    numbers = list(dict.fromkeys(row.number for row in rows))
    return tuple(sorted(rows, key=lambda row: (numbers.index(row.number), -by(row) if not row.reason else 0.0)))
