"""Migrating old runs and calibrations to the schemas of today: a copy beside, the old one is never touched."""

import json
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from pydantic import JsonValue

from rigctl.calibrations.content_file import write_content
from rigctl.calibrations.noise.noise_file import SCHEMA_VERSION as NOISE_VERSION
from rigctl.calibrations.noise.noise_file import read_noise_file
from rigctl.calibrations.polarizer.polarizer_file import SCHEMA_VERSION as POLARIZER_VERSION
from rigctl.calibrations.polarizer.polarizer_file import read_polarizer_file
from rigctl.calibrations.store import read_stored
from rigctl.errors import ConfigError, RunFolderError
from rigctl.numbers.utc_time import utc_text
from rigctl.runs.run_description import (
    SCHEMA_VERSION,
    SESSION_FILE,
    RunDescription,
    encode_description,
    first_link,
    read_description,
)
from rigctl.runs.run_events import EVENTS_FILE, RunEvent, closing_facts, read_journal
from rigctl.runs.run_folder import INPUTS_FOLDER, MANIFEST_FILE, read_contents
from rigctl.runs.sealed_lines import read_lines, sealed_all
from rigctl.runs.verification import verify_run
from rigctl.storage.bounded_file import MOST_RECORD_BYTES, read_bounded
from rigctl.version import VERSION

MIGRATED = "-migrated"
_FINISHED = ("finished", "imported")
Clock = Callable[[], int]


@dataclass(frozen=True, kw_only=True)
class Migration:
    """What becomes of an old run or calibration.

    Attributes
    ----------
    path : Path
        The run folder or file.
    kind : str
        "run", or the kind of the calibration.
    schema, newest : int
        Its schema, and the newest of its kind.
    copy : Path or None
        Where the copy of the newest schema stands, or would; None where there is nothing to do.
    is_written : bool
        The copy is there.
    """

    path: Path
    kind: str
    schema: int
    newest: int
    copy: Path | None
    is_written: bool = False

    @property
    def line(self) -> str:
        """It in a line that a person reads."""
        if self.copy is None:
            return f"{self.path}: {self.kind}, schema {self.schema}: is the newest"
        done = "written to" if self.is_written else "would be written to"
        return f"{self.path}: {self.kind}, schema {self.schema}; with schema {self.newest} {done} {self.copy}"


def migrate(path: Path, *, write: bool, utc_ns: Clock = time.time_ns) -> Migration:
    """Return what becomes of an old run or calibration, once its copy is written where that is wanted.

    Parameters
    ----------
    path : Path
        Run folder or calibration file.
    write : bool
        Write the copy; else only say what it would be.
    utc_ns : callable
        The clock [ns].

    Raises
    ------
    ConfigError
        The copy's place is taken.
    DataError
        It is damaged, is neither, or of a later schema than this program reads.
    """
    found = _of_run(path) if path.is_dir() else _of_file(path)
    if found.copy is None or not write:
        return found
    if found.copy.exists() or found.copy.is_symlink():
        raise ConfigError(f"{found.copy}: is there already; take it away, or leave it")
    if found.kind == "run":
        _write_run(path, found.copy, utc_ns)
    else:
        _write_calibration(path, found.copy, found.newest, utc_ns)
    return replace(found, is_written=True)


def _of_run(path: Path) -> Migration:
    contents = read_contents(path)
    description = contents.description
    if description is None or not verify_run(path).ok:
        raise RunFolderError(f"{path}: is damaged (rigctl verify says where): what is damaged is not migrated")
    copy = None if description.is_sealed else path.absolute().with_name(path.absolute().name + MIGRATED)
    return Migration(path=path, kind="run", schema=description.schema_version, newest=SCHEMA_VERSION, copy=copy)


def _of_file(path: Path) -> Migration:
    kind = read_stored(path).kind
    versions = {
        "noise": lambda: (read_noise_file(path).schema_version, NOISE_VERSION),
        "polarizer": lambda: (read_polarizer_file(path).schema_version, POLARIZER_VERSION),
    }
    schema, newest = versions[kind]() if kind in versions else (1, 1)
    copy = None if schema == newest else path.with_name(f"{path.stem}{MIGRATED}{path.suffix}")
    return Migration(path=path, kind=kind, schema=schema, newest=newest, copy=copy)


def _write_run(path: Path, copy: Path, utc_ns: Clock) -> None:
    """Copy a run whose lines have no seals, and seal them; the frames are the same bytes."""
    old = read_description(path / SESSION_FILE)
    description = _described_anew(old, path, utc_ns)
    part = copy.with_name(f"{copy.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    shutil.copytree(path, part, ignore=shutil.ignore_patterns("writer.lock", ".room-for-events"))
    (part / SESSION_FILE).write_bytes(encode_description(description))
    link = first_link(read_description(part / SESSION_FILE))
    manifest = [line.content for line in read_lines((path / MANIFEST_FILE).read_bytes(), None).lines]
    (part / MANIFEST_FILE).write_bytes(sealed_all(manifest, link))
    links = read_lines((part / MANIFEST_FILE).read_bytes(), link).links
    events = [line.content for line in read_journal(path).lines]
    names = [json.loads(line).get("event") for line in events]
    is_closed = not old.record.is_of_session or any(name in _FINISHED for name in names)
    facts = closing_facts(frames=len(manifest), link=links[-1]) if is_closed else {}
    migrated = RunEvent(id=len(events), utc=utc_text(utc_ns()), event="migrated", facts=facts)
    events.append(json.dumps(asdict(migrated), allow_nan=False).encode("ascii"))
    (part / EVENTS_FILE).write_bytes(sealed_all(events, link))
    if not verify_run(part).ok:
        raise RunFolderError(f"{part}: the copy does not hold; the old run is as it was")
    part.rename(copy)


def _described_anew(old: RunDescription, path: Path, utc_ns: Clock) -> RunDescription:
    """Return the description of the newest layout, with what it was before; files that were not kept have no hash."""
    session: dict[str, JsonValue] = dict(old.session)
    if "files" in session and not (path / INPUTS_FOLDER).is_dir():
        session["files_not_kept"] = session.pop("files")
    session["migrated"] = {
        "from_schema_version": old.schema_version,
        "by": f"rigctl {VERSION}",
        "utc": utc_text(utc_ns()),
    }
    return replace(old, schema_version=SCHEMA_VERSION, session=session, checksum=None)


def _write_calibration(path: Path, copy: Path, newest: int, utc_ns: Clock) -> None:
    """Copy a calibration whose devices stand under the key of the first version."""
    content = json.loads(read_bounded(path, MOST_RECORD_BYTES))
    origin = read_stored(path).made_for
    older = content["schema_version"]
    rest = {key: value for key, value in content.items() if key not in ("camera", "devices", "schema_version")}
    # Nobody said for how long it holds: whoever reads it decides, as before.
    made_for = replace(origin, valid_days=None).as_json()
    write_content(
        copy,
        {
            "schema_version": newest,
            **rest,
            "made_for": made_for,
            "migrated": {"from_schema_version": older, "by": f"rigctl {VERSION}", "utc": utc_text(utc_ns())},
        },
    )
