"""``rigctl export``: a run in another format."""

import shutil
from pathlib import Path
from typing import Annotated, Literal

import typer

from rigctl.durable_file import PART_SUFFIX
from rigctl.runs.exports.export_frames import require_new
from rigctl.runs.exports.export_hdf5 import export_hdf5
from rigctl.runs.exports.export_tiff import export_tiff
from rigctl.runs.exports.export_zarr import export_zarr
from rigctl.runs.run_folder import read_run
from rigctl.terminal import progress

Format = Literal["tiff", "hdf5", "zarr"]
_WRITERS = {"tiff": export_tiff, "hdf5": export_hdf5, "zarr": export_zarr}


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    to: Annotated[Format, typer.Option("--to", help="TIFF files, one HDF5 file, or a Zarr folder.")],
    out: Annotated[Path, typer.Option(metavar="PATH", help="File or folder to make.")],
) -> None:
    """Write a run in a format that other programs read; each frame's checksum is verified on the way.

    Example: rigctl export runs/2026-05-04 --to hdf5 --out panels.h5
    """
    require_new(out)
    found = read_run(run)
    part = out.with_name(out.name + PART_SUFFIX)
    _remove(part)
    try:
        _WRITERS[to](found, part)
    except BaseException:
        _remove(part)
        raise
    part.replace(out)
    progress().print(f"{len(found.frames)} frames in {out}", markup=False)


def _remove(part: Path) -> None:
    if part.is_dir():
        shutil.rmtree(part)
    else:
        part.unlink(missing_ok=True)
