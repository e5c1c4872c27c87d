"""The bytes here are written out from Thorlabs' protocol document, addressed to a USB unit."""

import numpy as np
import pytest

from sim_devices.stages.apt import AptLanguage
from sim_devices.stages.catalogue import parse_stage_address
from sim_devices.stages.drive import Drive


class Stage:
    """A K10CR1 without landing errors, at its mark; its parameters make 10 degrees a second."""

    def __init__(self, faults: str = "", *, start_deg: int = 0) -> None:
        options = parse_stage_address(f"sim:apt?landing=0&start={start_deg}&{faults}")
        drive = Drive(options, generator=np.random.default_rng(0))
        self.ring = drive.ring
        self._language = AptLanguage(options, drive)

    def hears(self, time_s: float, text: str) -> list[str]:
        return [reply.hex(" ") for _, reply in self._language.receive(time_s, bytes.fromhex(text))]

    def says_by(self, time_s: float) -> list[tuple[float, str]]:
        return [(time_s, reply.hex(" ")) for time_s, reply in self._language.advance(time_s)]


STATUS, MOVE_45, HOME = "80 04 01 00 50 01", "53 04 06 00 d0 01 01 00 00 c0 5d 00", "43 04 01 00 50 01"
AT_45 = "01 00 00 c0 5d 00 00 00 00 00 00 21 00 80"  # position, encoder, connected, settled, enabled


def test_says_what_it_is() -> None:
    (reply,) = Stage("serial=55000123").hears(0.0, "05 00 00 00 50 01")
    data = bytes.fromhex(reply)
    assert data[:6].hex(" ") == "06 00 54 00 81 50"
    assert len(data) == 6 + 84
    assert int.from_bytes(data[6:10], "little") == 55000123
    assert data[10:18] == b"K10CR1\x00\x00"


def test_a_servo_controller_tells_its_stage() -> None:
    (reply,) = Stage("model=KDC101").hears(0.0, "05 00 00 00 50 01")
    assert bytes.fromhex(reply)[6 + 76 : 6 + 78] == b"\x06\x00"


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        (STATUS, "81 04 0e 00 81 50 01 00 00 00 00 00 00 00 00 00 00 21 00 80"),
        ("90 04 01 00 50 01", "91 04 0e 00 81 50 01 00 00 00 00 00 00 00 00 00 00 21 00 80"),
        ("29 04 01 00 50 01", "2a 04 06 00 81 50 01 00 00 21 00 80"),
        ("11 04 01 00 50 01", "12 04 06 00 81 50 01 00 00 00 00 00"),
        ("11 02 01 00 50 01", "12 02 01 01 01 50"),
        ("3b 04 01 00 50 01", "3c 04 06 00 81 50 01 00 00 00 00 00"),
    ],
)
def test_answers_at_once(question: str, answer: str) -> None:
    assert Stage().hears(1.0, question) == [answer]


@pytest.mark.parametrize(
    ("model", "number", "length"),
    [
        ("K10CR1", 0x0413, 12),
        ("K10CR1", 0x0416, 20),
        ("K10CR1", 0x0423, 14),
        ("K10CR1", 0x0426, 4),
        ("K10CR1", 0x0440, 12),
        ("K10CR1", 0x0445, 4),
        ("K10CR1", 0x0450, 4),
        ("KDC101", 0x04A0, 18),
        ("KDC101", 0x04B0, 24),
        ("KDC101", 0x04B3, 2),
        ("KDC101", 0x04B6, 14),
        ("KDC101", 0x0520, 28),
        ("KDC101", 0x0523, 8),
        ("KDC101", 0x0526, 32),
    ],
)
def test_parameters_of_each_kind_are_kept_and_told(model: str, number: int, length: int) -> None:
    stage = Stage(f"model={model}")
    data = "01 00 " + " ".join(f"{byte:02x}" for byte in range(1, length + 1))
    stage.hears(0.0, f"{number & 0xFF:02x} {number >> 8:02x} {length + 2:02x} 00 d0 01 {data}")
    (answer,) = stage.hears(0.0, f"{(number + 1) & 0xFF:02x} {number >> 8:02x} 01 00 50 01")
    assert answer == f"{(number + 2) & 0xFF:02x} {number >> 8:02x} {length + 2:02x} 00 81 50 {data}"


