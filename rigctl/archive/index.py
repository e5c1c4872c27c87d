"""The index of an archive: an SQLite file next to the runs with their properties and results.

A row is a run and, where the run was compared with the model, one of its regions; `COLUMNS` lists what it holds.
`update_index` reads changed run folders and `comparison.json` files; an index of an older layout is rebuilt. `find`
takes a condition of SQL, which an authorizer of SQLite limits to reading.
"""

import os
import re
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Literal, NamedTuple

from pydantic_core import from_json

from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded, sha256_of
from rigctl.base.numbers import shown
from rigctl.errors import ConfigError, DataError
from rigctl.runs.check import wholeness
from rigctl.runs.folder import ANNOTATIONS_FILE, MANIFEST_FILE, read_annotation_lines, read_contents, sound_annotations
from rigctl.runs.records import EVENTS_FILE, SESSION_FILE, FrameRecord, SessionRecord, excluded_frames

Kind = Literal["text", "number"]
Level = Literal["run", "comparison", "region"]
Fact = str | float | None


class IndexColumn(NamedTuple):
    """A column that can be asked for."""

    name: str  #: as in conditions, CSV and JSON
    kind: Kind  #: type of values to compare with
    level: Level
    meaning: str  #: one line, with the unit


COLUMNS = (
    IndexColumn("run", "text", "run", "folder of the run, from the archive's root"),
    IndexColumn("state", "text", "run", "whole, unfinished or damaged, by session file, manifest and events"),
    IndexColumn("problem", "text", "run", "first damage"),
    IndexColumn("name", "text", "run", "name of the session"),
    IndexColumn("origin", "text", "run", "device, simulated, import"),
    IndexColumn("utc", "text", "run", "start of the first frame, ISO 8601; compares as text"),
    IndexColumn("end_utc", "text", "run", "end of the last frame"),
    IndexColumn("frames", "number", "run", "frames in the manifest"),
    IndexColumn("scenes", "number", "run", "frames of the scene"),
    IndexColumn("excluded", "number", "run", "frames that people excluded"),
    IndexColumn("notes", "number", "run", "notes of people"),
    IndexColumn("exposure_ms", "number", "run", "longest exposure of the scene [ms]"),
    IndexColumn("latitude_deg", "number", "run", "latitude of the site, north is positive [deg]"),
    IndexColumn("longitude_deg", "number", "run", "longitude of the site, east is positive [deg]"),
    IndexColumn(
        "sun_zenith", "number", "run", "angle of the sun from the zenith at the middle frame, without refraction [deg]"
    ),
    IndexColumn("sun_azimuth", "number", "run", "azimuth of the sun there, clockwise from north [deg]"),
    IndexColumn("rig", "text", "run", "name of the rig file"),
    IndexColumn("camera", "text", "run", "model and serial number of the camera"),
    IndexColumn("stage", "text", "run", "model and serial number of the stage"),
    IndexColumn("bit_depth", "number", "run", "bits of the camera"),
    IndexColumn("noise", "text", "run", "gain of the session's noise calibration [DN/e], empty for none"),
    IndexColumn("created_by", "text", "run", "program and version that made the run"),
    IndexColumn("schema_version", "number", "run", "layout of the run"),
    IndexColumn("manifest_sha256", "text", "run", "hash of the manifest, which identifies the run in results"),
    IndexColumn(
        "verdict",
        "text",
        "comparison",
        "of the newest comparison: agrees, agrees_with_reservations, disagrees, cannot_be_judged",
    ),
    IndexColumn("flags", "number", "comparison", "reservations of that comparison"),
    IndexColumn("unsound", "number", "comparison", "failed checks of that comparison"),
    IndexColumn("scene", "text", "comparison", "hash of its scene file"),
    IndexColumn("report", "text", "comparison", "its folder, from the archive's root"),
    IndexColumn("region", "text", "region", "name of a region of that comparison"),
    IndexColumn("region_verdict", "text", "region", "verdict on the region"),
    IndexColumn("dolp", "number", "region", "its measured DoLP"),
    IndexColumn("dolp_sigma", "number", "region", "standard error of that"),
    IndexColumn("aolp_deg", "number", "region", "its measured AoLP [deg]"),
    IndexColumn("aolp_sigma_deg", "number", "region", "standard error of that [deg]"),
    IndexColumn("dolp_predicted", "number", "region", "DoLP predicted by the model"),
    IndexColumn("dolp_z", "number", "region", "measured less predicted DoLP in its standard errors"),
)
BY_NAME = {column.name: column for column in COLUMNS}
KEPT_FILES = (SESSION_FILE, MANIFEST_FILE, EVENTS_FILE, ANNOTATIONS_FILE)
_MS_PER_S = 1000.0
_ZENITH_DEG = 90.0
INDEX_FILE = ".rigctl-index.sqlite"
COMPARISON_FILE = "comparison.json"
# Raised with every change of columns; an older index is rebuilt.
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
    """Update the index of an archive from its folders; a missing or old one is built."""
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


