"""A folder of calibrations, beside the rig file: what it holds, of which devices, and from when."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from rigctl.calibrations.checked_values import Measured
from rigctl.calibrations.made_for import MadeFor
from rigctl.errors import ConfigError, DataError
from rigctl.storage.bounded_file import MOST_RECORD_BYTES, read_bounded

CalibrationKind = Literal["noise", "polarizer", "flat", "radiometric", "registration"]
KINDS: tuple[CalibrationKind, ...] = get_args(CalibrationKind)
STORE_FOLDER = "calibrations"
_DEPTH = 2
_MOST_FILES = 5000
_OF_ANOTHER_KIND = "is no calibration of frames"
_WATCHED = ("gain_dn_per_e", "read_noise_e", "dark_current_e_per_s")
Numbers = Mapping[str, Measured[float]]


@dataclass(frozen=True, kw_only=True)
class StoredCalibration:
    """A calibration of a store.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    file : Path
        Where it stands.
    made_for : MadeFor
        Devices, settings, time, and for how long it holds.
    numbers : mapping
        What its history is drawn of: gain, read noise, dark current, offset of the axis [deg].
    parts : tuple of str
        What it holds: a polarizer calibration has the axis, and the throughput unless fixed references were used.
    """

    kind: CalibrationKind
    file: Path
    made_for: MadeFor
    numbers: Numbers
    parts: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class UnreadFile:
    """A file of a store that is no calibration that this program reads, and why; of another kind, or damaged."""

    file: Path
    problem: str
    is_damaged: bool = True

    @property
    def line(self) -> str:
        """It in a line that a person reads."""
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

    def of(self, kind: CalibrationKind) -> tuple[StoredCalibration, ...]:
        """Return the calibrations of a kind, the oldest first."""
        return tuple(one for one in self.calibrations if one.kind == kind)


def store_beside(file: Path) -> Path | None:
    """Return the store that stands beside a file; None where there is none."""
    folder = file.absolute().parent / STORE_FOLDER
    return folder if folder.is_dir() else None


def read_store(folder: Path) -> CalibrationStore:
    """Return what a store holds, its subfolders included.

    Raises
    ------
    ConfigError
        There is no such folder, or it holds thousands of files.
    """
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
        elif path.suffix in _READERS and path.is_file():
            yield path


def read_stored(file: Path) -> StoredCalibration:
    """Return a calibration of any kind, without what only its own reader needs.

    Raises
    ------
    DataError
        It cannot be read, or is none.
    """
    if file.suffix not in _READERS:
        raise DataError(f"{file}: is no calibration; they are .json files, flat fields .npz")
    return _READERS[file.suffix](file)


def _read_json(file: Path) -> StoredCalibration:
    # Readers of every kind take a tenth of a second to import; most rigs have no store.
    from rigctl.calibrations.noise.noise_file import read_noise_file
    from rigctl.calibrations.polarizer.polarizer_file import read_polarizer_file
    from rigctl.calibrations.radiometric_file import read_radiometric_file
    from rigctl.calibrations.registration.registration_file import read_registration_file

    kind = _kind_of(file)
    if kind == "noise":
        noise = read_noise_file(file)
        known = {name: noise.known[name] for name in _WATCHED if name in noise.known}
        numbers = {name: Measured(value=one.value, std_error=one.std_error) for name, one in known.items()}
        return StoredCalibration(kind=kind, file=file, made_for=noise.origin, numbers=numbers, parts=("noise",))
    if kind == "polarizer":
        polarizer = read_polarizer_file(file)
        return StoredCalibration(
            kind=kind,
            file=file,
            made_for=polarizer.origin,
            numbers={"offset_deg": polarizer.offset_deg},
            parts=("axis",) if polarizer.channels is None else ("axis", "throughput"),
        )
    if kind == "radiometric":
        origin = read_radiometric_file(file).origin
        return StoredCalibration(kind=kind, file=file, made_for=origin, numbers={}, parts=("radiometric",))
    origin = read_registration_file(file).origin
    return StoredCalibration(kind="registration", file=file, made_for=origin, numbers={}, parts=("registration",))


def _read_flats(file: Path) -> StoredCalibration:
    from rigctl.calibrations.flat.flat_file import read_flat_facts

    return StoredCalibration(
        kind="flat", file=file, made_for=read_flat_facts(file).origin, numbers={}, parts=("flats",)
    )


_READERS: dict[str, Callable[[Path], StoredCalibration]] = {".json": _read_json, ".npz": _read_flats}


def _kind_of(file: Path) -> CalibrationKind:
    """Return which kind a JSON file is; noise and polarizer calibrations say it by what they hold.

    Raises
    ------
    DataError
        It is none.
    """
    try:
        content = json.loads(read_bounded(file, MOST_RECORD_BYTES))
    except OSError as error:
        raise DataError(f"{file}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise DataError(f"{file}: is no JSON file") from error
    found = content if isinstance(content, dict) else {}
    kind = found.get("kind")
    if kind is None:
        kind = "noise" if "gain_dn_per_e" in found else "polarizer" if {"sense", "offset_deg"} <= found.keys() else None
    for known in KINDS:
        if kind == known:
            return known
    raise DataError(f"{file}: {_OF_ANOTHER_KIND}")