def test_what_another_controller_has_is_not_answered() -> None:
    assert Stage().hears(0.0, "a1 04 01 00 50 01") == []
    assert Stage("model=KDC101").hears(0.0, "27 04 01 00 50 01") == []


def test_short_settings_are_kept_and_told() -> None:
    stage = Stage()
    stage.hears(0.0, "00 05 01 04 50 01")
    assert stage.hears(0.0, "01 05 01 00 50 01") == ["02 05 01 04 01 50"]


def test_moves_without_data_go_by_the_parameters() -> None:
    stage = Stage()
    stage.hears(0.0, "50 04 06 00 d0 01 01 00 00 c0 5d 00")  # 45 degrees
    stage.hears(0.0, "53 04 01 00 50 01")
    assert stage.says_by(9.0)[0][1] == "64 04 0e 00 81 50 " + AT_45
    stage.hears(9.0, "45 04 06 00 d0 01 01 00 00 40 a2 ff")  # 45 degrees back
    stage.hears(9.0, "48 04 01 00 50 01")
    stage.says_by(20.0)
    assert stage.ring.angle_deg(20.0) == 0.0


@pytest.mark.parametrize(("way", "bits", "angle_deg"), [("01", "40 01", -5.0), ("02", "80 01", 5.0)])
def test_a_jog_goes_by_a_step(way: str, bits: str, angle_deg: float) -> None:
    stage = Stage()
    stage.hears(0.0, f"6a 04 01 {way} 50 01")
    assert stage.hears(0.1, STATUS)[0].endswith(f"{bits} 00 80")
    assert len(stage.says_by(5.0)) == 1
    assert stage.ring.angle_deg(5.0) == pytest.approx(angle_deg, abs=1e-5)


def test_a_motion_without_end_ends_at_a_stop() -> None:
    stage = Stage()
    stage.hears(0.0, "57 04 01 02 50 01")
    assert stage.says_by(100.0) == []
    assert stage.hears(100.0, "65 04 01 02 50 01")[0].startswith("66 04 0e")
    assert stage.ring.angle_deg(200.0) == pytest.approx(1000.0, rel=1e-6)


def test_soft_limits_end_a_move_and_are_told() -> None:
    stage = Stage()
    stage.hears(0.0, "23 04 10 00 d0 01 01 00 01 00 01 00 00 40 1f 00 00 c0 e0 ff 02 00")  # 15 degrees to either side
    stage.hears(0.0, MOVE_45)
    stage.says_by(9.0)
    assert stage.ring.angle_deg(9.0) == pytest.approx(15.0, abs=1e-5)
    assert stage.hears(9.0, STATUS)[0].endswith("08 21 00 80")
    stage.hears(9.0, "57 04 01 01 50 01")
    stage.says_by(20.0)
    assert stage.ring.angle_deg(20.0) == pytest.approx(-15.0, abs=1e-5)


def test_the_place_where_it_stands_may_get_another_number() -> None:
    stage = Stage()
    stage.hears(0.0, "10 04 06 00 d0 01 01 00 00 c0 5d 00")
    assert stage.hears(0.0, "11 04 01 00 50 01") == ["12 04 06 00 81 50 01 00 00 c0 5d 00"]
    assert stage.ring.angle_deg(0.0) == 0.0


def test_another_home_offset_moves_the_zero_by_its_change() -> None:
    stage = Stage(start_deg=20)
    stage.hears(0.0, "40 04 0e 00 d0 01 01 00 02 00 01 00 27 7b 5e 04 aa aa 0a 00")  # 5.12 degrees; it came with 4
    stage.hears(0.0, HOME)
    stage.says_by(9.0)
    assert stage.ring.angle_deg(9.0) == pytest.approx((0x0AAAAA - 546133) * 3 / 409600, abs=1e-9)


