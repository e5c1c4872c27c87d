"""Images that other programs or cameras wrote: FITS, PNG, TIFF, JPEG, camera RAW, and arrays in HDF5 and NetCDF files.

`read_images` yields the pictures of a file: one, or those of a stack. Samples are unsigned 16 bit counts where these
hold them, and in double precision otherwise: sums of many reads, means, and counts below 0. An array in a file of many
is named by its place in it, as in ``file.h5:/entry/data``, and a picture of a stack by its number, ``cube.fits[3]``.

A header may declare more than a machine holds: the size is found before memory is taken. Grey PNG files whose rows are
stored as they are, which many cameras' programs write, are read at the speed of zlib.
"""

import errno
import gzip
import io
import math
import re
import struct
import warnings
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.cameras.raw_files import RAW_SUFFIXES, RawPicture, read_raw
from drivers.cameras.raw_planes import Plane
from drivers.errors import LimitError, ProtocolError
from rigctl.base.durable import MOST_FRAME_BYTES, open_plain, read_bounded
from rigctl.errors import ConfigError, DataError

_BYTES_PER_MB = 1_000_000
_PNG_HEADER = struct.Struct(">II")
_PNG_HEADER_START, _PNG_HEADER_END = 16, 33
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
# Tags of a TIFF directory, and bytes of the types that sizes come in.
_WIDTH, _HEIGHT, _BITS, _SAMPLES, _PLANAR = 256, 257, 258, 277, 284
_SEPARATE = 2
_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}
_MOST_PICTURES = 1000


def require_size(sample_bytes: int, most_bytes: int) -> None:
    """Refuse a picture whose samples take more memory than is allowed."""
    if sample_bytes > most_bytes:
        raise DataError(
            f"would take {sample_bytes / _BYTES_PER_MB:.4g} MB by its header, and at most "
            f"{most_bytes / _BYTES_PER_MB:.4g} MB are read; say --max-frame-mb N if it really is that large"
        )


