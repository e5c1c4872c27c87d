"""Images that other programs or cameras wrote (FITS, PNG, TIFF, RAW), read as whole numbers of counts."""

import errno
import gzip
import io
import math
import warnings
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.cameras.raw_files import RAW_SUFFIXES
from drivers.cameras.raw_planes import Plane
from rigctl.errors import ConfigError, DataError
from rigctl.images.declared_size import png_bytes, require_size, tiff_bytes
from rigctl.images.raw_image import HeaderValue, RawSettings, raw_header, raw_picture, raw_settings
from rigctl.images.unfiltered_png import unfiltered_png
from rigctl.storage.bounded_file import MOST_FRAME_BYTES, read_bounded

FirstRow = Literal["top", "bottom"]

# Of the remark on a header's checksum.
STALE = "its CHECKSUM is stale while the DATASUM of its samples holds"
_GZIP = b"\x1f\x8b"
_FITS = b"SIMPLE  ="
_PNG = b"\x89PNG\r\n\x1a\n"
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
# What a file may have beside its samples.
_MOST_HEADER_BYTES = 10_000_000
_LARGER = "; --max-frame-mb N says how large a picture may be"
_LARGEST = 65535
_ROW_ORDERS: dict[str, FirstRow] = {"TOP-DOWN": "top", "BOTTOM-UP": "bottom"}


@dataclass(frozen=True, kw_only=True)
class ImageFile:
    """An image as its file has it.

    Attributes
    ----------
    counts : (H, W) array of uint16
        Samples, rows in the order of the file.
    sample_bits : {8, 16}
        Bits that a sample takes in the file; a camera may fill fewer of them.
    first_row : {"top", "bottom"}
        Which row comes first, as the file says or as its format has it.
    first_row_stated : bool
        The file itself says so.
    header : mapping
        Value by keyword; empty where the format has none.
    remarks : tuple of str
        What else one has to know of the file.
    raw : RawSettings or None
        How a still camera was set; None for what is no RAW file.
    """

    counts: NDArray[np.uint16]
    sample_bits: int
    first_row: FirstRow
    first_row_stated: bool
    header: Mapping[str, HeaderValue]
    remarks: tuple[str, ...] = ()
    raw: RawSettings | None = None


@dataclass(frozen=True, kw_only=True)
class ImageReading:
    """How files of images are read: which colour of RAW files, and how many bytes of samples one may have."""

    plane: Plane | None = None
    most_bytes: int = MOST_FRAME_BYTES


def read_image(path: Path, *, plane: Plane | None = None, most_bytes: int = MOST_FRAME_BYTES) -> ImageFile:
    """Return the image of a file.

    Parameters
    ----------
    path : Path
        A FITS file (its first image is taken), a PNG or TIFF file of one grey picture, or a camera's RAW file.
    plane : str or None
        Which colour of a RAW file.
    most_bytes : int
        A picture whose header declares more bytes of samples, and a file that has or unpacks to more, is refused before
        memory is taken for it.

    Raises
    ------
    DataError
        The file cannot be read, is too large, is no such image, is damaged, has colours or several pictures, or
        samples that are not whole numbers from 0 to 65535.
    ConfigError
        A colour is said and the file is not RAW, or the other way round.
    """
    if path.suffix.lower() in RAW_SUFFIXES:
        return _read_raw(path, plane, most_bytes)
    if plane is not None:
        raise ConfigError(f"--plane {plane}: is for RAW files of cameras, which this is not")
    try:
        data = read_bounded(path, most_bytes + _MOST_HEADER_BYTES)
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}{_LARGER if error.errno == errno.EFBIG else ''}") from error
    if data.startswith(_GZIP):
        data = _uncompressed(data, most_bytes + _MOST_HEADER_BYTES)
    if data.startswith(_FITS):
        return _read_fits(data, most_bytes)
    if data.startswith(_PNG):
        return _read_png(data, most_bytes)
    if data.startswith(_TIFF):
        return _read_tiff(data, most_bytes)
    raise DataError("is no FITS, PNG, TIFF or RAW image; other formats have to be converted without loss first")


def _read_raw(path: Path, plane: Plane | None, most_bytes: int) -> ImageFile:
    if path.is_file():
        # Stored samples are packed twofold at most; LibRaw bounds the memory of the picture itself.
        require_size(path.stat().st_size, most_bytes)
    picture = raw_picture(path, plane=plane)
    white = f"white level {picture.white_level_dn} by its file, {picture.bit_depth} bits; a sensor may saturate below"
    return ImageFile(
        counts=picture.counts,
        sample_bits=16,
        first_row="top",
        first_row_stated=False,
        header=raw_header(picture),
        remarks=(white, f"plane {plane}") if plane else (white,),
        raw=raw_settings(picture),
    )


