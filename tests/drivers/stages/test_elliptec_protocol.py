"""The bytes here are written out from the ELLx protocol manual and from replies of true stages."""

import pytest

from drivers.errors import LimitError, ProtocolError
from drivers.stages import elliptec as protocol
from drivers.stages.elliptec import ButtonPosition, ButtonStatus, Event, Information, Position, ReplyParser, Status

ELL14 = b"0IN0E1140132620251801016800023000\r\n"


def parse(data: bytes) -> Event | None:
    parser = ReplyParser()
    parser.feed(data)
    return parser.next_event()


def information(**changes: int) -> Information:
    values = {"stage_type": 14, "travel": 360, "pulses": 143360} | changes
    return Information(address="0", serial_number="11401326", year="2025", firmware="18", **values)


@pytest.mark.parametrize(
    ("command", "sent"),
    [
        (protocol.identify("0"), b"0in"),
        (protocol.status("A"), b"Ags"),
        (protocol.position("0"), b"0gp"),
        (protocol.stop("0"), b"0st"),
        (protocol.home("0"), b"0ho0"),
        (protocol.move_absolute("0", counts=0x4600), b"0ma00004600"),
        (protocol.move_absolute("F", counts=-1), b"FmaFFFFFFFF"),
        (protocol.move_absolute("0", counts=-(1 << 31)), b"0ma80000000"),
    ],
)
def test_commands(command: bytes, sent: bytes) -> None:
    assert command == sent


@pytest.mark.parametrize("counts", [1 << 31, -(1 << 31) - 1])
def test_a_position_that_has_no_room_is_refused(counts: int) -> None:
    with pytest.raises(LimitError, match="32 bits"):
        protocol.move_absolute("0", counts=counts)


@pytest.mark.parametrize("address", ["", "00", "G", "a", "\n"])
def test_an_address_that_does_not_exist_is_refused(address: str) -> None:
    with pytest.raises(LimitError, match="0-9 or A-F"):
        protocol.check_address(address)


@pytest.mark.parametrize(
    ("reply", "event"),
    [
        (ELL14, information()),
        (b"0GS00\r\n", Status(address="0", code=0)),
        (b"AGS09\r\n", Status(address="A", code=9)),
        (b"0PO00004600\r\n", Position(address="0", counts=17920)),
        (b"0POFFFFFFFF\r\n", Position(address="0", counts=-1)),
        (b"0PO80000000\r\n", Position(address="0", counts=-(1 << 31))),
        (b"0BS09\r\n", ButtonStatus(address="0", code=9)),
        (b"0BO00000100\r\n", ButtonPosition(address="0", counts=256)),
    ],
)
def test_replies(reply: bytes, event: Event) -> None:
    assert parse(reply) == event


def test_replies_that_come_together_are_told_one_by_one() -> None:
    parser = ReplyParser()
    parser.feed(b"0GS09\r\n0PO00004600\r\n0GS")
    assert parser.next_event() == Status(address="0", code=9)
    assert parser.next_event() == Position(address="0", counts=17920)
    assert parser.next_event() is None


@pytest.mark.parametrize(
    "damaged",
    [
        b"0PO0004600\r\n",  # a digit lost
        b"0PO000046000\r\n",  # a digit doubled
        b"0PO00004600\n",  # the carriage return lost
        b"0PO00004600\r0GS00\r\n",  # the line feed lost: two replies run together
        b"0PO0000460g\r\n",
        b"0po00004600\r\n",
        b"PO00004600\r\n",
        b"\x000PO00004600\r\n",
        b"0GV40\r\n",  # whole, but nobody asks for it
        b"\r\n",
    ],
)
def test_a_damaged_reply_is_an_error_and_the_next_one_is_read(damaged: bytes) -> None:
    parser = ReplyParser()
    parser.feed(damaged + b"0GS00\r\n")
    with pytest.raises(ProtocolError):
        parser.next_event()
    assert parser.next_event() == Status(address="0", code=0)


def test_a_flood_without_replies_is_not_kept() -> None:
    parser = ReplyParser()
    with pytest.raises(ProtocolError, match="make no reply"):
        parser.feed(b"x" * 1025)
    parser.feed(b"0PO00004600\r\n0GS00\r\n")  # the first of these may be the flood's own end
    assert parser.next_event() == Status(address="0", code=0)


def test_after_a_flood_that_ended_with_a_line_the_next_reply_is_read() -> None:
    parser = ReplyParser()
    with pytest.raises(ProtocolError):
        parser.feed(b"x" * 1024 + b"\n")
    parser.feed(b"0GS00\r\n")
    assert parser.next_event() == Status(address="0", code=0)


def test_reset_forgets_a_reply_in_part() -> None:
    parser = ReplyParser()
    parser.feed(b"0PO0000")
    parser.reset()
    parser.feed(b"0GS00\r\n")
    assert parser.next_event() == Status(address="0", code=0)


@pytest.mark.parametrize("pulses", [65536, 143360, 262144])
def test_pulses_are_those_that_the_stage_tells(pulses: int) -> None:
    assert protocol.pulses_per_revolution(information(pulses=pulses)) == pulses


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"stage_type": 17}, "ELL17 is none of the rotation stages"),
        ({"travel": 28}, "travel 28"),
        ({"pulses": 0}, "0 pulses"),
        ({"pulses": 1024}, "1024 pulses"),
        ({"pulses": 0x23000000}, "not plausible"),
    ],
)
def test_an_implausible_stage_is_refused_with_the_reason(change: dict[str, int], reason: str) -> None:
    with pytest.raises(ProtocolError, match=reason):
        protocol.pulses_per_revolution(information(**change))


@pytest.mark.parametrize(
    ("angle_deg", "pulses", "counts"),
    [
        (45.0, 143360, 0x4600),
        (45.0, 262144, 0x8000),
        (-45.0, 143360, 125440),
        (0.00126, 143360, 1),  # just above half a count of 0.00251 degrees: rounded, not cut off
        (359.999, 143360, 0),  # nearer to a whole turn than to the last count
    ],
)
def test_counts_from_angle(angle_deg: float, pulses: int, counts: int) -> None:
    assert protocol.counts_from_angle(angle_deg, pulses=pulses) == counts


@pytest.mark.parametrize(
    ("counts", "angle_deg"),
    [(0x4600, 45.0), (143360, 0.0), (-35840, 270.0), (-1, 360.0 - 360.0 / 143360)],
)
def test_angle_from_counts(counts: int, angle_deg: float) -> None:
    # All numbers have fewer than 53 bits, so that only the last division rounds.
    assert protocol.angle_from_counts(counts, pulses=143360) == pytest.approx(angle_deg, rel=1e-15)


def test_every_thousandth_of_a_degree_goes_through_counts_within_half_a_count() -> None:
    for pulses in (65536, 143360, 262144):
        for thousandth in range(0, 360_000, 7):
            angle_deg = thousandth / 1000.0
            counts = protocol.counts_from_angle(angle_deg, pulses=pulses)
            back_deg = protocol.angle_from_counts(counts, pulses=pulses)
            distance_deg = abs((back_deg - angle_deg + 180.0) % 360.0 - 180.0)
            assert distance_deg <= 180.0 / pulses + 1e-12  # rounding of numbers up to 360: 6e-14
