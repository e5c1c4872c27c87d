"""The files of a sweep."""

import json
from collections.abc import Sequence
from pathlib import Path

from rigctl.comparison.sweep import Sweep
from rigctl.durable_file import write_durably
from rigctl.reports.tables.sweep_tables import sweep_csv, sweep_json, sweep_png


def write_sweep(found: Sweep, out: Path, *, remarks: Sequence[str]) -> None:
    """Write sweep.csv, sweep.json and sweep.png."""
    content = sweep_json(found) | {"remarks": list(remarks)}
    out.mkdir(parents=True, exist_ok=True)
    write_durably(out / "sweep.csv", sweep_csv(found))
    write_durably(out / "sweep.json", (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())
    write_durably(out / "sweep.png", sweep_png(found))
