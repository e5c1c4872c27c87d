"""Dark and flat frames for a noise calibration: from a run, an EMVA 1288 data set, a folder of images or a table.

Each source lists its frames with kind, exposure and, where known, light and temperature. Frames that differ only by
noise form a group (`FrameGroup`), which becomes a level of the calibration. Of dark frames at several temperatures
those nearest to the temperature of the flats are used, and a flag names the others.
"""

import hashlib
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from math import isfinite
from pathlib import Path, PurePosixPath
from statistics import fmean, median
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Estimate
from calibration.results import Flag, refused
from calibration.sensor.findings import StatedExposures
from calibration.sensor.levels import LevelKind
from drivers.cameras.raw_files import RAW_SUFFIXES
from model.processing.mosaic import mosaic
from rigctl.base.durable import MOST_FRAME_BYTES, MOST_TEXT_BYTES, read_bounded, sha256_of
from rigctl.base.numbers import range_problem
from rigctl.calibrations.kinds import MadeFor, made_for
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import SECONDS_PER_UNIT, ExposureUnit
from rigctl.files.csv_table import csv_rows
from rigctl.images import HeaderValue, ImageReading, read_image
from rigctl.imports import headers
from rigctl.runs.check import run_to_measure
from rigctl.runs.folder import MANIFEST_FILE, Run
from rigctl.runs.records import FrameRecord

Shot = tuple[FrameRecord, ...]
Loader = Callable[[], NDArray[np.uint16]]
_Item = TypeVar("_Item")
_Problems = list[tuple[int, str]]

# Expected drift of temperature within a set; dark frames with a larger gap are of another temperature.
_DRIFT_C = 3.0
_PLAIN = ImageReading()


@dataclass(frozen=True, kw_only=True)
class FrameGroup:
    """Frames that differ by noise only."""

    kind: LevelKind  #: without light, or with even light
    exposure_s: float | None
    loaders: tuple[Loader, ...]  #: functions that read one frame each, in the order of exposure
    photons: float | None = None  #: mean photons a pixel, where they were measured


@dataclass(frozen=True, kw_only=True)
class FrameSource:
    """Origin of frames."""

    kind: Literal["run", "emva", "folder", "table"]
    path: str  #: folder, descriptor or table
    sha256: str  #: of the run's manifest, of the descriptor or table, or of the names of the images
    frames_sha256: str  #: over the SHA-256 of every frame's file, in the order of use


@dataclass(frozen=True, kw_only=True)
class FrameSet:
    """All frames of a calibration, the source of their exposures, and findings about how they were taken."""

    groups: tuple[FrameGroup, ...]
    bit_depth: int
    made_for: MadeFor
    source: FrameSource
    flags: tuple[Flag, ...] = ()
    stated: StatedExposures = field(default_factory=StatedExposures)
    black_level_dn: Estimate | None = None  #: in place of dark frames


@dataclass(frozen=True, kw_only=True)
class ListedImage:
    """An image file and what is known of it."""

    path: Path
    kind: LevelKind
    exposure_s: float | None = None
    photons: float | None = None  #: mean photons a pixel, where they were measured
    level: str = ""  #: frames of one kind and exposure with another level are of another light
    temperature_c: float | None = None  #: of the sensor, by the header
    overscan_dn: float | None = None  #: mean of the overscan, by the header


# Runs


def run_frames(path: Path, *, ignore_exclusions: bool = False) -> FrameSet:
    """Return the dark and flat frames of a run, by kind, exposure and polarizer angle."""
    run = run_to_measure(path, ignore_exclusions=ignore_exclusions)
    _refuse_interpolated(run)
    shots = [shot for shot in _shots(run.frames) if shot[0].kind != "scene"]
    shots, flags = _of_one_temperature(shots, lambda shot: (shot[0].kind, shot[0].camera_temperature_c))
    groups: dict[tuple[LevelKind, float | None, float | None], list[Shot]] = defaultdict(list)
    for shot in shots:
        if shot[0].kind != "scene":
            groups[shot[0].kind, _alike(shot[0].exposure_s), _light(shot[0])].append(shot)
    records = [record for group in groups.values() for shot in group for record in shot]
    if not records:
        raise DataError(f"{path}: has no dark and no flat frames; `rigctl acquire` and `rigctl import` make them")
    if any(record.reads for record in records):
        raise DataError(
            f"{path}: its frames are means of several reads, with less noise than one read; take single reads"
        )
    return FrameSet(
        groups=tuple(
            FrameGroup(kind=kind, exposure_s=exposure_s, loaders=tuple(partial(_picture, run, shot) for shot in group))
            for (kind, exposure_s, _), group in groups.items()
        ),
        bit_depth=_common_bit_depth(path, records),
        made_for=made_for(run, records),
        source=FrameSource(
            kind="run",
            path=str(path),
            sha256=sha256_of(path / MANIFEST_FILE),
            frames_sha256=_digest(record.checksum.removeprefix("sha256:") for record in records),
        ),
        flags=(*flags, *record_flags(sorted(records, key=lambda record: record.sequence))),
        stated=StatedExposures(where="the record of the run", unit="s", has_option=False),
        black_level_dn=_recorded_black_level(records),
    )


