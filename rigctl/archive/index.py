"""What an archive knows of its runs: one table of columns, of runs and of their regions.

Questions to an archive: comparisons of columns with numbers and texts, joined by and, or, not, to bound SQL.

What the index of an archive keeps of a run, and by what it sees that the run has changed.

The index of an archive: an SQLite file beside the runs, made from them and from the comparisons among them.
"""

import json
import math
import os
import re
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from hashlib import sha256
from pathlib import Path
from typing import Literal

from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded
from rigctl.errors import ConfigError, DataError
from rigctl.runs.check import wholeness
from rigctl.runs.folder import ANNOTATIONS_FILE, MANIFEST_FILE, read_annotation_lines, read_contents, sound_annotations
from rigctl.runs.records import EVENTS_FILE, SESSION_FILE, DeviceAsTaken, FrameRecord, SessionRecord, excluded_frames

Kind = Literal["text", "number"]
Level = Literal["run", "comparison", "region"]


@dataclass(frozen=True, kw_only=True)
class IndexColumn:
    """A column that can be asked for."""

    name: str  #: As in expressions, CSV and JSON.
    kind: Kind  #: With what it can be compared.
    level: Level  #: Of what it is.
    meaning: str  #: One line, with the unit.


def _run(name: str, kind: Kind, meaning: str) -> IndexColumn:
    return IndexColumn(name=name, kind=kind, level="run", meaning=meaning)


def _compared(name: str, kind: Kind, meaning: str) -> IndexColumn:
    return IndexColumn(name=name, kind=kind, level="comparison", meaning=meaning)


def _region(name: str, kind: Kind, meaning: str) -> IndexColumn:
    return IndexColumn(name=name, kind=kind, level="region", meaning=meaning)


COLUMNS = (
    _run("run", "text", "folder of the run, from the archive's root"),
    _run("state", "text", "whole, unfinished, damaged: session file, manifest and events held against each other"),
    _run("problem", "text", "what is damaged, the first of it"),
    _run("name", "text", "name of the session"),
    _run("origin", "text", "device, simulated, import"),
    _run("utc", "text", "start of the first frame, ISO 8601; compares as text"),
    _run("end_utc", "text", "end of the last frame"),
    _run("frames", "number", "frames in the manifest"),
    _run("scenes", "number", "of them frames of the scene"),
    _run("excluded", "number", "frames that people excluded"),
    _run("notes", "number", "notes of people"),
    _run("exposure_ms", "number", "longest exposure of the scene [ms]"),
    _run("latitude_deg", "number", "latitude of the site, north is positive [deg]"),
    _run("longitude_deg", "number", "longitude of the site, east is positive [deg]"),
    _run("sun_zenith", "number", "angle of the sun from the zenith at the middle frame, without refraction [deg]"),
    _run("sun_azimuth", "number", "azimuth of the sun there, clockwise from north [deg]"),
    _run("rig", "text", "name of the rig file"),
    _run("camera", "text", "model and serial number of the camera"),
    _run("stage", "text", "model and serial number of the stage"),
    _run("bit_depth", "number", "bits of the camera"),
    _run("noise", "text", "noise calibration that the session was watched with: its gain [DN/e], empty for none"),
    _run("created_by", "text", "program and version that made the run"),
    _run("schema_version", "number", "layout of the run"),
    _run("manifest_sha256", "text", "hash of the manifest, by which results know their run"),
    _compared(
        "verdict", "text", "of the newest comparison: agrees, agrees_with_reservations, disagrees, cannot_be_judged"
    ),
    _compared("flags", "number", "reservations of that comparison"),
    _compared("unsound", "number", "checks of that comparison that were not sound"),
    _compared("scene", "text", "hash of its scene file"),
    _compared("report", "text", "its folder, from the archive's root"),
    _region("region", "text", "name of a region of that comparison"),
    _region("region_verdict", "text", "verdict on the region alone"),
    _region("dolp", "number", "its measured DoLP"),
    _region("dolp_sigma", "number", "standard error of that"),
    _region("aolp_deg", "number", "its measured AoLP [deg]"),
    _region("aolp_sigma_deg", "number", "standard error of that [deg]"),
    _region("dolp_predicted", "number", "DoLP that the model predicts"),
    _region("dolp_z", "number", "measured less predicted DoLP in its standard errors"),
)
BY_NAME = {column.name: column for column in COLUMNS}
# Verdicts as people say them.
VERDICTS = {"agree": "agrees", "disagree": "disagrees", "reservations": "agrees_with_reservations"}


