"""``rigctl record``: a session's devices, written down for a replay without hardware."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import progress, warn


def command(
    rig: Annotated[Path, typer.Argument(help="Rig file.", metavar="RIG.toml")],
    session: Annotated[Path, typer.Argument(help="Session file: a short one is enough.", metavar="SESSION.toml")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to make.")],
) -> None:
    """Take a session, and write down every byte of the stage's line and the settings and frames of the camera.

    The run itself is not kept. The file replays them where there is no hardware: `port = "replay:FILE"` of [stage] and
    `address = "replay:FILE"` of [camera]; rig and session file for it are inside (it is a ZIP archive). It is written
    where a device fails, too: that is what to pass on.

    Example: rigctl record rig.toml session.toml --out fault.rec
    """
    from rigctl.jobs.record import record

    found = record(rig, session, out=out)
    progress().print(f"{found.path}: {found.line_bytes} bytes of the stage's line, {found.frames} frames", markup=False)
    if found.failure is not None:
        warn(f"the session ended early, which is in the recording: {found.failure}")
