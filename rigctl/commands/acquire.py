"""``rigctl acquire``: take a session."""

import time
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from rigctl.calibrations.noise.noise_file import read_noise_file
from rigctl.calibrations.polarizer.polarizer_file import read_polarizer_file
from rigctl.commands.acquire_calibrations import open_calibrated_rig
from rigctl.commands.target_cycles import with_target
from rigctl.errors import ConfigError
from rigctl.files.rig_file import load_rig
from rigctl.files.session_file import load_session
from rigctl.live.mean_noise import noise_numbers
from rigctl.session.planning.drift_cost import grouping_cost, missing_axes
from rigctl.session.planning.schedule import unix_ns
from rigctl.session.planning.session_steps import Need, Step, estimate, plan_steps
from rigctl.session.reconnect_loop import Outcome
from rigctl.session.take_session import take_session
from rigctl.terminal import progress, results, warn
from rigctl.utc_time import utc_text

_SECONDS_A_MINUTE = 60
# As sysexits.h has it: a temporary failure, try again.
EXIT_INCOMPLETE = 75


def command(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file: the devices.")],
    session: Annotated[Path, typer.Argument(metavar="SESSION.toml", help="Session file: the frames.")],
    out: Annotated[Path, typer.Option(metavar="RUN", help="Run folder to make; it must not exist yet.")],
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print the steps, the time and the disk they need; touch no device.")
    ] = False,
    at: Annotated[
        str | None, typer.Option(metavar="TIME", help="Begin then, such as 2026-05-04T10:00Z; a zone is needed.")
    ] = None,
    until: Annotated[str | None, typer.Option(metavar="TIME", help="Take no frame from then on.")] = None,
    noise: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Noise calibration: what noise does to sum rule, drift and DoLP."),
    ] = None,
    polarizer: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Polarizer calibration: the rig file has to agree with it.")
    ] = None,
    scene: Annotated[Path | None, typer.Option(metavar="FILE", help="Scene file, for --target-dolp-sigma.")] = None,
    target_dolp_sigma: Annotated[
        float | None,
        typer.Option(metavar="S", help="Take as many cycles as bring the error of a pixel's DoLP in --scene to this."),
    ] = None,
) -> None:
    """Take a session: each frame is on the disk, whole, before it counts. `rigctl resume` goes on where it ended.

    Exit codes: 0 finished, 75 stopped before its end by a signal or by `rigctl stop`, 2, 3 and 4 as everywhere.

    Example: rigctl acquire examples/rig-sim.toml examples/session.toml --out runs/panels

    Example: rigctl acquire examples/rig-sim.toml examples/session.toml --out runs/panels --scene
    examples/scene-panels.toml --target-dolp-sigma 0.01
    """
    rig_file, session_file = load_rig(rig), load_session(session)
    noise_content = None if noise is None else read_noise_file(noise)
    session_file = with_target(session_file, noise_content, scene=scene, target_dolp_sigma=target_dolp_sigma)
    for doubt in (grouping_cost(session_file), missing_axes(plan_steps(session_file))):
        if doubt is not None:
            warn(doubt)
    if dry_run:
        steps = plan_steps(session_file)
        _print_steps(steps, estimate(steps, rig_file))
        return
    opener = partial(
        open_calibrated_rig,
        rig_file,
        session_name=session_file.name,
        run=out,
        noise=noise_content,
        polarizer=None if polarizer is None else read_polarizer_file(polarizer),
        now_utc=utc_text(time.time_ns()),
    )
    outcome = take_session(
        rig_file,
        session_file,
        out,
        files={"rig": rig, "session": session},
        at_ns=time_option("--at", at),
        until_ns=time_option("--until", until),
        noise=None if noise_content is None else noise_numbers(noise_content),
        opener=opener,
    )
    say_outcome(outcome, out)


def time_option(name: str, text: str | None) -> int | None:
    """Return a time that was given on the command line [ns since 1970 UTC].

    Raises
    ------
    ConfigError
        It is no time, or has no zone.
    """
    if text is None:
        return None
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        raise ConfigError(f"{name}: {text!r} is no time; write it like 2026-05-04T10:00Z") from error
    if moment.tzinfo is None:
        raise ConfigError(f"{name}: {text!r} has no zone; write {text}Z for UTC, or {text}+02:00")
    return unix_ns(moment.astimezone(UTC))


def say_outcome(outcome: Outcome, run: Path) -> None:
    """Say how a session went, and end with the exit code that a scheduler understands."""
    progress().print(f"{outcome.frames} frames in {run}", markup=False)
    if not outcome.is_finished:
        progress().print(f"stopped before its end; `rigctl resume {run}` goes on", markup=False)
        raise typer.Exit(EXIT_INCOMPLETE)


def _print_steps(steps: tuple[Step, ...], need: Need) -> None:
    table = Table(box=None, pad_edge=False)
    for title in ("step", "kind", "cycle", "polarizer [deg]", "exposure [ms]"):
        table.add_column(title, justify="left" if title == "kind" else "right")
    for step in steps:
        angle = "" if step.polarizer_angle_deg is None else f"{step.polarizer_angle_deg:g}"
        exposure = "metered" if step.exposure_s is None else f"{step.exposure_s * 1000:g}"
        table.add_row(str(step.sequence), step.kind, str(step.cycle), angle, exposure)
    console = results()
    console.print(table)
    disk = "not known before the camera is opened" if need.disk_bytes is None else f"{need.disk_bytes / 1e6:.0f} MB"
    minutes, seconds = divmod(round(need.duration_s), _SECONDS_A_MINUTE)
    console.print(f"{len(steps)} frames, about {minutes} min {seconds} s, disk {disk}", markup=False)
