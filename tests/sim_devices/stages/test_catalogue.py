import pytest

from sim_devices.clock import ManualClock
from sim_devices.stages.catalogue import SCHEMES, make_stage, parse_stage_address


@pytest.mark.parametrize("scheme", SCHEMES)
def test_every_family_is_made_from_its_address(scheme: str) -> None:
    clock = ManualClock()
    machine = make_stage(parse_stage_address(f"{scheme}?start=12.5&seed=3"), clock=clock)
    assert machine.true_angle_deg() == 12.5
    assert machine.commands_heard() == 0


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize(
    "key", ["stall=3", "busy=1", "drop=0.01", "vanish=2&back=0.5", "unhomed=1", "minus=1", "pace=1"]
)
def test_every_family_takes_the_common_faults(scheme: str, key: str) -> None:
    parse_stage_address(f"{scheme}?{key}")


@pytest.mark.parametrize(
    ("address", "problem"),
    [
        ("sim:smc100", "there are sim:ellx, sim:zaber, sim:apt"),
        ("sim:zaber?fault=XX@1", "a warning flag that begins with F"),
        ("sim:apt?model=BSC201", "one of K10CR1, K10CR2, KDC101"),
        ("sim:apt?fault=0@1", "status bits"),
    ],
)
def test_what_there_is_not_is_refused(address: str, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        parse_stage_address(address)


def test_a_vanished_port_comes_back() -> None:
    clock = ManualClock()
    machine = make_stage(parse_stage_address("sim:zaber?vanish=1&back=2"), clock=clock)
    assert machine.is_plugged_in()
    machine.receive(b"/\n")
    assert not machine.is_plugged_in()
    clock.advance(2.0)
    assert machine.is_plugged_in()
