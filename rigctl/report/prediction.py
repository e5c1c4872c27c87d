"""Numbers of regions as tables: with their errors, by uncertain inputs, and what they are worth.

Detection as tables, CSV and JSON: what the RX detector found in a run, and predicted ROC curves.

A sweep as tables for the terminal, as CSV and as JSON.

Figures of a scene: its sky, what its materials reflect, and what the light of its regions is made of.

Predictions without a run as pictures: counts, laws of s1, s2 and DoLP, and sweeps.

Pictures of detection: the map of the RX statistic, and ROC curves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.prediction import LEAST_S0_DN
from model.processing import dolp_studies as normalized_stokes
from model.processing.dolp import pdf
from model.quantities import ORDERED
from rigctl.base.numbers import NO_NUMBER, NOTHING, size, to_digits
from rigctl.prediction.predict import FALSE_ALARM_RATES, STATED_RATES, SWEPT_RATES
from rigctl.report.data_files import csv_rows, json_rows
from rigctl.report.drawing import (
    LINE_STYLES,
    MEASURED,
    PREDICTED,
    DrawnPicture,
    legend_below,
    legend_beside,
    legend_of_all,
    pictures_png,
    png,
    say_beneath,
    subplots,
)
from rigctl.report.light import PARTS, title_lines
from rigctl.report.table import Column, Shown, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

    from model.prediction import PairDetection, PolarizationStrength, RegionPrediction
    from model.scene.field import FieldLight, Source
    from rigctl.comparison.detect import RxOnRun
    from rigctl.console.json_text import Json
    from rigctl.files.choices import RocKind, SnrKind
    from rigctl.prediction.predict import Performance, PredictedUncertainty
    from rigctl.prediction.sweep import Sweep
    from rigctl.scene.reflected_light import ReflectedMaps, SurfaceSheet
    from rigctl.scene.sky_map import SkyMap, SkyOfKind


_STATISTICS = ("mean", "std", "std_temporal", "std_spatial_mean")
Statistics = Mapping[str, float]
# Probabilities at which the law of DoLP is stated.
_QUANTILES = ("DoLP 2.5 %", "median", "97.5 %")
# Pairs of inputs whose errors go together, and the least correlation of them that is shown.
_PAIRS, _WORTH_A_LINE = 6, 0.1
# Of as many inputs as make the uncertainty; the rest is in the JSON.
_SHOWN = 6


def quantity_tables(regions: Mapping[str, Mapping[str, Statistics]], *, snr: SnrKind = "exact") -> Iterable[Table[Any]]:
    """Return a table for each region: a row a quantity, a column a statistic.

    `snr` says which DoLP SNR is shown; that to first order has a row of its own.
    """
    columns: tuple[Column[tuple[str, Statistics]], ...] = (
        Column(title="quantity", text=lambda row: row[0], left=True),
        *(Column(title=statistic, text=partial(_with_error, statistic=statistic)) for statistic in _STATISTICS),
    )
    for name, quantities in regions.items():
        yield Table(title=name, columns=columns, rows=tuple(_rows(quantities, snr)))


def _rows(quantities: Mapping[str, Statistics], snr: SnrKind) -> Iterable[tuple[str, Statistics]]:
    for name, statistics in quantities.items():
        if name != "dolp_snr" or snr != "first-order":
            yield name, statistics
        if name == "dolp_snr" and snr != "exact" and "first_order" in statistics:
            yield "dolp_snr (first order)", {"mean": statistics["first_order"]}


def _with_error(row: tuple[str, Statistics], statistic: str) -> str:
    statistics = row[1]
    if statistic not in statistics:
        return ""
    error = statistics.get(f"{statistic}_std_error", statistics.get(f"{statistic}_std_error_inputs"))
    value = statistics[statistic]
    if not isfinite(value):
        return NO_NUMBER
    return f"{value:.6g}" if error is None else f"{to_digits(value, error)} ± {to_digits(error, error)}"


@dataclass(frozen=True, kw_only=True)
class _Strength:
    region: str
    prediction: RegionPrediction
    found: PolarizationStrength | None


def strength_table(predictions: Mapping[str, RegionPrediction], performance: Performance) -> Table[_Strength]:
    """Return the law of each region's DoLP in a few numbers."""
    columns: tuple[Column[_Strength], ...] = (
        Column(title="region", text=lambda row: row.region, left=True),
        *(Column(title=title, text=partial(_quantile, k=k)) for k, title in enumerate(_QUANTILES)),
        Column(title="NEDoLP", text=_nedolp),
        Column(title="moments by", text=lambda row: row.prediction.dolp_method, left=True),
        Column(title="error", text=lambda row: size(row.prediction.dolp_error)),
    )
    rows = tuple(
        _Strength(region=name, prediction=prediction, found=performance.strengths[name])
        for name, prediction in predictions.items()
    )
    return Table(columns=columns, rows=rows)


def _nedolp(row: _Strength) -> str:
    if row.found is None:
        return NOTHING
    return "not known" if row.found.nedolp is None else f"{row.found.nedolp:.4f}"


def detection_table(performance: Performance) -> Table[PairDetection]:
    """Return the probability of detection of every pair of regions."""
    columns: tuple[Column[PairDetection], ...] = (
        Column(title="target", text=lambda pair: pair.target, left=True),
        Column(title="background", text=lambda pair: pair.background, left=True),
        *(Column(title=f"{rate:g}", text=partial(_detected, k=k)) for k, rate in enumerate(STATED_RATES)),
        Column(title="area under ROC", text=lambda pair: _probability(pair.auc)),
    )
    return Table(columns=columns, rows=tuple(performance.detections))


def _quantile(row: _Strength, k: int) -> str:
    return NOTHING if row.found is None else f"{row.found.quantiles[k]:.4f}"


def _detected(pair: PairDetection, k: int) -> str:
    return _probability(pair.p_detection[k])


