"""The Elliptec driver: bytes of the ELLx manual and of true stages, and what goes over the line."""

import pytest

from drivers.errors import DeviceFaultError, DeviceTimeoutError, LimitError, ProtocolError
from drivers.stages import elliptec as protocol
from drivers.stages.elliptec import EllxStage, Information, Reply, ReplyParser, open_elliptec
from tests.drivers.stages.lines import Script, ScriptedPort

ELL14 = b"0IN0E1140132620251801016800023000\r\n"


def parse(data: bytes) -> Reply | None:
    parser = ReplyParser()
    parser.feed(data)
    return parser.next_event()


def information(**changes: int) -> Information:
    values = {"stage_type": 14, "travel": 360, "pulses": 143360} | changes
    return Information(serial_number="11401326", firmware="18", **values)


@pytest.mark.parametrize(
    ("address", "letters", "counts", "sent"),
    [
        ("0", "ma", 0x4600, b"0ma00004600"),
        ("F", "ma", -1, b"FmaFFFFFFFF"),
        ("0", "mr", -(1 << 31), b"0mr80000000"),
    ],
)
def test_moves(address: str, letters: str, counts: int, sent: bytes) -> None:
    assert protocol.move(address, letters, counts=counts) == sent


@pytest.mark.parametrize("address", ["", "00", "G", "a", "\n"])
def test_an_address_that_does_not_exist_is_refused(address: str) -> None:
    with pytest.raises(LimitError, match="0-9 or A-F"):
        protocol.check_address(address)


def test_replies_that_come_together_are_told_one_by_one() -> None:
    parser = ReplyParser()
    parser.feed(b"0GS09\r\nAPO00004600\r\n0GS")
    assert [parser.next_event() for _ in range(3)] == [("0", "GS", "09"), ("A", "PO", "00004600"), None]


def test_what_a_stage_says_of_itself() -> None:
    reply = parse(ELL14)
    assert reply is not None
    assert protocol.information_of(reply[2]) == information()


@pytest.mark.parametrize(("digits", "counts"), [("00004600", 17920), ("FFFFFFFF", -1), ("80000000", -(1 << 31))])
def test_positions(digits: str, counts: int) -> None:
    assert protocol.signed(digits) == counts


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
    assert parser.next_event() == ("0", "GS", "00")


def test_a_flood_without_replies_is_not_kept() -> None:
    parser = ReplyParser()
    with pytest.raises(ProtocolError, match="without a reply"):
        parser.feed(b"x" * 1025)
    parser.feed(b"0PO00004600\r\n0GS00\r\n")  # the first of these may be the flood's own end
    assert parser.next_event() == ("0", "GS", "00")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"stage_type": 17}, "ELL17 is not one of the rotation stages"),
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


IN = b"0IN0E1140132620251801016800023000\r\n"


OPENING: Script = [
    (b"\r", []),
    (b"0gs", [(0.01, b"0GS00\r\n")]),
    (b"0in", [(0.05, IN)]),
    (b"0in", [(0.05, IN)]),
]


HOMING: Script = [
    (b"0ho0", [(0.01, b"0GS09\r\n"), (0.5, b"0PO00000000\r\n")]),
    (b"0gp", [(0.02, b"0PO00000000\r\n")]),
    (b"0gp", [(0.02, b"0PO00000000\r\n")]),
]


RESYNC: Script = [(b"\r", []), (b"0gs", [(0.01, b"0GS00\r\n")])]


AT_45 = b"0PO00004600\r\n"


def homed_stage(script: Script) -> tuple[EllxStage, ScriptedPort]:
    port = ScriptedPort(OPENING + HOMING + script)
    stage = open_elliptec(port, now_s=port.now_s, sleep=port.sleep)
    stage.home()
    return stage, port


def test_the_readback_counts_and_not_what_the_move_answered() -> None:
    elsewhere = b"0PO00004700\r\n"
    stage, port = homed_stage(
        [
            (b"0ma00004600", [(0.2, AT_45)]),
            (b"0gp", [(0.02, elsewhere)]),
            (b"0ma00004600", [(0.2, AT_45)]),
            (b"0gp", [(0.02, AT_45)]),
        ]
    )
    assert stage.move_to(45.0).tries == 2
    assert port.finished


READ_45 = (b"0gp", [(0.02, AT_45)])


