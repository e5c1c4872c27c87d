"""A polarizer calibration as tables."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from calibration.polarimeter.data_reduction import DataReduction
from calibration.polarimeter.fourier_fit import Harmonic
from rigctl.calibrations.polarizer.polarizer_calibration import PolarizerCalibration
from rigctl.calibrations.polarizer.polarizer_json import HARMONIC_MEANING
from rigctl.reports.table import Column, Table, text_columns

_TextRow = tuple[str, ...]


def number_table(found: PolarizerCalibration) -> Table[_TextRow]:
    """Return sense, axis offset, diattenuation and extinction."""
    columns = text_columns("quantity", "value", "std error", "unit", left=(0, 3))
    return Table(columns=columns, rows=tuple(_numbers(found)))


def harmonic_table(found: PolarizerCalibration) -> Table[Harmonic]:
    """Return what Malus' law leaves, by cycles a turn."""
    columns: tuple[Column[Harmonic], ...] = (
        Column(title="cycles a turn", text=lambda one: str(one.order), left=True),
        Column(title="amplitude [%]", text=lambda one: f"{100 * one.amplitude:.3f}"),
        Column(title="std error [%]", text=lambda one: f"{100 * one.std_error:.3f}"),
        Column(title="seen", text=lambda one: HARMONIC_MEANING[one.order] if one.is_seen else "no", left=True),
    )
    return Table(columns=columns, rows=found.harmonics)


@dataclass(frozen=True, kw_only=True)
class _Channel:
    stage_deg: float
    axis_deg: tuple[float, float]
    throughput: tuple[float, float]
    diattenuation: tuple[float, float]


def channel_table(found: PolarizerCalibration) -> Table[_Channel]:
    """Return axis, throughput and diattenuation of each stage angle, each with its standard error."""
    columns: tuple[Column[_Channel], ...] = (
        Column(title="stage [deg]", text=lambda one: f"{one.stage_deg:.3f}", left=True),
        Column(title="axis [deg]", text=lambda one: f"{one.axis_deg[0]:.4f}"),
        Column(title="std error", text=lambda one: f"{one.axis_deg[1]:.4f}"),
        Column(title="throughput", text=lambda one: f"{one.throughput[0]:.5f}"),
        Column(title="std error", text=lambda one: f"{one.throughput[1]:.5f}"),
        Column(title="diattenuation", text=lambda one: f"{one.diattenuation[0]:.5f}"),
        Column(title="std error", text=lambda one: f"{one.diattenuation[1]:.5f}"),
    )
    return Table(columns=columns, rows=tuple(_channels(found)))


def region_table(regions: Mapping[str, PolarizerCalibration]) -> Table[tuple[str, PolarizerCalibration]]:
    """Return offset and diattenuation of each region by itself."""
    columns: tuple[Column[tuple[str, PolarizerCalibration]], ...] = (
        Column(title="region", text=lambda row: row[0], left=True),
        Column(title="offset [deg]", text=lambda row: _offset(row[1])[0]),
        Column(title="std error", text=lambda row: _offset(row[1])[1]),
        Column(title="diattenuation", text=lambda row: _diattenuation(row[1])[0]),
        Column(title="std error", text=lambda row: _diattenuation(row[1])[1]),
    )
    return Table(columns=columns, rows=tuple(regions.items()))


def matrix_table(reduction: DataReduction) -> Table[_TextRow]:
    """Return the data reduction matrix, its values with their errors."""
    rows = tuple(
        (name, *(f"{value:+.5f} ± {error:.5f}" for value, error in zip(values, errors, strict=True)))
        for name, values, errors in zip(("S0", "S1", "S2"), reduction.matrix, reduction.std_error, strict=True)
    )
    return Table(columns=text_columns(*[""] * len(rows[0])), rows=rows)


def _numbers(found: PolarizerCalibration) -> Iterable[_TextRow]:
    yield "sense of rotation", f"{found.axis.best.sense:+d}", "", ""
    yield "axis offset", *_offset(found), "deg"
    if found.diattenuation is not None and found.diattenuation_error is not None:
        yield "diattenuation", *_diattenuation(found), ""
    if found.extinction is not None:
        extinction = found.extinction
        upper = "no upper limit" if extinction.upper is None else f"{extinction.upper:.4g}"
        ratio = "not measured" if extinction.ratio is None else f"{extinction.ratio:.4g}"
        yield "extinction ratio", ratio, f"95 %: {extinction.lower:.4g} to {upper}", ""


def _offset(found: PolarizerCalibration) -> tuple[str, str]:
    best = found.axis.best
    return f"{np.degrees(best.offset_rad):.4f}", f"{np.degrees(best.std_error_rad):.4f}"


def _diattenuation(found: PolarizerCalibration) -> tuple[str, str]:
    if found.diattenuation is None or found.diattenuation_error is None:
        return "not measured", ""
    return f"{found.diattenuation:.5f}", f"{found.diattenuation_error:.5f}"


def _channels(found: PolarizerCalibration) -> Iterable[_Channel]:
    channels, stage_rad = found.channels, found.stage_rad
    if channels is None or stage_rad is None:
        return
    for k, angle_rad in enumerate(stage_rad):
        yield _Channel(
            stage_deg=float(np.degrees(angle_rad)),
            axis_deg=(float(np.degrees(channels.axis_rad[k]) % 180.0), float(np.degrees(channels.axis_error_rad[k]))),
            throughput=(float(channels.throughput[k]), float(channels.throughput_error[k])),
            diattenuation=(float(channels.diattenuation[k]), float(channels.diattenuation_error[k])),
        )