def png_bytes(data: bytes) -> tuple[int, int]:
    """Return bytes of all samples, and bits a sample, of a PNG file.

    W3C, Portable Network Graphics (PNG) Specification, third edition, section 11.2.1.
    """
    if len(data) < _PNG_HEADER_END:
        raise DataError(f"is damaged: its {len(data)} bytes end within the header of a PNG file")
    width, height = _PNG_HEADER.unpack_from(data, _PNG_HEADER_START)
    bits, colour = data[24], data[25]
    if not width or not height:
        raise DataError(f"has {width} x {height} pixels")
    return width * height * _PNG_CHANNELS.get(colour, 4) * max(1, bits // 8), bits


def tiff_bytes(data: bytes) -> tuple[int, bool]:
    """Return bytes of all samples of a TIFF or BigTIFF file, and whether planes of a picture stand one after another.

    Adobe, TIFF revision 6.0, section 2; Aware Systems, The BigTIFF file format proposal.
    """
    try:
        directories = list(_directories(data))
    except struct.error as error:
        raise DataError("is damaged: a directory of a TIFF file lies outside of the file") from error
    is_planar = any(one.get(_SAMPLES, 1) > 1 and one.get(_PLANAR) == _SEPARATE for one in directories)
    return sum(map(_directory_bytes, directories)), is_planar


def _directory_bytes(entries: dict[int, int]) -> int:
    if not entries.get(_WIDTH) or not entries.get(_HEIGHT):
        raise DataError("is damaged: a picture of a TIFF file without width or height")
    samples = entries[_WIDTH] * entries[_HEIGHT] * max(1, entries.get(_SAMPLES, 1))
    return samples * max(1, entries.get(_BITS, 8) // 8)


def _directories(data: bytes) -> Iterator[dict[int, int]]:
    order = "<" if data.startswith(b"I") else ">"
    big = data[2:4] in (b"+\0", b"\0+")
    pointer = order + ("Q" if big else "I")
    (place,) = struct.unpack_from(pointer, data, 8 if big else 4)
    seen: set[int] = set()
    while place:
        if place in seen or len(seen) >= _MOST_PICTURES:
            raise DataError(f"is damaged: its pictures come round in a circle, or are more than {_MOST_PICTURES}")
        seen.add(place)
        entries, place = _directory(data, place, order, pointer, big=big)
        yield entries


def _directory(data: bytes, place: int, order: str, pointer: str, *, big: bool) -> tuple[dict[int, int], int]:
    (count,) = struct.unpack_from(order + ("Q" if big else "H"), data, place)
    place += 8 if big else 2
    size = 20 if big else 12
    if place + count * size > len(data):
        raise DataError("is damaged: a directory of a TIFF file lies outside of the file")
    entries: dict[int, int] = {}
    for start in range(place, place + count * size, size):
        tag, kind = struct.unpack_from(order + "HH", data, start)
        if tag in (_WIDTH, _HEIGHT, _BITS, _SAMPLES, _PLANAR) and kind in _TYPES:
            entries[tag] = _value(data, start, order, pointer, _TYPES[kind], big=big)
    (following,) = struct.unpack_from(pointer, data, place + count * size)
    return entries, following


def _value(data: bytes, start: int, order: str, pointer: str, kind: str, *, big: bool) -> int:
    """Return the first number of an entry: it stands in the entry, or, of several, where the entry points."""
    (count,) = struct.unpack_from(pointer, data, start + 4)
    place = start + (12 if big else 8)
    if count * struct.calcsize(kind) > (8 if big else 4):
        (place,) = struct.unpack_from(pointer, data, place)
    (value,) = struct.unpack_from(order + kind, data, place)
    return int(value)


# Values of FITS cards, or of the facts that a RAW file contains.
HeaderValue = str | float | bool
EXPOSURE, ISO, BLACK, WHITE, FLIP = "EXPTIME", "ISO", "BLACK", "WHITE", "FLIP"
# Cameras round the exposure that they write; a third of a stop is 26 %.
_EXPOSURE_TOLERANCE = 0.02


def raw_picture(path: Path, *, plane: Plane | None) -> RawPicture:
    """Return a RAW file's picture."""
    try:
        return read_raw(path, plane=plane)
    except LimitError as error:
        raise ConfigError(f"--plane: {_without_path(path, error)}") from error
    except ProtocolError as error:
        raise DataError(_without_path(path, error)) from error


def raw_header(picture: RawPicture) -> dict[str, HeaderValue]:
    """Return the facts of a RAW file under the keywords that ``--exposure-key`` and ``--black-level-key`` may name."""
    facts: dict[str, HeaderValue | None] = {
        EXPOSURE: picture.exposure_s,
        ISO: picture.iso,
        BLACK: picture.black_level_dn,
        WHITE: picture.white_level_dn,
        FLIP: picture.flip,
    }
    return {name: value for name, value in facts.items() if value is not None}


def unlike_settings(stack: Sequence[tuple[Path, Mapping[str, HeaderValue]]], *, same_exposure: bool) -> list[str]:
    """Return settings that differ between the first RAW file and the others and must be equal."""
    problems = []
    for path, header in stack[1:]:
        first_path, first = stack[0]
        if header.get(ISO) != first.get(ISO):
            problems.append(
                f"{path}: ISO {header.get(ISO)}, but {first_path} has {first.get(ISO)}: one gain for all is needed"
            )
        if header[FLIP] != first[FLIP]:
            problems.append(f"{path}: the camera was held another way than for {first_path}")
        exposures_s = header.get(EXPOSURE), first.get(EXPOSURE)
        if same_exposure and not _alike(*exposures_s):
            problems.append(
                f"{path}: exposed {exposures_s[0]} s and {first_path} {exposures_s[1]} s: not --same-exposure, "
                f"but --exposure-key {EXPOSURE}"
            )
    return problems


def _alike(one_s: HeaderValue | None, other_s: HeaderValue | None) -> bool:
    if not isinstance(one_s, float) or not isinstance(other_s, float):
        return one_s == other_s
    return abs(one_s - other_s) <= _EXPOSURE_TOLERANCE * other_s


def _without_path(path: Path, error: Exception) -> str:
    return str(error).removeprefix(f"{path}: ")


_SIGNATURE_SIZE = 8
_CHUNK_FRAME_SIZE = 12  # length, name and checksum
_ZLIB_HEADER, _ZLIB_CHECKSUM = 2, 4
_DICTIONARY = 0x20
_HEADER = struct.Struct(">IIBBBBB")
# Grey; deflate; adaptive filters; not interlaced.
_PLAIN = (0, 0, 0, 0)


def unfiltered_png(data: bytes) -> NDArray[np.uint16] | NDArray[np.uint8] | None:
    """Return the samples of a grey PNG file of 8 or 16 bits whose rows have no filter; None for any other.

    W3C, Portable Network Graphics (PNG) Specification, third edition.
    """
    try:
        layout, packed = _parts(data)
    except (struct.error, ValueError):
        return None
    if layout is None or len(packed) < _ZLIB_HEADER:
        return None
    width, height, sample_bytes = layout
    row_bytes = 1 + width * sample_bytes  # with its filter's byte
    raw = _inflated(packed, height * row_bytes)
    if raw is None:
        return None
    rows = np.frombuffer(raw, np.uint8).reshape(height, row_bytes)
    if rows[:, 0].any():
        return None
    samples = rows[:, 1:]
    return np.ascontiguousarray(samples) if sample_bytes == 1 else samples.view(">u2").astype(np.uint16)


def _inflated(packed: bytes, size: int) -> bytes | None:
    """Return the content of a zlib stream of rows; None if its size is different, or the first row has a filter.

    Its own checksum is skipped: those of the chunks cover the same bytes and were right.
    """
    method, flags = packed[0], packed[1]
    if method & 0x0F != zlib.DEFLATED or flags & _DICTIONARY or (method << 8 | flags) % 31:
        return None
    unpacker = zlib.decompressobj(-zlib.MAX_WBITS)
    try:
        # Most files have a filter in the first row, and need not be unpacked twice.
        first = unpacker.decompress(memoryview(packed)[_ZLIB_HEADER:], 1)
        if first != b"\0":
            return None
        # One byte too many is requested, to make sure that the stream ends.
        raw = first + unpacker.decompress(unpacker.unconsumed_tail, size)
    except zlib.error:
        return None
    whole = len(raw) == size and unpacker.eof and len(unpacker.unused_data) == _ZLIB_CHECKSUM
    return raw if whole else None


def _parts(data: bytes) -> tuple[tuple[int, int, int] | None, bytes]:
    """Return width, height and bytes of a sample, None where the layout is not plain, and the packed rows."""
    layout, packed = None, []
    for name, content in _chunks(data):
        if name == b"IHDR":
            layout = _layout(content)
        elif name == b"IDAT":
            packed.append(content)
        elif name in (b"PLTE", b"tRNS"):
            return None, b""
    return layout, b"".join(packed)


def _layout(content: memoryview) -> tuple[int, int, int] | None:
    width, height, bits, *rest = _HEADER.unpack(content)
    if tuple(rest) != _PLAIN or bits not in (8, 16):
        return None
    return width, height, bits // 8


def _chunks(data: bytes) -> list[tuple[bytes, memoryview]]:
    view, place, found = memoryview(data), _SIGNATURE_SIZE, []
    while place < len(data):
        (length,) = struct.unpack_from(">I", data, place)
        name = data[place + 4 : place + 8]
        content = view[place + 8 : place + 8 + length]
        (checksum,) = struct.unpack_from(">I", data, place + 8 + length)
        if zlib.crc32(view[place + 4 : place + 8 + length]) != checksum:
            raise ValueError(f"chunk {name!r} is damaged")
        found.append((name, content))
        place += length + _CHUNK_FRAME_SIZE
    return found


FirstRow = Literal["top", "bottom"]
_SUFFIXES = (".png", ".tif", ".tiff", ".fits", ".fit", ".fts", ".fz", ".gz", ".jpg", ".jpeg")
_COLOURS: tuple[Plane, ...] = ("red", "green", "blue")

# How remarks begin: on a file of several images, and on a header's checksum.
FIRST_OF = "the first of"
STALE = "its CHECKSUM is stale while the DATASUM of its samples holds"
_GZIP = b"\x1f\x8b"
_FITS = b"SIMPLE  ="
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
LOSSY = (
    "is compressed with loss and went through a tone curve, so that its counts are not the light: save raw frames as "
    "PNG, TIFF or FITS (rigctl look shows this one, uncalibrated)"
)
# Largest part of a file that is not samples.
_MOST_HEADER_BYTES = 10_000_000
_LARGER = "; --max-frame-mb N says how large a picture may be"
_LARGEST = 65535
_ROW_ORDERS: dict[str, FirstRow] = {"TOP-DOWN": "top", "BOTTOM-UP": "bottom"}


@dataclass(frozen=True, kw_only=True)
class ImageFile:
    """A picture as its file has it."""

    path: Path = Path()  #: Its file; of a stack with the number of the picture.
    counts: NDArray[Any]  #: Samples, rows in the order of the file: of 16 bits without sign, or in double precision.
    sample_bits: int  #: Bits that a sample takes in the file; a camera may fill fewer of them.
    first_row: FirstRow  #: Which row comes first, as the file says or as its format has it.
    first_row_stated: bool  #: The file itself says so.
    header: Mapping[str, HeaderValue]  #: Value by keyword; empty where the format has none.
    remarks: tuple[str, ...] = ()  #: Further facts about the file.
    #: Samples that are NaN or infinite; their counts are the least of the others.
    unset: NDArray[np.bool_] | None = None
    is_lossy: bool = False  #: It was compressed with loss, and its samples went through a tone curve.

    @property
    def raw_counts(self) -> NDArray[np.uint16]:
        """The samples of one read of a camera; DataError if they are sums, means, below 0, or no numbers."""
        if self.is_lossy:
            raise DataError(LOSSY)
        if self.unset is not None:
            raise DataError(f"{np.count_nonzero(self.unset)} samples are NaN or infinite")
        if self.counts.dtype == np.uint16:
            return np.asarray(self.counts, dtype=np.uint16)
        broken = int(np.count_nonzero(self.counts != np.floor(self.counts)))
        if broken:
            raise DataError(f"{broken} samples are not whole numbers: this is a processed image, not a raw one")
        low, high = self.counts.min(), self.counts.max()
        raise DataError(f"samples run from {low:g} to {high:g}; raw counts lie between 0 and {_LARGEST}")


@dataclass(frozen=True, kw_only=True)
class ImageReading:
    """Options for reading image files."""

    plane: Plane | None = None  #: of colour images and RAW files
    most_bytes: int = MOST_FRAME_BYTES  #: of the samples of a file
    is_cut: bool = True  #: to TRIMSEC or DATASEC of the header


def read_image(path: Path, *, plane: Plane | None = None, most_bytes: int = MOST_FRAME_BYTES) -> ImageFile:
    """Return the only picture of a file."""
    pictures = read_images(path, plane=plane, most_bytes=most_bytes)
    first = next(pictures)
    if next(pictures, None) is not None:
        raise DataError("holds several pictures; give one file for each")
    return first


def read_images(path: Path, *, plane: Plane | None = None, most_bytes: int = MOST_FRAME_BYTES) -> Iterator[ImageFile]:
    """Yield the pictures of a file: one, or those of a stack in their order, which are named by their number."""
    if path.suffix.lower() in RAW_SUFFIXES:
        yield replace(_read_raw(path, plane, most_bytes), path=path)
        return
    if path.suffix.lower() in _ARRAY_SUFFIXES or _ARRAY.fullmatch(str(path)):
        yield from _read_arrays(path, most_bytes)
        return
    try:
        data = read_bounded(path, most_bytes + _MOST_HEADER_BYTES)
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}{_LARGER if error.errno == errno.EFBIG else ''}") from error
    if data.startswith(_GZIP):
        data = _uncompressed(data, most_bytes + _MOST_HEADER_BYTES)
    pictures = _pictures(data, plane, most_bytes)
    for number, picture in enumerate(pictures):
        yield replace(picture, path=Path(f"{path}[{number}]") if len(pictures) > 1 else path)


def _pictures(data: bytes, plane: Plane | None, most_bytes: int) -> Sequence[ImageFile]:
    if data.startswith(_FITS):
        return _read_fits(data, plane, most_bytes)
    if data.startswith(_PNG):
        return [_read_png(data, plane, most_bytes)]
    if data.startswith(_TIFF):
        return _read_tiff(data, plane, most_bytes)
    if data.startswith(_JPEG):
        return [replace(_plain_image(_decoded(data)[0], plane), is_lossy=True)]
    raise DataError("is not a FITS, PNG, TIFF, JPEG or RAW image; convert other formats without loss first")


def image_files(given: Sequence[Path]) -> list[Path]:
    """Return the files with images: those that are named, and all of a folder."""
    return [file for path in given for file in (_images_in(path) if path.is_dir() else [path])]


def name_of(path: Path) -> str:
    """Return the name of an image: of its file, and the place of an array in it."""
    place = _ARRAY.fullmatch(str(path))
    return path.name if place is None else Path(place["file"]).name + str(path)[len(place["file"]) :]


def _images_in(folder: Path) -> list[Path]:
    if (folder / "manifest.jsonl").exists():
        raise ConfigError(f"{folder}: is a run: rigctl stokes {folder} --out FOLDER measures it")
    known = (*_SUFFIXES, *_ARRAY_SUFFIXES, *RAW_SUFFIXES)
    found = [path for path in folder.iterdir() if path.suffix.lower() in known and not path.name.startswith(".")]
    if not found:
        raise ConfigError(f"{folder}: holds no image (known are {', '.join(known)})")
    return sorted(path for path in found if path.is_file())


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


def _read_png(data: bytes, plane: Plane | None, most_bytes: int) -> ImageFile:
    sample_bytes, bits = png_bytes(data)
    if bits < 8:
        raise DataError(f"has {bits} bits per sample, fewer than any camera's raw image")
    require_size(sample_bytes, most_bytes)
    plain = unfiltered_png(data)
    return _plain_image(_decoded(data)[0] if plain is None else plain, plane)


def _read_tiff(data: bytes, plane: Plane | None, most_bytes: int) -> list[ImageFile]:
    sample_bytes, is_planar = tiff_bytes(data)
    require_size(sample_bytes, most_bytes)
    if not is_planar:
        return [_plain_image(page, plane) for page in _decoded(data)]
    try:  # OpenCV gives other samples where planes stand one after another
        import tifffile
    except ImportError as error:
        raise ConfigError("TIFF files with separate planes need tifffile: pip install 'rigctl[export]'") from error
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            planes = np.concatenate([page.asarray() for page in file.pages])
            are_colours = len(file.pages) == 1 and file.pages.first.photometric == tifffile.PHOTOMETRIC.RGB
    except Exception as error:  # tifffile raises many kinds on damaged files and unknown compression
        raise DataError(f"cannot be read as TIFF: {error}") from error
    return _stack(planes, plane, are_colours=are_colours)


def _stack(pixels: NDArray[Any], plane: Plane | None, *, are_colours: bool = False, **facts: Any) -> list[ImageFile]:
    """Return each plane of an array as a picture, or only the requested colour."""
    if pixels.ndim > 3 and set(pixels.shape[:-3]) == {1}:
        pixels = pixels.reshape(pixels.shape[-3:])
    is_one = pixels.ndim != 3 or (len(pixels) == len(_COLOURS) and (are_colours or plane is not None))
    return [_image(_grey(one, plane), plane=plane, **facts) for one in ([pixels] if is_one else pixels)]


def _decoded(data: bytes) -> Sequence[NDArray[Any] | None]:
    """Return the pictures of a PNG, TIFF or JPEG file; (None,) if it cannot be read."""
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)  # not on each odd tag of a TIFF file
    try:
        _, pages = cv2.imdecodemulti(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DataError("is damaged, or larger than pictures can be") from error
    return pages or (None,)


def _plain_image(pixels: NDArray[Any] | None, plane: Plane | None) -> ImageFile:
    if pixels is None:
        raise DataError("is damaged, or of a kind of PNG, TIFF or JPEG that cannot be read")
    # Colours stand in the order blue, green, red, and opacity.
    colours = None if pixels.ndim == 2 else np.moveaxis(pixels, 2, 0)[2::-1]
    grey = _grey(pixels if colours is None else colours, plane)
    return _image(grey, plane=plane)


def _grey(pixels: NDArray[Any], plane: Plane | None) -> NDArray[Any]:
    """Return a picture, or one colour of it: of three planes red, green and blue."""
    if pixels.ndim == 2:
        if plane is not None:
            raise ConfigError(f"--plane {plane}: is for colour images and RAW files, and this image is grey")
        return pixels
    if len(pixels) != len(_COLOURS) or pixels.ndim != 3:
        raise DataError(f"has axes of {' x '.join(map(str, pixels.shape))}; pictures and stacks of them have 2 or 3")
    if plane is None and np.array_equal(pixels[0], pixels[1]) and np.array_equal(pixels[0], pixels[2]):
        return np.asarray(pixels[0])
    if plane not in _COLOURS:
        raise ConfigError(
            f"{'' if plane is None else f'--plane {plane}: '}is a colour image: say --plane red, green or blue, for "
            "each of them in a run of its own"
        )
    return np.asarray(pixels[_COLOURS.index(plane)])


def _image(
    pixels: NDArray[Any],
    *,
    first_row: FirstRow = "top",
    is_stated: bool = False,
    header: Mapping[str, HeaderValue] | None = None,
    remarks: tuple[str, ...] = (),
    plane: Plane | None = None,
) -> ImageFile:
    counts, unset = _counts(pixels)
    return ImageFile(
        counts=counts,
        unset=unset,
        sample_bits=32 if counts.dtype != np.uint16 else 8 if pixels.dtype.itemsize == 1 else 16,
        first_row=first_row,
        first_row_stated=is_stated,
        header=header or {},
        remarks=(*remarks, f"plane {plane}") if plane else remarks,
    )


def _counts(pixels: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.bool_] | None]:
    """Return samples as unsigned 16 bits if they fit, else in double precision, and a mask of NaN and infinity."""
    if pixels.size == 0:
        raise DataError("has no pixels")
    if pixels.dtype.kind not in "uif":
        raise DataError(f"has samples of the type {pixels.dtype}; numbers are needed")
    unset = None
    if pixels.dtype.kind == "f" and not np.isfinite(pixels).all():
        unset = ~np.isfinite(pixels)
        if unset.all():
            raise DataError("all samples are NaN or infinite")
        pixels = np.where(unset, pixels[~unset].min(), pixels)
    is_whole = pixels.dtype.kind != "f" or not np.any(pixels != np.floor(pixels))
    if is_whole and pixels.min() >= 0 and pixels.max() <= _LARGEST:
        return np.ascontiguousarray(pixels, dtype=np.uint16), unset
    return np.ascontiguousarray(pixels, dtype=np.float64), unset