def of_level(level: Level) -> tuple[str, ...]:
    """Return the names of a level's columns."""
    return tuple(column.name for column in COLUMNS if column.level == level)


_TOKEN = re.compile(
    r"\s*(?:(?P<text>'[^']*'|\"[^\"]*\")|(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    r"|(?P<sign><=|>=|!=|<|>|=)|(?P<bracket>[()])|(?P<word>[A-Za-z_]\w*))"
)
_WORDS = ("and", "or", "not")
# Brackets within brackets: more no person writes.
_DEEPEST = 50


@dataclass(frozen=True, kw_only=True)
class Condition:
    """A condition of SQL with the values that are bound to its places, never written into it."""

    sql: str
    values: tuple[str | float, ...]


@dataclass(frozen=True, kw_only=True)
class _Token:
    kind: str
    text: str
    place: int


def parse(expression: str) -> Condition:
    """Return the condition that an expression states."""
    reader = _Reader(expression, _tokens(expression))
    found = reader.any_of(0)
    reader.require_end()
    return found


def _tokens(expression: str) -> list[_Token]:
    found, place = [], 0
    while expression[place:].strip():
        match = _TOKEN.match(expression, place)
        if match is None:
            blank = len(expression[place:]) - len(expression[place:].lstrip())
            raise _problem(expression, place + blank, "cannot be read here")
        kind = str(match.lastgroup)
        text = match.group(kind)
        word = kind == "word" and text.lower() in _WORDS
        found.append(
            _Token(kind="join" if word else kind, text=text.lower() if word else text, place=match.start(kind))
        )
        place = match.end()
    return found


def _problem(expression: str, place: int, what: str) -> ConfigError:
    return ConfigError(
        f"EXPR: {expression!r}, at character {place + 1}: {what}; write for instance "
        "sun_zenith < 40 and region = 'asphalt' and verdict = 'disagrees'"
    )


class _Reader:
    """Reads tokens from left to right: `or` of `and` of `not` of comparisons."""

    def __init__(self, expression: str, tokens: Sequence[_Token]) -> None:
        self._expression, self._tokens, self._next = expression, tokens, 0

    def any_of(self, depth: int) -> Condition:
        """Return conditions joined by or."""
        return self._joined("or", self._all_of, depth)

    def _all_of(self, depth: int) -> Condition:
        return self._joined("and", self._one, depth)

    def _joined(self, word: str, part: Callable[[int], Condition], depth: int) -> Condition:
        found = [part(depth)]
        while self._taken("join", word):
            found.append(part(depth))
        if len(found) == 1:
            return found[0]
        sql = f" {word.upper()} ".join(f"({one.sql})" for one in found)
        return Condition(sql=sql, values=tuple(value for one in found for value in one.values))

    def _one(self, depth: int) -> Condition:
        if depth > _DEEPEST:
            raise self._wrong(f"more than {_DEEPEST} brackets or nots within each other")
        if self._taken("join", "not"):
            found = self._one(depth + 1)
            return Condition(sql=f"NOT ({found.sql})", values=found.values)
        if self._taken("bracket", "("):
            found = self.any_of(depth + 1)
            if not self._taken("bracket", ")"):
                raise self._wrong("a closing bracket is missing")
            return found
        return self._comparison()

    def _comparison(self) -> Condition:
        name = self._required("word", "a column is wanted").text
        if name not in BY_NAME:
            close = get_close_matches(name, BY_NAME, n=3, cutoff=0.6)
            meant = f"did you mean {', '.join(close)}? " if close else ""
            raise ConfigError(f"EXPR: there is no column {name!r}; {meant}there are {', '.join(BY_NAME)}")
        sign = self._required("sign", "one of < <= > >= = != is wanted").text
        value = self._value(name)
        return Condition(sql=f'"{name}" {sign} ?', values=(value,))

    def _value(self, name: str) -> str | float:
        token = self._tokens[self._next] if self._next < len(self._tokens) else None
        kind = BY_NAME[name].kind
        if token is None or token.kind not in ("text", "number"):
            raise self._wrong("a number, or a text in quotes, is wanted")
        if (token.kind == "text") != (kind == "text"):
            wanted = "a text: put it into quotes" if kind == "text" else "a number, without quotes"
            raise self._wrong(f"{name} is compared with {wanted}")
        self._next += 1
        if token.kind == "text":
            text = token.text[1:-1]
            return VERDICTS.get(text, text) if name.endswith("verdict") else text
        number = float(token.text)
        if not math.isfinite(number):
            raise self._wrong(f"{token.text} is too large")
        return number

    def require_end(self) -> None:
        """Refuse what stands behind a whole expression."""
        if self._next < len(self._tokens):
            raise self._wrong("and, or, or the end is wanted")

    def _taken(self, kind: str, text: str) -> bool:
        token = self._tokens[self._next] if self._next < len(self._tokens) else None
        if token is None or (token.kind, token.text) != (kind, text):
            return False
        self._next += 1
        return True

    def _required(self, kind: str, what: str) -> _Token:
        token = self._tokens[self._next] if self._next < len(self._tokens) else None
        if token is None or token.kind != kind:
            raise self._wrong(what)
        self._next += 1
        return token

    def _wrong(self, what: str) -> ConfigError:
        at_end = self._next >= len(self._tokens)
        return _problem(self._expression, len(self._expression) if at_end else self._tokens[self._next].place, what)