def _uncompressed(data: bytes, most_bytes: int) -> bytes:
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as packed:
            plain = packed.read(most_bytes + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise DataError(f"is damaged: {error}") from error
    if len(plain) > most_bytes:
        raise DataError(f"unpacks to more than {most_bytes // 10**6} MB{_LARGER}")
    return plain


def _read_png(data: bytes, most_bytes: int) -> ImageFile:
    sample_bytes, bits = png_bytes(data)
    if bits < 8:
        raise DataError(f"has {bits} bits per sample, which is no camera's raw image")
    require_size(sample_bytes, most_bytes)
    plain = unfiltered_png(data)
    return _plain_image(_decoded(data)[0] if plain is None else plain)


def _read_tiff(data: bytes, most_bytes: int) -> ImageFile:
    require_size(tiff_bytes(data), most_bytes)
    pages = _decoded(data)
    if len(pages) > 1:
        raise DataError(f"holds {len(pages)} pictures; give one file for each")
    return _plain_image(pages[0])


def _decoded(data: bytes) -> Sequence[NDArray[Any] | None]:
    """Return the pictures of a PNG or TIFF file; one that is None where it cannot be read."""
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)  # not on each odd tag of a TIFF file
    try:
        _, pages = cv2.imdecodemulti(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DataError("is damaged, or larger than pictures can be") from error
    return pages or (None,)


def _plain_image(pixels: NDArray[Any] | None) -> ImageFile:
    if pixels is None:
        raise DataError("is damaged, or of a kind of PNG or TIFF that cannot be read")
    if pixels.ndim != 2:
        raise DataError(f"is a colour image ({pixels.shape[2]} channels); one grey picture is wanted")
    return ImageFile(
        counts=_whole_counts(pixels),
        sample_bits=_sample_bits(pixels),
        first_row="top",
        first_row_stated=False,
        header={},
    )


def _read_fits(data: bytes, most_bytes: int) -> ImageFile:
    header, pixels, images, is_stale = _first_fits_image(data, most_bytes)
    if pixels.ndim != 2:
        raise DataError(f"has {pixels.ndim} axes {pixels.shape}; give one file for each picture")
    stated = str(header.get("ROWORDER", "")).strip().upper()
    if stated and stated not in _ROW_ORDERS:
        raise DataError(f"ROWORDER is {stated!r}; known are {', '.join(_ROW_ORDERS)}")
    return ImageFile(
        counts=_whole_counts(pixels),
        sample_bits=_sample_bits(pixels),
        first_row=_ROW_ORDERS.get(stated, "bottom"),
        first_row_stated=bool(stated),
        header=header,
        remarks=(
            *((f"the first of {images} images of its file",) if images > 1 else ()),
            *((f"{STALE}: header keywords were changed after it was written",) if is_stale else ()),
        ),
    )


def _first_fits_image(data: bytes, most_bytes: int) -> tuple[dict[str, HeaderValue], NDArray[Any], int, bool]:
    from astropy.io import fits  # half a second, wanted for FITS only

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with fits.open(io.BytesIO(data), memmap=False, checksum=True) as units:
                # By the header: asking for the samples of a unit takes memory for them.
                images = [unit for unit in units if unit.is_image and unit.shape]
                require_size(max(map(_fits_bytes, images), default=0), most_bytes)
                header = {key: images[0].header[key] for key in set(images[0].header)} if images else {}
                pixels = images[0].data if images else None
        except DataError:
            raise
        except Exception as error:  # whatever astropy's own code trips over in a header that is spoilt
            raise DataError(f"is no FITS file that can be read: {error}") from error
    is_stale = _refuse_damage([str(warning.message) for warning in caught], has_datasum="DATASUM" in header)
    if pixels is None:
        raise DataError("is a FITS file without an image")
    return header, pixels, len(images), is_stale


def _fits_bytes(unit: Any) -> int:
    bits: int = abs(int(unit.header["BITPIX"]))
    return math.prod(map(int, unit.shape)) * bits // 8


def _refuse_damage(messages: list[str], *, has_datasum: bool) -> bool:
    """Return whether the checksum of the header fails while that of the data holds; refuse what is damaged."""
    # Headers are often untidy, and astropy says so; what matters here is whether the samples are what was written.
    failed = [text for text in messages if "verification failed" in text]
    of_data = [text for text in failed if text.startswith("Datasum")]
    is_stale = bool(failed) and has_datasum and not of_data
    damage = [text for text in messages if "truncated" in text] + ([] if is_stale else failed)
    if damage:
        raise DataError(f"is damaged: {' '.join(dict.fromkeys(damage))}")
    return is_stale


def _sample_bits(pixels: NDArray[Any]) -> int:
    return 8 if pixels.dtype.itemsize == 1 else 16


def _whole_counts(pixels: NDArray[Any]) -> NDArray[np.uint16]:
    if pixels.size == 0:
        raise DataError("has no pixels")
    if pixels.dtype.kind == "f":
        _refuse_fractions(pixels)
    low, high = pixels.min(), pixels.max()
    if low < 0 or high > _LARGEST:
        raise DataError(f"samples run from {low:g} to {high:g}; raw counts lie between 0 and {_LARGEST}")
    return np.ascontiguousarray(pixels, dtype=np.uint16)


def _refuse_fractions(pixels: NDArray[Any]) -> None:
    unset = int(np.count_nonzero(~np.isfinite(pixels)))
    if unset:
        raise DataError(f"{unset} samples are NaN or infinite; give missing pixels a count and name it: --missing-dn")
    broken = int(np.count_nonzero(pixels != np.floor(pixels)))
    if broken:
        raise DataError(f"{broken} samples are not whole numbers: this is no raw image, but one that was worked on")
