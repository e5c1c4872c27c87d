"""``rigctl bundle``: a run packed for somebody who shall find a fault."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import progress


def command(
    run: Annotated[Path, typer.Argument(help="Run folder; it may be unfinished or damaged.", metavar="RUN")],
    out: Annotated[Path, typer.Option(metavar="FILE.zip", help="File to make.")],
    frames: Annotated[int, typer.Option(metavar="N", min=0, help="Frames to pack, spread over the run.")] = 3,
) -> None:
    """Pack log, versions, check-up and a few frames of a run into one file, without secrets, for a report of a fault.

    Addresses on the web, [notify], commands of monitors, tokens and passwords, e-mail addresses, users and the name of
    this machine are left out. Comments, notes, serial numbers and the site stay: read it before you pass it on.

    Example: rigctl bundle runs/2026-05-04 --out fault.zip --frames 5
    """
    from rigctl.jobs.bundle import bundle

    found = bundle(run, out=out, frames=frames)
    progress().print(f"{found.path}: {len(found.names)} files, {found.frames} frames among them", markup=False)
