"""The bytes here are written out from the ELLx protocol manual and from replies of true stages."""

import numpy as np
import pytest

from sim_devices.stages.catalogue import parse_stage_address
from sim_devices.stages.drive import Drive
from sim_devices.stages.ellx import EllxLanguage


class Stage:
    """A stage without landing errors that turns by 90 degrees a second, from its mark at 45 degrees in the housing."""

    def __init__(self, faults: str = "") -> None:
        options = parse_stage_address(f"sim:ellx?landing=0&start=45&mark=45&slow=90&{faults}")
        drive = Drive(options, generator=np.random.default_rng(0))
        self.mechanics = drive.ring
        self._language = EllxLanguage(options, drive)

    def hears(self, time_s: float, data: bytes) -> list[tuple[float, bytes]]:
        return self._language.receive(time_s, data)

    def says_by(self, time_s: float) -> list[tuple[float, bytes]]:
        return self._language.advance(time_s)

    def next_event_s(self) -> float | None:
        return self._language.next_event_s()


@pytest.mark.parametrize(
    ("command", "reply"),
    [
        (b"0in", b"0IN0E1140132620251801016800023000\r\n"),
        (b"0in\r\n", b"0IN0E1140132620251801016800023000\r\n"),
        (b"0gs", b"0GS00\r\n"),
        (b"0gp", b"0PO00000000\r\n"),
        (b"0st", b"0GS00\r\n"),
        (b"0gv", b"0GV64\r\n"),
        (b"0sv32", b"0GS00\r\n"),
        (b"0sv00", b"0GS04\r\n"),
        (b"0sv65", b"0GS04\r\n"),
        (b"0ma7FFFFFFF", b"0GS04\r\n"),
        (b"0ma0000460z", b"0GS04\r\n"),
        (b"0zz", b"0GS03\r\n"),
        (b"0us", b"0GS00\r\n"),
        (b"0sk", b"0GS00\r\n"),
        (b"0go", b"0HO0000018E\r\n"),
        (b"0so00000400", b"0GS00\r\n"),
        (b"0soFFFFFFFF", b"0GS04\r\n"),
        (b"0gj", b"0GJ00000F8E\r\n"),
        (b"0sj00002000", b"0GS00\r\n"),
        (b"0sj00023001", b"0GS04\r\n"),
        (b"0i1", b"0I110005DFFFFFFFF00BD008B\r\n"),
        (b"0i2", b"0I210005DFFFFFFFF00BC008C\r\n"),
        (b"0f180C0", b"0GS00\r\n"),
        (b"0b2FFFF", b"0GS00\r\n"),
        (b"0b10001", b"0GS04\r\n"),
        (b"0i3", b"0GS03\r\n"),
        (b"0ca7", b"7GS00\r\n"),
        (b"0ga7", b"0GS00\r\n"),
        (b"0is01", b"0GS00\r\n"),
    ],
)
def test_answers_at_once(command: bytes, reply: bytes) -> None:
    assert Stage().hears(1.0, command) == [(1.0, reply)]


@pytest.mark.parametrize("command", [b"3gs", b"3ma00004600", b"0", b"0g", b"0ma0000460", b"\r\n", b"?!"])
def test_has_nothing_to_say_to_what_is_not_whole_or_not_its_own(command: bytes) -> None:
    assert Stage().hears(1.0, command) == []


def test_a_move_is_answered_when_it_ends() -> None:
    stage = Stage()
    assert stage.hears(1.0, b"0ma00004600") == []
    assert stage.next_event_s() == 1.5
    assert stage.says_by(1.49) == []
    assert stage.says_by(2.0) == [(1.5, b"0PO00004600\r\n")]
    assert stage.mechanics.angle_deg(2.0) == 90.0


def test_a_relative_move_may_end_below_zero() -> None:
    stage = Stage()
    stage.hears(0.0, b"0mrFFFFFFFF")
    assert [reply for _, reply in stage.says_by(1.0)] == [b"0POFFFFFFFF\r\n"]


def test_homing_is_answered_when_it_ends() -> None:
    stage = Stage()
    stage.hears(0.0, b"0ma00004600")
    stage.says_by(1.0)
    assert stage.hears(1.0, b"0ho0") == []
    assert stage.says_by(2.0) == [(1.5, b"0PO00000000\r\n")]