def _probability(found: float) -> str:
    return NOTHING if np.isnan(found) else f"{found:.4f}"


def with_input_errors(
    predictions: dict[str, RegionPrediction], found: PredictedUncertainty
) -> dict[str, dict[str, dict[str, float]]]:
    """Return regions as JSON has those of a prediction, with a std_error_inputs beside each number."""
    return {
        region: {
            quantity: statistics
            | {f"{name}_std_error_inputs": found.std_errors[region][quantity][name] for name in statistics}
            for quantity, statistics in prediction.quantities.items()
        }
        for region, prediction in predictions.items()
    }


def input_effects_json(found: PredictedUncertainty) -> dict[str, Json]:
    """Return which input makes how much of the uncertainty, of the means that a user reads first."""
    effects = {
        region: {quantity: dict(found.ranked(region, quantity)) for quantity in ORDERED if quantity in quantities}
        for region, quantities in found.std_errors.items()
    }
    together: list[Json] = [{"inputs": [one, other], "correlation": value} for one, other, value in found.correlations]
    return {
        "uncertain_inputs": list(found.inputs),
        "input_effects": effects,
        "input_correlations": together,
        "input_remarks": list(found.remarks),
    }


def correlation_lines(found: PredictedUncertainty) -> Iterable[str]:
    """Give the inputs whose errors go together, the closest pairs, a line each."""
    for one, other, value in found.correlations[:_PAIRS]:
        if abs(value) >= _WORTH_A_LINE:
            yield f"errors of {one} and {other} go together: correlation {value:+.2f}; the table has each alone"


def input_effect_tables(found: PredictedUncertainty) -> Iterable[Table[str]]:
    """Return a table for each region: the inputs that move its DoLP most, by one standard uncertainty of each."""
    for region in found.std_errors:
        ranked = found.ranked(region, "dolp")[:_SHOWN]
        if not ranked:
            continue
        columns: tuple[Column[str], ...] = (
            Column(title="input", text=str, left=True),
            *(
                Column(title=title, text=partial(_effect, effects=dict(found.ranked(region, quantity))))
                for title, quantity in (("DoLP", "dolp"), ("s1", "s1n"), ("s2", "s2n"), ("S0 DN", "s0"))
            ),
        )
        yield Table(
            title=f"{region}: change by one standard uncertainty of an input, those first that move DoLP most",
            columns=columns,
            rows=tuple(name for name, _ in ranked),
        )


def _effect(name: str, effects: Mapping[str, float]) -> str:
    return f"{effects[name]:+.2g}" if name in effects else "0"


DETECTION_SCHEMA = 1
_Row = tuple[int, str, float, float, float]


@dataclass(frozen=True, kw_only=True)
class RocPoint:
    """A point of the measured and of the predicted ROC."""

    p_false_alarm: float
    threshold: float
    p_detection_predicted: float
    p_detection_measured: float
    band_low: float
    band_high: float
    p_false_alarm_measured: float


_COLUMNS: tuple[Column[RocPoint], ...] = (
    Column(title="P_FA", key="p_false_alarm", text=lambda point: f"{point.p_false_alarm:.1e}"),
    Column(title="threshold", key="threshold", text=lambda point: f"{point.threshold:.2f}"),
    Column(
        title="P_D predicted",
        key="p_detection_predicted",
        text=lambda point: f"{point.p_detection_predicted:.4f}",
        csv=lambda point: repr(point.p_detection_predicted),
    ),
    Column(title="P_D measured", key="p_detection_measured", text=lambda point: f"{point.p_detection_measured:.4f}"),
    Column(key="band_low", shown=Shown.PROGRAMS),
    Column(key="band_high", shown=Shown.PROGRAMS),
    Column(title="95 % band", text=lambda point: f"{point.band_low:.4f} to {point.band_high:.4f}"),
    Column(key="p_false_alarm_measured", shown=Shown.PROGRAMS),
)


def measured_roc_table(found: RxOnRun) -> Table[RocPoint]:
    """Return every point of the curves."""
    return Table(columns=_COLUMNS, rows=tuple(_point(found, k) for k in range(found.p_false_alarm.size)))


def round_roc_table(found: RxOnRun, *, background: str, target: str) -> Table[RocPoint]:
    """Return the points at round false alarm rates."""
    places = np.flatnonzero(np.isin(found.p_false_alarm, FALSE_ALARM_RATES)).tolist()
    rows = tuple(_point(found, k) for k in places)
    return Table(title=f"RX: {target} on {background}", columns=_COLUMNS, rows=rows)


def detection_json(found: RxOnRun, *, background: str, target: str) -> dict[str, Json]:
    """Return the numbers as JSON holds them: points of the curves at round false alarm rates, and the area."""
    return {
        "schema_version": DETECTION_SCHEMA,
        "background": background,
        "target": target,
        "background_pixels": found.n_background,
        "target_pixels": found.n_target,
        "threshold_law": "F law: background estimated from its pixels, tested pixel outside of them",
        "predicted_from": found.predicted_from,
        "band_level": found.band_level,
        "auc_known_background": found.auc,
        "points": json_rows(round_roc_table(found, background=background, target=target)),
        "warnings": list(found.warnings),
    }


def _point(found: RxOnRun, k: int) -> RocPoint:
    return RocPoint(
        p_false_alarm=float(found.p_false_alarm[k]),
        threshold=float(found.threshold[k]),
        p_detection_predicted=float(found.predicted_p_detection[k]),
        p_detection_measured=float(found.empirical_p_detection[k]),
        band_low=float(found.band_low[k]),
        band_high=float(found.band_high[k]),
        p_false_alarm_measured=float(found.empirical_p_false_alarm[k]),
    )


def roc_json(curves: Mapping[RocKind, Sequence[PairDetection]], shape: tuple[int, ...]) -> dict[str, Json]:
    """Return curves by their kind: arrays in the order of the axes, the false alarm probabilities last."""
    return {kind: _kind(found, shape) for kind, found in curves.items()}


