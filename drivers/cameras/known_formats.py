"""The formats of samples that are read, by the numbers of GigE Vision (PFNC) and the letters of V4L2."""

from collections.abc import Mapping

from drivers.cameras.pixel_format import Packing, PixelFormat

# Two samples in three bytes: high, both low parts, high (GigE Vision).
_GVSP_12 = Packing(group_bytes=3, group_pixels=2, moves=((0, 0xFF, 4), (1, 0x0F, 0), (1, 0xF0, 12), (2, 0xFF, 20)))
_GVSP_10 = Packing(group_bytes=3, group_pixels=2, moves=((0, 0xFF, 2), (1, 0x03, 0), (1, 0x30, 12), (2, 0xFF, 18)))
# One stream of bits, lowest first (PFNC's "p").
_PFNC_12 = Packing(group_bytes=3, group_pixels=2, moves=((0, 0xFF, 0), (1, 0x0F, 8), (1, 0xF0, 12), (2, 0xFF, 20)))
_PFNC_10 = Packing(
    group_bytes=5,
    group_pixels=4,
    moves=(
        (0, 0xFF, 0),
        (1, 0x03, 8),
        (1, 0xFC, 14),
        (2, 0x0F, 22),
        (2, 0xF0, 28),
        (3, 0x3F, 36),
        (3, 0xC0, 42),
        (4, 0xFF, 50),
    ),
)
# All high parts, then one byte with the low parts (MIPI CSI-2; V4L2's Y10P and Y12P).
_CSI_12 = Packing(group_bytes=3, group_pixels=2, moves=((0, 0xFF, 4), (1, 0xFF, 20), (2, 0x0F, 0), (2, 0xF0, 12)))
_CSI_10 = Packing(
    group_bytes=5,
    group_pixels=4,
    moves=(
        (0, 0xFF, 2),
        (1, 0xFF, 18),
        (2, 0xFF, 34),
        (3, 0xFF, 50),
        (4, 0x03, 0),
        (4, 0x0C, 14),
        (4, 0x30, 28),
        (4, 0xC0, 42),
    ),
)

_GREY: Mapping[int, PixelFormat] = {
    0x01080001: PixelFormat(name="Mono8", bit_depth=8, sample_bytes=1),
    0x01100003: PixelFormat(name="Mono10", bit_depth=10),
    0x01100005: PixelFormat(name="Mono12", bit_depth=12),
    0x01100025: PixelFormat(name="Mono14", bit_depth=14),
    0x01100007: PixelFormat(name="Mono16", bit_depth=16),
    0x010C0004: PixelFormat(name="Mono10Packed", bit_depth=10, packing=_GVSP_10),
    0x010C0006: PixelFormat(name="Mono12Packed", bit_depth=12, packing=_GVSP_12),
    0x010A0046: PixelFormat(name="Mono10p", bit_depth=10, packing=_PFNC_10),
    0x010C0047: PixelFormat(name="Mono12p", bit_depth=12, packing=_PFNC_12),
}
# Kind of samples -> numbers for the cells that begin with BG, GB, GR, RG.
_MOSAICS: tuple[tuple[str, PixelFormat, tuple[int, int, int, int]], ...] = (
    ("8", _GREY[0x01080001], (0x0108000B, 0x0108000A, 0x01080008, 0x01080009)),
    ("10", _GREY[0x01100003], (0x0110000F, 0x0110000E, 0x0110000C, 0x0110000D)),
    ("12", _GREY[0x01100005], (0x01100013, 0x01100012, 0x01100010, 0x01100011)),
    ("16", _GREY[0x01100007], (0x01100031, 0x01100030, 0x0110002E, 0x0110002F)),
    ("12Packed", _GREY[0x010C0006], (0x010C002D, 0x010C002C, 0x010C002A, 0x010C002B)),
    ("10p", _GREY[0x010A0046], (0x010A0052, 0x010A0054, 0x010A0056, 0x010A0058)),
    ("12p", _GREY[0x010C0047], (0x010C0053, 0x010C0055, 0x010C0057, 0x010C0059)),
)
_CELLS = ("BGGR", "GBRG", "GRBG", "RGGB")

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
}
"""Formats of GigE Vision by their number (PFNC)."""

_LETTERS_OF_MOSAICS = {
    8: ("BA81", "GBRG", "GRBG", "RGGB"),
    10: ("BG10", "GB10", "BA10", "RG10"),
    12: ("BG12", "GB12", "BA12", "RG12"),
    16: ("BYR2", "GB16", "GR16", "RG16"),
}

V4L2: Mapping[str, PixelFormat] = {
    "GREY": PixelFormat(name="GREY", bit_depth=8, sample_bytes=1),
    "Y10 ": PixelFormat(name="Y10", bit_depth=10),
    "Y12 ": PixelFormat(name="Y12", bit_depth=12),
    "Y14 ": PixelFormat(name="Y14", bit_depth=14),
    "Y16 ": PixelFormat(name="Y16", bit_depth=16),
    "Y10P": PixelFormat(name="Y10P", bit_depth=10, packing=_CSI_10),
    "Y12P": PixelFormat(name="Y12P", bit_depth=12, packing=_CSI_12),
    **{
        letters: PixelFormat(name=letters, bit_depth=bits, sample_bytes=1 if bits == 8 else 2, cell=cell)
        for bits, names in _LETTERS_OF_MOSAICS.items()
        for cell, letters in zip(_CELLS, names, strict=True)
    },
}
"""Formats of V4L2 by their four letters."""