# Error of a black level that is stated without one: a count.
STATED_BLACK_ERROR_DN = 0.5


def _recorded_black_level(records: Sequence[FrameRecord]) -> Estimate | None:
    """Return the black level that all flats of a run without dark frames have."""
    levels = {record.black_level_dn for record in records}
    level = levels.pop() if len(levels) == 1 else None
    if level is None or any(record.kind == "dark" for record in records):
        return None
    return Estimate(value=level, std_error=STATED_BLACK_ERROR_DN, n=len(records))


def _shots(frames: Sequence[FrameRecord]) -> list[Shot]:
    """Return frames by exposure; the parts of a division-of-focal-plane camera are one."""
    shots: dict[tuple[str, int], list[FrameRecord]] = defaultdict(list)
    for record in frames:
        key = ("frame", record.sequence) if record.exposure_id is None else ("cell", record.exposure_id)
        shots[key].append(record)
    return [tuple(shot) for shot in shots.values()]


def _picture(run: Run, shot: Shot) -> NDArray[np.uint16]:
    """Return the picture of an exposure as the sensor has it, with its parts put back."""
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
    """Return the polarizer angle of a flat: brightness may depend on it."""
    if record.kind == "dark":
        return None
    target_deg = record.polarizer_angle_target_deg
    return target_deg if target_deg is not None else _alike(record.polarizer_angle_deg)


def _alike(number: float | None) -> float | None:
    """Return a number to six digits, as readbacks scatter in the last digits."""
    return None if number is None else float(f"{number:.6g}")


def _common_bit_depth(path: Path, records: Sequence[FrameRecord]) -> int:
    """Return the bit depth of all frames; refuse them if they differ in a setting."""
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
            f"{path}: dark and flat frames have different settings; make one run for each "
            f"setting\n  " + "\n  ".join(mixed)
        )
    return records[0].bit_depth


# A camera may expose one frame while it reads out another, but exposes only one at a time.
_NS_PER_S, _LEAST_SPACING = 1e9, 0.5


def record_flags(records: Sequence[FrameRecord]) -> tuple[Flag, ...]:
    """Return the findings in the times and temperatures of frames."""
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
                message=f"frame {before.sequence} has an exposure of {before.exposure_s:g} s in its record, but the "
                f"next one began {spacing_s:.3g} s later: exposures seem to be in another unit than seconds (ms?), "
                f"which makes dark current too small: correct the exposures",
                refuses=True,
            )
    return None


def _temperature_drift(records: Sequence[FrameRecord]) -> Flag | None:
    temperatures = [one.camera_temperature_c for one in records if one.camera_temperature_c is not None]
    if not temperatures or max(temperatures) - min(temperatures) < _DRIFT_C:
        return None
    return Flag(
        name="temperature_drift",
        message=f"the camera drifted from {min(temperatures):.1f} to {max(temperatures):.1f} C (expected: at most "
        f"{_DRIFT_C:g} C): dark current doubles every 6 to 8 C, so darks may not fit their flats: let it warm up",
    )


