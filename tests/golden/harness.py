"""Runs chapters of commands and compares what they give with what is stored.

A chapter is a list of commands that share one folder. Of each command the exit code, the JSON on standard output and
the files that it wrote are kept; prose for people, times, versions, paths and hashes are not.
"""

import contextlib
import gzip
import io
import json
import os
import re
import shlex
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

from rich.console import Console

from rigctl.cli import main
from rigctl.verbs.options import Result
from tests.golden.digest import digest_file, digest_table, digest_value, flat

STORED = Path(__file__).parent / "stored"
#: A number may move by this share of itself, or of the standard error that is stated next to it.
RELATIVE = 1e-9
#: Smaller differences are rounding of numbers that should be zero.
FLOOR = 1e-14
#: Another processor sums in another order. These pass through single precision (pictures: 6e-8 an operation) or through
#: a fit whose end that moves (shifts, and the sizes of faults, whose order does not count: some cannot be told apart).
_ROUNDED = (
    (re.compile(r"\.fits/data|\.npz/|^/maps-|/registration/|walk\.json/|/budget/"), 1e-5),
    # Angles: rounding moves pixels across 0 and 180 deg; the Stokes parameters beside them have the same to 1e-5.
    (re.compile(r"/aolp\.fits/data|/stokes\.fits/data6/"), 1e-3),
    (re.compile(r"/diagnosis/terms/"), 0.05),
    (re.compile(r"/light/[^/]*/error$"), 1e-6),  # the difference of two numbers that are nearly the same
)
_NO_ORDER = re.compile(r"/diagnosis/terms/.*(/samples/|confused_with)")
_ERROR_KEYS = ("std_error", "std", "sigma", "rms", "error")
_PROSE_WORDS = 4
_OWN_FAULT = 70
#: A number of this size is rounding on a screen; an error of the computation may be.
_TINY = re.compile(r"\de-(1[3-9]|[2-9]\d)\b")


@dataclass(frozen=True)
class Chapter:
    """Commands that are run one after the other in one folder."""

    commands: Mapping[str, str]  #: name -> command line; names are kept when verbs are renamed
    prepare: Callable[[Path], None] | None = None  #: writes the input files of the folder
    needs: tuple[str, ...] = ()  #: Python packages; without them the chapter is skipped
    is_long: bool = False  #: takes minutes: run by `make trials` and by `python -m tests.golden --long`
    is_real: bool = False  #: needs RIGCTL_REAL_DATA
    values: Callable[[], dict[str, Any]] | None = None  #: numbers of Python functions, kept next to the commands
    relative: Mapping[str, float] = field(default_factory=dict)  #: wider tolerance of single commands
    floor: float = FLOOR
    ignored: str = "^$"  #: expression for the places whose differences do not count
    by_error: bool = False  #: numbers with a standard error next to them may move by 1e-9 of that only


def run_chapter(chapter: Chapter, folder: Path) -> dict[str, Any]:
    """Run a chapter in an empty folder; return what its commands gave."""
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.chdir(folder):
        if chapter.prepare is not None:
            chapter.prepare(folder)
        found = {name: _run(line, folder) for name, line in chapter.commands.items()}
    if chapter.values is not None:
        found |= json.loads(json.dumps(chapter.values()))
    return found


def _run(line: str, folder: Path) -> dict[str, Any]:
    before, shown = _files(folder), list[str]()
    with patch.object(Result, "show_json", _noting_screens(Result.show_json, shown)):
        code, text = run_command(line)
    found: dict[str, Any] = {"code": code} | ({"screen": shown} if shown else {})
    if "--json" in line.split():
        try:
            found["json"] = digest_value(json.loads(text), folder)
        except ValueError:
            found["json"] = "<no JSON>"
    after = _files(folder)
    written = sorted(name for name, stamp in after.items() if before.get(name) != stamp)
    found |= _digests(folder, written)
    gone = sorted(before.keys() - after.keys())
    return _without_copies(found | ({"gone": gone} if gone else {}))


def _noting_screens(show_json: Callable[[Result], None], problems: list[str]) -> Callable[[Result], None]:
    """Return `show_json`, which also notes where the same result on a terminal of 80 columns is not as it should be."""

    def noting(result: Result) -> None:
        show_json(result)
        if type(result).show is not Result.show:
            return
        parts = [part for part in result.content() if not callable(part)]
        console = Console(width=80, file=io.StringIO(), record=True)
        for part in parts:
            console.print(part, markup=False)
        if parts and not isinstance(parts[0], str):
            problems.append("begins with a table, not with the answer")
        problems.extend(
            f"rounding, to be shown as 0: {line}" for line in console.export_text().split("\n") if _TINY.search(line)
        )

    return noting


def run_command(line: str) -> tuple[int, str]:
    """Run one command line in this process; return its exit code and its standard output."""
    out, arguments = io.StringIO(), shlex.split(os.path.expandvars(line))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
        code = main(arguments)
    return code, out.getvalue()


def _digests(folder: Path, written: list[str]) -> dict[str, Any]:
    """Return the digests of the files written: frames of one folder together, other files each by itself."""
    files: dict[str, Any] = {}
    frames: dict[str, list[Any]] = {}
    for name in written:
        found = digest_file(folder / name, folder)
        series = re.sub(r"(\d{6}_\w+\.fits|[0-9a-f]{64}\.\w+)$", "*", name)
        if series != name:
            frames.setdefault(series, []).append(found)
        else:
            files[name] = found
    for series, found in frames.items():
        files[series] = digest_table([flat(one) if isinstance(one, dict) else {"": one} for one in found], folder)
    return {"files": files} if files else {}


