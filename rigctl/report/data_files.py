"""Results as files for programs: tables as CSV and JSON, images as FITS, and the provenance of a comparison.

A number that does not exist is empty in CSV and null in JSON. Provenance names files with their hashes, settings and
versions; folders are relative, and left out with --anonymous.
"""

from __future__ import annotations

import csv
import io
import math
import os
import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.console import LEFT_OUT, is_anonymous, is_personal, json_text, rewritten, told, told_content
from rigctl.report.table import Shown, Table, text_columns
from rigctl.version import VERSION

if TYPE_CHECKING:
    from rigctl.comparison.compare import Comparison
    from rigctl.console import Json
    from rigctl.measure.measure import Measurement
    from rigctl.report.table import AnyTable, Column, Value
    from rigctl.runs.fits import CardValue


def csv_rows(table: AnyTable, *, line_end: str = "\n") -> bytes:
    """Return the columns for programs as CSV, with all digits."""
    columns = table.shown(Shown.CSV)
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator=line_end)
    writer.writerow(column.key for column in columns)
    writer.writerows([_cell(column, row) for column in columns] for row in table.rows)
    return text.getvalue().encode()


def _cell(column: Column[Any], row: Any) -> Value:
    value = column.csv(row) if column.csv is not None else column.value_of(row)
    if isinstance(value, str):
        return told(value)
    return "" if value is None or (isinstance(value, float) and math.isnan(value)) else value


def json_rows(table: AnyTable) -> list[dict[str, Value]]:
    """Return the columns for programs, one object per row."""
    columns = table.shown(Shown.JSON)
    return [{column.key: finite(column.value_of(row)) for column in columns} for row in table.rows]


def finite(value: Value) -> Value:
    """Return a value for JSON: infinity (an ideal polarizer) and missing numbers are null."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def json_file(content: Mapping[str, Json], *, indent: int | None = 2) -> bytes:
    """Return the content of a JSON file."""
    return json_text(told_content(content), indent=indent).encode()


def fits_image(image: NDArray[np.generic], *, unit: str, what: str) -> bytes:
    """Return an image, or a stack of them, as the bytes of a FITS file."""
    from rigctl.runs.fits import encode_image

    cards: dict[str, tuple[CardValue, str]] = {
        "BUNIT": (unit, "unit of the samples"),
        "ROWORDER": ("TOP-DOWN", "first row is the top of the picture"),
        "CONTENT": (what, ""),
        "SWVER": (f"rigctl {VERSION}", ""),
    }
    return encode_image(image, cards)


_DEG_PER_RAD = 57.29577951308232

# Last digits, and single pixels of figures, depend on these versions.
_LIBRARIES = ("numpy", "scipy", "matplotlib", "opencv-contrib-python-headless", "reportlab")


def provenance_json(found: Comparison) -> dict[str, Json]:
    """Return the provenance of a comparison as JSON, without absolute paths."""
    run = found.measurement.run
    told = {
        "program": f"rigctl {VERSION}",
        "run": {"path": str(run.path), "created_by": run.created_by, "created_utc": run.created_utc},
        "files": found.files,
        "settings": {"alpha": found.alpha, "scale": "absolute" if found.scale is None else found.scale.kind},
        "machine": _machine(),
        "session": run.session_json,
    }
    return dict(told_places(told, anonymous=is_anonymous()))


def _machine() -> dict[str, str]:
    """Return the properties of this machine on which last digits and single pixels may depend."""
    return {name: version(name) for name in _LIBRARIES} | {
        "python": platform.python_version(),
        "processor": platform.machine(),
    }


def told_places(content: Any, *, anonymous: bool) -> Any:
    """Return the content of a report without absolute paths."""

    def value(key: str, one: Json) -> Json:
        return LEFT_OUT if anonymous and one is not None and is_personal(key) else one

    return rewritten(content, text=lambda text: _told_path(text, anonymous=anonymous), value=value)


def _told_path(text: str, *, anonymous: bool) -> str:
    if anonymous and "/" in text and "\n" not in text and "://" not in text:
        return PurePath(text).name
    if text.startswith("/") and "\n" not in text and len(text) < os.pathconf("/", "PC_PATH_MAX"):
        return os.path.relpath(text)
    return text


def source_table(found: Comparison) -> Table[tuple[str, str]]:
    """Return the source of the frames and their settings, for people."""
    facts = _facts(found.measurement, anonymous=is_anonymous())
    return Table(columns=text_columns("what", "which", left=(0, 1), wide=1), rows=tuple(facts.items()))


def _facts(measurement: Measurement, *, anonymous: bool) -> dict[str, str]:
    grid, first = measurement.grid, measurement.grid.records[0][0]
    exposures = "not known" if grid.exposures_s is None else ", ".join(f"{1000 * t:g}" for t in grid.exposures_s)
    return {
        "run": told_places(str(measurement.run.path), anonymous=anonymous),
        "frames come from": measurement.run.session.origin or "not said",
        "camera": f"{first.camera_model or 'not known'}, serial number {_serial(first.camera_serial, anonymous)}",
        "stage": f"{first.stage_model or 'not known'}, serial number {_serial(first.stage_serial, anonymous)}",
        "polarizer angles, measured [deg]": ", ".join(f"{a * _DEG_PER_RAD:.3f}" for a in grid.polarizer_angles_rad),
        "extinction ratio of the polarizer": f"{measurement.extinction_ratio:g}",
        "cycles": str(grid.cycles),
        "exposure [ms]": exposures,
        "dark level": measurement.dark_level.source,
        "saturated pixels in the picture": str(int(measurement.saturated.sum())),
        "missing pixels in the picture": str(int(measurement.missing.sum())),
        "first frame": first.start_utc or "not known",
    }


def _serial(text: str | None, is_left_out: bool) -> str:
    return "left out" if is_left_out else text or "not known"
