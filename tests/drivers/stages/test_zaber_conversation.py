"""What goes over the wire between the driver and a Zaber device."""

import pytest

from drivers.errors import DeviceFaultError, DeviceTimeoutError, LimitError, ProtocolError
from drivers.stages.zaber import ZaberLink, ZaberStage, checksum, connect_zaber
from sim_devices.clock import ManualClock
from sim_devices.stages.catalogue import make_stage, parse_stage_address
from sim_devices.stages.stage import InProcessPort
from tests.drivers.stages.scripted_port import ScriptedPort

Script = list[tuple[bytes, list[tuple[float, bytes]]]]


def sent(text: str) -> bytes:
    return f"/{text}:{checksum(text)}\n".encode()


def said(text: str) -> bytes:
    return f"@{text}:{checksum(text)}\r\n".encode()


def link_to(script: Script) -> tuple[ZaberLink, ScriptedPort]:
    port = ScriptedPort(script)
    return ZaberLink(port, address="1", now_s=port.now_s, sleep=port.sleep), port


def simulated(faults: str = "", *, steps_per_turn: int | None = None) -> ZaberStage:
    clock = ManualClock()
    machine = make_stage(parse_stage_address(f"sim:zaber?{faults}"), clock=clock)
    return connect_zaber(
        InProcessPort(machine, clock=clock), steps_per_turn=steps_per_turn, now_s=clock.now_s, sleep=clock.sleep
    )


def test_a_question_and_its_answer() -> None:
    link, port = link_to([(sent("1 1 00 get pos"), [(0.01, said("01 1 00 OK IDLE -- 384000"))])])
    assert link.ask("get pos").data == "384000"
    assert port.finished


def test_a_late_answer_carries_another_id_and_is_not_taken() -> None:
    late = said("01 1 00 OK IDLE -- 111")
    link, port = link_to(
        [
            (sent("1 1 00 get pos"), [(0.55, late)]),  # after its half second
            (sent("1 1 01 get pos"), [(0.1, said("01 1 01 OK IDLE -- 222"))]),
        ]
    )
    assert link.ask("get pos").data == "222"
    assert any("no answer" in note for note in link.notes.take())
    assert port.finished


def test_a_damaged_answer_is_asked_for_again() -> None:
    bent = said("01 1 00 OK IDLE -- 111").replace(b"111", b"112")
    link, port = link_to(
        [
            (sent("1 1 00 get pos"), [(0.01, bent)]),
            (sent("1 1 01 get pos"), [(0.01, said("01 1 01 OK IDLE -- 111"))]),
        ]
    )
    assert link.ask("get pos").data == "111"
    assert port.finished


def test_an_answer_without_checksum_is_not_believed() -> None:
    script = [(sent(f"1 1 {n:02d} get pos"), [(0.01, b"@01 1 %02d OK IDLE -- 111\r\n" % n)]) for n in range(6)]
    link, _ = link_to(script)
    with pytest.raises(ProtocolError, match="without checksum"):
        link.ask("get pos")


def test_alerts_and_other_devices_are_not_answers() -> None:
    others = [(0.01, b"!01 1 IDLE --\r\n"), (0.02, said("02 1 00 OK IDLE -- 7")), (0.03, said("01 1 00 OK IDLE -- 8"))]
    link, _ = link_to([(sent("1 1 00 get pos"), others)])
    assert link.ask("get pos").data == "8"


def test_a_refusal_that_is_repeated_is_a_fault_with_its_reason() -> None:
    script = [(sent(f"1 1 {n:02d} move abs 9"), [(0.01, said(f"01 1 {n:02d} RJ IDLE -- BADDATA"))]) for n in range(2)]
    link, port = link_to(script)
    with pytest.raises(DeviceFaultError, match="BADDATA") as caught:
        link.ask("move abs 9")
    assert (caught.value.code, caught.value.meaning) == ("BADDATA", "value not allowed")
    assert port.finished


def test_a_silent_device_is_a_timeout() -> None:
    link, port = link_to([(sent(f"1 1 {n:02d} get pos"), []) for n in range(6)])
    with pytest.raises(DeviceTimeoutError, match="Zaber stage 1 on scripted port: no answer"):
        link.ask("get pos")
    assert port.now_s() < 3.5  # six times half a second


@pytest.mark.parametrize(("faults", "counts"), [("", 384000), ("resolution=128", 768000), ("steps=16000", 256000)])
def test_counts_follow_what_the_stage_says_of_itself(faults: str, counts: int) -> None:
    stage = simulated(f"landing=0&{faults}")
    stage.home()
    assert stage.move_to(90.0).position.counts == counts


def test_a_firmware_that_does_not_tell_its_turn_needs_the_data_sheet() -> None:
    with pytest.raises(LimitError, match="steps_per_turn"):
        simulated("cycle=0")
    stage = simulated("cycle=0&landing=0&resolution=32", steps_per_turn=24000)
    stage.home()
    assert stage.move_to(90.0).position.counts == 192000


def test_a_data_sheet_of_another_stage_is_refused() -> None:
    with pytest.raises(LimitError, match="Another stage, or a wrong number"):
        simulated(steps_per_turn=16000)


def test_a_stage_that_lost_its_reference_is_not_moved() -> None:
    with pytest.raises(LimitError, match="since its power-up"):
        simulated().move_to(10.0)


def test_a_stall_is_told_once_and_the_stage_goes_on() -> None:
    stage = simulated("stall=1")
    stage.home()
    with pytest.raises(DeviceFaultError, match="stalled and stopped") as caught:
        stage.move_to(90.0)
    assert caught.value.code == "FS"
    assert stage.move_to(90.0).tries == 1


def test_a_hand_at_the_knob_is_told() -> None:
    stage = simulated("button=1")
    stage.home()
    move = stage.move_to(90.0)
    assert move.tries == 2
    assert "the stage reports NC (turned by hand)" in move.remarks


def test_the_flags_stand_in_the_status() -> None:
    status = simulated().status()
    assert (status.code, status.meaning, status.homed) == ("WR", "no reference position", False)
