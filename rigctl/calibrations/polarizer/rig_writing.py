"""Sense and offset of a calibration, written into a rig file in the place of those that stand there."""

import re
from pathlib import Path

from rigctl.calibrations.polarizer.polarizer_calibration import PolarizerCalibration
from rigctl.errors import ConfigError
from rigctl.files.rig_file import load_rig
from rigctl.storage.durable_file import write_durably

_TABLE = re.compile(r"^\[polarizer\][^\n]*\n(?:(?!\[)[^\n]*(?:\n|\Z))*", re.MULTILINE)


def write_into_rig(path: Path, found: PolarizerCalibration) -> None:
    """Write sense, offset with its error, and extinction ratio into a rig file; its comments stay.

    Raises
    ------
    ConfigError
        The file is no rig file, or has no table [polarizer] of its own.
    """
    load_rig(path)
    text = path.read_text(encoding="utf-8")
    table = _TABLE.search(text)
    if table is None:
        raise ConfigError(f"{path}: has no table [polarizer] to write into")
    offset = found.offset_deg
    numbers = {
        "sense": str(found.axis.best.sense),
        "offset_deg": f"{{ value = {offset.value:.4f}, std = {offset.std_error:.4f} }}",
    }
    if found.extinction is not None and found.extinction.ratio is not None:
        numbers["extinction_ratio"] = f"{found.extinction.ratio:.4g}"
    inside = re.sub(r"^(?:placeholder|offset_std_deg)\s*=[^\n]*\n", "", table[0], flags=re.MULTILINE)
    for key, number in numbers.items():
        line = f"{key} = {number}    # rigctl calibrate axis"
        inside, done = re.subn(rf"^{key}\s*=[^\n]*$", line, inside, flags=re.MULTILINE)
        inside = inside if done else inside.replace("\n", f"\n{line}\n", 1)
    write_durably(path, (text[: table.start()] + inside + text[table.end() :]).encode("utf-8"))
    load_rig(path)
