"""Opens the devices of a rig file: the one place where a rig is put together."""

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from drivers.interfaces import Camera, CameraWithFacts, DeviceIdentity, RotationStage
from drivers.recording import read_recording
from drivers.serial_ports import resolve_port
from rigctl.console.terminal import warn
from rigctl.devices.stages import SIMULATED, connect_stage, find_driver, require_serial
from rigctl.errors import ConfigError
from rigctl.files.choices import FrameKind
from rigctl.files.rig_file import REPLAY, RigFile
from rigctl.numbers.angles import wrapped
from rigctl.runs.simulated_light import SimulatedLight
from rigctl.simulated.camera_address import require_known_camera
from rigctl.simulated.simulated_clock import SimulatedClock
from rigctl.simulated.simulation import Simulation, simulate
from sim_devices.clock import SimClock
from sim_devices.stages.pty_server import serve_on_pty
from sim_devices.stages.replayed_device import ReplayedDevice, exchanges_of

# How often each recording's stage was opened in this program.
_REPLAYED: Counter[Path] = Counter()
# A cell that is calibrated differs by some degrees from the one that was meant, another one by 45.
_CELL_TOLERANCE_DEG = 22.5
REQUESTS: dict[FrameKind, str] = {
    "scene": "Point the camera at the scene, nothing before the lens",
    "dark": "Cover the lens, so that no light comes in",
    "flat": "Put the flat field (integrating sphere) before the lens",
}


def _do_nothing(_sequence: int) -> bool:
    """Return that no numbers jump: a real camera's noise is its own."""
    return False