def _of_one_temperature(
    items: Sequence[_Item], facts: Callable[[_Item], tuple[str, float | None]]
) -> tuple[list[_Item], tuple[Flag, ...]]:
    """Return items without dark frames of another temperature than the flats, and a flag that names these.

    `facts` returns kind and temperature of an item. If that of the flats is not known, the largest set of darks is
    used; if that of a dark is not known, all darks are used.
    """
    known = [facts(item) for item in items]
    darks = sorted(one for kind, one in known if kind == "dark" and one is not None)
    flats = [one for kind, one in known if kind == "flat" and one is not None]
    gaps = [0, *(place for place in range(1, len(darks)) if darks[place] - darks[place - 1] > _DRIFT_C), len(darks)]
    sets = [darks[start:end] for start, end in pairwise(gaps)]
    if len(sets) < 2 or any(kind == "dark" and one is None for kind, one in known):
        return list(items), ()
    used = min(sets, key=lambda one: abs(fmean(one) - median(flats))) if flats else max(sets, key=len)
    named = " and ".join(f"{fmean(one):.1f} C ({len(one)} frames)" for one in sets)
    why = f"nearest to the flats ({median(flats):.1f} C)" if flats else "the most"
    message = (
        f"dark frames were taken at {named}: dark current doubles every 6 to 8 K; those "
        f"at {fmean(used):.1f} C are used, {why}, the others are left out: calibrate each temperature separately, "
        f"and compare by `rigctl calibrate doubling`"
    )
    kept = [
        item
        for item, (kind, one) in zip(items, known, strict=True)
        if kind != "dark" or (one is not None and used[0] <= one <= used[-1])
    ]
    return kept, (Flag(name="dark_temperatures", message=message),)


# EMVA 1288 data sets


def emva_frames(
    path: Path, *, exposure_unit: ExposureUnit | None = None, most_bytes: int = MOST_FRAME_BYTES
) -> FrameSet:
    """Return the frames of an EMVA 1288 data set."""
    bit_depth, shape, images = read_emva_descriptor(path, unit_s=SECONDS_PER_UNIT[exposure_unit or "ns"])
    return _frame_set(
        images,
        bit_depth=bit_depth,
        reading=ImageReading(most_bytes=most_bytes),
        shape=shape,
        source=partial(FrameSource, kind="emva", path=str(path), sha256=sha256_of(path)),
        stated=StatedExposures(where="the descriptor", unit=exposure_unit or "ns"),
    )


def read_emva_descriptor(path: Path, *, unit_s: float = 1e-9) -> tuple[int, tuple[int, int], list[ListedImage]]:
    """Return bit depth, rows and columns, and images of a descriptor; ConfigError names every problem.

    A line `n` has bits, width and height; `b EXPOSURE PHOTONS` and `d EXPOSURE` begin a level of bright or dark images,
    and `i FILE` adds an image. Format: EMVA1288/emva1288 on GitHub.
    """
    try:
        text = read_bounded(path, MOST_TEXT_BYTES).decode("utf-8", errors="replace")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    lines = [(number, *line.strip().partition(" ")[::2]) for number, line in enumerate(text.splitlines(), start=1)]
    lines = [(number, tag, rest.strip()) for number, tag, rest in lines if tag and not tag.startswith("#")]
    problems: _Problems = [
        (number, f"{f'{tag} {rest}'.strip()!r} begins with {tag!r}; allowed are {', '.join(_TAGS)} and #")
        for number, tag, rest in lines
        if tag not in _TAGS
    ]
    numbers = {
        number: _numbers(problems, number, rest, _TAGS[tag])
        for number, tag, rest in lines
        if tag in _TAGS and tag != "i"
    }
    size = _descriptor_size([(number, rest, numbers[number]) for number, tag, rest in lines if tag == "n"], problems)
    images = _descriptor_images(
        path.parent, [one for one in lines if one[1] in ("b", "d", "i")], numbers, problems, unit_s=unit_s
    )
    if problems:
        count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
        lines_of = [
            f"line {line}: {said}" if line else said for line, said in sorted(problems, key=lambda one: one[0] or 1e9)
        ]
        raise ConfigError("\n  ".join([f"{path}: {count}", *lines_of]))
    bits, width, height = map(int, size)
    return bits, (height, width), images


# Tags of the lines of a descriptor and the numbers that follow them; problems with their line, 0 for the whole file.
_TAGS = {
    "v": ("version",),
    "n": ("n bits", "width", "height"),
    "b": ("exposure in nanoseconds", "photons per pixel"),
    "d": ("exposure in nanoseconds",),
    "i": (),
}
_KIND_OF_TAG: dict[str, LevelKind] = {"b": "flat", "d": "dark"}


def _numbers(problems: _Problems, line: int, text: str, names: tuple[str, ...]) -> list[float] | None:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) == len(names) and all(value >= 0.0 and range_problem(value) is None for value in values):
        return values
    problems.append((line, f"{text!r} must be {len(names)} numbers, none below 0: {', '.join(names)}"))
    return None


