"""Results that others may read: without folders, serial numbers, ports, site and the name of the machine."""

import json
import platform
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.console.json_text import Json

LEFT_OUT = "left out"
# Words of keys whose values say whose rig it is, or where it stands.
_PERSONAL = frozenset({"serial", "site", "latitude", "longitude", "host", "hostname", "port", "address"})
# A calibration says by them whose it is; whoever reads it takes null as not known.
_MAY_BE_UNKNOWN = frozenset({"camera_serial", "stage_serial"})
_SHORTEST = 4
_SESSION_FILE = "session.json"
_SECRETS: ContextVar[tuple[tuple[str, str], ...] | None] = ContextVar("secrets", default=None)


@contextmanager
def anonymous(paths: Iterable[Path]) -> Iterator[None]:
    """Leave out of all results, until the context is left, what files and folders tell of rig, place and machine.

    Parameters
    ----------
    paths : iterable of Path
        What a command reads and writes: runs, rig files, calibrations, and whatever has no such facts.
    """
    token = _SECRETS.set(tuple(sorted(set(_secrets(tuple(paths))), key=lambda pair: -len(pair[0]))))
    try:
        yield
    finally:
        _SECRETS.reset(token)


def is_anonymous() -> bool:
    """Return whether results are to say nothing of rig, place and machine."""
    return _SECRETS.get() is not None


def told(text: str) -> str:
    """Return a text of a result as others may read it; as it is where nobody asked for that."""
    for secret, instead in _SECRETS.get() or ():
        text = text.replace(secret, instead)
    return text


def told_content(content: Mapping[str, Json]) -> Mapping[str, Json]:
    """Return the content of a JSON file as others may read it; as it is where nobody asked for that."""
    if not is_anonymous():
        return content
    return {key: _told_value(key, value) for key, value in content.items()}


def is_personal(key: str) -> bool:
    """Return whether the value of a key says whose rig it is, or where it stands."""
    return not _PERSONAL.isdisjoint(key.lower().split("_"))


def _told_value(key: str, value: Json) -> Json:
    if value is None or value == LEFT_OUT or not is_personal(key):
        return _told_inside(value)
    return None if key in _MAY_BE_UNKNOWN else LEFT_OUT


def _told_inside(content: Json) -> Json:
    if isinstance(content, Mapping):
        return told_content(content)
    if isinstance(content, list | tuple):
        return [_told_inside(value) for value in content]
    return told(content) if isinstance(content, str) else content


def _secrets(paths: tuple[Path, ...]) -> Iterator[tuple[str, str]]:
    for path in paths:
        for folder in {str(path.parent), str(path.absolute().parent), str(path.resolve().parent)} - {".", "/", ".."}:
            yield f"{folder}/", ""
        for text in _personal_texts(_facts_of(path)):
            yield text, LEFT_OUT
    if len(platform.node()) >= _SHORTEST:
        yield platform.node(), LEFT_OUT


def _facts_of(path: Path) -> Json:
    """Return what a run, a calibration or a rig file says; nothing of another file."""
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