def test_half_the_velocity_takes_twice_the_time() -> None:
    stage = Stage()
    stage.hears(0.0, b"0sv32")
    stage.hears(0.0, b"0ma00004600")
    assert stage.next_event_s() == 1.0


def test_while_it_moves_it_is_busy_and_takes_no_other_move() -> None:
    stage = Stage()
    stage.hears(0.0, b"0ma00004600")
    assert stage.hears(0.1, b"0gs") == [(0.1, b"0GS09\r\n")]
    assert stage.hears(0.2, b"0ma00000000") == [(0.2, b"0GS09\r\n")]
    assert stage.says_by(1.0) == [(0.5, b"0PO00004600\r\n")]


def test_on_request_a_move_is_first_answered_by_busy() -> None:
    stage = Stage("busy=1")
    assert stage.hears(0.0, b"0ma00004600") == [(0.0, b"0GS09\r\n")]
    assert stage.says_by(1.0) == [(0.5, b"0PO00004600\r\n")]


def test_a_command_may_come_in_pieces() -> None:
    stage = Stage()
    assert stage.hears(0.0, b"0g") == []
    assert stage.hears(1.9, b"p") == [(1.9, b"0PO00000000\r\n")]


def test_a_command_that_pauses_for_two_seconds_is_forgotten_and_remembered_as_error_1() -> None:
    stage = Stage()
    stage.hears(0.0, b"0ma0000")
    assert stage.hears(2.1, b"0gs") == [(2.1, b"0GS01\r\n")]
    assert stage.hears(2.2, b"0gs") == [(2.2, b"0GS00\r\n")]


def test_a_carriage_return_makes_it_forget_a_command_in_part() -> None:
    stage = Stage()
    stage.hears(0.0, b"0ma0000")
    assert stage.hears(0.1, b"\r0gs") == [(0.1, b"0GS00\r\n")]


def test_an_error_stays_until_it_is_read() -> None:
    stage = Stage()
    stage.hears(0.0, b"0zz")
    assert stage.hears(0.1, b"0gp0gs0gs") == [(0.1, b"0PO00000000\r\n"), (0.1, b"0GS03\r\n"), (0.1, b"0GS00\r\n")]


def test_a_stall_stops_half_way_and_is_told_after_two_seconds() -> None:
    stage = Stage("stall=2")
    stage.hears(0.0, b"0ma00002300")
    stage.says_by(1.0)
    stage.hears(1.0, b"0ma00004600")  # from 22.5 to 45 degrees, half of it in 0.125 s
    assert stage.says_by(5.0) == [(3.125, b"0GS02\r\n")]
    assert stage.mechanics.angle_deg(5.0) == 78.75
    assert stage.hears(5.0, b"0gs") == [(5.0, b"0GS02\r\n")]


def test_a_pressed_button_is_told_unasked_and_turns_the_stage() -> None:
    stage = Stage("button=1")
    stage.hears(0.0, b"0ma00004600")
    assert [reply for _, reply in stage.says_by(1.0)] == [b"0BS09\r\n", b"0BO00004DC7\r\n", b"0PO00004DC7\r\n"]


def test_a_move_too_soon_after_another_goes_to_zero() -> None:
    stage = Stage("gap=0.1")
    stage.hears(0.0, b"0ma00004600")
    stage.says_by(0.5)
    stage.hears(0.55, b"0ma00002300")
    assert [reply for _, reply in stage.says_by(2.0)] == [b"0PO00000000\r\n"]
    stage.hears(2.1, b"0ma00002300")
    assert [reply for _, reply in stage.says_by(4.0)] == [b"0PO00002300\r\n"]


def test_falls_silent_from_the_command_on_that_was_asked_for() -> None:
    stage = Stage("silent=2")
    assert len(stage.hears(0.0, b"0gs")) == 1
    assert stage.hears(0.1, b"0gs") == []


def test_a_period_that_is_set_is_told_until_the_search_finds_the_resonance() -> None:
    stage = Stage()
    stage.hears(0.0, b"0f180C0")
    assert b"00C0" in stage.hears(0.0, b"0i1")[0][1]
    assert stage.hears(0.0, b"0s1") == []
    assert stage.hears(0.5, b"0gs") == [(0.5, b"0GS09\r\n")]
    assert stage.says_by(2.0) == [(1.5, b"0GS00\r\n")]
    assert b"00BD" in stage.hears(2.0, b"0i1")[0][1]