def _descriptor_size(stated: Sequence[tuple[int, str, list[float] | None]], problems: _Problems) -> list[float]:
    """Return bits, width and height."""
    if not stated:
        problems.append((0, "a line `n BITS WIDTH HEIGHT` is missing"))
    problems += [(line, "n occurs a second time") for line, _, _ in stated[1:]]
    for line, text, values in stated:
        if values and (not 1 <= values[0] <= 16 or min(values[1:]) < 1 or any(value % 1 for value in values)):
            said = f"n {text} must be three whole numbers: 1 to 16 bits, width and height of at least 1"
            problems.append((line, said))
    return next((values for _, _, values in stated if values), [0.0, 0.0, 0.0])


def _descriptor_images(
    folder: Path,
    lines: Sequence[tuple[int, str, str]],
    numbers: Mapping[int, list[float] | None],
    problems: _Problems,
    *,
    unit_s: float,
) -> list[ListedImage]:
    images: list[ListedImage] = []
    first_use: dict[Path, int] = {}
    levels: list[ListedImage] = []  # images of levels whose file is not yet known
    for number, tag, text in lines:
        if tag != "i":
            exposure, photons = [*(numbers[number] or [0.0]), 0.0][:2]
            exposure_s, kind = float(f"{exposure * unit_s:.9g}"), _KIND_OF_TAG[tag]
            levels.append(
                ListedImage(path=folder, kind=kind, exposure_s=exposure_s, photons=photons or None, level=str(number))
            )
        elif not levels:
            problems.append((number, f"image {text!r} stands before any b or d line"))
        else:
            file = folder / PurePosixPath(text.replace("\\", "/"))
            said = _image_problem(file, folder.resolve(), first_use.get(file))
            if said is not None:
                problems.append((number, f"image {text!r}{said}"))
            first_use.setdefault(file, number)
            images.append(replace(levels[-1], path=file))
    used = {image.level for image in images}
    problems += [(int(level.level), "no image follows") for level in levels if level.level not in used]
    for kind, what in (("flat", "bright group (line `b NANOSECONDS PHOTONS`)"), ("dark", "dark group (`d`)")):
        if all(level.kind != kind for level in levels):
            problems.append((0, f"there is no {what}"))
    return images


def _image_problem(file: Path, folder: Path, first_use: int | None) -> str | None:
    if not _lies_within(file, folder):
        return " lies outside of the descriptor's folder; a data set has its own"
    if first_use is not None:
        return f" is listed a second time (first in line {first_use})"
    return None if file.is_file() else f": there is no such file ({file})"


def _lies_within(file: Path, folder: Path) -> bool:
    try:
        return file.resolve().is_relative_to(folder)
    except (OSError, RuntimeError, ValueError):  # links in a circle, a name that is too long or no name at all
        return False


# Folders of images


