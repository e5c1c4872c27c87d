"""What goes between the driver and an APT controller, and what each knows of the other."""

import pytest

from drivers.errors import DeviceFaultError, DeviceTimeoutError, LimitError, ProtocolError
from drivers.stages import apt as protocol
from drivers.stages.apt import AptLink, AptStage, connect_apt
from sim_devices.clock import ManualClock
from sim_devices.stages.catalogue import make_stage, parse_stage_address
from sim_devices.stages.stage import InProcessPort
from tests.drivers.stages.scripted_port import ScriptedPort

Script = list[tuple[bytes, list[tuple[float, bytes]]]]
ASK = protocol.status(is_stepper=True)


def status(counts: int, bits: int = 0x80000400) -> bytes:
    data = b"\x01\x00" + counts.to_bytes(4, "little", signed=True) + bytes(4) + bits.to_bytes(4, "little")
    return bytes.fromhex("81 04 0e 00 81 50") + data


def link_to(script: Script) -> tuple[AptLink, ScriptedPort]:
    port = ScriptedPort(script)
    return AptLink(port, now_s=port.now_s, sleep=port.sleep), port


class Bench:
    def __init__(self, faults: str = "") -> None:
        self.clock = ManualClock()
        self.machine = make_stage(parse_stage_address(f"sim:apt?{faults}"), clock=self.clock)

    def connect(self) -> AptStage:
        port = InProcessPort(self.machine, clock=self.clock)
        return connect_apt(port, now_s=self.clock.now_s, sleep=self.clock.sleep)


def test_a_question_and_its_answer() -> None:
    link, port = link_to([(ASK, [(0.01, status(7))])])
    assert link.ask(ASK, protocol.Status) == protocol.Status(counts=7, bits=0x80000400)
    assert port.finished


def test_a_late_answer_is_not_taken_for_that_of_the_next_question() -> None:
    link, port = link_to([(ASK, [(0.52, status(1))]), (ASK, [(0.01, status(2))])])
    assert link.ask(ASK, protocol.Status).counts == 2
    assert port.finished


def test_a_lost_byte_that_the_next_message_makes_up_for_is_noticed() -> None:
    shifted = status(1)[:9] + status(1)[10:]
    homed = bytes.fromhex("44 04 01 00 01 50")
    link, port = link_to([(ASK, [(0.01, shifted + homed)]), (ASK, [(0.01, status(5))])])
    assert link.ask(ASK, protocol.Status).counts == 5
    assert port.finished


def test_a_doubled_byte_within_an_answer_is_noticed() -> None:
    doubled = status(1)[:9] + status(1)[8:]
    link, port = link_to([(ASK, [(0.01, doubled)]), (ASK, [(0.01, status(5))])])
    assert link.ask(ASK, protocol.Status).counts == 5
    assert port.finished


def test_trouble_is_a_fault_with_its_code_and_text() -> None:
    trouble = bytes.fromhex("81 00 44 00 81 50 80 04 08 00") + b"overload".ljust(64, b"\x00")
    link, _ = link_to([(ASK, [(0.01, trouble)])])
    with pytest.raises(DeviceFaultError, match="overload") as caught:
        link.ask(ASK, protocol.Status)
    assert (caught.value.code, caught.value.meaning) == (8, "overload")


def test_a_silent_controller_is_a_timeout() -> None:
    link, port = link_to([(ASK, [])] * 6)
    with pytest.raises(DeviceTimeoutError, match="no answer to 80 04 01 00 50 01"):
        link.ask(ASK, protocol.Status)
    assert port.now_s() < 3.5  # six times half a second, and listening


def test_parameters_that_were_forgotten_are_set_at_the_start() -> None:
    bench = Bench("forgets=1&landing=0")
    stage = bench.connect()
    stage.home()
    assert stage.move_to(45.0).position.counts == 6144000


def test_messages_that_nobody_asked_for_are_ended() -> None:
    bench = Bench("updates=1")
    bench.connect()
    bench.machine.transmit()
    bench.clock.advance(5.0)
    assert bench.machine.transmit() == b""


def test_a_homed_bit_from_before_is_not_taken_for_this_homing() -> None:
    bench = Bench("quiethome=1&start=200")
    stage = bench.connect()
    stage.home()
    stage.move_to(180.0)
    before_s = bench.clock.now_s()
    stage.home()
    assert bench.clock.now_s() - before_s > 17.0  # 180 degrees back at 10 deg/s
    assert bench.machine.true_angle_deg() == pytest.approx(0.0, abs=0.02) or bench.machine.true_angle_deg() > 359.98


def test_a_position_of_minus_one_is_near_zero() -> None:
    bench = Bench("model=K10CR2&minus=1&landing=0")
    stage = bench.connect()
    stage.home()
    move = stage.move_to(0.0)
    assert (move.position.counts, move.tries) == (-1, 1)


def test_a_motor_that_does_not_follow_is_a_fault_with_its_bit() -> None:
    bench = Bench("stall=1&model=KDC101")
    stage = bench.connect()
    stage.home()
    with pytest.raises(DeviceFaultError, match="does not follow") as caught:
        stage.move_to(90.0)
    assert caught.value.code == 0x4000


def test_a_stage_that_was_homed_before_needs_no_homing() -> None:
    bench = Bench()
    bench.connect().home()
    again = bench.connect()
    assert again.status().homed
    assert again.move_to(10.0).tries == 1


def test_a_stage_that_was_never_homed_is_not_moved() -> None:
    with pytest.raises(LimitError, match="since its power-up"):
        Bench().connect().move_to(10.0)


def test_a_servo_controller_is_switched_on() -> None:
    bench = Bench("model=KDC101")
    stage = bench.connect()
    assert int(stage.status().code) & 0x80000000


def test_another_controller_is_refused() -> None:
    class Other(InProcessPort):
        def read_some(self, *, timeout_s: float) -> bytes:
            return super().read_some(timeout_s=timeout_s).replace(b"K10CR1", b"BSC201")

    clock = ManualClock()
    machine = make_stage(parse_stage_address("sim:apt"), clock=clock)
    with pytest.raises(ProtocolError, match="'BSC201'"):
        connect_apt(Other(machine, clock=clock), now_s=clock.now_s, sleep=clock.sleep)


def test_stopping_ends_a_motion() -> None:
    bench = Bench()
    stage = bench.connect()
    bench.machine.receive(protocol.home())
    assert stage.status().moving
    stage.stop()
    assert not stage.status().moving
