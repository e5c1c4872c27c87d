"""``rigctl status``: where a session stands."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.terminal import print_json, results

if TYPE_CHECKING:
    from rigctl.live.run_state import RunState

_SECONDS_A_MINUTE = 60
# Characters of a time in UTC, without its fraction.
_TO_SECONDS = 19


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Say where a session stands; ask from any terminal.

    Frames, remaining time, counts and saturation by angle; sum rule, drift, and DoLP of the regions of the last cycle,
    each with the standard deviation that noise predicts where the session was given a calibration (`--noise`).

    Example: rigctl status runs/2026-05-04
    """
    from rigctl.live.live_status import status_json
    from rigctl.live.run_state import state_of

    state = state_of(run)
    if as_json:
        print_json(asdict(state) | {"live": None if state.live is None else status_json(state.live)})
        return
    _print(state)


def _print(state: "RunState") -> None:
    from rigctl.live.live_text import live_lines
    from rigctl.runs.run_events import event_line

    console = results()
    by = "" if state.process is None else f" (process {state.process})"
    console.print(f"{state.run}: {state.state}{by}", markup=False)
    live = state.live
    planned = "unknown" if live is None else live.frames_planned
    console.print(f"frames        {state.frames} of {planned}", markup=False)
    console.print(f"disk          {state.disk_free_mb:.0f} MB free", markup=False)
    if state.process is not None and live is not None and live.progress is not None:
        minutes, seconds = divmod(round(live.progress.remaining_s), _SECONDS_A_MINUTE)
        until = live.progress.end_utc[:_TO_SECONDS]
        console.print(f"remaining     {minutes} min {seconds} s, until {until}Z", markup=False)
    if live is not None and live.numbers is not None:
        for line in live_lines(live.numbers):
            console.print(line, markup=False)
    for event in state.events:
        console.print(event_line(event), markup=False)
