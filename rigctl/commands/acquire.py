"""``rigctl acquire``: take a session."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from rigctl.files.rig_file import load_rig
from rigctl.files.session_file import load_session
from rigctl.sessions.plan import Need, Step, estimate, plan_steps
from rigctl.sessions.take_session import take_session
from rigctl.terminal import progress, results

_SECONDS_A_MINUTE = 60


def command(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file: the devices.")],
    session: Annotated[Path, typer.Argument(metavar="SESSION.toml", help="Session file: the frames.")],
    out: Annotated[Path, typer.Option(metavar="RUN", help="Run folder to make; it must not exist yet.")],
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print the steps, the time and the disk they need; touch no device.")
    ] = False,
) -> None:
    """Take a session: each frame is on the disk, whole, before the next is taken.

    Example: rigctl acquire examples/rig-sim.toml examples/session.toml --out runs/panels
    """
    rig_file, session_file = load_rig(rig), load_session(session)
    if dry_run:
        steps = plan_steps(session_file)
        _print_steps(steps, estimate(steps, rig_file))
        return
    frames = take_session(rig_file, session_file, out, files={"rig": rig, "session": session})
    progress().print(f"{frames} frames in {out}", markup=False)


def _print_steps(steps: tuple[Step, ...], need: Need) -> None:
    table = Table(box=None, pad_edge=False)
    for title in ("step", "kind", "cycle", "polarizer [deg]", "exposure [ms]"):
        table.add_column(title, justify="left" if title == "kind" else "right")
    for step in steps:
        angle = "" if step.polarizer_angle_deg is None else f"{step.polarizer_angle_deg:g}"
        table.add_row(str(step.sequence), step.kind, str(step.cycle), angle, f"{step.exposure_s * 1000:g}")
    console = results()
    console.print(table)
    disk = "not known before the camera is opened" if need.disk_bytes is None else f"{need.disk_bytes / 1e6:.0f} MB"
    minutes, seconds = divmod(round(need.duration_s), _SECONDS_A_MINUTE)
    console.print(f"{len(steps)} frames, about {minutes} min {seconds} s, disk {disk}", markup=False)
