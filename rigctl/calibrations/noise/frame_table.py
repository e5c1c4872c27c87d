"""A table of dark and flat frames: a CSV file that says what each image is."""

import csv
import io
from dataclasses import replace
from functools import partial
from math import isfinite
from pathlib import Path

from calibration.sensor.curves import StatedExposures
from calibration.sensor.levels import LevelKind
from rigctl.calibrations.noise.folder_frames import ListedImage, frame_set
from rigctl.calibrations.noise.noise_frames import FrameSet, FrameSource
from rigctl.errors import ConfigError
from rigctl.files.choices import SECONDS_PER_UNIT, ExposureUnit
from rigctl.images.image_file import ImageReading
from rigctl.storage.bounded_file import MOST_TEXT_BYTES, read_bounded, sha256_of

_S_PER_MS = 1e-3
_NEEDED = ("file", "kind")
_ALLOWED = (*_NEEDED, "exposure_ms", "photons", "level")
_PLAIN = ImageReading()
_KINDS: dict[str, LevelKind] = {"dark": "dark", "flat": "flat"}


def table_frames(
    path: Path, *, bit_depth: int, reading: ImageReading = _PLAIN, exposure_unit: ExposureUnit | None = None
) -> FrameSet:
    """Return the dark and flat frames that a table lists.

    Parameters
    ----------
    path : Path
        CSV file with the columns ``file`` (relative to the table), ``kind`` (dark or flat), and, where they are known,
        ``exposure_ms``, ``photons`` (mean a pixel) and ``level`` (frames of one exposure and another light have another
        level; any text). Rows of a level in the order in which its frames were taken.
    bit_depth : int
        Bits per sample of the camera.
    reading : ImageReading
        Which colour of RAW files, and how large a picture may be.
    exposure_unit : str or None
        Unit of the column ``exposure_ms`` where it is another.

    Raises
    ------
    ConfigError
        The table cannot be read, or is wrong: every problem with its line.
    """
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
