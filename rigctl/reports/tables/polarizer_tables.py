"""A polarizer calibration as tables."""

from collections.abc import Iterable
from functools import partial
from typing import Any

from rigctl.calibrations.polarizer.polarizer_json import HARMONIC_MEANING
from rigctl.reports.table import Column, Table, text_columns

_Content = dict[str, Any]


def number_table(content: _Content) -> Table[Any]:
    """Return sense, axis offset, diattenuation and extinction."""
    columns = text_columns("quantity", "value", "std error", "unit", left=(0, 3))
    return Table(columns=columns, rows=tuple(_numbers(content)))


def harmonic_table(content: _Content) -> Table[_Content]:
    """Return what Malus' law leaves, by cycles a turn."""
    columns: tuple[Column[_Content], ...] = (
        Column(title="cycles a turn", text=lambda one: str(one["order"]), left=True),
        Column(title="amplitude [%]", text=lambda one: f"{100 * one['amplitude']:.3f}"),
        Column(title="std error [%]", text=lambda one: f"{100 * one['std_error']:.3f}"),
        Column(title="seen", text=lambda one: HARMONIC_MEANING[one["order"]] if one["is_seen"] else "no", left=True),
    )
    return Table(columns=columns, rows=tuple(content["harmonics"]))


def channel_table(content: _Content) -> Table[_Content]:
    """Return axis, throughput and diattenuation of each stage angle."""
    columns: tuple[Column[_Content], ...] = (
        Column(title="stage [deg]", text=lambda one: f"{one['stage_angle_deg']:.3f}", left=True),
        *_with_error("axis [deg]", "axis_deg", digits=4),
        *_with_error("throughput", "throughput", digits=5),
        *_with_error("diattenuation", "diattenuation", digits=5),
    )
    return Table(columns=columns, rows=tuple(content["channels"]))


def region_table(content: _Content) -> Table[_Content]:
    """Return offset and diattenuation of each region by itself."""
    columns: tuple[Column[_Content], ...] = (
        Column(title="region", text=lambda one: str(one["name"]), left=True),
        *_with_error("offset [deg]", "offset_deg", digits=4),
        *_with_error("diattenuation", "diattenuation", digits=5),
    )
    return Table(columns=columns, rows=tuple(content["regions"]))


def matrix_table(reduction: _Content) -> Table[Any]:
    """Return the data reduction matrix, its values with their errors."""
    rows = tuple(
        (name, *(f"{value:+.5f} ± {error:.5f}" for value, error in zip(values, errors, strict=True)))
        for name, values, errors in zip(("S0", "S1", "S2"), reduction["matrix"], reduction["std_error"], strict=True)
    )
    return Table(columns=text_columns(*[""] * len(rows[0])), rows=rows)


def _numbers(content: _Content) -> Iterable[tuple[str, str, str, str]]:
    offset, diattenuation, extinction = (content[name] for name in ("offset_deg", "diattenuation", "extinction_ratio"))
    yield "sense of rotation", f"{content['sense']:+d}", "", ""
    yield "axis offset", f"{offset['value']:.4f}", f"{offset['std_error']:.4f}", "deg"
    if diattenuation is not None:
        yield "diattenuation", f"{diattenuation['value']:.5f}", f"{diattenuation['std_error']:.5f}", ""
    if extinction is not None:
        upper = "no upper limit" if extinction["upper"] is None else f"{extinction['upper']:.4g}"
        ratio = "not measured" if extinction["ratio"] is None else f"{extinction['ratio']:.4g}"
        yield "extinction ratio", ratio, f"95 %: {extinction['lower']:.4g} to {upper}", ""


def _with_error(title: str, key: str, *, digits: int) -> tuple[Column[_Content], Column[_Content]]:
    """Return the columns of a number and of its standard error."""
    return (
        Column(title=title, text=partial(_part, key=key, part="value", digits=digits)),
        Column(title="std error", text=partial(_part, key=key, part="std_error", digits=digits)),
    )


def _part(one: _Content, key: str, part: str, digits: int) -> str:
    if one[key] is None:
        return "not measured" if part == "value" else ""
    return f"{one[key][part]:.{digits}f}"
