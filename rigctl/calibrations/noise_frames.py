"""The descriptor file of an EMVA 1288 data set: which image was taken at which exposure and light.

Flags of a run by its records: exposures in a wrong unit, a camera that warms up.

Dark and flat frames for a noise calibration, out of a run folder or an EMVA 1288 data set.

Dark and flat frames out of a folder of images: kind and exposure from names and headers.

A table of dark and flat frames: a CSV file that says what each image is.
"""

import csv
import hashlib
import io
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from math import isfinite
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from calibration.results import Flag, refused
from calibration.sensor.curves import StatedExposures
from calibration.sensor.levels import LevelKind
from drivers.cameras.raw_files import RAW_SUFFIXES
from model.processing.mosaic import mosaic
from rigctl.base.durable import MOST_FRAME_BYTES, MOST_TEXT_BYTES, read_bounded, sha256_of
from rigctl.base.numbers import range_problem
from rigctl.calibrations.made_for import MadeFor, made_for
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import SECONDS_PER_UNIT, ExposureUnit
from rigctl.images import HeaderValue, ImageReading, read_image
from rigctl.runs.check import used_run
from rigctl.runs.folder import MANIFEST_FILE, Run
from rigctl.runs.records import FrameRecord

_S_PER_NS = 1e-9
_COMMENT = "#"


@dataclass(frozen=True, kw_only=True)
class EmvaGroup:
    """Images of one exposure and one light."""

    kind: Literal["dark", "flat"]  #: A ``d`` or a ``b`` line.
    exposure_s: float  #: Exposure time [s].
    photons: float | None  #: Mean photons a pixel, as stated; None for dark images.
    files: tuple[Path, ...]  #: In the order of the descriptor.


@dataclass(frozen=True, kw_only=True)
class EmvaDescriptor:
    """An EMVA 1288 data set."""

    bit_depth: int  #: Bits per sample.
    width: int  #: Pixels.
    height: int
    groups: tuple[EmvaGroup, ...]  #: In the order of the descriptor.


def read_emva_descriptor(path: Path) -> EmvaDescriptor:
    """Return what an EMVA 1288 descriptor says, once all of it has been found right.

    EMVA1288/emva1288 on GitHub, data set format.
    """
    try:
        text = read_bounded(path, MOST_TEXT_BYTES).decode("utf-8", errors="replace")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    reader = _Reader(folder=path.parent)
    for number, line in enumerate(text.splitlines(), start=1):
        reader.read(number, line.strip())
    return reader.finish(path)


def _lies_within(file: Path, folder: Path) -> bool:
    try:
        return file.resolve().is_relative_to(folder)
    except (OSError, RuntimeError, ValueError):  # links in a circle, a name that is too long or no name at all
        return False


@dataclass
class _OpenGroup:
    line: int
    kind: Literal["dark", "flat"]
    exposure_s: float
    photons: float | None
    files: list[Path] = field(default_factory=list)


