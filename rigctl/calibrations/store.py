"""The store of calibrations: the folder `calibrations` beside a rig file.

`read_store` lists its files with devices and times. `choose` selects the calibration of a kind that fits frames, with
the reason, and the reasons against the others; `selected_for_rig` does so for a rig before any device is opened, and
`store_doubts` names what is missing or expires soon. `histories_of` follows gain, read noise, dark current and axis of
each device through time, with control limits.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibration.estimate import control_chart
from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded, sha256_of
from rigctl.base.numbers import utc_moment, utc_text, wrapped
from rigctl.calibrations.kinds import (
    KINDS,
    CalibrationKind,
    MadeFor,
    Measured,
    age_days,
    is_beyond_exposures,
    is_too_old,
    kind_of,
    made_for_rig,
    misfits,
    record_of,
    temperature_step_k,
)
from rigctl.console import Json, note, warn
from rigctl.errors import ConfigError, DataError

if TYPE_CHECKING:
    from rigctl.files.rig_file import RigFile

STORE_FOLDER = "calibrations"
_SUFFIXES = (".json", ".npz")
_DEPTH = 2
_MOST_FILES = 5000
_OF_ANOTHER_KIND = "is not a calibration of frames"
Numbers = Mapping[str, Measured[float]]


@dataclass(frozen=True, kw_only=True)
class StoredCalibration:
    """A calibration of a store."""

    kind: CalibrationKind  #: One of `KINDS`.
    file: Path
    made_for: MadeFor  #: Devices, settings, time, and validity.
    numbers: Numbers  #: numbers with a history: gain, read noise, dark current, offset of the axis [deg]
    #: contents: a polarizer calibration has the axis, and the throughput unless fixed references were used
    parts: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class UnreadFile:
    """A file of a store that is damaged, or not a readable calibration."""

    file: Path
    problem: str
    is_damaged: bool = True

    @property
    def line(self) -> str:
        """The problem in a line for people."""
        return f"calibration not read: {self.file}: {self.problem.partition(chr(10))[0]}"


@dataclass(frozen=True, kw_only=True)
class CalibrationStore:
    """Content of a store, the oldest calibration first."""

    folder: Path
    calibrations: tuple[StoredCalibration, ...]
    unread: tuple[UnreadFile, ...] = ()

    @property
    def damaged(self) -> tuple[UnreadFile, ...]:
        """Files that may be calibrations, and cannot be read."""
        return tuple(one for one in self.unread if one.is_damaged)


def store_beside(file: Path) -> Path | None:
    """Return the store in the folder of a file; None if it has none."""
    folder = file.absolute().parent / STORE_FOLDER
    return folder if folder.is_dir() else None


def read_store(folder: Path) -> CalibrationStore:
    """Return the content of a store, subfolders included."""
    if not folder.is_dir():
        raise ConfigError(f"{folder}: there is no such folder; a store of calibrations is a folder of their files")
    files = sorted(_files(folder))
    if len(files) > _MOST_FILES:
        raise ConfigError(f"{folder}: holds {len(files)} files; a store of calibrations holds {_MOST_FILES} at most")
    found: list[StoredCalibration] = []
    unread: list[UnreadFile] = []
    for file in files:
        try:
            found.append(read_stored(file))
        except DataError as error:
            problem = str(error).removeprefix(f"{file}: ")
            unread.append(UnreadFile(file=file, problem=problem, is_damaged=problem != _OF_ANOTHER_KIND))
    found.sort(key=lambda one: (one.made_for.taken_utc or "", str(one.file)))
    return CalibrationStore(folder=folder, calibrations=tuple(found), unread=tuple(unread))


def _files(folder: Path, depth: int = _DEPTH) -> Iterator[Path]:
    for path in folder.iterdir():
        if path.name.startswith("."):
            continue
        if path.is_dir() and depth:
            yield from _files(path, depth - 1)
        elif path.suffix in _SUFFIXES and path.is_file():
            yield path


def read_stored(file: Path) -> StoredCalibration:
    """Return the facts of a calibration of any kind that a store needs."""
    kind = kind_of(file)
    if kind is None:
        try:
            json.loads(read_bounded(file, MOST_TEXT_BYTES))
        except OSError as error:
            raise DataError(f"{file}: {error.strerror}") from error
        except (ValueError, RecursionError) as error:
            raise DataError(f"{file}: not valid JSON: {error}") from error
        raise DataError(f"{file}: {_OF_ANOTHER_KIND}")
    record = record_of(kind).read(file)
    return StoredCalibration(kind=kind, file=file, made_for=record.origin, numbers=record.history, parts=record.parts)


# An axis is the same after half a turn.
_TURN_DEG = {"offset_deg": 180.0}
_SECONDS_A_YEAR = 365.25 * 86400.0


@dataclass(frozen=True, kw_only=True)
class HistoryPoint:
    """A number of one calibration."""

    utc: str  #: start of its last frame
    value: float  #: in the unit that the number's name ends in; an axis is followed over half turns
    std_error: float
    #: control limits: they contain 997 of 1000 numbers if nothing changed, by the stated error of the number and #:
    #: that of the mean of this device
    limits: tuple[float, float]
    is_inside: bool
    file: Path  #: the calibration


@dataclass(frozen=True, kw_only=True)
class History:
    """A number of one device through time."""

    quantity: str  #: Its name, and of which camera or stage.
    device: str
    points: tuple[HistoryPoint, ...]  #: The oldest first.
    #: Slope of a straight line through them and its standard error, widened by their scatter; None of fewer than three.
    drift_per_year: float | None
    drift_error: float | None

    @property
    def line(self) -> str:
        """The history in a line for people."""
        first, last = self.points[0], self.points[-1]
        if len(self.points) == 1:
            return f"{self.quantity} of {self.device}: {first.value:.6g} +- {first.std_error:.2g}, calibrated once"
        text = f"{self.quantity} of {self.device}: {first.value:.6g} to {last.value:.6g} in {len(self.points)}"
        if self.drift_per_year is not None:
            text += f", {self.drift_per_year:+.3g} +- {self.drift_error:.2g} a year"
        outside = sum(not point.is_inside for point in self.points)
        return text + (f"; {outside} outside the control limits: IT CHANGES" if outside else "; within control limits")

    def as_json(self) -> dict[str, Json]:
        """Return the history as JSON."""
        return {
            "quantity": self.quantity,
            "device": self.device,
            "drift_per_year": self.drift_per_year,
            "drift_error": self.drift_error,
            "is_inside": all(point.is_inside for point in self.points),
            "points": [asdict(point) | {"file": str(point.file)} for point in self.points],
        }


def histories_of(store: CalibrationStore) -> Iterator[History]:
    """Return the history of each device's numbers: gain, read noise, dark current of a camera, axis of a stage."""
    series: dict[tuple[str, str], list[StoredCalibration]] = {}
    for one in store.calibrations:
        if one.made_for.taken_utc is not None:
            for quantity in one.numbers:
                series.setdefault((quantity, _device(quantity, one.made_for)), []).append(one)
    for (quantity, device), calibrations in sorted(series.items(), key=lambda item: item[0][0]):
        yield _history(quantity, device, calibrations)


