"""``rigctl export``: a run in another format."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import progress, warn
from rigctl.files.choices import ExportFormat


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    to: Annotated[ExportFormat, typer.Option("--to", help="TIFF files, one HDF5 file, or a Zarr folder.")],
    out: Annotated[Path, typer.Option(metavar="PATH", help="File or folder to make.")],
) -> None:
    """Write a run in a format that other programs read; each frame's checksum is verified on the way.

    Example: rigctl export runs/2026-05-04 --to hdf5 --out panels.h5
    """
    from rigctl.files.rig_file import unset_polarizer
    from rigctl.jobs.export_run import export_run

    found = export_run(run, to=to, out=out)
    for doubt in unset_polarizer(run, placeholder=found.session.polarizer.placeholder):
        warn(doubt)
    progress().print(f"{len(found.frames)} frames in {out}", markup=False)
