"""``rigctl acquire``: take a session."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.failures import EXIT_INCOMPLETE
from rigctl.console.options import CalibrationStore, time_option
from rigctl.console.terminal import progress, results, warn
from rigctl.files.choices import ROOF_CHANGES, Asked, RoofChange
from rigctl.reports.table import Column, Table
from rigctl.reports.writers.terminal_table import terminal_table
from rigctl.session.control import outliving_terminal

if TYPE_CHECKING:
    from rigctl.jobs.acquire import PreparedSession
    from rigctl.session.planning.session_steps import Step
    from rigctl.session.reconnect_loop import Outcome

_SECONDS_A_MINUTE = 60


@outliving_terminal()
def command(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file: the devices.")],
    session: Annotated[Path, typer.Argument(metavar="SESSION.toml", help="Session file: the frames.")],
    out: Annotated[Path, typer.Option(metavar="RUN", help="Run folder to make; it must not exist yet.")],
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run", help="Print the steps, the time and the disk they need, or what refuses them; touch no device."
        ),
    ] = False,
    at: Annotated[
        str | None, typer.Option(metavar="TIME", help="Begin then, such as 2026-05-04T10:00Z; a zone is needed.")
    ] = None,
    until: Annotated[str | None, typer.Option(metavar="TIME", help="Take no frame from then on.")] = None,
    noise: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Noise calibration: what noise does to sum rule, drift, DoLP. none: pick none."
        ),
    ] = None,
    polarizer: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Polarizer calibration: the rig file has to agree with it. none: pick none."),
    ] = None,
    scene: Annotated[Path | None, typer.Option(metavar="FILE", help="Scene file, for --target-dolp-sigma.")] = None,
    target_dolp_sigma: Annotated[
        float | None,
        typer.Option(metavar="S", help="Take as many cycles as bring the error of a pixel's DoLP in --scene to this."),
    ] = None,
    clock: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Simulated rig: its clock begins then, and the session does not wait."),
    ] = None,
    perturb: Annotated[
        RoofChange | None,
        typer.Option(metavar="|".join(ROOF_CHANGES), help="Simulated roof: change it against its scene file."),
    ] = None,
    ask: Annotated[
        Asked,
        typer.Option(help="Where somebody has to cover the lens: ask at the terminal, or hold until `rigctl resume`."),
    ] = Asked.TERMINAL,
    store: CalibrationStore = None,
) -> None:
    """Take a session: each frame is on the disk, whole, before it counts. `rigctl resume` goes on where it ended.

    Exit codes: 0 finished, 75 stopped before its end by Ctrl-C, a signal or `rigctl stop` (a second Ctrl-C stops at
    once: 130), 2, 3 and 4 as everywhere.

    Example: rigctl acquire examples/rig-sim.toml examples/session.toml --out runs/panels

    Example: rigctl acquire examples/rig-sim.toml examples/session.toml --out runs/panels --scene
    examples/scene-panels.toml --target-dolp-sigma 0.01

    Example: rigctl acquire examples/rig-roof.toml examples/session-roof.toml --out runs/noon --clock 2010-05-25T17:07Z
    """
    from rigctl.jobs.acquire import AcquireRequest, acquire, prepare_session, require_takeable

    prepared = prepare_session(
        AcquireRequest(
            rig=rig,
            session=session,
            noise=noise,
            polarizer=polarizer,
            scene=scene,
            target_dolp_sigma=target_dolp_sigma,
            clock_ns=time_option("--clock", clock),
            perturb=perturb,
            asks_by_hold=ask is Asked.HOLD,
            store=store,
            picks=True,
        )
    )
    at_ns, until_ns = time_option("--at", at), time_option("--until", until)
    for line in prepared.picked.lines:
        progress().print(line, markup=False)
    for line in prepared.chosen:
        progress().print(f"--target-dolp-sigma: {line}", markup=False)
    for doubt in prepared.doubts:
        warn(doubt)
    found = require_takeable(prepared, out, at_ns=at_ns, until_ns=until_ns)
    for said in found.light:
        progress().print(said, markup=False, soft_wrap=True)
    if dry_run:
        for doubt in found.doubts:
            warn(doubt)
        _print_steps(prepared)
        return
    outcome = acquire(prepared, out, warn=warn, at_ns=at_ns, until_ns=until_ns)
    say_outcome(outcome, out)


def say_outcome(outcome: "Outcome", run: Path) -> None:
    """Say how a session went, and end with the exit code that a scheduler understands."""
    if outcome.was_finished:
        progress().print(f"nothing to do: this session is finished, {outcome.frames} frames in {run}", markup=False)
        return
    progress().print(f"{outcome.frames} frames in {run}", markup=False)
    if not outcome.is_finished:
        progress().print(f"stopped at {outcome.frames} of {outcome.planned}; rigctl resume {run}", markup=False)
        raise typer.Exit(EXIT_INCOMPLETE)


def _print_steps(prepared: "PreparedSession") -> None:
    steps, need = prepared.steps, prepared.need
    columns: tuple[Column[Step], ...] = (
        Column(title="step", text=lambda step: str(step.sequence)),
        Column(title="kind", text=lambda step: step.kind, left=True),
        Column(title="cycle", text=lambda step: str(step.cycle)),
        Column(title="polarizer [deg]", text=_angle),
        Column(title="exposure [ms]", text=_exposure),
    )
    console = results()
    console.print(terminal_table(Table(columns=columns, rows=tuple(steps))))
    disk = "not known before the camera is opened" if need.disk_bytes is None else f"{need.disk_bytes / 1e6:.0f} MB"
    minutes, seconds = divmod(round(need.duration_s), _SECONDS_A_MINUTE)
    console.print(f"{len(steps)} frames, about {minutes} min {seconds} s, disk {disk}", markup=False)


def _angle(step: "Step") -> str:
    return "" if step.polarizer_angle_deg is None else f"{step.polarizer_angle_deg:g}"


def _exposure(step: "Step") -> str:
    return "metered" if step.exposure_s is None else f"{step.exposure_s * 1000:g}"
