"""A frame as a FITS file and back: 16-bit samples, first row on top, checksums, and its whole record in the header.

A lost manifest can be made again from the headers.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from textwrap import wrap
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from rigctl.errors import DataError
from rigctl.runs.records import FRAME_RECORD, FrameRecord, explain_invalid
from rigctl.version import VERSION

CARD_LENGTH = 80
_STRING_ROOM = 68  # between the quotes, where the value begins in column 11
_VALUE = re.compile(r"^ *(?:'(?P<text>(?:[^']|'')*)'|(?P<plain>[^ /']+))? *(?:/.*)?$")
_ESCAPED = re.compile(r"\\(?:x[0-9a-f]{2}|u[0-9a-f]{4}|U[0-9a-f]{8}|[nrt\\])")
_MISREAD = re.compile(r"[ &]$|'(?= */)")

CardValue = bool | int | float | str


def make_card(keyword: str, value: CardValue, comment: str) -> str:
    """Return a card, or several of 80 characters for a long text.

    FITS standard 4.0 (doi:10.1051/0004-6361/201015362), sections 4.1, 4.2; 4.2.1.2 for long texts (CONTINUE).
    """
    if isinstance(value, str):
        return _make_text_cards(keyword, value, comment)
    return _pad(f"{keyword:<8}= {_number(value):>20}", comment)


def _number(value: bool | int | float) -> str:
    if isinstance(value, bool):
        return "T" if value else "F"
    # repr of numpy's scalars includes their type.
    return repr(float(value) if isinstance(value, float) else value).upper()


def _pad(body: str, comment: str) -> str:
    return f"{body} / {comment}"[:CARD_LENGTH].ljust(CARD_LENGTH)


def _make_text_cards(keyword: str, value: str, comment: str) -> str:
    quoted = _escape(value).replace("'", "''")
    if len(quoted) <= _STRING_ROOM:
        return _pad(f"{keyword:<8}= {_quote(quoted):<20}", comment)
    first, *rest = _split_quoted(quoted)
    cards = [f"{keyword:<8}= '{first}&'"]
    cards += [f"CONTINUE  '{piece}&'" for piece in rest[:-1]]
    cards.append(f"CONTINUE  '{rest[-1]}'")
    return "".join(card.ljust(CARD_LENGTH) for card in cards)


def _quote(quoted: str) -> str:
    return f"'{quoted:<8}'"


def _escape(value: str) -> str:
    text = value.encode("unicode_escape").decode("ascii")
    # FITS ignores blanks at the end of a text; "&" there may mean "to be continued"; and astropy ends the text at a
    # quote before a slash.
    return _MISREAD.sub(lambda found: f"\\x{ord(found[0]):02x}", text)


def _split_quoted(quoted: str) -> list[str]:
    pieces = []
    while quoted:
        size = _STRING_ROOM - 1  # room for "&"
        # A doubled quote is one character and must not be split.
        quotes_at_end = len(quoted[:size]) - len(quoted[:size].rstrip("'"))
        size -= quotes_at_end % 2
        pieces.append(quoted[:size])
        quoted = quoted[size:]
    return pieces


def read_cards(header: bytes) -> dict[str, str | None]:
    """Return the values of a header by keyword, texts unquoted and joined, numbers as text."""
    values: dict[str, str | None] = {}
    for keyword, field in _join_continued(header.decode("ascii")):
        match = _VALUE.match(field)
        if match is None:
            raise ValueError(f"card {keyword}: no value can be read from {field.strip()!r}")
        text = match["text"]
        values[keyword] = match["plain"] if text is None else _unescape(text)
    return values


def _unescape(text: str) -> str:
    plain = text.rstrip(" ").replace("''", "'")
    return _ESCAPED.sub(lambda found: found[0].encode("ascii").decode("unicode_escape"), plain)


def _join_continued(header: str) -> Iterator[tuple[str, str]]:
    keyword, field = "", ""
    for start in range(0, len(header), CARD_LENGTH):
        card = header[start : start + CARD_LENGTH]
        if card.startswith("CONTINUE  ") and field.rstrip().endswith("&'"):
            field = field.rstrip()[:-2] + card[10:].lstrip()[1:]
            continue
        if keyword:
            yield keyword, field
        keyword, field = (card[:8].rstrip(), card[10:]) if card[8:10] == "= " else ("", "")
    if keyword:
        yield keyword, field


ALL_ONES = 0xFFFF_FFFF
NO_CHECKSUM = "0" * 16
# ASCII codes between digits and letters, excluded from encoded sums.
_PUNCTUATION = frozenset(range(0x3A, 0x41)) | frozenset(range(0x5B, 0x61))


def ones_complement_sum(data: bytes | memoryview) -> int:
    """Return the 32-bit sum with end-around carry of big-endian words.

    FITS standard 4.0 (doi:10.1051/0004-6361/201015362), appendix J.
    """
    total = int(np.frombuffer(data, dtype=">u4").sum(dtype=np.uint64))
    while total >> 32:
        total = (total & ALL_ONES) + (total >> 32)
    return total


def encode_checksum(total: int) -> str:
    """Return the sixteen letters and digits that bring a header-and-data sum to all ones.

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


