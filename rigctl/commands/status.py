"""``rigctl status``: where a session stands."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.terminal import print_json, results

if TYPE_CHECKING:
    from rigctl.runs.run_state import RunState

_SECONDS_A_MINUTE = 60


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Say where a session stands; ask from any terminal.

    Frames, remaining time, counts and saturation by angle; sum rule, drift, and DoLP of the regions of the last cycle,
    each with the standard deviation that noise predicts where the session was given a calibration (`--noise`).

    Example: rigctl status runs/2026-05-04
    """
    from rigctl.runs.run_state import state_of

    state = state_of(run)
    if as_json:
        print_json(asdict(state))
        return
    _print(state)


def _print(state: "RunState") -> None:
    from rigctl.live.live_text import live_lines
    from rigctl.runs.run_events import event_line

    console = results()
    by = "" if state.process is None else f" (process {state.process})"
    console.print(f"{state.run}: {state.state}{by}", markup=False)
    live = state.live or {}
    console.print(f"frames        {state.frames} of {live.get('frames_planned', 'unknown')}", markup=False)
    console.print(f"disk          {state.disk_free_mb:.0f} MB free", markup=False)
    if state.process is not None and "remaining_s" in live:
        minutes, seconds = divmod(round(live["remaining_s"]), _SECONDS_A_MINUTE)
        console.print(f"remaining     {minutes} min {seconds} s, until {live.get('end_utc', '')[:19]}Z", markup=False)
    for line in live_lines(live):
        console.print(line, markup=False)
    for event in state.events:
        console.print(event_line(event), markup=False)
