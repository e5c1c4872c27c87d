"""The APT driver: messages of Thorlabs' protocol document, addressed to a USB unit, and what goes over the line."""

import struct
from collections.abc import Callable

import pytest

from drivers.errors import DeviceFaultError, DeviceTimeoutError, ProtocolError
from drivers.stages import apt as protocol
from drivers.stages.apt import AptLink, Information, MessageParser, Status, find_model
from tests.drivers.stages.lines import Bench, Script, ScriptedPort

K10CR1 = find_model("K10CR1", stage_id=0, actuator=None)


PRM1 = find_model("KDC101", stage_id=6, actuator=None)


HOMED = bytes.fromhex("44 04 01 00 01 50")


MOVED = "64 04 0e 00 81 50 01 00 ff ff ff ff 00 00 00 00 00 04 00 80"


def parse(text: str) -> bytes | None:
    parser = MessageParser()
    parser.feed(bytes.fromhex(text))
    return parser.next_event()


@pytest.mark.parametrize(
    ("message", "sent"),
    [
        (protocol.IDENTIFY, "05 00 00 00 50 01"),
        (protocol.STOP_UPDATES, "12 00 00 00 50 01"),
        (protocol.NO_FLASH_PROGRAMMING, "18 00 00 00 50 01"),
        (protocol.ENABLE, "10 02 01 01 50 01"),
        (protocol.ASK_ENABLED, "11 02 01 00 50 01"),
        (protocol.ASK_STATUS_OF_STEPPER, "80 04 01 00 50 01"),
        (protocol.ASK_STATUS_OF_SERVO, "90 04 01 00 50 01"),
        (protocol.HOME, "43 04 01 00 50 01"),
        (protocol.STOP, "65 04 01 02 50 01"),
        (protocol.move_absolute(200000), "53 04 06 00 d0 01 01 00 40 0d 03 00"),
        (protocol.move_absolute(-1), "53 04 06 00 d0 01 01 00 ff ff ff ff"),
        (
            protocol.set_velocity(protocol.velocity_parameters(acceleration=13744, highest=13421773)),
            "13 04 0e 00 d0 01 01 00 00 00 00 00 b0 35 00 00 cd cc cc 00",
        ),
        (protocol.ASK_VELOCITY, "14 04 01 00 50 01"),
        (
            protocol.set_home(protocol.home_parameters(velocity=73300775, offset_counts=546133)),
            "40 04 0e 00 d0 01 01 00 02 00 01 00 27 7b 5e 04 55 55 08 00",
        ),
        (protocol.ASK_HOME, "41 04 01 00 50 01"),
    ],
)
def test_commands(message: bytes, sent: str) -> None:
    assert message.hex(" ") == sent


def info(*, model: bytes = b"K10CR1\x00\x00", stage_id: int = 0) -> str:
    head = (55000123).to_bytes(4, "little") + model + b"\x10\x00" + bytes([2, 1, 3, 0]) + b"notes".ljust(48, b"\x00")
    tail = bytes(10) + stage_id.to_bytes(2, "little") + b"\x01\x00\x01\x00\x01\x00"
    return "06 00 54 00 81 50" + (head + tail).hex()


@pytest.mark.parametrize(
    ("received", "read", "meaning"),
    [
        (
            info(model=b"KDC101\x00\x00", stage_id=6),
            protocol.information_of,
            Information(serial_number=55000123, model="KDC101", firmware="3.1.2", stage_id=6),
        ),
        (
            "81 04 0e 00 81 50 01 00 40 0d 03 00 00 00 00 00 00 04 00 80",
            protocol.status_of,
            Status(counts=200000, bits=0x80000400),
        ),
        (
            "91 04 0e 00 81 50 01 00 fe ff ff ff 10 00 00 00 10 00 00 80",
            protocol.status_of,
            Status(counts=-2, bits=0x80000010),
        ),
        ("12 02 01 01 01 50", protocol.is_enabled, True),
        ("12 02 01 02 01 50", protocol.is_enabled, False),
        (
            "15 04 0e 00 81 50 01 00 00 00 00 00 b0 35 00 00 cd cc cc 00",
            protocol.data_of,
            protocol.velocity_parameters(acceleration=13744, highest=13421773),
        ),
    ],
)
def test_messages(received: str, read: Callable[[bytes], object], meaning: object) -> None:
    message = parse(received)
    assert message is not None
    assert read(message) == meaning


def test_a_name_that_is_none_is_an_error() -> None:
    with pytest.raises(ProtocolError, match="not the name"):
        protocol.information_of(bytes.fromhex(info(model=b"K10\xffR1\x00\x00")))


def test_bytes_that_begin_nothing_are_passed_over_and_told() -> None:
    parser = MessageParser()
    parser.feed(bytes.fromhex("00 13 37 44 04 01 00 01 50"))
    with pytest.raises(ProtocolError, match="00 13 37 begins no message"):
        parser.next_event()
    assert parser.next_event() == HOMED


def test_another_channel_is_an_error() -> None:
    with pytest.raises(ProtocolError, match="not of channel 1"):
        parse("81 04 0e 00 81 50 02 00 40 0d 03 00 00 00 00 00 00 04 00 80")


