"""Destinations of results, checked before any work; files of others are never replaced.

A list of written results with their commands and inputs is kept in the user's own folder.
"""

import hashlib
import json
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import count
from pathlib import Path
from typing import Literal

from rigctl.base.durable import MOST_RECORD_BYTES, MOST_TEXT_BYTES, open_plain, read_bounded, sha256_of, write_durably
from rigctl.errors import ConfigError

_RUN_FILES = ("session.json", "manifest.jsonl")
# Optional notes of people on a run, with its excluded frames.
_SAID_OF_RUN = "annotations.jsonl"
# A run with only one of them is still a run.
_BESIDE_IN_RUN = ("frames", "events.jsonl")
# Distance from either end of a file within which formats name their writer.
_HEADER_BYTES = 65536
_TEXT_FORMATS = (".toml", ".csv", ".txt")
_MARK = b"rigctl"
_OF_THE_ENGINE = ("workers", "scheduler")


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Origin of results: a command, and its inputs."""

    command: str  #: The verb.
    digest: str  #: Of its options and of the content of its inputs.


def origin_of(command: str, options: Mapping[str, object], inputs: Iterable[Path]) -> Origin:
    """Return the origin of results, independent of where the work is done."""
    stated = sorted((key, str(value)) for key, value in options.items() if key not in _OF_THE_ENGINE)
    found = hashlib.sha256(repr(stated).encode())
    for path in inputs:
        for file in sorted(_files_of_input(path)):
            if not file.is_file():  # a pipe or a device has no end
                continue
            with suppress(OSError), open_plain(file) as content:
                if file.stat().st_size > MOST_RECORD_BYTES:  # never read as a whole, and slow to hash
                    found.update(repr(file.stat()).encode())
                    continue
                found.update(hashlib.file_digest(content, "sha256").digest())
    return Origin(command=command, digest=found.hexdigest())


def remember(file: Path, origin: Origin) -> None:
    """Note where a file comes from. Raises OSError."""
    note = _note_of(file)
    note.parent.mkdir(parents=True, exist_ok=True)
    content = {
        "file": str(file.resolve()),
        "sha256": sha256_of(file),
        "command": origin.command,
        "digest": origin.digest,
    }
    beside = note.with_name(f"{note.name}.{os.getpid()}")
    beside.write_text(json.dumps(content), encoding="ascii")
    beside.replace(note)


def remembered(file: Path) -> tuple[str, Origin] | None:
    """Return the recorded hash and origin of a file; None without a record."""
    try:
        content = json.loads(read_bounded(_note_of(file), MOST_TEXT_BYTES))
        origin = Origin(command=str(content["command"]), digest=str(content["digest"]))
        return str(content["sha256"]), origin
    except (OSError, ValueError, RuntimeError, LookupError, TypeError):
        return None


def says_rigctl(file: Path) -> bool:
    """Return whether the header of a file has this program as its writer."""
    with open_plain(file) as content:
        head = content.read(_HEADER_BYTES)
        content.seek(max(file.stat().st_size - _HEADER_BYTES, 0))
        tail = content.read(_HEADER_BYTES)
    if file.suffix.lower() in _TEXT_FORMATS:
        first = head.partition(b"\n")[0]
        return first.startswith(b"#") and b"written by rigctl" in first
    return _MARK in head or _MARK in tail


def is_run(folder: Path) -> bool:
    """Return whether a folder is a run, or the remains of one."""
    there = [name for name in _RUN_FILES if (folder / name).is_file()]
    return len(there) == len(_RUN_FILES) or (bool(there) and any((folder / name).exists() for name in _BESIDE_IN_RUN))


def _files_of_input(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path] if path.is_file() else []
    if is_run(path):
        return [file for name in (*_RUN_FILES, _SAID_OF_RUN) if (file := path / name).is_file()]
    return [file for file in path.iterdir() if file.is_file()]


def _note_of(file: Path) -> Path:
    stated = os.environ.get("XDG_STATE_HOME", "")
    base = Path(stated) if Path(stated).is_absolute() else Path.home() / ".local" / "state"
    name = hashlib.sha256(os.fsencode(file.resolve())).hexdigest()
    return base / "rigctl" / "results" / f"{name}.json"


Kind = Literal["file", "folder", "new", "edited", "run", "absent"]


@dataclass(frozen=True, kw_only=True)
class Destination:
    """Place that a command writes to."""

    option: str  #: Its option.
    path: Path  #: As it was given.
    #: One file, files in a folder, a folder that must not hold anything yet, a file that the command is to change, a
    #: run that is made or added to, or what must not be there at all.
    kind: Kind
    names: tuple[str, ...] = ()  #: The files of a folder, in it or in the folders of it; ``*`` stands for any text.


@dataclass(frozen=True, kw_only=True)
class _Command:
    """The running command: origin of its results, and files written so far."""

    origin: Origin
    force: bool
    written: set[Path] = field(default_factory=set)


_RUNNING: ContextVar[_Command | None] = ContextVar("running", default=None)


@contextmanager
def results_of(origin: Origin, *, force: bool) -> Iterator[None]:
    """Allow a command to replace its own results within the context; record the written files at its end."""
    running = _Command(origin=origin, force=force)
    token = _RUNNING.set(running)
    try:
        yield
    finally:
        _RUNNING.reset(token)
        for file in running.written:
            with suppress(OSError):
                remember(file, origin)


def require_replaceable(files: Iterable[Path]) -> None:
    """Refuse to replace files of people and results of other commands, before any file is written.

    Outside of a command, in a program, results of rigctl are replaced.
    """
    running = _RUNNING.get() or _Command(origin=Origin(command="", digest=""), force=True)
    wanted = [file for file in files if file not in running.written]
    problem = _taken([file for file in wanted if file.exists()], running.origin, force=running.force)
    if problem is not None:
        raise ConfigError(f"{wanted[0].parent}: {problem}")
    running.written.update(wanted)


def require_free(destinations: Iterable[Destination], origin: Origin, *, inputs: Iterable[Path], force: bool) -> None:
    """Refuse destinations that cannot be written, or that are files of others; nothing is changed."""
    sources = {source.resolve() for source in inputs}
    problems = []
    seen: set[Path] = set()
    for one in destinations:
        try:
            with suppress(FileNotFoundError):
                one.path.stat()  # refuses a link to itself, which only some versions of Python do below
            path = one.path.resolve()
            problem = _problem(one, origin, force=force)
            if path in seen:
                problem = "another result has the same place"
            elif path in sources and one.kind == "file":
                problem = "is an input of this command: name another file"
            seen.add(path)
        except NotADirectoryError:
            problem = "lies in a folder that is a file"
        except OSError as error:
            problem = error.strerror or str(error)
        except (ValueError, RuntimeError) as error:
            problem = str(error)
        if problem:
            problems.append(f"{one.option}: {one.path}: {problem}")
    if problems:
        raise ConfigError("\n".join(problems))


def edited_before(destinations: Iterable[Destination]) -> dict[Path, bytes]:
    """Return the content of the files that are to be edited."""
    edited = (one.path for one in destinations if one.kind == "edited" and one.path.is_file())
    return {path: read_bounded(path, MOST_TEXT_BYTES) for path in edited}


def keep_old(before: Mapping[Path, bytes]) -> None:
    """Keep the old version of each edited file, under its name with .bak; earlier ones stay."""
    for path, content in before.items():
        try:
            if read_bounded(path, MOST_TEXT_BYTES) != content:
                _keep(path, content)
        except OSError as error:
            raise ConfigError(f"{path}: cannot be kept as {path.name}.bak: {error.strerror}") from error


def replace_keeping(path: Path, content: bytes) -> None:
    """Replace a file after its old version is kept as in `keep_old`."""
    if path.exists() and (old := read_bounded(path, MOST_TEXT_BYTES)) != content:
        _keep(path, old)
    write_durably(path, content)


def _keep(path: Path, content: bytes) -> None:
    for number in count(1):
        kept = path.with_name(f"{path.name}.bak{number if number > 1 else ''}")
        with suppress(FileExistsError), kept.open("xb") as file:
            file.write(content)
            return


Snapshot = dict[Path, tuple[int, int, int]]


def snapshot(destinations: Iterable[Destination]) -> Snapshot:
    """Return the present files at the destinations."""
    found: Snapshot = {}
    for one in destinations:
        for file in _present(one):
            with suppress(OSError):
                stat = file.stat()
                found[file] = (stat.st_ino, stat.st_size, stat.st_mtime_ns)
    return found


def remember_written(destinations: Iterable[Destination], before: Snapshot, origin: Origin) -> None:
    """Record written files and their origin in the user's own folder."""
    after = snapshot(destinations)
    for file, state in after.items():
        if before.get(file) != state:
            with suppress(OSError):
                remember(file, origin)


