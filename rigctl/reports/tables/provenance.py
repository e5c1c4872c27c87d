"""Provenance of a comparison: files with their hashes, settings, versions; places told so that others may read them."""

import os
import platform
from importlib.metadata import version
from pathlib import PurePath
from typing import Any

from rigctl.comparison.comparison import Comparison
from rigctl.console.anonymity import LEFT_OUT, is_anonymous, is_personal
from rigctl.console.json_text import Json
from rigctl.measurement.measurement import Measurement
from rigctl.reports.table import Table, text_columns
from rigctl.version import VERSION

_DEG_PER_RAD = 57.29577951308232

# Of these figures in the last digit, and single pixels of figures, depend.
_LIBRARIES = ("numpy", "scipy", "matplotlib", "opencv-contrib-python-headless", "reportlab")


def provenance_json(found: Comparison) -> dict[str, Json]:
    """Return what a comparison was made from and with, as JSON holds it, without absolute paths."""
    run = found.measurement.run
    told = {
        "program": f"rigctl {VERSION}",
        "run": {"path": str(run.path), "created_by": run.created_by, "created_utc": run.created_utc},
        "files": {what: {"path": str(file.path), "sha256": file.sha256} for what, file in found.files.items()},
        "settings": {"alpha": found.alpha, "scale": "absolute" if found.scale is None else found.scale.kind},
        "machine": _machine(),
        "session": run.session_json,
    }
    return dict(told_places(told, anonymous=is_anonymous()))


def _machine() -> dict[str, str]:
    """Return what of this machine a report may depend on, in its last digits and single pixels."""
    return {name: version(name) for name in _LIBRARIES} | {
        "python": platform.python_version(),
        "processor": platform.machine(),
    }


def told_places(content: Any, *, anonymous: bool) -> Any:
    """Return the content of a report without absolute paths.

    Parameters
    ----------
    content : tables, lists and values
        As JSON holds them.
    anonymous : bool
        Leave the last name only of each path, and say "left out" for serial numbers, ports and the site.
    """
    if isinstance(content, dict):
        return {
            key: LEFT_OUT
            if anonymous and value is not None and is_personal(key)
            else told_places(value, anonymous=anonymous)
            for key, value in content.items()
        }
    if isinstance(content, list | tuple):
        return [told_places(value, anonymous=anonymous) for value in content]
    return _told_path(content, anonymous=anonymous) if isinstance(content, str) else content


def _told_path(text: str, *, anonymous: bool) -> str:
    if anonymous and "/" in text and "\n" not in text and "://" not in text:
        return PurePath(text).name
    if text.startswith("/") and "\n" not in text and len(text) < os.pathconf("/", "PC_PATH_MAX"):
        return os.path.relpath(text)
    return text


def source_table(found: Comparison) -> Table[tuple[str, str]]:
    """Return where the frames come from and how they were taken, for people."""
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
