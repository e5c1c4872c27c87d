"""The bytes here are written out from Zaber's ASCII protocol manual."""

import numpy as np
import pytest

from sim_devices.stages.catalogue import parse_stage_address
from sim_devices.stages.drive import Drive
from sim_devices.stages.zaber import ZaberLanguage


class Stage:
    """A stage without landing errors that turns by 90 degrees a second, from its mark at 0 in the housing."""

    def __init__(self, faults: str = "", *, start_deg: int = 0) -> None:
        options = parse_stage_address(f"sim:zaber?landing=0&start={start_deg}&slow=90&{faults}")
        drive = Drive(options, generator=np.random.default_rng(0))
        self.ring = drive.ring
        self._language = ZaberLanguage(options, drive)

    def hears(self, time_s: float, data: bytes) -> list[tuple[float, bytes]]:
        return self._language.receive(time_s, data)

    def says_by(self, time_s: float) -> list[tuple[float, bytes]]:
        return self._language.advance(time_s)


@pytest.mark.parametrize(
    ("command", "reply"),
    [
        (b"/\n", b"@01 0 OK IDLE WR 0\r\n"),
        (b"/0 0 00:00\n", b"@01 0 00 OK IDLE WR 0\r\n"),
        (b"/1\r\n", b"@01 0 OK IDLE WR 0\r\n"),
        (b"/1 1 42\n", b"@01 1 42 OK IDLE WR 0\r\n"),
        (b"/get system.serial\n", b"@01 0 OK IDLE WR 114821\r\n"),
        (b"/1 1 get resolution\n", b"@01 1 OK IDLE WR 64\r\n"),
        (b"/1 1 get limit.cycle.dist\n", b"@01 1 OK IDLE WR 1536000\r\n"),
        (b"/1 1 get pos\n", b"@01 1 OK IDLE WR 0\r\n"),
        (b"/1 0 warnings\n", b"@01 0 OK IDLE WR 01 WR\r\n"),
        (b"/1 tools echo:BF\n", b"@01 0 RJ IDLE WR BADCOMMAND\r\n"),
        (b"/1 1 get no.such\n", b"@01 1 RJ IDLE WR BADCOMMAND\r\n"),
        (b"/1 2 get pos\n", b"@01 2 RJ IDLE WR BADAXIS\r\n"),
        (b"/1 1 move abs x\n", b"@01 1 RJ IDLE WR BADDATA\r\n"),
        (b"/1 1 move abs 1000000001\n", b"@01 1 RJ IDLE WR BADDATA\r\n"),
        (b"/1 get 1 maxspeed accel\n", b"@01 0 OK IDLE WR 699051 ; 205\r\n"),
        (b"/1 1 get motion.index.num\n", b"@01 1 OK IDLE WR 1\r\n"),
        (b"/1 1 set accel 300\n", b"@01 1 OK IDLE WR 0\r\n"),
        (b"/1 1 set accel x\n", b"@01 1 RJ IDLE WR BADDATA\r\n"),
        (b"/1 1 set deviceid 5\n", b"@01 1 RJ IDLE WR BADCOMMAND\r\n"),
        (b"/1 1 move sin 100 100\n", b"@01 1 RJ IDLE WR BADDATA\r\n"),
        (b"/1 trigger show\n", b"@01 0 OK IDLE WR d d d d d d\r\n"),
        (b"/1 trigger 7 enable\n", b"@01 0 RJ IDLE WR BADDATA\r\n"),
        (b"/1 storage get a\n", b"@01 0 RJ IDLE WR BADDATA\r\n"),
        (b"/1 io info\n", b"@01 0 OK IDLE WR 0 0 0 0\r\n"),
        (b"/1 renumber 100\n", b"@01 0 RJ IDLE WR BADDATA\r\n"),
        (b"noise/1 1 get pos\n", b"@01 1 OK IDLE WR 0\r\n"),
    ],
)
def test_answers_at_once(command: bytes, reply: bytes) -> None:
    assert Stage().hears(1.0, command) == [(1.0, reply)]


@pytest.mark.parametrize("command", [b"/2 get pos\n", b"/1 get pos", b"get pos\n", b"/1 tools echo:BE\n", b"\r\n"])
def test_has_nothing_to_say_to_what_is_not_whole_not_sound_or_not_its_own(command: bytes) -> None:
    assert Stage().hears(1.0, command) == []


def test_with_checksums_switched_on_every_message_has_one() -> None:
    stage = Stage()
    assert stage.hears(0.0, b"/1 set comm.checksum 1\n") == [(0.0, b"@01 0 OK IDLE WR 0:3E\r\n")]
    assert stage.hears(0.0, b"/1 1 home\n")[0][1].startswith(b"@01 1 OK BUSY WR 0:")