class _Reader:
    """Takes the lines one by one and keeps every problem."""

    def __init__(self, *, folder: Path) -> None:
        self._folder, self._resolved_folder = folder, folder.resolve()
        self._problems: list[str] = []
        self._size: tuple[int, int, int] | None = None
        self._groups: list[_OpenGroup] = []
        self._first_use: dict[Path, int] = {}

    def read(self, number: int, line: str) -> None:
        if not line or line.startswith(_COMMENT):
            return
        tag, _, rest = line.partition(" ")
        readers = {"v": self._version, "n": self._image_size, "b": self._bright, "d": self._dark, "i": self._image}
        if tag not in readers:
            self._problem(number, f"{line!r} begins with {tag!r}; allowed are {', '.join(readers)} and {_COMMENT}")
            return
        readers[tag](number, rest.strip())

    def finish(self, path: Path) -> EmvaDescriptor:
        if self._size is None and not any(": n " in problem for problem in self._problems):
            self._problems.append("there is no line `n BITS WIDTH HEIGHT`")
        self._problems += [f"line {group.line}: no image follows" for group in self._groups if not group.files]
        self._problems += [
            f"there is no {what}"
            for what, kind in (("bright group (line `b NANOSECONDS PHOTONS`)", "flat"), ("dark group (`d`)", "dark"))
            if not any(group.kind == kind for group in self._groups)
        ]
        if self._problems or self._size is None:
            count = "1 problem" if len(self._problems) == 1 else f"{len(self._problems)} problems"
            raise ConfigError("\n  ".join([f"{path}: {count}", *self._problems]))
        bit_depth, width, height = self._size
        groups = tuple(
            EmvaGroup(kind=g.kind, exposure_s=g.exposure_s, photons=g.photons, files=tuple(g.files))
            for g in self._groups
        )
        return EmvaDescriptor(bit_depth=bit_depth, width=width, height=height, groups=groups)

    def _problem(self, number: int, text: str) -> None:
        self._problems.append(f"line {number}: {text}")

    def _numbers(self, number: int, text: str, *, names: tuple[str, ...]) -> list[float] | None:
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = []
        if len(values) != len(names) or not all(value >= 0.0 and range_problem(value) is None for value in values):
            self._problem(number, f"{text!r} has to be {len(names)} numbers, none below 0: {', '.join(names)}")
            return None
        return values

    def _version(self, number: int, text: str) -> None:
        self._numbers(number, text, names=("version",))

    def _image_size(self, number: int, text: str) -> None:
        values = self._numbers(number, text, names=("n bits", "width", "height"))
        if values is None:
            return
        if self._size is not None:
            self._problem(number, "n stands a second time")
        if not 1 <= values[0] <= 16 or min(values[1:]) < 1 or any(value % 1 for value in values):
            self._problem(
                number, f"n {text} is not 1 to 16 bits, and width and height of at least 1, all whole numbers"
            )
            return
        self._size = (int(values[0]), int(values[1]), int(values[2]))

    def _bright(self, number: int, text: str) -> None:
        values = self._numbers(number, text, names=("exposure in nanoseconds", "photons per pixel"))
        exposure_ns, photons = values or (0.0, 0.0)
        self._groups.append(_OpenGroup(line=number, kind="flat", exposure_s=exposure_ns * _S_PER_NS, photons=photons))

    def _dark(self, number: int, text: str) -> None:
        values = self._numbers(number, text, names=("exposure in nanoseconds",))
        exposure_s = values[0] * _S_PER_NS if values else 0.0
        self._groups.append(_OpenGroup(line=number, kind="dark", exposure_s=exposure_s, photons=None))

    def _image(self, number: int, text: str) -> None:
        if not self._groups:
            self._problem(number, f"image {text!r} stands before any b or d line")
            return
        file = self._folder / PurePosixPath(text.replace("\\", "/"))
        if not _lies_within(file, self._resolved_folder):
            self._problem(number, f"image {text!r} lies outside of the descriptor's folder; a data set has its own")
            return
        if file in self._first_use:
            self._problem(number, f"image {text!r} is listed a second time (first in line {self._first_use[file]})")
        elif not file.is_file():
            self._problem(number, f"image {text!r}: there is no such file ({file})")
        self._first_use.setdefault(file, number)
        self._groups[-1].files.append(file)


_NS_PER_S = 1e9
# A camera may read one frame out while it exposes the next, but exposes only one.
_LEAST_SPACING = 0.5
_DRIFT_C = 3.0


def record_flags(records: Sequence[FrameRecord]) -> tuple[Flag, ...]:
    """Return what is odd in how frames were taken."""
    found = (_too_close(records), _temperature_drift(records))
    return tuple(flag for flag in found if flag is not None)


def _too_close(records: Sequence[FrameRecord]) -> Flag | None:
    for before, after in pairwise(records):
        if before.start_monotonic_ns is None or after.start_monotonic_ns is None or not before.exposure_s:
            continue
        spacing_s = (after.start_monotonic_ns - before.start_monotonic_ns) / _NS_PER_S
        if 0.0 < spacing_s < _LEAST_SPACING * before.exposure_s:
            return Flag(
                name="wrong_time_unit",
                message=f"frame {before.sequence} was exposed for {before.exposure_s:g} s by its record, but the next "
                f"one began {spacing_s:.3g} s later: exposures are stated in another unit than seconds (ms?), "
                f"and dark current would be as much too small: correct the exposures",
                refuses=True,
            )
    return None


def _temperature_drift(records: Sequence[FrameRecord]) -> Flag | None:
    temperatures = [one.camera_temperature_c for one in records if one.camera_temperature_c is not None]
    if not temperatures or max(temperatures) - min(temperatures) < _DRIFT_C:
        return None
    return Flag(
        name="temperature_drift",
        message=f"the camera was {min(temperatures):.1f} to {max(temperatures):.1f} C warm (at most {_DRIFT_C:g} C of "
        f"drift is expected): dark current doubles every 6 to 8 C, and darks may not fit their flats: let it warm up",
    )


