"""Header cards of a FITS file: a keyword, a value, and a word on what it means; 80 characters each."""

import re
from collections.abc import Iterator

CARD_LENGTH = 80
_STRING_ROOM = 68  # between the quotes, where the value begins in column 11
_VALUE = re.compile(r"^ *(?:'(?P<text>(?:[^']|'')*)'|(?P<plain>[^ /']+))? *(?:/.*)?$")
_ESCAPED = re.compile(r"\\(?:x[0-9a-f]{2}|u[0-9a-f]{4}|U[0-9a-f]{8}|[nrt\\])")
_MISREAD = re.compile(r"[ &]$|'(?= */)")

CardValue = bool | int | float | str


def make_card(keyword: str, value: CardValue, comment: str) -> str:
    """Return a card, or several of 80 characters each where a text is too long for one.

    Parameters
    ----------
    keyword : str
        At most eight of ``A-Z 0-9 _ -``.
    value : bool, int, finite float or str
        A text may hold any character: what is not printable ASCII is escaped as in Python source.
    comment : str
        Shortened where there is no room for all of it.

    References
    ----------
    FITS standard 4.0 (doi:10.1051/0004-6361/201015362), sections 4.1, 4.2; 4.2.1.2 for long texts (CONTINUE).
    """
    if isinstance(value, str):
        return _make_text_cards(keyword, value, comment)
    return _pad(f"{keyword:<8}= {_number(value):>20}", comment)


def _number(value: bool | int | float) -> str:
    if isinstance(value, bool):
        return "T" if value else "F"
    # numpy's scalars are floats that write themselves with their type.
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
    # Blanks at the end of a text do not count in FITS; "&" there may stand for "to be continued"; and astropy takes
    # a quote before a slash for the end of the text.
    return _MISREAD.sub(lambda found: f"\\x{ord(found[0]):02x}", text)


def _split_quoted(quoted: str) -> list[str]:
    pieces = []
    while quoted:
        size = _STRING_ROOM - 1  # room for "&"
        # A doubled quote stands for one character and must not be torn.
        quotes_at_end = len(quoted[:size]) - len(quoted[:size].rstrip("'"))
        size -= quotes_at_end % 2
        pieces.append(quoted[:size])
        quoted = quoted[size:]
    return pieces


def read_cards(header: bytes) -> dict[str, str | None]:
    """Return the values of a header by keyword, texts unquoted and joined, numbers still as they stand.

    Parameters
    ----------
    header : bytes
        Whole cards, without the one that says END.

    Raises
    ------
    ValueError
        A card is no ASCII, or has no value that can be read.
    """
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
