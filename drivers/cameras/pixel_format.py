"""From the bytes that a camera sends to whole counts: plain, shifted and packed samples."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ProtocolError

ByteOrder = Literal["little", "big"]
Justified = Literal["right", "left"]

# What is worked on stays in the processor's cache: a third of the time of a whole picture at once.
_GROUPS_AT_A_TIME = 32768


@dataclass(frozen=True, kw_only=True)
class Packing:
    """Samples that share bytes.

    Attributes
    ----------
    group_bytes, group_pixels : int
        How many bytes hold how many samples.
    moves : tuple of (byte, mask, shift)
        Where the bits go: these bits of this byte, shifted left so far, are part of a word in which the samples of a
        group stand side by side, 16 bits each, the first one lowest.
    """

    group_bytes: int
    group_pixels: Literal[2, 4]
    moves: tuple[tuple[int, int, int], ...]


@dataclass(frozen=True, kw_only=True)
class PixelFormat:
    """Layout of a camera's samples in bytes.

    Attributes
    ----------
    name : str
        As the camera's own standard calls it.
    bit_depth : int
        Bits that a sample has.
    sample_bytes : {1, 2}
        Bytes of a sample that shares none.
    byte_order : {"little", "big"}
        Of samples of two bytes.
    justified : {"right", "left"}
        At which end of its bytes an unpacked sample stands.
    packing : Packing or None
        Where samples share bytes.
    cell : str or None
        Colours of the mosaic's cell of 2 x 2 samples, row by row; None for grey.
    is_polarized : bool
        Its samples stand behind polarizers, four angles in a cell of 2 x 2.
    """

    name: str
    bit_depth: int
    sample_bytes: Literal[1, 2] = 2
    byte_order: ByteOrder = "little"
    justified: Justified = "right"
    packing: Packing | None = None
    cell: str | None = None
    is_polarized: bool = False


def unpack(
    data: bytes | memoryview | NDArray[np.uint8],
    *,
    pixel_format: PixelFormat,
    width: int,
    height: int,
    row_bytes: int | None = None,
) -> NDArray[np.uint16]:
    """Return the counts of a picture, right-justified, in an array of its own.

    Parameters
    ----------
    data : bytes-like
        The picture; bytes behind it are not looked at.
    pixel_format : PixelFormat
        How samples stand in it.
    width, height : int
        Pixels, each >= 1.
    row_bytes : int or None
        Bytes from one row to the next, where each row begins anew (V4L2). None: samples follow one another through
        the whole picture, a group of packed ones may go on in the next row (GigE Vision).

    Returns
    -------
    counts : (height, width) array of uint16
        0 to ``2**bit_depth - 1``.

    Raises
    ------
    ProtocolError
        The picture is too short, or a sample uses bits that its format does not have: then byte order, depth or
        justification are other than stated.

    Notes
    -----
    The last group of packed samples may be cut short after the last byte that holds a bit of a sample.
    """
    stream = np.frombuffer(data, np.uint8)
    if row_bytes is None:
        counts = _samples(stream, pixel_format, width * height)
    else:
        rows = _rows(stream, row_bytes=row_bytes, height=height)
        counts = np.concatenate([_samples(row, pixel_format, width) for row in rows])
    return _right_justified(counts, pixel_format).reshape(height, width)


def needed_bytes(pixel_format: PixelFormat, *, samples: int) -> int:
    """Return the fewest bytes that hold this many samples in a row."""
    packing = pixel_format.packing
    if packing is None:
        return samples * pixel_format.sample_bytes
    groups, rest = divmod(samples, packing.group_pixels)
    low_bits = range(16 * rest)
    tail = [byte for byte, mask, shift in packing.moves if ((mask & -mask).bit_length() - 1 + shift) in low_bits]
    return groups * packing.group_bytes + (max(tail) + 1 if rest else 0)


def _rows(stream: NDArray[np.uint8], *, row_bytes: int, height: int) -> list[NDArray[np.uint8]]:
    # The last row may lack the padding that the others have.
    return [stream[row * row_bytes : (row + 1) * row_bytes] for row in range(height)]


def _samples(stream: NDArray[np.uint8], pixel_format: PixelFormat, count: int) -> NDArray[np.uint16]:
    needed = needed_bytes(pixel_format, samples=count)
    if stream.size < needed:
        raise ProtocolError(
            f"{pixel_format.name}: {stream.size} bytes came, and {count} samples take {needed}: the picture is cut "
            "short, or of another format or size than stated"
        )
    if pixel_format.packing is None:
        order = "<" if pixel_format.byte_order == "little" else ">"
        return stream[:needed].view(f"{order}u{pixel_format.sample_bytes}").astype(np.uint16)
    return _spread(stream, pixel_format.packing, count)


def _spread(stream: NDArray[np.uint8], packing: Packing, count: int) -> NDArray[np.uint16]:
    """Return samples of 16 bits out of packed ones: whole columns of bytes at a time, a word for each group."""
    size = -(-count // packing.group_pixels) * packing.group_bytes
    if stream.size < size:
        stream = np.concatenate([stream, np.zeros(size - stream.size, np.uint8)])
    groups = stream[:size].reshape(-1, packing.group_bytes)
    words = np.empty(len(groups), dtype=f"<u{2 * packing.group_pixels}")
    for start in range(0, len(groups), _GROUPS_AT_A_TIME):
        block = slice(start, start + _GROUPS_AT_A_TIME)
        _spread_block(groups[block], packing, words[block])
    return words.view("<u2").astype(np.uint16, copy=False)[:count]


def _spread_block(groups: NDArray[np.uint8], packing: Packing, words: NDArray[np.unsignedinteger[Any]]) -> None:
    words[:] = 0
    part = np.empty_like(words)
    for byte, mask, shift in packing.moves:
        np.copyto(part, groups[:, byte])
        if mask != 0xFF:
            part &= words.dtype.type(mask)
        part <<= words.dtype.type(shift)
        words |= part


def _right_justified(counts: NDArray[np.uint16], pixel_format: PixelFormat) -> NDArray[np.uint16]:
    spare = 8 * pixel_format.sample_bytes - pixel_format.bit_depth
    if pixel_format.packing is not None or spare == 0:
        return counts
    unused = 2**spare - 1 if pixel_format.justified == "left" else (2**spare - 1) << pixel_format.bit_depth
    if int(np.bitwise_or.reduce(counts)) & unused:
        raise ProtocolError(
            f"{pixel_format.name}: samples use bits that {pixel_format.bit_depth} bits, {pixel_format.justified}-"
            f"justified, {pixel_format.byte_order} end first, do not have (mask {unused:#06x}). State the camera's "
            "true bits, justified and byte_order in its address"
        )
    return np.right_shift(counts, spare) if pixel_format.justified == "left" else counts
