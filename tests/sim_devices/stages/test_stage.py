"""The whole simulated stage: its line, its port within the process, and its pseudo-terminal."""

import re
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import serial

from drivers.errors import NotConnectedError
from sim_devices.clock import ManualClock, SimClock
from sim_devices.stages.apt import MODELS, AptLanguage, AptOptions
from sim_devices.stages.catalogue import SCHEMES, make_stage, parse_stage_address
from sim_devices.stages.drive import Drive
from sim_devices.stages.ellx import DATA_DIGITS, EllxLanguage, EllxOptions
from sim_devices.stages.options import StageOptions
from sim_devices.stages.stage import InProcessPort, Line, SimulatedStage, damaged, serve_on_pty
from sim_devices.stages.zaber import ZaberLanguage, ZaberOptions

MOVE_45, AT_45 = b"0ma00004600", b"0PO00004600\r\n"  # half a second at 90 degrees a second


def stage(faults: str = "") -> tuple[SimulatedStage, ManualClock]:
    clock = ManualClock()
    return make_stage(parse_stage_address(f"sim:ellx?start=0&slow=90&landing=0&{faults}"), clock=clock), clock


def port_to(faults: str = "") -> tuple[InProcessPort, ManualClock]:
    machine, clock = stage(faults)
    return InProcessPort(machine, clock=clock), clock


def test_the_true_angle_follows_the_time_within_one_turn() -> None:
    machine, clock = stage()
    machine.receive(MOVE_45)
    clock.advance(0.25)
    assert machine.true_angle_deg() == pytest.approx(22.5, rel=1e-15)
    clock.advance(1.0)
    assert machine.true_angle_deg() == 45.0
    machine.receive(b"0ma00000000")
    clock.advance(1.0)
    machine.receive(b"0mrFFFFFFFF")
    clock.advance(1.0)
    assert machine.true_angle_deg() == pytest.approx(360.0 - 360.0 / 143360, rel=1e-15)


def test_tells_when_there_is_something_new_and_looking_takes_none_of_it_away() -> None:
    machine, clock = stage()
    assert machine.next_event_s() is None
    machine.receive(MOVE_45)
    assert machine.next_event_s() == 0.5
    clock.advance(0.5)
    machine.true_angle_deg()
    assert machine.transmit() == AT_45
    assert machine.next_event_s() is None


def test_commands_are_damaged_on_their_way_too() -> None:
    machine, _ = stage("drop=1")
    machine.receive(MOVE_45)
    assert machine.next_event_s() is None


def test_the_same_seed_lands_alike_and_another_does_not() -> None:
    def lands(seed: int) -> float:
        clock = ManualClock()
        machine = make_stage(parse_stage_address(f"sim:ellx?landing=0.1&seed={seed}"), clock=clock)
        machine.receive(MOVE_45)
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


def test_a_vanished_port_comes_back() -> None:
    machine, clock = stage("vanish=1&back=2")
    assert machine.is_plugged_in()
    machine.receive(b"0gs")
    assert not machine.is_plugged_in()
    clock.advance(2.0)
    assert machine.is_plugged_in()


def line(**faults: float) -> Line:
    return Line(EllxOptions(**faults), baud=9600, generator=np.random.default_rng(0))  # type: ignore[arg-type]


def test_a_reply_arrives_when_it_is_sent_and_once() -> None:
    plain = line()
    plain.send(1.0, b"0GS00\r\n")
    assert plain.next_arrival_s() == 1.0
    assert plain.arrived(0.9) == b""
    assert plain.arrived(1.0) == b"0GS00\r\n"
    assert plain.next_arrival_s() is None


def test_paced_bytes_take_ten_bits_each() -> None:
    paced = line(pace=True)
    paced.send(0.0, AT_45)
    # 1e-9 s is far below a byte's 1.04 ms and far above the rounding of the sum.
    assert paced.arrived(5 * 10 / 9600 + 1e-9) == b"0PO00"
    assert paced.arrived(13 * 10 / 9600 + 1e-9) == b"004600\r\n"


def test_pieces_arrive_one_after_the_other() -> None:
    pieces = line(pieces=True)
    pieces.send(0.0, b"0GS00\r\n")
    got = []
    while (time_s := pieces.next_arrival_s()) is not None:
        got.append(pieces.arrived(time_s))
    assert got == [b"0G", b"S0", b"0\r", b"\n"]


def test_every_third_reply_is_late_and_what_follows_waits() -> None:
    slow = line(late_s=2.0)
    for number in range(4):
        slow.send(float(number) / 10, b"%d" % number)
    assert slow.arrived(2.1) == b"01"
    assert slow.arrived(2.2) == b"23"