Fact = str | float | None
KEPT_FILES = (SESSION_FILE, MANIFEST_FILE, EVENTS_FILE, ANNOTATIONS_FILE)
_MS_PER_S = 1000.0
_ZENITH_DEG = 90.0


def is_run(folder: Path) -> bool:
    """Return whether a folder is a run, whole or not."""
    return any((folder / name).is_file() for name in (SESSION_FILE, MANIFEST_FILE))


def fingerprint(run: Path) -> str:
    """Return what changes when a run does: size and time of its journals, and of the folder, whose frames they name."""
    facts = []
    for path in (run, *(run / name for name in KEPT_FILES)):
        try:
            stat = path.stat()
        except FileNotFoundError:
            continue
        facts.append(f"{path.name} {stat.st_size} {stat.st_mtime_ns}")
    return "\n".join(facts)


def facts_of(run: Path) -> dict[str, Fact]:
    """Return a run's columns; of a damaged one, those that can be had, and what is damaged."""
    try:
        contents = read_contents(run)
    except DataError as error:
        return {"state": "damaged", "problem": str(error)}
    judged = wholeness(run, contents)
    problems = [f"{file}: {text}" for file, text in judged.problems]
    problems += [f"{record.file}: missing" for record in contents.frames if not (run / record.file).is_file()][:1]
    facts: dict[str, Fact] = {
        "state": "damaged" if problems else judged.state,
        "problem": problems[0] if problems else "",
        **_of_frames(contents.frames),
        **_of_annotations(run),
    }
    if (run / MANIFEST_FILE).is_file():
        facts["manifest_sha256"] = sha256((run / MANIFEST_FILE).read_bytes()).hexdigest()
    if contents.description is not None:
        session = contents.description.record
        facts |= {"created_by": contents.description.created_by, "schema_version": contents.description.schema_version}
        facts |= _of_session(session)
    return facts