def _kind(found: Sequence[PairDetection], shape: tuple[int, ...]) -> dict[str, Json]:
    detected = np.array([one.p_detection for one in found]).reshape(*shape, -1)
    return {
        "target": found[0].target,
        "background": found[0].background,
        "p_false_alarm": found[0].p_false_alarm.tolist(),
        "p_detection": _nested(detected),
        "auc": _nested(np.array([one.auc for one in found]).reshape(shape)),
        "warnings": list(dict.fromkeys(text for one in found for text in one.warnings)),
    }


def _nested(values: Any) -> Any:
    if np.ndim(values):
        return [_nested(part) for part in values]
    return None if np.isnan(values) else float(values)


def roc_csv(curves: Mapping[RocKind, Sequence[PairDetection]]) -> bytes:
    """Return curves as CSV: a row a false alarm probability of a point; the point counts the rows of sweep.csv."""
    rows: list[_Row] = [
        (point, kind, float(rate), float(detected), one.auc)
        for kind, found in curves.items()
        for point, one in enumerate(found)
        for rate, detected in zip(one.p_false_alarm, one.p_detection, strict=True)
    ]
    columns: tuple[Column[_Row], ...] = (
        Column(key="point", value=lambda row: row[0]),
        Column(key="kind", value=lambda row: row[1]),
        Column(key="p_false_alarm", value=lambda row: row[2]),
        Column(key="p_detection", value=lambda row: row[3]),
        Column(key="auc", value=lambda row: row[4]),
    )
    return csv_rows(Table(columns=columns, rows=tuple(rows)))


def roc_table(curves: Mapping[RocKind, Sequence[PairDetection]]) -> Table[tuple[str, PairDetection]]:
    """Return the area under each curve of a single prediction, and a few of its points."""
    rows = tuple((kind, found[0]) for kind, found in curves.items())
    pair = rows[0][1]
    columns: tuple[Column[tuple[str, PairDetection]], ...] = (
        Column(title="vector", text=lambda row: row[0], left=True),
        *(Column(title=f"P_D at {rate:g}", text=_at(rate)) for rate in (1e-4, 1e-3, 1e-2, 1e-1)),
        Column(title="area", text=lambda row: f"{row[1].auc:.6g}"),
    )
    return Table(title=f"ROC of {pair.target} on {pair.background}", columns=columns, rows=rows)


def _at(rate: float) -> Any:
    return lambda row: f"{row[1].p_detection[int(np.argmin(np.abs(row[1].p_false_alarm - rate)))]:.5g}"


FloatArray = NDArray[np.float64]

SWEEP_SCHEMA = 2
# At which the table and the plot show detection.
SHOWN_RATE = 1e-3
# More columns fit no terminal.
_MOST_PAIRS_SHOWN = 3
EXACT_SNR = ("dolp_snr", "mean", "DoLP SNR")
FIRST_ORDER_SNR = ("dolp_snr", "first_order", "DoLP SNR (first order)")


def shown_snr(kind: SnrKind) -> tuple[tuple[str, str, str], ...]:
    """Return quantity, statistic and label of the DoLP SNR that tables and plots show."""
    by_kind = {"exact": (EXACT_SNR,), "first-order": (FIRST_ORDER_SNR,), "both": (EXACT_SNR, FIRST_ORDER_SNR)}
    return by_kind[kind]


def sweep_tables(found: Sweep, *, snr: SnrKind = "exact") -> Iterable[Table[int]]:
    """Return a table for each region: DoLP, its signal-to-noise ratio and S0, a row a point; and one of detection."""
    shown = (("dolp_pixels", "mean", "mean DoLP of pixels"), *shown_snr(snr), ("s0", "mean", "S0 DN"))
    for region in found.regions:
        columns = [(label, found.series(region, quantity, kind)) for quantity, kind, label in shown]
        yield _table(region, found, columns, about=(f"{region}: ",))
    if 0 < len(found.pairs) <= _MOST_PAIRS_SHOWN:
        names = [f"{target} on {background}" for target, background in found.pairs]
        columns = [(name, found.detection(pair, SHOWN_RATE)) for name, pair in zip(names, found.pairs, strict=True)]
        yield _table(f"P_D at P_FA {SHOWN_RATE:g}", found, columns, about=tuple(f"{name}: " for name in names))


def warning_lines(found: Sweep) -> Iterable[str]:
    """Return what is to be said of points of a sweep, each text once with the points that it is of."""
    places: dict[str, list[tuple[int, ...]]] = {}
    for one in found.warnings:
        places.setdefault(one.message, []).append(one.index)
    for message, indices in places.items():
        first = _point_text(found, indices[0])
        more = f" and {len(indices) - 1} more" if len(indices) > 1 else ""
        yield f"warning at {first}{more}: {message}"


def _point_text(found: Sweep, index: tuple[int, ...]) -> str:
    return ", ".join(f"{axis.key} = {axis.values[k]:g}" for axis, k in zip(found.axes, index, strict=True))


def _table(title: str, found: Sweep, series: Sequence[tuple[str, FloatArray]], *, about: tuple[str, ...]) -> Table[int]:
    warned = {
        int(np.ravel_multi_index(one.index, found.shape)) for one in found.warnings if one.message.startswith(about)
    }
    columns: tuple[Column[int], ...] = (
        *_axis_columns(found),
        *(Column(title=label, text=partial(_cell, values=values.ravel())) for label, values in series),
    )
    if warned:
        # Words stand below the tables; a row says that there are some.
        columns = (*columns, Column(title="", text=lambda row: "warning" if row in warned else "", left=True))
    return Table(title=title, columns=columns, rows=tuple(range(math.prod(found.shape))))


