"""``rigctl notify``: notices of sessions, tried before they are needed."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.failures import EXIT_DEVICE
from rigctl.console.terminal import progress, results

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def notify() -> None:
    """Notices of sessions: at their end, when they hold, stop or fail, at an interlock, on a short disk.

    Example: rigctl notify test rig.toml
    """


@app.command("test")
def test_command(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file with a section [notify].")],
) -> None:
    """Send a notice the way that the rig file says, and tell whether it went; a failure ends with 3.

    Example: rigctl notify test rig.toml
    """
    from rigctl.jobs.notify import send_test

    problems = send_test(rig)
    for problem in problems:
        progress().print(problem)
    if problems:
        raise typer.Exit(EXIT_DEVICE)
    results().print("the notice was sent")