def _device(quantity: str, made: MadeFor) -> str:
    camera = f"camera {made.camera_serial}" if made.camera_serial else "a camera"
    if quantity in _TURN_DEG:
        return f"stage {made.stage_serial}, {camera}" if made.stage_serial else f"a stage, {camera}"
    return f"{camera} at {made.gain_db:g} dB" if made.gain_db is not None else camera


def _history(quantity: str, device: str, calibrations: Sequence[StoredCalibration]) -> History:
    values = np.array([one.numbers[quantity].value for one in calibrations])
    turn_deg = _TURN_DEG.get(quantity)
    if turn_deg is not None:
        values = values[0] + np.cumsum(np.append(0.0, wrapped(np.diff(values), turn=turn_deg)))
    errors = np.array([one.numbers[quantity].std_error for one in calibrations])
    seconds = np.array([utc_moment(one.made_for.taken_utc or "").timestamp() for one in calibrations])
    chart = control_chart(seconds / _SECONDS_A_YEAR, values, errors)
    points = tuple(
        HistoryPoint(
            utc=one.made_for.taken_utc or "",
            value=float(values[place]),
            std_error=float(errors[place]),
            limits=(float(chart.lower[place]), float(chart.upper[place])),
            is_inside=bool(chart.is_inside[place]),
            file=one.file,
        )
        for place, one in enumerate(calibrations)
    )
    drift, error = chart.drift_per_year, chart.drift_error
    return History(quantity=quantity, device=device, points=points, drift_per_year=drift, drift_error=error)


