"""Output of the program: answers, progress, warnings, JSON and failures; --anonymous leaves out names.

Results go to standard output, progress and remarks to standard error. A verb reports by `warn` and `note`; `failure_of`
gives a failure its exit code and its words. The parts used by the rest of the package are light to import.
"""

import errno
import json
import logging
import math
import os
import platform
import re
import sys
import tempfile
import tomllib
import traceback
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from threading import Timer
from typing import IO, TYPE_CHECKING, Any, TypeAlias, TypeVar

from calibration.results import CalibrationError
from drivers.errors import AddressError, DeviceError
from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.errors import ConfigError, DataError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

_LOG = logging.getLogger(__name__)
_WIDTH_OF_FILES = 120
# Optical depth above which a wavelength takes seconds to minutes, which is reported if there is no terminal for a bar.
_DEEP = 12.0
# Time before a bar is shown on a terminal [s].
_SILENT_S = 1.0


def warn(text: str) -> None:
    """Report a doubt: on standard error of the command line, or to the logger ``rigctl`` in Python."""
    _LOG.warning("%s", text)


def note(text: str, *, below: bool = False) -> None:
    """Report a step, or written files below the answer; silent in Python unless the logger shows this level."""
    _LOG.info("%s", text, extra={"below": below})


def _console(**options: Any) -> "Console":
    from rich.console import Console

    class SafeConsole(Console):
        """Shows control characters of texts, which may come from files of others, without effect."""

        def render_str(self, text: str, **style: Any) -> "Text":
            """Return a printable text, also for tables."""
            return super().render_str(visible(text), **style)

    # Without markup: "[deg]" is a unit, not a style.
    return SafeConsole(highlight=False, markup=False, **options)


def results() -> "Console":
    """Return the console for the answer of a command."""
    # A table in a file or a pipe may be wider than a terminal.
    width = None if sys.stdout.isatty() else _WIDTH_OF_FILES
    # Lines break between words on a terminal; in a file a sentence is one line.
    return _console(soft_wrap=not sys.stdout.isatty(), width=width)


def progress() -> "Console":
    """Return the console for progress bars and remarks."""
    # In a file a remark is one line.
    return _console(stderr=True, soft_wrap=not sys.stderr.isatty())


@contextmanager
def solving_shown() -> Iterator[Callable[[float], None]]:
    """Show a bar with the time while a scene is computed; the yielded function takes each sky's optical depth.

    The bar appears on a terminal with the first sky, or after a second: light of spheres, wide fields and laws of DoLP
    may take longer than skies. Elsewhere one line warns of deep air.
    """
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = progress()
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    bar, depths = Progress(*columns, console=console, transient=True, disable=not console.is_terminal), list[float]()
    task = bar.add_task("computing", total=None)
    begun = Timer(_SILENT_S, bar.start)
    begun.daemon = True

    def tell(depth: float) -> None:
        if not depths:
            bar.start()
        if depth > _DEEP and not console.is_terminal and max(depths, default=0.0) <= _DEEP:
            console.print(f"optical depth {depth:.3g}: each wavelength takes seconds to minutes")
        depths.append(depth)
        bar.update(task, description=f"sky {len(depths)}, of optical depth {depth:.3g}")

    if console.is_terminal:
        begun.start()
    try:
        yield tell
    finally:
        begun.cancel()
        if begun.is_alive():
            begun.join()
        bar.stop()


