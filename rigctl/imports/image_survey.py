"""A first look at every image that is to be imported: its size, its header's answers, its counts."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.processing.jpeg_traces import jpeg_traces
from rigctl.errors import ConfigError, DataError
from rigctl.images.image_file import FirstRow, ImageFile, read_image
from rigctl.images.raw_image import HeaderValue, RawSettings, unlike_settings
from rigctl.imports.image_border import Border, constant_border
from rigctl.imports.image_levels import LEVELS, histogram
from rigctl.imports.import_request import ImportRequest
from rigctl.numbers.utc_time import is_utc_text

_ANGLE = re.compile(r"([-+]?[0-9]*\.?[0-9]+)\s*(?:deg|degrees?|°)?", re.IGNORECASE)
_FITS_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?")


@dataclass(frozen=True, kw_only=True)
class SurveyedImage:
    """One file, as far as it is known before anything is written.

    Attributes
    ----------
    path : Path
        The file.
    shape : (height, width)
        Its size.
    sample_bits : {8, 16}
        Bits that a sample takes in the file.
    first_row : {"top", "bottom"}
        Which row comes first in it.
    angle_deg, exposure_s, black_level_dn : float or None
        From the user or the header.
    start_utc : str or None
        Start of the exposure, where the header has it in standard form.
    remarks : tuple of str
        What else one has to know of the file.
    raw : RawSettings or None
        How a still camera was set.
    levels : (65536,) array of int
        How many of its pixels have each count.
    border : Border or None
        Constant pixels along its edges.
    is_jpeg : bool
        Its blocks of 8 x 8 pixels show that it went through JPEG.
    """

    path: Path
    shape: tuple[int, int]
    sample_bits: int
    first_row: FirstRow
    angle_deg: float | None
    exposure_s: float | None
    black_level_dn: float | None
    start_utc: str | None
    remarks: tuple[str, ...]
    raw: RawSettings | None
    levels: NDArray[np.int64] = field(repr=False)
    border: Border | None = None
    is_jpeg: bool = False


@dataclass(frozen=True, kw_only=True)
class Survey:
    """All files, as far as they are known.

    Attributes
    ----------
    images : tuple of SurveyedImage
        The files that could be read.
    levels : (65536,) array of int
        How many pixels of all images together have each count.
    unsaid : tuple of str
        What the command line would have to say (exit 2).
    unfit : tuple of str
        What is wrong with the files (exit 4).
    """

    images: tuple[SurveyedImage, ...]
    levels: NDArray[np.int64]
    unsaid: tuple[str, ...]
    unfit: tuple[str, ...]


def survey_images(request: ImportRequest) -> Survey:
    """Return what all files say, and every problem of theirs."""
    images: list[SurveyedImage] = []
    levels = np.zeros(LEVELS, dtype=np.int64)
    unsaid: list[str] = []
    unfit: list[str] = []
    for index, path in enumerate(request.files):
        try:
            image = read_image(path, plane=request.plane, most_bytes=request.most_bytes)
            images.append(_survey(request, index, image))
            levels += images[-1].levels
        except DataError as error:
            unfit.append(f"{path}: {error}")
        except ConfigError as error:
            unsaid.append(f"{path}: {error}")
    unfit += _size_problems(request, images)
    stack = [(image.path, image.raw) for image in images if image.raw is not None]
    unfit += unlike_settings(stack, same_exposure=request.same_exposure)
    return Survey(images=tuple(images), levels=levels, unsaid=tuple(unsaid), unfit=tuple(unfit))


def _survey(request: ImportRequest, index: int, image: ImageFile) -> SurveyedImage:
    return SurveyedImage(
        path=request.files[index],
        shape=(image.counts.shape[0], image.counts.shape[1]),
        sample_bits=image.sample_bits,
        first_row=_first_row(request, image),
        angle_deg=_angle(request, index, image.header),
        exposure_s=_number(image.header, "--exposure-key", request.exposure_key, request.exposure_s),
        black_level_dn=_number(image.header, "--black-level-key", request.black_level_key, request.black_level_dn),
        start_utc=_start(image.header),
        remarks=image.remarks,
        raw=image.raw,
        levels=histogram(image.counts),
        border=None if request.no_border_search else constant_border(image.counts),
        is_jpeg=_is_jpeg(image.counts),
    )


def _is_jpeg(counts: NDArray[np.uint16]) -> bool:
    found = jpeg_traces(counts)
    return found is not None and found.is_found


def _first_row(request: ImportRequest, image: ImageFile) -> FirstRow:
    if request.first_row is None or request.first_row == image.first_row:
        return image.first_row
    if image.first_row_stated:
        raise ConfigError(f"--first-row {request.first_row}: the file itself says {image.first_row}")
    return request.first_row


def _angle(request: ImportRequest, index: int, header: Mapping[str, HeaderValue]) -> float | None:
    if request.angle_key is not None:
        text = str(_header_value(header, "--angle-key", request.angle_key)).strip()
        match = _ANGLE.fullmatch(text)
        if match is None:
            raise ConfigError(f"--angle-key {request.angle_key}: {text!r} is no angle in degrees; say --angles")
        return float(match[1])
    angles = request.angles_deg or ()
    return angles[index] if index < len(angles) else None


def _number(header: Mapping[str, HeaderValue], option: str, key: str | None, given: float | None) -> float | None:
    if key is None:
        return given
    value = _header_value(header, option, key)
    if isinstance(value, bool) or not isinstance(value, int | float) or value < 0:
        raise ConfigError(f"{option} {key}: {value!r} is no number of 0 or more")
    return float(value)


def _header_value(header: Mapping[str, HeaderValue], option: str, key: str) -> HeaderValue:
    if key.upper() not in header:
        has = f"its header has {', '.join(sorted(filter(None, header)))}" if header else "it has no header"
        raise ConfigError(f"{option} {key}: not in this file; {has}")
    return header[key.upper()]


def _start(header: Mapping[str, HeaderValue]) -> str | None:
    text = str(header.get("DATE-OBS", ""))
    is_utc = str(header.get("TIMESYS", "UTC")).strip().upper() == "UTC"
    return f"{text}Z" if is_utc and _FITS_TIME.fullmatch(text) and is_utc_text(text) else None


def _size_problems(request: ImportRequest, images: list[SurveyedImage]) -> list[str]:
    problems = []
    for image in images:
        if image.shape != images[0].shape:
            problems.append(f"{image.path}: {_size(image)} pixels, but {images[0].path} has {_size(images[0])}")
        if request.mosaic_deg is not None and (image.shape[0] % 2 or image.shape[1] % 2):
            problems.append(f"{image.path}: {_size(image)} pixels cannot be cut into cells of 2 x 2 (--mosaic)")
    return problems


def _size(image: SurveyedImage) -> str:
    return f"{image.shape[1]} x {image.shape[0]}"
