import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import serial

from sim_devices.clock import SimClock
from sim_devices.stages.catalogue import make_stage
from sim_devices.stages.ellx import parse_address
from sim_devices.stages.stage import serve_on_pty


class Broken:
    """A device that fails when it hears something."""

    def __init__(self) -> None:
        self.heard = threading.Event()

    def receive(self, data: bytes) -> None:
        self.heard.set()
        raise RuntimeError("broken inside")

    def transmit(self) -> bytes:
        return b""

    def next_event_s(self) -> float | None:
        return None

    def is_plugged_in(self) -> bool:
        return True


class Babbler:
    """A device that never stops talking."""

    def __init__(self, enough: Callable[[], None]) -> None:
        self._enough = enough
        self._sent = 0

    def receive(self, data: bytes) -> None:
        pass

    def transmit(self) -> bytes:
        self._sent += 1
        if self._sent == 300:
            self._enough()
        return b"x" * 1000

    def next_event_s(self) -> float | None:
        return 0.0

    def is_plugged_in(self) -> bool:
        return True


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def ask(path: str, command: bytes, *, length: int) -> bytes:
    with serial.Serial(path, 9600, timeout=10.0) as port:
        port.write(command)
        return port.read(length)


def test_any_program_can_talk_to_the_stage() -> None:
    clock = SimClock(speed=50.0)
    machine = make_stage(parse_address("sim:ellx"), clock=clock)
    with serve_on_pty(machine, clock=clock) as path:
        assert ask(path, b"0in", length=35) == b"0IN0E1140132620251801016800023000\r\n"
        assert ask(path, b"0gs\r\n", length=7) == b"0GS00\r\n"  # a second program after the first has left


def test_an_answer_that_takes_time_comes_by_itself() -> None:
    clock = SimClock(speed=50.0)
    machine = make_stage(parse_address("sim:ellx?landing=0"), clock=clock)
    with serve_on_pty(machine, clock=clock) as path:
        assert ask(path, b"0ho0", length=13) == b"0PO00000000\r\n"


def test_leaving_ends_the_thread_and_the_terminal() -> None:
    clock = SimClock()
    threads = threading.active_count()
    machine = make_stage(parse_address("sim:ellx"), clock=clock)
    files = open_files()
    with serve_on_pty(machine, clock=clock):
        assert threading.active_count() == threads + 1
    assert threading.active_count() == threads
    assert open_files() == files


def test_a_fault_within_the_device_is_raised_on_leaving() -> None:
    device = Broken()
    server = serve_on_pty(device, clock=SimClock())
    with serial.Serial(server.__enter__(), 9600) as port:
        port.write(b"x")
        assert device.heard.wait(10.0)
    with pytest.raises(RuntimeError, match="broken inside"):
        server.__exit__(None, None, None)


def test_a_host_that_never_reads_does_not_hold_up_the_end() -> None:
    enough = threading.Event()
    with serve_on_pty(Babbler(enough.set), clock=SimClock()):
        assert enough.wait(10.0)


def test_a_link_leads_to_the_terminal_for_as_long_as_it_is_served(tmp_path: Path) -> None:
    clock = SimClock(speed=50.0)
    link = tmp_path / "stage"
    with serve_on_pty(make_stage(parse_address("sim:ellx"), clock=clock), clock=clock, link=link) as path:
        assert path == str(link)
        assert ask(path, b"0gs", length=7) == b"0GS00\r\n"
    assert not link.is_symlink()


def test_what_stands_at_the_place_of_the_link_is_left_alone(tmp_path: Path) -> None:
    link = tmp_path / "stage"
    link.write_text("mine")
    files = open_files()
    machine = make_stage(parse_address("sim:ellx"), clock=SimClock())
    with pytest.raises(FileExistsError), serve_on_pty(machine, clock=SimClock(), link=link):
        pass
    assert link.read_text() == "mine"
    assert open_files() == files


def test_a_port_that_vanishes_comes_back_as_another_behind_the_same_link() -> None:
    clock = SimClock(speed=50.0)
    machine = make_stage(parse_address("sim:ellx?vanish=1&back=5"), clock=clock)  # 0.1 s of the wall clock
    with serve_on_pty(machine, clock=clock) as path:
        with serial.Serial(path, 9600, timeout=10.0) as port:
            port.write(b"0gs")
            with pytest.raises(serial.SerialException):
                port.read(7)
        wait_for(Path(path).exists)
        assert ask(path, b"0gs", length=7) == b"0GS00\r\n"


def wait_for(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
