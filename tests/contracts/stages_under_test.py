"""The stages that the contract suite is run on, each made ready by a function of no arguments."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

from drivers.interfaces import RotationStage
from drivers.stages.elliptec import connect_elliptec, open_elliptec
from sim_devices.clock import ManualClock, SimClock
from sim_devices.stages.ellx import SimulatedEllx
from sim_devices.stages.ellx_address import parse_address
from sim_devices.stages.in_process_port import InProcessPort
from sim_devices.stages.pty_server import serve_on_pty


@dataclass(frozen=True, kw_only=True)
class StageUnderTest:
    """A stage that is open and not homed yet.

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


@contextmanager
def ellx_in_process() -> Iterator[StageUnderTest]:
    clock = ManualClock()
    machine = SimulatedEllx(parse_address("sim:ellx"), clock=clock)
    port = InProcessPort(machine, clock=clock)
    with connect_elliptec(port, tolerance_deg=0.02, now_s=clock.now_s, sleep=clock.sleep) as stage:
        yield StageUnderTest(stage=stage, tolerance_deg=0.02, true_angle_deg=machine.true_angle_deg)


@contextmanager
def ellx_on_pty() -> Iterator[StageUnderTest]:
    clock = SimClock(speed=50.0)
    machine = SimulatedEllx(parse_address("sim:ellx?pieces=1&busy=1"), clock=clock)
    with (
        serve_on_pty(machine, clock=clock) as path,
        open_elliptec(path, tolerance_deg=0.02, sleep=clock.sleep) as stage,
    ):
        yield StageUnderTest(stage=stage, tolerance_deg=0.02, true_angle_deg=machine.true_angle_deg)


STAGES: dict[str, Callable[[], AbstractContextManager[StageUnderTest]]] = {
    "ellx-in-process": ellx_in_process,
    "ellx-on-pty": ellx_on_pty,
}
