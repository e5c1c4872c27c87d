import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.stages.apt import Event, Homed, MessageParser, Status
from tests.drivers.stages.streams import PLACES, RUBBISH, cut, damaged, read_all, read_waiting


def status(is_stepper: bool, counts: int, bits: int) -> bytes:
    data = struct.pack("<HiiI", 1, counts, 0, bits)
    return (b"\x81\x04" if is_stepper else b"\x91\x04") + b"\x0e\x00\x81\x50" + data


MESSAGES = st.one_of(
    st.builds(status, st.booleans(), st.integers(-(1 << 31), (1 << 31) - 1), st.integers(0, (1 << 32) - 1)),
    st.just(bytes.fromhex("44 04 01 00 01 50")),
    st.just(bytes.fromhex("12 02 01 01 01 50")),
    st.just(bytes.fromhex("64 04 0e 00 81 50 01 00 ff ff ff ff 00 00 00 00 00 04 00 80")),
)
STREAMS = st.lists(MESSAGES, min_size=1, max_size=8).map(b"".join)


def read(pieces: list[bytes]) -> list[Event]:
    return read_all(MessageParser(), pieces)


@settings(deadline=None, max_examples=150)
@given(stream=STREAMS, at=PLACES)
def test_the_cuts_of_a_stream_do_not_matter(stream: bytes, at: list[int]) -> None:
    assert read(cut(stream, at)) == read([stream])


@settings(deadline=None, max_examples=150)
@given(messages=st.lists(MESSAGES, min_size=1, max_size=8))
def test_a_sound_stream_gives_every_message(messages: list[bytes]) -> None:
    assert len(read([b"".join(messages)])) == len(messages)


@settings(deadline=None, max_examples=200)
@given(stream=damaged(STREAMS), at=PLACES)
def test_only_messages_that_came_whole_are_told(stream: bytes, at: list[int]) -> None:
    for event in read(cut(stream, at)):
        if isinstance(event, Status):
            data = struct.pack("<i", event.counts)
            ends = [stream.find(data, start) for start in range(len(stream))]
            heads = {stream[end - 8 : end] for end in ends if end >= 8}
            assert heads & {b"\x81\x04\x0e\x00\x81\x50\x01\x00", b"\x91\x04\x0e\x00\x81\x50\x01\x00"}


@settings(deadline=None, max_examples=200)
@given(stream=damaged(STREAMS))
def test_after_damage_and_a_silence_the_next_good_message_is_read(stream: bytes) -> None:
    parser = MessageParser()
    read_all(parser, [stream])
    parser.reset()  # what the link does when nothing more comes
    parser.feed(bytes.fromhex("44 04 01 00 01 50"))
    assert read_waiting(parser) == [Homed()]


@settings(deadline=None, max_examples=200)
@given(stream=damaged(STREAMS))
def test_after_damage_without_a_silence_at_most_ninety_bytes_are_lost(stream: bytes) -> None:
    # The longest message has 90 bytes: a false beginning takes no more than that, 15 short messages.
    assert read([stream, bytes.fromhex("44 04 01 00 01 50") * 31])[-1] == Homed()


@settings(deadline=None, max_examples=100)
@given(pieces=RUBBISH)
def test_any_bytes_at_all_raise_nothing_but_protocol_errors(pieces: list[bytes]) -> None:
    read(pieces)