@contextmanager
def steps_shown() -> Iterator[Callable[[str, int, int], None]]:
    """Show a bar on a terminal; the yielded function takes the current work, the steps done and their total."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = progress()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda text, done, steps: bar.update(task, completed=done, total=steps, description=text)


# JSON: a missing number is null, with its reason next to it.

# Content of JSON; NaN and infinite numbers become null.
Json: TypeAlias = "Mapping[str, Json] | Sequence[Json] | str | int | float | bool | None"

_JsonT = TypeVar("_JsonT", bound=Json)

REASON_SUFFIX = "_reason"
_NO_NUMBER = "not defined for these inputs"
_NO_BOUND = "infinite for these inputs"


def json_text(content: Json, *, indent: int | None = 2) -> str:
    """Return the content of a JSON file or answer.

    NaN and infinite values become null, with ``KEY_reason`` unless the content has its own reason; for a list, the
    reason has the places.
    """
    return json.dumps(_existing(content), indent=indent, allow_nan=False) + "\n"


def _existing(content: Json) -> Json:
    if isinstance(content, Mapping):
        return _existing_table(content)
    if isinstance(content, list | tuple):
        return [_existing(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def _existing_table(content: Mapping[str, Json]) -> dict[str, Json]:
    found: dict[str, Json] = {}
    for key, value in content.items():
        found[key] = _existing(value)
        reason = _reason(value)
        if reason is not None and content.get(f"{key}{REASON_SUFFIX}") is None:
            found[f"{key}{REASON_SUFFIX}"] = reason
    # The content's own reason takes precedence.
    return found | {key: value for key, value in content.items() if key.endswith(REASON_SUFFIX) and value is not None}


def _reason(value: object) -> str | None:
    """Return the reason why a number, or numbers of a list, are null; None if none is."""
    if isinstance(value, float) and not math.isfinite(value):
        return _NO_NUMBER if math.isnan(value) else _NO_BOUND
    if isinstance(value, list | tuple):
        gone = [(place, reason) for place, one in enumerate(value) if (reason := _reason(one)) is not None]
        return "; ".join(f"item {place}: {reason}" for place, reason in gone[:3]) or None
    return None


# Anonymous results: without folders, serial numbers, ports, site and the name of the machine.

LEFT_OUT = "left out"
# Words in keys whose values identify the rig or its place.
_PERSONAL = frozenset({"serial", "site", "latitude", "longitude", "host", "hostname", "port", "address"})
# They identify a calibration's devices; null means unknown to readers.
_MAY_BE_UNKNOWN = frozenset({"camera_serial", "stage_serial"})
_SHORTEST = 4
_SESSION_FILE = "session.json"
_SECRETS: ContextVar[tuple[tuple[str, str], ...] | None] = ContextVar("secrets", default=None)


@contextmanager
def anonymous(paths: Iterable[Path]) -> Iterator[None]:
    """Leave out of all results within the context what identifies rig and place."""
    token = _SECRETS.set(tuple(sorted(set(_secrets(tuple(paths))), key=lambda pair: -len(pair[0]))))
    try:
        yield
    finally:
        _SECRETS.reset(token)


def is_anonymous() -> bool:
    """Return whether results are anonymous."""
    return _SECRETS.get() is not None


def anonymized(text: str) -> str:
    """Return a text of a result, anonymous if requested."""
    for secret, instead in _SECRETS.get() or ():
        text = text.replace(secret, instead)
    return text


def anonymized_content(content: _JsonT) -> _JsonT:
    """Return the content of a JSON file, anonymous if requested."""
    found: _JsonT = rewritten(content, text=anonymized, value=_anonymized_value) if is_anonymous() else content
    return found


def rewritten(content: Any, *, text: Callable[[str], str], value: Callable[[str, Json], Json]) -> Any:
    """Return the content of a JSON file with two functions applied to every text and to the value of every key."""
    if isinstance(content, Mapping):
        return {key: rewritten(value(key, one), text=text, value=value) for key, one in content.items()}
    if isinstance(content, list | tuple):
        return [rewritten(one, text=text, value=value) for one in content]
    return text(content) if isinstance(content, str) else content


def is_personal(key: str) -> bool:
    """Return whether the value of a key identifies the rig or its place."""
    return not _PERSONAL.isdisjoint(key.lower().split("_"))


def _anonymized_value(key: str, value: Json) -> Json:
    if value is None or not is_personal(key):
        return value
    return None if key in _MAY_BE_UNKNOWN and value != LEFT_OUT else LEFT_OUT


def _secrets(paths: tuple[Path, ...]) -> Iterator[tuple[str, str]]:
    for path in paths:
        for folder in {str(path.parent), str(path.absolute().parent), str(path.resolve().parent)} - {".", "/", ".."}:
            yield f"{folder}/", ""
        for text in _personal_texts(_facts_of(path)):
            yield text, LEFT_OUT
    if len(platform.node()) >= _SHORTEST:
        yield platform.node(), LEFT_OUT


def _facts_of(path: Path) -> Json:
    """Return the content of a run, a calibration or a rig file; nothing for other files."""
    file = path / _SESSION_FILE if path.is_dir() else path
    try:
        if file.suffix == ".json":
            found: Json = json.loads(read_bounded(file, MOST_TEXT_BYTES))
            return found
        return tomllib.loads(read_bounded(file, MOST_TEXT_BYTES).decode()) if file.suffix == ".toml" else None
    except (OSError, ValueError, RecursionError):
        return None


def _personal_texts(content: Json, *, within: bool = False) -> Iterator[str]:
    if isinstance(content, Mapping):
        for key, value in content.items():
            yield from _personal_texts(value, within=within or is_personal(str(key)))
    elif isinstance(content, list | tuple):
        for value in content:
            yield from _personal_texts(value, within=within)
    elif within and isinstance(content, str) and len(content) >= _SHORTEST:
        yield content


# Failures: exit code, words, and ``{"error": {"code", "kind", ...}}`` for programs.

Failure = TypeVar("Failure", bound=BaseException)
_ANSWER = "answer_for_programs"

# 0 (done) and 130 (interrupted) are the command line library's own.
EXIT_USAGE = 2
EXIT_DEVICE = 3
EXIT_DATA = 4
EXIT_DISAGREES = 5
EXIT_OWN_FAULT = 70
EXIT_INTERRUPTED = 130
# As in sysexits.h: a temporary failure, for stopped sessions and unfinished runs.
EXIT_INCOMPLETE = 75

# Exit code of a failure, by the first class that fits.
EXIT_CODES: tuple[tuple[type[BaseException], int], ...] = (
    (ConfigError, EXIT_USAGE),
    (AddressError, EXIT_USAGE),
    (DeviceError, EXIT_DEVICE),
    (DataError, EXIT_DATA),
    (CalibrationError, EXIT_DATA),
)

# Errors of the operating system caused by a disk; others are wrong file names.
_DISK_FAULTS = frozenset({errno.EIO, errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG})

# Python before 3.13 has another kind of error for a link to itself.
_LINK_LOOP = "Symlink loop"

# Packages of modules missing from the installation for acquisition only (`acquisition` in pyproject.toml).
_LEFT_OUT = {
    "astropy": "astropy",
    "jinja2": "jinja2",
    "matplotlib": "matplotlib",
    "PIL": "pillow",
    "reportlab": "reportlab",
}

# By exit code: the failure, and the next step.
_KINDS: dict[int, tuple[str, str]] = {
    2: ("usage", "correct this; `rigctl {verb} --help` has the options, the documentation the keys"),
    3: (
        "device",
        "look at cables, power, addresses; `rigctl devices` lists what answers, `rigctl doctor` checks it",
    ),
    4: ("data", "`rigctl verify RUN` lists damaged frames; make other files again with the command that wrote them"),
    5: ("disagrees", "read the report: it names the likely cause"),
    70: ("own_fault", "report it with the log that the message names"),
    75: ("incomplete", "`rigctl resume RUN` continues; `rigctl status RUN --log` shows what happened"),
    130: ("interrupted", "repeat the command; `rigctl resume RUN` continues a session"),
}
# A problem begins with its key or option: "  camera.address: is missing", "--alpha: is 2".
_KEY = re.compile(r"^\s*(--[a-z][a-z-]*|(?:\w+ \[\[[\w.]+\]\], )?[A-Za-z_][\w.]*)(?=: )", re.MULTILINE)
# Added by the command line to a usage error.
_TRY = re.compile(r"\nTry: .*")


def failure_of(error: Exception) -> tuple[int, str]:
    """Return the exit code and the words of a failure."""
    if isinstance(error, tuple(kind for kind, _ in EXIT_CODES)):
        return next(code for kind, code in EXIT_CODES if isinstance(error, kind)), str(error)
    if hasattr(error, "format_message") and hasattr(error, "exit_code"):  # the command line library's own
        return int(error.exit_code), str(error.format_message())
    if isinstance(error, MemoryError):
        return EXIT_DATA, "there is not enough memory; nothing was written"
    if isinstance(error, RuntimeError) and str(error).startswith(_LINK_LOOP):
        return EXIT_USAGE, str(error)
    if isinstance(error, OSError):
        code = EXIT_DATA if error.errno in _DISK_FAULTS else EXIT_USAGE
        return code, f"{error.filename or 'a file'}: {error.strerror or error}"
    if isinstance(error, ModuleNotFoundError) and error.name in _LEFT_OUT:
        return EXIT_USAGE, (
            f"this needs {error.name}, which an installation for acquisition only lacks: pip install "
            f"{' '.join(_LEFT_OUT.values())}"
        )
    text = f"a fault of rigctl itself: {type(error).__name__}: {error}. Traceback in {_log_traceback()}"
    return EXIT_OWN_FAULT, text


def failure_json(code: int, message: str, *, verb: str, error: BaseException | None = None) -> str:
    """Return `failure_content` as JSON text, with the error's own content for programs."""
    answer = getattr(error, _ANSWER, {})
    return json.dumps({**answer, **failure_content(code, message, verb=verb)}, indent=2) + "\n"


