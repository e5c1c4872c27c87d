"""The driver against every fault of the simulated stage: the right angle, or the right error in time."""

import pytest

from drivers.errors import (
    DeviceError,
    DeviceFaultError,
    DeviceTimeoutError,
    LimitError,
    NotConnectedError,
    ProtocolError,
)
from drivers.interfaces import Move
from drivers.stages.elliptec import EllxStage, connect_elliptec, open_elliptec
from sim_devices.clock import ManualClock, SimClock
from sim_devices.stages.catalogue import make_stage, parse_stage_address
from sim_devices.stages.stage import InProcessPort, serve_on_pty

TOLERANCE_DEG = 0.02
HALF_COUNT_DEG = 180.0 / 65536
PICKERING_DEG = (0.0, 90.0, 45.0, 135.0)


class Bench:
    """A driver and a simulated stage in one simulated time."""

    def __init__(self, faults: str) -> None:
        self.clock = ManualClock()
        self.machine = make_stage(parse_stage_address(f"sim:ellx?{faults}"), clock=self.clock)

    def connect(self) -> EllxStage:
        port = InProcessPort(self.machine, clock=self.clock)
        return connect_elliptec(port, tolerance_deg=TOLERANCE_DEG, now_s=self.clock.now_s, sleep=self.clock.sleep)

    def homed(self) -> EllxStage:
        stage = self.connect()
        stage.home()
        return stage

    def off_deg(self, angle_deg: float) -> float:
        return abs((self.machine.true_angle_deg() - angle_deg + 180.0) % 360.0 - 180.0)

    def assert_stands_at(self, move: Move, target_deg: float) -> None:
        assert self.off_deg(move.position.angle_deg) <= HALF_COUNT_DEG
        assert self.off_deg(target_deg) <= TOLERANCE_DEG + HALF_COUNT_DEG


@pytest.mark.parametrize(
    "faults",
    [
        "",
        "pulses=0x40000",
        "model=18&pulses=65536",
        "busy=1",
        "slow=20",
        "slow=20&busy=1",
        "late=0.3",
        "pieces=1",
        "pace=1",
        "pieces=1&pace=1&busy=1&late=0.2",
        "gap=0.09",
        "landing=0",
        "button=2",
        "mark=12.5",
    ],
)
def test_the_pickering_sequence_ends_at_the_right_angles(faults: str) -> None:
    bench = Bench(faults)
    stage = bench.homed()
    mark_deg = 12.5 if "mark" in faults else 0.0
    for target_deg in PICKERING_DEG:
        move = stage.move_to(target_deg)
        # The half count is the coarsest encoder's; angles are counted from the mark.
        assert bench.off_deg(move.position.angle_deg + mark_deg) <= HALF_COUNT_DEG
        assert bench.off_deg(target_deg + mark_deg) <= TOLERANCE_DEG + HALF_COUNT_DEG


def test_a_stall_is_a_fault_with_code_2() -> None:
    stage = Bench("stall=2").homed()
    stage.move_to(10.0)
    with pytest.raises(DeviceFaultError, match="stalled") as caught:
        stage.move_to(90.0)
    assert caught.value.code == 2


def test_after_a_stall_the_stage_moves_again() -> None:
    bench = Bench("stall=1")
    stage = bench.homed()
    with pytest.raises(DeviceFaultError):
        stage.move_to(90.0)
    bench.assert_stands_at(stage.move_to(90.0), 90.0)


def test_a_motor_slower_than_its_deadline_is_a_timeout_in_time() -> None:
    bench = Bench("slow=5")
    stage = bench.homed()
    start_s = bench.clock.now_s()
    with pytest.raises(DeviceTimeoutError, match="busy"):
        stage.move_to(90.0)
    # 2 s and 1 s for each 10 degrees; then at most 0.2 s of gap and of listening, and one poll.
    assert bench.clock.now_s() - start_s < 2.0 + 9.0 + 0.5


def test_after_a_motor_was_too_slow_its_late_answer_is_nobodys() -> None:
    bench = Bench("slow=5")
    stage = bench.homed()
    with pytest.raises(DeviceTimeoutError):
        stage.move_to(90.0)
    position = stage.position()
    assert bench.off_deg(position.angle_deg) <= HALF_COUNT_DEG
    assert abs(position.angle_deg - 90.0) <= TOLERANCE_DEG


@pytest.mark.parametrize("late_s", [0.9, 1.1, 1.5, 2.5])
def test_answers_later_than_their_deadline_never_give_a_wrong_angle(late_s: float) -> None:
    bench = Bench(f"late={late_s}")
    try:
        stage = bench.homed()
        for target_deg in PICKERING_DEG:
            bench.assert_stands_at(stage.move_to(target_deg), target_deg)
            assert bench.off_deg(stage.position().angle_deg) <= HALF_COUNT_DEG
    except (DeviceTimeoutError, ProtocolError):
        assert late_s > 1.0  # what comes within its deadline of a second is no error


def test_a_landing_error_is_tried_again_and_told() -> None:
    bench = Bench("landing=0.03")
    stage = bench.homed()
    moves = [stage.move_to(target_deg) for target_deg in (0.0, 90.0, 45.0)]
    assert max(move.tries for move in moves) > 1
    bench.assert_stands_at(moves[-1], 45.0)