Shot = tuple[FrameRecord, ...]
Loader = Callable[[], NDArray[np.uint16]]


@dataclass(frozen=True, kw_only=True)
class FrameGroup:
    """Frames that differ by noise only."""

    kind: LevelKind  #: Without light, or with even light.
    exposure_s: float | None  #: Exposure time [s].
    loaders: tuple[Loader, ...]  #: Each reads one frame, in the order in which they were taken.
    photons: float | None = None  #: Mean photons a pixel, where somebody measured them.


@dataclass(frozen=True, kw_only=True)
class CameraSetting:
    """A camera and its settings; None where one is not known."""

    model: str | None
    serial: str | None
    gain_db: float | None
    bit_depth: int


@dataclass(frozen=True, kw_only=True)
class FrameSource:
    """Origin of frames."""

    #: A run folder, an EMVA 1288 data set, a folder of images, or a table of them.
    kind: Literal["run", "emva", "folder", "table"]
    path: str  #: Folder, descriptor or table.
    sha256: str  #: Of the run's manifest, of the descriptor or table, or of the names of the images.
    frames_sha256: str  #: Over the SHA-256 of every frame's file, in the order of use.


@dataclass(frozen=True, kw_only=True)
class FrameSet:
    """All frames of a calibration, where their exposures are stated, and what was odd about how they were taken."""

    groups: tuple[FrameGroup, ...]
    camera: CameraSetting
    made_for: MadeFor
    source: FrameSource
    flags: tuple[Flag, ...] = ()
    stated: StatedExposures = field(default_factory=StatedExposures)


def run_frames(path: Path, *, ignore_exclusions: bool = False) -> FrameSet:
    """Return the dark and flat frames of a run, by kind, exposure and polarizer angle."""
    run = used_run(path, ignore_exclusions=ignore_exclusions)
    _refuse_interpolated(run)
    groups: dict[tuple[LevelKind, float | None, float | None], list[Shot]] = defaultdict(list)
    for shot in _shots(run.frames):
        if shot[0].kind != "scene":
            groups[shot[0].kind, _alike(shot[0].exposure_s), _light(shot[0])].append(shot)
    records = [record for group in groups.values() for shot in group for record in shot]
    if not records:
        raise DataError(f"{path}: has no dark and no flat frames; `rigctl acquire` and `rigctl import` make them")
    return FrameSet(
        groups=tuple(
            FrameGroup(kind=kind, exposure_s=exposure_s, loaders=tuple(partial(_picture, run, shot) for shot in group))
            for (kind, exposure_s, _), group in groups.items()
        ),
        camera=_common_setting(path, records),
        made_for=made_for(run, records),
        source=FrameSource(
            kind="run",
            path=str(path),
            sha256=sha256_of(path / MANIFEST_FILE),
            frames_sha256=_digest(record.checksum.removeprefix("sha256:") for record in records),
        ),
        flags=record_flags(sorted(records, key=lambda record: record.sequence)),
        stated=StatedExposures(where="the record of the run", unit="s", has_option=False),
    )


def _shots(frames: Sequence[FrameRecord]) -> list[Shot]:
    """Return frames by exposure: each by itself, or the parts behind a cell of polarizers together."""
    shots: dict[tuple[str, int], list[FrameRecord]] = defaultdict(list)
    for record in frames:
        key = ("frame", record.sequence) if record.exposure_id is None else ("cell", record.exposure_id)
        shots[key].append(record)
    return [tuple(shot) for shot in shots.values()]


def _picture(run: Run, shot: Shot) -> NDArray[np.uint16]:
    """Return the picture of an exposure, its parts back in their places: each pixel is one of the sensor."""
    if len(shot) == 1:
        return run.counts(shot[0])
    return mosaic([run.counts(record) for record in shot])


def _refuse_interpolated(run: Run) -> None:
    if run.session.interpolation != "none":
        raise DataError(
            f"{run.path}: its frames were interpolated ({run.session.interpolation}), so that neighbours share their "
            'noise: take frames for a calibration with interpolation = "none"'
        )


def _light(record: FrameRecord) -> float | None:
    """Return the polarizer angle that a flat was taken at: another angle may be another brightness."""
    if record.kind == "dark":
        return None
    target_deg = record.polarizer_angle_target_deg
    return target_deg if target_deg is not None else _alike(record.polarizer_angle_deg)


def _alike(number: float | None) -> float | None:
    """Return a number to six digits: a readback differs from frame to frame in the last ones."""
    return None if number is None else float(f"{number:.6g}")