def test_a_flood_is_not_kept() -> None:
    with pytest.raises(ProtocolError, match="unread bytes"):
        MessageParser().feed(bytes(1025))


def test_fault_bits_are_told_in_words() -> None:
    assert protocol.fault_in_words(0x4000 | 0x4000000) == "motion error: the motor does not follow, over-current"


def test_the_scales_are_those_of_the_document() -> None:
    # K10CR1: 7329109 per deg/s and 1502.03 per deg/s2, set to 10.0 of each, told to 0.05; PRM1-Z8: 42941.66 and 14.657,
    # of which 10 are rounded to a whole number.
    (*_, k10cr1_acceleration, k10cr1_highest), (*_, prm1_acceleration, prm1_highest) = (
        struct.unpack("<Hiii", model.velocity) for model in (K10CR1, PRM1)
    )
    assert k10cr1_highest / 7329109 == pytest.approx(10.0, abs=0.05)
    assert k10cr1_acceleration / 1502.03 == pytest.approx(10.0, abs=0.05)
    assert prm1_highest == pytest.approx(42941.66 * 10, abs=0.6)
    assert prm1_acceleration == pytest.approx(14.657 * 10, abs=0.6)


@pytest.mark.parametrize(("controller", "stage_id"), [("K10CR9", 0), ("KDC101", 5), ("KDC101", 0), ("", 0)])
def test_a_stage_whose_counts_are_not_known_is_refused(controller: str, stage_id: int) -> None:
    with pytest.raises(ProtocolError, match="not one of K10CR1, K10CR2, KDC101 with PRM1-Z8"):
        find_model(controller, stage_id=stage_id, actuator=None)


def test_a_controller_that_does_not_tell_its_stage_can_be_told() -> None:
    assert find_model("KDC101", stage_id=0, actuator="PRM1-Z8").name == "KDC101 with PRM1-Z8"


ASK = protocol.ASK_STATUS_OF_STEPPER


def status(counts: int, bits: int = 0x80000400) -> bytes:
    data = b"\x01\x00" + counts.to_bytes(4, "little", signed=True) + bytes(4) + bits.to_bytes(4, "little")
    return bytes.fromhex("81 04 0e 00 81 50") + data


def link_to(script: Script) -> tuple[AptLink, ScriptedPort]:
    port = ScriptedPort(script)
    return AptLink(port, now_s=port.now_s, sleep=port.sleep), port


@pytest.mark.parametrize(
    ("arrives_s", "answer"),
    [
        pytest.param(0.52, status(1), id="too late"),
        pytest.param(0.01, status(1)[:9] + status(1)[10:] + HOMED, id="a lost byte, made up by the next message"),
        pytest.param(0.01, status(1)[:9] + status(1)[8:], id="a doubled byte"),
    ],
)
def test_a_wrong_answer_is_not_believed_and_the_question_repeated(arrives_s: float, answer: bytes) -> None:
    link, port = link_to([(ASK, [(arrives_s, answer)]), (ASK, [(0.01, status(5))])])
    assert link.ask(ASK, protocol.status_of).counts == 5
    assert port.finished


def test_trouble_is_a_fault_with_its_code_and_text() -> None:
    trouble = bytes.fromhex("81 00 44 00 81 50 80 04 08 00") + b"overload".ljust(64, b"\x00")
    link, _ = link_to([(ASK, [(0.01, trouble)])])
    with pytest.raises(DeviceFaultError, match="overload") as caught:
        link.ask(ASK, protocol.status_of)
    assert (caught.value.code, caught.value.meaning) == (8, "overload")


def test_a_silent_controller_is_a_timeout() -> None:
    link, port = link_to([(ASK, [])] * 6)
    with pytest.raises(DeviceTimeoutError, match="no answer to 80 04 01 00 50 01"):
        link.ask(ASK, protocol.status_of)
    assert port.now_s() < 3.5  # six times half a second, and listening


def test_parameters_that_were_forgotten_are_set_at_the_start() -> None:
    bench = Bench("apt?forgets=1&landing=0")
    stage = bench.connect()
    stage.home()
    assert stage.move_to(45.0).position.counts == 6144000


def test_a_homed_bit_from_before_is_not_taken_for_this_homing() -> None:
    bench = Bench("apt?quiethome=1&start=200")
    stage = bench.connect()
    stage.home()
    stage.move_to(180.0)
    before_s = bench.clock.now_s()
    stage.home()
    assert bench.clock.now_s() - before_s > 17.0  # 180 degrees back at 10 deg/s
    assert bench.machine.true_angle_deg() == pytest.approx(0.0, abs=0.02) or bench.machine.true_angle_deg() > 359.98


def test_a_motor_that_does_not_follow_is_a_fault_with_its_bit() -> None:
    bench = Bench("apt?stall=1&model=KDC101")
    stage = bench.connect()
    stage.home()
    with pytest.raises(DeviceFaultError, match="does not follow") as caught:
        stage.move_to(90.0)
    assert caught.value.code == 0x4000


def test_a_stage_that_was_homed_before_needs_no_homing() -> None:
    bench = Bench("apt")
    bench.connect().home()
    again = bench.connect()
    assert again.status().homed
    assert again.move_to(10.0).tries == 1