def find(root: Path, expression: str) -> list[dict[str, Fact]]:
    """Return the rows of an archive for which a condition holds: a run and, if it was compared, one of its regions."""
    condition = checked_condition(expression)
    require_folder(root)
    if not (root / INDEX_FILE).is_file():
        raise ConfigError(f"{root}: has no index; make it: rigctl archive index {root}")
    names = [column.name for column in COLUMNS]
    listed = ", ".join(f'"{name}"' for name in names)
    with _opened(root) as index:
        index.set_authorizer(_only_reading)
        rows = index.execute(f"SELECT {listed} FROM found WHERE (\n{condition}\n) ORDER BY run, region").fetchall()
        index.set_authorizer(None)
        return [dict(zip(names, row, strict=True)) for row in rows]


def matching_runs(root: Path, where: str | None) -> list[str]:
    """Return the runs for which an expression holds, or all without one; an expression updates the index."""
    require_folder(root)
    if where is None:
        return sorted(run.relative_to(root).as_posix() for run in found_below(root)[0])
    checked_condition(where)  # before the slow update of the index
    update_index(root)
    return sorted({str(row["run"]) for row in find(root, where)})


def found_below(root: Path) -> tuple[list[Path], list[Path]]:
    """Return the runs below a folder and the comparisons, without searching within runs."""
    runs, comparisons = [], []
    for name, folders, files in os.walk(root):
        folder = Path(name)
        if folder != root and any((folder / one).is_file() for one in (SESSION_FILE, MANIFEST_FILE)):
            runs.append(folder)
            folders.clear()
            continue
        folders[:] = sorted(one for one in folders if not one.startswith("."))
        if COMPARISON_FILE in files:
            comparisons.append(folder / COMPARISON_FILE)
    return runs, comparisons


def require_folder(root: Path) -> None:
    """Raise ConfigError unless an archive is a folder."""
    if not root.is_dir():
        raise ConfigError(f"{root}: there is no such folder; an archive is a folder with runs below it")


def fingerprint(run: Path) -> str:
    """Return the fingerprint of a run: size and time of its journals and of its folder of frames."""
    facts = []
    for path in (run, *(run / name for name in KEPT_FILES)):
        try:
            stat = path.stat()
        except FileNotFoundError:
            continue
        facts.append(f"{path.name} {stat.st_size} {stat.st_mtime_ns}")
    return "\n".join(facts)


def facts_of(run: Path) -> dict[str, Fact]:
    """Return a run's columns; for a damaged one, the readable ones and the damage."""
    try:
        contents = read_contents(run)
    except DataError as error:
        return {"state": "damaged", "problem": str(error)}
    state, damage = wholeness(run, contents)
    problems = [f"{file}: {text}" for file, text in damage]
    problems += [f"{record.file}: missing" for record in contents.frames if not (run / record.file).is_file()][:1]
    facts: dict[str, Fact] = {
        "state": "damaged" if problems else state,
        "problem": problems[0] if problems else "",
        **_of_frames(contents.frames),
        **_of_annotations(run),
    }
    if (run / MANIFEST_FILE).is_file():
        facts["manifest_sha256"] = sha256_of(run / MANIFEST_FILE)
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