def _common_setting(path: Path, records: Sequence[FrameRecord]) -> CameraSetting:
    """Return the setting that all frames share; refuse them if they share none."""
    facts: dict[str, set[Any]] = {
        "camera_model": {record.camera_model for record in records},
        "camera_serial": {record.camera_serial for record in records},
        "gain_db": {record.gain_db for record in records},
        "bit_depth": {record.bit_depth for record in records},
        "size": {(record.height, record.width) for record in records},
    }
    mixed = [f"{name}: {', '.join(sorted(map(str, values)))}" for name, values in facts.items() if len(values) > 1]
    if mixed:
        raise DataError(
            f"{path}: dark and flat frames differ in what has to be the same for a calibration; make one run a "
            f"setting\n  " + "\n  ".join(mixed)
        )
    first = records[0]
    return CameraSetting(
        model=first.camera_model, serial=first.camera_serial, gain_db=first.gain_db, bit_depth=first.bit_depth
    )


def emva_frames(
    path: Path, *, exposure_unit: ExposureUnit | None = None, most_bytes: int = MOST_FRAME_BYTES
) -> FrameSet:
    """Return the frames of an EMVA 1288 data set."""
    descriptor = read_emva_descriptor(path)
    factor = SECONDS_PER_UNIT[exposure_unit or "ns"] / SECONDS_PER_UNIT["ns"]
    shape = (descriptor.height, descriptor.width)
    return FrameSet(
        groups=tuple(
            FrameGroup(
                kind=group.kind,
                exposure_s=float(f"{group.exposure_s * factor:.9g}"),
                loaders=tuple(partial(_read_emva_image, file, shape, most_bytes) for file in group.files),
                photons=group.photons or None,
            )
            for group in descriptor.groups
        ),
        camera=CameraSetting(model=None, serial=None, gain_db=None, bit_depth=descriptor.bit_depth),
        made_for=MadeFor(bit_depth=descriptor.bit_depth),
        source=FrameSource(
            kind="emva",
            path=str(path),
            sha256=sha256_of(path),
            frames_sha256=files_digest([file for group in descriptor.groups for file in group.files]),
        ),
        stated=StatedExposures(where="the descriptor", unit=exposure_unit or "ns"),
    )


def _read_emva_image(file: Path, shape: tuple[int, int], most_bytes: int) -> NDArray[np.uint16]:
    try:
        counts = read_image(file, most_bytes=most_bytes).counts
    except DataError as error:
        raise DataError(f"{file}: {error}") from error
    if counts.shape != shape:
        raise DataError(f"{file}: has {counts.shape} rows and columns; the descriptor says {shape}")
    return counts


def files_digest(files: Sequence[Path]) -> str:
    """Return the SHA-256 over the SHA-256 of each file."""
    with ThreadPoolExecutor() as pool:
        return _digest(pool.map(sha256_of, files))


def _digest(sha256s: Iterable[str]) -> str:
    return hashlib.sha256("".join(sha256s).encode("ascii")).hexdigest()


_FITS_SUFFIXES = frozenset({".fits", ".fit", ".fts", ".gz"})
_PLAIN_SUFFIXES = frozenset({".png", ".tif", ".tiff"})
_LOSSY_SUFFIXES = frozenset({".jpg", ".jpeg", ".webp"})
_KIND_WORDS: dict[LevelKind, frozenset[str]] = {
    "dark": frozenset({"dark", "darks", "bias"}),
    "flat": frozenset({"flat", "flats", "bright", "light"}),
}
_SECONDS: dict[str, float] = {
    "nsec": 1e-9,
    "usec": 1e-6,
    "msec": 1e-3,
    "sec": 1.0,
    "µs": 1e-6,
    **{str(unit): seconds for unit, seconds in SECONDS_PER_UNIT.items()},
}
# 10ms, 0.5s, 2p5ms, exp000522us; not the s of a word.
_BEFORE = r"(?<![A-Za-z0-9.])(?:(?:exposuretime|exposure|exptime|expo|exp|texp|tint|int|t)[-=]?)"
_NUMBER = r"(\d+(?:[.p]\d+)?)"
_EXPOSURE = re.compile(
    rf"(?:{_BEFORE}|(?<![A-Za-z0-9.])){_NUMBER}\s?({'|'.join(map(re.escape, _SECONDS))})(?![A-Za-z0-9])", re.IGNORECASE
)
_BARE_EXPOSURE = re.compile(rf"{_BEFORE}\s?{_NUMBER}(?![A-Za-z0-9])", re.IGNORECASE)
_PLAIN = ImageReading()
_LISTED_PROBLEMS = 5
_EXPOSURE_KEYS = ("EXPTIME", "EXPOSURE", "XPOSURE")
_KIND_KEYS = ("IMAGETYP", "FRAME", "OBSTYPE")


