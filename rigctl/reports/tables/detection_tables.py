"""Result of the RX detector on a run, as tables and as JSON."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.comparison.rx_detection import BAND_LEVEL, RxOnRun
from rigctl.prediction.performance import FALSE_ALARM_RATES
from rigctl.reports.table import Column, Shown, Table
from rigctl.reports.writers.json_rows import json_rows

SCHEMA_VERSION = 1


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


def roc_table(found: RxOnRun) -> Table[RocPoint]:
    """Return every point of the curves."""
    return Table(columns=_COLUMNS, rows=tuple(_point(found, k) for k in range(found.p_false_alarm.size)))


def round_roc_table(found: RxOnRun, *, background: str, target: str) -> Table[RocPoint]:
    """Return the points at round false alarm rates."""
    places = np.flatnonzero(np.isin(found.p_false_alarm, FALSE_ALARM_RATES)).tolist()
    rows = tuple(_point(found, k) for k in places)
    return Table(title=f"RX: {target} on {background}", columns=_COLUMNS, rows=rows)


def detection_json(found: RxOnRun, *, background: str, target: str) -> dict[str, Any]:
    """Return the numbers as JSON holds them: points of the curves at round false alarm rates, and the area."""
    return {
        "schema_version": SCHEMA_VERSION,
        "background": background,
        "target": target,
        "background_pixels": found.n_background,
        "target_pixels": found.n_target,
        "threshold_law": "F law: background estimated from its pixels, tested pixel outside of them",
        "predicted_from": found.predicted_from,
        "band_level": BAND_LEVEL,
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