def encode_frame(counts: NDArray[Any], cards: Mapping[str, tuple[CardValue, str]]) -> bytes:
    """Return the bytes of a FITS file with one frame: of unsigned 16 bits, or in single precision.

    FITS has only signed 16-bit integers; unsigned ones are stored less 32768 (``BZERO``), which every reader undoes.
    ``ROWORDER = 'TOP-DOWN'`` means that the first row in the file is the top of the picture.

    FITS standard 4.0 (doi:10.1051/0004-6361/201015362), sections 4.4 and 5.2.5, appendix J.
    """
    plain = counts.astype(">f4").tobytes() if counts.dtype == np.float32 else _to_signed(counts)
    is_real, (height, width) = counts.dtype == np.float32, counts.shape
    sizes: list[tuple[str, CardValue, str]] = [
        ("SIMPLE", True, "FITS standard 4.0"),
        ("BITPIX", -32 if is_real else 16, "bits of a stored sample"),
        ("NAXIS", 2, ""),
        ("NAXIS1", width, "columns"),
        ("NAXIS2", height, "rows"),
        *(() if is_real else (("BZERO", 32768, "samples are unsigned"), ("BSCALE", 1, ""))),
        ("ROWORDER", "TOP-DOWN", "the first row is the top of the picture"),
    ]
    return _whole_file(sizes, cards, plain)


def encode_image(
    image: NDArray[np.generic],
    cards: Mapping[str, tuple[CardValue, str]],
    *,
    comments: Iterable[str] = (),
    is_extension: bool = False,
) -> bytes:
    """Return the bytes of a FITS file, or of an extension, with a computed image or a stack of images."""
    first = ("XTENSION", "IMAGE", "FITS standard 4.0") if is_extension else ("SIMPLE", True, "FITS standard 4.0")
    sizes: list[tuple[str, CardValue, str]] = [
        first,
        ("BITPIX", _BITPIX[image.dtype.name], "bits of a sample, below 0 for real numbers"),
        ("NAXIS", image.ndim, ""),
        *((f"NAXIS{k}", length, "") for k, length in enumerate(reversed(image.shape), start=1)),
        *((("PCOUNT", 0, ""), ("GCOUNT", 1, "")) if is_extension else ()),
    ]
    swapped = image.astype(image.dtype.newbyteorder(">"))
    text = "".join(f"COMMENT {line:<72}" for comment in comments for line in wrap(comment, 72))
    return _whole_file(sizes, cards, swapped.tobytes(), text)


def _whole_file(
    sizes: Iterable[tuple[str, CardValue, str]],
    cards: Mapping[str, tuple[CardValue, str]],
    samples: bytes,
    comments: str = "",
) -> bytes:
    data = _fill_block(samples, b"\0")
    text = "".join(make_card(*size) for size in sizes)
    text += "".join(make_card(key, *card) for key, card in cards.items()) + comments
    text += make_card("DATASUM", str(ones_complement_sum(data)), "sum of the data, 32 bit")
    unsummed = _header(text, NO_CHECKSUM)
    total = ones_complement_sum(unsummed + data)
    return _header(text, encode_checksum(total)) + data


def _header(text: str, checksum: str) -> bytes:
    return _fill_block((text + make_card("CHECKSUM", checksum, "sum of the whole file")).encode("ascii") + _END, b" ")


def _to_signed(counts: NDArray[np.uint16]) -> bytes:
    return (counts ^ _SIGN_BIT).astype(">u2").tobytes()


