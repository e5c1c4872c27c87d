"""What every export of a run holds: frames in order, and per frame what is known of it, as plain values."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from rigctl.errors import ConfigError, RunFolderError
from rigctl.runs.run_folder import FrameRecord, Run

Column = list[Any]


def columns_of(run: Run) -> dict[str, Column]:
    """Return what is known of the frames by field, one value a frame; texts joined, None where nothing is known."""
    return {field.name: [_plain(getattr(record, field.name)) for record in run.frames] for field in fields(FrameRecord)}


def common_shape(run: Run) -> tuple[int, int]:
    """Return rows and columns of all frames.

    Raises
    ------
    RunFolderError
        There are no frames, or they differ in size.
    """
    shapes = {(record.height, record.width) for record in run.frames}
    if len(shapes) != 1:
        raise RunFolderError(f"{run.path}: has frames of {len(shapes)} sizes; one file holds frames of one size")
    return next(iter(shapes))


def require_new(out: Path) -> None:
    """Refuse to write over something.

    Raises
    ------
    ConfigError
        There is something.
    """
    if out.exists():
        raise ConfigError(f"--out: {out} is there already; name a file or folder that does not exist yet")


def _plain(value: object) -> object:
    return "\n".join(value) if isinstance(value, tuple) else value
