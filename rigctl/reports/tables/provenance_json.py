"""Provenance of a comparison: files with their hashes, settings, versions."""

import platform
from importlib.metadata import version
from typing import Any

from rigctl.comparison.compared_run import ComparedRun
from rigctl.reports.tables.told_places import told_places
from rigctl.version import VERSION

# Of these figures in the last digit, and single pixels of figures, depend.
_LIBRARIES = ("numpy", "scipy", "matplotlib", "opencv-contrib-python-headless", "reportlab")


def provenance_json(found: ComparedRun) -> dict[str, Any]:
    """Return what a comparison was made from and with, as JSON holds it, without absolute paths."""
    told: dict[str, Any] = told_places(_provenance(found), anonymous=found.provenance.anonymous)
    return told


def _provenance(found: ComparedRun) -> dict[str, Any]:
    run, used = found.measurement.run, found.provenance
    return {
        "program": f"rigctl {VERSION}",
        "run": {"path": str(run.path), "created_by": run.created_by, "created_utc": run.created_utc},
        "files": {what: {"path": str(file.path), "sha256": file.sha256} for what, file in used.files.items()},
        "settings": {"alpha": used.alpha, "scale": used.scale},
        "machine": _machine(),
        "session": run.session_json,
    }


def _machine() -> dict[str, str]:
    """Return what of this machine a report may depend on, in its last digits and single pixels."""
    return {name: version(name) for name in _LIBRARIES} | {
        "python": platform.python_version(),
        "processor": platform.machine(),
    }
