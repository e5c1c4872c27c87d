"""The index of an archive: an SQLite file beside the runs, made from them and from the comparisons among them."""

import json
import os
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rigctl.archive.columns import BY_NAME, COLUMNS, of_level
from rigctl.archive.expression import Condition
from rigctl.archive.run_facts import Fact, facts_of, fingerprint, is_run
from rigctl.errors import ConfigError, DataError
from rigctl.storage.bounded_file import MOST_RECORD_BYTES, read_bounded

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
    """Bring the index of an archive to what its folders hold; one that is not there, or of old, is made.

    Parameters
    ----------
    root : Path
        The archive: runs at any depth below it.

    Raises
    ------
    ConfigError
        There is no such folder, or the index cannot be written.
    DataError
        A file of the index's name is something else.
    """
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
    """Return the rows of an archive that a condition holds of: a run and, where it was compared, one of its regions.

    Raises
    ------
    ConfigError
        The archive has no index.
    DataError
        The index is damaged, or of another version.
    """
    require_folder(root)
    if not (root / INDEX_FILE).is_file():
        raise ConfigError(f"{root}: has no index; make it: rigctl archive index {root}")
    names = [column.name for column in COLUMNS]
    listed = ", ".join(f'"{name}"' for name in names)
    with _opened(root) as index:
        rows = index.execute(f"SELECT {listed} FROM found WHERE {condition.sql} ORDER BY run, region", condition.values)
        return [dict(zip(names, row, strict=True)) for row in rows]


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
        regions = [_region(name, one, means) for name, one in content["regions"].items()]
        return files["manifest"]["sha256"], facts, regions
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _region(name: str, content: Mapping[str, str], means: Sequence[Mapping[str, float | str]]) -> dict[str, Fact]:
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