def test_ends_are_not_told_while_that_is_suspended() -> None:
    stage = Stage()
    stage.hears(0.0, "6b 04 01 00 50 01")
    stage.hears(0.0, MOVE_45)
    assert stage.says_by(9.0) == []
    stage.hears(9.0, "6c 04 01 00 50 01")
    stage.hears(9.0, HOME)
    assert len(stage.says_by(20.0)) == 1


@pytest.mark.parametrize(
    "question", ["18 00 00 00 50 01", "23 02 00 00 50 01", "00 00 00 00 00 00", "80 04 01 00 22 01"]
)
def test_has_nothing_to_say_to_what_is_no_question_or_not_its_own(question: str) -> None:
    assert Stage().hears(1.0, question) == []


def test_parameters_are_kept() -> None:
    stage = Stage()
    stage.hears(0.0, "13 04 0e 00 d0 01 01 00 00 00 00 00 b0 35 00 00 cd cc cc 00")
    assert stage.hears(0.0, "14 04 01 00 50 01") == ["15 04 0e 00 81 50 01 00 00 00 00 00 b0 35 00 00 cd cc cc 00"]


def test_a_move_tells_its_end_with_the_status() -> None:
    stage = Stage()
    assert stage.hears(0.0, MOVE_45) == []
    ((time_s, reply),) = stage.says_by(9.0)
    assert time_s == pytest.approx(4.5, rel=1e-6)  # 10 deg/s to the last whole unit of the velocity
    assert reply == "64 04 0e 00 81 50 " + AT_45
    assert stage.ring.angle_deg(9.0) == 45.0


def test_while_it_moves_the_status_says_so() -> None:
    stage = Stage()
    stage.hears(0.0, MOVE_45)
    assert stage.hears(1.0, STATUS)[0].endswith("20 01 00 80")


def test_homing_sets_its_bit_and_says_so() -> None:
    stage = Stage(start_deg=20)
    stage.hears(0.0, HOME)
    assert stage.hears(1.0, STATUS)[0].endswith("10 03 00 80")
    assert [reply for _, reply in stage.says_by(5.0)] == ["44 04 01 00 01 50"]
    assert stage.hears(5.0, STATUS)[0].endswith("00 25 00 80")


def test_on_request_homing_says_nothing() -> None:
    stage = Stage("quiethome=1")
    stage.hears(0.0, HOME)
    assert stage.says_by(5.0) == []
    assert stage.hears(5.0, STATUS)[0].endswith("00 25 00 80")


def test_without_parameters_it_says_that_it_moves_and_stands_still() -> None:
    stage = Stage("forgets=1")
    stage.hears(0.0, MOVE_45)
    assert stage.says_by(99.0) == []
    assert stage.hears(99.0, STATUS)[0].endswith("20 01 00 80")
    assert stage.ring.angle_deg(99.0) == 0.0


def test_a_servo_that_is_not_switched_on_does_not_move() -> None:
    stage = Stage("model=KDC101")
    stage.hears(0.0, HOME)
    stage.hears(0.0, MOVE_45)
    assert stage.says_by(99.0) == []
    stage.hears(99.0, "10 02 01 01 50 01")
    stage.hears(99.0, HOME)
    assert [reply for _, reply in stage.says_by(199.0)] == ["44 04 01 00 01 50"]


def test_unasked_status_ends_after_fifty_messages_without_an_answer() -> None:
    stage = Stage()
    stage.hears(0.0, "11 00 00 00 50 01")
    assert len(stage.says_by(20.0)) == 50
    stage.hears(20.0, "92 04 00 00 50 01")
    assert len(stage.says_by(21.0)) == pytest.approx(10, abs=1)
    stage.hears(21.0, "12 00 00 00 50 01")
    assert stage.says_by(30.0) == []


def test_what_came_in_part_is_forgotten_after_a_silence() -> None:
    stage = Stage()
    stage.hears(0.0, MOVE_45[:20])
    assert len(stage.hears(1.0, STATUS)) == 1


def test_a_stopped_motion_tells_where() -> None:
    stage = Stage()
    stage.hears(0.0, MOVE_45)
    assert stage.hears(2.25, "65 04 01 02 50 01")[0].startswith("66 04 0e 00 81 50 01 00")
    assert stage.ring.angle_deg(9.0) == pytest.approx(22.5, rel=1e-6)