def _of_frames(frames: Sequence[FrameRecord]) -> dict[str, Fact]:
    scenes = [record for record in frames if record.kind == "scene"]
    exposures = [record.exposure_s for record in scenes if record.exposure_s is not None]
    starts = sorted(record.start_utc for record in frames if record.start_utc)
    ends = sorted(record.end_utc for record in frames if record.end_utc)
    middle = scenes[len(scenes) // 2] if scenes else None
    elevation = None if middle is None else middle.sun_elevation_deg
    return {
        "frames": len(frames),
        "scenes": len(scenes),
        "utc": starts[0] if starts else None,
        "end_utc": ends[-1] if ends else None,
        "exposure_ms": _MS_PER_S * max(exposures) if exposures else None,
        "bit_depth": frames[0].bit_depth if frames else None,
        "latitude_deg": None if middle is None else middle.site_latitude_deg,
        "longitude_deg": None if middle is None else middle.site_longitude_deg,
        "sun_zenith": None if elevation is None else _ZENITH_DEG - elevation,
        "sun_azimuth": None if middle is None else middle.sun_azimuth_deg,
    }


def _of_annotations(run: Path) -> dict[str, Fact]:
    annotations = sound_annotations(read_annotation_lines(run)) if (run / ANNOTATIONS_FILE).is_file() else ()
    notes = sum(one.kind == "note" for one in annotations)
    return {"excluded": len(excluded_frames(annotations)), "notes": notes}


def _of_session(session: SessionRecord) -> dict[str, Fact]:
    return {
        "origin": session.origin,
        "rig": None if session.rig is None else session.rig.name,
        "name": None if session.session is None else session.session.name,
        "camera": _device(session.camera),
        "stage": _device(session.stage),
        "noise": "" if session.noise is None else f"{session.noise.gain_dn_per_e:g}",
    }


def _device(device: DeviceAsTaken) -> str:
    return " ".join(text for text in (device.model, device.serial_number) if text)


INDEX_FILE = ".rigctl-index.sqlite"
COMPARISON_FILE = "comparison.json"
# Raised with every change of columns or of their meaning: an older index is made anew.
_LAYOUT = 1
_WAIT_S = 30.0


@dataclass(frozen=True, kw_only=True)
class Indexed:
    """What an update of an index did."""

    runs: int
    new: int
    changed: int
    gone: int
    damaged: int
    comparisons: int


def update_index(root: Path) -> Indexed:
    """Bring the index of an archive to what its folders hold; one that is not there, or of old, is made."""
    require_folder(root)
    runs, comparisons = found_below(root)
    with _opened(root) as index:
        known = dict(index.execute("SELECT run, fingerprint FROM runs"))
        seen = {str(run.relative_to(root)): fingerprint(run) for run in runs}
        changed = [run for run in seen if known.get(run) != seen[run]]
        for run in changed:
            _put(index, "runs", {"run": run, "fingerprint": seen[run], **facts_of(root / run)})
        gone = set(known) - set(seen)
        index.executemany("DELETE FROM runs WHERE run = ?", [(run,) for run in gone])
        _compare(index, root, comparisons)
        damaged = index.execute("SELECT count(*) FROM runs WHERE state = 'damaged'").fetchone()[0]
    new = sum(run not in known for run in changed)
    return Indexed(
        runs=len(seen),
        new=new,
        changed=len(changed) - new,
        gone=len(gone),
        damaged=damaged,
        comparisons=len(comparisons),
    )


def find(root: Path, condition: Condition) -> list[dict[str, Fact]]:
    """Return the rows of an archive that a condition holds of: a run and, where it was compared, one of its regions."""
    require_folder(root)
    if not (root / INDEX_FILE).is_file():
        raise ConfigError(f"{root}: has no index; make it: rigctl archive index {root}")
    names = [column.name for column in COLUMNS]
    listed = ", ".join(f'"{name}"' for name in names)
    with _opened(root) as index:
        rows = index.execute(f"SELECT {listed} FROM found WHERE {condition.sql} ORDER BY run, region", condition.values)
        return [dict(zip(names, row, strict=True)) for row in rows]


def matching_runs(root: Path, where: str | None) -> list[str]:
    """Return the runs of which an expression holds, all if there is none; an expression brings the index up to date."""
    require_folder(root)
    if where is None:
        return sorted(run.relative_to(root).as_posix() for run in found_below(root)[0])
    condition = parse(where)
    update_index(root)
    return sorted({str(row["run"]) for row in find(root, condition)})


def require_folder(root: Path) -> None:
    """Raise ConfigError where an archive is no folder."""
    if not root.is_dir():
        raise ConfigError(f"{root}: there is no such folder; an archive is a folder with runs below it")


def found_below(root: Path) -> tuple[list[Path], list[Path]]:
    """Return the runs below a folder and the comparisons; nothing is sought within a run."""
    runs, comparisons = [], []
    for name, folders, files in os.walk(root):
        folder = Path(name)
        if folder != root and is_run(folder):
            runs.append(folder)
            folders.clear()
            continue
        folders[:] = sorted(one for one in folders if not one.startswith("."))
        if COMPARISON_FILE in files:
            comparisons.append(folder / COMPARISON_FILE)
    return runs, comparisons


@contextmanager
def _opened(root: Path) -> Iterator[sqlite3.Connection]:
    """Open the index within one transaction: it changes whole, or not at all."""
    path = root / INDEX_FILE
    try:
        index = sqlite3.connect(path, timeout=_WAIT_S, isolation_level=None)
        try:
            index.execute("BEGIN IMMEDIATE" if os.access(root, os.W_OK) else "BEGIN")
            if index.execute("PRAGMA user_version").fetchone()[0] != _LAYOUT:
                _make(index, path)
            yield index
            index.execute("COMMIT")
        finally:
            index.close()
    except sqlite3.DatabaseError as error:
        what = "is damaged or no index" if not isinstance(error, sqlite3.OperationalError) else "cannot be used"
        raise DataError(f"{path}: {what}: {error}; it can be removed and made anew: rigctl archive index") from error


def _make(index: sqlite3.Connection, path: Path) -> None:
    tables = [name for (name,) in index.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
    if set(tables) - {"runs", "comparisons", "regions"}:
        raise DataError(f"{path}: is a database of another program")
    index.execute("DROP VIEW IF EXISTS found")
    for table in tables:
        index.execute(f"DROP TABLE {table}")
    columns = {level: ", ".join(map(_declared, of_level(level))) for level in ("run", "comparison", "region")}
    index.execute(f"CREATE TABLE runs ({columns['run']}, fingerprint TEXT, PRIMARY KEY (run))")
    index.execute("CREATE INDEX runs_by_manifest ON runs (manifest_sha256)")
    key = "manifest_sha256 TEXT"
    index.execute(f"CREATE TABLE comparisons ({key}, {columns['comparison']}, PRIMARY KEY (manifest_sha256))")
    index.execute(f"CREATE TABLE regions ({key}, {columns['region']}, PRIMARY KEY (manifest_sha256, region))")
    index.execute(
        "CREATE VIEW found AS SELECT * FROM runs LEFT JOIN comparisons USING (manifest_sha256) "
        "LEFT JOIN regions USING (manifest_sha256)"
    )
    index.execute(f"PRAGMA user_version = {_LAYOUT}")


def _declared(name: str) -> str:
    return f'"{name}" ' + ("TEXT" if BY_NAME[name].kind == "text" else "REAL")


def _put(index: sqlite3.Connection, table: str, facts: Mapping[str, Fact]) -> None:
    names = ", ".join(f'"{name}"' for name in facts)
    places = ", ".join("?" * len(facts))
    index.execute(f"INSERT OR REPLACE INTO {table} ({names}) VALUES ({places})", tuple(facts.values()))


def _compare(index: sqlite3.Connection, root: Path, files: Sequence[Path]) -> None:
    """Take every comparison anew, the newest of a run last: they are small, and may have been replaced."""
    index.execute("DELETE FROM comparisons")
    index.execute("DELETE FROM regions")
    for file in sorted(files, key=lambda path: path.stat().st_mtime_ns):
        found = _comparison(file)
        if found is not None:
            manifest, facts, regions = found
            report = {"report": str(file.parent.relative_to(root))}
            _put(index, "comparisons", {"manifest_sha256": manifest, **facts, **report})
            index.execute("DELETE FROM regions WHERE manifest_sha256 = ?", (manifest,))
            for region in regions:
                _put(index, "regions", {"manifest_sha256": manifest, **region})


def _comparison(file: Path) -> tuple[str, dict[str, Fact], list[dict[str, Fact]]] | None:
    """Return the manifest, columns and regions of a comparison; None where the file is none that can be read."""
    try:
        content = json.loads(read_bounded(file, MOST_RECORD_BYTES))
        files = content["provenance"]["files"]
        facts: dict[str, Fact] = {
            "verdict": content["verdict"],
            "flags": len(content["flags"]),
            "unsound": sum(check["verdict"] != "sound" for check in content["checks"]),
            "scene": files.get("scene", {}).get("sha256"),
        }
        means = [row for row in content["rows"] if row["statistic"] == "mean"]
        regions = [_region_numbers(name, one, means) for name, one in content["regions"].items()]
        return files["manifest"]["sha256"], facts, regions
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _region_numbers(
    name: str, content: Mapping[str, str], means: Sequence[Mapping[str, float | str]]
) -> dict[str, Fact]:
    rows = {row["quantity"]: row for row in means if row["region"] == name}
    dolp, aolp = rows.get("dolp", {}), rows.get("aolp_deg", {})
    return {
        "region": name,
        "region_verdict": content["verdict"],
        "dolp": dolp.get("measured"),
        "dolp_sigma": dolp.get("std_error"),
        "aolp_deg": aolp.get("measured"),
        "aolp_sigma_deg": aolp.get("std_error"),
        "dolp_predicted": dolp.get("predicted"),
        "dolp_z": dolp.get("z"),
    }