def _device(device: Mapping[str, object]) -> str:
    return " ".join(str(device[key]) for key in ("model", "serial_number") if device.get(key))


# Verdicts in words.
_VERDICTS = {"agree": "agrees", "disagree": "disagrees", "reservations": "agrees_with_reservations"}
_COMPARED = re.compile(r"""\b(\w+)(\s*(?:<=|>=|<>|!=|==|=|<|>)\s*)('[^']*'|"[^"]*"|[-+]?[\d.]+)""")
_FUNCTIONS = ("abs", "coalesce", "glob", "ifnull", "length", "like", "lower", "max", "min", "round", "substr", "upper")


def checked_condition(expression: str) -> str:
    """Return a condition of SQL that only reads columns, or raise ConfigError."""

    def compared(match: re.Match[str]) -> str:
        name, sign, value = match.groups()
        kind = BY_NAME[name].kind if name in BY_NAME else None
        is_text = value[0] in "'\""
        if kind is not None and is_text != (kind == "text"):
            wanted = "a text: put it into quotes" if kind == "text" else "a number, without quotes"
            raise ConfigError(f"EXPR: {shown(expression)}: {name} is compared with {wanted}")
        if is_text:
            text = value[1:-1].replace("'", "''")
            value = f"'{_VERDICTS.get(text, text) if name.endswith('verdict') else text}'"
        return f"{name}{sign}{value}"

    condition = _COMPARED.sub(compared, expression)
    trial = sqlite3.connect(":memory:")
    try:
        trial.execute(f"CREATE TABLE found ({', '.join(map(_declared, BY_NAME))})")
        trial.set_authorizer(_only_reading)
        trial.execute(f"SELECT 1 FROM found WHERE (\n{condition}\n)")
    except (sqlite3.Error, sqlite3.Warning, ValueError) as error:
        raise ConfigError(_problem(expression, str(error))) from error
    finally:
        trial.close()
    return condition


def _only_reading(action: int, *names: str | None) -> int:
    """Allow SQLite to read columns of the index and to call functions that only compute."""
    allowed = {
        sqlite3.SQLITE_SELECT: True,
        sqlite3.SQLITE_READ: names[0] in ("found", "runs", "comparisons", "regions"),
        sqlite3.SQLITE_FUNCTION: names[1] in _FUNCTIONS,
    }
    return sqlite3.SQLITE_OK if allowed.get(action, False) else sqlite3.SQLITE_DENY


def _problem(expression: str, words: str) -> str:
    _, is_column, name = words.partition("no such column: ")
    if is_column:
        close = get_close_matches(name, BY_NAME, n=3, cutoff=0.6)
        meant = f"did you mean {', '.join(close)}? " if close else ""
        return f"EXPR: there is no column {name!r}; {meant}there are {', '.join(BY_NAME)}"
    example = "sun_zenith < 40 and region = 'asphalt' and verdict = 'disagrees'"
    return f"EXPR: {shown(expression)} cannot be read as a condition: {words}; write for instance {example}"


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
        what = "is damaged or not an index" if not isinstance(error, sqlite3.OperationalError) else "cannot be used"
        raise DataError(f"{path}: {what}: {error}; remove it and build it again: rigctl archive index") from error


def _make(index: sqlite3.Connection, path: Path) -> None:
    tables = [name for (name,) in index.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
    if set(tables) - {"runs", "comparisons", "regions"}:
        raise DataError(f"{path}: is a database of another program")
    index.execute("DROP VIEW IF EXISTS found")
    for table in tables:
        index.execute(f"DROP TABLE {table}")
    columns = {
        level: ", ".join(_declared(one.name) for one in COLUMNS if one.level == level)
        for level in ("run", "comparison", "region")
    }
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
    """Read every comparison again, the newest of a run last: they are small, and may have been replaced."""
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
    """Return manifest, columns and regions of a comparison; None if the file cannot be read."""
    try:
        content = from_json(read_bounded(file, MOST_RECORD_BYTES))
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
