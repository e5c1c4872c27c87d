import pytest

from sim_devices.clock import ManualClock, SimClock


class Wall:
    """A wall clock that stands still until somebody sleeps."""

    def __init__(self) -> None:
        self.time_s = 1000.0

    def now_s(self) -> float:
        return self.time_s

    def sleep(self, duration_s: float) -> None:
        self.time_s += duration_s


@pytest.fixture
def wall() -> Wall:
    return Wall()


def test_simulated_time_runs_as_many_times_faster(wall: Wall) -> None:
    clock = SimClock(speed=8.0, wall_s=wall.now_s, wall_sleep=wall.sleep)
    assert clock.now_s() == 0.0
    wall.time_s += 0.5
    assert clock.now_s() == 4.0


def test_sleeping_takes_as_much_less_of_the_wall_clock(wall: Wall) -> None:
    clock = SimClock(speed=8.0, wall_s=wall.now_s, wall_sleep=wall.sleep)
    clock.sleep(4.0)
    assert wall.time_s == 1000.5


def test_waiting_for_what_has_gone_by_takes_no_time(wall: Wall) -> None:
    clock = SimClock(speed=8.0, wall_s=wall.now_s, wall_sleep=wall.sleep)
    wall.time_s += 1.0
    clock.wait_until(7.0)
    assert wall.time_s == 1001.0
    assert clock.wall_s_until(7.0) == 0.0
    assert clock.wall_s_until(16.0) == 1.0


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), float("inf")])
def test_a_speed_must_be_a_number_above_0(speed: float) -> None:
    with pytest.raises(ValueError, match="above 0"):
        SimClock(speed=speed)


def test_a_manual_clock_moves_when_told() -> None:
    clock = ManualClock()
    clock.advance(1.5)
    clock.sleep(0.5)
    clock.wait_until(3.0)
    assert clock.now_s() == 3.0


def test_a_manual_clock_does_not_go_back() -> None:
    clock = ManualClock()
    clock.advance(2.0)
    clock.wait_until(1.0)
    clock.sleep(-1.0)
    assert clock.now_s() == 2.0
    with pytest.raises(ValueError, match="cannot go back"):
        clock.advance(-1.0)
