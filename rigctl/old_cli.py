"""The command line: which verbs there are, and how one is called."""

import ctypes
import gc
import importlib
import logging
import re
import sys
from collections import Counter
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any

import typer
from typer.core import TyperGroup

from rigctl.base.numbers import with_options_in_range
from rigctl.console.console_streams import lasting_streams, visible
from rigctl.console.destination_options import with_tried_destinations
from rigctl.console.failures import EXIT_INTERRUPTED, failure_json, failure_of
from rigctl.errors import ConfigError
from rigctl.verbs import HEADINGS

# Of malloc.h, and the memory beyond which it is given back to the system: some pictures of 2448 x 2048.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _KEPT_BYTES = -1, -3, 64 << 20

# Objects made and not freed until Python looks for those that hold each other: imports make many that
# stay, and looking through them each 700 takes a twentieth of a start.
_COLLECT_AFTER = 50_000, 10, 10

_MODULES = {"import": "import_images"}
# Verb -> (module that holds its `command` or `app`, one line of help), of the verbs that are not yet in rigctl/verbs.
VERBS: dict[str, tuple[str, str]] = {
    verb: (f"rigctl.commands.{_MODULES.get(verb, verb)}", text)
    for verbs in HEADINGS.values()
    for verb, (target, text) in verbs.items()
    if target == "old"
}


def holds(verb: str) -> bool:
    """Return whether a verb is still here."""
    return verb in VERBS


EPILOG = "Start with `rigctl demo`. Exit codes: 0 done, 2 usage, 3 device, 4 data, 5 disagrees, 75 stopped on request."


def once_each(command: Any) -> Any:
    """Return a command, or a group with its commands, that refuses an option given twice where it holds one value."""
    for inner in getattr(command, "commands", {}).values():
        once_each(inner)
    parse = command.parse_args

    def parse_args(context: Any, arguments: list[str]) -> Any:
        try:
            _refuse_repeats(command, context, arguments)
            return parse(context, arguments)
        except typer.BadParameter as error:
            error.message = _in_plain_words(error.message)
            raise

    command.parse_args = parse_args
    return command


def _in_plain_words(message: str) -> str:
    """Return what the command line library says of an option in the words of this program."""
    choice = re.fullmatch(r"Value error, ('[^']*') is not one of (.*?)\.?", message)
    if choice is not None:
        close = get_close_matches(choice[1].strip("'").lower(), re.findall(r"'([^']*)'", choice[2]), n=1)
        return f"{choice[1]} is not one of {choice[2]}{f'; did you mean {close[0]}?' if close else ''}"
    limit = re.fullmatch(r"Input should be (greater|less) than (or equal to )?(-?[0-9.]+)", message)
    if limit is not None:
        words = {("greater", True): "at least", ("greater", False): "above", ("less", True): "at most"}
        return f"must be {words.get((limit[1], bool(limit[2])), 'below')} {float(limit[3]):g}"
    number = re.match(r"Input should be a valid (number|integer)", message)
    return message if number is None else f"must be a {'whole ' if number[1] == 'integer' else ''}number"


def _refuse_repeats(command: Any, context: Any, arguments: list[str]) -> None:
    """Read the arguments as the command line does, and count which options stand there."""
    _, _, order = command.make_parser(context).parse_args(args=list(arguments))
    for one, times in Counter(found for found in order if found.param_type_name == "option").items():
        if times > 1 and not one.multiple and not getattr(one, "count", False):
            raise typer.BadParameter(f"is given {times} times; it has one value", context, one)


