"""The stages that the contract suite is run on, each made ready by a function of no arguments."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import entry_points
from typing import Any

from drivers.interfaces import RotationStage
from sim_devices.clock import SimClock
from sim_devices.stages.catalogue import make_stage, parse_stage_address
from sim_devices.stages.stage import serve_on_pty
from tests.drivers.stages.lines import OPEN, Bench

TOLERANCE_DEG = 0.02


@dataclass(frozen=True, kw_only=True)
class StageUnderTest:
    """A stage that is open; a simulated one is not homed yet.

    Attributes
    ----------
    stage : RotationStage
        The driver.
    tolerance_deg : float
        What the driver was told to hold.
    true_angle_deg : callable or None
        Where the ring truly stands [deg]; None when nobody can know, as for a stage of metal.
    """

    stage: RotationStage
    tolerance_deg: float
    true_angle_deg: Callable[[], float] | None


Maker = Callable[[], AbstractContextManager[StageUnderTest]]


def family(address: str) -> str:
    """The driver's name in a simulated stage's address."""
    return address.partition("?")[0].removeprefix("sim:")


@contextmanager
def in_process(address: str) -> Iterator[StageUnderTest]:
    bench = Bench(address.removeprefix("sim:"))
    with bench.connect(tolerance_deg=TOLERANCE_DEG) as stage:
        yield StageUnderTest(stage=stage, tolerance_deg=TOLERANCE_DEG, true_angle_deg=bench.machine.true_angle_deg)


@contextmanager
def on_pty(address: str) -> Iterator[StageUnderTest]:
    clock = SimClock(speed=200.0)
    machine = make_stage(parse_stage_address(address), clock=clock)
    open_stage = OPEN[family(address)]
    with (
        serve_on_pty(machine, clock=clock) as path,
        open_stage(path, tolerance_deg=TOLERANCE_DEG, sleep=clock.sleep) as stage,
    ):
        yield StageUnderTest(stage=stage, tolerance_deg=TOLERANCE_DEG, true_angle_deg=machine.true_angle_deg)


@contextmanager
def of_metal(address: str) -> Iterator[StageUnderTest]:
    """A stage named on the command line: ``DRIVER:PORT``, for every driver that is installed, and ``?key=value``."""
    driver, _, rest = address.partition(":")
    port, _, options = rest.partition("?")
    given: dict[str, Any] = dict(pair.split("=", 1) for pair in options.split("&")) if options else {}
    tolerance_deg = float(given.pop("tolerance_deg", TOLERANCE_DEG))
    factory = {entry.name: entry for entry in entry_points(group="rigctl.stages")}[driver].load()
    with factory(port, tolerance_deg=tolerance_deg, **given) as stage:
        yield StageUnderTest(stage=stage, tolerance_deg=tolerance_deg, true_angle_deg=None)


def named(address: str) -> Maker:
    """What ``--stage ADDRESS`` asks for."""
    return partial(on_pty if address.startswith("sim:") else of_metal, address)


STAGES: dict[str, Maker] = {
    "ellx-in-process": partial(in_process, "sim:ellx"),
    "ellx-on-pty": partial(on_pty, "sim:ellx?pieces=1&busy=1"),
    "zaber-in-process": partial(in_process, "sim:zaber"),
    "zaber-without-encoder": partial(in_process, "sim:zaber?encoder=0&resolution=128"),
    "zaber-of-one-turn": partial(in_process, "sim:zaber?oneturn=1"),
    "zaber-on-pty": partial(on_pty, "sim:zaber?pieces=1&busy=1"),
    "k10cr1-in-process": partial(in_process, "sim:apt?forgets=1"),
    "k10cr2-in-process": partial(in_process, "sim:apt?model=K10CR2&minus=1&quiethome=1"),
    "kdc101-in-process": partial(in_process, "sim:apt?model=KDC101"),
    "apt-on-pty": partial(on_pty, "sim:apt?pieces=1&busy=1&updates=1"),
}
