"""Columns that every export of a run holds: all that is known of its frames, in order, as plain values."""

from dataclasses import fields
from typing import Any

from rigctl.errors import RunFolderError
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run

Column = list[Any]
# The longest ending first: "_e_per_dn" is no count.
_UNITS = {
    "_e_per_dn": "e-/DN",
    "_deg": "deg",
    "_dn": "DN",
    "_db": "dB",
    "_ns": "ns",
    "_s": "s",
    "_c": "deg C",
    "_m": "m",
}


def columns_of(run: Run) -> dict[str, Column]:
    """Return what is known of the frames by field, one value a frame; None where nothing is known."""
    return {field.name: [getattr(record, field.name) for record in run.frames] for field in fields(FrameRecord)}


def unit_of(field: str) -> str:
    """Return the unit that the name of a field ends in; empty where it has none."""
    return next((unit for ending, unit in _UNITS.items() if field.endswith(ending)), "")


def common_shape(run: Run) -> tuple[int, int]:
    """Return rows and columns of all frames.

    Raises
    ------
    RunFolderError
        There are no frames, or they differ in size.
    """
    if not run.frames:
        raise RunFolderError(f"{run.path}: has no frames")
    shapes = {(record.height, record.width) for record in run.frames}
    if len(shapes) != 1:
        raise RunFolderError(f"{run.path}: has frames of {len(shapes)} sizes; one file holds frames of one size")
    return next(iter(shapes))
