"""`rigctl calibrate list` and `rigctl calibrate history`: the store of calibrations."""

import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from rigctl.base.numbers import time_option, utc_text
from rigctl.console import Json, note, warn
from rigctl.errors import ConfigError
from rigctl.verbs.options import FilePath, Part, Result, Writes

if TYPE_CHECKING:
    from rigctl.calibrations.kinds import MadeFor
    from rigctl.calibrations.store import CalibrationStore, Choice, History, StoredCalibration


def list_store(
    folder: FilePath | None = None,
    /,
    *,
    used_by: Annotated[FilePath | None, Parameter(name="--for")] = None,
    at: str | None = None,
) -> "StoreResult":
    """List the stored calibrations: for which devices, from when, and how long each is valid.

    The store is the folder `calibrations` next to the rig file, with files of `rigctl calibrate`. If it exists,
    `acquire`, `stokes`, `compare` and `predict` select from it the calibrations that are not given.

    Example: rigctl calibrate list --for runs/2026-05-04

    Parameters
    ----------
    folder : path
        Store, or rig file next to it; default: ./calibrations.
    used_by : path
        Run folder or rig file: show which calibrations are selected for it, and why.
    at : str
        Time for which ages are shown, with a time zone; default: now.
    """
    from rigctl.calibrations.kinds import MadeFor
    from rigctl.calibrations.store import read_store

    store = read_store(_folder(folder))
    now_ns = time_option("--at", at) or time.time_ns()
    now = MadeFor(taken_utc=utc_text(now_ns))
    for unread in store.unread:
        warn(f"{unread.file}: {unread.problem}")
    return StoreResult(
        store=store,
        now=now,
        choices=None if used_by is None else _choices(Path(used_by), store.folder, now_ns),
    )


def history(folder: FilePath | None = None, /, *, out: Annotated[FilePath | None, Writes()] = None) -> "HistoryResult":
    """Show the changes of gain, read noise, dark current and axis from calibration to calibration.

    Example: rigctl calibrate history --out history.png

    Parameters
    ----------
    folder : path
        Store, or rig file next to it; default: ./calibrations.
    out : path
        Picture with control limits to write (PNG).
    """
    from rigctl.calibrations.record import write_whole
    from rigctl.calibrations.store import histories_of, read_store

    store = read_store(_folder(folder))
    found = HistoryResult(folder=store.folder, histories=tuple(histories_of(store)))
    if out is not None:
        if not found.histories:
            raise ConfigError(f"--out: {store.folder} has no noise or polarizer calibration with a date")
        write_whole(Path(out), found.picture())
        note(f"history: {out}", below=True)
    return found


@dataclass(frozen=True, kw_only=True)
class StoreResult(Result):
    """Calibrations of a store, and the choices for a run or rig if one is given."""

    store: "CalibrationStore"
    now: "MadeFor"  #: time for which ages are given
    choices: "tuple[Choice, ...] | None" = None

    def content(self) -> Iterable[Part]:
        """Return how many calibrations there are, a table of them, and the choices."""
        from rigctl.calibrations.kinds import age_days
        from rigctl.report.document import Column, Table

        def age(one: "StoredCalibration") -> str:
            days = age_days(one.made_for, self.now)
            return "" if days is None else f"{days:.0f}"

        columns: tuple[Column[StoredCalibration], ...] = (
            Column(title="kind", text=lambda one: "+".join(one.parts), left=True),
            Column(title="taken", text=lambda one: (one.made_for.taken_utc or "not known")[:10], left=True),
            Column(title="age [d]", text=age),
            Column(
                title="valid [d]",
                text=lambda one: f"{one.made_for.valid_days:g}{'' if _holds(one, self.now) else ' EXPIRED'}",
            ),
            Column(title="camera", text=lambda one: one.made_for.camera_serial or "not stated", left=True),
            Column(title="stage", text=lambda one: one.made_for.stage_serial or "", left=True),
            Column(title="gain [dB]", text=lambda one: _number(one.made_for.gain_db)),
            Column(title="deg C", text=lambda one: _number(one.made_for.temperature_c)),
            Column(title="file", text=lambda one: str(one.file.relative_to(self.store.folder)), left=True),
        )
        expired = sum(not _holds(one, self.now) for one in self.store.calibrations)
        yield f"{len(self.store.calibrations)} calibrations in {self.store.folder}, {expired} of them expired"
        yield Table(columns=columns, rows=self.store.calibrations)
        yield from (one.line for one in self.choices or () if one.selection is not None or one.others)

    def as_json(self) -> dict[str, Json]:
        """Return calibrations, files that cannot be read, history and choices."""
        from rigctl.base.durable import sha256_of
        from rigctl.calibrations.kinds import age_days
        from rigctl.calibrations.store import choices_json, histories_of

        content: dict[str, Json] = {
            "folder": str(self.store.folder),
            "stored": [
                {
                    "kind": one.kind,
                    "parts": list(one.parts),
                    "file": str(one.file),
                    "sha256": sha256_of(one.file),
                    "age_days": age_days(one.made_for, self.now),
                    "holds": _holds(one, self.now),
                    "made_for": one.made_for.as_json(),
                    "numbers": {name: asdict(number) for name, number in one.numbers.items()},
                }
                for one in self.store.calibrations
            ],
            "not_read": [{"file": str(one.file), "problem": one.problem} for one in self.store.unread],
            "history": [one.as_json() for one in histories_of(self.store)],
        }
        return content if self.choices is None else content | choices_json(self.choices, ())


@dataclass(frozen=True, kw_only=True)
class HistoryResult(Result):
    """Histories of numbers in a store."""

    folder: Path
    histories: "tuple[History, ...]"

    def content(self) -> Iterable[Part]:
        """Return a line for each quantity, and the plot."""
        yield from (one.line for one in self.histories)
        if self.histories:
            yield self.picture

    def picture(self) -> bytes:
        """Return the quantities against time with their control limits (PNG)."""
        from rigctl.report.noise import history_png

        return history_png(self.histories)

    def as_json(self) -> dict[str, Json]:
        """Return the values of each quantity."""
        return {"folder": str(self.folder), "history": [one.as_json() for one in self.histories]}


def _folder(given: FilePath | None) -> Path:
    from rigctl.calibrations.store import STORE_FOLDER

    path = Path(STORE_FOLDER if given is None else given)
    return path.parent / STORE_FOLDER if path.is_file() and path.suffix == ".toml" else path


def _holds(one: "StoredCalibration", now: "MadeFor") -> bool:
    from rigctl.calibrations.kinds import age_days

    age, valid = age_days(one.made_for, now), one.made_for.valid_days
    return age is None or valid is None or age <= valid


def _choices(used_by: Path, folder: Path, now_ns: int) -> "tuple[Choice, ...]":
    from rigctl.calibrations.kinds import KINDS
    from rigctl.calibrations.store import selected_for_rig
    from rigctl.files.rig_file import load_rig
    from rigctl.measure.frames import CalibrationPaths, selected_for_run
    from rigctl.runs.check import run_to_measure

    if used_by.is_dir():
        paths = CalibrationPaths(uses_store=True, store=folder)
        return selected_for_run(paths, run_to_measure(used_by), tuple(KINDS)).choices
    rig = load_rig(used_by)
    return selected_for_rig(rig, used_by, now_ns=now_ns, store=folder, named=dict.fromkeys(KINDS)).choices


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"
