"""``rigctl status``: where a session stands."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from rigctl.runs.run_state import RunState, state_of
from rigctl.terminal import print_json, results

_SECONDS_A_MINUTE = 60


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Say where a session stands: frames, remaining time, numbers per angle, last events. Ask from any terminal.

    Example: rigctl status runs/2026-05-04
    """
    state = state_of(run)
    if as_json:
        print_json(asdict(state))
        return
    _print(state)


def _print(state: RunState) -> None:
    console = results()
    by = "" if state.process is None else f" (process {state.process})"
    console.print(f"{state.run}: {state.state}{by}", markup=False)
    live = state.live or {}
    console.print(f"frames        {state.frames} of {live.get('frames_planned', 'unknown')}", markup=False)
    if state.process is not None and "remaining_s" in live:
        minutes, seconds = divmod(round(live["remaining_s"]), _SECONDS_A_MINUTE)
        console.print(f"remaining     {minutes} min {seconds} s, until {live['end_utc'][:19]}Z", markup=False)
    for angle, numbers in live.get("angles", {}).items():
        console.print(f"{angle:>6} deg    {_numbers(numbers)}", markup=False)
    for name, text in (("sum_rule", "(I0 + I90) / (I45 + I135)"), ("dolp_of_mean", "DoLP of the mean counts")):
        if live.get(name) is not None:
            console.print(f"{text}  {live[name]:.4f}", markup=False)
    for event in state.events:
        facts = ", ".join(f"{name} {value}" for name, value in event["facts"].items())
        console.print(f"{event['utc'][:19]}Z  {event['event']}  {facts}", markup=False)


def _numbers(numbers: dict[str, Any]) -> str:
    return f"mean {numbers['mean_dn']:.1f} DN, saturated {100 * numbers['saturated_fraction']:.2f} %"