def _axis_columns(found: Sweep) -> Iterable[Column[int]]:
    grids = np.meshgrid(*(axis.values for axis in found.axes), indexing="ij")
    for axis, grid in zip(found.axes, grids, strict=True):
        flat = grid.ravel()
        yield Column(title=axis.key, key=axis.key, value=partial(_number, values=flat), text=_general(flat))


def _general(values: FloatArray) -> Callable[[int], str]:
    return lambda row: f"{values[row]:g}"


def _cell(row: int, values: FloatArray) -> str:
    return "-" if math.isnan(values[row]) else f"{values[row]:.5g}"


def sweep_json(found: Sweep, *, remarks: Iterable[str] = ()) -> dict[str, Json]:
    """Return a sweep as JSON holds it: arrays in the order of the axes, null with a reason where there is no number."""
    one = {"key": found.key, "values": found.values.tolist()} if len(found.axes) == 1 else {}
    content = {
        "schema_version": SWEEP_SCHEMA,
        **one,
        "axes": [{"key": axis.key, "values": axis.values.tolist()} for axis in found.axes],
        "regions": {
            region: {
                quantity: {kind: _numbers(found.series(region, quantity, kind)) for kind in kinds}
                for quantity, kinds in _quantities(found, region).items()
            }
            for region in found.regions
        },
        "detection": [
            {"target": pair[0], "background": pair[1]}
            | {"p_detection": {f"{rate:g}": _numbers(found.detection(pair, rate)) for rate in SWEPT_RATES}}
            for pair in found.pairs
        ],
        "warnings": [{"index": list(point.index), "message": point.message} for point in found.warnings],
        "reasons": [
            {"index": list(point.index), "number": point.number, "reason": point.reason} for point in found.missing
        ],
        "remarks": list(remarks),
    }
    return content | ({"roc": roc_json(found.rocs, found.shape)} if found.rocs else {})


def sweep_csv(found: Sweep, *, remarks: Sequence[str] = ()) -> bytes:
    """Return a sweep as CSV: a row a point, a column a number; empty where it does not exist.

    The last columns hold in words what is to be said: of the point, why numbers are missing, and in the first row what
    is to be said of all.
    """
    warnings = _by_row(found, ((one.index, one.message) for one in found.warnings))
    reasons = _by_row(found, ((one.index, f"{one.number}: {one.reason}") for one in found.missing))
    columns: tuple[Column[int], ...] = (
        *_axis_columns(found),
        *(
            Column(key=".".join(name), value=partial(_number, values=found.series(*name).ravel()))
            for name in _names(found)
        ),
        *(
            Column(
                key=f"{pair[0]}_on_{pair[1]}.p_detection.{rate:g}",
                value=partial(_number, values=found.detection(pair, rate).ravel()),
            )
            for pair in found.pairs
            for rate in SWEPT_RATES
        ),
        Column(key="warnings", value=lambda row: "; ".join(warnings.get(row, ()))),
        Column(key="reasons", value=lambda row: "; ".join(reasons.get(row, ()))),
        Column(key="remarks", value=lambda row: "; ".join(remarks) if row == 0 else ""),
    )
    return csv_rows(Table(columns=columns, rows=tuple(range(math.prod(found.shape)))))


def _by_row(found: Sweep, texts: Iterable[tuple[tuple[int, ...], str]]) -> dict[int, list[str]]:
    rows: dict[int, list[str]] = {}
    for index, text in texts:
        rows.setdefault(int(np.ravel_multi_index(index, found.shape)), []).append(text)
    return rows


def _number(row: int, values: FloatArray) -> float:
    return float(values[row])


def _names(found: Sweep) -> Iterable[tuple[str, str, str]]:
    for region in found.regions:
        for quantity, kinds in _quantities(found, region).items():
            yield from ((region, quantity, kind) for kind in kinds)


def _quantities(found: Sweep, region: str) -> dict[str, tuple[str, ...]]:
    """Quantities and statistics that a region has at any point."""
    names: dict[str, dict[str, None]] = {}
    for step in found.quantities:
        for quantity, statistics in step[region].items():
            names.setdefault(quantity, {}).update(dict.fromkeys(statistics))
    return {quantity: tuple(kinds) for quantity, kinds in names.items()}


def _numbers(values: FloatArray) -> Any:
    """Return nested lists in the order of the axes; null where there is no number."""
    if values.ndim > 1:
        return [_numbers(part) for part in values]
    return [None if np.isnan(value) else float(value) for value in values]


# Darker than this nothing is seen; a sky without polarization still needs a scale.
_LEAST = 1e-12
_MOST_COLUMNS = 4
_UNPOLARISED, _POLARISED, _SPECULAR = PREDICTED, MEASURED, "0.45"
# Decades of F00 below its largest value that are shown.
_DECADES_OF_HEMISPHERE, _DECADES_OF_CURVE = 4.0, 8.0
_MARGIN = 1.2
_LEAST_DEGREE = 0.01
# What adds up to the light at the aperture, with its colour.
_SUMMANDS: dict[Source, str] = {"reflected_sun": "#e69f00", "reflected_sky": "#56b4e9", "path": "#999999"}
_COMPONENTS = ("S0", "S1", "S2")