class LazyGroup(TyperGroup):
    """A group of commands that imports a command's module only when that command is asked for."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the verbs in the order in which a newcomer meets them."""
        return list(VERBS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return one verb's command, imported now."""
        if cmd_name not in VERBS:
            return None
        module = importlib.import_module(VERBS[cmd_name][0])
        app = getattr(module, "app", None)
        if app is None:
            app = typer.Typer(add_completion=False, rich_markup_mode=None)
            app.command(cmd_name)(module.command)
        command = once_each(_in_range(typer.main.get_command(app)))
        return with_tried_destinations(cmd_name, command)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the verb that was asked for; of an unknown one say which may have been meant."""
        if args and args[0] not in VERBS and not args[0].startswith("-"):
            known = [*VERBS, "--help"]
            close = get_close_matches(args[0].lower(), known, n=2, cutoff=0.7)
            close = close or get_close_matches(args[0].lower(), known, n=1, cutoff=0.5)
            alike = f" Did you mean {' or '.join(close)}?" if close else ""
            ctx.fail(f"No such command {args[0]!r}.{alike}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list of verbs without importing any of them."""
        with formatter.section("Commands"):
            formatter.write_dl([(verb, text) for verb, (_, text) in VERBS.items()])


def _in_range(command: Any) -> Any:
    """Return a verb, all of whose commands refuse numbers that no arithmetic may be done with."""
    for inner in getattr(command, "commands", {}).values():
        _in_range(inner)
    if command.callback is not None:
        command.callback = with_options_in_range(command.callback, ConfigError)
    return command


app = typer.Typer(cls=LazyGroup, add_completion=True, no_args_is_help=True, epilog=EPILOG, rich_markup_mode=None)


def _print_version(asked: bool) -> None:
    if asked:
        from rigctl.version import VERSION

        sys.stdout.write(f"rigctl {VERSION}\n")
        raise typer.Exit()


@app.callback()
def rigctl(
    version: bool = typer.Option(
        False, "--version", help="Print the version and stop.", callback=_print_version, is_eager=True
    ),
) -> None:
    """Instrument control, sensor calibration and model validation for division-of-time polarimetry."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line; return its exit code. Only this function turns an exception into words."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    _keep_memory()
    gc.set_threshold(*_COLLECT_AFTER)
    remarks = _Remarks()
    logging.getLogger("rigctl").addHandler(remarks)
    logging.getLogger("rigctl").setLevel(logging.INFO)
    try:
        with lasting_streams():
            return _run_for_programs(given) if "--json" in given else _run(given)
    finally:
        logging.getLogger("rigctl").removeHandler(remarks)


def _keep_memory() -> None:
    """Have memory of pictures taken again, not given back and asked for anew: each page of it costs a fault.

    A third of a microsecond a page, a quarter of the time of `rigctl stokes`. Only the C library of GNU knows this.
    """
    try:
        set_option = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError, TypeError):
        return
    set_option(_TRIM_THRESHOLD, _KEPT_BYTES)
    set_option(_MMAP_THRESHOLD, _KEPT_BYTES // 2)


def _run(arguments: list[str]) -> int:
    command = typer.main.get_command(app)
    try:
        command.main(args=arguments, prog_name="rigctl")
    except SystemExit as finished:  # typer has said what there is to say: help, a usage error, an exit code
        return finished.code if isinstance(finished.code, int) else 0
    except Exception as error:
        code, message = failure_of(error)
        _say(message)
        return code
    return 0


def _run_for_programs(arguments: list[str]) -> int:
    """Run one command line that is to answer in JSON: a failure is JSON on standard output too; the exit code stays."""
    command = typer.main.get_command(app)
    try:
        code = command.main(args=arguments, prog_name="rigctl", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code, message = EXIT_INTERRUPTED, "interrupted"
    except SystemExit as finished:
        return finished.code if isinstance(finished.code, int) else 0
    except Exception as error:
        code, message = failure_of(error)
    else:
        return code if isinstance(code, int) else 0
    sys.stdout.write(failure_json(code, visible(message), verb=arguments[0]))
    _say(message)
    return code


class _Remarks(logging.Handler):
    """Says on standard error what the rooms below remark of what they read, each remark once."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._said: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Say a remark."""
        text = record.getMessage()
        if record.levelno < logging.WARNING:
            sys.stderr.write(f"{visible(text)}\n")
        elif text not in self._said:
            self._said.add(text)
            _say(f"warning: {text}")


def _say(message: str) -> None:
    sys.stderr.write(f"rigctl: {visible(message)}\n")