def test_a_stage_that_lands_nowhere_near_is_refused() -> None:
    stage = Bench("landing=5").homed()
    with pytest.raises(LimitError, match=r"45 deg 3 times"):
        stage.move_to(45.0)


def test_a_pressed_button_is_told_and_the_stage_brought_back() -> None:
    bench = Bench("button=1")
    move = bench.homed().move_to(45.0)
    assert move.tries == 2
    assert "a button of the handset was pressed" in move.remarks
    bench.assert_stands_at(move, 45.0)


def test_a_stage_that_falls_silent_is_a_timeout_within_its_deadline() -> None:
    bench = Bench("silent=7")
    stage = bench.homed()  # six commands: status, identity twice, homing, position twice
    start_s = bench.clock.now_s()
    with pytest.raises(DeviceTimeoutError, match="no answer"):
        stage.position()
    assert bench.clock.now_s() - start_s < 1.0 + 3 * (1.0 + 0.05) + 0.5


def test_a_silent_move_is_a_timeout_within_its_deadline() -> None:
    bench = Bench("silent=7")
    stage = bench.homed()
    start_s = bench.clock.now_s()
    with pytest.raises(DeviceTimeoutError, match="no answer"):
        stage.move_to(90.0)
    assert bench.clock.now_s() - start_s < 2.0 + 9.0 + 3 * (1.0 + 0.05) + 0.5


@pytest.mark.parametrize("damage", ["drop", "double", "flip"])
@pytest.mark.parametrize("seed", range(8))
def test_a_bad_line_ends_in_the_right_angle_or_in_a_typed_error(damage: str, seed: int) -> None:
    bench = Bench(f"{damage}=0.02&seed={seed}")
    try:
        stage = bench.homed()
    except DeviceError:
        return
    for target_deg in PICKERING_DEG * 3:
        try:
            stage.move_to(target_deg)
        except DeviceError:
            continue
        # Of the readback only this much is sure: one bit of it may be wrong, as long as it is near the target.
        assert bench.off_deg(target_deg) <= TOLERANCE_DEG + HALF_COUNT_DEG


@pytest.mark.parametrize("damage", ["drop", "double", "flip"])
def test_a_line_that_loses_one_byte_in_five_hundred_is_worked_with(damage: str) -> None:
    bench = Bench(f"{damage}=0.002&seed=5")
    stage = bench.homed()
    for target_deg in PICKERING_DEG * 10:
        stage.move_to(target_deg)
        assert bench.off_deg(target_deg) <= TOLERANCE_DEG + HALF_COUNT_DEG


def test_an_interrupted_move_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench("slow=20")
    stage = bench.homed()

    def interrupt(*args: object, **kwargs: object) -> bytes:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(InProcessPort, "read_some", interrupt)
        with pytest.raises(KeyboardInterrupt):
            stage.move_to(90.0)
    bench.assert_stands_at(stage.move_to(45.0), 45.0)


def test_going_to_just_below_a_turn_and_reading_just_above_is_near() -> None:
    bench = Bench("landing=0")
    stage = bench.homed()
    move = stage.move_to(359.999)  # nearest count: 0
    assert (move.position.counts, move.tries) == (0, 1)


@pytest.mark.parametrize("tolerance_deg", [0.0, 0.001, 180.0, float("nan")])
def test_a_tolerance_that_means_nothing_is_refused(tolerance_deg: float) -> None:
    bench = Bench("")
    port = InProcessPort(bench.machine, clock=bench.clock)
    with pytest.raises(LimitError, match="half an encoder count"):
        connect_elliptec(port, tolerance_deg=tolerance_deg, now_s=bench.clock.now_s, sleep=bench.clock.sleep)


def test_identifies_the_stage() -> None:
    identity = Bench("model=18&serial=1234").connect().identify()
    assert (identity.model, identity.serial_number, identity.firmware) == ("ELL18", "00001234", "18")


def test_a_port_that_vanishes_and_comes_back() -> None:
    clock = SimClock(speed=50.0)
    machine = make_stage(parse_stage_address("sim:ellx"), clock=clock)
    with serve_on_pty(machine, clock=clock) as path:
        stage = open_elliptec(path, sleep=clock.sleep)
        stage.home()
    with pytest.raises(NotConnectedError, match="gone away"):
        stage.move_to(45.0)
    stage.close()
    with serve_on_pty(machine, clock=clock) as path, open_elliptec(path, sleep=clock.sleep) as again:
        again.home()
        assert again.move_to(45.0).position.angle_deg == pytest.approx(45.0, abs=TOLERANCE_DEG)


def test_a_port_is_released_when_nothing_answers() -> None:
    clock = SimClock(speed=50.0)
    machine = make_stage(parse_stage_address("sim:ellx?model=17"), clock=clock)
    with serve_on_pty(machine, clock=clock) as path:
        with pytest.raises(ProtocolError, match="ELL17") as first:
            open_elliptec(path, sleep=clock.sleep)
        # `first` keeps the port's object alive, so that only closing it can have released it
        with pytest.raises(ProtocolError, match="ELL17"):
            open_elliptec(path, sleep=clock.sleep)
    assert first.value.__traceback__ is not None
