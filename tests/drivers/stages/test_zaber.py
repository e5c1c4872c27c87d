"""The literal messages are those of Zaber's manual, of its own libraries' tests, and of what its client sends."""

from dataclasses import replace

import pytest

from drivers.errors import DeviceFaultError, DeviceTimeoutError, LimitError, ProtocolError
from drivers.interfaces import RotationStage
from drivers.stages import zaber as protocol
from drivers.stages.zaber import Reply, ReplyParser, ZaberLink, checksum
from tests.drivers.stages.lines import Bench, Script, ScriptedPort


def parse(data: bytes) -> Reply | None:
    parser = ReplyParser()
    parser.feed(data)
    return parser.next_event()


@pytest.mark.parametrize(
    ("text", "digits"),
    [
        ("1 tools echo", "BF"),
        ("2 1", "7D"),
        ("get maxspeed", "49"),
        ("0 0 set comm.alert 1", "B1"),
        ("0 0 00", "00"),
        ("01 0 OK IDLE -- 0", "8D"),
        ("01 0 OK IDLE -- 7z", "0C"),
    ],
)
def test_checksums(text: str, digits: str) -> None:
    assert protocol.checksum(text) == digits


def test_the_first_command_of_the_vendors_client() -> None:
    assert protocol.command("", device=0, axis=0, message_id=0) == b"/0 0 00:00\n"


@pytest.mark.parametrize(
    ("words", "axis", "message_id", "text"),
    [
        ("get pos", 1, 7, b"/1 1 07 get pos"),
        ("move abs 384000", 1, 42, b"/1 1 42 move abs 384000"),
        ("move abs -17", 1, 42, b"/1 1 42 move abs -17"),
        ("home", 0, 99, b"/1 0 99 home"),
    ],
)
def test_commands_say_it_and_add_up_to_zero(words: str, axis: int, message_id: int, text: bytes) -> None:
    said, colon, check = protocol.command(words, device=1, axis=axis, message_id=message_id).partition(b":")
    assert said == text
    assert colon == b":"
    assert check.endswith(b"\n")
    assert (sum(said[1:]) + int(check, 16)) % 256 == 0


IDLE = Reply(device=1, axis=0, message_id=None, accepted=True, busy=False, flag="--", data="0", checked=False)


@pytest.mark.parametrize(
    ("line", "event"),
    [
        (b"@01 0 OK IDLE -- 0\r\n", IDLE),
        (b"@01 0 OK IDLE -- 0:8D\r\n", replace(IDLE, checked=True)),
        (b"@01 0 12 OK IDLE -- 0\r\n", replace(IDLE, message_id=12)),
        (b"@01 0 OK IDLE WR 49822\r\n", replace(IDLE, flag="WR", data="49822")),
        (b"@01 1 OK BUSY -- 0\r\n", replace(IDLE, axis=1, busy=True)),
        (b"@02 0 RJ IDLE -- BADCOMMAND\r\n", replace(IDLE, device=2, accepted=False, data="BADCOMMAND")),
        (b"@01 0 OK IDLE FS 02 FS WR\r\n", replace(IDLE, flag="FS", data="02 FS WR")),
        (b"!01 1 IDLE --\r\n", None),
        (b"#01 0 help\r\n", None),
    ],
)
def test_messages(line: bytes, event: Reply | None) -> None:
    assert parse(line) == event


@pytest.mark.parametrize(
    "damaged",
    [
        b"@01 0 OK IDLE -- 0:8E\r\n",
        b"@01 0 OK IDLE -- 1:8D\r\n",
        b"@01 0 OK IDLE -- 0:GG\r\n"[:-4] + b"\n",
        b"@01 0 OK IDLE -- 0\n",
        b"@01 0 OK IDLE\r\n",
        b"@01 OK IDLE -- 0\r\n",
        b"01 0 OK IDLE -- 0\r\n",
        b"@01 0 OK SLOW -- 0\r\n",
        b"@01 0 OK IDLE -- \x07\r\n",
        b"\r\n",
    ],
)
def test_a_damaged_message_is_an_error_and_the_next_one_is_read(damaged: bytes) -> None:
    parser = ReplyParser()
    parser.feed(damaged + b"@01 0 OK IDLE -- 0:8D\r\n")
    with pytest.raises(ProtocolError):
        parser.next_event()
    assert parser.next_event() == replace(IDLE, checked=True)


@pytest.mark.parametrize(("data", "flags"), [("00", ()), ("01 WR", ("WR",)), ("02 FS WR", ("FS", "WR"))])
def test_flags(data: str, flags: tuple[str, ...]) -> None:
    assert protocol.warning_flags(data) == flags


@pytest.mark.parametrize("data", ["", "WR", "02 WR", "01 wr", "01 WRX"])
def test_what_is_no_list_of_flags_is_an_error(data: str) -> None:
    with pytest.raises(ProtocolError, match="not a list of warning flags"):
        protocol.warning_flags(data)


@pytest.mark.parametrize("data", ["", "12.5", "0x10", "--3", "1 2"])
def test_what_is_no_whole_number_is_an_error(data: str) -> None:
    with pytest.raises(ProtocolError, match="not an integer"):
        protocol.whole_number(data)


@pytest.mark.parametrize("address", ["", "0", "100", "A", "-1"])
def test_an_address_that_does_not_exist_is_refused(address: str) -> None:
    with pytest.raises(LimitError, match="1 to 99"):
        protocol.check_address(address)


def sent(text: str) -> bytes:
    return f"/{text}:{checksum(text)}\n".encode()


def said(text: str) -> bytes:
    return f"@{text}:{checksum(text)}\r\n".encode()


def link_to(script: Script) -> tuple[ZaberLink, ScriptedPort]:
    port = ScriptedPort(script)
    return ZaberLink(port, address="1", now_s=port.now_s, sleep=port.sleep), port


def simulated(faults: str = "", **options: object) -> RotationStage:
    return Bench(f"zaber?{faults}").connect(**options)


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
    with pytest.raises(ProtocolError, match="has no checksum"):
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
    with pytest.raises(LimitError, match="Correct steps_per_turn"):
        simulated(steps_per_turn=16000)


def test_a_hand_at_the_knob_is_told() -> None:
    stage = simulated("button=1")
    stage.home()
    move = stage.move_to(90.0)
    assert move.tries == 2
    assert "the stage reports NC (turned by hand)" in move.remarks


def test_the_flags_stand_in_the_status() -> None:
    status = simulated().status()
    assert (status.code, status.meaning, status.homed) == ("WR", "no reference position", False)
