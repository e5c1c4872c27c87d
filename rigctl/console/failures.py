"""A failure as people and programs are told of it: exit code, words, and ``{"error": {"code", "kind", ...}}``."""

import errno
import json
import re
import tempfile
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from calibration.results import CalibrationError
from drivers.errors import AddressError, DeviceError
from rigctl.console.json_text import Json
from rigctl.errors import ConfigError, DataError

Failure = TypeVar("Failure", bound=BaseException)
_ANSWER = "answer_for_programs"

# 0 (done) and 130 (interrupted) are the command line library's own.
EXIT_USAGE = 2
EXIT_DEVICE = 3
EXIT_DATA = 4
EXIT_DISAGREES = 5
EXIT_OWN_FAULT = 70
EXIT_INTERRUPTED = 130
# As sysexits.h has it: a temporary failure, try again. A session stopped before its end, a run that is unfinished.
EXIT_INCOMPLETE = 75

# Which exit code a failure has. The first class that fits decides.
EXIT_CODES: tuple[tuple[type[BaseException], int], ...] = (
    (ConfigError, EXIT_USAGE),
    (AddressError, EXIT_USAGE),
    (DeviceError, EXIT_DEVICE),
    (DataError, EXIT_DATA),
    (CalibrationError, EXIT_DATA),
)

# Of errors of the operating system, those that a disk is to blame for; the others are files that were named wrongly.
_DISK_FAULTS = frozenset({errno.EIO, errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG})

# Of a link that leads to itself Python before 3.13 says so in another kind of error.
_LINK_LOOP = "Symlink loop"

# Modules that the installation for acquisition alone (pyproject.toml, `acquisition`) does without: their packages.
_LEFT_OUT = {
    "astropy": "astropy",
    "jinja2": "jinja2",
    "matplotlib": "matplotlib",
    "PIL": "pillow",
    "reportlab": "reportlab",
}

# By exit code: what failed, and what to do next.
_KINDS: dict[int, tuple[str, str]] = {
    2: ("usage", "correct what the message names; `rigctl {verb} --help` has the options, the documentation the keys"),
    3: (
        "device",
        "look at cables, power, addresses; `rigctl devices` lists what answers, `rigctl doctor` checks it",
    ),
    4: ("data", "`rigctl verify RUN` lists damaged frames; make other files again with the command that wrote them"),
    5: ("disagrees", "read the report: it names the likely cause"),
    70: ("own_fault", "report it with the log that the message names"),
    75: ("incomplete", "`rigctl resume RUN` continues; `rigctl status RUN --log` says what happened"),
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
        return EXIT_DATA, "this needs more memory than there is; nothing was written"
    if isinstance(error, RuntimeError) and str(error).startswith(_LINK_LOOP):
        return EXIT_USAGE, str(error)
    if isinstance(error, OSError):
        code = EXIT_DATA if error.errno in _DISK_FAULTS else EXIT_USAGE
        return code, f"{error.filename or 'a file'}: {error.strerror or error}"
    if isinstance(error, ModuleNotFoundError) and error.name in _LEFT_OUT:
        return EXIT_USAGE, (
            f"this needs {error.name}, which an installation for acquisition alone leaves out: "
            f"pip install {' '.join(_LEFT_OUT.values())}"
        )
    text = f"a fault of rigctl itself: {type(error).__name__}: {error}. Traceback in {_log_traceback()}"
    return EXIT_OWN_FAULT, text


def failure_json(code: int, message: str, *, verb: str, error: BaseException | None = None) -> str:
    """Return a failure as JSON, `failure_content` as text; with what the error itself tells programs."""
    answer = getattr(error, _ANSWER, {})
    return json.dumps({**answer, **failure_content(code, message, verb=verb)}, indent=2) + "\n"


def with_answer(error: Failure, content: Mapping[str, Json]) -> Failure:
    """Return an error whose JSON has more than the message: what was found before it failed."""
    setattr(error, _ANSWER, dict(content))
    return error


def failure_content(code: int, message: str, *, verb: str) -> dict[str, Json]:
    """Return a failure as JSON holds it, under "error".

    Parameters
    ----------
    code : int
        Exit code.
    message : str
        What people are told.
    verb : str
        Of the command line.
    """
    kind, step = _KINDS.get(code, ("failure", "`rigctl {verb} --help`"))
    return {
        "error": {"code": code, "kind": kind, "message": message, "key": _key(message), "next": step.format(verb=verb)}
    }


def _key(message: str) -> str | None:
    """Return the first key or option that a message names; None where it names none."""
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
