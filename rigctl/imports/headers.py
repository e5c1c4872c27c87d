"""Facts in headers and names of image files, under the keywords that other programs use.

Observatories and camera programs write the same facts under different keywords. Each function tries the usual ones, the
most reliable first. Names of files count if headers lack the fact.
"""

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any

from rigctl.errors import ConfigError
from rigctl.files.choices import FrameKind
from rigctl.files.csv_table import csv_rows
from rigctl.images import HeaderValue, name_of

Header = Mapping[str, HeaderValue]

# Measured angles come before requested ones.
ANGLE_KEYS = ("POLMEAS", "POLANG", "POLANGLE", "POLAR", "POLARREF", "ANGLE")
RETARDER_KEY = "RETANG"
EXPOSURE_KEYS = ("EXPTIME", "EXPOSURE", "XPOSURE")
BLACK_LEVEL_KEYS = ("BLKLEVEL", "BLACK", "OFFSET", "PEDESTAL")
_KIND_KEYS = ("IMAGETYP", "FRAME", "OBSTYPE")
# Words for kinds of frames. A bias or zero frame is a dark frame of no exposure.
_KIND_WORDS: dict[FrameKind, tuple[str, ...]] = {
    "dark": ("bias", "zero", "dark"),
    "flat": ("flat",),
    "scene": ("scene", "light", "object", "science"),
}
_KIND_PREFIX = re.compile(r"(bias|zero|dark|flat)(?![a-z]{3}|[ _-]?deg)", re.IGNORECASE)
# Measured temperatures of the sensor, then of the camera, then the one that was set.
_TEMPERATURE_KEYS = (
    "CCD-TEMP", "CCD_TEMP", "CCDTEMP", "CCDTMP", "DET-TEMP", "DET_TEMP", "DETTEMP", "SENSTEMP", "CAM-TEMP", "CAMTEMP",
    "TEMPERAT", "SET-TEMP", "CCDSETT",
)  # fmt: skip
_KELVIN, _WARMEST_C = 273.15, 120.0
# Sums of reads, as infrared cameras write them; means, as programs that combine frames do.
_SUM_KEYS, _MEAN_KEYS = ("COADDS", "NCOADDS", "NCOADD"), ("NCOMBINE", "STACKCNT", "SNAPSHOT")
_NUMBER = re.compile(r"((?<![A-Za-z0-9])[-+])?(\d+(?:\.\d+)?)([ _]?deg|°)?", re.IGNORECASE)
_LEAST_ANGLES = 3


def kind_of(header: Header, name: str) -> FrameKind | None:
    """Return the kind of a frame by its header or the beginning of its file's name; None if both lack it."""
    for key in _KIND_KEYS:
        words = re.split(r"[^a-z]+", str(header.get(key, "")).lower())
        for kind, known in _KIND_WORDS.items():
            if any(word in known or word.removesuffix("s") in known for word in words):
                return kind
    begins = _KIND_PREFIX.match(name)
    if begins is None:
        return None
    named: FrameKind = "flat" if begins[1].lower() == "flat" else "dark"
    other = _KIND_WORDS["dark" if named == "flat" else "flat"]
    return None if set(re.split(r"[^a-z]+", name.lower())).intersection(other) else named


def temperature_c(header: Header) -> float | None:
    """Return the temperature of the sensor [deg C]; some headers have it in kelvins."""
    for key in _TEMPERATURE_KEYS:
        try:
            value = float(header[key])
        except (KeyError, ValueError):
            continue
        if isfinite(value):
            return value if value <= _WARMEST_C else value - _KELVIN
    return None


# Fields of a frame's record, and the keywords under which other programs write them.
_TEXTS = {"camera_model": ("INSTRUME", "CAMERA"), "filter_name": ("FILTER",)}
_PLACES = {
    "site_latitude_deg": ("SITELAT", "LATITUDE"),
    "site_longitude_deg": ("SITELONG", "LONGITUD"),
    "site_elevation_m": ("SITEELEV", "ALTITUDE"),
}
_LONGEST_TEXT = 60


def origin_of(header: Header) -> dict[str, Any]:
    """Return camera, filter and place by a header, under the names of a frame's record."""
    found: dict[str, Any] = {}
    for field, keys in _TEXTS.items():
        texts = [str(header.get(key, "")).strip() for key in keys]
        if text := next(filter(None, texts), ""):
            found[field] = text.encode("ascii", "replace").decode()[:_LONGEST_TEXT]
    for field, keys in _PLACES.items():
        numbers = [header.get(key) for key in keys]
        number = next((one for one in numbers if isinstance(one, int | float) and isfinite(one)), None)
        if number is not None:
            found[field] = float(number)
    return found


