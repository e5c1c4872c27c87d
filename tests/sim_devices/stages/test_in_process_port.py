import pytest

from drivers.errors import NotConnectedError
from sim_devices.clock import ManualClock
from sim_devices.stages.catalogue import make_stage
from sim_devices.stages.ellx import parse_address
from sim_devices.stages.stage import InProcessPort


def port_to(faults: str = "") -> tuple[InProcessPort, ManualClock]:
    clock = ManualClock()
    machine = make_stage(parse_address(f"sim:ellx?start=0&slow=90&landing=0&{faults}"), clock=clock)
    return InProcessPort(machine, clock=clock), clock


def test_waiting_moves_the_clock_to_the_answer() -> None:
    port, clock = port_to()
    port.write(b"0ma00004600")
    assert port.read_some(timeout_s=10.0) == b"0PO00004600\r\n"
    assert clock.now_s() == 0.5


def test_waiting_for_nothing_moves_the_clock_to_the_deadline() -> None:
    port, clock = port_to()
    assert port.read_some(timeout_s=3.0) == b""
    assert clock.now_s() == 3.0


def test_an_answer_after_the_deadline_is_left_for_later() -> None:
    port, clock = port_to()
    port.write(b"0ma00004600")
    assert port.read_some(timeout_s=0.25) == b""
    assert clock.now_s() == 0.25
    assert port.read_some(timeout_s=0.25) == b"0PO00004600\r\n"


def test_an_answer_that_is_lost_ends_the_wait_at_its_deadline() -> None:
    port, clock = port_to("silent=1")
    port.write(b"0ma00004600")
    assert port.read_some(timeout_s=2.0) == b""
    assert clock.now_s() == 2.0


def test_a_closed_port_says_so() -> None:
    port, _ = port_to()
    port.close()
    port.close()
    with pytest.raises(NotConnectedError, match="closed"):
        port.write(b"0gs")
