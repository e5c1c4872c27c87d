"""What no case may do: a fault of ours, a hang, a number that is none, a change of what was there."""

import contextlib
import hashlib
import io
import itertools
import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

from rigctl import cli
from tests.monkey.cases import Case

_ALLOWED = frozenset({0, 2, 3, 4, 5, 75})
# Of the processor, so that a busy machine does not count; and by the clock, for what waits.
_MOST_S, _MOST_WAITING_S = 60, 300
# What a writer of a run leaves beside it, whatever becomes of it.
_LOOSE = frozenset({"writer.lock"})


class _TooSlowError(BaseException):
    """A case took longer than a person waits."""


def problems_of(case: Case, folder: Path) -> list[str]:
    """Return what a case did that none may do; the workspace is the working folder meanwhile."""
    before = tree_hash(folder)
    out, err = io.StringIO(), io.StringIO()
    try:
        with contextlib.chdir(folder), _alarm(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = cli.main(case.arguments)
    except _TooSlowError:
        return [f"took more than {_MOST_S} s of the processor, or waited for more than {_MOST_WAITING_S} s"]
    after = tree_hash(folder)
    # An exit code of 4 may also be that of a report: of failed runs, or of a run that cannot be judged.
    is_refused = code == 2 or (code == 4 and '"verdict"' not in out.getvalue())
    return [
        *([] if code in _ALLOWED else [f"exit {code}: {err.getvalue()[-300:]}"]),
        *(["traceback on standard error"] if "Traceback (most" in err.getvalue() else []),
        *(["control characters on standard error"] if "\x1b" in err.getvalue() + out.getvalue() else []),
        *_json_problems(case, code, out.getvalue()),
        *_changes(before, after, refused=is_refused, edited=_edited(case)),
        *(
            ["a part left under its working name"]
            if any(name.endswith(".part") for name in set(after) - set(before))
            else []
        ),
        *_wrong_files(folder, set(after) - set(before)),
    ]


def _edited(case: Case) -> tuple[str, ...]:
    """Return beginnings of the names of files that a command is there to change."""
    words = case.arguments
    named = [after for word, after in itertools.pairwise(words) if word in ("--write", "--out")]
    return (*named, *(f"{word}/" for word in words[1:2] if words[:1] == ["resume"]))


def _wrong_files(folder: Path, names: set[str]) -> Iterator[str]:
    """Give which of the JSON files that came are none."""
    for name in sorted(names):
        if name.endswith(".json") and (folder / name).is_file():
            try:
                json.loads((folder / name).read_text(encoding="utf-8"), parse_constant=_refuse)
            except ValueError as error:
                yield f"{name} is no JSON: {error}"


def tree_hash(folder: Path) -> dict[str, str]:
    """Return the hash of every file below a folder, by its path; folders too, so that empty ones count."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        found[name] = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "folder"
    return found


def _changes(before: dict[str, str], after: dict[str, str], *, refused: bool, edited: tuple[str, ...]) -> Iterator[str]:
    """Give what became of files that were there; and, of a command that refused, files that came."""
    for name, digest in before.items():
        if after.get(name) != digest and Path(name).name not in _LOOSE and (refused or not name.startswith(edited)):
            yield f"{name} is {'gone' if name not in after else 'changed'}"
    came = [name for name in after if name not in before and Path(name).name not in _LOOSE]
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
def _alarm() -> Iterator[None]:
    def ring(_signal: int, _frame: FrameType | None) -> None:
        raise _TooSlowError

    os.environ.setdefault("MPLBACKEND", "agg")
    kept = {number: signal.signal(number, ring) for number in (signal.SIGALRM, signal.SIGPROF)}
    signal.setitimer(signal.ITIMER_PROF, _MOST_S)
    signal.alarm(_MOST_WAITING_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0)
        for number, handler in kept.items():
            signal.signal(number, handler)