def test_homing_takes_the_warning_away() -> None:
    stage = Stage(start_deg=45)
    assert stage.hears(0.0, b"/1 1 home\n") == [(0.0, b"@01 1 OK BUSY WR 0\r\n")]
    assert stage.hears(0.4, b"/1 1\n") == [(0.4, b"@01 1 OK BUSY WR 0\r\n")]
    assert stage.hears(0.6, b"/1 1\n") == [(0.6, b"@01 1 OK IDLE -- 0\r\n")]


def test_a_move_is_accepted_at_once_and_ends_in_its_time() -> None:
    stage = Stage()
    assert stage.hears(0.0, b"/1 1 move abs 384000\n") == [(0.0, b"@01 1 OK BUSY WR 0\r\n")]
    assert stage.hears(0.5, b"/1 1 get pos\n") == [(0.5, b"@01 1 OK BUSY WR 192000\r\n")]
    assert stage.hears(1.5, b"/1 1 get encoder.pos\n") == [(1.5, b"@01 1 OK IDLE WR 384000\r\n")]
    assert stage.ring.angle_deg(1.5) == 90.0


def test_alerts_tell_the_end_of_a_motion_when_they_are_on() -> None:
    stage = Stage()
    stage.hears(0.0, b"/0 0 set comm.alert 1:B1\n")
    stage.hears(0.0, b"/1 1 move rel 384000\n")
    assert stage.says_by(2.0) == [(1.0, b"!01 1 IDLE WR\r\n")]


def test_a_stall_stops_half_way_with_its_flag_until_that_is_cleared() -> None:
    stage = Stage("stall=1")
    stage.hears(0.0, b"/1 1 move abs 384000\n")
    assert stage.hears(1.0, b"/1 1\n") == [(1.0, b"@01 1 OK IDLE FS 0\r\n")]
    assert stage.ring.angle_deg(1.0) == 45.0
    assert stage.hears(1.0, b"/1 1 warnings clear\n") == [(1.0, b"@01 1 OK IDLE WR 02 FS WR\r\n")]


def test_stop_ends_a_motion_where_it_is() -> None:
    stage = Stage()
    stage.hears(0.0, b"/1 1 move abs 384000\n")
    assert stage.hears(0.5, b"/1 1 stop\n") == [(0.5, b"@01 1 OK IDLE WR 0\r\n")]
    assert stage.ring.angle_deg(9.0) == 45.0


def data_of(stage: Stage, time_s: float, command: str) -> str:
    return stage.hears(time_s, f"/1 1 {command}\n".encode())[0][1].decode().split(maxsplit=5)[5].strip()


def test_a_lower_top_speed_takes_longer() -> None:
    stage = Stage()
    data_of(stage, 0.0, "set maxspeed 69905")  # ten degrees a second
    data_of(stage, 0.0, "move abs 384000")
    stage.says_by(8.9)
    assert stage.ring.angle_deg(8.9) == pytest.approx(89.0, rel=1e-4)


def test_a_motion_at_a_speed_goes_on_until_it_is_stopped() -> None:
    stage = Stage()
    assert stage.hears(0.0, b"/1 1 move vel -69905\n")[0][1] == b"@01 1 OK BUSY WR 0\r\n"
    assert stage.hears(5.0, b"/1 1 stop\n")[0][1] == b"@01 1 OK IDLE WR 0\r\n"
    assert stage.ring.angle_deg(99.0) == pytest.approx(-50.0, rel=1e-4)


def test_moves_to_an_end_and_to_an_index() -> None:
    stage = Stage("oneturn=1")
    data_of(stage, 0.0, "move max")
    stage.says_by(9.0)
    assert stage.ring.angle_deg(9.0) == 360.0
    data_of(stage, 9.0, "move index 3")
    stage.says_by(20.0)
    assert stage.ring.angle_deg(20.0) == 90.0
    assert data_of(stage, 20.0, "get motion.index.num") == "3"


@pytest.mark.parametrize(
    ("off", "on", "why"),
    [("tools parking park", "tools parking unpark", "PARKED"), ("driver disable", "driver enable", "DRIVERDISABLED")],
)
def test_a_stage_that_may_not_move_says_why(off: str, on: str, why: str) -> None:
    stage = Stage()
    data_of(stage, 0.0, off)
    assert data_of(stage, 0.0, "move abs 1000") == why
    data_of(stage, 0.0, on)
    assert data_of(stage, 0.0, "move abs 1000") == "0"


def test_another_number_is_the_only_one_it_then_listens_to() -> None:
    stage = Stage()
    assert stage.hears(0.0, b"/1 renumber 5\n") == [(0.0, b"@05 0 OK IDLE WR 0\r\n")]
    assert stage.hears(0.0, b"/1 get pos\n") == []
    assert len(stage.hears(0.0, b"/5 get pos\n")) == 1


