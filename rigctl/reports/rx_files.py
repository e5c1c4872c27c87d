"""Writes what the RX detector found: map, curves and numbers."""

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.comparison.performance import FALSE_ALARM_RATES
from rigctl.detection.rx_run import BAND_LEVEL, RxOnRun
from rigctl.durable_file import write_durably
from rigctl.reports.figures.rx_figures import roc_plot, statistic_picture
from rigctl.reports.writers.fits_image import fits_image

SCHEMA_VERSION = 1


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
        "points": [_point(found, k) for k in np.flatnonzero(np.isin(found.p_false_alarm, FALSE_ALARM_RATES)).tolist()],
        "warnings": list(found.warnings),
    }


def _point(found: RxOnRun, k: int) -> dict[str, float]:
    return {
        "p_false_alarm": float(found.p_false_alarm[k]),
        "threshold": float(found.threshold[k]),
        "p_detection_predicted": float(found.predicted_p_detection[k]),
        "p_detection_measured": float(found.empirical_p_detection[k]),
        "band_low": float(found.band_low[k]),
        "band_high": float(found.band_high[k]),
        "p_false_alarm_measured": float(found.empirical_p_false_alarm[k]),
    }


def write_detection(found: RxOnRun, out: Path, *, background: str, target: str) -> tuple[str, ...]:
    """Write rx.fits, rx.png, roc.csv, roc.png and detection.json into a folder; return their names."""
    out.mkdir(parents=True, exist_ok=True)
    content = detection_json(found, background=background, target=target)
    files = {
        "rx.fits": fits_image(found.statistic, unit="", what=f"RX statistic D against {background}; NaN: no meaning"),
        "rx.png": statistic_picture(found, background=background),
        "roc.csv": _csv(found),
        "roc.png": roc_plot(found, background=background, target=target),
        "detection.json": (json.dumps(content, indent=2, allow_nan=False) + "\n").encode(),
    }
    for name, data in files.items():
        write_durably(out / name, data)
    return tuple(files)


def _csv(found: RxOnRun) -> bytes:
    columns = {
        "p_false_alarm": found.p_false_alarm,
        "threshold": found.threshold,
        "p_detection_predicted": found.predicted_p_detection,
        "p_detection_measured": found.empirical_p_detection,
        "band_low": found.band_low,
        "band_high": found.band_high,
        "p_false_alarm_measured": found.empirical_p_false_alarm,
    }
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(columns)
    writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
    return text.getvalue().encode()