def sky_picture(sky: SkyMap, *, title: Sequence[str] = (), beneath: Sequence[str] = ()) -> bytes:
    """Return S0, S1, S2 and DoLP over the sky as a map: north at the top, east at the right, the horizon outside."""
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 9.6), layout="constrained")
    axes = figure.subplots(2, 2, subplot_kw={"projection": "polar"}).ravel()
    s0, s1, s2 = np.moveaxis(sky.stokes, -1, 0)
    panels = (
        (s0, Normalize(0.0, _largest(s0)), "S0 [W m-2 sr-1]", "viridis"),
        (s1, _even(s1), "S1 [W m-2 sr-1], horizontal - vertical", "RdBu_r"),
        (s2, _even(s2), "S2 [W m-2 sr-1], +45 - (-45) deg", "RdBu_r"),
        (sky.dolp, Normalize(0.0, _largest(sky.dolp)), "DoLP", "magma"),
    )
    azimuth_rad = np.deg2rad(sky.azimuth_deg)
    for ax, (values, norm, label, cmap) in zip(axes, panels, strict=True):
        shown = ax.pcolormesh(azimuth_rad, sky.zenith_deg, values, norm=norm, cmap=cmap, shading="gouraud")
        _finish(ax, sky)
        figure.colorbar(shown, ax=ax, label=label, shrink=0.8)
    figure.suptitle("\n".join([*title, *title_lines(sky)]), fontsize=10)
    say_beneath(figure, beneath)
    return png(figure)


