"""A run as one HDF5 file."""

import json
from pathlib import Path

import numpy as np

from rigctl.errors import ConfigError
from rigctl.runs.export_frames import Column, columns_of, common_shape
from rigctl.runs.run_folder import Run


def export_hdf5(run: Run, out: Path) -> None:
    """Write a run into an HDF5 file: `counts` (N, H, W), and a dataset a field under `frames`.

    Raises
    ------
    ConfigError
        h5py is not installed.
    RunFolderError
        A frame is damaged, or they differ in size.

    Notes
    -----
    Numbers that are not known are NaN, texts are empty. The session stands as JSON in the attribute `session`.
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
        for place, record in enumerate(run.frames):
            counts[place] = run.counts(record)
        for name, column in columns_of(run).items():
            file.create_dataset(f"frames/{name}", data=_dataset(column))
        file.attrs["session"] = json.dumps(run.session)
        file.attrs["created_by"] = run.created_by


def _dataset(column: Column) -> object:
    if any(isinstance(value, str) for value in column):
        return ["" if value is None else value for value in column]
    if all(isinstance(value, int) for value in column):
        return np.array(column, dtype=np.int64)
    return np.array([np.nan if value is None else value for value in column], dtype=np.float64)
