"""What no case may do: a fault of ours, a hang, a number that is none, a change of what was there."""

import contextlib
import hashlib
import io
import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

from rigctl import cli
from tests.monkey.cases import Case

_ALLOWED = frozenset({0, 2, 3, 4, 5, 75})
_MOST_S = 60
# What `rigctl stop` is there to write, and what a running session would take away again.
_REQUESTS = frozenset({"control"})


class _TooSlowError(BaseException):
    """A case took longer than a person waits."""


def problems_of(case: Case, folder: Path, *, most_s: int = _MOST_S) -> list[str]:
    """Return what a case did that none may do; the workspace is the working folder meanwhile."""
    before = tree_hash(folder)
    out, err = io.StringIO(), io.StringIO()
    start_s = time.monotonic()
    try:
        with contextlib.chdir(folder), _alarm(most_s), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = cli.main(case.arguments)
    except _TooSlowError:
        return [f"took more than {most_s} s"]
    after = tree_hash(folder)
    return [
        *([] if code in _ALLOWED else [f"exit {code}: {err.getvalue()[-300:]}"]),
        *(["traceback on standard error"] if "Traceback (most" in err.getvalue() else []),
        *(["control characters on standard error"] if "\x1b" in err.getvalue() + out.getvalue() else []),
        *_json_problems(case, code, out.getvalue()),
        *_changes(before, after, refused=code in (2, 4)),
        *(["a part left under its working name"] if any(name.endswith(".part") for name in after) else []),
        *([f"took {time.monotonic() - start_s:.0f} s"] if time.monotonic() - start_s > most_s else []),
    ]


def tree_hash(folder: Path) -> dict[str, str]:
    """Return the hash of every file below a folder, by its path; folders too, so that empty ones count."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        found[name] = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "folder"
    return found


def _changes(before: dict[str, str], after: dict[str, str], *, refused: bool) -> Iterator[str]:
    """Give what became of files that were there; and, of a command that refused, files that came."""
    for name, digest in before.items():
        if after.get(name) != digest:
            yield f"{name} is {'gone' if name not in after else 'changed'}"
    came = [name for name in after if name not in before and Path(name).name not in _REQUESTS]
    if refused and came:
        yield f"refused, and left {', '.join(came[:3])}"


def _json_problems(case: Case, code: int, text: str) -> Iterator[str]:
    if "--json" not in case.arguments or code != 0 or "--help" in case.arguments or not text.startswith("{"):
        return
    try:
        json.loads(text, parse_constant=_refuse)
    except ValueError as error:
        yield f"standard output is no JSON: {error}"


def _refuse(name: str) -> float:
    raise ValueError(f"{name} is no JSON")


@contextlib.contextmanager
def _alarm(seconds: int) -> Iterator[None]:
    def ring(_signal: int, _frame: FrameType | None) -> None:
        raise _TooSlowError

    os.environ.setdefault("MPLBACKEND", "agg")
    kept = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, kept)
