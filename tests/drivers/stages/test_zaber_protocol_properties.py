from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.stages.zaber import Event, Reply, ReplyParser
from tests.drivers.stages.streams import PLACES, RUBBISH, cut, damaged, read_all

GOOD = b"@01 0 OK IDLE -- 0:8D\r\n"


def check(text: str) -> str:
    """The checksum by other means than the driver's: the digits that bring the sum to a multiple of 256."""
    return next(f"{n:02X}" for n in range(256) if (sum(text.encode()) + n) % 256 == 0)


def line(device: int, message_id: int, flag: str, state: str, data: str) -> bytes:
    text = f"{device:02d} 1 {message_id:02d} {flag} {state} -- {data}"
    return f"@{text}:{check(text)}\r\n".encode()


REPLIES = st.builds(
    line,
    st.integers(1, 99),
    st.integers(0, 99),
    st.sampled_from(["OK", "RJ"]),
    st.sampled_from(["BUSY", "IDLE"]),
    st.one_of(st.integers(-(10**9), 10**9).map(str), st.just("BADDATA")),
)
STREAMS = st.lists(REPLIES, min_size=1, max_size=8).map(b"".join)


def read(pieces: list[bytes]) -> list[Event]:
    return read_all(ReplyParser(), pieces)


def written(event: Event) -> bytes:
    assert isinstance(event, Reply)
    flag, state = "OK" if event.accepted else "RJ", "BUSY" if event.busy else "IDLE"
    message_id = "" if event.message_id is None else f"{event.message_id:02d} "
    return f"@{event.device:02d} {event.axis} {message_id}{flag} {state} {event.flag} {event.data}".encode()


@settings(deadline=None, max_examples=150)
@given(stream=STREAMS, at=PLACES)
def test_the_cuts_of_a_stream_do_not_matter(stream: bytes, at: list[int]) -> None:
    assert read(cut(stream, at)) == read([stream])
    assert len(read([stream])) == stream.count(b"\r\n")


@settings(deadline=None, max_examples=200)
@given(stream=damaged(STREAMS), at=PLACES)
def test_only_replies_that_came_whole_are_told(stream: bytes, at: list[int]) -> None:
    lines = stream.split(b"\n")[:-1]
    for event in read(cut(stream, at)):
        if isinstance(event, Reply):
            assert any(line.startswith(written(event)) for line in lines)


@settings(deadline=None, max_examples=200)
@given(stream=STREAMS, place=st.integers(0, 10**6), change=st.integers(1, 255))
def test_one_changed_byte_is_always_noticed(stream: bytes, place: int, change: int) -> None:
    """The sum of a message changes with any one of its bytes; only a lost colon leaves a reply that is not checked."""
    sound = read([stream])
    data = bytearray(stream)
    data[place % len(data)] ^= change
    assert all(event in sound for event in read([bytes(data)]) if isinstance(event, Reply) and event.checked)


@settings(deadline=None, max_examples=200)
@given(stream=damaged(STREAMS))
def test_the_next_good_reply_is_read_after_damage(stream: bytes) -> None:
    assert read([stream + b"\n", GOOD])[-1] == read([GOOD])[0]


@settings(deadline=None, max_examples=150)
@given(pieces=RUBBISH)
def test_any_bytes_at_all_raise_nothing_but_protocol_errors(pieces: list[bytes]) -> None:
    read(pieces)
