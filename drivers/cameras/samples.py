"""Bytes of a camera to counts: plain, shifted, packed, and one colour of a mosaic.

Formats are known by the numbers of GigE Vision (PFNC) and the letters of V4L2.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from drivers.errors import LimitError, ProtocolError

ByteOrder = Literal["little", "big"]
Justified = Literal["right", "left"]

# Fits into the processor's cache, which takes a third of the time of a whole picture.
_GROUPS_AT_A_TIME = 32768


@dataclass(frozen=True, kw_only=True)
class Packing:
    """Samples that share bytes."""

    group_bytes: int  #: Bytes and samples of a group.
    group_pixels: Literal[2, 4]
    #: Moves of bits: (byte, bits, shift to the left) into a word with the samples of a group, 16 bits each, the first
    #: lowest.
    moves: tuple[tuple[int, int, int], ...]


@dataclass(frozen=True, kw_only=True)
class PixelFormat:
    """Layout of a camera's samples in bytes."""

    name: str  #: As in the camera's own standard.
    bit_depth: int  #: Bits that a sample has.
    sample_bytes: Literal[1, 2] = 2  #: Bytes of an unpacked sample.
    byte_order: ByteOrder = "little"  #: Of samples of two bytes.
    justified: Justified = "right"  #: End of its bytes at which an unpacked sample is.
    packing: Packing | None = None  #: If samples share bytes.
    cell: str | None = None  #: Colours of the mosaic's cell of 2 x 2 samples, row by row; None for grey.
    is_polarized: bool = False  #: Its samples are behind polarizers, four angles in a cell of 2 x 2.


