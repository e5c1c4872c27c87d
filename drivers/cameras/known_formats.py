"""The formats of samples that are read, by the numbers of GigE Vision (PFNC) and the letters of V4L2."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

from drivers.cameras.pixel_format import Packing, PixelFormat


def _stream(bits: int, pixels: int, *, first_byte: int = 0) -> tuple[tuple[int, int, int], ...]:
    """Return the moves of samples of so many bits that follow each other in a stream, the lowest bit first."""
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

    Notes
    -----
    Its samples stand as those of the Mono format of the same ending. Formats of computed pictures, such as
    PolarizedDolp_Mono8, are none of these.
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