_SHOWN = 5


@dataclass(frozen=True, kw_only=True)
class Selection:
    """A calibration that was selected."""

    file: Path
    sha256: str  #: of its content
    why: str  #: reason for this one
    age_days: float | None = None  #: days from it to the frames, below 0 where it came after; None if not known

    def as_json(self) -> dict[str, Json]:
        """Return the selection for results."""
        age = None if self.age_days is None else round(self.age_days, 3)
        return {"file": str(self.file), "sha256": self.sha256, "why": self.why, "age_days": age}


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The calibration of a kind that fits frames best."""

    kind: CalibrationKind
    selection: Selection | None  #: None if none fits
    others: tuple[tuple[Path, str], ...] = ()  #: files of the same kind that were not selected, and why

    @property
    def line(self) -> str:
        """The choice in a line for people."""
        if self.selection is not None:
            return f"{self.kind} calibration: {self.selection.file}: {self.selection.why}"
        reasons = "; ".join(f"{file.name}: {reason}" for file, reason in self.others[-_SHOWN:])
        return f"no {self.kind} calibration: of {len(self.others)} in the store none fits: {reasons}"


def choices_json(choices: Sequence[Choice], damaged: Sequence[UnreadFile]) -> dict[str, Json]:
    """Return the choices from a store for the JSON of results."""
    not_read: list[Json] = [{"file": str(one.file), "problem": one.problem} for one in damaged]
    return {
        "calibrations": {one.kind: one.selection.as_json() for one in choices if one.selection is not None},
        "calibrations_not_picked": [
            {"kind": choice.kind, "file": str(file), "reason": reason}
            for choice in choices
            for file, reason in choice.others
        ],
        **({"calibrations_not_read": not_read} if not_read else {}),
    }


def choose(
    store: CalibrationStore,
    kind: CalibrationKind,
    used: MadeFor,
    *,
    require_usable: Callable[[Path], object],
) -> Choice:
    """Return the calibration of a kind that fits frames best: the newest that was made before them.

    Other devices or settings, and calibrations that are too old, are refused. Preferred, in this order, are those at
    the temperature and exposures of the frames, with stated devices, made before the frames, and nearest in time.
    """
    reasons = [(one, _unfit(one, used)) for one in store.calibrations if one.kind == kind]
    unfit = [(one.file, reason) for one, reason in reasons if reason is not None]
    # With the same rank the newest comes first.
    fitting = [one for one, reason in reversed(reasons) if reason is None]
    ranked = sorted(fitting, key=lambda one: _rank(one, used))
    for place, one in enumerate(ranked):
        try:
            require_usable(one.file)
        except DataError as error:
            unfit.append((one.file, str(error).removeprefix(f"{one.file}: ").partition("\n")[0]))
            continue
        rest = ranked[place + 1 :]
        why = _why(one, used, fitting=1 + len(rest), refused=[reason for _, reason in unfit], store=store)
        same = [other.file.name for other in rest if _rank(other, used) == _rank(one, used)]
        why += f"; taken at the same time: {', '.join(same)}; the last by name is used" if same else ""
        selected = Selection(file=one.file, sha256=sha256_of(one.file), why=why, age_days=age_days(one.made_for, used))
        farther = [(other.file, _farther(other, used)) for other in rest]
        return Choice(kind=kind, selection=selected, others=(*unfit, *farther))
    return Choice(kind=kind, selection=None, others=tuple(unfit))


def _unfit(one: StoredCalibration, used: MadeFor) -> str | None:
    wrong = misfits(one.kind, one.made_for, used)
    if wrong:
        return "; ".join(wrong)
    if is_too_old(one.made_for, used):
        days = age_days(one.made_for, used) or 0.0
        return f"too far in time: {abs(days):.0f} days from the frames, valid for {one.made_for.valid_days:g}"
    return None


def _rank(one: StoredCalibration, used: MadeFor) -> tuple[bool, bool, int, bool, float]:
    made = one.made_for
    days = age_days(made, used)
    pairs = [(made.camera_serial, used.camera_serial)]
    pairs += [(made.stage_serial, used.stage_serial)] if KINDS[one.kind].of_stage else []
    silent = sum(calibrated is None and now is not None for calibrated, now in pairs)
    is_of_noise = one.kind == "noise"
    return (
        is_of_noise and temperature_step_k(made, used) is not None,
        is_of_noise and is_beyond_exposures(made, used),
        silent,
        days is None or days < 0.0,
        0.0 if days is None else abs(days),
    )


def _why(
    one: StoredCalibration, used: MadeFor, *, fitting: int, refused: Sequence[str], store: CalibrationStore
) -> str:
    days, made = age_days(one.made_for, used), one.made_for
    taken = "at an unknown time" if made.taken_utc is None else made.taken_utc[:10]
    apart = "" if days is None else f", {abs(days):.1f} days {'before' if days >= 0.0 else 'AFTER'} the frames"
    which = (
        "the only one that fits"
        if fitting == 1
        else f"the newest before the frames, of {fitting} of these devices and settings"
    )
    if days is None and fitting > 1:
        which = f"the newest of {fitting}, as the frames do not say when they were taken"
    if days is not None and days < 0.0:
        which = "the nearest that fits, as all came after the frames"
    text = f"{which}: taken {taken}{apart}, valid for {made.valid_days:g} days{_identity(one, used)}"
    if refused:
        counts = Counter(reason.partition(":")[0] for reason in refused)
        text += "; refused: " + ", ".join(f"{count} ({reason})" for reason, count in counts.items())
    cameras = {other.made_for.camera_serial for other in store.calibrations if other.kind == one.kind} - {None}
    if used.camera_serial is None and len(cameras) > 1:
        text += f"; the camera to be used is not stated, and the store has {len(cameras)}"
    return text


def _identity(one: StoredCalibration, used: MadeFor) -> str:
    made, kind = one.made_for, KINDS[one.kind]
    said = [f"camera {made.camera_serial}" if made.camera_serial else "its camera is not stated"]
    said += [f"stage {made.stage_serial}"] if kind.of_stage and made.stage_serial else []
    said += [f"gain {made.gain_db:g} dB"] if kind.of_gain and made.gain_db is not None else []
    said += [f"{made.bit_depth} bits"] if kind.of_gain and made.bit_depth is not None else []
    step_k = temperature_step_k(made, used)
    said += [] if step_k is None or one.kind != "noise" else [f"but {abs(step_k):.1f} K away in temperature"]
    return f"; {', '.join(said)}"


def _farther(one: StoredCalibration, used: MadeFor) -> str:
    days = age_days(one.made_for, used)
    when = "" if days is None else f"{abs(days):.1f} days {'before' if days >= 0.0 else 'after'} the frames: "
    return f"{when}fits, and another is nearer"


NONE = Path("none")
# Needed for a comparison; the others cause a warning where the store has had them once.
_NEEDED: tuple[CalibrationKind, ...] = ("noise", "polarizer")
_SOON_DAYS = 14.0
# Clocks of two computers differ by less.
_CLOCK_DAYS = 0.5


@dataclass(frozen=True, kw_only=True)
class RigSelection:
    """Choices from a store for a rig or a run."""

    store: Path | None = None  #: None where there is no store, and nothing is selected
    choices: tuple[Choice, ...] = ()  #: one for each kind
    damaged: tuple[UnreadFile, ...] = ()  #: files that may be calibrations but cannot be read

    @property
    def files(self) -> dict[CalibrationKind, Path]:
        """Files that were selected, by kind."""
        return {one.kind: one.selection.file for one in self.choices if one.selection is not None}

    @property
    def lines(self) -> tuple[str, ...]:
        """Each choice of which the store has any calibration, and each damaged file, in a line."""
        lines = (choice.line for choice in self.choices if choice.selection is not None or choice.others)
        return (*lines, *(one.line for one in self.damaged))

    def report(self) -> None:
        """Report what was selected; warn where there are calibrations of a kind and none fits."""
        for choice in self.choices:
            if choice.selection is not None:
                note(choice.line)
            elif choice.others:
                warn(choice.line)
        for file in self.damaged:
            note(file.line)

    @property
    def used(self) -> dict[str, Json]:
        """Calibrations that are used, by kind: file, sha256, why, age_days; empty where there is no store."""
        choices = () if self.store is None else self.choices
        return {one.kind: one.selection.as_json() for one in choices if one.selection is not None}

    def __str__(self) -> str:
        """Return the files that are used as the end of a sentence."""
        files = [f"{kind} {file.name}" for kind, file in self.files.items()]
        return f", with {', '.join(files)}" if files else ""

    def as_json(self) -> dict[str, Json]:
        """Return the choices for the JSON of results; empty without a store."""
        return {} if self.store is None else choices_json(self.choices, self.damaged)


def selected_for_rig(
    rig: "RigFile",
    rig_path: Path,
    *,
    now_ns: int,
    store: Path | None = None,
    named: Mapping[CalibrationKind, Path | None],
) -> RigSelection:
    """Return the calibrations of a store that fit a rig."""
    found = _store(rig_path, store)
    if found is None:
        return RigSelection()
    used = made_for_rig(rig, now_utc=utc_text(now_ns))
    wanted = [kind for kind, path in named.items() if path is None]
    choices = (choose(found, kind, used, require_usable=_usable(kind, rig, used)) for kind in wanted)
    return RigSelection(store=found.folder, choices=tuple(choices), damaged=found.damaged)


def store_doubts(rig: "RigFile", rig_path: Path, *, now_ns: int) -> tuple[str, ...]:
    """Return as text the calibrations that are missing from the store of a rig file or expire soon."""
    store = _store(rig_path, None)
    if store is None:
        return ()
    used = made_for_rig(rig, now_utc=utc_text(now_ns))
    doubts = (doubt for kind in KINDS for doubt in _doubts(store, kind, rig, used))
    return (*doubts, *(one.line for one in store.damaged))


def _store(rig_path: Path, store: Path | None) -> CalibrationStore | None:
    if store is not None and store != NONE and not store.is_dir():
        raise ConfigError(f"--calibrations: {store}: there is no such folder")
    folder = store_beside(rig_path) if store is None else store
    return None if folder is None or folder == NONE else read_store(folder)


def _doubts(store: CalibrationStore, kind: CalibrationKind, rig: "RigFile", used: MadeFor) -> Iterable[str]:
    there = [one for one in store.calibrations if one.kind == kind]
    if not there:
        if kind in _NEEDED:
            yield f"{store.folder} has no {kind} calibration"
        return
    choice = choose(store, kind, used, require_usable=_usable(kind, rig, used))
    if choice.selection is None:
        yield choice.line
        return
    made = next(one.made_for for one in there if one.file == choice.selection.file)
    days = age_days(made, used)
    if days is not None and days < -_CLOCK_DAYS:
        yield f"{kind} calibration: {choice.selection.file} has a date {-days:.0f} days ahead: check both clocks"
    left = None if days is None or made.valid_days is None else made.valid_days - days
    if left is not None and left < _SOON_DAYS:
        yield f"{kind} calibration: {choice.selection.file} expires in {left:.0f} days: make a new one"


def _usable(kind: CalibrationKind, rig: "RigFile", used: MadeFor) -> Callable[[Path], object]:
    """Return the function that checks a file for a rig."""
    if kind == "polarizer":
        from rigctl.calibrations.polarizer import PolarizerParameters, require_polarizer_fits

        return lambda path: require_polarizer_fits(PolarizerParameters.read(path), used, polarizer=rig.polarizer)
    return lambda path: record_of(kind).read(path).doubts(used)


def selected_for_scene(scene: Path | None, used: MadeFor, store: Path | None, named: Path | None) -> RigSelection:
    """Return the noise calibration that a prediction takes where none is named."""
    found = None if named is not None or (store is None and scene is None) else _store(scene or Path(), store)
    if found is None:
        return RigSelection()
    choice = choose(found, "noise", used, require_usable=lambda path: record_of("noise").read(path).doubts(used))
    return RigSelection(store=found.folder, choices=(choice,), damaged=found.damaged)