@dataclass(frozen=True, kw_only=True)
class ListedImage:
    """An image and what is known of it."""

    path: Path  #: File.
    kind: LevelKind  #: Without light, or with even light.
    exposure_s: float | None  #: Exposure time [s].
    photons: float | None  #: Mean photons a pixel, where somebody measured them.
    level: str  #: Frames of one kind and exposure with another level are of another light.


def folder_frames(
    folder: Path, *, bit_depth: int, reading: ImageReading = _PLAIN, exposure_unit: ExposureUnit | None = None
) -> FrameSet:
    """Return the dark and flat frames of a folder of images, subfolders included."""
    if not folder.is_dir():
        raise ConfigError(f"{folder}: there is no such folder")
    # Names that begin with a point are what other systems leave behind beside an image.
    paths = sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("."))
    _refuse_lossy([path for path in paths if path.suffix.lower() in _LOSSY_SUFFIXES])
    images, problems = [], []
    for path in paths:
        if path.suffix.lower() in _FITS_SUFFIXES | _PLAIN_SUFFIXES | RAW_SUFFIXES:
            try:
                images.append(_listed(path, path.relative_to(folder), reading, exposure_unit))
            except ConfigError as error:
                problems.append(str(error))
    if not images and not problems:
        problems.append("it holds no PNG, TIFF, FITS or RAW files")
    if problems:
        raise ConfigError("\n  ".join([f"{folder}:", *_shortened(problems)]))
    digest = hashlib.sha256("\n".join(str(image.path.relative_to(folder)) for image in images).encode()).hexdigest()
    source = partial(FrameSource, kind="folder", path=str(folder), sha256=digest)
    # Names may have a unit beside each number, headers have seconds.
    stated = StatedExposures(where="the names or headers of the images")
    return frame_set(images, bit_depth=bit_depth, reading=reading, source=source, stated=stated)


def frame_set(
    images: Sequence[ListedImage],
    *,
    bit_depth: int,
    reading: ImageReading,
    source: Callable[..., FrameSource],
    stated: StatedExposures,
) -> FrameSet:
    """Return a set of frames from images of which all is known."""
    groups: dict[tuple[LevelKind, float | None, str], list[ListedImage]] = defaultdict(list)
    for image in images:
        groups[image.kind, image.exposure_s, image.level].append(image)
    return FrameSet(
        groups=tuple(
            FrameGroup(
                kind=kind,
                exposure_s=exposure_s,
                loaders=tuple(partial(_counts, image.path, reading) for image in group),
                photons=group[0].photons,
            )
            for (kind, exposure_s, _), group in groups.items()
        ),
        camera=CameraSetting(model=None, serial=None, gain_db=None, bit_depth=bit_depth),
        made_for=MadeFor(bit_depth=bit_depth),
        source=source(frames_sha256=files_digest([image.path for group in groups.values() for image in group])),
        stated=stated,
    )


def _counts(path: Path, reading: ImageReading) -> NDArray[np.uint16]:
    try:
        return read_image(path, plane=reading.plane, most_bytes=reading.most_bytes).counts
    except DataError as error:
        raise DataError(f"{path}: {error}") from error


def _refuse_lossy(paths: Sequence[Path]) -> None:
    if not paths:
        return
    raise refused(
        "lossy_compression",
        f"{len(paths)} files such as {paths[0]} are compressed with loss: noise is what such a format takes away, and "
        f"their values went through a tone curve; save raw frames as PNG, TIFF or FITS",
    )


def _shortened(problems: Sequence[str]) -> list[str]:
    """Return problems, the first of many and how many there are."""
    if len(problems) <= _LISTED_PROBLEMS:
        return list(problems)
    return [*problems[:3], f"and {len(problems) - 3} more files of which the same is to be said"]