def unpack(
    data: bytes | memoryview | NDArray[np.uint8],
    *,
    pixel_format: PixelFormat,
    width: int,
    height: int,
    row_bytes: int | None = None,
) -> NDArray[np.uint16]:
    """Return the counts of a picture, right-justified, in a new array.

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
    """Return the fewest bytes for this many samples."""
    packing = pixel_format.packing
    if packing is None:
        return samples * pixel_format.sample_bytes
    groups, rest = divmod(samples, packing.group_pixels)
    low_bits = range(16 * rest)
    tail = [byte for byte, mask, shift in packing.moves if ((mask & -mask).bit_length() - 1 + shift) in low_bits]
    return groups * packing.group_bytes + (max(tail) + 1 if rest else 0)


def _rows(stream: NDArray[np.uint8], *, row_bytes: int, height: int) -> list[NDArray[np.uint8]]:
    # The last row may lack padding.
    return [stream[row * row_bytes : (row + 1) * row_bytes] for row in range(height)]


def _samples(stream: NDArray[np.uint8], pixel_format: PixelFormat, count: int) -> NDArray[np.uint16]:
    needed = needed_bytes(pixel_format, samples=count)
    if stream.size < needed:
        raise ProtocolError(
            f"{pixel_format.name}: {stream.size} bytes came, and {count} samples need {needed}: the picture is "
            "truncated, or has another format or size than stated"
        )
    if pixel_format.packing is None:
        order = "<" if pixel_format.byte_order == "little" else ">"
        return stream[:needed].view(f"{order}u{pixel_format.sample_bytes}").astype(np.uint16)
    return _spread(stream, pixel_format.packing, count)


def _spread(stream: NDArray[np.uint8], packing: Packing, count: int) -> NDArray[np.uint16]:
    """Return samples of 16 bits from packed ones: whole columns of bytes at a time, one word per group."""
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


def _stream(bits: int, pixels: int, *, first_byte: int = 0) -> tuple[tuple[int, int, int], ...]:
    """Return the moves of consecutive samples in a stream, lowest bit first."""
    moves = []
    for byte in range(bits * pixels // 8):
        for pixel in range(8 * byte // bits, (8 * byte + 7) // bits + 1):
            low, high = max(8 * byte, bits * pixel), min(8 * byte + 8, bits * (pixel + 1))
            mask = 2 ** (high - 8 * byte) - 2 ** (low - 8 * byte)
            moves.append((first_byte + byte, mask, 16 * pixel + 8 * byte - bits * pixel))
    return tuple(moves)


def _pfnc(bits: int, pixels: Literal[2, 4]) -> Packing:
    """Return one stream of bits, lowest first (PFNC's "p")."""
    return Packing(group_bytes=bits * pixels // 8, group_pixels=pixels, moves=_stream(bits, pixels))


def _csi(bits: int, pixels: Literal[2, 4]) -> Packing:
    """Return all high parts of eight bits, then a stream of the low parts (MIPI CSI-2; V4L2's Y10P to Y14P)."""
    high = tuple((pixel, 0xFF, 16 * pixel + bits - 8) for pixel in range(pixels))
    low = _stream(bits - 8, pixels, first_byte=pixels)
    return Packing(group_bytes=bits * pixels // 8, group_pixels=pixels, moves=(*high, *low))


# Two samples in three bytes: high, both low parts, high (GigE Vision).
_GVSP_12 = Packing(group_bytes=3, group_pixels=2, moves=((0, 0xFF, 4), (1, 0x0F, 0), (1, 0xF0, 12), (2, 0xFF, 20)))
_GVSP_10 = Packing(group_bytes=3, group_pixels=2, moves=((0, 0xFF, 2), (1, 0x03, 0), (1, 0x30, 12), (2, 0xFF, 18)))

_GREY: Mapping[int, PixelFormat] = {
    0x01080001: PixelFormat(name="Mono8", bit_depth=8, sample_bytes=1),
    0x01100003: PixelFormat(name="Mono10", bit_depth=10),
    0x01100005: PixelFormat(name="Mono12", bit_depth=12),
    0x01100025: PixelFormat(name="Mono14", bit_depth=14),
    0x01100007: PixelFormat(name="Mono16", bit_depth=16),
    0x010C0004: PixelFormat(name="Mono10Packed", bit_depth=10, packing=_GVSP_10),
    0x010C0006: PixelFormat(name="Mono12Packed", bit_depth=12, packing=_GVSP_12),
    0x010A0046: PixelFormat(name="Mono10p", bit_depth=10, packing=_pfnc(10, 4)),
    0x010C0047: PixelFormat(name="Mono12p", bit_depth=12, packing=_pfnc(12, 2)),
    0x010E0104: PixelFormat(name="Mono14p", bit_depth=14, packing=_pfnc(14, 4)),
}
# Kind of samples -> numbers for the cells that begin with BG, GB, GR, RG.
_MOSAICS: tuple[tuple[str, PixelFormat, tuple[int, int, int, int]], ...] = (
    ("8", _GREY[0x01080001], (0x0108000B, 0x0108000A, 0x01080008, 0x01080009)),
    ("10", _GREY[0x01100003], (0x0110000F, 0x0110000E, 0x0110000C, 0x0110000D)),
    ("12", _GREY[0x01100005], (0x01100013, 0x01100012, 0x01100010, 0x01100011)),
    ("14", _GREY[0x01100025], (0x0110010C, 0x0110010B, 0x01100109, 0x0110010A)),
    ("16", _GREY[0x01100007], (0x01100031, 0x01100030, 0x0110002E, 0x0110002F)),
    ("10Packed", _GREY[0x010C0004], (0x010C0029, 0x010C0028, 0x010C0026, 0x010C0027)),
    ("12Packed", _GREY[0x010C0006], (0x010C002D, 0x010C002C, 0x010C002A, 0x010C002B)),
    ("10p", _GREY[0x010A0046], (0x010A0052, 0x010A0054, 0x010A0056, 0x010A0058)),
    ("12p", _GREY[0x010C0047], (0x010C0053, 0x010C0055, 0x010C0057, 0x010C0059)),
    ("14p", _GREY[0x010E0104], (0x010E0108, 0x010E0107, 0x010E0105, 0x010E0106)),
)
_CELLS = ("BGGR", "GBRG", "GRBG", "RGGB")

# GigE Vision leaves numbers from 0x8... to makers: these are LUCID's.
_POLARIZED_OF_MAKERS = {
    0x81080001: "PolarizeMono8",
    0x81100008: "PolarizeMono12",
    0x81100007: "PolarizeMono16",
    0x810C0006: "PolarizeMono12Packed",
    0x810C0047: "PolarizeMono12p",
}
_POLARIZED_NAME = re.compile(r"Polariz(?:e|ed)(?:Mono)?(\d+(?:p|Packed)?)")


def polarized_format(name: str) -> PixelFormat | None:
    """Return a format of samples behind polarizers by its name, such as PolarizeMono12p or Polarized8; else None.

    Its samples are arranged as in the Mono format of the same ending. Formats of computed pictures, such as
    PolarizedDolp_Mono8, do not belong.
    """
    found = _POLARIZED_NAME.fullmatch(name)
    grey = None if found is None else next((f for f in _GREY.values() if f.name == f"Mono{found[1]}"), None)
    return None if grey is None else replace(grey, name=name, is_polarized=True)


GENICAM: Mapping[int, PixelFormat] = {
    **_GREY,
    **{
        code: PixelFormat(
            name=f"Bayer{cell[:2]}{suffix}",
            bit_depth=grey.bit_depth,
            sample_bytes=grey.sample_bytes,
            packing=grey.packing,
            cell=cell,
        )
        for suffix, grey, codes in _MOSAICS
        for cell, code in zip(_CELLS, codes, strict=True)
    },
    **{code: known for code, name in _POLARIZED_OF_MAKERS.items() if (known := polarized_format(name)) is not None},
}
"""Formats of GigE Vision by their number (PFNC)."""

# Bits -> letters for the same cells; those of packed samples.
_LETTERS_OF_MOSAICS = {
    8: ("BA81", "GBRG", "GRBG", "RGGB"),
    10: ("BG10", "GB10", "BA10", "RG10"),
    12: ("BG12", "GB12", "BA12", "RG12"),
    14: ("BG14", "GB14", "GR14", "RG14"),
    16: ("BYR2", "GB16", "GR16", "RG16"),
}
_LETTERS_OF_PACKED_MOSAICS = {
    10: ("pBAA", "pGAA", "pgAA", "pRAA"),
    12: ("pBCC", "pGCC", "pgCC", "pRCC"),
    14: ("pBEE", "pGEE", "pgEE", "pREE"),
}
_PACKED: Mapping[int, Packing] = {10: _csi(10, 4), 12: _csi(12, 2), 14: _csi(14, 4)}

V4L2: Mapping[str, PixelFormat] = {
    "GREY": PixelFormat(name="GREY", bit_depth=8, sample_bytes=1),
    "Y10 ": PixelFormat(name="Y10", bit_depth=10),
    "Y12 ": PixelFormat(name="Y12", bit_depth=12),
    "Y14 ": PixelFormat(name="Y14", bit_depth=14),
    "Y16 ": PixelFormat(name="Y16", bit_depth=16),
    "Y16_BE": PixelFormat(name="Y16_BE", bit_depth=16, byte_order="big"),
    **{
        f"Y{bits}P": PixelFormat(name=f"Y{bits}P", bit_depth=bits, packing=packing) for bits, packing in _PACKED.items()
    },
    **{
        letters: PixelFormat(name=letters, bit_depth=bits, sample_bytes=1 if bits == 8 else 2, cell=cell)
        for bits, names in _LETTERS_OF_MOSAICS.items()
        for cell, letters in zip(_CELLS, names, strict=True)
    },
    **{
        letters: PixelFormat(name=letters, bit_depth=bits, packing=_PACKED[bits], cell=cell)
        for bits, names in _LETTERS_OF_PACKED_MOSAICS.items()
        for cell, letters in zip(_CELLS, names, strict=True)
    },
}
"""Formats of V4L2 by their four letters; "_BE" behind them stands for the highest bit, the big end first."""


Plane = Literal["red", "green-1", "green-2", "blue", "green", "sum"]
PLANES: tuple[Plane, ...] = get_args(Plane)
"""Green-1 stands in the rows of red. "green" is the sum of both greens, "sum" that of all four samples."""

_SUMMED: dict[str, tuple[str, ...]] = {
    "green": ("green-1", "green-2"),
    "sum": ("red", "green-1", "green-2", "blue"),
}
_MOST_DN = 65535


def samples_of(plane: Plane) -> int:
    """Return the number of samples per pixel of a plane: 1, 2 or 4."""
    return len(_SUMMED.get(plane, (plane,)))


def places_of(plane: Plane, *, cell: str) -> tuple[tuple[int, int], ...]:
    """Return row and column within a cell, such as "RGGB", of each sample of a plane."""
    red, blue = divmod(cell.index("R"), 2), divmod(cell.index("B"), 2)
    places = {"red": red, "blue": blue, "green-1": (red[0], 1 - red[1]), "green-2": (blue[0], 1 - blue[1])}
    return tuple(places[colour] for colour in _SUMMED.get(plane, (plane,)))


def bit_depth_of(plane: Plane, *, bit_depth: int) -> int:
    """Return the bits of a plane, whose samples have `bit_depth` bits."""
    depth = bit_depth + (samples_of(plane) - 1).bit_length()
    if depth > 16:
        raise LimitError(
            f"plane {plane}: a sum of {samples_of(plane)} samples of {bit_depth} bits needs {depth}, and counts have "
            "at most 16; take one colour, or state the true bit_depth if samples have fewer"
        )
    return depth


def take_plane(
    counts: NDArray[np.uint16], *, cell: str, plane: Plane, saturation_dn: int, saturated_as_dn: int
) -> NDArray[np.uint16]:
    """Return a plane of a mosaic, in a new array.

    A sum loses the colours, and range: if one colour saturates, the sum of its cell is unknown. Its variance is the sum
    of the samples' variances.
    """
    parts = [counts[row::2, column::2] for row, column in places_of(plane, cell=cell)]
    if len(parts) == 1:
        return parts[0].copy()
    if saturated_as_dn > _MOST_DN:
        raise LimitError(
            f"plane {plane}: sums reach {saturated_as_dn} DN, and counts {_MOST_DN} at most: take one colour"
        )
    height, width = counts.shape[0] // 2, counts.shape[1] // 2
    total = np.zeros((height, width), dtype=np.uint32)
    is_saturated = np.zeros((height, width), dtype=np.bool_)
    for part in (part[:height, :width] for part in parts):
        total += part
        is_saturated |= part >= saturation_dn
    total[is_saturated] = saturated_as_dn
    return total.astype(np.uint16)


def counts_of_picture(
    counts: NDArray[np.uint16], *, pixel_format: PixelFormat, plane: Plane | None
) -> NDArray[np.uint16]:
    """Return the chosen plane of a picture; the picture itself if it has no colours."""
    if pixel_format.cell is None or plane is None:
        return counts
    return take_plane(
        counts,
        cell=pixel_format.cell,
        plane=plane,
        saturation_dn=2**pixel_format.bit_depth - 1,
        saturated_as_dn=2 ** bit_depth_of(plane, bit_depth=pixel_format.bit_depth) - 1,
    )


def size_of_counts(pixel_format: PixelFormat, *, plane: Plane | None, width: int, height: int) -> tuple[int, int, int]:
    """Return width, height and bits of the counts for a camera's picture size."""
    if pixel_format.cell is None and plane is None:
        return width, height, pixel_format.bit_depth
    if pixel_format.cell is None or plane is None:
        wanted = "|".join(PLANES)
        raise LimitError(f"pixel format {pixel_format.name}: plane={wanted} is for Bayer formats only")
    width, height = plane_size(width=width, height=height, cell=pixel_format.cell, plane=plane)
    return width, height, bit_depth_of(plane, bit_depth=pixel_format.bit_depth)


def plane_size(*, width: int, height: int, cell: str, plane: Plane) -> tuple[int, int]:
    """Return width and height of a plane of a mosaic of this size."""
    if samples_of(plane) > 1:
        return width // 2, height // 2
    ((row, column),) = places_of(plane, cell=cell)
    return (width - column + 1) // 2, (height - row + 1) // 2
