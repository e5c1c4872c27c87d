"""Grey PNG files whose rows are stored as they are, which many cameras' programs write: read at the speed of zlib."""

import struct
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_SIGNATURE_SIZE = 8
_CHUNK_FRAME_SIZE = 12  # length, name and checksum
_ZLIB_HEADER, _ZLIB_CHECKSUM = 2, 4
_DICTIONARY = 0x20
_HEADER = struct.Struct(">IIBBBBB")
# Grey; deflate; adaptive filters; not interlaced.
_PLAIN = (0, 0, 0, 0)


@dataclass(frozen=True, kw_only=True)
class _Layout:
    width: int
    height: int
    sample_bytes: int

    @property
    def row_bytes(self) -> int:
        """Bytes of a row, its filter's byte before it."""
        return 1 + self.width * self.sample_bytes


def unfiltered_png(data: bytes) -> NDArray[np.uint16] | NDArray[np.uint8] | None:
    """Return the samples of a grey PNG file of 8 or 16 bits whose rows have no filter; None for any other.

    Parameters
    ----------
    data : bytes
        The file. A damaged one gives None too: what reads every kind of PNG then says so.

    References
    ----------
    W3C, Portable Network Graphics (PNG) Specification, third edition.
    """
    try:
        layout, packed = _parts(data)
    except (struct.error, ValueError):
        return None
    if layout is None or len(packed) < _ZLIB_HEADER:
        return None
    raw = _inflated(packed, layout.height * layout.row_bytes)
    if raw is None:
        return None
    rows = np.frombuffer(raw, np.uint8).reshape(layout.height, layout.row_bytes)
    if rows[:, 0].any():
        return None
    samples = rows[:, 1:]
    return np.ascontiguousarray(samples) if layout.sample_bytes == 1 else samples.view(">u2").astype(np.uint16)


def _inflated(packed: bytes, size: int) -> bytes | None:
    """Return what a zlib stream holds, None where that is not so many bytes, or another kind of stream.

    Its checksum over the samples is passed by: those of the chunks are over the same, packed, and were right.
    """
    method, flags = packed[0], packed[1]
    if method & 0x0F != zlib.DEFLATED or flags & _DICTIONARY or (method << 8 | flags) % 31:
        return None
    unpacker = zlib.decompressobj(-zlib.MAX_WBITS)
    try:
        # One byte more than there should be is asked for, to see that there is none.
        raw = unpacker.decompress(memoryview(packed)[_ZLIB_HEADER:], size + 1)
    except zlib.error:
        return None
    whole = len(raw) == size and unpacker.eof and len(unpacker.unused_data) == _ZLIB_CHECKSUM
    return raw if whole else None


def _parts(data: bytes) -> tuple[_Layout | None, bytes]:
    """Return the layout, None where it is not plain, and the packed rows."""
    layout, packed = None, []
    for name, content in _chunks(data):
        if name == b"IHDR":
            layout = _layout(content)
        elif name == b"IDAT":
            packed.append(content)
        elif name in (b"PLTE", b"tRNS"):
            return None, b""
    return layout, b"".join(packed)


def _layout(content: memoryview) -> _Layout | None:
    width, height, bits, *rest = _HEADER.unpack(content)
    if tuple(rest) != _PLAIN or bits not in (8, 16):
        return None
    return _Layout(width=width, height=height, sample_bytes=bits // 8)


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
