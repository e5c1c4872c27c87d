import threading

import pytest

from sim_devices.clock import ManualClock
from sim_devices.stages.catalogue import make_stage
from sim_devices.stages.ellx import parse_address
from sim_devices.stages.stage import SimulatedStage


def stage(faults: str = "landing=0") -> tuple[SimulatedStage, ManualClock]:
    clock = ManualClock()
    return make_stage(parse_address(f"sim:ellx?start=0&slow=90&{faults}"), clock=clock), clock


def test_the_true_angle_follows_the_time() -> None:
    machine, clock = stage()
    machine.receive(b"0ma00004600")
    clock.advance(0.25)
    assert machine.true_angle_deg() == pytest.approx(22.5, rel=1e-15)
    clock.advance(1.0)
    assert machine.true_angle_deg() == 45.0


def test_the_true_angle_lies_in_one_turn() -> None:
    machine, clock = stage()
    machine.receive(b"0mrFFFFFFFF")
    clock.advance(1.0)
    assert machine.true_angle_deg() == pytest.approx(360.0 - 360.0 / 143360, rel=1e-15)


def test_looking_at_the_angle_takes_no_reply_away() -> None:
    machine, clock = stage()
    machine.receive(b"0ma00004600")
    clock.advance(1.0)
    machine.true_angle_deg()
    assert machine.transmit() == b"0PO00004600\r\n"


def test_tells_when_there_will_be_something_new() -> None:
    machine, clock = stage()
    assert machine.next_event_s() is None
    machine.receive(b"0ma00004600")
    assert machine.next_event_s() == 0.5
    clock.advance(0.5)
    assert machine.transmit() == b"0PO00004600\r\n"
    assert machine.next_event_s() is None


def test_commands_are_damaged_on_their_way_too() -> None:
    machine, _ = stage("drop=1")
    machine.receive(b"0ma00004600")
    assert machine.next_event_s() is None


def test_the_same_seed_lands_alike_and_another_does_not() -> None:
    def lands(seed: int) -> float:
        machine, clock = stage(f"landing=0.1&seed={seed}")
        machine.receive(b"0ma00004600")
        clock.advance(5.0)
        return machine.true_angle_deg()

    assert lands(1) == lands(1)
    assert lands(1) != lands(2)


def test_several_threads_may_look_while_one_talks() -> None:
    machine, clock = stage()
    errors: list[Exception] = []

    def look() -> None:
        try:
            for _ in range(500):
                assert 0.0 <= machine.true_angle_deg() < 360.0
        except Exception as error:
            errors.append(error)

    threads = [threading.Thread(target=look) for _ in range(3)]
    for thread in threads:
        thread.start()
    replies = b""
    for number in range(100):
        machine.receive(b"0ma%08X" % (number * 10))
        clock.advance(1.0)
        replies += machine.transmit()
    for thread in threads:
        thread.join()
    assert errors == []
    assert replies.count(b"PO") == 100