def with_answer(error: Failure, content: Mapping[str, Json]) -> Failure:
    """Return an error whose JSON also has the findings before it failed."""
    setattr(error, _ANSWER, dict(content))
    return error


def failure_content(code: int, message: str, *, verb: str) -> dict[str, Json]:
    """Return a failure as JSON, under "error"."""
    kind, step = _KINDS.get(code, ("failure", "`rigctl {verb} --help`"))
    return {
        "error": {"code": code, "kind": kind, "message": message, "key": _key(message), "next": step.format(verb=verb)}
    }


def _key(message: str) -> str | None:
    """Return the first key or option in a message; None without one."""
    message = _TRY.sub("", message)
    keys = [found[1] for found in _KEY.finditer(message) if not found[1].endswith((".toml", ".json"))]
    if keys:
        return keys[0]
    option = re.search(r"--[a-z][a-z-]*", message)
    return None if option is None else option[0]


def _log_traceback() -> Path:
    with tempfile.NamedTemporaryFile("w", prefix="rigctl-", suffix=".log", delete=False, encoding="utf-8") as log:
        traceback.print_exc(file=log)
    return Path(log.name)


# Streams that may fail: a closed pipe, a full disk or a lost terminal does not end the work.

_KEPT = frozenset("\n\t")
# Errors of a closed pipe or terminal, which need no message.
_GONE = frozenset({errno.EPIPE, errno.EIO})