def _ask_nobody(_kind: FrameKind) -> None:
    """Return: nobody's hands are needed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rig:
    """Devices that are open, and what they say they are.

    Attributes
    ----------
    stage, camera
        The devices; no stage where the camera has polarizers on its pixels.
    stage_identity, camera_identity : DeviceIdentity
        What they are.
    present : callable
        Puts scene, dark or flat before the camera where the world is simulated; else does nothing.
    ask : callable
        Asks the operator of a real rig to do that, at the terminal; where the world is simulated, nobody.
    origin : {"simulated", "device", "replay"}
        Where the frames come from; "replay" of a recording.
    begin_step : callable
        To be told of each step, by its sequence number, before its first frame; says whether the numbers of the
        camera's frames jump there. Of a simulated camera, whose noise hangs on it; others do nothing.
    light : SimulatedLight or None
        What lights a simulated roof.
    """

    stage: RotationStage | None
    camera: Camera
    stage_identity: DeviceIdentity | None
    camera_identity: DeviceIdentity
    present: Callable[[FrameKind], None]
    ask: Callable[[FrameKind], None] = _ask_nobody
    origin: Literal["simulated", "device", "replay"]
    begin_step: Callable[[int], bool] = _do_nothing
    light: SimulatedLight | None = None


@contextmanager
def open_rig(
    rig: RigFile, *, session_name: str, run: Path | None = None, clock: SimulatedClock | None = None
) -> Iterator[Rig]:
    """Give the open devices of a rig until the context is left; then they are closed.

    Parameters
    ----------
    rig : RigFile
        Which devices, and where. A port or address that begins with "sim:" is a simulated device.
    session_name : str
        Decides the noise of a simulated camera.
    run : Path or None
        Run folder of the session, which may hold a part of it: simulated noise goes on from there.
    clock : SimulatedClock or None
        The time of a simulated rig with a clock of its own.

    Raises
    ------
    DeviceError
        A device cannot be opened, or is not the one that the rig file names.
    ConfigError
        The rig file names a driver that is not installed.
    """
    if not rig.is_simulated:
        with _open_devices(rig, None) as opened:
            yield opened
        return
    with (
        simulate(rig, session_name=session_name, run=run, clock=clock) as simulation,
        _open_devices(rig, simulation) as opened,
    ):
        yield opened


def require_drivers(rig: RigFile) -> None:
    """Raise ConfigError where a driver is not installed or a simulated camera is none; no device is touched."""
    if rig.stage is not None:
        find_driver("rigctl.stages", rig.stage.driver, key="stage.driver")
    for monitor in rig.monitors:
        find_driver("rigctl.monitors", monitor.driver, key=f"monitors.{monitor.name}.driver")
    require_known_camera(rig.camera.address, is_mosaic=rig.camera.mosaic_deg is not None)
    if not rig.camera.address.startswith(SIMULATED):
        find_driver("rigctl.cameras", rig.camera.address.partition(":")[0], key="camera.address")


@contextmanager
def _open_devices(rig: RigFile, simulation: Simulation | None) -> Iterator[Rig]:
    with _stage(rig, simulation) as stage, _camera(rig, simulation) as camera:
        camera_identity = camera.identify()
        require_serial("camera", rig.camera.serial_number, camera_identity)
        require_cell(rig, camera)
        yield Rig(
            stage=stage,
            camera=camera,
            stage_identity=None if stage is None else stage.identify(),
            camera_identity=camera_identity,
            present=_ask_nobody if simulation is None else simulation.world.present,
            ask=_ask_operator if simulation is None and not rig.is_replayed else _ask_nobody,
            origin="replay" if rig.is_replayed else "device" if simulation is None else "simulated",
            begin_step=_do_nothing if simulation is None else simulation.begin_step,
            light=None if simulation is None else simulation.light,
        )


@contextmanager
def _stage(rig: RigFile, simulation: Simulation | None) -> Iterator[RotationStage | None]:
    if rig.stage is None:
        yield None
        return
    if rig.stage.port.startswith(REPLAY):
        clock = SimClock(speed=1.0)
        device = _replayed_line(rig.stage.port.removeprefix(REPLAY), clock)
        with serve_on_pty(device, clock=clock) as port, connect_stage(rig.stage, port) as stage:
            yield stage
        return
    simulated_port = None if simulation is None else simulation.stage_port
    is_real = simulated_port is None or not rig.stage.port.startswith(SIMULATED)
    port = resolve_port(rig.stage.port, warn=warn) if is_real or simulated_port is None else simulated_port
    with connect_stage(rig.stage, port) as stage:
        yield stage


def _replayed_line(place: str, clock: SimClock) -> ReplayedDevice:
    """Return what answers as a recorded stage did; each opening is the next one that was recorded."""
    path = Path(place)
    opened = read_recording(path).opened
    number = _REPLAYED[path.resolve()]
    _REPLAYED[path.resolve()] += 1
    line = opened[number % len(opened)].line if opened else ()
    return ReplayedDevice(exchanges_of((one.time_s, one.heard, one.data) for one in line), clock=clock)


def require_cell(rig: RigFile, camera: Camera) -> None:
    """Refuse a mosaic that is not the one of the rig file, as far as the camera tells.

    Raises
    ------
    ConfigError
        It is another one, or the rig file has none.
    """
    told = camera.facts().mosaic_deg if isinstance(camera, CameraWithFacts) else None
    stated = rig.camera.mosaic_deg
    if told is None:
        return
    cell = ", ".join(f"{angle:g}" for angle in told)
    if stated is None:
        raise ConfigError(
            "camera.mosaic_deg: the camera says that it has polarizers on its pixels: state "
            f"mosaic_deg = [{cell}], and leave [stage] out"
        )
    if any(
        abs(wrapped(one - other, turn=180.0)) > _CELL_TOLERANCE_DEG for one, other in zip(stated, told, strict=True)
    ):
        found = ", ".join(f"{angle:g}" for angle in stated)
        raise ConfigError(f"camera.mosaic_deg: is [{found}], and the camera says that its cell is [{cell}]")


def _camera(rig: RigFile, simulation: Simulation | None) -> Camera:
    address = rig.camera.address
    if address.startswith(SIMULATED) and simulation is not None:
        if simulation.network_address is None:
            return simulation.camera
        address = simulation.network_address
    scheme, _, place = address.partition(":")
    factory = find_driver("rigctl.cameras", scheme, key="camera.address").load()
    camera: Camera = factory(place)
    return camera


def _ask_operator(kind: FrameKind) -> None:
    """Return once the person at the terminal says that it is done.

    Raises
    ------
    ConfigError
        There is nobody at a terminal: a lens cap does not put itself on. A scene needs nobody.
    """
    if not sys.stdin.isatty():
        if kind == "scene":
            return  # what a camera sees when nobody has put anything before it
        raise ConfigError(
            f"a take of kind {kind!r} needs somebody at the rig, and there is no terminal to ask at: "
            "run it by hand, or keep to takes of one kind"
        )
    sys.stderr.write(f"{REQUESTS[kind]}, then press Enter: ")
    sys.stderr.flush()
    sys.stdin.readline()
