"""Tables of what would explain the residuals of a comparison."""

from rigctl.comparison.input_attribution import FittedInput, InputAttribution, InputMove
from rigctl.reports.number_text import to_digits
from rigctl.reports.table import NOTHING, Column, Table

# More names than this say no more than that an input is hardly seen.
_NAMED = 4
_SHOWN_MOVES = 12


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
    return f"{move.p_value_left:.2g}" + (" (removed)" if move.removes else "")


def _confused(move: InputMove) -> str:
    names = move.indistinguishable_from
    if not names:
        return NOTHING
    return ", ".join(names) if len(names) <= _NAMED else f"{len(names)} others: hardly seen"
