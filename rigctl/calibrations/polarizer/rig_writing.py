"""Sense and offset of a calibration, written into a rig file in the place of those that stand there."""

import re
from pathlib import Path

from rigctl.calibrations.polarizer.polarizer_calibration import PolarizerCalibration
from rigctl.errors import ConfigError
from rigctl.files.rig_file import load_rig
from rigctl.storage.durable_file import write_durably

_TABLE = re.compile(r"^\[polarizer\][^\n]*\n(?:(?!\[)[^\n]*(?:\n|\Z))*", re.MULTILINE)
_NO_LONGER_TRUE = re.compile(r"^(?:placeholder|offset_std_deg)\s*=[^\n]*(?:\n|\Z)", re.MULTILINE)
_OURS = "    # rigctl calibrate axis"
_PLACEHOLDER = "# a placeholder"


def require_writable_rig(path: Path) -> None:
    """Refuse a file that a calibration cannot be written into, before there is one.

    Raises
    ------
    ConfigError
        The file is no rig file, or has no table [polarizer] of its own.
    """
    load_rig(path)
    _polarizer_table(path)


def write_into_rig(path: Path, found: PolarizerCalibration) -> tuple[str, ...]:
    """Write sense, offset with its error, and extinction ratio into a rig file; its comments stay.

    Returns
    -------
    tuple of str
        The lines that went, behind a minus, and those that came, behind a plus.

    Raises
    ------
    ConfigError
        As `require_writable_rig`.
    """
    require_writable_rig(path)
    text = _text(path)
    table = _polarizer_table(path)
    inside = _NO_LONGER_TRUE.sub("", table[0])
    for key, number in _numbers(found).items():
        # What a person has noted behind a number stays there.
        line = re.compile(rf"^({key}\s*=\s*)[^#\r\n]*?([ \t]*#[^\r\n]*)?(\r?)$", re.MULTILINE)
        was = line.search(inside)
        if was is not None:
            inside = f"{inside[: was.start()]}{was[1]}{number}{_kept(was[2])}{was[3]}{inside[was.end() :]}"
        else:
            inside = inside.replace("\n", f"\n{key} = {number}{_OURS}\n", 1)
    write_durably(path, (text[: table.start()] + inside + text[table.end() :]).encode("utf-8"))
    load_rig(path)
    return _changes(table[0].splitlines(), inside.splitlines())


def _kept(comment: str | None) -> str:
    return _OURS if comment is None or comment.strip().startswith(_PLACEHOLDER) else comment


def _polarizer_table(path: Path) -> re.Match[str]:
    table = _TABLE.search(_text(path))
    if table is None:
        raise ConfigError(f"{path}: has no table [polarizer] to write into")
    return table


def _text(path: Path) -> str:
    # As bytes: the ends of lines stay what they are.
    return path.read_bytes().decode("utf-8")


def _numbers(found: PolarizerCalibration) -> dict[str, str]:
    offset = found.offset_deg
    numbers = {
        "sense": str(found.axis.best.sense),
        "offset_deg": f"{{ value = {offset.value:.4f}, std = {offset.std_error:.4f} }}",
    }
    if found.extinction is not None and found.extinction.ratio is not None:
        numbers["extinction_ratio"] = f"{found.extinction.ratio:.4g}"
    return numbers


def _changes(before: list[str], after: list[str]) -> tuple[str, ...]:
    went = [f"- {line}" for line in before if line not in after]
    return (*went, *(f"+ {line}" for line in after if line not in before))
