"""One frame as the bytes of a FITS file, and back: 16-bit samples, first row on top, with checksums."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import DataError
from rigctl.runs.fits.fits_card import CARD_LENGTH, CardValue, make_card, read_cards
from rigctl.runs.fits.fits_checksum import ALL_ONES, NO_CHECKSUM, encode_checksum, ones_complement_sum

_BLOCK = 2880
_SIGN_BIT = np.uint16(0x8000)
_STATED_SUM = re.compile(rb"DATASUM = '([0-9]+) *'")
_END = b"END".ljust(CARD_LENGTH)


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
    data = _pad(_to_signed(counts), b"\0")
    text = _size_cards(counts.shape) + "".join(make_card(key, *card) for key, card in cards.items())
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


def decode_frame(data: bytes) -> FitsFrame:
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
    values = read_cards(data[:end])
    height, width = _shape(values)
    if len(data) != header_length + _padded(2 * height * width):
        raise DataError(f"{len(data)} bytes are not what {height} rows of {width} samples take")
    return FitsFrame(values=values, counts=_from_signed(data[header_length:], (height, width)))


def _find_end(data: bytes) -> int:
    if not data.startswith(b"SIMPLE  =") or len(data) % _BLOCK:
        raise DataError(f"no whole FITS file: its {len(data)} bytes begin wrongly or are no multiple of {_BLOCK}")
    for start in range(0, len(data), CARD_LENGTH):
        if data[start : start + CARD_LENGTH] == _END:
            return start
    raise DataError("no whole FITS file: the header has no end")


def _what_is_damaged(header: bytes, data: bytes) -> str:
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


def _from_signed(data: bytes, shape: tuple[int, int]) -> NDArray[np.uint16]:
    height, width = shape
    stored = np.frombuffer(data, dtype=">u2", count=height * width).astype(np.uint16)
    return (stored ^ _SIGN_BIT).reshape(shape)