@pytest.mark.parametrize("pace", [False, True])
def test_a_reply_of_which_all_is_lost_never_arrives(pace: bool) -> None:
    dead = line(pace=pace, drop=1.0)
    dead.send(0.0, b"0GS00\r\n")
    assert dead.next_arrival_s() is None


@pytest.mark.parametrize(("kind", "arrives"), [("drop", b""), ("double", b"00GGSS"), ("", b"0GS")])
def test_damage_is_of_its_kind(kind: str, arrives: bytes) -> None:
    options = EllxOptions(**({kind: 1.0} if kind else {}))  # type: ignore[arg-type]
    assert damaged(b"0GS", options, np.random.default_rng(1)) == arrives


def test_a_changed_byte_differs_in_one_bit() -> None:
    changed = damaged(bytes(1000), EllxOptions(flip=1.0), np.random.default_rng(1))
    assert {byte.bit_count() for byte in changed} == {1}


def test_waiting_moves_the_clock_to_the_answer_or_to_the_deadline() -> None:
    port, clock = port_to()
    assert port.read_some(timeout_s=3.0) == b""
    assert clock.now_s() == 3.0
    port.write(MOVE_45)
    assert port.read_some(timeout_s=0.25) == b""
    assert port.read_some(timeout_s=10.0) == AT_45
    assert clock.now_s() == 3.5


def test_an_answer_that_is_lost_ends_the_wait_at_its_deadline() -> None:
    port, clock = port_to("silent=1")
    port.write(MOVE_45)
    assert port.read_some(timeout_s=2.0) == b""
    assert clock.now_s() == 2.0


def test_a_closed_port_says_so() -> None:
    port, _ = port_to()
    port.close()
    port.close()
    with pytest.raises(NotConnectedError, match="closed"):
        port.write(b"0gs")


class Device:
    """A device that fails when it hears something, or that never stops talking."""

    def __init__(self, *, enough: int | None = None) -> None:
        self.reached = threading.Event()
        self._enough, self._sent = enough, 0

    def receive(self, data: bytes) -> None:
        self.reached.set()
        raise RuntimeError("broken inside")

    def transmit(self) -> bytes:
        self._sent += 1
        if self._sent == self._enough:
            self.reached.set()
        return b"" if self._enough is None else b"x" * 1000

    def next_event_s(self) -> float | None:
        return None if self._enough is None else 0.0

    def is_plugged_in(self) -> bool:
        return True


def served(faults: str = "") -> tuple[SimulatedStage, SimClock]:
    clock = SimClock(speed=50.0)
    return make_stage(parse_stage_address(f"sim:ellx?landing=0&{faults}"), clock=clock), clock


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def ask(path: str, command: bytes, *, length: int) -> bytes:
    with serial.Serial(path, 9600, timeout=60.0) as port:
        port.write(command)
        return port.read(length)


def test_any_program_can_talk_to_the_stage_one_after_the_other() -> None:
    machine, clock = served()
    with serve_on_pty(machine, clock=clock) as path:
        assert ask(path, b"0in", length=35) == b"0IN0E1140132620251801016800023000\r\n"
        assert ask(path, b"0ho0", length=13) == b"0PO00000000\r\n"


def test_the_link_the_thread_and_the_terminal_are_there_while_it_is_served(tmp_path: Path) -> None:
    machine, clock = served()
    threads, files, link = threading.active_count(), open_files(), tmp_path / "stage"
    with serve_on_pty(machine, clock=clock, link=link) as path:
        assert path == str(link)
        assert threading.active_count() == threads + 1
        assert ask(path, b"0gs", length=7) == b"0GS00\r\n"
    assert not link.is_symlink()
    assert (threading.active_count(), open_files()) == (threads, files)


def test_what_stands_at_the_place_of_the_link_is_left_alone(tmp_path: Path) -> None:
    machine, clock = served()
    link = tmp_path / "stage"
    link.write_text("mine")
    files = open_files()
    with pytest.raises(FileExistsError), serve_on_pty(machine, clock=clock, link=link):
        pass
    assert link.read_text() == "mine"
    assert open_files() == files


def test_a_fault_within_the_device_is_raised_on_leaving() -> None:
    device = Device()
    server = serve_on_pty(device, clock=SimClock())
    with serial.Serial(server.__enter__(), 9600) as port:
        port.write(b"x")
        assert device.reached.wait(60.0)
    with pytest.raises(RuntimeError, match="broken inside"):
        server.__exit__(None, None, None)


def test_a_host_that_never_reads_does_not_hold_up_the_end() -> None:
    device = Device(enough=300)
    with serve_on_pty(device, clock=SimClock()):
        assert device.reached.wait(60.0)


