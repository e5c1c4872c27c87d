"""Every fault of the simulated stages, cameras and disks, at every operation: how do drivers and sessions react?

A cell is right if its operation ends in the right angle, or in an error of the right type, within its deadline. Time of
stages is simulated. `tests/contracts/test_fault_matrix.py` tries the cells of stages with fewer seeds.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from benchmarks.trials.camera_faults import CALLS, Cell, camera_rows
from benchmarks.trials.disk_faults import disk_rows
from benchmarks.trials.lossy_network import why_no_camera
from drivers.errors import (
    DeviceError,
    DeviceFaultError,
    DeviceTimeoutError,
    LimitError,
    NotConnectedError,
    ProtocolError,
)
from drivers.interfaces import RotationStage
from tests.drivers.stages.lines import FAMILIES, Bench

TOLERANCE_DEG = 0.02
_HALF_COUNT_DEG = 0.0028  # of the coarsest encoder, 65536 counts
_TARGET_DEG = 90.0
_SEEDS = 20

Errors = tuple[type[DeviceError], ...]
_DAMAGE: Errors = (ProtocolError, DeviceTimeoutError, DeviceFaultError, LimitError)
_LATE: Errors = (ProtocolError, DeviceTimeoutError)


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault of stages."""

    name: str
    keys: dict[
        str, str
    ]  #: family to the keys of its address, if it can have the fault; {n}: first command of an operation
    errors: dict[str, Errors] = field(default_factory=dict)  #: operation to the right errors; all others must succeed
    or_succeeds: bool = False  #: an operation with errors may also succeed
    is_random: bool = False  #: tried with many seeds


OPERATIONS = ("open", "home", "move", "position", "status", "stop")


def _everywhere(errors: Errors) -> dict[str, Errors]:
    return dict.fromkeys(OPERATIONS, errors)


def _all(keys: str) -> dict[str, str]:
    return dict.fromkeys(FAMILIES, keys)


FAULTS = (
    Fault(name="none", keys=_all("")),
    Fault(
        name="other counts of a turn", keys={"ellx": "pulses=0x40000", "zaber": "resolution=128", "apt": "model=KDC101"}
    ),
    Fault(name="replies in pieces of two bytes", keys=_all("pieces=1")),
    Fault(name="bytes as slow as the line", keys=_all("pace=1")),
    Fault(name="busy for no reason", keys=_all("busy=1")),
    Fault(name="every third reply 0.3 s late", keys=_all("late=0.3")),
    Fault(name="every third reply 2 s late", keys=_all("late=2"), errors=_everywhere(_LATE), or_succeeds=True),
    Fault(name="a move too soon goes to 0", keys={"ellx": "gap=0.09"}),
    Fault(name="status told unasked", keys={"apt": "updates=1"}),
    Fault(name="parameters forgotten at power-off", keys={"apt": "forgets=1"}),
    Fault(name="homes without saying so", keys={"apt": "quiethome=1"}),
    Fault(
        name="homing never confirmed", keys=_all("unhomed=1"), errors={"home": (DeviceTimeoutError, DeviceFaultError)}
    ),
    Fault(name="lands one count low (position -1)", keys=_all("minus=1&landing=0")),
    Fault(
        name="landing error 0.03 deg",
        keys=_all("landing=0.03"),
        errors={"move": (LimitError,)},
        or_succeeds=True,
        is_random=True,
    ),
    Fault(name="landing error 5 deg", keys=_all("landing=5&seed=3"), errors={"move": (LimitError,)}),
    Fault(name="backlash 0.01 deg", keys=_all("backlash=0.01")),
    Fault(
        name="creeps 0.1 deg after a motion",
        keys=_all("creep=0.1"),
        errors={"move": (LimitError,), "position": (ProtocolError,)},
        or_succeeds=True,
    ),
    Fault(
        name="motor ten times too slow",
        keys={"ellx": "slow=5", "zaber": "slow=10", "apt": "slow=1"},
        errors={"move": (DeviceTimeoutError,), "home": (DeviceTimeoutError,)},
        or_succeeds=True,
    ),
    Fault(name="stall in the move", keys=_all("stall=1"), errors={"move": (DeviceFaultError,)}),
    Fault(
        name="device fault in the move",
        keys={"ellx": "fault=8@1", "zaber": "fault=FQ@1", "apt": "fault=0x1000000@1"},
        errors={"move": (DeviceFaultError,)},
    ),
    Fault(name="turned by hand during the move", keys=_all("button=1")),
    Fault(name="silent from here on", keys=_all("silent={n}"), errors=_everywhere((DeviceTimeoutError,))),
    Fault(name="port vanishes here", keys=_all("vanish={n}&back=1"), errors=_everywhere((NotConnectedError,))),
    Fault(
        name="1 % of bytes lost", keys=_all("drop=0.01"), errors=_everywhere(_DAMAGE), or_succeeds=True, is_random=True
    ),
    Fault(
        name="1 % of bytes doubled",
        keys=_all("double=0.01"),
        errors=_everywhere(_DAMAGE),
        or_succeeds=True,
        is_random=True,
    ),
    Fault(
        name="1 % of bytes changed",
        keys=_all("flip=0.01"),
        errors=_everywhere(_DAMAGE),
        or_succeeds=True,
        is_random=True,
    ),
)

