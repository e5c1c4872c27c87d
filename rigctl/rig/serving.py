"""Serves simulated devices to other programs: a stage on a pseudo-terminal, a camera on the network."""

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path
from typing import TextIO

from drivers.interfaces import Camera
from rigctl.errors import ConfigError
from rigctl.files.rig_file import load_rig
from rigctl.rig.simulated_parts import SERVED, THIS_MACHINE, split_faults
from sim_devices.cameras.gige_server import AravisDevice, GigeFaults, serve_behind_network, serve_gige_camera
from sim_devices.clock import SimClock
from sim_devices.stages.catalogue import make_stage, parse_stage_address
from sim_devices.stages.stage import SimulatedStage, serve_on_pty

_LOOK_S = 0.02
_LOOPBACK = "127."
_SMALLEST_CHANGE_DEG = 1e-6


class StageServer:
    """A served stage, whose true angle is logged."""

    def __init__(self, stage: SimulatedStage, clock: SimClock, log: TextIO | None) -> None:
        self._stage = stage
        self._clock = clock
        self._log = log
        self._logged_deg: float | None = None

    def run(self) -> None:
        """Log the true angle each time that it has changed; never return."""
        while True:
            self.look()
            time.sleep(_LOOK_S)

    def look(self) -> None:
        """Log the true angle if it has changed."""
        angle_deg = self._stage.true_angle_deg()
        unchanged = self._logged_deg is not None and abs(angle_deg - self._logged_deg) < _SMALLEST_CHANGE_DEG
        if self._log is None or unchanged:
            return
        self._log.write(f"{self._clock.now_s():.3f},{angle_deg:.6f}\n")
        self._log.flush()
        self._logged_deg = angle_deg


@contextmanager
def serve_stage(address: str, *, link: Path, truth: Path | None) -> Iterator[StageServer]:
    """Give a simulated stage that answers on a pseudo-terminal until the context is left."""
    try:
        options = parse_stage_address(address)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    clock = SimClock(speed=options.speed)
    stage = make_stage(options, clock=clock)
    log = nullcontext(None) if truth is None else truth.open("w", encoding="utf-8")
    with log as opened, serve_on_pty(stage, clock=clock, link=link):
        if opened is not None:
            opened.write("time_s,angle_deg\n")
        yield StageServer(stage, clock, opened)


_EXAMPLE = "rig-sim.toml"


@contextmanager
def serve_rig_camera(address: str, *, rig_path: Path | None, lost_share: float) -> Iterator[str]:
    """Serve it until the context is left; give the port of the rig's stage, which turns the polarizer."""
    from rigctl.rig.simulation import simulate

    place, _, options = address.partition("?")
    faults, rest = split_faults(options)
    if rest:
        raise ConfigError(f"{address}: {rest}: no fault that the simulated camera has; docs/cameras.md lists them")
    faults = replace(faults, lost_share=lost_share or faults.lost_share)
    with as_file(files("rigctl") / "data" / "examples") as examples:
        rig = load_rig(rig_path or examples / _EXAMPLE)
        camera_section = rig.camera.model_copy(update={"address": SERVED})  # not twice on the network
        rig = rig.model_copy(update={"camera": camera_section})
        with simulate(rig, session_name="served") as simulation:
            serial_number = simulation.camera.identify().serial_number
            with _served(simulation.camera, place, serial_number=serial_number, faults=faults):
                yield simulation.stage_port or "none: the camera has polarizers on its pixels"


def _served(
    camera: Camera, place: str, *, serial_number: str, faults: GigeFaults
) -> AbstractContextManager[AravisDevice | str]:
    """Serve a camera where it was asked for: behind a network of its own, where that is another loopback address."""
    if place != THIS_MACHINE and place.startswith(_LOOPBACK):
        return serve_behind_network(camera, address=place, serial_number=serial_number, faults=faults)
    return serve_gige_camera(camera, address=place, serial_number=serial_number, faults=faults)
