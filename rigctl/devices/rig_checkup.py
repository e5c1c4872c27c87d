"""Check-up of the devices of a rig: how fast they answer, and what is lost on the way."""

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path

from drivers.interfaces import Camera, ReportingCamera, RotationStage
from drivers.network_path import path_mtu
from drivers.serial_ports import resolve_port
from rigctl.console.terminal import warn
from rigctl.devices.host_checkup import Finding
from rigctl.devices.rig import open_rig
from rigctl.devices.stages import SIMULATED, find_driver
from rigctl.files.rig_file import RigFile
from rigctl.simulated.camera_address import ON_NETWORK, THIS_MACHINE

_EXPOSURE_S = 0.01
_READINGS = 20
_SLOW_ANSWER_S = 0.05
_SERIAL_DEVICES = Path("/sys/bus/usb-serial/devices")
_ETHERNET_MTU, _JUMBO_MTU = 1500, 9000


class RigCheckup:
    """Opens a rig and looks at it.

    Parameters
    ----------
    rig : RigFile
        Which.
    frames : int
        How many pictures are taken.

    Attributes
    ----------
    pixels : int or None
        Of a picture, once the camera was opened.
    camera_s : float or None
        What a picture takes beside its exposure, once some were taken [s].
    """

    def __init__(self, rig: RigFile, *, frames: int) -> None:
        self._rig, self._frames = rig, frames
        self.pixels: int | None = None
        self.camera_s: float | None = None

    def findings(self) -> Iterator[Finding]:
        """Give what is found, line by line.

        Raises
        ------
        DeviceError
            A device cannot be opened, or fails.
        """
        yield from self._ways()
        with open_rig(self._rig, session_name="doctor") as rig:
            yield Finding(what="stage", found=f"{rig.stage_identity.model}, serial {rig.stage_identity.serial_number}")
            yield stage_latency(rig.stage)
            identity = rig.camera_identity
            yield Finding(what="camera", found=f"{identity.model}, serial {identity.serial_number}")
            settings = rig.camera.configure(exposure_s=_EXPOSURE_S, gain_db=self._rig.camera.gain_db)
            self.pixels = settings.width * settings.height
            timeout_s = self._rig.camera.timeout_s + _EXPOSURE_S
            times_s = frame_times_s(rig.camera, frames=self._frames, timeout_s=timeout_s)
            self.camera_s = max(0.0, statistics.median(times_s) - settings.exposure_s)
            yield from camera_frames(rig.camera, times_s)

    def _ways(self) -> Iterator[Finding]:
        """Give what there is to say of the ways to the devices."""
        port = self._rig.stage.port
        if not port.startswith(SIMULATED):
            adapter = adapter_wait(resolve_port(port, warn=warn))
            if adapter is not None:
                yield adapter
        network_address = _network_address(self._rig.camera.address)
        if network_address is not None:
            yield interface_mtu(network_address)


def stage_latency(stage: RotationStage) -> Finding:
    """Return how long the stage takes to tell its position."""
    times_s = [_timed(stage.position) for _ in range(_READINGS)]
    typical_s, longest_s = statistics.median(times_s), max(times_s)
    advice = None
    if typical_s > _SLOW_ANSWER_S:
        advice = "it answers slowly: is its adapter behind a hub, or does another program use it?"
    found = f"{typical_s * 1e3:.1f} ms a reading, longest {longest_s * 1e3:.1f} ms"
    return Finding(what="stage", found=found, advice=advice)


def adapter_wait(port: str, *, devices: Path = _SERIAL_DEVICES) -> Finding | None:
    """Return how long a USB adapter waits before it passes bytes on; None for a port whose adapter does not tell.

    Parameters
    ----------
    port : str
        The path of the port.
    devices : Path
        Where the system tells of adapters.
    """
    file = devices / Path(port).resolve().name / "latency_timer"
    try:
        wait_ms = int(file.read_text())
    except (OSError, ValueError):
        return None
    advice = None
    if wait_ms > 1:
        advice = f"each answer takes so much longer: echo 1 > {file} (docs/plug-ins.md has a rule that lasts)"
    return Finding(what="serial adapter", found=f"waits {wait_ms} ms before it passes bytes on", advice=advice)


def frame_times_s(camera: Camera, *, frames: int, timeout_s: float) -> list[float]:
    """Return how long each of so many pictures takes, exposure included [s]."""
    return [_timed(lambda: camera.take_frame(timeout_s=timeout_s)) for _ in range(frames)]


def camera_frames(camera: Camera, times_s: Sequence[float]) -> Iterator[Finding]:
    """Return how fast pictures came, and what was lost of them, where the camera counts that."""
    found = (
        f"{len(times_s)} frames, {statistics.median(times_s) * 1e3:.0f} ms each, longest {max(times_s) * 1e3:.0f} ms"
    )
    yield Finding(what="camera", found=found)
    if not isinstance(camera, ReportingCamera):
        return
    facts, tally = camera.facts(), camera.tally()
    bent = {True: "linear: what bends counts is off", None: "linear: it does not tell", False: "its counts are bent"}
    yield Finding(what="samples", found=f"{facts.sample_format}, {facts.justified}-justified; {bent[facts.linear]}")
    lost = tally.damaged + tally.never_came
    advice = None
    # The first one after a start is often damaged.
    if lost > 1:
        advice = (
            "packets are lost: raise the receive buffer, connect the camera without a switch or with jumbo packets, "
            "use a shorter or better cable, and let nothing else use this interface"
        )
    yield Finding(what="loss", found=f"{tally.damaged} damaged, {tally.never_came} never came", advice=advice)
    for name, value in camera.features().items():
        yield Finding(what=f"  {name}", found=value)


def interface_mtu(address: str) -> Finding:
    """Return how large packets may be on the way to a camera."""
    mtu = path_mtu(address)
    advice = hint = None
    if mtu < _ETHERNET_MTU:
        advice = f"smaller than Ethernet's {_ETHERNET_MTU}: ip link set IFACE mtu {_ETHERNET_MTU}"
    elif mtu < _JUMBO_MTU:
        hint = (
            f"if camera and switch can: ip link set IFACE mtu {_JUMBO_MTU}, and packet_size={_JUMBO_MTU}, load it less"
        )
    return Finding(what="MTU", found=f"{mtu} bytes", advice=advice, hint=hint)


def _timed(ask: Callable[[], object]) -> float:
    start_s = time.perf_counter()
    ask()
    return time.perf_counter() - start_s


def _network_address(address: str) -> str | None:
    """Return where a camera is on the network, before it is opened; None where its driver's module does not tell."""
    scheme, _, place = address.partition(":")
    if address.startswith(SIMULATED):
        return THIS_MACHINE if address.partition("?")[0] == ON_NETWORK else None
    driver = find_driver("rigctl.cameras", scheme, key="camera.address")
    tell: Callable[[str], str] | None = getattr(import_module(driver.module), "network_address", None)
    return None if tell is None else tell(place)
