"""A run as one HDF5 file."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from rigctl.errors import ConfigError
from rigctl.runs.exports.export_frames import Column, columns_of, common_shape, unit_of
from rigctl.runs.run_folder import Run


def export_hdf5(run: Run, out: Path) -> None:
    """Write a run into an HDF5 file: `counts` (N, H, W), a dataset a field under `frames`, and `records`.

    Raises
    ------
    ConfigError
        h5py is not installed.
    RunFolderError
        A frame is damaged, or they differ in size.

    Notes
    -----
    Under `frames` numbers that are not known are NaN, and texts empty; several remarks are lines of one text. `records`
    has each frame's record as JSON, as the manifest has it: nothing is lost there. The session stands as JSON in
    the attribute `session`.
    """
    try:
        import h5py
    except ImportError as error:
        raise ConfigError("--to hdf5 needs h5py: pip install 'rigctl[export]'") from error
    height, width = common_shape(run)
    with h5py.File(out, "x") as file:
        counts = file.create_dataset(
            "counts", (len(run.frames), height, width), dtype="u2", chunks=(1, height, width), fletcher32=True
        )
        counts.attrs["unit"] = "DN"
        for place, record in enumerate(run.frames):
            counts[place] = run.counts(record)
        for name, column in columns_of(run).items():
            dataset = file.create_dataset(f"frames/{name}", data=_dataset(column))
            dataset.attrs["unit"] = unit_of(name)
        file.create_dataset("records", data=[json.dumps(asdict(record)) for record in run.frames])
        file.attrs["session"] = json.dumps(run.session_json)
        file.attrs["created_by"] = run.created_by


def _dataset(column: Column) -> object:
    if any(isinstance(value, (str, tuple)) for value in column):
        return [_text(value) for value in column]
    if all(isinstance(value, int) for value in column):
        return np.array(column, dtype=np.int64)
    return np.array([np.nan if value is None else value for value in column], dtype=np.float64)


def _text(value: str | tuple[str, ...] | None) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else "\n".join(value)
