"""The store of calibrations: what it holds, what it has for a run or a rig, how its numbers have moved."""

import time
from dataclasses import asdict, dataclass
from pathlib import Path

from rigctl.base.durable import sha256_of
from rigctl.base.numbers import utc_text
from rigctl.calibrations.made_for import MadeFor, age_days
from rigctl.calibrations.record import write_whole
from rigctl.calibrations.store import (
    KINDS,
    STORE_FOLDER,
    CalibrationStore,
    Choice,
    History,
    StoredCalibration,
    choices_json,
    histories_of,
    picked_for_rig,
    read_store,
)
from rigctl.console.json_text import Json
from rigctl.errors import ConfigError
from rigctl.files.rig_file import load_rig
from rigctl.measure.calibrations import CalibrationPaths, picked_for_run
from rigctl.runs.check import used_run


@dataclass(frozen=True, kw_only=True)
class CalibrationsRequest:
    """What is asked of a store.

    Attributes
    ----------
    folder : Path or None
        The store, or the rig file that it stands beside; None is the folder ``calibrations`` here.
    used_by : Path or None
        A run or a rig file: which calibrations it would be given, and why.
    history : Path or None
        Picture to draw.
    now_ns : int or None
        For the ages of calibrations [ns since 1970 UTC]; None is now.
    """

    folder: Path | None = None
    used_by: Path | None = None
    history: Path | None = None
    now_ns: int | None = None


@dataclass(frozen=True, kw_only=True)
class StoredRow:
    """A calibration with its age, and whether it still holds."""

    calibration: StoredCalibration
    sha256: str
    age_days: float | None
    holds: bool

    def as_json(self) -> dict[str, Json]:
        """Return it as JSON holds it."""
        one = self.calibration
        return {
            "kind": one.kind,
            "parts": list(one.parts),
            "file": str(one.file),
            "sha256": self.sha256,
            "age_days": self.age_days,
            "holds": self.holds,
            "made_for": one.made_for.as_json(),
            "numbers": {name: asdict(number) for name, number in one.numbers.items()},
        }


@dataclass(frozen=True, kw_only=True)
class CalibrationsOverview:
    """What a store holds, how its numbers moved, and what it has for a run or rig where that was asked."""

    store: CalibrationStore
    rows: tuple[StoredRow, ...]
    histories: tuple[History, ...]
    choices: tuple[Choice, ...] | None = None

    def as_json(self) -> dict[str, Json]:
        """Return the answer of `rigctl calibrations`."""
        content: dict[str, Json] = {
            "folder": str(self.store.folder),
            "stored": [row.as_json() for row in self.rows],
            "not_read": [{"file": str(one.file), "problem": one.problem} for one in self.store.unread],
            "history": [one.as_json() for one in self.histories],
        }
        return content if self.choices is None else content | choices_json(self.choices, ())


def look_at_calibrations(request: CalibrationsRequest) -> CalibrationsOverview:
    """Return what a store of calibrations holds, once its picture is drawn where that is wanted.

    Raises
    ------
    ConfigError, DataError
        There is no such folder, run or rig file.
    """
    store = read_store(_folder(request.folder))
    now_ns = time.time_ns() if request.now_ns is None else request.now_ns
    now = MadeFor(taken_utc=utc_text(now_ns))
    found = CalibrationsOverview(
        store=store,
        rows=tuple(_row(one, now) for one in store.calibrations),
        histories=tuple(histories_of(store)),
        choices=None if request.used_by is None else _choices(request.used_by, store.folder, now_ns),
    )
    if request.history is not None:
        if not found.histories:
            raise ConfigError(f"--history: {store.folder} holds no noise and no polarizer calibration with a date")
        from rigctl.report.calibration import history_png

        write_whole(request.history, history_png(found.histories))
    return found


def _folder(given: Path | None) -> Path:
    if given is None:
        return Path(STORE_FOLDER)
    return given.parent / STORE_FOLDER if given.is_file() and given.suffix == ".toml" else given


def _row(one: StoredCalibration, now: MadeFor) -> StoredRow:
    age, valid = age_days(one.made_for, now), one.made_for.valid_days
    holds = age is None or valid is None or age <= valid
    return StoredRow(calibration=one, sha256=sha256_of(one.file), age_days=age, holds=holds)


def _choices(used_by: Path, folder: Path, now_ns: int) -> tuple[Choice, ...]:
    if used_by.is_dir():
        return picked_for_run(CalibrationPaths(picks=True, store=folder), used_run(used_by), KINDS).choices
    rig = load_rig(used_by)
    return picked_for_rig(rig, used_by, now_ns=now_ns, store=folder, named=dict.fromkeys(KINDS)).choices
