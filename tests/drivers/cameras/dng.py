"""Writes DNG files whose every number is known: TIFF by hand, uncompressed."""

import struct

import numpy as np

_ASCII, _SHORT, _LONG, _RATIONAL, _BYTE, _SRATIONAL = 2, 3, 4, 5, 1, 10
_LETTERS = {_ASCII: "s", _SHORT: "H", _LONG: "I", _RATIONAL: "I", _BYTE: "B", _SRATIONAL: "i"}
_STRIP, _EXIF = 273, 34665


def write_dng(path, counts, *, black=(256, 256, 256, 256), white=4095, exposure=(1, 125), iso=100, mosaic=True):
    """Write a mosaic of red, green, green, blue, or a picture without colours.

    `black` goes row by row through the cell. `exposure` is a fraction of seconds; None leaves it out.
    """
    height, width = counts.shape
    data = np.ascontiguousarray(counts, dtype="<u2").tobytes()
    colours = {33421: (_SHORT, (2, 2)), 33422: (_BYTE, (0, 1, 1, 2))} if mosaic else {}
    cells = (2, 2) if mosaic else (1, 1)
    levels = black if mosaic else black[:1]
    main = {
        254: (_LONG, (0,)),
        256: (_LONG, (width,)),
        257: (_LONG, (height,)),
        258: (_SHORT, (16,)),
        259: (_SHORT, (1,)),
        262: (_SHORT, (32803 if mosaic else 34892,)),
        271: (_ASCII, b"Test\0"),
        272: (_ASCII, b"Test T1\0"),
        _STRIP: (_LONG, (0,)),
        274: (_SHORT, (1,)),
        277: (_SHORT, (1,)),
        278: (_LONG, (height,)),
        279: (_LONG, (len(data),)),
        284: (_SHORT, (1,)),
        **colours,
        50706: (_BYTE, (1, 4, 0, 0)),
        50707: (_BYTE, (1, 1, 0, 0)),
        50708: (_ASCII, b"Test T1\0"),
        50711: (_SHORT, (1,)),
        50713: (_SHORT, cells),
        50714: (_RATIONAL, tuple(n for level in levels for n in (level, 1))),
        50717: (_LONG, (white,)),
        50721: (_SRATIONAL, (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1)),
        50728: (_RATIONAL, (1, 1, 1, 1, 1, 1)),
        50778: (_SHORT, (21,)),
        _EXIF: (_LONG, (0,)),
    }
    exif = {34855: (_SHORT, (iso,))} | ({33434: (_RATIONAL, exposure)} if exposure else {})
    size = len(_directory(main, start=8))
    second = _directory(exif, start=8 + size)
    places = {_STRIP: 8 + size + len(second), _EXIF: 8 + size}
    main |= {tag: (_LONG, (place,)) for tag, place in places.items()}
    path.write_bytes(b"II*\0" + struct.pack("<I", 8) + _directory(main, start=8) + second + data)


def _directory(entries, *, start):
    """A directory and, behind it, the values that do not fit into its entries."""
    behind = start + 2 + 12 * len(entries) + 4
    table, values = struct.pack("<H", len(entries)), b""
    for tag in sorted(entries):
        kind, content = entries[tag]
        raw = content if kind == _ASCII else struct.pack(f"<{len(content)}{_LETTERS[kind]}", *content)
        count = len(content) // 2 if kind in (_RATIONAL, _SRATIONAL) else len(content)
        if len(raw) > 4:
            field = struct.pack("<I", behind + len(values))
            values += raw + b"\0" * (len(raw) % 2)
        else:
            field = raw.ljust(4, b"\0")
        table += struct.pack("<HHI", tag, kind, count) + field
    return table + b"\0" * 4 + values