def test_a_trigger_is_told_as_the_commands_that_make_it() -> None:
    stage = Stage()
    for command in (b"when 1 pos > 5", b"action a 1 stop", b"enable 3"):
        stage.hears(0.0, b"/1 trigger 2 " + command + b"\n")
    told = [reply for _, reply in stage.hears(0.0, b"/1 0 7 trigger 2 print\n")]
    lines = [b"when 1 pos > 5", b"action a 1 stop", b"action b none", b"enable 3"]
    assert told == [b"@01 0 7 OK IDLE WR 0\r\n", *(b"#01 0 7 " + line + b"\r\n" for line in lines)]


def with_trigger(stage: Stage, time_s: float, *commands: str) -> None:
    for command in commands:
        assert data_of(stage, time_s, f"trigger 1 {command}") == "0"


def test_a_trigger_stops_the_stage_where_its_condition_comes_true() -> None:
    stage = Stage()
    stage.hears(0.0, b"/1 1 home\n")
    turn = int(data_of(stage, 5.0, "get limit.cycle.dist"))
    with_trigger(stage, 5.0, f"when 1 pos >= {turn // 4}", "action a 1 stop", "enable 1")
    stage.hears(5.0, f"/1 1 move abs {turn // 2}\n".encode())
    speed = turn / 360.0 * 430.0  # the motor's
    assert 0 <= int(data_of(stage, 20.0, "get pos")) - turn // 4 <= 0.002 * speed
    assert data_of(stage, 20.0, "trigger show") == "d d d d d d"


def test_a_trigger_fires_each_time_its_condition_comes_true_and_at_once_where_it_is() -> None:
    stage = Stage()
    with_trigger(stage, 0.0, "when 1 accel > 300", "action b 1 motion.accelonly += 5", "enable")
    for time_s, accel in enumerate((301, 302, 300, 303), 1):
        data_of(stage, float(time_s), f"set accel {accel}")
    assert data_of(stage, 5.0, "get motion.accelonly") == "215"
    with_trigger(stage, 5.0, "enable 2")
    assert data_of(stage, 5.0, "get motion.accelonly") == "220"
    assert data_of(stage, 5.0, "trigger show").startswith("1 ")


def test_a_trigger_fires_by_distance_in_both_directions() -> None:
    stage = Stage()
    stage.hears(0.0, b"/1 1 home\n")
    with_trigger(stage, 5.0, "when 1 dist 1000", "action a 1 accel += 1", "enable")
    stage.hears(5.0, b"/1 1 move rel 10500\n")
    assert data_of(stage, 20.0, "get accel") == "215"
    stage.hears(20.0, b"/1 1 move rel -10500\n")
    assert data_of(stage, 40.0, "get accel") == "225"


def test_a_trigger_fires_by_time_and_sets_a_setting_to_another() -> None:
    stage = Stage()
    with_trigger(
        stage, 0.0, "when time 100", "action a 1 accel += 1", "action b 1 driver.current.hold = setting 1 accel"
    )
    with_trigger(stage, 0.0, "enable 7")
    assert [data_of(stage, time_s, "get accel") for time_s in (0.05, 0.35, 5.0)] == ["205", "208", "212"]
    data_of(stage, 5.0, "set accel 90")
    with_trigger(stage, 5.0, "enable")
    assert data_of(stage, 6.05, "get driver.current.hold") == "100"


@pytest.mark.parametrize("command", ["when time 0", "when 1 dist x", "when", "action c 1 stop", "enable often"])
def test_what_is_no_trigger_is_refused(command: str) -> None:
    assert data_of(Stage(), 0.0, f"trigger 1 {command}") == "BADDATA"


def test_actions_that_cannot_be_done_are_left() -> None:
    stage = Stage()
    with_trigger(stage, 0.0, "when 1 pos >= 0", "action a 1 move abs far", "action b io set do 1 1", "enable")
    assert data_of(stage, 1.0, "get pos") == "0"


def test_texts_are_kept_for_device_and_axis_apart() -> None:
    stage = Stage()
    stage.hears(0.0, b"/1 storage set a two words\n")
    stage.hears(0.0, b"/1 1 storage axis set a other\n")
    stage.hears(0.0, b"/1 storage append a more\n")
    assert data_of(stage, 0.0, "storage get a") == "two words more"
    assert data_of(stage, 0.0, "storage axis get a") == "other"
    assert data_of(stage, 0.0, "storage erase a") == "0"
    assert data_of(stage, 0.0, "storage exists a") == "0"


def test_settings_can_be_made_what_they_were() -> None:
    stage = Stage()
    data_of(stage, 0.0, "set accel 300")
    data_of(stage, 0.0, "system restore")
    assert data_of(stage, 0.0, "get accel") == "205"