def _fill_block(data: bytes, filler: bytes) -> bytes:
    return data + filler * (_padded(len(data)) - len(data))


def _padded(length: int) -> int:
    return length + (-length % _BLOCK)


def decode_frame(data: bytes | memoryview) -> tuple[dict[str, str | None], NDArray[Any]]:
    """Return header values and samples from the bytes of a file of ``encode_frame``, not of other FITS files.

    Values are the texts of the file by keyword, None for a keyword without a value. Samples are in DN, first row on
    top, as unsigned 16-bit integers or in single precision.
    """
    end = _find_end(data)
    header_length = _padded(end + CARD_LENGTH)
    if ones_complement_sum(data) != ALL_ONES:
        raise DataError(_what_is_damaged(data[:header_length], data[header_length:]))
    values = read_cards(bytes(data[:end]))
    height, width = _shape(values)
    is_real = values["BITPIX"] == "-32"
    if len(data) != header_length + _padded((4 if is_real else 2) * height * width):
        raise DataError(f"{len(data)} bytes do not fit {height} rows of {width} samples")
    if is_real:
        real = np.frombuffer(data, dtype=">f4", count=height * width, offset=header_length)
        return values, real.astype(np.float32).reshape(height, width)
    return values, _from_signed(data, (height, width), offset=header_length)


def _find_end(data: bytes | memoryview) -> int:
    if data[: len(_BEGIN)] != _BEGIN or len(data) % _BLOCK:
        raise DataError(f"not a whole FITS file: its {len(data)} bytes begin wrongly or are not a multiple of {_BLOCK}")
    for start in range(0, len(data), CARD_LENGTH):
        if data[start : start + CARD_LENGTH] == _END:
            return start
    raise DataError("not a whole FITS file: the header has no end")


def _what_is_damaged(header: bytes | memoryview, data: bytes | memoryview) -> str:
    stated = _STATED_SUM.search(header)
    if stated is None:
        return "the header is damaged: no DATASUM can be read from it"
    samples_are_sound = int(stated[1]) == ones_complement_sum(data)
    return "the header is damaged (CHECKSUM)" if samples_are_sound else "the samples are damaged (DATASUM)"


def _shape(values: Mapping[str, str | None]) -> tuple[int, int]:
    wanted = {"NAXIS": "2", "ROWORDER": "TOP-DOWN"}
    if values.get("BITPIX") != "-32":
        wanted |= {"BITPIX": "16", "BZERO": "32768", "BSCALE": "1"}
    other = [f"{key} = {values.get(key)}" for key, value in wanted.items() if values.get(key) != value]
    if other:
        raise DataError(f"not a frame of this program: {', '.join(other)}. `rigctl import` imports other files")
    return int(values["NAXIS2"] or "0"), int(values["NAXIS1"] or "0")


def _from_signed(data: bytes | memoryview, shape: tuple[int, int], *, offset: int) -> NDArray[np.uint16]:
    height, width = shape
    # One copy for the caller; the bytes of a file stay unchanged.
    counts = np.frombuffer(data, dtype=">u2", count=height * width, offset=offset).astype(np.uint16)
    counts ^= _SIGN_BIT
    return counts.reshape(shape)