def _problem(one: Destination, origin: Origin, *, force: bool) -> str | None:
    path = one.path
    at = Path(os.path.realpath(path))  # links may lead into a run, dots out of one
    run = next((folder for folder in (at, *at.parents) if is_run(folder)), None)
    if run is not None and (one.kind not in ("new", "run") or run != at):
        return f"lies in the run {run}, which does not accept results: name a place next to it"
    if one.kind in ("new", "run"):
        return _not_new(path, is_run=run == at and one.kind == "run") or _untried(path)
    if one.kind == "absent":
        return "exists: remove it, or name another" if os.path.lexists(path) else _unplaced(path)
    if one.kind == "folder":
        if path.exists() and not path.is_dir():
            return "is a file; name a folder"
        return _untried(path / "x") or _blocked(one) or _taken(_present(one), origin, force=force)
    if path.is_dir():
        return "is a folder; name a file"
    if path.exists() and not path.is_file():
        return "is not a regular file"
    if one.kind == "edited":
        return _unplaced(path) or _unwritable(path)
    return _unplaced(path) or _taken(_present(one), origin, force=force)


def _blocked(one: Destination) -> str | None:
    """Return a result that cannot be a file because a folder has its name."""
    folders = [name for name in one.names if (one.path / name).is_dir()]
    return f"{folders[0]} in it is a folder, and a result needs this name" if folders else None