def reads_of(header: Header) -> tuple[int, bool, str]:
    """Return the number of reads of a frame, True if it is their sum, and the keyword; 1 without a keyword."""
    for key in (*_SUM_KEYS, *_MEAN_KEYS):
        value = header.get(key)
        if isinstance(value, int | float) and value > 1 and float(value).is_integer():
            return int(value), key in _SUM_KEYS, key
    return 1, False, ""


# One-based, both ends included, the first row of the file is 1.
_SECTION = re.compile(r"\[(\d+):(\d+),(\d+):(\d+)\]")
_OVERSCAN_KEY, _LIT_KEYS = "BIASSEC", ("TRIMSEC", "DATASEC")


def sections_of(
    header: Header, shape: tuple[int, int]
) -> tuple[tuple[slice, slice] | None, tuple[slice, slice] | None, str]:
    """Return rows and columns that see light, those of the overscan, and the keyword of the first; None if not stated.

    NOAO keywords, https://noirlab.edu/science/documents/scidoc0434.
    """
    found = {key: _section(header, key, shape) for key in (*_LIT_KEYS, _OVERSCAN_KEY)}
    key = next((key for key in _LIT_KEYS if found[key] is not None), "")
    return found.get(key), found[_OVERSCAN_KEY], key


def _section(header: Header, key: str, shape: tuple[int, int]) -> tuple[slice, slice] | None:
    match = _SECTION.fullmatch(str(header.get(key, "")).replace(" ", ""))
    if match is None:
        return None
    left, right, first, last = map(int, match.groups())
    if not (1 <= left <= right <= shape[1] and 1 <= first <= last <= shape[0]):
        size = f"{shape[1]} x {shape[0]}"
        raise ConfigError(
            f"{key} = {header[key]} does not lie within the picture of {size} pixels: correct or delete it"
        )
    return slice(first - 1, last), slice(left - 1, right)


def key_of_all(keys: Sequence[str], headers: Sequence[Header]) -> str | None:
    """Return the first keyword under which every header has a number of 0 or more; None where there is none."""
    for key in keys:
        values = [header.get(key) for header in headers]
        if values and all(isinstance(one, int | float) and not isinstance(one, bool) and one >= 0 for one in values):
            return key
    return None


_ANGLE = re.compile(r"([-+]?[0-9]*\.?[0-9]+)\s*(?:deg|degrees?|°)?", re.IGNORECASE)


def stated_angles(
    option: str,
    stated: Sequence[float | str],
    pictures: Sequence[tuple[int, Path, Header]],
    *,
    files: int,
    is_whole: bool = True,
) -> tuple[float, ...]:
    """Return the angle of each picture by what an option states: numbers, a header keyword, or a CSV table [deg].

    A picture is the number of its file, its name, and its header. Numbers are one for each file, or for each picture if
    all files could be read (`is_whole`).
    """
    words = [one for one in stated if isinstance(one, str)]
    if len(stated) == 1 and words:
        if words[0].lower().endswith(".csv"):
            return _angles_of_table(Path(words[0]), option, [path for _, path, _ in pictures])
        return tuple(_angle_of_header(header, option, words[0], path) for _, path, header in pictures)
    if words:
        raise ConfigError(f"{option}: {words[0]!r} is not a number of degrees")
    angles = [float(one) for one in stated]
    if not all(map(isfinite, angles)):
        raise ConfigError(f"{option}: every angle must be a finite number of degrees")
    if len(angles) == files:
        return tuple(angles[number] for number, _, _ in pictures)
    if is_whole and len(angles) == len(pictures):
        return tuple(angles)
    if is_whole and len(pictures) > files:
        raise ConfigError(
            f"{option}: {len(angles)} angles for {files} files of {len(pictures)} pictures; give one for each file, or "
            "for each picture"
        )
    raise ConfigError(
        f"{option}: {len(angles)} angles for {files} file{'s' if files > 1 else ''}; give one for each file"
    )


