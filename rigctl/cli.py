"""The command line: which verbs there are, under which heading, and how one is called.

A verb is a function `rigctl.verbs.MODULE:NAME` whose signature and docstring are its options and its help. What all
verbs share is done here and nowhere else: destinations are tried before any work, numbers are checked, results are
shown or written as JSON, and every failure gets its words and its exit code.
"""

import ctypes
import gc
import inspect
import logging
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, get_args, get_type_hints

from cyclopts import (
    App,
    CoercionError,
    CycloptsError,
    Group,
    MissingArgumentError,
    Parameter,
    UnusedCliTokensError,
)

from rigctl.base.destination import (
    Destination,
    edited_before,
    keep_old,
    origin_of,
    remember_written,
    require_free,
    results_of,
    snapshot,
)
from rigctl.console import EXIT_INTERRUPTED, EXIT_USAGE, anonymous, failure_json, failure_of, lasting_streams, visible
from rigctl.errors import ConfigError
from rigctl.verbs.options import NOT_AN_INPUT, Writes

# Heading -> {verb: (function, one line of help)}; None is a group of verbs. The module of a function is imported when
# its verb is called.
HEADINGS: dict[str, dict[str, tuple[str | None, str]]] = {
    "Start": {
        "demo": ("rigctl.verbs.demo:demo", "Run the whole job on a simulated rig: session, calibration, report."),
        "new": ("rigctl.verbs.new:new", "Write the files of a new rig into a folder, ready to run."),
        "doctor": ("rigctl.verbs.doctor:doctor", "Check network, disk, clock and devices, and say what to change."),
    },
    "Rig": {
        "devices": ("rigctl.verbs.devices:devices", "List ports, stages and cameras, with lines for the rig file."),
        "preview": ("rigctl.verbs.preview:preview", "Show what a camera sees, and how sharp it is, for focusing."),
        "serve": ("rigctl.verbs.serve:serve", "Operate a rig from a browser, or watch a run while it is taken."),
        "sim": (None, "Serve simulated devices to other programs."),
        "sim stage": ("rigctl.verbs.sim:stage", "Serve a simulated rotation stage on a pseudo-terminal."),
        "sim camera": ("rigctl.verbs.sim:camera", "Serve a simulated camera over GigE Vision."),
        "sim lens": ("rigctl.verbs.sim:lens", "Turn the lens of a simulated camera."),
    },
    "Session": {
        "plan": ("rigctl.verbs.session:plan", "Print the steps of a session, its duration and disk space."),
        "acquire": ("rigctl.verbs.session:acquire", "Take a session: frames at measured polarizer angles."),
        "resume": ("rigctl.verbs.session:resume", "Continue a session that holds or was interrupted."),
        "hold": ("rigctl.verbs.session:hold", "Hold a running session after the current frame."),
        "stop": ("rigctl.verbs.session:stop", "Stop a running session after the current frame."),
    },
    "Run": {
        "status": ("rigctl.verbs.status:status", "Print the progress of a session, the contents of a run, or its log."),
        "note": ("rigctl.verbs.note:note", "Write a note about a run, or exclude frames with a reason."),
        "verify": ("rigctl.verbs.verify:verify", "Check whether a run is complete, unfinished or damaged."),
        "regions": (None, "Draw regions on a picture; find them again by markers."),
        "regions draw": ("rigctl.verbs.regions:draw", "Draw regions on a picture of a run, in a browser."),
        "regions mark": ("rigctl.verbs.regions:mark", "Add the markers in the picture to a regions file."),
        "regions find": ("rigctl.verbs.regions:find", "Find regions again by markers after the camera has moved."),
        "import": ("rigctl.verbs.import_images:import_images", "Make a run from images of other programs."),
        "export": ("rigctl.verbs.export:export", "Write a run as CSV, FITS, TIFF, HDF5 or Zarr."),
        "bundle": ("rigctl.verbs.bundle:bundle", "Pack a run for a bug report, without secrets."),
    },
    "Calibrate": {
        "calibrate": (None, "Calibrate sensor, polarizer, optics or pointing."),
        "calibrate noise": (
            "rigctl.verbs.calibrate:noise",
            "Gain, read noise, dark current, PRNU and DSNU of the sensor.",
        ),
        "calibrate axis": ("rigctl.verbs.axis:axis", "Sense of rotation, axis offset and extinction of the polarizer."),
        "calibrate flat": ("rigctl.verbs.calibrate:flat", "Flat fields for each polarizer angle."),
        "calibrate lens": ("rigctl.verbs.calibrate:lens", "Focal length, principal point and distortion of the lens."),
        "calibrate radiometric": (
            "rigctl.verbs.calibrate:radiometric",
            "Counts per unit of radiance, from a reference panel.",
        ),
        "calibrate registration": (
            "rigctl.verbs.calibrate:registration",
            "Shift of the picture at each polarizer angle.",
        ),
        "calibrate doubling": ("rigctl.verbs.calibrate:doubling", "Temperature rise that doubles the dark current."),
        "calibrate stage": (
            "rigctl.verbs.calibrate_stage:stage",
            "Readback error, backlash and settling time of the stage.",
        ),
        "calibrate pointing": ("rigctl.verbs.pointing:pointing", "Direction of the camera and tilt of panels."),
        "calibrate list": ("rigctl.verbs.store:list_store", "List the stored calibrations, and which are selected."),
        "calibrate history": ("rigctl.verbs.store:history", "Changes of calibrated numbers over time."),
    },
    "Measure": {
        "look": ("rigctl.verbs.look:look", "Show S0, DoLP and AoLP maps of a few images, uncalibrated."),
        "stokes": ("rigctl.verbs.stokes:stokes", "Measure Stokes parameters, DoLP and AoLP of a run and its regions."),
        "detect": ("rigctl.verbs.detect:detect", "Detect a target by its polarization: RX map and ROC of a run."),
        "compare": ("rigctl.verbs.compare:compare", "Compare a run with the model, and give a verdict."),
        "infer": (
            "rigctl.verbs.infer:infer",
            "Infer uncertain numbers of a scene from runs.",
        ),
    },
    "Model": {
        "predict": ("rigctl.verbs.predict:predict", "Predict counts, Stokes parameters and DoLP of a scene."),
        "sweep": ("rigctl.verbs.predict:sweep", "Predict a scene over ranges of its numbers."),
        "effects": ("rigctl.verbs.effects:effects", "List the effects that matter in a scene, and why."),
        "tradeoff": ("rigctl.verbs.tradeoff:tradeoff", "Show the cost of accuracy in computing or session time."),
        "sky": ("rigctl.verbs.sky:sky", "Compute the polarized sky of a scene."),
        "surface": ("rigctl.verbs.surface:surface", "Print DoLP and reflectance of a material against angle."),
        "paper": ("rigctl.verbs.paper:paper", "Reproduce figures and statements of the paper, with verdicts."),
    },
    "Many runs": {
        "archive": (None, "Index an archive of runs, find runs in it, and process all of them."),
        "archive index": ("rigctl.verbs.archive:index", "Make or update the index of an archive."),
        "archive find": ("rigctl.verbs.archive:find", "Print the runs and regions that fulfil a condition."),
        "archive health": ("rigctl.verbs.archive:health", "Print how the rig changed from run to run."),
        "archive compare": ("rigctl.verbs.archive:compare", "Compare every run with the model."),
        "archive stokes": ("rigctl.verbs.archive:stokes", "Measure every run."),
        "archive verify": ("rigctl.verbs.archive:verify", "Check every checksum of every run."),
        "archive recalibrate": ("rigctl.verbs.archive:recalibrate", "Measure every run again with other calibrations."),
        "study": ("rigctl.verbs.study:study", "Predict thousands of cases: grids, random draws, sensitivity."),
    },
}

