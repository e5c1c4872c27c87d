"""Detection for people and programs: the map of the RX statistic, measured and predicted ROC curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rigctl.prediction.predict import FALSE_ALARM_RATES
from rigctl.report.document import AnyTable, Column, Shown, Table, value_columns
from rigctl.report.drawing import (
    MEASURED,
    PREDICTED,
    DrawnPicture,
    legend_below,
    legend_beside,
    pictures_png,
    png,
    subplots,
)
from rigctl.report.files import fits_image

if TYPE_CHECKING:
    from model.prediction import PairDetection
    from rigctl.comparison.detect import RxOnRun
    from rigctl.console import Json
    from rigctl.files.choices import RocKind
    from rigctl.report.files import Content


DETECTION_SCHEMA = 1


def measured_roc_table(found: RxOnRun) -> Table[int]:
    """Return every point of the measured and of the predicted ROC."""
    return Table(columns=_columns(found), rows=tuple(range(found.p_false_alarm.size)))


def round_roc_table(found: RxOnRun) -> Table[int]:
    """Return the points at round false alarm rates."""
    places = np.flatnonzero(np.isin(found.p_false_alarm, FALSE_ALARM_RATES)).tolist()
    return Table(title=f"RX: {found.target} on {found.background}", columns=_columns(found), rows=tuple(places))


def _columns(found: RxOnRun) -> tuple[Column[int], ...]:
    def column(key: str, values: str, title: str = "", digits: str = "") -> Column[int]:
        def value(k: int) -> float:
            return float(getattr(found, values)[k])

        if not title:
            return Column(key=key, value=value, shown=Shown.PROGRAMS)
        return Column(title=title, key=key, value=value, text=lambda k: format(value(k), digits))

    predicted = column("p_detection_predicted", "predicted_p_detection", "P_D predicted", ".4f")
    return (
        column("p_false_alarm", "p_false_alarm", "P_FA", ".1e"),
        column("threshold", "threshold", "threshold", ".2f"),
        replace(predicted, csv=lambda k: repr(float(found.predicted_p_detection[k]))),
        column("p_detection_measured", "empirical_p_detection", "P_D measured", ".4f"),
        column("band_low", "band_low"),
        column("band_high", "band_high"),
        Column(title="95 % band", text=lambda k: f"{found.band_low[k]:.4f} to {found.band_high[k]:.4f}"),
        column("p_false_alarm_measured", "empirical_p_false_alarm"),
    )


def detection_json(found: RxOnRun) -> dict[str, Json]:
    """Return the numbers as JSON: points of the curves at round false alarm rates, and the area."""
    return {
        "schema_version": DETECTION_SCHEMA,
        "background": found.background,
        "target": found.target,
        "background_pixels": found.n_background,
        "target_pixels": found.n_target,
        "threshold_law": "F law: background estimated from its pixels, without the tested pixel",
        "predicted_from": found.predicted_from,
        "band_level": found.band_level,
        "auc_known_background": found.auc,
        "points": round_roc_table(found).json(),
        "warnings": list(found.warnings),
    }


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


def roc_points(curves: Mapping[RocKind, Sequence[PairDetection]]) -> AnyTable:
    """Return a row per point and false alarm probability of every curve; points are rows of sweep.csv."""
    rows = [
        (point, kind, float(rate), float(detected), one.auc)
        for kind, found in curves.items()
        for point, one in enumerate(found)
        for rate, detected in zip(one.p_false_alarm, one.p_detection, strict=True)
    ]
    columns = value_columns("point", "kind", "p_false_alarm", "p_detection", "auc")
    return Table(columns=columns, rows=tuple(rows))


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


# Quantile of the statistic of background pixels at the lower end of the scale.
_LEAST_SHOWN = 0.8
# Most names in a legend.
_MOST_NAMED = 12


def statistic_picture(found: RxOnRun) -> bytes:
    """Return the map of the statistic on a log scale, from the value that one background pixel in ten exceeds."""
    values = np.log10(np.maximum(found.statistic, 1e-3))
    picture = DrawnPicture(
        values=values,
        low=_LEAST_SHOWN,
        high=max(float(np.nanmax(values, initial=_LEAST_SHOWN)), _LEAST_SHOWN + 0.1),
        colours="cividis",
        title=f"RX against {found.background}",
        label="log10 D",
    )
    return pictures_png((picture,))


def roc_plot(found: RxOnRun) -> bytes:
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
    ax.set_title(f"RX: {found.target} on {found.background}")
    legend_beside(ax)
    return png(figure)


def roc_png(curves: Mapping[RocKind, Sequence[PairDetection]], labels: Sequence[str] = ("",)) -> bytes:
    """Return a panel for each kind of vector and a curve for each point; a dozen are named, others are grey."""
    from matplotlib import colormaps

    named = np.unique(np.linspace(0, len(labels) - 1, min(len(labels), _MOST_NAMED)).astype(int))
    # Names of many curves go below the axes.
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


def detection_files(found: RxOnRun) -> dict[str, Content]:
    """Return the map of the statistic, curves and numbers as files."""
    what = f"RX statistic D against {found.background}; NaN: undefined"
    return {
        "rx.fits": fits_image(found.statistic, unit="", what=what),
        "rx.png": statistic_picture(found),
        "roc.csv": measured_roc_table(found),
        "roc.png": roc_plot(found),
        "detection.json": detection_json(found),
    }
