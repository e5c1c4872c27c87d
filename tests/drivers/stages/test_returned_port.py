"""A port that vanishes is an error of its own type; once it is back, it is opened again and all is as before."""

from collections.abc import Callable

import pytest

from drivers.errors import NotConnectedError
from drivers.interfaces import RotationStage
from drivers.stages.apt import connect_apt
from drivers.stages.elliptec import connect_elliptec
from drivers.stages.zaber import connect_zaber
from sim_devices.clock import ManualClock
from sim_devices.stages.catalogue import make_stage, parse_stage_address
from sim_devices.stages.stage import InProcessPort


def read_on(stage: RotationStage) -> None:
    for _ in range(60):
        stage.position()


@pytest.mark.parametrize(
    ("family", "connect"), [("ellx", connect_elliptec), ("zaber", connect_zaber), ("apt", connect_apt)]
)
def test_a_port_that_vanishes_and_comes_back(family: str, connect: Callable[..., RotationStage]) -> None:
    clock = ManualClock()
    machine = make_stage(parse_stage_address(f"sim:{family}?vanish=60&back=3&start=1"), clock=clock)

    def opened() -> RotationStage:
        return connect(InProcessPort(machine, clock=clock), now_s=clock.now_s, sleep=clock.sleep)

    stage = opened()
    stage.home()
    with pytest.raises(NotConnectedError, match="gone away"):
        read_on(stage)
    stage.close()
    with pytest.raises(NotConnectedError, match="gone away"):
        opened()
    clock.advance(3.0)
    again = opened()
    again.home()
    assert again.move_to(45.0).position.angle_deg == pytest.approx(45.0, abs=0.02)