VERBS = tuple(verb for verbs in HEADINGS.values() for verb in verbs)

# Of malloc.h, and the memory beyond which it is given back to the system: some pictures of 2448 x 2048.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _KEPT_BYTES = -1, -3, 64 << 20

# Objects made and not freed until Python looks for those that hold each other: imports make many that
# stay, and looking through them each 700 takes a twentieth of a start.
_COLLECT_AFTER = 50_000, 10, 10

_FLAGS = ("--json", "--force", "--anonymous")
_EPILOGUE = (
    "Every command also takes --json (answer in JSON, failures too), --force (replace results of another command or of "
    "other inputs) and --anonymous (leave serial numbers, ports, site, folders and machine out of results)."
)
_KINDS = {float: "a number", int: "a whole number"}
_EXIT_CODES = "Exit codes: 0 done, 2 usage, 3 device, 4 data, 5 disagrees, 75 stopped on request."


def _version() -> str:
    from rigctl.version import VERSION

    return f"rigctl {VERSION}"


def _shown_default(value: Any) -> Any:
    """Return a default as help shows it; an option that is off or empty unless given needs no word."""
    if value is None or value is False or value in ((), ""):
        return None
    return ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def make_app(called: str = "") -> App:
    """Return the command line; only the module of the verb that is called is imported.

    The verb that is called has its own docstring as its help, every other one the line that the list shows.
    """
    app = App(
        name="rigctl",
        help="Instrument control, sensor calibration and model validation for division-of-time polarimetry.",
        help_epilogue=f"{_EPILOGUE}\n\nStart with rigctl demo. {_EXIT_CODES}",
        help_format="markdown",
        version=_version,
        default_parameter=Parameter(negative=(), show_env_var=False, show_default=_shown_default),
        exit_on_error=False,
        print_error=False,
        result_action="return_value",
    )
    for place, (heading, verbs) in enumerate(HEADINGS.items()):
        group = Group(heading, sort_key=place)
        for order, (name, (target, text)) in enumerate(verbs.items()):
            *above, last = name.split()
            parent = app
            for word in above:
                parent = parent[word]
            under = None if above else group
            if target is None:
                parent.command(App(name=last, help=text, help_epilogue=_EPILOGUE, group=under, sort_key=order))
            else:
                own_help = None if name == called else text
                parent.command(target, name=last, help=own_help, group=under, sort_key=order)
    app.register_install_completion_command()
    return app