def test_a_port_that_vanishes_comes_back_as_another_behind_the_same_link() -> None:
    machine, clock = served("vanish=1&back=5")  # 0.1 s of the wall clock
    with serve_on_pty(machine, clock=clock) as path:
        with serial.Serial(path, 9600, timeout=60.0) as port:
            port.write(b"0gs")
            with pytest.raises(serial.SerialException):
                port.read(7)
        wait_for(Path(path).exists)
        assert ask(path, b"0gs", length=7) == b"0GS00\r\n"


def wait_for(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_every_family_is_made_from_its_address(scheme: str) -> None:
    address = f"{scheme}?start=12.5&seed=3&stall=3&busy=1&drop=0.01&vanish=2&back=0.5&unhomed=1&minus=1&pace=1"
    machine = make_stage(parse_stage_address(address), clock=ManualClock())
    assert machine.true_angle_deg() == 12.5
    assert machine.commands_heard() == 0


def test_every_key_is_read() -> None:
    text = (
        "sim:ellx?model=18&serial=42&pulses=0x40000&slow=20&landing=0.01&mark=1.5&start=-3&busy=1&gap=0.1&stall=3"
        "&button=2&silent=9&late=0.3&drop=0.01&double=0.02&flip=0.03&pieces=1&pace=0&seed=7&speed=50&fault=8@3"
        "&unhomed=1&minus=1&backlash=0.05&creep=0.2&vanish=4&back=1.5"
    )
    assert parse_stage_address(text) == EllxOptions(
        model=18,
        serial_number=42,
        pulses=262144,
        gap_s=0.1,
        seed=7,
        speed=50.0,
        motor_deg_per_s=20.0,
        landing_deg=0.01,
        mark_deg=1.5,
        start_deg=-3.0,
        backlash_deg=0.05,
        creep_deg=0.2,
        busy=True,
        stall=3,
        button=2,
        fault=(8, 3),
        unhomed=True,
        minus_one=True,
        drop=0.01,
        double=0.02,
        flip=0.03,
        late_s=0.3,
        pieces=True,
        silent=9,
        vanish=4,
        back_s=1.5,
    )


@pytest.mark.parametrize(
    ("address", "problem"),
    [
        ("sim:smc100", "allowed are sim:ellx, sim:zaber, sim:apt"),
        ("/dev/ttyUSB0", "allowed are sim:ellx"),
        ("sim:zaber?fault=XX@1", "a warning flag that begins with F"),
        ("sim:apt?model=BSC201", "one of K10CR1, K10CR2, KDC101"),
        ("sim:apt?fault=0@1", "status bits"),
        ("sim:ellx?busy", "busy=: must be one of 0, 1"),
        ("sim:ellx?busy=2", "busy=2"),
        ("sim:ellx?drop=1.5", "drop=1.5: must be a number from 0 to 1"),
        ("sim:ellx?late=nan", "late=nan"),
        ("sim:ellx?stall=0", "stall=0"),
        ("sim:ellx?stall=2.5", "stall=2.5"),
        ("sim:ellx?fault=8", "fault=8: must be CODE@MOVE"),
        ("sim:ellx?fault=8@0", "fault=8@0"),
        ("sim:ellx?seed=1&seed=2", "'seed' stands twice"),
        # All problems at once, and all that is allowed.
        (
            "sim:ellx?stal=3&busy=7",
            "(?s)'stal' is no key.*busy=7.*stall= number of the move that stalls: a whole number",
        ),
    ],
)
def test_a_wrong_address_is_refused_with_the_reason(address: str, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        parse_stage_address(address)


PAGE = Path(__file__).parents[3] / "docs" / "simulated-stages.md"


def named(section: str) -> set[str]:
    """What the first column of a section's table names."""
    text = PAGE.read_text(encoding="utf-8").split(f"## {section}\n")[1].split("\n## ")[0]
    cells = (line.split("|")[1] for line in text.splitlines() if line.startswith("| `"))
    return {name for cell in cells for name in re.findall(r"`(\w+)`", cell)}


def drive(options: StageOptions) -> Drive:
    return Drive(options, generator=np.random.default_rng(0))


def test_elliptec() -> None:
    understood = EllxLanguage(EllxOptions(), drive(EllxOptions())).understood
    assert named("Elliptec") == understood
    assert understood == DATA_DIGITS.keys()  # or the receiver would not know where a command ends


def test_apt() -> None:
    options = [AptOptions(model=model) for model in MODELS]
    understood = set[int]().union(*(AptLanguage(one, drive(one)).understood for one in options))
    assert {int(number, 16) for number in named("Thorlabs APT")} == understood


def test_zaber() -> None:
    assert named("Zaber") == ZaberLanguage(ZaberOptions(), drive(ZaberOptions())).understood