def _read_fits(data: bytes, plane: Plane | None, most_bytes: int) -> list[ImageFile]:
    header, pixels, images, is_stale = _first_fits_image(data, most_bytes)
    stated = str(header.get("ROWORDER", "")).strip().upper()
    if stated and stated not in _ROW_ORDERS:
        raise DataError(f"ROWORDER is {stated!r}; known are {', '.join(_ROW_ORDERS)}")
    pictures = _stack(
        pixels,
        plane,
        first_row=_ROW_ORDERS.get(stated, "bottom"),
        is_stated=bool(stated),
        header=header,
        remarks=(
            *((f"{FIRST_OF} {images} images of its file",) if images > 1 else ()),
            *((f"{STALE}: header keywords were changed after it was written",) if is_stale else ()),
        ),
    )
    # The header of a cube has the time of its first picture.
    later = {key: value for key, value in header.items() if key != "DATE-OBS"}
    return [replace(one, header=later) if number else one for number, one in enumerate(pictures)]


def _first_fits_image(data: bytes, most_bytes: int) -> tuple[dict[str, HeaderValue], NDArray[Any], int, bool]:
    from astropy.io import fits

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with fits.open(io.BytesIO(data), memmap=False, checksum=True) as units:
                # By the header: asking for the samples of a unit takes memory for them.
                images = [unit for unit in units if unit.is_image and unit.shape]
                require_size(max(map(_fits_bytes, images), default=0), most_bytes)
                # An image in an extension shares the header of the file, FITS standard 4.0, appendix K.
                cards = [units[0].header, images[0].header] if images else []
                header = {key: one[key] for one in cards for key in set(one)}
                pixels = images[0].data if images else None
        except DataError:
            raise
        except Exception as error:  # astropy raises many kinds on damaged headers
            raise DataError(f"cannot be read as FITS: {error}") from error
    is_stale = _refuse_damage([str(warning.message) for warning in caught], has_datasum="DATASUM" in header)
    if pixels is None:
        raise DataError("is a FITS file without an image")
    return header, pixels, len(images), is_stale