def function_of(verb: str) -> Callable[..., Any]:
    """Return the function of a verb."""
    app = make_app(verb)
    for word in verb.split():
        app = app[word]
    command = app.default_command
    if command is None:
        raise ValueError(f"{verb} is a group of verbs")
    return command


def commands_page() -> str:
    """Return the reference page of all commands as Markdown."""
    parts = [f"# Commands\n\n{_EPILOGUE}\n"]
    for heading, verbs in HEADINGS.items():
        parts.append(f"\n## {heading}\n")
        for name, (target, text) in verbs.items():
            if target is None:
                parts.append(f"\n### rigctl {name}\n\n{text}\n")
                continue
            command = make_app(name)
            for word in name.split():
                command = command[word]
            page = command.generate_docs(heading_level=3).replace("--empty-", "--no-")
            parts.append("\n" + re.sub(r"^### .*", f"### rigctl {name}", page, count=1))
    return "".join(parts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line; return its exit code. Only this function turns an exception into words."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    tokens, flags = _taken_flags(given)
    _keep_memory()
    gc.set_threshold(*_COLLECT_AFTER)
    with lasting_streams(), _reports_printed():
        return _run(tokens, flags)


def _taken_flags(arguments: list[str]) -> tuple[list[str], set[str]]:
    """Return the arguments without the flags that every verb has, and these."""
    end = arguments.index("--") if "--" in arguments else len(arguments)
    flags = {word for word in arguments[:end] if word in _FLAGS}
    return [word for place, word in enumerate(arguments) if place >= end or word not in _FLAGS], flags


def parsed(arguments: Sequence[str]) -> tuple[Callable[..., Any], inspect.BoundArguments]:
    """Return the function that a command line calls and its arguments.

    Raises
    ------
    CycloptsError
        There is no such command or option, or a value cannot be read.
    """
    tokens, _ = _taken_flags(list(arguments))
    command, bound, _ = make_app(" ".join(_verb_of(tokens))).parse_args(tokens)
    return command, bound


def _run(tokens: list[str], flags: set[str]) -> int:
    verb, failed = " ".join(_verb_of(tokens)), None
    try:
        command, bound = parsed(tokens)
        return _call(command, bound, flags, verb=verb)
    except CycloptsError as error:
        code, message = EXIT_USAGE, f"{_mistake(error)}\nTry: rigctl {verb} --help".replace("  --help", " --help")
    except KeyboardInterrupt:
        code, message = EXIT_INTERRUPTED, "interrupted"
    except SystemExit as finished:
        return finished.code if isinstance(finished.code, int) else 0
    except Exception as error:
        code, message = failure_of(error)
        failed = error
    if "--json" in flags:
        said, _, _ = message.partition("\nTry: ")  # JSON has that under "next"
        sys.stdout.write(failure_json(code, visible(said), verb=tokens[0] if tokens else "", error=failed))
    _say(message)
    return code


def _mistake(error: CycloptsError) -> str:
    """Return what is wrong with a command line."""
    if isinstance(error, UnusedCliTokensError):
        found = " ".join(map(repr, error.unused_tokens or ()))
        return f"{found}: nothing is expected there; the name of an option may be missing before it"
    name = "" if error.argument is None else error.argument.name
    if type(error) is MissingArgumentError:
        has_begun = error.keyword is not None or (error.argument is not None and bool(error.argument.tokens))
        return f"{error.keyword or name} " + ("needs a value" if has_begun else "is missing")
    if isinstance(error, CoercionError) and error.token is not None and error.target_type in _KINDS:
        return f"{error.token.keyword or name} {error.token.value!r}: must be {_KINDS[error.target_type]}"
    return str(error)


def _verb_of(tokens: Sequence[str]) -> Iterator[str]:
    """Yield the words of the verb that a command line begins with."""
    for count in (2, 1):
        if " ".join(tokens[:count]) in VERBS:
            yield from tokens[:count]
            return


def _call(command: Callable[..., Any], bound: inspect.BoundArguments, flags: set[str], *, verb: str) -> int:
    """Call a verb with its destinations tried, and show what it returns."""
    if command.__module__.partition(".")[0] == "cyclopts":  # help, version, completion
        command(*bound.args, **bound.kwargs)
        return 0
    bound.apply_defaults()
    values = _values(bound)
    _require_numbers(values)
    with _destinations_tried(command, values, flags, verb=verb):
        result = command(*bound.args, **bound.kwargs)
        return 0 if result is None else _show(result, as_json="--json" in flags)


def _show(result: Any, *, as_json: bool) -> int:
    """Show what a verb returned: the answer on standard output; return the exit code."""
    result.show_json() if as_json else result.show()
    sys.stdout.flush()
    result.follow()
    return int(result.exit_code)


def _values(bound: inspect.BoundArguments) -> dict[str, Any]:
    """Return the values of a call by name, those of shared options among them."""
    values = dict(bound.arguments)
    for name, parameter in bound.signature.parameters.items():
        if parameter.kind is inspect.Parameter.VAR_KEYWORD:
            values |= values.pop(name, {})
    return values


def destinations(command: Callable[..., Any]) -> dict[str, Writes]:
    """Return the parameters of a verb that name what it writes."""
    return {name: one for name, found in _annotations(command).items() for one in found if isinstance(one, Writes)}


def _annotations(command: Callable[..., Any]) -> dict[str, tuple[Any, ...]]:
    """Return what is annotated of each parameter of a verb."""
    return {name: getattr(hint, "__metadata__", ()) for name, hint in hints_of(command).items()}


def hints_of(command: Callable[..., Any]) -> dict[str, Any]:
    """Return the annotation of each parameter of a verb; what only type checkers know is left out."""
    found: dict[str, Any] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        if parameter.kind is inspect.Parameter.VAR_KEYWORD:
            (options,) = get_args(parameter.annotation)
            found |= get_type_hints(options, include_extras=True)
        else:
            found[name] = parameter.annotation
    return found


def _require_numbers(values: Mapping[str, Any]) -> None:
    """Refuse numbers that no arithmetic may be done with."""
    from rigctl.base.numbers import wild_numbers

    problems = [f"{_option(name.partition('.')[0])}: {text}" for name, text in wild_numbers(values)]
    if problems:
        raise ConfigError("\n  ".join(problems))


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


@contextmanager
def _destinations_tried(
    command: Callable[..., Any], values: Mapping[str, Any], flags: set[str], *, verb: str
) -> Iterator[None]:
    """Try the destinations that a verb writes to before it begins; note afterwards what was written from what."""
    writes = destinations(command)
    places = [_destination(name, one, values) for name, one in writes.items() if values.get(name) is not None]
    no_inputs = {name for name, found in _annotations(command).items() if NOT_AN_INPUT in found}
    inputs = list(_inputs(values, no_inputs | set(writes)))
    paths = (*inputs, *(one.path for one in places))
    with anonymous(paths) if "--anonymous" in flags else nullcontext():
        if not places or values.get("dry_run"):
            yield
            return
        options = {name: value for name, value in values.items() if name not in writes}
        origin = origin_of(verb, options | {"anonymous": "--anonymous" in flags}, inputs)
        require_free(places, origin, inputs=inputs, force="--force" in flags)
        edited, before = edited_before(places), snapshot(places)
        try:
            with results_of(origin, force="--force" in flags):
                yield
        finally:
            keep_old(edited)
            remember_written(places, before, origin)


def _destination(name: str, place: Writes, values: Mapping[str, Any]) -> Destination:
    path, source = Path(values[name]), values.get(place.edits or "")
    is_edited = isinstance(source, Path) and os.path.realpath(source) == os.path.realpath(path)
    option = name.upper() if place.is_argument else _option(name)
    return Destination(option=option, path=path, kind="edited" if is_edited else place.kind, names=place.names)


def _inputs(values: Mapping[str, Any], besides: set[str]) -> Iterator[Path]:
    for name, value in values.items():
        if name not in besides:
            many = value if isinstance(value, list | tuple) else (value,)
            yield from (one for one in many if isinstance(one, Path))


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


@contextmanager
def _reports_printed() -> Iterator[None]:
    reports, log = _Reports(), logging.getLogger("rigctl")
    level = log.level
    log.addHandler(reports)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(reports)
        log.setLevel(level)
        for text in reports.below:
            _print_error(text)


class _Reports(logging.Handler):
    """Prints what verbs report on standard error: notes as they are, each warning once; some wait for the answer."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._printed: set[str] = set()
        self.below: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Print a report."""
        text = record.getMessage()
        if getattr(record, "below", False):
            self.below.append(text)
        elif record.levelno < logging.WARNING:
            _print_error(text)
        elif text not in self._printed:
            self._printed.add(text)
            _say(f"warning: {text}")


def _say(message: str) -> None:
    _print_error(f"rigctl: {message}")


def _print_error(text: str) -> None:
    """Print on standard error; on a terminal lines break between words."""
    text = visible(text)
    if sys.stderr.isatty():
        width = shutil.get_terminal_size().columns
        text = "\n".join(_wrapped(line, width) for line in text.split("\n"))
    sys.stderr.write(f"{text}\n")


def _wrapped(line: str, width: int) -> str:
    """Return a line broken between words; a line that fits keeps its spaces."""
    if len(line) <= width:
        return line
    return textwrap.fill(line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
