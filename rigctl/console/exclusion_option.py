"""The option ``--ignore-exclusions`` of every command that makes numbers of a run's frames."""

import functools
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from rigctl.console.options import options_of

_NAME = "ignore_exclusions"
READERS = frozenset(
    {
        "calibrate axis",
        "calibrate flat",
        "calibrate noise",
        "calibrate radiometric",
        "calibrate registration",
    }
)


_IGNORED: ContextVar[bool] = ContextVar("exclusions_ignored", default=False)


@contextmanager
def exclusions_ignored() -> Iterator[None]:
    """Read runs with all their frames, until the context is left."""
    token = _IGNORED.set(True)
    try:
        yield
    finally:
        _IGNORED.reset(token)


def are_exclusions_ignored() -> bool:
    """Return whether runs are to be read with all their frames."""
    return _IGNORED.get()


def with_exclusion_option(verb: str, command: Any) -> Any:
    """Return a command that takes all frames of its runs where that is asked for; commands of a group likewise."""
    if isinstance(command, TyperGroup):
        for name, one in command.commands.items():
            with_exclusion_option(f"{verb} {name}", one)
        return command
    body = command.callback
    if verb not in READERS or body is None:
        return command
    command.params += options_of(_ignoring)

    @functools.wraps(body)
    def run_with(**values: Any) -> Any:
        with exclusions_ignored() if values.pop(_NAME, False) else nullcontext():
            return body(**values)

    command.callback = run_with
    return command


def _ignoring(
    ignore_exclusions: Annotated[
        bool, typer.Option("--ignore-exclusions", help="Take frames too that people have excluded.")
    ] = False,
) -> None:
    """Have the option."""