def _fits_bytes(unit: Any) -> int:
    bits: int = abs(int(unit.header["BITPIX"]))
    return math.prod(map(int, unit.shape)) * bits // 8


def _refuse_damage(messages: list[str], *, has_datasum: bool) -> bool:
    """Return True if only the header's checksum fails; raise DataError if the data are damaged."""
    # astropy also warns of untidy headers; only damage to the samples matters here.
    failed = [text for text in messages if "verification failed" in text]
    of_data = [text for text in failed if text.startswith("Datasum")]
    is_stale = bool(failed) and has_datasum and not of_data
    damage = [text for text in messages if "truncated" in text] + ([] if is_stale else failed)
    if damage:
        raise DataError(f"is damaged: {' '.join(dict.fromkeys(damage))}")
    return is_stale


_ARRAY_SUFFIXES = (".h5", ".hdf5", ".hdf", ".nxs", ".nc", ".nc4", ".cdf")
_ARRAY = re.compile(
    rf"(?P<file>.+(?:{'|'.join(map(re.escape, _ARRAY_SUFFIXES))})):(?P<inside>[^\[]+)(?:\[(?P<number>\d+)\])?",
    re.IGNORECASE,
)
_CLASSIC_NETCDF = (b"CDF\x01", b"CDF\x02")