def test_the_current_curve_has_87_points_and_its_peak_at_the_resonance() -> None:
    stage = Stage()
    stage.hears(0.0, b"0c1")
    ((time_s, reply),) = stage.says_by(20.0)
    points = [bytes.fromhex(reply[start : start + 12].decode()) for start in range(3, len(reply) - 2, 12)]
    currents = {int.from_bytes(point[:2], "little"): int.from_bytes(point[2:], "little") for point in points}
    assert (time_s, reply[:3], len(points)) == (12.0, b"0C1", 87)
    assert max(currents, key=lambda period: currents[period]) in (0x8B, 0xBD)


def test_jogs_go_by_the_step() -> None:
    stage = Stage()
    stage.hears(0.0, b"0sj00000800")
    stage.hears(0.0, b"0fw")
    assert [reply for _, reply in stage.says_by(5.0)] == [b"0PO00000800\r\n"]
    stage.hears(5.0, b"0bw")
    assert [reply for _, reply in stage.says_by(9.0)] == [b"0PO00000000\r\n"]


def test_a_jog_of_nothing_goes_on_until_it_is_stopped() -> None:
    stage = Stage()
    stage.hears(0.0, b"0sj00000000")
    assert stage.hears(0.0, b"0fw") == [(0.0, b"0GS00\r\n")]
    assert stage.hears(7.0, b"0gs") == [(7.0, b"0GS09\r\n")]
    assert stage.hears(8.0, b"0ma00000000") == [(8.0, b"0GS09\r\n")]
    assert stage.hears(9.0, b"0st") == [(9.0, b"0GS00\r\n")]
    assert stage.mechanics.angle_deg(20.0) == pytest.approx(45.0 + 9.0 * 90.0)


def test_a_move_to_somewhere_cannot_be_stopped() -> None:
    stage = Stage()
    stage.hears(0.0, b"0ma00004600")
    assert stage.hears(0.1, b"0st") == [(0.1, b"0GS09\r\n")]
    assert stage.says_by(1.0) == [(0.5, b"0PO00004600\r\n")]


@pytest.mark.parametrize("command", [b"0om", b"0cm"])
def test_upkeep_takes_minutes_and_can_be_stopped(command: bytes) -> None:
    stage = Stage()
    assert stage.hears(0.0, command) == []
    assert stage.hears(60.0, b"0gs") == [(60.0, b"0GS09\r\n")]
    assert stage.hears(61.0, b"0st") == [(61.0, b"0GS00\r\n")]
    stage.hears(62.0, command)
    assert [reply for _, reply in stage.says_by(999.0)] == [b"0GS00\r\n"]


def test_another_home_offset_moves_the_zero_by_its_change() -> None:
    stage = Stage()
    stage.hears(0.0, b"0so0000031C")  # twice what it comes with, which is a degree
    stage.hears(0.0, b"0ho1")
    assert [reply for _, reply in stage.says_by(9.0)] == [b"0PO00000000\r\n"]
    assert stage.mechanics.angle_deg(9.0) == pytest.approx(46.0, abs=0.003)


def test_another_address_is_the_only_one_it_then_listens_to() -> None:
    stage = Stage()
    stage.hears(0.0, b"0caB")
    assert stage.hears(0.1, b"0gs") == []
    assert stage.hears(0.2, b"Bgs") == [(0.2, b"BGS00\r\n")]
    assert Stage("address=4").hears(0.0, b"4gp") == [(0.0, b"4PO00000000\r\n")]


def test_the_address_of_a_group_holds_for_one_motion() -> None:
    stage = Stage()
    stage.hears(0.0, b"0ga3")
    assert stage.hears(0.1, b"3gs") == []
    stage.hears(0.2, b"3ma00004600")
    assert [reply for _, reply in stage.says_by(2.0)] == [b"0PO00004600\r\n"]
    assert stage.hears(3.0, b"3ma00000000") == []
    assert stage.next_event_s() is None


def test_in_isolation_it_is_deaf_and_tells_so_afterwards() -> None:
    stage = Stage()
    stage.hears(0.0, b"0is02")
    assert stage.hears(119.0, b"0gs0ma00004600") == []
    assert stage.hears(121.0, b"0gs") == [(121.0, b"0GS06\r\n")]
    assert stage.hears(122.0, b"0gs") == [(122.0, b"0GS00\r\n")]