# Field of the record, keyword, comment.
_KEYWORDS = (
    ("kind", "IMAGETYP", "scene, dark or flat"),
    ("sequence", "SEQ", "place in the order of the run, from 0"),
    ("cycle", "CYCLE", "repeat of the set of angles, from 0"),
    ("start_utc", "DATE-OBS", "start of exposure, UTC"),
    ("end_utc", "DATE-END", "end of exposure, UTC"),
    ("start_monotonic_ns", "MONONS", "[ns] start of exposure, host clock"),
    ("start_uncertainty_s", "TIMSYER", "[s] largest error of DATE-OBS"),
    ("start_source", "TIMESRC", "source of DATE-OBS"),
    ("exposure_s", "EXPTIME", "[s] exposure"),
    ("gain_db", "GAINDB", "[dB] setting of the camera"),
    ("egain_e_per_dn", "EGAIN", "[e-/DN] electrons per count"),
    ("bit_depth", "BITDEPTH", "bits per sample, right-justified"),
    ("reads", "NCOMBINE", "reads of the camera averaged in the frame"),
    ("real_counts", "REALDN", "counts with fractions, or below 0"),
    ("black_level_dn", "BLKLEVEL", "[DN] counts without light"),
    ("saturation_dn", "SATURATE", "[DN] saturated at and above"),
    ("missing_dn", "MISSDN", "[DN] value of missing pixels"),
    ("saturated_fraction", "SATFRAC", "share of saturated pixels"),
    ("polarizer_angle_target_deg", "POLANG", "[deg] transmission axis, commanded"),
    ("polarizer_angle_deg", "POLMEAS", "[deg] transmission axis, readback"),
    ("stage_angle_target_deg", "STGANG", "[deg] stage, commanded"),
    ("stage_angle_deg", "STGMEAS", "[deg] stage, readback"),
    ("stage_counts", "STGCNT", "stage, counts of the encoder"),
    ("camera_model", "CAMERA", "camera"),
    ("camera_serial", "CAMSN", "its serial number"),
    ("filter_name", "FILTER", "filter"),
    ("stage_model", "STAGE", "rotation stage"),
    ("stage_serial", "STAGESN", "its serial number"),
    ("stage_tries", "POLTRY", "commands of the move until within tolerance"),
    ("settle_s", "SETTLE", "[s] command of the move to accepted readback"),
    ("camera_frame", "CAMFRAME", "the camera's own frame counter"),
    ("exposure_id", "EXPOID", "equal for frames of one exposure"),
    ("camera_temperature_c", "CCD-TEMP", "[deg C] reported by the camera"),
    ("round", "ROUND", "round of the schedule, from 0"),
    ("sun_azimuth_deg", "SUNAZ", "[deg] sun, clockwise from north"),
    ("sun_elevation_deg", "SUNEL", "[deg] sun, no refraction"),
    ("site_latitude_deg", "SITELAT", "[deg] north positive"),
    ("site_longitude_deg", "SITELONG", "[deg] east positive"),
    ("site_elevation_m", "SITEELEV", "[m] above the sea"),
    ("source_file", "SRCFILE", "imported from"),
)
_TIMES = ("start_utc", "end_utc")
_REMARK = "REMARK"
_MOST_REMARKS = 99


def header_cards(record: FrameRecord) -> dict[str, tuple[CardValue, str]]:
    """Return the header cards of a frame by keyword: value and comment."""
    if len(record.remarks) > _MOST_REMARKS:
        raise ValueError(f"remarks: {len(record.remarks)} given, at most {_MOST_REMARKS} fit a frame")
    for time in filter(None, (record.start_utc, record.end_utc)):
        if not time.endswith("Z"):
            raise ValueError(f"start_utc, end_utc: {time!r} must be UTC and end in Z, as from utc_text")
    cards: dict[str, tuple[CardValue, str]] = {"TIMESYS": ("UTC", ""), "BUNIT": ("DN", "unit of the samples")}
    for field, keyword, comment in _KEYWORDS:
        value = getattr(record, field)
        if value is not None:
            # A FITS date has no zone; TIMESYS says that it is UTC.
            stated = value.removesuffix("Z") if field in _TIMES else value
            cards[keyword] = (stated, comment)
    cards |= {f"{_REMARK}{i}": (text, "") for i, text in enumerate(record.remarks, start=1)}
    return cards | {"SWVER": (f"rigctl {VERSION}", "program")}


def decode_record(data: bytes | memoryview, *, file: str, checksum: str) -> tuple[FrameRecord, NDArray[Any]]:
    """Return the record in the header of a frame's file, and the samples."""
    header, counts = decode_frame(data)
    values: dict[str, object] = {field: header.get(keyword) for field, keyword, _ in _KEYWORDS}
    for field in _TIMES:
        values[field] = f"{values[field]}Z" if values[field] is not None else None
    height, width = counts.shape
    values |= {"height": height, "width": width, "file": file, "checksum": checksum}
    remarks = (f"{_REMARK}{number}" for number in range(1, _MOST_REMARKS + 1))
    values["remarks"] = tuple(header[name] or "" for name in remarks if name in header)
    try:
        # Values are still text; the type of each field converts its own.
        return FRAME_RECORD.validate_python(values, strict=False), counts
    except ValidationError as error:
        raise DataError(f"{file}: the header does not describe a frame: {explain_invalid(error)}") from error