def _read_arrays(path: Path, most_bytes: int) -> Iterator[ImageFile]:
    """Yield the pictures of an array of two or three axes; the only one of a file need not be named.

    Their header are attributes, and numbers of arrays with one for each picture.
    """
    place = _ARRAY.fullmatch(str(path))
    file, asked = (path, None) if place is None else (Path(place["file"]), place["number"])
    with _arrays_of(file) as (arrays, facts):
        pictures = {name: one.shape for name, one in arrays.items() if len(one.shape) in (2, 3)}
        inside = place["inside"] if place else next(iter(pictures), "") if len(pictures) == 1 else ""
        one = arrays.get(f"/{inside.strip('/')}")
        if one is None or len(one.shape) not in (2, 3):
            there = ", ".join(f"{name} ({' x '.join(map(str, shape))})" for name, shape in list(pictures.items())[:6])
            raise ConfigError(f"say which array, as in {file}:/entry/data; there are {there or 'no pictures'}")
        require_size(math.prod(one.shape[-2:]) * np.asarray(one[:0]).itemsize, most_bytes)
        is_stack, own = len(one.shape) == 3, _attributes(one)
        numbers = range(one.shape[0]) if is_stack else range(1)
        if asked is not None and int(asked) not in numbers:
            raise DataError(f"{inside} holds {len(numbers)} pictures, from [0]")
        if not numbers:
            raise DataError(f"{inside} holds no picture")
        for number in numbers if asked is None else [int(asked)]:
            pixels = np.asarray(one[number] if is_stack else one[:])
            # The convention of NetCDF for packed numbers, Climate and Forecast conventions, section 8.1.
            if "scale_factor" in own or "add_offset" in own:
                pixels = pixels * float(own.get("scale_factor", 1.0)) + float(own.get("add_offset", 0.0))
            of_pictures = {
                name.rpartition("/")[2]: other[number]
                for name, other in arrays.items()
                if is_stack and other.shape == one.shape[:1]
            }
            picture = _image(pixels, header=_plain_values({**facts, **own, **of_pictures}))
            yield replace(picture, path=Path(f"{file}:{inside}[{number}]" if is_stack else f"{file}:{inside}"))


