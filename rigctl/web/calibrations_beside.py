"""The calibrations that lie beside a run, and whether each holds for it."""

import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import JsonValue

from rigctl.calibrations import radiometric_file
from rigctl.calibrations.flat import flat_file
from rigctl.calibrations.noise import noise_file
from rigctl.calibrations.polarizer import polarizer_file
from rigctl.calibrations.registration import registration_file
from rigctl.errors import DataError
from rigctl.files.rig_file import PLACEHOLDER
from rigctl.runs.run_folder import Run
from rigctl.storage.bounded_file import MOST_TEXT_BYTES, read_bounded
from rigctl.web.run_look import CalibrationLook

_MOST_FILES = 200
# A noise calibration does not name its kind.
_OF_NOISE = re.compile(rb'"gain_dn_per_e"\s*:')
_KIND = re.compile(rb'"kind"\s*:\s*"([a-z]{3,20})"')
_HEAD_BYTES = 20_000


@dataclass(frozen=True, kw_only=True)
class _Kind:
    """A kind of calibration: what reads it for a run, and for how long it holds where it does not say."""

    read: Callable[[Path, Run], tuple[object, tuple[str, ...]]]
    valid_days: float


_KINDS: Mapping[str, _Kind] = {
    "noise": _Kind(read=noise_file.read_fitting_noise, valid_days=noise_file.VALID_DAYS),
    "flat": _Kind(read=flat_file.read_fitting_flats, valid_days=flat_file.VALID_DAYS),
    "polarizer": _Kind(read=polarizer_file.read_fitting_polarizer, valid_days=polarizer_file.VALID_DAYS),
    "radiometric": _Kind(read=radiometric_file.read_fitting_radiometric, valid_days=radiometric_file.VALID_DAYS),
    "registration": _Kind(read=registration_file.read_fitting_registration, valid_days=registration_file.VALID_DAYS),
}


class CalibrationsBeside:
    """Remembers what was found of a run, until a file changes.

    Parameters
    ----------
    run : Path
        The run folder: calibrations are sought in the folder that it lies in, and in the one above.
    """

    def __init__(self, run: Path) -> None:
        self._folders = (run.resolve().parent, run.resolve().parent.parent)
        self._known: tuple[object, tuple[CalibrationLook, ...]] = (None, ())

    def of(self, run: Run) -> tuple[CalibrationLook, ...]:
        """Return the calibrations, by kind and name; none until the run has a frame of the scene."""
        if not any(frame.kind == "scene" for frame in run.frames):
            return ()
        files = dict(sorted(_json_files(self._folders)))
        key = tuple(files.items())
        if self._known[0] != key:
            looks = (_look(path, run) for path in files)
            found = sorted((look for look in looks if look is not None), key=lambda look: (look.kind, look.file))
            self._known = (key, (*_of_rig(run), *found))
        return self._known[1]


def _json_files(folders: tuple[Path, ...]) -> Iterator[tuple[Path, int]]:
    """Return the files that may be calibrations, with the time of each."""
    for folder in folders:
        try:
            for path in sorted(folder.glob("*.json"))[:_MOST_FILES]:
                yield path, path.stat().st_mtime_ns
        except OSError:
            continue


def _of_rig(run: Run) -> tuple[CalibrationLook, ...]:
    """Return the axis of the polarizer, which the rig file has, where that is none yet."""
    if not run.session.polarizer.placeholder:
        return ()
    return (CalibrationLook(file="rig.toml", kind="axis of the polarizer", verdict="does not hold", words=PLACEHOLDER),)


def _look(path: Path, run: Run) -> CalibrationLook | None:
    """Return what a file is worth for a run; None where it is no calibration."""
    try:
        kind = _kind_of(path)
    except OSError:
        return None
    if kind is None:
        return None
    made_utc, valid_days = _made(path)
    look = CalibrationLook(
        file=path.name, kind=kind, made_utc=made_utc, valid_days=valid_days or _KINDS[kind].valid_days, verdict="holds"
    )
    try:
        _, doubts = _KINDS[kind].read(path, run)
    except DataError as error:
        return replace(look, verdict="does not hold", words=str(error).replace(str(path), path.name))
    return replace(look, verdict="doubtful", words="; ".join(doubts)) if doubts else look


def _kind_of(path: Path) -> str | None:
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    named = _KIND.search(head)
    if named is not None and named[1].decode("ascii") in _KINDS:
        return named[1].decode("ascii")
    return "noise" if named is None and _OF_NOISE.search(head) is not None else None


def _made(path: Path) -> tuple[str, float | None]:
    """Return when a calibration was made and for how many days it says that it holds, as far as it says so."""
    try:
        content: JsonValue = json.loads(read_bounded(path, MOST_TEXT_BYTES))
    except (OSError, ValueError, RecursionError):
        return "", None
    if not isinstance(content, dict):
        return "", None
    made_for = content.get("made_for")
    made = made_for if isinstance(made_for, dict) else {}
    utc, days = made.get("taken_utc") or content.get("created_utc"), made.get("valid_days")
    is_number = isinstance(days, int | float) and not isinstance(days, bool)
    return str(utc or "")[:40], float(days) if is_number and isinstance(days, int | float) else None