@pytest.mark.parametrize(
    "script",
    [
        pytest.param([(b"0gp", [(0.01, b"3PO00000007\r\n"), (0.02, AT_45)])] * 2, id="another stage on the line"),
        pytest.param([(b"0gp", [(0.02, b"0PO00004700\r\n")]), READ_45, READ_45], id="two readings differ"),
        # After the second that an answer may take; it then arrives during the listening and belongs to no question.
        pytest.param([(b"0gp", [(1.02, b"0PO00000123\r\n")]), *RESYNC, READ_45, READ_45], id="a late answer"),
        pytest.param([(b"0gp", [(0.02, b"0PO0000")]), *RESYNC, READ_45, READ_45], id="an answer that breaks off"),
    ],
)
def test_a_wrong_answer_is_not_taken_for_the_position(script: Script) -> None:
    stage, port = homed_stage(script)
    assert stage.position().counts == 0x4600
    assert port.finished


def test_an_answer_that_waits_unread_is_not_taken_for_the_next_one() -> None:
    old = b"0PO00000123\r\n"
    stage, port = homed_stage(
        [
            (b"0gp", [(0.02, old)]),
            (b"0gp", [(0.02, old), (0.02, old)]),
            (b"0gp", [(0.02, AT_45)]),
            (b"0gp", [(0.02, AT_45)]),
        ]
    )
    stage.position()
    assert stage.position().counts == 0x4600
    assert port.finished


def test_a_damaged_answer_to_a_move_is_cleared_up_by_asking() -> None:
    stage, port = homed_stage(
        [
            (b"0ma00004600", [(0.2, b"0PO0004600\r\n")]),
            (b"\r", []),
            (b"0gs", [(0.01, b"0GS09\r\n")]),
            (b"0gs", [(0.01, b"0GS00\r\n")]),
            (b"0gp", [(0.02, AT_45)]),
        ]
    )
    move = stage.move_to(45.0)
    assert move.position.counts == 0x4600
    assert any("8 digits" in remark for remark in move.remarks)
    assert port.finished


def test_a_move_that_the_stage_did_not_understand_is_sent_again() -> None:
    stage, port = homed_stage(
        [
            (b"0ma00004600", [(0.01, b"0GS03\r\n")]),
            (b"0gs", [(0.01, b"0GS03\r\n")]),  # reading the fault clears it
            *RESYNC,
            (b"0gp", [(0.02, b"0PO00000000\r\n")]),
            (b"0ma00004600", [(0.2, AT_45)]),
            (b"0gp", [(0.02, AT_45)]),
        ]
    )
    assert stage.move_to(45.0).tries == 2
    assert port.finished


def test_a_homing_that_was_not_confirmed_is_commanded_again() -> None:
    script = [*OPENING, (b"0ho0", [(0.1, b"0P00000000\r\n")]), *RESYNC, *HOMING]
    port = ScriptedPort(script)
    open_elliptec(port, now_s=port.now_s, sleep=port.sleep).home()
    assert port.finished


def test_a_fault_is_told_with_its_code_and_cleared() -> None:
    stage, port = homed_stage(
        [
            (b"0ma00004600", [(1.0, b"0GS08\r\n")]),
            (b"0gs", [(0.01, b"0GS08\r\n")]),
        ]
    )
    with pytest.raises(DeviceFaultError, match="thermal") as caught:
        stage.move_to(45.0)
    assert (caught.value.code, caught.value.meaning) == (8, "thermal error")
    assert port.finished


def test_a_fault_left_from_before_does_not_hinder_opening_but_is_told() -> None:
    opening: Script = [(b"\r", []), (b"0gs", [(0.01, b"0GS02\r\n")]), *OPENING[2:], *HOMING]
    port = ScriptedPort([*opening, (b"0ma00004600", [(0.2, AT_45)]), (b"0gp", [(0.02, AT_45)])])
    stage = open_elliptec(port, now_s=port.now_s, sleep=port.sleep)
    stage.home()
    assert any("left from before: status 2" in remark for remark in stage.move_to(45.0).remarks)


def test_a_stage_that_restarted_must_be_homed_again() -> None:
    stage, port = homed_stage(
        [
            (b"0ma00004600", [(0.1, b"0P0\r\n")]),  # what came when the supply failed
            (b"\r", []),
            (b"0gs", [(0.01, b"0GS07\r\n")]),
            (b"0gs", [(0.01, b"0GS00\r\n")]),
            (b"0gp", [(0.02, AT_45)]),
            *HOMING,
            (b"0ma00004600", [(0.2, AT_45)]),
            (b"0gp", [(0.02, AT_45)]),
        ]
    )
    with pytest.raises(LimitError, match="since it was restarted"):
        stage.move_to(45.0)
    stage.home()
    assert stage.move_to(45.0).position.counts == 0x4600
    assert port.finished