@contextmanager
def _arrays_of(file: Path) -> Iterator[tuple[Mapping[str, Any], Mapping[str, Any]]]:
    """Give the arrays of a file, by their places in it, and the file's attributes."""
    try:
        with open_plain(file) as start:
            is_classic = start.read(4) in _CLASSIC_NETCDF
        if is_classic:
            from scipy.io import netcdf_file

            with netcdf_file(file, mmap=False) as classic:
                yield {f"/{name}": one for name, one in classic.variables.items()}, _attributes(classic)
            return
        try:
            import h5py
        except ImportError as error:
            raise ConfigError("arrays in HDF5 files need h5py: pip install 'rigctl[export]'") from error
        with h5py.File(file) as held:
            arrays: dict[str, Any] = {}
            held.visititems(lambda name, one: arrays.update({f"/{name}": one} if isinstance(one, h5py.Dataset) else {}))
            yield arrays, _attributes(held)
    except (OSError, RuntimeError, TypeError, ValueError) as error:
        raise DataError(f"cannot be read: {getattr(error, 'strerror', None) or error}") from error


def _attributes(one: Any) -> dict[str, Any]:
    return dict(getattr(one, "attrs", None) or getattr(one, "_attributes", {}))


def _plain_values(found: Mapping[str, Any]) -> dict[str, HeaderValue]:
    """Return texts and single numbers by their names in capitals, as the header of a FITS file has them."""
    values: dict[str, HeaderValue] = {}
    for name, value in found.items():
        plain = np.asarray(value).ravel()
        if plain.size == 1 and plain.dtype.kind in "uifbSUO":
            one = plain[0].item() if plain.dtype.kind != "O" else plain[0]
            values[name.upper()] = one.decode(errors="replace") if isinstance(one, bytes) else one
    return values