def kinds_picture(found: tuple[SkyOfKind, ...]) -> bytes:
    """Return the degree of polarization of the sky for each kind of aerosol, on one scale."""
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    columns = min(len(found), _MOST_COLUMNS)
    rows = -(-len(found) // columns)
    figure = Figure(figsize=(3.6 * columns + 1.2, 4.1 * rows + 0.6), layout="constrained")
    grid = figure.subplots(rows, columns, subplot_kw={"projection": "polar"}, squeeze=False).ravel()
    norm = Normalize(0.0, max(_largest(one.sky.dolp) for one in found))
    for ax in grid[len(found) :]:
        ax.set_axis_off()
    for ax, one in zip(grid, found, strict=False):
        sky = one.sky
        azimuth_rad = np.deg2rad(sky.azimuth_deg)
        shown = ax.pcolormesh(azimuth_rad, sky.zenith_deg, sky.dolp, norm=norm, cmap="magma", shading="gouraud")
        _finish(ax, sky)
        mark = " (the file)" if one.is_chosen else ""
        ax.set_title(f"{one.label}{mark}\nlargest DoLP {sky.largest_dolp[0]:.3f}", fontsize=9)
    figure.colorbar(shown, ax=grid.tolist(), label="DoLP", shrink=0.6)
    figure.suptitle("\n".join(title_lines(found[0].sky)[:2]), fontsize=10)
    return png(figure)


def _finish(ax: PolarAxes, sky: SkyMap) -> None:
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    ax.set_rlim(0.0, 90.0)
    ax.set_rticks([30.0, 60.0], ["30°", "60°"], fontsize=8)
    ax.set_thetagrids(np.arange(0, 360, 45), ["N", "45", "E", "135", "S", "225", "W", "315"], fontsize=8)
    ax.grid(color="0.5", alpha=0.4, linewidth=0.6)
    ax.plot(
        np.deg2rad(sky.sun_azimuth_deg),
        sky.sun_zenith_deg,
        marker="*",
        markersize=14,
        color="#ffd400",
        markeredgecolor="black",
    )


def _largest(values: FloatArray) -> float:
    return max(float(np.max(values)), _LEAST)


def _even(values: FloatArray) -> Normalize:
    from matplotlib.colors import Normalize

    limit = _largest(np.abs(values))
    return Normalize(-limit, limit)


def surface_picture(sheet: SurfaceSheet, maps: ReflectedMaps) -> bytes:
    """Return F00 and DoLP in the principal plane, and reflectance against the angle of incidence."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.5, 3.9), layout="constrained")
    intensity, polarization, reflectance = figure.subplots(1, 3)
    stokes = maps.curve_stokes
    intensity.semilogy(maps.curve_deg, _positive(stokes[:, 0]), color=_UNPOLARISED)
    intensity.set_ylim(*_shown_range(stokes[:, 0], _DECADES_OF_CURVE))
    intensity.set_ylabel("F00 [1/sr]")
    polarization.plot(maps.curve_deg, _degree(stokes), color=_UNPOLARISED)
    polarization.set_ylabel("DoLP of unpolarised light")
    polarization.set_ylim(-0.02, 1.02)
    for ax in (intensity, polarization):
        _mark_sun(ax, sheet.sun_zenith_deg)
    _draw_reflectance(reflectance, sheet)
    figure.suptitle(_title(sheet))
    return png(figure)


def hemisphere_picture(sheet: SurfaceSheet, maps: ReflectedMaps) -> bytes:
    """Return F00 and DoLP over all directions of the camera, seen from above, the sun's azimuth at the top."""
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    azimuth_rad, stokes = np.deg2rad(maps.azimuth_deg), maps.hemisphere_stokes
    brightness, degree = _positive(stokes[..., 0]), _degree(stokes)
    panels = (
        (brightness, LogNorm(*_shown_range(stokes[..., 0], _DECADES_OF_HEMISPHERE)), "F00 [1/sr]", "viridis"),
        (degree, Normalize(0.0, np.nanmax(degree, initial=_LEAST_DEGREE)), "DoLP of unpolarised light", "magma"),
    )
    axes = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
    for ax, (values, norm, label, cmap) in zip(axes, panels, strict=True):
        shown = ax.pcolormesh(azimuth_rad, maps.zenith_deg, values, norm=norm, cmap=cmap, shading="gouraud")
        _finish_hemisphere(ax, sheet.sun_zenith_deg)
        figure.colorbar(shown, ax=ax, label=label, shrink=0.8, extend="min" if isinstance(norm, LogNorm) else "neither")
    figure.suptitle(_title(sheet))
    return png(figure)


def _draw_reflectance(ax: Axes, sheet: SurfaceSheet) -> None:
    zenith_deg = [given.zenith_deg for given in sheet.reflectance]
    for values, colour, style, label in (
        ([given.total for given in sheet.reflectance], _UNPOLARISED, "-", "unpolarised light"),
        ([given.horizontal for given in sheet.reflectance], _POLARISED, "--", "polarised horizontally"),
        ([given.vertical for given in sheet.reflectance], _POLARISED, ":", "polarised vertically"),
        ([given.specular for given in sheet.reflectance], _SPECULAR, "-.", "unpolarised, specular lobe alone"),
    ):
        ax.plot(zenith_deg, values, style, color=colour, label=label)
    ax.axhline(1.0, color="0.7", linewidth=0.8)
    ax.set_ylim(0.0, 1.05 * max(1.0, *(given.total for given in sheet.reflectance)))
    ax.set_xlabel("angle of incidence [deg]")
    ax.set_ylabel("directional-hemispherical reflectance")
    legend_beside(ax)


def _mark_sun(ax: Axes, sun_zenith_deg: float) -> None:
    for angle, label in ((-sun_zenith_deg, "sun"), (sun_zenith_deg, "mirror direction")):
        ax.axvline(angle, color="0.6", linewidth=0.8, linestyle="--")
        ax.annotate(label, (angle, 0.02), xycoords=("data", "axes fraction"), rotation=90, fontsize=7, ha="right")
    ax.set_xlabel("camera zenith [deg], positive towards the glint")
    ax.set_xlim(-90.0, 90.0)


def _finish_hemisphere(ax: PolarAxes, sun_zenith_deg: float) -> None:
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    ax.set_rlim(0.0, 90.0)
    ax.set_rticks([30.0, 60.0], ["30°", "60°"], color="white", fontsize=8)
    ax.set_rlabel_position(100.0)
    phi_deg = np.arange(0, 360, 45)
    ax.set_thetagrids(phi_deg, [_phi_label(int(angle)) for angle in phi_deg], fontsize=8)
    ax.set_facecolor("0.85")  # where nothing is reflected
    ax.grid(color="white", alpha=0.35, linewidth=0.6)
    ax.plot(0.0, sun_zenith_deg, marker="*", markersize=13, color="#ffd400", markeredgecolor="black")


def _phi_label(clockwise_deg: int) -> str:
    phi_deg = -clockwise_deg if clockwise_deg < 180 else 360 - clockwise_deg
    return {0: "phi 0\n(sun)", 180: "180 (glint)"}.get(phi_deg, f"{phi_deg:+d}")


def _positive(intensity: FloatArray) -> FloatArray:
    return np.asarray(np.where(intensity > 0.0, intensity, np.nan))


def _shown_range(intensity: FloatArray, decades: float) -> tuple[float, float]:
    """Return the ends of a logarithmic axis, which a surface that is black or the same everywhere has too."""
    highest = float(np.max(intensity)) or 1.0
    return max(float(np.min(intensity)), highest * 10.0**-decades) / _MARGIN, highest * _MARGIN


def _degree(stokes: FloatArray) -> FloatArray:
    """DoLP, NaN where nothing is reflected."""
    return np.asarray(np.hypot(stokes[..., 1], stokes[..., 2]) / _positive(stokes[..., 0]))


def _title(sheet: SurfaceSheet) -> str:
    assumed = [given.name for given in sheet.properties if given.assumed]
    note = f"; assumed: {', '.join(assumed)}" if assumed else ""
    return f"{sheet.material} at {sheet.wavelength_nm:g} nm, sun at {sheet.sun_zenith_deg:g} deg{note}"


def light_figure(lights: Mapping[str, FieldLight]) -> bytes:
    """Return the parts of the light of each region as bars, a panel a Stokes parameter; the stroke is the total."""
    figure, axes = subplots(1, 3, size=(11.0, 1.4 + 0.5 * len(lights)))
    names = list(lights)
    for component, ax in enumerate(axes):
        values = {part: np.array([light.mean(part)[component] for light in lights.values()]) for part in _SUMMANDS}
        up, down = np.zeros(len(names)), np.zeros(len(names))
        for part, colour in _SUMMANDS.items():
            # Parts of opposite sign stand on opposite sides of zero.
            left = np.where(values[part] >= 0.0, up, down)
            ax.barh(names, values[part], left=left, color=colour, label=PARTS[part], height=0.6)
            up, down = up + np.maximum(values[part], 0.0), down + np.minimum(values[part], 0.0)
        ax.plot(up + down, names, linestyle="none", marker="|", markersize=16, color="black", label="total")
        ax.axvline(0.0, color="0.3", linewidth=0.8)
        ax.set_xlabel(f"{_COMPONENTS[component]} [W m-2 sr-1]")
        ax.invert_yaxis()
        ax.tick_params(labelleft=component == 0)
    legend_of_all(figure, axes[0], place="upper")
    return png(figure)


_POINTS, _SPAN = 400, 5.0
# Words under a plot: more of them stand in table, CSV and JSON.
_MOST_LINES = 4
_MAP_KEY = "red cross: there is a warning of this point; white: the number does not exist"
# A map with its bar; its margins left, right (with the bar), below and above; and room for words under all of them.
_MAP_INCH, _MAP_MARGINS, _BENEATH_INCH = (5.4, 4.0), (0.75, 1.0, 0.55, 0.35), 1.5
# More numbers than these make no plot.
MOST_AXES = 2


def counts_png(predictions: Mapping[str, RegionPrediction], *, warnings: Sequence[str] = ()) -> bytes:
    """Return mean and deviation of the counts behind each angle, as [MK14] Fig. 7 has them."""
    figure, axes = subplots(1, 2, size=(11.0, 4.4))
    for k, (name, one) in enumerate(predictions.items()):
        counts = {key: value for key, value in one.quantities.items() if key.startswith("dn_")}
        angles = [key.removeprefix("dn_") for key in counts]
        places = np.arange(len(angles)) + 0.8 * (k + 0.5) / len(predictions) - 0.4
        for ax, statistic in zip(axes, ("mean", "std"), strict=True):
            ax.bar(places, [value[statistic] for value in counts.values()], 0.8 / len(predictions), label=name)
            ax.set_xticks(np.arange(len(angles)), angles)
            ax.set_xlabel("angle of the polarizer [deg]")
    axes[0].set_ylabel("mean counts [DN]")
    axes[1].set_ylabel("deviation of the counts over pixels [DN]")
    legend_of_all(figure, axes[0], place="upper")
    say_beneath(figure, warnings)
    return png(figure)


def laws_png(predictions: Mapping[str, RegionPrediction], *, warnings: Sequence[str] = ()) -> bytes:
    """Return the laws of s1, s2 and DoLP of single pixels, as [MK14] Fig. 8b has them, by the exact distributions."""
    figure, axes = subplots(1, 3, size=(14.0, 4.4))
    for (name, one), style in zip(predictions.items(), cycle(LINE_STYLES)):
        if not one.stokes_dn.mean[0] > LEAST_S0_DN:
            continue
        for ax, (x, density) in zip(axes, laws_of(one), strict=True):
            if x.size > 1:
                ax.plot(x, density, style, label=name)
            else:
                ax.plot(np.repeat(x, 2), (0.0, 1.0), style, label=name, transform=ax.get_xaxis_transform())
    for ax, label in zip(axes, ("s1 = S1/S0", "s2 = S2/S0", "DoLP"), strict=True):
        ax.set_xlabel(f"{label} of a pixel")
        ax.set_ylabel("density")
        ax.locator_params(axis="x", nbins=6)
        ax.set_ylim(bottom=0.0)
    legend_of_all(figure, axes[0], place="upper")
    say_beneath(figure, warnings)
    return png(figure)


def laws_of(one: RegionPrediction) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Return abscissa and density of s1, s2 and DoLP of a region's pixels; its S0 is above 0.

    A number that does not fluctuate has no density: its abscissa is the one value that it has.
    """
    mean, cov = one.stokes_dn.mean, one.stokes_dn.cov

    def ratio(x: FloatArray, component: int) -> FloatArray:
        return normalized_stokes.distribution(x, mean, cov, component=component).density

    found = []
    for component, name in ((1, "s1n"), (2, "s2n")):
        value, std = one.quantities[name]["mean"], one.quantities[name]["std"]
        limits = (value - _SPAN * std, value + _SPAN * std)
        found.append(_law(partial(ratio, component=component), limits, value))
    return (*found, _law(lambda x: pdf(x, mean, cov), _dolp_limits(one), one.quantities["dolp"]["mean"]))


def _law(
    density: Callable[[FloatArray], FloatArray], limits: tuple[float, float], value: float
) -> tuple[FloatArray, FloatArray]:
    x = np.linspace(*limits, _POINTS)
    alone = np.array([value]), np.array([np.inf])
    if not limits[0] < limits[1]:
        return alone
    try:
        return x, density(x)
    except ValueError:
        return alone


def _dolp_limits(one: RegionPrediction) -> tuple[float, float]:
    mean, std = one.quantities["dolp"]["mean"], max(one.quantities["s1n"]["std"], one.quantities["s2n"]["std"])
    return max(mean - _SPAN * std, 0.0), mean + _SPAN * std


def sweep_png(found: Sweep, *, snr: SnrKind = "exact", remarks: Sequence[str] = ()) -> bytes:
    """Return DoLP with its deviation, DoLP SNR and detection of all regions over what was swept.

    Over two numbers, the most that there may be, these are maps.
    """
    are_maps = len(found.axes) == MOST_AXES
    figure = _maps(found, snr) if are_maps else _curves(found, snr)
    key = [_MAP_KEY] if are_maps and found.warnings else []
    say_beneath(figure, [*key, *_shortened([*warning_lines(found), *remarks])])
    return png(figure)


def _curves(found: Sweep, snr: SnrKind) -> Figure:
    panels = 3 if found.pairs else 2
    figure, axes = subplots(1, panels, size=(5.0 * panels, 5.8))
    degree, ratio = axes[:2]
    for region, style in zip(found.regions, cycle(LINE_STYLES)):
        mean, std = (found.series(region, "dolp_pixels", kind) for kind in ("mean", "std"))
        (line,) = degree.plot(found.values, mean, style, marker=".", label=region)
        degree.fill_between(found.values, mean - std, mean + std, color=line.get_color(), alpha=0.2, linewidth=0)
        _mark(degree, found, region, mean)
        for quantity, kind, label in shown_snr(snr):
            name = f"{region}, first order" if kind == "first_order" else region
            marker = "x" if "first order" in label else "."
            ratio.plot(found.values, found.series(region, quantity, kind), style, marker=marker, label=name)
    degree.set_ylabel("mean DoLP of pixels; band: deviation")
    ratio.set_ylabel(_snr_label(snr))
    for (target, background), style in zip(found.pairs, cycle(LINE_STYLES)):
        detected = found.detection((target, background), SHOWN_RATE)
        axes[2].plot(found.values, detected, style, marker=".", label=f"{target} on {background}")
        axes[2].set_ylabel(f"P_D at P_FA {SHOWN_RATE:g}")
    for ax in axes:
        ax.set_xlabel(found.key)
        ax.set_ylim(bottom=0.0)
    if found.pairs:
        axes[2].set_ylim(0.0, 1.05)
    for ax in axes[1:]:
        legend_below(ax)
    return figure


def _snr_label(snr: SnrKind) -> str:
    return {"exact": "DoLP SNR of the exact law", "first-order": "DoLP SNR, first order"}.get(snr, "DoLP SNR")


def _mark(ax: Axes, found: Sweep, region: str, values: FloatArray) -> None:
    """Ring the points of a region of which there is something to be said."""
    warned = sorted({one.index[0] for one in found.warnings if one.message.startswith(f"{region}: ")})
    if warned:
        ax.plot(found.values[warned], values[warned], "o", color="#b00000", markersize=9, fillstyle="none")


def _maps(found: Sweep, snr: SnrKind) -> Figure:
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    panels = list(_map_panels(found, snr))
    columns = 2 if len(panels) <= 4 else 3
    rows = -(-len(panels) // columns)
    # Places are counted out, in inches: a layout engine takes longer than the drawing.
    wide, high = _MAP_INCH
    width, height = columns * wide, rows * high + _BENEATH_INCH
    left, right, below, above = _MAP_MARGINS
    figure = Figure(figsize=(width, height))
    first, second = found.axes
    for k, (title, values) in enumerate(panels):
        norm = Normalize(0.0, 1.0 if title.startswith("P_D") else float(np.nanmax(values, initial=1e-12)))
        x, y = (k % columns) * wide + left, height - (k // columns + 1) * high + below
        size = (wide - left - right, high - below - above)
        ax = figure.add_axes((x / width, y / height, size[0] / width, size[1] / height))
        shown = ax.pcolormesh(second.values, first.values, values, shading="nearest", cmap="viridis", norm=norm)
        _cross(ax, found, title)
        ax.set_title(title, fontsize=9)
        ax.set_xlabel(second.key)
        ax.set_ylabel(first.key)
        bar = figure.add_axes(((x + size[0] + 0.15) / width, y / height, 0.14 / width, size[1] / height))
        figure.colorbar(shown, cax=bar)
    return figure


def _cross(ax: Axes, found: Sweep, title: str) -> None:
    """Cross the points of a map of whose region, or regions, there is something to be said."""
    region, _, pair = title.partition(": ")
    named = (region,) if region in found.regions else (*pair.split(" on "), pair)
    starts = tuple(f"{name}: " for name in named)
    warned = sorted({one.index for one in found.warnings if one.message.startswith(starts)})
    first, second = found.axes
    ax.plot([second.values[j] for _, j in warned], [first.values[i] for i, _ in warned], "x", color="#d00000", ms=4)


def _map_panels(found: Sweep, snr: SnrKind) -> Iterable[tuple[str, FloatArray]]:
    for region in found.regions:
        yield f"{region}: mean DoLP of pixels", found.series(region, "dolp_pixels", "mean")
        for quantity, kind, label in shown_snr(snr):
            yield f"{region}: {label}", found.series(region, quantity, kind)
    for pair in found.pairs:
        yield f"P_D at P_FA {SHOWN_RATE:g}: {pair[0]} on {pair[1]}", found.detection(pair, SHOWN_RATE)


def _shortened(lines: Sequence[str]) -> list[str]:
    more = len(lines) - _MOST_LINES
    return [*lines[:_MOST_LINES], *([f"... and {more} more: see sweep.json"] if more > 0 else [])]


# What one background pixel in ten exceeds.
_LEAST_SHOWN = 0.8
# More names than these fit no legend.
_MOST_NAMED = 12


def statistic_picture(found: RxOnRun, *, background: str) -> bytes:
    """Return the map of the statistic on a log scale, from what one background pixel in ten exceeds."""
    values = np.log10(np.maximum(found.statistic, 1e-3))
    picture = DrawnPicture(
        values=values,
        low=_LEAST_SHOWN,
        high=max(float(np.nanmax(values, initial=_LEAST_SHOWN)), _LEAST_SHOWN + 0.1),
        colours="cividis",
        title=f"RX against {background}",
        label="log10 D",
    )
    return pictures_png((picture,))


def roc_plot(found: RxOnRun, *, background: str, target: str) -> bytes:
    """Return the measured ROC with its band and the predicted one on top."""
    figure, axes = subplots(1, 1, size=(6.4, 4.6))
    ax = axes[0]
    ax.fill_between(found.p_false_alarm, found.band_low, found.band_high, color=MEASURED, alpha=0.25, label="95 % band")
    ax.plot(found.p_false_alarm, found.empirical_p_detection, color=MEASURED, label="measured pixels")
    ax.plot(found.p_false_alarm, found.predicted_p_detection, color=PREDICTED, label="predicted, exact law")
    ax.plot(found.p_false_alarm, found.p_false_alarm, color="0.5", linestyle=":", label="chance")
    ax.set_xscale("log")
    ax.set_xlabel("probability of false alarm")
    ax.set_ylabel("probability of detection")
    ax.set_ylim(-0.02, 1.02)
    ax.set_title(f"RX: {target} on {background}")
    legend_beside(ax)
    return png(figure)


def roc_png(curves: Mapping[RocKind, Sequence[PairDetection]], labels: Sequence[str] = ("",)) -> bytes:
    """Return a panel for each kind of vector, a curve for each point; of many a dozen are named, the others grey."""
    from matplotlib import colormaps

    named = np.unique(np.linspace(0, len(labels) - 1, min(len(labels), _MOST_NAMED)).astype(int))
    # Names of many curves stand below, where they hide none.
    figure, axes = subplots(1, len(curves), size=(5.6 * len(curves), 4.4 + 0.16 * len(named) * (len(labels) > 1)))
    for ax, (kind, found) in zip(axes, curves.items(), strict=True):
        colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(found)))
        for k, (one, label, colour) in enumerate(zip(found, labels, colours, strict=True)):
            if k in named:
                name = f"{label} (area {one.auc:.4f})".strip()
                ax.plot(one.p_false_alarm, one.p_detection, color=colour, label=name, linewidth=1.6, zorder=3)
            else:
                ax.plot(one.p_false_alarm, one.p_detection, color="0.8", linewidth=0.6)
        ax.plot(found[0].p_false_alarm, found[0].p_false_alarm, ":", color="0.6", linewidth=1.0)
        ax.set_xscale("log")
        ax.set_ylim(0.0, 1.02)
        ax.set_xlabel("probability of false alarm")
        ax.set_ylabel("probability of detection")
        ax.set_title(f"RX on {kind}: {found[0].target} on {found[0].background}", fontsize=10)
        legend_below(ax)
    return png(figure)
