"""The devices of a rig, looked at one after the other."""

import statistics
from collections.abc import Iterator

from drivers.cameras.aravis_library import load_aravis
from drivers.cameras.gige_link import address_of
from drivers.serial_ports import resolve_port
from rigctl.devices.device_checkup import adapter_wait, camera_frames, frame_times_s, interface_mtu, stage_latency
from rigctl.devices.finding import Finding
from rigctl.devices.rig import open_rig
from rigctl.devices.stages import SIMULATED
from rigctl.files.rig_file import RigFile
from rigctl.simulated.simulated_gige import SCHEME
from rigctl.terminal import warn

_EXPOSURE_S = 0.01
_THIS_MACHINE = "127.0.0.1"


class Checkup:
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
        scheme, _, place = self._rig.camera.address.partition(":")
        if scheme == "gige":
            yield interface_mtu(address_of(load_aravis(), place.partition("?")[0]))
        elif self._rig.camera.address.partition("?")[0] == SCHEME:
            yield interface_mtu(_THIS_MACHINE)
