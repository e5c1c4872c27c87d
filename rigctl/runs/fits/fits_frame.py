"""One frame as the bytes of a FITS file, and back: 16-bit samples, first row on top, with checksums."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import DataError
from rigctl.runs.fits.fits_card import CARD_LENGTH, CardValue, make_card, read_cards

ALL_ONES = 0xFFFF_FFFF
NO_CHECKSUM = "0" * 16
# Encoded sums are letters and digits only: these ASCII codes lie between them.
_PUNCTUATION = frozenset(range(0x3A, 0x41)) | frozenset(range(0x5B, 0x61))


def ones_complement_sum(data: bytes | memoryview) -> int:
    """Return the 32-bit sum with end-around carry of big-endian words.

    Parameters
    ----------
    data : bytes
        A whole number of words of four bytes, at most 2**34 bytes (so that the sum fits 64 bits).

    References
    ----------
    FITS standard 4.0 (doi:10.1051/0004-6361/201015362), appendix J.
    """
    total = int(np.frombuffer(data, dtype=">u4").sum(dtype=np.uint64))
    while total >> 32:
        total = (total & ALL_ONES) + (total >> 32)
    return total


def encode_checksum(total: int) -> str:
    """Return the sixteen letters and digits that bring a header-and-data sum to all ones.

    Parameters
    ----------
    total : int
        ``ones_complement_sum`` of the whole unit with ``NO_CHECKSUM`` in the place of the checksum.

    References
    ----------
    FITS standard 4.0 (doi:10.1051/0004-6361/201015362), appendix J: each byte of the complement is shared
    out over four characters, which stand four apart; the whole is turned right by one, since a card's value
    begins one byte before a word does.
    """
    complement = ALL_ONES - total
    columns = [_share_out(byte) for byte in complement.to_bytes(4, "big")]
    text = "".join(chr(columns[i][j]) for j in range(4) for i in range(4))
    return text[-1] + text[:-1]


def _share_out(byte: int) -> list[int]:
    quarter, rest = divmod(byte, 4)
    codes = [ord("0") + quarter + rest] + [ord("0") + quarter] * 3
    while any(code in _PUNCTUATION for code in codes):
        for i in (0, 2):
            if codes[i] in _PUNCTUATION or codes[i + 1] in _PUNCTUATION:
                codes[i] += 1
                codes[i + 1] -= 1
    return codes


_BLOCK = 2880
_BITPIX = {"uint8": 8, "int16": 16, "int32": 32, "float32": -32, "float64": -64}
_SIGN_BIT = np.uint16(0x8000)
_STATED_SUM = re.compile(rb"DATASUM = '([0-9]+) *'")
_BEGIN, _END = b"SIMPLE  =", b"END".ljust(CARD_LENGTH)


@dataclass(frozen=True, kw_only=True)
class FitsFrame:
    """A frame's header values as text, and its samples.

    Attributes
    ----------
    values : mapping
        Value by keyword; numbers as they stand in the file, ``None`` where a keyword has no value.
    counts : (H, W) array of uint16
        Samples in DN, first row on top.
    """

    values: dict[str, str | None]
    counts: NDArray[np.uint16]


def encode_frame(counts: NDArray[np.uint16], cards: Mapping[str, tuple[CardValue, str]]) -> bytes:
    """Return the bytes of a FITS file that holds one frame.

    Parameters
    ----------
    counts : (H, W) array of uint16
        Samples in DN, first row on top.
    cards : mapping of keyword to (value, comment)
        What else the header is to say.

    Notes
    -----
    FITS knows signed 16-bit integers only; unsigned ones are stored less 32768 (``BZERO``), which every
    reader of FITS undoes. ``ROWORDER = 'TOP-DOWN'`` tells that the first row in the file is the
    top of the picture.

    References
    ----------
    FITS standard 4.0 (doi:10.1051/0004-6361/201015362), sections 4.4 and 5.2.5, appendix J.
    """
    return _whole_file(_size_cards(counts.shape), cards, _to_signed(counts))


def encode_image(image: NDArray[np.generic], cards: Mapping[str, tuple[CardValue, str]]) -> bytes:
    """Return the bytes of a FITS file that holds a computed image, or a stack of them, as any reader of FITS reads it.

    Parameters
    ----------
    image : (..., H, W) array of uint8, int16, int32, float32 or float64
        First row on top.
    cards : mapping of keyword to (value, comment)
        What the header is to say beside the size.
    """
    sizes: list[tuple[str, CardValue, str]] = [
        ("SIMPLE", True, "FITS standard 4.0"),
        ("BITPIX", _BITPIX[image.dtype.name], "bits of a sample, below 0 for real numbers"),
        ("NAXIS", image.ndim, ""),
        *((f"NAXIS{k}", length, "") for k, length in enumerate(reversed(image.shape), start=1)),
    ]
    swapped = image.astype(image.dtype.newbyteorder(">"))
    return _whole_file("".join(make_card(*size) for size in sizes), cards, swapped.tobytes())


def _whole_file(sizes: str, cards: Mapping[str, tuple[CardValue, str]], samples: bytes) -> bytes:
    data = _pad(samples, b"\0")
    text = sizes + "".join(make_card(key, *card) for key, card in cards.items())
    text += make_card("DATASUM", str(ones_complement_sum(data)), "sum of the data, 32 bit")
    unsummed = _header(text, NO_CHECKSUM)
    total = ones_complement_sum(unsummed + data)
    return _header(text, encode_checksum(total)) + data


def _header(text: str, checksum: str) -> bytes:
    return _pad((text + make_card("CHECKSUM", checksum, "sum of the whole file")).encode("ascii") + _END, b" ")


def _size_cards(shape: tuple[int, ...]) -> str:
    height, width = shape
    values: list[tuple[str, CardValue, str]] = [
        ("SIMPLE", True, "FITS standard 4.0"),
        ("BITPIX", 16, "bits of a stored sample"),
        ("NAXIS", 2, ""),
        ("NAXIS1", width, "columns"),
        ("NAXIS2", height, "rows"),
        ("BZERO", 32768, "samples are unsigned"),
        ("BSCALE", 1, ""),
        ("ROWORDER", "TOP-DOWN", "the first row is the top of the picture"),
    ]
    return "".join(make_card(*value) for value in values)


def _to_signed(counts: NDArray[np.uint16]) -> bytes:
    return (counts ^ _SIGN_BIT).astype(">u2").tobytes()


def _pad(data: bytes, filler: bytes) -> bytes:
    return data + filler * (_padded(len(data)) - len(data))


def _padded(length: int) -> int:
    return length + (-length % _BLOCK)


def decode_frame(data: bytes | memoryview) -> FitsFrame:
    """Return a frame from the bytes of a file that ``encode_frame`` made.

    Raises
    ------
    DataError
        A checksum fails, the file is cut off or too long, or it is no frame of ours.

    Notes
    -----
    Reads what this program writes, and no other kind of FITS.
    """
    end = _find_end(data)
    header_length = _padded(end + CARD_LENGTH)
    if ones_complement_sum(data) != ALL_ONES:
        raise DataError(_what_is_damaged(data[:header_length], data[header_length:]))
    values = read_cards(bytes(data[:end]))
    height, width = _shape(values)
    if len(data) != header_length + _padded(2 * height * width):
        raise DataError(f"{len(data)} bytes are not what {height} rows of {width} samples take")
    return FitsFrame(values=values, counts=_from_signed(data, (height, width), offset=header_length))


def _find_end(data: bytes | memoryview) -> int:
    if data[: len(_BEGIN)] != _BEGIN or len(data) % _BLOCK:
        raise DataError(f"no whole FITS file: its {len(data)} bytes begin wrongly or are no multiple of {_BLOCK}")
    for start in range(0, len(data), CARD_LENGTH):
        if data[start : start + CARD_LENGTH] == _END:
            return start
    raise DataError("no whole FITS file: the header has no end")


def _what_is_damaged(header: bytes | memoryview, data: bytes | memoryview) -> str:
    stated = _STATED_SUM.search(header)
    if stated is None:
        return "the header is damaged: no DATASUM can be read from it"
    samples_are_sound = int(stated[1]) == ones_complement_sum(data)
    return "the header is damaged (CHECKSUM)" if samples_are_sound else "the samples are damaged (DATASUM)"


def _shape(values: Mapping[str, str | None]) -> tuple[int, int]:
    wanted = {"BITPIX": "16", "NAXIS": "2", "BZERO": "32768", "BSCALE": "1", "ROWORDER": "TOP-DOWN"}
    other = [f"{key} = {values.get(key)}" for key, value in wanted.items() if values.get(key) != value]
    if other:
        raise DataError(f"no frame that this program wrote: {', '.join(other)}. `rigctl import` takes in other files")
    return int(values["NAXIS2"] or "0"), int(values["NAXIS1"] or "0")


def _from_signed(data: bytes | memoryview, shape: tuple[int, int], *, offset: int) -> NDArray[np.uint16]:
    height, width = shape
    # One copy, which is the caller's own: the bytes of a file stay as they are.
    counts = np.frombuffer(data, dtype=">u2", count=height * width, offset=offset).astype(np.uint16)
    counts ^= _SIGN_BIT
    return counts.reshape(shape)
