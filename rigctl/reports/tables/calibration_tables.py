"""Calibrations as tables: numbers of the noise and of the polarizer, and the EMVA 1288 summary sheet."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from calibration.estimate import Estimate
from calibration.polarimeter.analyzer import DataReduction, Harmonic
from calibration.sensor.emva1288 import EMVA_SYMBOLS, EmvaFigure
from calibration.sensor.noise import NoiseCalibration, not_known
from rigctl.calibrations.polarizer.polarizer_calibration import PolarizerCalibration
from rigctl.calibrations.polarizer.polarizer_json import HARMONIC_MEANING
from rigctl.reports.table import Column, Shown, Table, text_columns

_BEST, _STANDARD = "best", "EMVA 1288"
_NOT_KNOWN = "not known"
# Digits of a number without an error, and from where on powers of ten are written.
_MOST_DIGITS, _LARGE, _THOUSAND = 6, 1e6, 1e3
# Title, unit, factor from the file's unit to this one, key of the best number, key of the standard's.
_ROWS: tuple[tuple[str, str, float, str | None, str | None], ...] = (
    ("gain", "DN/e-", 1.0, "gain_dn_per_e", "gain_dn_per_e"),
    ("quantum efficiency", "%", 100.0, "quantum_efficiency", "quantum_efficiency"),
    ("responsivity", "DN/photon", 1.0, None, "responsivity_dn_per_photon"),
    ("read noise", "e-", 1.0, "read_noise_e", "temporal_dark_noise_e"),
    ("dark noise, 1/12 DN^2 in it", "DN", 1.0, None, "temporal_dark_noise_dn"),
    ("black level", "DN", 1.0, "black_level_dn", None),
    ("absolute sensitivity threshold", "e-", 1.0, "threshold_e", "threshold_e"),
    ("absolute sensitivity threshold", "photons", 1.0, None, "threshold_photons"),
    ("saturation", "e-", 1.0, "saturation_e", "saturation_e"),
    ("saturation", "photons", 1.0, None, "saturation_photons"),
    ("dynamic range", "", 1.0, "dynamic_range", "dynamic_range"),
    ("largest SNR", "", 1.0, "snr_max", "snr_max"),
    ("linearity error, lowest", "%", 100.0, None, "linearity_error_min"),
    ("linearity error, highest", "%", 100.0, None, "linearity_error_max"),
    ("dark current by mean", "e-/s", 1.0, "dark_current_e_per_s", "dark_current_mean_e_per_s"),
    ("dark current by variance", "e-/s", 1.0, "dark_current_variance_e_per_s", "dark_current_variance_e_per_s"),
    ("DSNU", "e-", 1.0, "dsnu_e", "dsnu_e"),
    ("DSNU of rows", "e-", 1.0, None, "dsnu_row_e"),
    ("DSNU of columns", "e-", 1.0, None, "dsnu_column_e"),
    ("DSNU of pixels", "e-", 1.0, None, "dsnu_pixel_e"),
    ("PRNU", "%", 100.0, "prnu", "prnu"),
    ("PRNU of rows", "%", 100.0, None, "prnu_row"),
    ("PRNU of columns", "%", 100.0, None, "prnu_column"),
    ("PRNU of pixels", "%", 100.0, None, "prnu_pixel"),
)
_TextRow = tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class CalibrationRow:
    """A quantity with its numbers as text, each to the digits that its error allows.

    Attributes
    ----------
    title, unit : str
        What it is called, and its unit.
    value, error, frames : str
        What the model uses, its standard error, and from how many frames; empty where only the standard has it.
    emva_value, emva_error, emva_frames, symbol : str
        The same of EMVA 1288, and its symbol; empty where the standard has none.
    """

    title: str
    unit: str
    value: str
    error: str
    frames: str
    emva_value: str
    emva_error: str
    emva_frames: str
    symbol: str


_COLUMNS: tuple[Column[CalibrationRow], ...] = (
    Column(title="quantity", text=lambda row: row.title, left=True),
    Column(title="value", text=lambda row: row.value, group=_BEST),
    Column(title="std error", text=lambda row: row.error, group=_BEST),
    Column(title="frames", text=lambda row: row.frames, group=_BEST, shown=Shown.PAGE),
    Column(title="symbol", text=lambda row: row.symbol, group=_STANDARD, shown=Shown.PAGE),
    Column(title="value", text=lambda row: row.emva_value, group=_STANDARD, shown=Shown.PAGE),
    Column(title=_STANDARD, text=lambda row: row.emva_value, shown=Shown.TERMINAL),
    Column(title="std error", text=lambda row: row.emva_error, group=_STANDARD),
    Column(title="frames", text=lambda row: row.emva_frames, group=_STANDARD, shown=Shown.PAGE),
    Column(title="unit", text=lambda row: row.unit, left=True),
    Column(title="frames", text=lambda row: row.frames or row.emva_frames, shown=Shown.TERMINAL),
)
_SHEET_COLUMNS: tuple[Column[CalibrationRow], ...] = (
    Column(title="quantity", text=lambda row: row.title, left=True),
    Column(title="symbol", text=lambda row: row.symbol, left=True),
    Column(title="value", text=lambda row: row.emva_value),
    Column(title="std error", text=lambda row: row.emva_error),
    Column(title="unit", text=lambda row: row.unit, left=True),
)


def calibration_table(rows: list[CalibrationRow]) -> Table[CalibrationRow]:
    """Return the numbers of a calibration, the standard's beside the best ones."""
    return Table(columns=_COLUMNS, rows=tuple(rows))


