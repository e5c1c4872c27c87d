"""Streams of bytes that were cut and damaged, and a parser that is fed with them."""

import itertools
from typing import Protocol, TypeVar

from hypothesis import strategies as st

from drivers.errors import ProtocolError

EventT = TypeVar("EventT", covariant=True)


class Parser(Protocol[EventT]):
    def feed(self, data: bytes) -> None: ...

    def next_event(self) -> EventT | None: ...


def read_all(parser: Parser[EventT], pieces: list[bytes]) -> list[EventT]:
    """Every message in the pieces, errors left out; any exception but ProtocolError escapes."""
    events: list[EventT] = []
    for piece in pieces:
        try:
            parser.feed(piece)
        except ProtocolError:
            continue
        events += read_waiting(parser)
    return events


def read_waiting(parser: Parser[EventT]) -> list[EventT]:
    events: list[EventT] = []
    while True:
        try:
            event = parser.next_event()
        except ProtocolError:
            continue
        if event is None:
            return events
        events.append(event)


def cut(data: bytes, at: list[int]) -> list[bytes]:
    edges = [0, *sorted({place % (len(data) + 1) for place in at}), len(data)]
    return [data[start:end] for start, end in itertools.pairwise(edges)]


@st.composite
def damaged(draw: st.DrawFn, sound: st.SearchStrategy[bytes]) -> bytes:
    """A sound stream with one to six bytes dropped, changed or inserted."""
    data = bytearray(draw(sound))
    for _ in range(draw(st.integers(1, 6))):
        place = draw(st.integers(0, max(0, len(data) - 1)))
        kind = draw(st.sampled_from(["drop", "flip", "insert"]))
        if kind == "insert":
            data.insert(place, draw(st.integers(0, 255)))
        elif data and kind == "drop":
            del data[place]
        elif data:
            data[place] ^= draw(st.integers(1, 255))
    return bytes(data)


PLACES = st.lists(st.integers(0, 400), max_size=12)
RUBBISH = st.lists(st.binary(max_size=1500), max_size=6)
