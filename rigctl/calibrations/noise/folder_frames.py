"""Dark and flat frames out of a folder of images: kind and exposure from names and headers."""

import hashlib
import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.results import refused
from calibration.sensor.curves import StatedExposures
from calibration.sensor.levels import LevelKind
from drivers.cameras.raw_files import RAW_SUFFIXES
from rigctl.calibrations.made_for import MadeFor
from rigctl.calibrations.noise.noise_frames import CameraSetting, FrameGroup, FrameSet, FrameSource, files_digest
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import SECONDS_PER_UNIT, ExposureUnit
from rigctl.images.image_file import ImageReading, read_image
from rigctl.images.raw_image import HeaderValue

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
    """An image and what is known of it.

    Attributes
    ----------
    path : Path
        File.
    kind : {"dark", "flat"}
        Without light, or with even light.
    exposure_s : float or None
        Exposure time [s].
    photons : float or None
        Mean photons a pixel, where somebody measured them.
    level : str
        Frames of one kind and exposure with another level are of another light.
    """

    path: Path
    kind: LevelKind
    exposure_s: float | None
    photons: float | None
    level: str


def folder_frames(
    folder: Path, *, bit_depth: int, reading: ImageReading = _PLAIN, exposure_unit: ExposureUnit | None = None
) -> FrameSet:
    """Return the dark and flat frames of a folder of images, subfolders included.

    Parameters
    ----------
    folder : Path
        PNG, TIFF, FITS or RAW files. Whether one is dark or flat is a word of its path (dark, bias, flat, bright,
        light) or, in FITS, ``IMAGETYP``. Its exposure stands in its path as a number with ns, us, ms or s, or in the
        header as ``EXPTIME``. Flats of one exposure in different subfolders are of different light.
    bit_depth : int
        Bits per sample of the camera.
    reading : ImageReading
        Which colour of RAW files, and how large a picture may be.
    exposure_unit : str or None
        Unit of exposures in headers, and of numbers in names that have none, such as ``exp000522``.

    Raises
    ------
    ConfigError
        There are none, or it cannot be told what some are: every problem at once.
    RefusedFramesError
        Some are compressed with loss.
    """
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
    """Return a set of frames from images of which all is known.

    Parameters
    ----------
    images : sequence of ListedImage
        In the order in which they were taken, within a level.
    bit_depth : int
        Bits per sample of the camera.
    reading : ImageReading
        Which colour of RAW files, and how large a picture may be.
    source : callable
        Makes the source, given ``frames_sha256``.
    stated : StatedExposures
        Where the exposures are from.
    """
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