def sheet_table(rows: list[CalibrationRow]) -> Table[CalibrationRow]:
    """Return the numbers that the standard's summary sheet has."""
    return Table(columns=_SHEET_COLUMNS, rows=tuple(row for row in rows if row.symbol))


def calibration_rows(noise: NoiseCalibration) -> list[CalibrationRow]:
    """Return the numbers of a calibration."""
    return [_row(noise, *row) for row in _ROWS]


def unknown_lines(noise: NoiseCalibration) -> list[str]:
    """Return a line for each number that is not known: why, and what would tell."""
    reasons = not_known(noise)
    titles: dict[str, list[str]] = {}
    for title, _, _, key, emva_key in _ROWS:
        for name in (key, emva_key):
            if name is not None and name in reasons and title not in titles.setdefault(reasons[name], []):
                titles[reasons[name]].append(title)
    return [f"not known: {', '.join(words)}: {reason}" for reason, words in titles.items() if words]


def _row(
    noise: NoiseCalibration, title: str, unit: str, factor: float, key: str | None, emva_key: str | None
) -> CalibrationRow:
    best = None if key is None else _best(noise, key)
    value, error, frames = ("", "", "") if key is None else _cells(best, factor)
    if key is not None and best is None and (bound := noise.bounds.get(key)) is not None:
        value = f"{bound.bound} {_brief(factor * bound.value)}"
    standard = None if emva_key is None else noise.emva1288[emva_key]
    emva_value, emva_error, emva_frames = ("", "", "") if emva_key is None else _cells(standard, factor)
    if standard is not None and standard.bound is not None:
        emva_value, emva_error = f"{standard.bound} {_brief(factor * standard.value)}", ""
    return CalibrationRow(
        title=title,
        unit=unit,
        value=value,
        error=error,
        frames=frames,
        emva_value=emva_value,
        emva_error=emva_error,
        emva_frames=emva_frames,
        symbol="" if emva_key is None or standard is None else EMVA_SYMBOLS[emva_key],
    )


def _best(noise: NoiseCalibration, key: str) -> Estimate | None:
    found: Estimate | None = getattr(noise if hasattr(noise, key) else noise.performance, key)
    return found


def _cells(found: Estimate | EmvaFigure | None, factor: float) -> tuple[str, str, str]:
    """Return value and standard error to two digits of the error, and the number of frames."""
    if found is None:
        return _NOT_KNOWN, "", ""
    value = factor * found.value
    if not found.std_error:
        return f"{value:.4g}", "", str(found.n)
    error = factor * found.std_error
    digits = min(1 - _exponent(error), _MOST_DIGITS - 1 - _exponent(value) if value else _MOST_DIGITS)
    return _rounded(value, digits), _rounded(error, digits), str(found.n)


def _rounded(number: float, digits: int) -> str:
    """Return a number to so many digits after the point; below 0, to so many before it."""
    rounded = round(number, digits)
    return _brief(rounded) if abs(rounded) >= _LARGE else f"{rounded:.{max(digits, 0)}f}"


def _brief(number: float) -> str:
    return f"{number:.3g}" if not _LARGE > abs(number) >= _THOUSAND else f"{float(f'{number:.3g}'):.0f}"


def _exponent(number: float) -> int:
    return int(f"{number:.1e}".partition("e")[2])


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
