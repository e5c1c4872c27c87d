"""Pictures of a study: which input deserves a measurement."""

from collections.abc import Callable, Sequence
from typing import Any

from matplotlib.axes import Axes

from rigctl.reports.figures.figure_style import MEASURED, PREDICTED, png, subplots
from rigctl.study.sensitivity import MorrisEffect, SobolIndex

# More panels than this no one reads; the tables have all.
_MOST_PANELS = 12
_COLUMNS = 3
_INCHES_A_BAR = 0.32


def sobol_figure(rows: Sequence[SobolIndex]) -> bytes:
    """Return bars of first and total index for each number, a panel each, at most twelve."""

    def draw(ax: Axes, found: Sequence[SobolIndex]) -> None:
        for shift, color, label, key in ((-0.2, PREDICTED, "alone", "first"), (0.2, MEASURED, "with others", "total")):
            ends = [_to_limits(row, key) for row in found]
            _bars(ax, found, key, shift=shift, color=color, label=label, ends=ends)
        ax.set_xlim(min(0.0, ax.get_xlim()[0]), max(1.0, ax.get_xlim()[1]))
        ax.set_xlabel("share of the variance")

    return _panels(rows, draw, by="total")


def _to_limits(row: SobolIndex, key: str) -> tuple[float, float]:
    """From an index down to its lower limit and up to its upper one."""
    value = getattr(row, key)
    return max(value - getattr(row, f"{key}_low"), 0.0), max(getattr(row, f"{key}_high") - value, 0.0)


def morris_figure(rows: Sequence[MorrisEffect]) -> bytes:
    """Return bars of the mean size of effects and of their deviation for each number, a panel each, at most twelve."""

    def draw(ax: Axes, found: Sequence[MorrisEffect]) -> None:
        _bars(ax, found, "mean_size", shift=-0.2, color=PREDICTED, label="mean size")
        _bars(ax, found, "deviation", shift=0.2, color=MEASURED, label="deviation: bent, or joint")
        ax.set_xlabel(f"effect on {found[0].number.quantity}")

    return _panels(rows, draw, by="mean_size")


def _bars(
    ax: Axes,
    found: Sequence[Any],
    key: str,
    *,
    shift: float,
    color: str,
    label: str,
    ends: Sequence[tuple[float, float]] = (),
) -> None:
    places, values = [k + shift for k in range(len(found))], [getattr(row, key) for row in found]
    ax.barh(places, values, 0.38, color=color, label=label)
    if ends:
        ax.errorbar(values, places, xerr=list(zip(*ends, strict=True)), fmt="none", ecolor="black", capsize=2)


def _panels(rows: Sequence[Any], draw: Callable[[Axes, Sequence[Any]], None], *, by: str) -> bytes:
    """Return a figure with a panel for each number, the input that matters most on top."""
    known = [row for row in rows if not row.reason]
    numbers = list(dict.fromkeys(row.number for row in known))[:_MOST_PANELS]
    inputs = max((sum(row.number == number for row in known) for number in numbers), default=1)
    columns = max(min(_COLUMNS, len(numbers)), 1)
    lines = max(-(-len(numbers) // columns), 1)
    figure, axes = subplots(lines, columns, size=(1.0 + 4.2 * columns, lines * (1.3 + _INCHES_A_BAR * inputs)))
    several = len({number.scene for number in numbers}) > 1
    for ax, number in zip(axes, numbers, strict=False):
        found = sorted((row for row in known if row.number == number), key=lambda row: -getattr(row, by))
        draw(ax, found)
        ax.set_yticks(range(len(found)), [row.input for row in found], fontsize=8)
        ax.invert_yaxis()
        scene = f"{number.scene}\n" if several else ""
        ax.set_title(f"{scene}{number.region}: {number.quantity}", fontsize=9)
    if numbers:
        axes[0].legend(fontsize=8)
    for ax in axes[len(numbers) :]:
        ax.set_axis_off()
    return png(figure)