def _listed(path: Path, inside: Path, reading: ImageReading, unit: ExposureUnit | None) -> ListedImage:
    name = inside.as_posix()
    kind, exposure_s = _kind_of_name(name), _exposure_of_name(name, unit)
    if (kind is None or exposure_s is None) and path.suffix.lower() in _FITS_SUFFIXES | RAW_SUFFIXES:
        header = read_image(path, plane=reading.plane, most_bytes=reading.most_bytes).header
        kind, exposure_s = kind or _kind_of_header(header), exposure_s or _exposure_of_header(header, unit)
    if kind is None:
        words = ", ".join(sorted(word for words in _KIND_WORDS.values() for word in words))
        raise ConfigError(f"{name}: is it dark or flat? One word of its path has to say so: {words}; or give --table")
    level = "" if kind == "dark" else inside.parent.as_posix()
    return ListedImage(path=path, kind=kind, exposure_s=exposure_s, photons=None, level=level)


def _kind_of_name(name: str) -> LevelKind | None:
    words = set(re.split(r"[^a-z]+", name.lower()))
    found = [kind for kind, known in _KIND_WORDS.items() if words & known]
    return found[0] if len(found) == 1 else None


def _exposure_of_name(name: str, bare_unit: ExposureUnit | None = None) -> float | None:
    # An underscore ends a number's word, as a blank does.
    words = name.replace("_", " ")
    found: list[tuple[str, str]] = _EXPOSURE.findall(words)
    if not found and bare_unit is not None:
        found = [(number, bare_unit) for number in _BARE_EXPOSURE.findall(words)]
    if not found:
        return None
    number, unit = found[-1]
    return float(f"{float(number.lower().replace('p', '.')) * _SECONDS[unit.lower()]:.9g}")


def _kind_of_header(header: Mapping[str, HeaderValue]) -> LevelKind | None:
    return _kind_of_name(" ".join(str(header.get(key, "")) for key in _KIND_KEYS))


def _exposure_of_header(header: Mapping[str, HeaderValue], unit: ExposureUnit | None) -> float | None:
    for key in _EXPOSURE_KEYS:
        if isinstance(header.get(key), int | float):
            return float(header[key]) * SECONDS_PER_UNIT[unit or "s"]
    return None


_S_PER_MS = 1e-3
_NEEDED = ("file", "kind")
_ALLOWED = (*_NEEDED, "exposure_ms", "photons", "level")
_KINDS: dict[str, LevelKind] = {"dark": "dark", "flat": "flat"}


def table_frames(
    path: Path, *, bit_depth: int, reading: ImageReading = _PLAIN, exposure_unit: ExposureUnit | None = None
) -> FrameSet:
    """Return the dark and flat frames that a table lists."""
    try:
        text = read_bounded(path, MOST_TEXT_BYTES).decode("utf-8-sig")
        rows = list(csv.DictReader(io.StringIO(text, newline="")))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    columns = list(rows[0]) if rows else []
    problems = [f"column {name!r} is missing" for name in _NEEDED if name not in columns]
    problems += [f"column {name!r} is none of {', '.join(_ALLOWED)}" for name in columns if name not in _ALLOWED]
    images = []
    if not problems:
        for line, row in enumerate(rows, start=2):
            try:
                images.append(_image(path.parent, row))
            except ConfigError as error:
                problems.append(f"line {line}: {error}")
    if problems:
        raise ConfigError("\n  ".join([f"{path}:", *problems]))
    source = partial(FrameSource, kind="table", path=str(path), sha256=sha256_of(path))
    if exposure_unit is not None:
        factor = SECONDS_PER_UNIT[exposure_unit] / _S_PER_MS
        images = [
            replace(one, exposure_s=None if one.exposure_s is None else one.exposure_s * factor) for one in images
        ]
    stated = StatedExposures(where="the column exposure_ms", unit=exposure_unit or "ms")
    return frame_set(images, bit_depth=bit_depth, reading=reading, source=source, stated=stated)


def _image(folder: Path, row: dict[str, str | None]) -> ListedImage:
    kind = _KINDS.get((row["kind"] or "").strip().lower())
    if kind is None:
        raise ConfigError(f"kind is {row['kind']!r}; allowed are {', '.join(_KINDS)}")
    file = folder / (row["file"] or "").strip()
    if not file.is_file():
        raise ConfigError(f"there is no file {file}")
    exposure_ms = _number(row, "exposure_ms")
    return ListedImage(
        path=file,
        kind=kind,
        exposure_s=None if exposure_ms is None else exposure_ms * _S_PER_MS,
        photons=_number(row, "photons") if kind == "flat" else None,
        level=(row.get("level") or "").strip(),
    )


def _number(row: dict[str, str | None], name: str) -> float | None:
    text = (row.get(name) or "").strip()
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not isfinite(value) or value < 0.0:
        raise ConfigError(f"{name} is {text!r}; it has to be a number, not below 0, or empty where it is not known")
    return value
