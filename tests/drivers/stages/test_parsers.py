"""What the parsers of all families promise of any stream, however it is cut and damaged."""

import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.stages import apt, elliptec, zaber
from tests.drivers.stages.lines import cut, damaged, read_all

HOMED = bytes.fromhex("44 04 01 00 01 50")
APT = st.one_of(
    st.builds(
        lambda stepper, counts, bits: (
            (b"\x81\x04" if stepper else b"\x91\x04") + b"\x0e\x00\x81\x50" + struct.pack("<HiiI", 1, counts, 0, bits)
        ),
        st.booleans(),
        st.integers(-(1 << 31), (1 << 31) - 1),
        st.integers(0, (1 << 32) - 1),
    ),
    st.just(HOMED),
    st.just(bytes.fromhex("12 02 01 01 01 50")),
)
ADDRESSES = st.sampled_from("0123456789ABCDEF")
ELLX = st.one_of(
    st.builds(lambda a, v: f"{a}GS{v:02X}\r\n".encode(), ADDRESSES, st.integers(0, 255)),
    st.builds(lambda a, v: f"{a}PO{v:08X}\r\n".encode(), ADDRESSES, st.integers(0, (1 << 32) - 1)),
    st.builds(lambda a, v: f"{a}BO{v:08X}\r\n".encode(), ADDRESSES, st.integers(0, (1 << 32) - 1)),
    st.just(b"0IN0E1140132620251801016800023000\r\n"),
)


def zaber_line(device: int, message_id: int, flag: str, state: str, data: str) -> bytes:
    text = f"{device:02d} 1 {message_id:02d} {flag} {state} -- {data}"
    # By other means than the driver's: the digits that bring the sum to a multiple of 256.
    check = next(f"{n:02X}" for n in range(256) if (sum(text.encode()) + n) % 256 == 0)
    return f"@{text}:{check}\r\n".encode()


ZABER = st.builds(
    zaber_line,
    st.integers(1, 99),
    st.integers(0, 99),
    st.sampled_from(["OK", "RJ"]),
    st.sampled_from(["BUSY", "IDLE"]),
    st.one_of(st.integers(-(10**9), 10**9).map(str), st.just("BADDATA")),
)


def zaber_text(event: zaber.Reply) -> bytes:
    flag, state = "OK" if event.accepted else "RJ", "BUSY" if event.busy else "IDLE"
    message_id = "" if event.message_id is None else f"{event.message_id:02d} "
    return f"@{event.device:02d} {event.axis} {message_id}{flag} {state} {event.flag} {event.data}".encode()


# Parser, its messages, how an event was written, and what makes it ready for the next message after damage.
FAMILIES = {
    "apt": (apt.MessageParser, APT, lambda event: event, None, HOMED),
    "ellx": (elliptec.ReplyParser, ELLX, lambda reply: "".join(reply).encode() + b"\r\n", b"\n", b"0PO00004600\r\n"),
    "zaber": (zaber.ReplyParser, ZABER, zaber_text, b"\n", b"@01 0 OK IDLE -- 0:8D\r\n"),
}
PLACES = st.lists(st.integers(0, 400), max_size=12)
families = pytest.mark.parametrize("family", list(FAMILIES))


def streams(family: str) -> st.SearchStrategy[list[bytes]]:
    return st.lists(FAMILIES[family][1], min_size=1, max_size=8)


@families
@settings(deadline=None, max_examples=100)
@given(data=st.data(), at=PLACES)
def test_a_sound_stream_gives_every_message_wherever_it_is_cut(family: str, data: st.DataObject, at: list[int]) -> None:
    parser, _, written, _, _ = FAMILIES[family]
    messages = data.draw(streams(family))
    events = read_all(parser(), cut(b"".join(messages), at))
    assert all(message.startswith(written(event)) for message, event in zip(messages, events, strict=True))


@families
@settings(deadline=None, max_examples=200)
@given(data=st.data(), at=PLACES)
def test_only_messages_that_came_whole_are_told(family: str, data: st.DataObject, at: list[int]) -> None:
    parser, _, written, _, _ = FAMILIES[family]
    stream = data.draw(damaged(streams(family).map(b"".join)))
    assert all(written(event) in stream for event in read_all(parser(), cut(stream, at)))


@families
@settings(deadline=None, max_examples=200)
@given(data=st.data())
def test_the_next_good_message_is_read_after_damage(family: str, data: st.DataObject) -> None:
    make, _, written, end, good = FAMILIES[family]
    parser: Any = make()
    read_all(parser, [data.draw(damaged(streams(family).map(b"".join))) + (end or b"")])
    if end is None:
        parser.reset()  # what the link does after a silence
    assert good.startswith(written(read_all(parser, [good])[-1]))


@families
@settings(deadline=None, max_examples=100)
@given(pieces=st.lists(st.binary(max_size=1500), max_size=6))
def test_any_bytes_at_all_raise_nothing_but_protocol_errors(family: str, pieces: list[bytes]) -> None:
    read_all(FAMILIES[family][0](), pieces)


@settings(deadline=None, max_examples=200)
@given(stream=damaged(streams("apt").map(b"".join)))
def test_after_damage_without_a_silence_apt_loses_at_most_ninety_bytes(stream: bytes) -> None:
    # The longest message has 90 bytes: a false beginning takes no more than that, 15 short messages.
    assert read_all(apt.MessageParser(), [stream, HOMED * 31])[-1] == HOMED


@settings(deadline=None, max_examples=200)
@given(stream=streams("zaber").map(b"".join), place=st.integers(0, 10**6), change=st.integers(1, 255))
def test_one_changed_byte_of_zabers_is_always_noticed(stream: bytes, place: int, change: int) -> None:
    """The sum of a message changes with any one of its bytes; only a lost colon leaves a reply that is not checked."""
    sound = read_all(zaber.ReplyParser(), [stream])
    data = bytearray(stream)
    data[place % len(data)] ^= change
    found = read_all(zaber.ReplyParser(), [bytes(data)])
    assert all(event in sound for event in found if isinstance(event, zaber.Reply) and event.checked)
