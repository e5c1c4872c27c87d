"""``rigctl doctor``: whether this machine and these devices are fit for a session."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.failures import EXIT_DEVICE
from rigctl.console.terminal import print_json, results

if TYPE_CHECKING:
    from rigctl.devices.host_checkup import Finding


def command(
    rig: Annotated[Path | None, typer.Argument(metavar="RIG.toml", help="Look at its devices too.")] = None,
    session: Annotated[
        Path | None, typer.Argument(metavar="SESSION.toml", help="Hold the disk against what it needs.")
    ] = None,
    folder: Annotated[Path, typer.Option(metavar="DIR", help="Where runs will be.")] = Path(),
    frames: Annotated[int, typer.Option(metavar="N", min=1, help="Pictures to take.")] = 20,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Check network, disk, clock and, with a rig file, its devices; each line says what to change.

    The stage is asked for its position and not moved. Without a session file the disk is held against 60 frames a
    second. Exit code 3 if something has to be changed.

    Example: rigctl doctor examples/rig-sim.toml examples/session.toml --folder /data/runs
    """
    from rigctl.jobs.doctor import DoctorRequest, check_up, most_important_first

    found = []
    for finding in check_up(DoctorRequest(rig=rig, session=session, folder=folder, frames=frames)):
        found.append(finding)
        if not as_json:
            _show(finding)
    changes = most_important_first(found)
    if as_json:
        told = [vars(finding) for finding in found]
        print_json({"findings": told, "to_change": [vars(finding) for finding in changes]})
    elif len(changes) > 1:
        results().print("To change, what stops a session first:", markup=False)
        for number, finding in enumerate(changes, 1):
            results().print(f"  {number}. {finding.what}: {finding.advice}", markup=False)
    if changes:
        raise typer.Exit(EXIT_DEVICE)


def _show(finding: "Finding") -> None:
    results().print(f"{finding.what}: {finding.found}", markup=False)
    if finding.advice is not None:
        results().print(f"  change: {finding.advice}", markup=False)
    if finding.hint is not None:
        results().print(f"  hint: {finding.hint}", markup=False)