def _without_copies(found: dict[str, Any]) -> dict[str, Any]:
    """Return what a command gave, with standard output as the name of the file that holds the same."""
    same = [name for name, content in found.get("files", {}).items() if content == found.get("json")]
    return found | {"json": f"<{same[0]}>"} if same else found


def _files(folder: Path) -> dict[str, tuple[int, int]]:
    """Return the files below a folder with their times and sizes; a Zarr store counts as one."""
    found = {}
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        inside_zarr = re.match(r"(.*?\.zarr)/", name)
        if inside_zarr is not None:
            found[inside_zarr[1]] = (0, 0)
        elif path.is_file():
            status = path.stat()
            found[name] = (status.st_mtime_ns, status.st_size)
    return found


@dataclass(frozen=True)
class Comparison:
    """How far two trees of JSON may differ."""

    relative: float = RELATIVE  #: share of a number, or of the standard error next to it
    floor: float = FLOOR  #: smaller differences are none
    by_error: bool = False  #: where an error stands next to a number, only that counts
    prose: bool = False  #: whether sentences count

    def differences(self, stored: Any, found: Any, at: str = "", scale: float = 0.0) -> Iterator[str]:
        """Yield where two trees differ; `scale` is the size of the numbers, or of the error, next to a number."""
        if isinstance(stored, dict) and isinstance(found, dict):
            yield from self._of_dicts(stored, found, at)
        elif isinstance(stored, list) and isinstance(found, list) and len(stored) == len(found):
            scale = max(map(abs, stored), default=0.0) if all(map(_is_number, stored)) else 0.0
            for number, (one, other) in enumerate(zip(stored, found, strict=True)):
                yield from self.differences(one, other, f"{at}/{number}", scale)
        elif _is_number(stored) and _is_number(found):
            size = scale if self.by_error and scale else max(abs(stored), scale)
            allowed = (
                max([self.relative, *(share for place, share in _ROUNDED if place.search(at))]) * size + self.floor
            )
            if not abs(found - stored) <= allowed:
                yield f"{at}: {found!r} (stored: {stored!r}, allowed difference {allowed:.2g})"
        elif stored != found and (self.prose or not (_is_prose(stored) and _is_prose(found))):
            yield f"{at}: {_short(found)} (stored: {_short(stored)})"

    def _of_dicts(self, stored: dict[str, Any], found: dict[str, Any], at: str) -> Iterator[str]:
        scale = max((abs(stored[key]) for key in _ERROR_KEYS if _is_number(stored.get(key))), default=0.0)
        if "/budget/" in at:  # roots of differences: rounding shows against the largest
            scale = max((abs(value) for value in stored.values() if _is_number(value)), default=0.0)
        for key in stored.keys() | found.keys():
            if key not in found:
                yield f"{at}/{key}: is gone (stored: {_short(stored[key])})"
            elif key not in stored:
                yield f"{at}/{key}: is new ({_short(found[key])})"
            else:
                yield from self.differences(stored[key], found[key], f"{at}/{key}", scale)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_prose(value: Any) -> bool:
    return isinstance(value, str) and len(value.split()) >= _PROSE_WORDS


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 100 else f"{text[:100]}..."


def _store(name: str, chapter: Chapter, found: dict[str, Any]) -> None:
    """Store what a chapter gave, one command on a line; long chapters are compressed."""
    lines = (f"{json.dumps(key)}: {json.dumps(value, separators=(',', ':'))}" for key, value in found.items())
    text = "{\n" + ",\n".join(lines) + "\n}\n"
    STORED.mkdir(exist_ok=True)
    if chapter.is_long:
        (STORED / f"{name}.json.gz").write_bytes(gzip.compress(text.encode(), mtime=0))
    else:
        (STORED / f"{name}.json").write_text(text)


def _stored(name: str, chapter: Chapter) -> dict[str, Any]:
    if chapter.is_long:
        return json.loads(gzip.decompress((STORED / f"{name}.json.gz").read_bytes()))
    return json.loads((STORED / f"{name}.json").read_text())


def check(name: str, chapter: Chapter, folder: Path, *, write: bool = False, prose: bool = False) -> list[str]:
    """Run a chapter in a folder; return where it differs from what is stored, or store it."""
    found = run_chapter(chapter, folder)
    if write:
        broken = [one for one, gave in found.items() if gave.get("code") == _OWN_FAULT]
        assert not broken, f"{name}: not stored, rigctl itself fails: {', '.join(broken)}"
        _store(name, chapter, found)
        return []
    stored = _stored(name, chapter)
    changed = [f"/{command}: is new" for command in found.keys() - stored.keys()]
    changed += [f"/{command}: is gone" for command in stored.keys() - found.keys()]
    for command in stored.keys() & found.keys():
        comparison = Comparison(
            relative=chapter.relative.get(command, RELATIVE),
            floor=chapter.floor,
            by_error=chapter.by_error,
            prose=prose,
        )
        changed += comparison.differences(stored[command], found[command], f"/{command}")
    ignored = re.compile(f"{chapter.ignored}|{_NO_ORDER.pattern}")
    return sorted(line for line in changed if not ignored.search(line.partition(": ")[0]))
