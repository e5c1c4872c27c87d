"""Rows of an archive's job: one per finished run, stored at once, and identified by the hash of its inputs."""

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Literal

from pydantic import TypeAdapter, ValidationError

from rigctl.archive.index import KEPT_FILES
from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded, write_durably
from rigctl.console import EXIT_OWN_FAULT
from rigctl.errors import DataError
from rigctl.mapped import PARTS_FOLDER
from rigctl.runs.folder import FRAMES_FOLDER

Verb = Literal["compare", "stokes", "verify", "recalibrate"]


@dataclass(frozen=True, kw_only=True)
class RegionNumbers:
    """Numbers of a region in a run; None if unknown or not part of the job."""

    region: str  #: Its name and verdict.
    verdict: str = ""
    dolp: float | None = None  #: Measured DoLP and its standard error.
    dolp_sigma: float | None = None
    aolp_deg: float | None = None  #: Measured AoLP and its standard error [deg].
    aolp_sigma_deg: float | None = None
    dolp_predicted: float | None = None  #: DoLP of the model; measured less predicted in standard errors.
    dolp_z: float | None = None
    dolp_before: float | None = None  #: Of the run without the calibrations.
    aolp_before_deg: float | None = None


@dataclass(frozen=True, kw_only=True)
class RunRow:
    """What came of one run."""

    run: str  #: Its folder, from the archive's root.
    utc: str = ""  #: Start of its first frame, empty where it cannot be read.
    sun_zenith: float | None = None  #: Angle of the sun from the zenith at the middle frame [deg].
    exit_code: int  #: Exit code of the command for a single run.
    verdict: str  #: In a word; "failed" without a result.
    reason: str = ""  #: Reason of the failure, or reservations of the verdict.
    calibrations: str = ""  #: Used files, each with the beginning of its hash.
    seconds: float = 0.0  #: Time that it took.
    regions: tuple[RegionNumbers, ...] = ()  #: Its regions.


_ROWS: TypeAdapter[dict[str, RunRow]] = TypeAdapter(dict[str, RunRow])


def write_rows(out: Path, rows: Mapping[str, RunRow]) -> None:
    """Return once rows are on the disk, under the hash of the first."""
    write_durably(out / PARTS_FOLDER / f"{next(iter(rows))}.json", _ROWS.dump_json(dict(rows)))


def read_rows(out: Path) -> tuple[dict[str, RunRow], tuple[str, ...]]:
    """Return the finished rows by the hash of their inputs, and the unreadable files."""
    rows: dict[str, RunRow] = {}
    damaged = []
    for file in sorted((out / PARTS_FOLDER).glob("*.json")):
        try:
            found = _ROWS.validate_json(read_bounded(file, MOST_RECORD_BYTES))
        except (ValidationError, DataError, OSError) as error:
            damaged.append(f"{file}: {str(error).partition(chr(10))[0]}")
            continue
        # A row that failed by a fault of the program is computed again.
        rows |= {key: row for key, row in found.items() if key not in rows or row.exit_code != EXIT_OWN_FAULT}
    return rows, tuple(damaged)


def inputs_hash(run: Path, settings: str) -> str:
    """Return the identity of a run's row: its journals, sizes and times of its frames, and the settings."""
    digest = sha256(settings.encode())
    for name in KEPT_FILES:
        try:
            digest.update(f"\0{name}\0".encode() + read_bounded(run / name, MOST_RECORD_BYTES))
        except (OSError, DataError) as error:
            digest.update(f"\0{name}: {type(error).__name__}".encode())
    frames = run / FRAMES_FOLDER
    for file in sorted(frames.iterdir()) if frames.is_dir() else ():
        stat = file.lstat()
        digest.update(f"\0{file.name} {stat.st_size} {stat.st_mtime_ns}".encode())
    return digest.hexdigest()