def test_a_button_pressed_between_two_moves_is_told_with_the_next() -> None:
    pressed = [(0.02, AT_45), (0.021, b"0BS09\r\n"), (0.021, b"0BO00005000\r\n")]
    stage, _ = homed_stage(
        [
            (b"0ma00004600", [(0.2, AT_45)]),
            (b"0gp", pressed),
            (b"0ma00000000", [(0.2, b"0PO00000000\r\n")]),
            (b"0gp", [(0.02, b"0PO00000000\r\n")]),
        ]
    )
    assert stage.move_to(45.0).remarks == ()
    remarks = stage.move_to(0.0).remarks
    assert remarks == (
        "a button of the handset was pressed",
        "a button of the handset moved the stage to 20480 counts",
    )


def test_a_move_waits_a_tenth_of_a_second_after_the_line_was_last_used() -> None:
    stage, port = homed_stage([(b"0ma00000000", [(0.0, b"0PO00000000\r\n")]), (b"0gp", [(0.0, b"0PO00000000\r\n")])])
    before_s = port.now_s()
    stage.move_to(0.0)
    # Nothing else in this script takes time; 1e-9 is far above the rounding of a sum of seconds.
    assert port.now_s() - before_s == pytest.approx(0.1, abs=1e-9)


def test_a_damaged_reading_does_not_make_the_next_wait_longer() -> None:
    stage, port = homed_stage(
        [
            (b"0ma00004600", [(0.2, AT_45)]),
            (b"0gp", [(0.02, b"0PO40004601\r\n")]),
            *[(b"0gp", [(0.02, AT_45)])] * 2,  # from there only a relative move would lead: so it is read again
            (b"0ma00004600", []),
            *[(b"\r", []), (b"0gs", [])] * 3,
        ]
    )
    with pytest.raises(DeviceTimeoutError):
        stage.move_to(45.0)
    # The deadline of no way at all is 2 s; homing, the first try and asking for the status take less than 5 s.
    assert port.now_s() < 2.0 + 5.0


def test_a_silent_address_is_a_timeout_within_its_deadline() -> None:
    port = ScriptedPort([(b"\r", []), (b"5gs", [])] * 3)
    with pytest.raises(DeviceTimeoutError, match="stage 5 on scripted port: no answer to b'5gs'"):
        open_elliptec(port, address="5", now_s=port.now_s, sleep=port.sleep)
    assert port.now_s() < 4.0  # three tries of a second, and three times 0.05 s of listening


@pytest.mark.parametrize(
    ("reply", "reason"),
    [
        (b"0IN111140132620251801001C00002000\r\n", "ELL17"),
        (b"0IN0E1140132620251801016800000000\r\n", "0 pulses"),
    ],
)
def test_what_is_no_rotation_stage_is_refused(reply: bytes, reason: str) -> None:
    port = ScriptedPort([*OPENING[:2], (b"0in", [(0.05, reply)]), (b"0in", [(0.05, reply)])])
    with pytest.raises(ProtocolError, match=reason):
        open_elliptec(port, now_s=port.now_s, sleep=port.sleep)


def test_pulses_that_were_told_once_only_are_not_believed() -> None:
    bent = IN.replace(b"023000", b"021000")
    answers = [bent, IN, IN]
    port = ScriptedPort([*OPENING[:2], *[(b"0in", [(0.05, answer)]) for answer in answers], *HOMING])
    stage = open_elliptec(port, now_s=port.now_s, sleep=port.sleep)
    stage.home()
    assert port.finished


def test_the_short_way_through_zero_is_a_relative_move_from_a_reading_that_is_sure() -> None:
    at_315 = b"0POFFFFBA00\r\n"  # 17920 counts below zero
    stage, port = homed_stage(
        [
            *[(b"0gp", [(0.02, b"0PO00000000\r\n")])] * 2,
            (b"0mrFFFFBA00", [(0.2, at_315)]),
            (b"0gp", [(0.02, at_315)]),
        ]
    )
    assert stage.move_to(315.0).position.angle_deg == 315.0
    assert port.finished


@pytest.mark.parametrize(("reply", "moving", "code"), [(b"0GS00\r\n", False, 0), (b"0GS09\r\n", True, 9)])
def test_the_status_is_told(reply: bytes, moving: bool, code: int) -> None:
    stage, _ = homed_stage([(b"0gs", [(0.01, reply)])])
    status = stage.status()
    assert (status.moving, status.homed, status.code) == (moving, True, code)


def test_a_fault_in_the_status_is_told_and_not_raised() -> None:
    stage, _ = homed_stage([(b"0gs", [(0.01, b"0GS0B\r\n")]), (b"0gs", [(0.01, b"0GS0B\r\n")])])
    status = stage.status()
    assert (status.moving, status.code, status.meaning) == (False, 11, "motor error")
