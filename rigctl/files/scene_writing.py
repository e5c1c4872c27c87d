"""Numbers that are written into a scene file in the place of those that stand there; its comments stay."""

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from rigctl.errors import ConfigError
from rigctl.files.place import PointingSection
from rigctl.files.scene_file import load_scene
from rigctl.storage.durable_file import write_durably

_HEADER = re.compile(r"^\[\[?([A-Za-z_][\w.]*)\]\]?[ \t]*(?:#[^\n]*)?$", re.MULTILINE)
_OURS = "  # rigctl point"
_BY_PHI = "phi_deg"
# Behind the point, and more where a standard uncertainty would not show.
_DIGITS = 4
# Of a table of ours: its last line that holds a key, a number or a bracket.
_LAST_KEY = re.compile(r"(?s:.*)^[^#\n]*[\w\]\"][^\n]*\n?", re.MULTILINE)


def write_into_scene(
    path: Path,
    geometry: Mapping[str, tuple[float, float]],
    regions: Mapping[str, Mapping[str, tuple[float, float]]],
    pointing: PointingSection | None,
) -> tuple[str, ...]:
    """Write numbers with their standard uncertainties into a scene file, and how their errors go together.

    Parameters
    ----------
    path : Path
        The file.
    geometry : mapping
        Key of ``[geometry]`` to value and standard uncertainty. An azimuth takes the place of ``phi_deg``.
    regions : mapping
        Name of a region to the same.
    pointing : PointingSection or None
        Takes the place of the ``[pointing]`` that is there; None: there is none any more.

    Returns
    -------
    tuple of str
        The lines that went, behind a minus, and those that came, behind a plus.

    Raises
    ------
    ConfigError
        The file is no scene file, has no such region, or would not be a scene file any more: then it is as it was.
    """
    load_scene(path)
    before = path.read_bytes()
    text = before.decode("utf-8")
    for name, numbers in regions.items():
        start, end = _region(path, text, name)
        text = text[:start] + _with(text[start:end], numbers) + text[end:]
    if geometry:
        text = _with_geometry(text, geometry)
    text = _with_pointing(text, pointing)
    write_durably(path, text.encode("utf-8"))
    try:
        load_scene(path)
    except ConfigError:
        write_durably(path, before)
        raise
    return tuple(_changes(before.decode("utf-8").splitlines(), text.splitlines()))


def _with_geometry(text: str, geometry: Mapping[str, tuple[float, float]]) -> str:
    place = _place(text, "geometry")
    if place is None:
        text = f"{text.rstrip()}\n\n[geometry]\n"
        place = (len(text) - len("[geometry]\n"), len(text))
    inside = text[place[0] : place[1]]
    if "camera_azimuth_deg" in geometry:
        inside = re.sub(rf"^{_BY_PHI}\s*=[^\n]*\n?", "", inside, flags=re.MULTILINE)
    return text[: place[0]] + _with(inside, geometry) + text[place[1] :]


def _with_pointing(text: str, pointing: PointingSection | None) -> str:
    place = _place(text, "pointing")
    if place is not None:
        # What stands behind the last key of a table belongs to the next.
        last = _LAST_KEY.search(text[place[0] : place[1]])
        text = text[: place[0]] + text[place[0] + (last.end() if last else 0) :].lstrip("\n")
    if pointing is None:
        return text
    rows = "".join(f"  [{', '.join(map(repr, row))}],\n" for row in pointing.correlation)
    names = ", ".join(f'"{name}"' for name in pointing.parameters)
    table = f"[pointing]{_OURS}\nparameters = [{names}]\ncorrelation = [\n{rows}]\n"
    return f"{text.rstrip()}\n\n{table}"


def _place(text: str, table: str) -> tuple[int, int] | None:
    return next(((start, end) for name, start, end in _tables(text) if name == table), None)


def _tables(text: str) -> Iterator[tuple[str, int, int]]:
    headers = list(_HEADER.finditer(text))
    ends = [header.start() for header in headers[1:]] + [len(text)]
    for header, end in zip(headers, ends, strict=True):
        yield header[1], header.start(), end


def _region(path: Path, text: str, name: str) -> tuple[int, int]:
    line = re.compile(rf"^name\s*=\s*(['\"]){re.escape(name)}\1", re.MULTILINE)
    for table, start, end in _tables(text):
        if table == "regions" and line.search(text[start:end]):
            return start, end
    raise ConfigError(f"{path}: has no [[regions]] of the name {name}")


def _with(table: str, numbers: Mapping[str, tuple[float, float]]) -> str:
    for key, (value, std) in numbers.items():
        digits = max(_DIGITS, 2 - math.floor(math.log10(std)))
        number = f"{{ value = {value:.{digits}f}, std = {std:.{digits}f} }}"
        line = re.compile(rf"^({key}\s*=\s*)[^#\r\n]*?([ \t]*#[^\r\n]*)?(\r?)$", re.MULTILINE)
        was = line.search(table)
        if was is not None:
            table = f"{table[: was.start()]}{was[1]}{number}{was[2] or _OURS}{was[3]}{table[was.end() :]}"
        else:
            head, _, rest = table.partition("\n")
            table = f"{head}\n{key} = {number}{_OURS}\n{rest}"
    return table


def _changes(before: list[str], after: list[str]) -> Iterator[str]:
    yield from (f"- {line}" for line in before if line not in after)
    yield from (f"+ {line}" for line in after if line not in before)
