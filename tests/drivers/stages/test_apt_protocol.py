"""The literal messages are those of Thorlabs' protocol document, addressed to a USB unit, and of its clients."""

import pytest

from drivers.errors import LimitError, ProtocolError
from drivers.stages import apt as protocol
from drivers.stages.apt import (
    ChannelState,
    Event,
    Homed,
    HomeParameters,
    Information,
    MessageParser,
    Status,
    Stopped,
    Trouble,
    VelocityParameters,
    find_model,
)

K10CR1 = find_model("K10CR1", stage_id=0, actuator=None)
PRM1 = find_model("KDC101", stage_id=6, actuator=None)
MOVED = "64 04 0e 00 81 50 01 00 ff ff ff ff 00 00 00 00 00 04 00 80"


def parse(text: str) -> Event | None:
    parser = MessageParser()
    parser.feed(bytes.fromhex(text))
    return parser.next_event()


@pytest.mark.parametrize(
    ("message", "sent"),
    [
        (protocol.identify(), "05 00 00 00 50 01"),
        (protocol.stop_updates(), "12 00 00 00 50 01"),
        (protocol.no_flash_programming(), "18 00 00 00 50 01"),
        (protocol.enable(), "10 02 01 01 50 01"),
        (protocol.channel_state(), "11 02 01 00 50 01"),
        (protocol.status(is_stepper=True), "80 04 01 00 50 01"),
        (protocol.status(is_stepper=False), "90 04 01 00 50 01"),
        (protocol.home(), "43 04 01 00 50 01"),
        (protocol.stop(), "65 04 01 02 50 01"),
        (protocol.move_absolute(200000), "53 04 06 00 d0 01 01 00 40 0d 03 00"),
        (protocol.move_absolute(-1), "53 04 06 00 d0 01 01 00 ff ff ff ff"),
        (
            protocol.set_velocity(VelocityParameters(lowest=0, acceleration=13744, highest=13421773)),
            "13 04 0e 00 d0 01 01 00 00 00 00 00 b0 35 00 00 cd cc cc 00",
        ),
        (protocol.ask_velocity(), "14 04 01 00 50 01"),
        (
            protocol.set_home(HomeParameters(direction=2, switch=1, velocity=73300775, offset_counts=546133)),
            "40 04 0e 00 d0 01 01 00 02 00 01 00 27 7b 5e 04 55 55 08 00",
        ),
        (protocol.home_parameters(), "41 04 01 00 50 01"),
    ],
)
def test_commands(message: bytes, sent: str) -> None:
    assert message.hex(" ") == sent


def info(*, model: bytes = b"K10CR1\x00\x00", stage_id: int = 0) -> str:
    head = (55000123).to_bytes(4, "little") + model + b"\x10\x00" + bytes([2, 1, 3, 0]) + b"notes".ljust(48, b"\x00")
    tail = bytes(10) + stage_id.to_bytes(2, "little") + b"\x01\x00\x01\x00\x01\x00"
    return "06 00 54 00 81 50" + (head + tail).hex()


@pytest.mark.parametrize(
    ("received", "event"),
    [
        (info(), Information(serial_number=55000123, model="K10CR1", firmware="3.1.2", stage_id=0)),
        (
            info(model=b"KDC101\x00\x00", stage_id=6),
            Information(serial_number=55000123, model="KDC101", firmware="3.1.2", stage_id=6),
        ),
        (
            "81 04 0e 00 81 50 01 00 40 0d 03 00 00 00 00 00 00 04 00 80",
            Status(counts=200000, bits=0x80000400),
        ),
        (
            "91 04 0e 00 81 50 01 00 fe ff ff ff 10 00 00 00 10 00 00 80",
            Status(counts=-2, bits=0x80000010),
        ),
        ("12 02 01 01 01 50", ChannelState(enabled=True)),
        ("12 02 01 02 01 50", ChannelState(enabled=False)),
        ("44 04 01 00 01 50", Homed()),
        (MOVED, Stopped(completed=True)),
        ("66 04" + MOVED[5:], Stopped(completed=False)),
        ("80 00 07 00 01 50", Trouble(code=7, text="")),
        ("81 00 44 00 81 50 53 04 08 00" + b"overload".ljust(64, b"\x00").hex(), Trouble(code=8, text="overload")),
        (
            "15 04 0e 00 81 50 01 00 00 00 00 00 b0 35 00 00 cd cc cc 00",
            VelocityParameters(lowest=0, acceleration=13744, highest=13421773),
        ),
        (
            "42 04 0e 00 81 50 01 00 02 00 01 00 27 7b 5e 04 55 55 08 00",
            HomeParameters(direction=2, switch=1, velocity=73300775, offset_counts=546133),
        ),
    ],
)
def test_messages(received: str, event: Event) -> None:
    assert parse(received) == event