class LastingStream:
    """A text stream that keeps its first failure and then discards output."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        self.failure: OSError | None = None

    def write(self, text: str) -> int:
        """Write a text, as far as it can be written; return its length."""
        with self._forgiven():
            self._stream.write(text)
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        """Write texts one after the other."""
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        """Hand on what is buffered, as far as it can be written."""
        with self._forgiven():
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the stream itself, such as its encoding."""
        return getattr(self._stream, name)

    @contextmanager
    def _forgiven(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.failure = self.failure or error
            _lead_nowhere(self._stream)


def _lead_nowhere(stream: IO[str]) -> None:
    """Discard buffered and later output, so that the program ends quietly."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, stream.fileno())
        finally:
            os.close(nowhere)


def _nowhere() -> IO[str]:
    return Path(os.devnull).open("w", encoding="utf-8")


@contextmanager
def lasting_streams() -> Iterator[None]:
    """Protect standard output and error within the context; report at its end if a result could not be written.

    A closed pipe (``rigctl status RUN --log | head -1``) and a lost terminal are not reported. Exit codes stay those of
    the work itself.
    """
    # A stream that was closed before the program began is None.
    given = tuple(stream or _nowhere() for stream in (sys.stdout, sys.stderr))
    out, err = LastingStream(given[0]), LastingStream(given[1])
    for stream in given:
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    sys.stdout, sys.stderr = out, err
    try:
        yield
    finally:
        out.flush()
        if out.failure is not None and out.failure.errno not in _GONE:
            err.write(f"rigctl: standard output cannot be written: {out.failure.strerror}; the answer is incomplete\n")
        err.flush()
        sys.stdout, sys.stderr = given


def visible(text: str) -> str:
    r"""Return a text with control characters shown as ``\x1b``, lines and tabs kept."""
    return text if text.isprintable() else "".join(map(_visible_character, text))


def _visible_character(character: str) -> str:
    if character in _KEPT or unicodedata.category(character) not in ("Cc", "Cf", "Cs", "Zl", "Zp"):
        return character
    return character.encode("unicode_escape").decode("ascii")
