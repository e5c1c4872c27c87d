from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.stages import elliptec as protocol
from drivers.stages.elliptec import ButtonPosition, ButtonStatus, Event, Position, ReplyParser, Status
from tests.drivers.stages.streams import RUBBISH, cut, damaged, read_all

ADDRESSES = st.sampled_from("0123456789ABCDEF")
REPLIES = st.one_of(
    st.builds(lambda a, v: f"{a}GS{v:02X}\r\n".encode(), ADDRESSES, st.integers(0, 255)),
    st.builds(lambda a, v: f"{a}PO{v:08X}\r\n".encode(), ADDRESSES, st.integers(0, (1 << 32) - 1)),
    st.builds(lambda a, v: f"{a}BO{v:08X}\r\n".encode(), ADDRESSES, st.integers(0, (1 << 32) - 1)),
    st.just(b"0IN0E1140132620251801016800023000\r\n"),
)
STREAMS = st.lists(REPLIES, min_size=1, max_size=8).map(b"".join)


def written(event: Event) -> bytes:
    """A reply written out again, by other means than the parser's."""
    if isinstance(event, Status | ButtonStatus):
        letters = "GS" if isinstance(event, Status) else "BS"
        return b"%b%b%02X\r\n" % (event.address.encode(), letters.encode(), event.code)
    if isinstance(event, Position | ButtonPosition):
        letters = "PO" if isinstance(event, Position) else "BO"
        digits = event.counts.to_bytes(4, "big", signed=True).hex().upper()
        return f"{event.address}{letters}{digits}\r\n".encode()
    head = f"{event.address}IN{event.stage_type:02X}{event.serial_number}{event.year}{event.firmware}"
    return head.encode()  # the hardware's release is not kept, so that only the beginning can be compared


def read(pieces: list[bytes]) -> list[Event]:
    """Every reply in the pieces, errors left out; any exception but ProtocolError escapes."""
    return read_all(ReplyParser(), pieces)


@settings(deadline=None, max_examples=200)
@given(stream=STREAMS, at=st.lists(st.integers(0, 400), max_size=12))
def test_the_cuts_of_a_stream_do_not_matter(stream: bytes, at: list[int]) -> None:
    assert read(cut(stream, at)) == read([stream])


@settings(deadline=None, max_examples=200)
@given(stream=STREAMS)
def test_a_sound_stream_gives_every_reply(stream: bytes) -> None:
    assert len(read([stream])) == stream.count(b"\r\n")


@settings(deadline=None, max_examples=300)
@given(stream=damaged(STREAMS), at=st.lists(st.integers(0, 400), max_size=6))
def test_only_replies_that_came_whole_are_told(stream: bytes, at: list[int]) -> None:
    lines = stream.split(b"\n")
    for event in read(cut(stream, at)):
        assert any((line + b"\n").startswith(written(event)) for line in lines[:-1])


@settings(deadline=None, max_examples=300)
@given(stream=damaged(STREAMS))
def test_the_next_good_reply_is_read_after_damage(stream: bytes) -> None:
    good = Position(address="0", counts=17920)
    assert read([stream + b"\n", b"0PO00004600\r\n"])[-1] == good


@settings(deadline=None, max_examples=300)
@given(pieces=RUBBISH)
def test_any_bytes_at_all_raise_nothing_but_protocol_errors(pieces: list[bytes]) -> None:
    read(pieces)


@settings(deadline=None, max_examples=300)
@given(angle_deg=st.floats(-1e6, 1e6), pulses=st.integers(1 << 15, 1 << 22))
def test_counts_lie_within_one_turn(angle_deg: float, pulses: int) -> None:
    counts = protocol.counts_from_angle(angle_deg, pulses=pulses)
    assert 0 <= counts < pulses
    assert 0.0 <= protocol.angle_from_counts(counts, pulses=pulses) < 360.0


@settings(deadline=None, max_examples=300)
@given(counts=st.integers(-(1 << 31), (1 << 31) - 1), pulses=st.integers(1 << 15, 1 << 22))
def test_an_angle_of_counts_leads_back_to_them(counts: int, pulses: int) -> None:
    angle_deg = protocol.angle_from_counts(counts, pulses=pulses)
    assert protocol.counts_from_angle(angle_deg, pulses=pulses) == counts % pulses