def _not_new(path: Path, *, is_run: bool) -> str | None:
    if path.is_dir():
        return None if is_run or not any(path.iterdir()) else "exists and is not empty; give the name of a new folder"
    return "exists and is not a folder; give another name" if path.exists() else None


def _unplaced(path: Path) -> str | None:
    """Return the reason why a file cannot be made in its folder, which must exist."""
    if not path.absolute().parent.is_dir():
        return f"there is no folder {path.absolute().parent}; its folder does not exist"
    return _untried(path)


def _untried(path: Path) -> str | None:
    """Return the reason why a file of this name cannot be made, without creating folders."""
    name = path.name
    with suppress(FileNotFoundError):
        path.lstat()  # refuses a long name, or a file in place of a folder
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    if not folder.is_dir():
        return f"{folder} is a file"
    if not name:
        return "is not a file name"
    try:
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return f"cannot be written: {folder}: {error.strerror}"


def _taken(files: Iterable[Path], origin: Origin, *, force: bool) -> str | None:
    for file in sorted(files):
        known = remembered(file)
        if known is None and not says_rigctl(file):
            return f"{_there(file)} was not written by rigctl: it is not replaced; name another place"
        if known is not None and known[0] != sha256_of(file):
            return f"{_there(file)} was changed since rigctl wrote it: it is not replaced; move it away"
        if not file.stat().st_mode & 0o222:
            return f"{_there(file)} is read-only"
        if not force and (known is None or known[1] != origin):
            return f"{_there(file)} is the result of another command or of other inputs: --force replaces it"
    return None


def _unwritable(file: Path) -> str | None:
    return "is read-only" if file.exists() and not file.stat().st_mode & 0o222 else None


def _there(file: Path) -> str:
    return f"{file.name} exists and"


def _present(one: Destination) -> list[Path]:
    if one.kind in ("file", "edited"):
        return [one.path] if one.path.is_file() else []
    if one.kind == "new" or not one.path.is_dir():
        return []
    return [
        Path(folder) / name
        for folder, _, files in _near(one.path)
        for name in files
        if any(fnmatchcase(name, known) for known in one.names) and (Path(folder) / name).is_file()
    ]


def _near(path: Path) -> Iterator[tuple[str, list[str], list[str]]]:
    """Return a folder and the folders in it, the deepest places of results."""
    for folder, folders, files in os.walk(path):
        yield folder, folders, files
        if Path(folder) != path:
            folders.clear()
