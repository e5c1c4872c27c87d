"""What a comparison was made with: its calibrations, the effects that the model took, settings and versions."""

import math
import platform
from importlib.metadata import version
from typing import Any

from model.effects.names import Effect
from model.effects.planner import Decision
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.comparison.compared_run import ComparedRun, EffectsTaken
from rigctl.files.scene_file import NoiseSection
from rigctl.reports.number_text import to_digits
from rigctl.reports.report import NOTHING, Table
from rigctl.version import VERSION

# Of these figures in the last digit, and single pixels of figures, depend.
_LIBRARIES = ("numpy", "scipy", "matplotlib", "opencv-contrib-python-headless", "reportlab")


def calibration_table(noise: NoiseParameters | None) -> Table | None:
    """Return the numbers of a noise calibration with their errors; nothing without one."""
    if noise is None:
        return None
    rows = [
        (name, to_digits(found.value, found.std_error), f"{found.std_error:.2g}")
        for name in NoiseSection.model_fields
        if (found := noise.known.get(name)) is not None
    ]
    return Table(header=("noise calibration", "value", "its standard error"), rows=tuple(rows))


def effects_block(found: EffectsTaken) -> Table:
    """Return each effect of the model: taken here or not, the most that leaving it out can change, and why."""
    return Table(
        header=("effect", "taken here", "of DoLP, s1, s2", "of counts", "called for", "reason"),
        rows=tuple(
            (
                one.effect.value,
                _taken(one, found.taken),
                _bound(one.bound.ratios),
                _bound(one.bound.radiance),
                "yes" if one.acts else "no",
                one.reason,
            )
            for one in found.plan.decisions
        ),
        off=tuple(one.acts and one.effect not in found.taken for one in found.plan.decisions),
        left=(0, 1, 4, 5),
        wide=5,
    )


def provenance_json(found: ComparedRun) -> dict[str, Any]:
    """Return what a comparison was made from and with, as JSON holds it."""
    run, used = found.measurement.run, found.provenance
    return {
        "program": f"rigctl {VERSION}",
        "run": {"path": str(run.path), "created_by": run.created_by, "created_utc": run.created_utc},
        "files": {what: {"path": str(file.path), "sha256": file.sha256} for what, file in used.files.items()},
        "settings": {"alpha": used.alpha, "scale": used.scale},
        "machine": machine(),
        "session": run.session_json,
    }


def machine() -> dict[str, str]:
    """Return what of this machine a report may depend on, in its last digits and single pixels."""
    return {name: version(name) for name in _LIBRARIES} | {
        "python": platform.python_version(),
        "processor": platform.machine(),
    }


def _taken(one: Decision, taken: frozenset[Effect]) -> str:
    if one.effect not in taken:
        return "NO"
    return "yes" if one.bound.largest > 0.0 or one.acts else NOTHING


def _bound(value: float) -> str:
    if value == 0.0:
        return "0"
    return f"{value:.1e}" if math.isfinite(value) else NOTHING
