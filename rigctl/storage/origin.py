"""Origin of results: which command wrote a file, and from what; noted in the user's own folder, known again by that."""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rigctl.storage.bounded_file import MOST_RECORD_BYTES, sha256_of

_RUN_FILES = ("session.json", "manifest.jsonl")
# What people say of a run, if anything: which of its frames are left out.
_SAID_OF_RUN = "annotations.jsonl"
# A run of which one of the two is gone is still one.
_BESIDE_IN_RUN = ("frames", "events.jsonl")
# Where a format has a place for its writer, the word stands within this much of either end.
_HEADER_BYTES = 65536
_TEXT_FORMATS = (".toml", ".csv", ".txt")
_MARK = b"rigctl"


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Origin of results: a command, and what it read.

    Attributes
    ----------
    command : str
        The verb.
    digest : str
        Of its options and of the content of its inputs.
    """

    command: str
    digest: str


@dataclass(frozen=True, kw_only=True)
class Remembered:
    """What was noted of a file when it was written."""

    sha256: str
    origin: Origin


def origin_of(command: str, options: Mapping[str, object], inputs: Iterable[Path]) -> Origin:
    """Return what results come from.

    Parameters
    ----------
    command : str
        The verb.
    options : mapping
        All that decides the results beside the inputs.
    inputs : iterable of Path
        Files and folders that are read; a run by its session file and manifest.
    """
    found = hashlib.sha256(repr(sorted((key, str(value)) for key, value in options.items())).encode())
    for path in inputs:
        for file in sorted(_files_of_input(path)):
            if not file.is_file():  # a pipe or a device has no end
                continue
            with suppress(OSError), file.open("rb") as content:
                if file.stat().st_size > MOST_RECORD_BYTES:  # nothing reads it whole, and to hash it takes long
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


def remembered(file: Path) -> Remembered | None:
    """Return what was noted of a file; None where nothing was."""
    try:
        content = json.loads(_note_of(file).read_text(encoding="ascii"))
        origin = Origin(command=str(content["command"]), digest=str(content["digest"]))
        return Remembered(sha256=str(content["sha256"]), origin=origin)
    except (OSError, ValueError, RuntimeError, LookupError, TypeError):
        return None


def says_rigctl(file: Path) -> bool:
    """Return whether the header of a file names this program as its writer."""
    with file.open("rb") as content:
        head = content.read(_HEADER_BYTES)
        content.seek(max(file.stat().st_size - _HEADER_BYTES, 0))
        tail = content.read(_HEADER_BYTES)
    if file.suffix.lower() in _TEXT_FORMATS:
        first = head.partition(b"\n")[0]
        return first.startswith(b"#") and b"written by rigctl" in first
    return _MARK in head or _MARK in tail


def is_run(folder: Path) -> bool:
    """Return whether a folder is a run, or what was left of one."""
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