_FITS_SUFFIXES = frozenset({".fits", ".fit", ".fts", ".fz", ".gz"})
_PLAIN_SUFFIXES = frozenset({".png", ".tif", ".tiff"})
_LOSSY_SUFFIXES = frozenset({".jpg", ".jpeg", ".webp"})
_KIND_WORDS: dict[LevelKind, frozenset[str]] = {
    "dark": frozenset({"dark", "darks", "bias", "zero"}),
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
_LISTED_PROBLEMS = 5


def folder_frames(
    folder: Path, *, bit_depth: int, reading: ImageReading = _PLAIN, exposure_unit: ExposureUnit | None = None
) -> FrameSet:
    """Return the dark and flat frames of a folder of images, subfolders included."""
    if not folder.is_dir():
        raise ConfigError(f"{folder}: there is no such folder")
    # Other systems leave files whose names begin with a point.
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
        problems.append("has no PNG, TIFF, FITS or RAW files")
    if problems:
        raise ConfigError("\n  ".join([f"{folder}:", *_shortened(problems)]))
    digest = hashlib.sha256("\n".join(str(image.path.relative_to(folder)) for image in images).encode()).hexdigest()
    return _frame_set(
        images,
        bit_depth=bit_depth,
        reading=reading,
        source=partial(FrameSource, kind="folder", path=str(folder), sha256=digest),
        # Names may have a unit after each number, headers have seconds.
        stated=StatedExposures(where="the names or headers of the images"),
    )


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
    return [*problems[:3], f"and {len(problems) - 3} more files with such problems"]


def _listed(path: Path, inside: Path, reading: ImageReading, unit: ExposureUnit | None) -> ListedImage:
    name = inside.as_posix()
    kind, exposure_s = _kind_of_name(name), _exposure_of_name(name, unit)
    header, overscan_dn = _header(path, reading, is_wanted=kind is None or exposure_s is None)
    told = headers.kind_of(header, path.name)
    kind = kind or (None if told == "scene" else told)
    exposure_s = exposure_s or _exposure_of_header(header, unit)
    if kind is None:
        words = ", ".join(sorted(word for words in _KIND_WORDS.values() for word in words))
        raise ConfigError(f"{name}: is it dark or flat? One word of its path has to say so: {words}; or give --table")
    level = "" if kind == "dark" else inside.parent.as_posix()
    return ListedImage(
        path=path,
        kind=kind,
        exposure_s=exposure_s,
        level=level,
        temperature_c=headers.temperature_c(header),
        overscan_dn=overscan_dn,
    )


def _header(
    path: Path, reading: ImageReading, *, is_wanted: bool = False
) -> tuple[Mapping[str, HeaderValue], float | None]:
    """Return the header of a FITS file, and the mean of the overscan where it has one.

    RAW files have no temperature and take long to read: theirs is read if it is wanted.
    """
    suffix = path.suffix.lower()
    if suffix not in _FITS_SUFFIXES and not (is_wanted and suffix in RAW_SUFFIXES):
        return {}, None
    image = read_image(path, plane=reading.plane, most_bytes=reading.most_bytes)
    _, overscan, _ = headers.sections_of(image.header, image.counts.shape)
    return image.header, None if overscan is None else float(image.counts[overscan].mean())


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


def _exposure_of_header(header: Mapping[str, HeaderValue], unit: ExposureUnit | None) -> float | None:
    for key in headers.EXPOSURE_KEYS:
        if isinstance(header.get(key), int | float):
            return float(header[key]) * SECONDS_PER_UNIT[unit or "s"]
    return None


# Tables of images


_S_PER_MS = 1e-3
_NEEDED = ("file", "kind")
_ALLOWED = (*_NEEDED, "exposure_ms", "photons", "level")
_KINDS: dict[str, LevelKind] = {"dark": "dark", "flat": "flat"}


def table_frames(
    path: Path, *, bit_depth: int, reading: ImageReading = _PLAIN, exposure_unit: ExposureUnit | None = None
) -> FrameSet:
    """Return the dark and flat frames that a table lists."""
    rows = csv_rows(path)
    columns = list(rows[0]) if rows else []
    problems = [f"column {name!r} is missing" for name in _NEEDED if name not in columns]
    problems += [f"column {name!r} is not one of {', '.join(_ALLOWED)}" for name in columns if name not in _ALLOWED]
    unit_s = _S_PER_MS if exposure_unit is None else SECONDS_PER_UNIT[exposure_unit]
    images = []
    for line, row in enumerate([] if problems else rows, start=2):
        try:
            images.append(_image(path.parent, row, reading, unit_s))
        except ConfigError as error:
            problems.append(f"line {line}: {error}")
    if problems:
        raise ConfigError("\n  ".join([f"{path}:", *problems]))
    return _frame_set(
        images,
        bit_depth=bit_depth,
        reading=reading,
        source=partial(FrameSource, kind="table", path=str(path), sha256=sha256_of(path)),
        stated=StatedExposures(where="the column exposure_ms", unit=exposure_unit or "ms"),
    )


def _image(folder: Path, row: dict[str, str | None], reading: ImageReading, unit_s: float) -> ListedImage:
    kind = _KINDS.get((row["kind"] or "").strip().lower())
    if kind is None:
        raise ConfigError(f"kind is {row['kind']!r}; allowed are {', '.join(_KINDS)}")
    file = folder / (row["file"] or "").strip()
    if not file.is_file():
        raise ConfigError(f"there is no file {file}")
    exposure = _number(row, "exposure_ms")
    header, overscan_dn = _header(file, reading)
    return ListedImage(
        path=file,
        kind=kind,
        exposure_s=None if exposure is None else exposure * unit_s,
        photons=_number(row, "photons") if kind == "flat" else None,
        level=(row.get("level") or "").strip(),
        temperature_c=headers.temperature_c(header),
        overscan_dn=overscan_dn,
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


# Images of any source


def _frame_set(
    images: Sequence[ListedImage],
    *,
    bit_depth: int,
    reading: ImageReading,
    shape: tuple[int, int] | None = None,
    source: Callable[..., FrameSource],
    stated: StatedExposures,
) -> FrameSet:
    """Return a set of frames from images of which all is known."""
    used, flags = _of_one_temperature(images, lambda image: (image.kind, image.temperature_c))
    groups: dict[tuple[LevelKind, float | None, str], list[ListedImage]] = defaultdict(list)
    for image in used:
        groups[image.kind, image.exposure_s, image.level].append(image)
    temperatures = [image.temperature_c for image in used if image.temperature_c is not None]
    strips = [image.overscan_dn for image in used if image.overscan_dn is not None]
    is_by_strips = len(strips) == len(used) > 1 and all(image.kind == "flat" for image in used)
    return FrameSet(
        groups=tuple(
            FrameGroup(
                kind=kind,
                exposure_s=exposure_s,
                loaders=tuple(partial(_counts, image.path, reading, shape) for image in group),
                photons=group[0].photons,
            )
            for (kind, exposure_s, _), group in groups.items()
        ),
        bit_depth=bit_depth,
        made_for=MadeFor(bit_depth=bit_depth, temperature_c=fmean(temperatures) if temperatures else None),
        source=source(frames_sha256=_files_digest([image.path for group in groups.values() for image in group])),
        flags=flags,
        stated=stated,
        black_level_dn=_overscan_level(strips) if is_by_strips else None,
    )


def _counts(path: Path, reading: ImageReading, shape: tuple[int, int] | None) -> NDArray[np.uint16]:
    try:
        image = read_image(path, plane=reading.plane, most_bytes=reading.most_bytes)
        lit, _, _ = headers.sections_of(image.header, image.counts.shape) if reading.is_cut else (None, None, "")
        counts = np.ascontiguousarray(image.raw_counts[lit or np.s_[:, :]])
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    if shape is not None and counts.shape != shape:
        raise DataError(f"{path}: has {counts.shape} rows and columns; the descriptor says {shape}")
    return counts


def with_overscan(frames: FrameSet, box: tuple[int, int, int, int]) -> FrameSet:
    """Return flats without the strip of pixels that get no light, and its mean as their black level.

    The strip is x, y, width and height, and reaches along a whole side of the picture.
    """
    loaders = [load for group in frames.groups for load in group.loaders]
    x, y, width, height = box
    strip, rest = (slice(y, y + height), slice(x, x + width)), None
    rows, columns = loaders[0]().shape
    if min(x, y) >= 0 and min(width, height) > 0 and x + width <= columns and y + height <= rows:
        if height == rows and width < columns and (x == 0 or x + width == columns):
            rest = (slice(None), slice(width, None) if x == 0 else slice(0, x))
        elif width == columns and height < rows and (y == 0 or y + height == rows):
            rest = (slice(height, None) if y == 0 else slice(0, y), slice(None))
    if rest is None:
        raise ConfigError(
            f"--overscan {x},{y},{width},{height}: has to be x,y,width,height of a strip along a whole side of the "
            f"picture of {columns} x {rows} pixels, such as {columns - 16},0,16,{rows}"
        )
    level = _overscan_level([float(load()[strip].mean()) for load in loaders])
    groups = tuple(
        replace(group, loaders=tuple(partial(_part, load, rest) for load in group.loaders)) for group in frames.groups
    )
    return replace(frames, groups=groups, black_level_dn=level)


def _overscan_level(means: Sequence[float]) -> Estimate:
    """Return the black level by the overscan of each frame; with their scatter, as it may move with the light."""
    error = float(np.std(means, ddof=1))
    return Estimate(value=fmean(means), std_error=max(error, 1e-3), n=len(means))


def _part(load: Loader, part: tuple[slice, slice]) -> NDArray[np.uint16]:
    return np.ascontiguousarray(load()[part])


def _files_digest(files: Sequence[Path]) -> str:
    with ThreadPoolExecutor() as pool:
        return _digest(pool.map(sha256_of, files))


def _digest(sha256s: Iterable[str]) -> str:
    """Return the SHA-256 over the SHA-256 of each file."""
    return hashlib.sha256("".join(sha256s).encode("ascii")).hexdigest()
