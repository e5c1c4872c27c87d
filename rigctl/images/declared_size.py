"""Size of a picture as its header declares it, found without taking memory for the picture."""

import struct
from collections.abc import Iterator

from rigctl.errors import DataError

_BYTES_PER_MB = 1_000_000
_PNG_HEADER = struct.Struct(">II")
_PNG_HEADER_START, _PNG_HEADER_END = 16, 33
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
# Tags of a TIFF directory, and bytes of the types that sizes come in.
_WIDTH, _HEIGHT, _BITS, _SAMPLES = 256, 257, 258, 277
_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}
_MOST_PICTURES = 1000


def require_size(sample_bytes: int, most_bytes: int) -> None:
    """Refuse a picture whose samples take more memory than is allowed.

    Raises
    ------
    DataError
        They do.
    """
    if sample_bytes > most_bytes:
        raise DataError(
            f"would take {sample_bytes / _BYTES_PER_MB:.4g} MB by its header, and at most "
            f"{most_bytes / _BYTES_PER_MB:.4g} MB are read; say --max-frame-mb N if it really is that large"
        )


def png_bytes(data: bytes) -> tuple[int, int]:
    """Return bytes of all samples, and bits a sample, of a PNG file.

    Raises
    ------
    DataError
        The file ends before its header does, or has no pixels.

    References
    ----------
    W3C, Portable Network Graphics (PNG) Specification, third edition, section 11.2.1.
    """
    if len(data) < _PNG_HEADER_END:
        raise DataError(f"is damaged: its {len(data)} bytes end within the header of a PNG file")
    width, height = _PNG_HEADER.unpack_from(data, _PNG_HEADER_START)
    bits, colour = data[24], data[25]
    if not width or not height:
        raise DataError(f"has {width} x {height} pixels")
    return width * height * _PNG_CHANNELS.get(colour, 4) * max(1, bits // 8), bits


def tiff_bytes(data: bytes) -> int:
    """Return bytes of all samples of all pictures of a TIFF or BigTIFF file.

    Raises
    ------
    DataError
        A directory lies outside of the file, has no size, or they come round in a circle.

    References
    ----------
    Adobe, TIFF revision 6.0, section 2; Aware Systems, The BigTIFF file format proposal.
    """
    try:
        return sum(_directory_bytes(entries) for entries in _directories(data))
    except struct.error as error:
        raise DataError("is damaged: a directory of a TIFF file lies outside of the file") from error


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
        if tag in (_WIDTH, _HEIGHT, _BITS, _SAMPLES) and kind in _TYPES:
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