# How long each operation may take [s]: what the drivers' documentation says, all their tries together.
_DEADLINES_S = {
    "ellx": {"open": 60.0, "home": 130.0, "move": 60.0, "position": 20.0, "status": 10.0, "stop": 10.0},
    "zaber": {"open": 30.0, "home": 135.0, "move": 40.0, "position": 10.0, "status": 10.0, "stop": 10.0},
    "apt": {"open": 60.0, "home": 290.0, "move": 80.0, "position": 20.0, "status": 10.0, "stop": 10.0},
}


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a cell ended.

    Attributes
    ----------
    word : str
        "right", or the error's name with its code, or what went wrong.
    is_right : bool
        Whether it ended as it must, in time.
    duration_s : float
        Simulated time of the operation.
    """

    word: str
    is_right: bool
    duration_s: float


class _WrongAngleError(Exception):
    """What must never be."""


class _Bench(Bench):
    """A simulated stage, and its driver once it is opened."""

    def __init__(self, family: str, keys: str, *, seed: int) -> None:
        super().__init__(f"{family}?" + (keys if "seed=" in keys else f"{keys}&seed={seed}".lstrip("&")))
        self.stage: RotationStage | None = None

    def prepare(self, operation: str) -> None:
        """Do what must have been done before."""
        if operation != "open":
            self.open()
        if operation not in ("open", "home"):
            self.opened().home()

    def open(self) -> None:
        self.stage = self.connect(tolerance_deg=TOLERANCE_DEG)

    def opened(self) -> RotationStage:
        if self.stage is None:
            raise RuntimeError("not opened")
        return self.stage

    def run(self, operation: str) -> None:
        """Do it, and see whether what it says is so."""
        if operation == "open":
            self.open()
        elif operation == "home":
            self._require_true(self.opened().home().angle_deg)
        elif operation == "move":
            move = self.opened().move_to(_TARGET_DEG)
            self._require(_apart_deg(move.position.angle_deg, _TARGET_DEG) <= TOLERANCE_DEG)
            self._require_true(_TARGET_DEG, within_deg=TOLERANCE_DEG + _HALF_COUNT_DEG)
        elif operation == "position":
            self._require_true(self.opened().position().angle_deg)
        elif operation == "status":
            self._require(self.opened().status().meaning != "")
        else:
            self.opened().stop()

    def _require_true(self, angle_deg: float, *, within_deg: float = TOLERANCE_DEG) -> None:
        self._require(self.off_deg(angle_deg) <= within_deg)

    def _require(self, so: bool) -> None:
        if not so:
            raise _WrongAngleError


def run_cell(family: str, fault: Fault, operation: str, *, seed: int) -> Outcome | None:
    """Return how an operation ends with a fault; None where the fault hits before the operation is reached."""
    keys = fault.keys[family]
    if "{n}" in keys:
        rehearsal = _Bench(family, "", seed=seed)
        rehearsal.prepare(operation)
        keys = keys.format(n=rehearsal.machine.commands_heard() + 1)
    bench = _Bench(family, keys, seed=seed)
    try:
        bench.prepare(operation)
    except DeviceError as error:
        return None if operation != "open" and _is_expected_before(fault, error) else _wrong(error, 0.0)
    start_s = bench.clock.now_s()
    try:
        bench.run(operation)
    except DeviceError as error:
        duration_s = bench.clock.now_s() - start_s
        is_right = isinstance(error, fault.errors.get(operation, ())) and duration_s <= _DEADLINES_S[family][operation]
        return Outcome(word=_name(error), is_right=is_right, duration_s=duration_s)
    except Exception as error:
        return _wrong(error, bench.clock.now_s() - start_s)
    duration_s = bench.clock.now_s() - start_s
    may_succeed = operation not in fault.errors or fault.or_succeeds
    is_right = may_succeed and duration_s <= _DEADLINES_S[family][operation]
    return Outcome(word="right", is_right=is_right, duration_s=duration_s)


def _is_expected_before(fault: Fault, error: DeviceError) -> bool:
    return any(isinstance(error, errors) for errors in fault.errors.values())


def _wrong(error: Exception, duration_s: float) -> Outcome:
    return Outcome(word=f"WRONG: {type(error).__name__}", is_right=False, duration_s=duration_s)


def _name(error: DeviceError) -> str:
    name = type(error).__name__.removesuffix("Error")
    if not isinstance(error, DeviceFaultError):
        return name
    return f"{name} {error.code:#x}" if isinstance(error.code, int) else f"{name} {error.code}"


def _apart_deg(a_deg: float, b_deg: float) -> float:
    return abs((a_deg - b_deg + 180.0) % 360.0 - 180.0)


def _cell_text(family: str, fault: Fault, operation: str) -> tuple[str, bool]:
    seeds = range(_SEEDS if fault.is_random else 1)
    outcomes = [run_cell(family, fault, operation, seed=seed) for seed in seeds]
    reached = [outcome for outcome in outcomes if outcome is not None]
    if not reached:
        return "not reached", True
    words = Counter(outcome.word for outcome in reached)
    counted = ", ".join(f"{word} {number}" if fault.is_random else word for word, number in words.most_common())
    longest_s = max(outcome.duration_s for outcome in reached)
    return f"{counted}; {longest_s:.1f} s", all(outcome.is_right for outcome in reached)


_TITLES = {"ellx": "Elliptec ELLx", "zaber": "Zaber ASCII", "apt": "Thorlabs APT"}


def run_faults() -> bool:
    """Print the matrix; return whether no cell is wrong.

    A cell says how the operation ended and how long that took at most. "right": the true angle of the simulated ring is
    where the driver says, or the picture is bit for bit what was sent. Faults that are random are tried with 20 seeds,
    and the numbers count how often each end came. "not reached": the fault struck before, where it is counted. Cells in
    **bold** are wrong.
    """
    right = True
    for family in FAMILIES:
        rows = (
            (fault.name, [_cell_text(family, fault, operation) for operation in OPERATIONS])
            for fault in FAULTS
            if family in fault.keys
        )
        right &= _printed(_TITLES[family], OPERATIONS, rows)
    if (reason := why_no_camera()) is None:
        right &= _printed("GigE Vision cameras", CALLS, camera_rows())
    else:
        print(f"no cameras: {reason}")
    return _printed("A disk that freezes before a flush", ["end"], disk_rows()) and right


def _printed(title: str, columns: Iterable[str], rows: Iterable[tuple[str, list[Cell]]]) -> bool:
    columns = list(columns)
    print(f"\n## {title}\n\n| fault | {' | '.join(columns)} |\n| --- |{' --- |' * len(columns)}")
    wrong = 0
    for name, cells in rows:
        wrong += sum(not is_right for _, is_right in cells)
        print(f"| {name} | {' | '.join(text if is_right else f'**{text}**' for text, is_right in cells)} |", flush=True)
    print(f"\n{wrong} cells are wrong")
    return wrong == 0
