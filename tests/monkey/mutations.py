"""Damage to files and command lines, drawn from a generator: the same seed does the same."""

import json
import os
import random
import re
from pathlib import Path
from typing import Any

# Texts that people, sensors and attackers put where a number is wanted.
WILD = (
    "nan", "inf", "-inf", "1e300", "-1e300", "1e-320", "0", "-1", "-0.0", "1", "2", "1e12", "99999999999999999999",
    "0.5", "", " ", "x", "é", "\x1b[31m", "../../etc/passwd", "9999-12-31T23:59Z", "0001-01-01T00:00Z", "1:2:3",
    "0:1e300:5", "a" * 5000, "%s%n", "true", "None", ",", "1,2,3,4", "0,45,90,135", "{}", "[]",
)  # fmt: skip
_WILD_VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1, 1e300, -1e300, 1e-320, 1e40, 10**30, "x", "", "\x1b]0;t\x07", [], {}, [1], [[1]],
    {"value": "x"},
    {"value": -5, "std_error": -5}, "9999-12-31T23:59:59Z",
)  # fmt: skip
_NUMBER = re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w.])")


def damaged_text(data: bytes, draws: random.Random) -> bytes:
    """Return a text file with one thing changed: a number, a line, a bracket, a byte."""
    kind = draws.randrange(8)
    if kind <= 2 and (numbers := list(_NUMBER.finditer(data))):
        found = draws.choice(numbers)
        return data[: found.start()] + draws.choice(WILD).encode() + data[found.end() :]
    if kind == 3:
        lines = data.splitlines(keepends=True) or [b""]
        lines.insert(draws.randrange(len(lines)), draws.choice(lines))
        return b"".join(lines)
    if kind == 4:
        lines = data.splitlines(keepends=True) or [b""]
        del lines[draws.randrange(len(lines))]
        return b"".join(lines)
    if kind == 5:
        return data[: draws.randrange(len(data) + 1)]
    if kind == 6:
        place = draws.randrange(len(data) + 1)
        return data[:place] + draws.choice((b"[" * 2000, b"\0", b"\xff", b'"', b"\x1b[2J", b"=")) + data[place:]
    return damaged_bytes(data, draws)


def damaged_bytes(data: bytes, draws: random.Random) -> bytes:
    """Return a file with bits flipped, cut, lengthened or emptied."""
    kind = draws.randrange(6)
    if kind == 0 or not data:
        return b""
    if kind == 1:
        return data[: draws.randrange(len(data))]
    if kind == 2:
        return data + draws.randbytes(draws.randrange(1, 400))
    changed = bytearray(data)
    for _ in range(draws.choice((1, 1, 2, 20))):
        # Headers, where meaning is, more often than samples.
        place = draws.randrange(len(changed) if draws.random() < 0.3 else min(len(changed), 300))
        changed[place] = draws.randrange(256) if draws.random() < 0.5 else changed[place] ^ (1 << draws.randrange(8))
    return bytes(changed)


def damaged_json(data: bytes, draws: random.Random) -> bytes:
    """Return a JSON file in which one value is another, or is gone; or a damaged text."""
    if draws.random() < 0.3:
        return damaged_text(data, draws)
    content = json.loads(data)
    parent, key = draws.choice(list(_places(content)))
    if draws.random() < 0.2 and isinstance(parent, dict):
        del parent[key]
    else:
        parent[key] = draws.choice(_WILD_VALUES)
    return json.dumps(content).encode()


def _places(content: Any) -> Any:
    for key, value in list(content.items() if isinstance(content, dict) else enumerate(content)):
        yield content, key
        if isinstance(value, dict | list):
            yield from _places(value)


def damage_run(run: Path, draws: random.Random) -> str:
    """Damage one file of a run folder; return what was done."""
    files = sorted(path for path in run.rglob("*") if path.is_file())
    file = draws.choice(files)
    kind = draws.randrange(6)
    if kind == 0:
        file.unlink()
        return f"deleted {file.name}"
    if kind == 5:
        return _put_in_its_place(file, draws)
    if kind == 1:
        other = draws.choice(files)
        file.write_bytes(other.read_bytes())
        return f"{file.name} replaced by {other.name}"
    if kind == 2:
        (run / draws.choice(("status.json", "request", "frames/more.fits", "events.jsonl"))).write_bytes(
            draws.choice((b"1", b"[]", b'{"angles": 3}', b'{"event": "x", "utc": 5}\n', b"stop\n", b"\0" * 100))
        )
        return "a file added"
    damage = damaged_text if file.suffix in (".json", ".jsonl", ".toml") else damaged_bytes
    file.write_bytes(damage(file.read_bytes(), draws))
    return f"{file.name} damaged"


def _put_in_its_place(file: Path, draws: random.Random) -> str:
    """Put in the place of a file what is none: a pipe, a folder, a link to a device, nowhere or itself."""
    kind = draws.choice(("pipe", "folder", "link to /dev/zero", "link to nowhere", "link to itself"))
    file.unlink()
    if kind == "pipe":
        os.mkfifo(file)
    elif kind == "folder":
        file.mkdir()
    else:
        file.symlink_to({"link to /dev/zero": "/dev/zero", "link to nowhere": "nowhere"}.get(kind, file.name))
    return f"{kind} in the place of {file.name}"
