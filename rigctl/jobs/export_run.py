"""Exporting a run: run folder in; a file or folder that other programs read out."""

import tempfile
from pathlib import Path

from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.errors import ConfigError
from rigctl.files.choices import ExportFormat
from rigctl.runs.export_formats import export_hdf5, export_tiff, export_zarr
from rigctl.runs.run_folder import Run
from rigctl.runs.wholeness import used_run
from rigctl.storage.durable_file import PART_SUFFIX

_SHOWN = 100
_WRITERS = {"tiff": export_tiff, "hdf5": export_hdf5, "zarr": export_zarr}


def export_run(path: Path, *, to: ExportFormat, out: Path) -> Run:
    """Return the run, once all of it stands in another format; every frame's checksum is verified on the way.

    Parameters
    ----------
    path : Path
        Run folder.
    to : {"tiff", "hdf5", "zarr"}
        TIFF files, one HDF5 file, or a Zarr folder.
    out : Path
        File or folder to make; whole, or not at all.

    Raises
    ------
    ConfigError
        There is something already, or the library that writes the format is not installed.
    RunFolderError
        A frame is damaged, or they differ in size where one array holds all.
    """
    if out.exists():
        raise ConfigError(f"--out: {out} is there already; name a file or folder that does not exist yet")
    run = used_run(path, ignore_exclusions=are_exclusions_ignored())
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name[:_SHOWN]}-", suffix=PART_SUFFIX) as scratch:
        part = Path(scratch) / "part"
        _WRITERS[to](run, part)
        part.replace(out)
    return run