def test_bytes_that_begin_nothing_are_passed_over_and_told() -> None:
    parser = MessageParser()
    parser.feed(bytes.fromhex("00 13 37 44 04 01 00 01 50"))
    with pytest.raises(ProtocolError, match="00 13 37 begins no message"):
        parser.next_event()
    assert parser.next_event() == Homed()


def test_the_beginning_of_a_message_is_waited_for() -> None:
    parser = MessageParser()
    for byte in bytes.fromhex(MOVED)[:-1]:
        parser.feed(bytes([byte]))
        assert parser.next_event() is None
    parser.feed(bytes.fromhex(MOVED)[-1:])
    assert parser.next_event() == Stopped(completed=True)


def test_reset_forgets_a_message_in_part() -> None:
    parser = MessageParser()
    parser.feed(bytes.fromhex(MOVED)[:9])
    parser.reset()
    parser.feed(bytes.fromhex("44 04 01 00 01 50"))
    assert parser.next_event() == Homed()


def test_another_channel_is_an_error() -> None:
    with pytest.raises(ProtocolError, match="channel 2"):
        parse("81 04 0e 00 81 50 02 00 40 0d 03 00 00 00 00 00 00 04 00 80")


def test_a_flood_is_not_kept() -> None:
    with pytest.raises(ProtocolError, match="nobody reads"):
        MessageParser().feed(bytes(1025))


@pytest.mark.parametrize("counts", [1 << 31, -(1 << 31) - 1])
def test_a_position_that_has_no_room_is_refused(counts: int) -> None:
    with pytest.raises(LimitError, match="32 bits"):
        protocol.move_absolute(counts)


def test_fault_bits_are_told_in_words() -> None:
    assert protocol.fault_in_words(0x4000 | 0x4000000) == "motion error: the motor does not follow, over-current"


def test_the_scales_are_those_of_the_document() -> None:
    # K10CR1: 7329109 per deg/s and 1502.03 per deg/s2, set to 10.0 of each, told to 0.05; PRM1-Z8: 42941.66 and 14.657,
    # of which 10 are rounded to a whole number.
    assert K10CR1.velocity.highest / 7329109 == pytest.approx(10.0, abs=0.05)
    assert K10CR1.velocity.acceleration / 1502.03 == pytest.approx(10.0, abs=0.05)
    assert PRM1.velocity.highest == pytest.approx(42941.66 * 10, abs=0.6)
    assert PRM1.velocity.acceleration == pytest.approx(14.657 * 10, abs=0.6)


@pytest.mark.parametrize(("controller", "stage_id"), [("K10CR9", 0), ("KDC101", 5), ("KDC101", 0), ("", 0)])
def test_a_stage_whose_counts_are_not_known_is_refused(controller: str, stage_id: int) -> None:
    with pytest.raises(ProtocolError, match="none of K10CR1, K10CR2, KDC101 with PRM1-Z8"):
        find_model(controller, stage_id=stage_id, actuator=None)


def test_a_controller_that_does_not_tell_its_stage_can_be_told() -> None:
    assert find_model("KDC101", stage_id=0, actuator="PRM1-Z8").name == "KDC101 with PRM1-Z8"
