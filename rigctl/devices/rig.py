"""Opens the devices of a rig file: the one place where a rig is put together."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

from drivers.interfaces import Camera, DeviceIdentity, RotationStage
from drivers.serial_ports import resolve_port
from rigctl.devices.operator_at_rig import ask_operator
from rigctl.devices.stages import SIMULATED, connect_stage, find_driver, require_serial
from rigctl.files.rig_file import RigFile
from rigctl.runs.run_folder import FrameKind
from rigctl.simulated.simulation import Simulation, simulate
from rigctl.terminal import warn
from sim_devices.camera import SimCamera


@dataclass(frozen=True, kw_only=True, eq=False)
class Rig:
    """Devices that are open, and what they say they are.

    Attributes
    ----------
    stage, camera
        The devices.
    stage_identity, camera_identity : DeviceIdentity
        What they are.
    present : callable
        Puts scene, dark or flat before the camera: a simulated world by itself, a real rig by asking its operator.
    origin : {"simulated", "device"}
        Where the frames come from.
    source : SimCamera or None
        What makes the pictures of a simulated camera: its numbers decide their noise.
    is_networked : bool
        Pictures of the source come over the network, under other numbers than the source's own.
    """

    stage: RotationStage
    camera: Camera
    stage_identity: DeviceIdentity
    camera_identity: DeviceIdentity
    present: Callable[[FrameKind], None]
    origin: Literal["simulated", "device"]
    source: SimCamera | None = None
    is_networked: bool = False


@contextmanager
def open_rig(rig: RigFile, *, session_name: str) -> Iterator[Rig]:
    """Give the open devices of a rig until the context is left; then they are closed.

    Parameters
    ----------
    rig : RigFile
        Which devices, and where. A port or address that begins with "sim:" is a simulated device.
    session_name : str
        Decides the noise of a simulated camera.

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
    with simulate(rig, session_name=session_name) as simulation, _open_devices(rig, simulation) as opened:
        yield opened


@contextmanager
def _open_devices(rig: RigFile, simulation: Simulation | None) -> Iterator[Rig]:
    with connect_stage(rig.stage, _stage_port(rig, simulation)) as stage, _camera(rig, simulation) as camera:
        stage_identity, camera_identity = stage.identify(), camera.identify()
        require_serial("camera", rig.camera.serial_number, camera_identity)
        yield Rig(
            stage=stage,
            camera=camera,
            stage_identity=stage_identity,
            camera_identity=camera_identity,
            present=ask_operator if simulation is None else simulation.world.present,
            origin="device" if simulation is None else "simulated",
            source=_source(rig, simulation),
            is_networked=simulation is not None and simulation.gige_place is not None,
        )


def _stage_port(rig: RigFile, simulation: Simulation | None) -> str:
    if simulation is not None and rig.stage.port.startswith(SIMULATED):
        return simulation.stage_port
    return resolve_port(rig.stage.port, warn=warn)


def _source(rig: RigFile, simulation: Simulation | None) -> SimCamera | None:
    if simulation is None or not rig.camera.address.startswith(SIMULATED):
        return None
    return simulation.camera


def _camera(rig: RigFile, simulation: Simulation | None) -> Camera:
    scheme, _, place = rig.camera.address.partition(":")
    if scheme == "sim" and simulation is not None:
        if simulation.gige_place is None:
            return simulation.camera
        scheme, place = "gige", simulation.gige_place
    factory = find_driver("rigctl.cameras", scheme, key="camera.address").load()
    camera: Camera = factory(place)
    return camera