def _angle_of_header(header: Header, option: str, key: str, path: Path) -> float:
    try:
        text = str(value_of(header, option, key)).strip()
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    match = _ANGLE.fullmatch(text)
    if match is None:
        raise ConfigError(
            f"{path}: {option} {key}: {text!r} is not an angle in degrees; say --angles or --stage-angles"
        )
    return float(match[1])


def value_of(header: Header, option: str, key: str) -> HeaderValue:
    """Return the value of a keyword that an option names; ConfigError if the header lacks it."""
    if key.upper() not in header:
        has = f"its header has {', '.join(sorted(filter(None, header)))}" if header else "it has no header"
        raise ConfigError(f"{option} {key}: not in this file; {has}")
    return header[key.upper()]


def _angles_of_table(table: Path, option: str, paths: Sequence[Path]) -> tuple[float, ...]:
    """Return the angles of pictures by the names of their files in a table, those of stacks with or without number."""
    column = f"{option.removeprefix('--').removesuffix('s').replace('-', '_')}_deg"
    try:
        found = {name_of(Path(str(row["file"]).strip())): float(row[column] or "") for row in csv_rows(table)}
    except (KeyError, ValueError) as error:
        raise ConfigError(f"{table}: needs the columns file and {column}, a number of degrees ({error})") from error
    if not found or not all(map(isfinite, found.values())):
        raise ConfigError(f"{table}: has to have a row with a finite angle for each file")
    names = [name_of(path) for path in paths]
    rows = [name if name in found else name.rpartition("[")[0] for name in names]
    without = [name for name, row in zip(names, rows, strict=True) if row not in found]
    if without:
        raise ConfigError(f"{option} {table}: has no row for the file {', '.join(without[:3])}")
    return tuple(found[row] for row in rows)


def angles_of(pictures: Sequence[tuple[Path, Header]]) -> tuple[tuple[float, ...], str]:
    """Return the angle of each picture by its header or name [deg], and the source; ConfigError if both lack it."""
    names, headers = [name_of(path) for path, _ in pictures], [header for _, header in pictures]
    for key in ANGLE_KEYS:
        values = [_angle_text(header, key) for header in headers]
        if all(values):
            return tuple(map(float, values)), f"by the header keyword {key}"
    retarders = [_angle_text(header, RETARDER_KEY) for header in headers]
    if all(retarders) and len({2.0 * float(one) % 180.0 for one in retarders}) >= _LEAST_ANGLES:
        by = f"by twice the header keyword {RETARDER_KEY}, as of a half-wave plate before a fixed polarizer"
        return tuple(2.0 * float(one) for one in retarders), by
    numbers = [_NUMBER.findall(name.rpartition(".")[0] or name) for name in names]
    # Names of one set have the same numbers at the same places; places are counted from the end.
    columns = [[found[-place] for found in numbers] for place in range(1, min(map(len, numbers), default=0) + 1)]
    likely = sorted(filter(_is_of_angles, columns), key=lambda column: not all(deg for _, _, deg in column))
    if not likely:
        hint = ""
        if any(RETARDER_KEY in header for header in headers):
            hint = f" ({RETARDER_KEY} is there: a half-wave plate turns the axis by twice its angle)"
        for key in ANGLE_KEYS:
            without = [name for name, header in zip(names, headers, strict=True) if not _angle_text(header, key)]
            if len(without) < len(names):
                hint = f" ({key} says no angle of {', '.join(without[:3])}: leave files without a polarizer out)"
        raise ConfigError(
            f"neither headers nor names say the polarizer angles of {', '.join(names[:4])}{hint}; say "
            "--angles 0,45,... or --mosaic A,B,C,D"
        )
    return tuple(float(sign + size) for sign, size, _ in likely[0]), "by the names of the files"


def _angle_text(header: Header, key: str) -> str:
    """Return the number that a keyword's value begins with; empty where there is none."""
    found = re.match(r"[-+]?\d*\.?\d+", str(header.get(key, "")).strip())
    return found[0] if found else ""


def _is_of_angles(column: Sequence[tuple[str, str, str]]) -> bool:
    """Return True if numbers at one place of the names are angles, by their values or units, and not a counter."""
    values = [float(sign + size) for sign, size, _ in column]
    distinct = sorted({value % 180.0 for value in values})
    if len(distinct) < _LEAST_ANGLES or max(map(abs, values)) > 360.0:
        return False
    return all(deg for _, _, deg in column) or min(b - a for a, b in pairwise(distinct)) > 1.0
