"""A simulated camera on the network: any GigE Vision program can take pictures of the simulated world with it."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Camera
from sim_devices.cameras import gige_feature_list as registers
from sim_devices.cameras.aravis_device import AravisDevice
from sim_devices.cameras.device_clock import DeviceClock
from sim_devices.cameras.gige_faults import FaultyPower, GigeFaults
from sim_devices.cameras.lossy_network import Losses, lossy_network
from sim_devices.cameras.sample_bytes import bytes_of

_ENDLESS_S = 1e9
_START_TEMPERATURE_TENTHS_C = 285
# An automatic exposure that was left on shows in the picture.
_AUTOMATIC_FACTOR = 2.0
_FORGOTTEN_EXPOSURE_US = 1234


@contextmanager
def serve_gige_camera(
    source: Camera,
    *,
    address: str = "127.0.0.1",
    serial_number: str = "SIM1",
    faults: GigeFaults | None = None,
    clock: DeviceClock | None = None,
    wait: Callable[[float], None] = time.sleep,
) -> Iterator[AravisDevice]:
    """Serve a camera on an IP address of this machine until the context is left.

    Parameters
    ----------
    source : Camera
        Makes the pictures; nobody else may use it meanwhile. It need not wait for its exposures.
    address : str
        Of one of this machine's interfaces.
    serial_number : str
        What the camera says that it is.
    faults : GigeFaults or None
        What goes wrong.
    clock : DeviceClock or None
        Of which its list of features tells; whoever stands before it answers for the clock.
    wait : callable
        Waits out an exposure [s] once the picture is made, so that light is from the exposure's start and the picture
        leaves at its end.

    Raises
    ------
    NotConnectedError
        libaravis is not installed, or the address is not this machine's or in use.

    Notes
    -----
    It powers up with automatic exposure and gain and with a gamma, as real cameras do; then pictures are of twice the
    exposure that was set, and bent. It sends no packet twice (behind `serve_behind_network` it does), and does not
    bin. Nobody is answered during an exposure: longer ones than 2 s look like a camera that hangs. What the source
    raises is raised when the context is left.
    """
    served = _ServedCamera(
        source, address=address, serial_number=serial_number, faults=faults or GigeFaults(), clock=clock, wait=wait
    )
    try:
        with served.power:
            served.power_up()
            yield served.device
    finally:
        served.device.power_down()
    if served.device.failures:
        raise served.device.failures[0]


@contextmanager
def serve_behind_network(
    source: Camera,
    *,
    address: str = "127.0.0.2",
    serial_number: str = "SIM1",
    faults: GigeFaults,
    wait: Callable[[float], None] = time.sleep,
) -> Iterator[str]:
    """Serve a camera of this machine behind a network that loses what the faults say; give the address to turn to.

    Parameters are those of `serve_gige_camera`; the camera itself is at 127.0.0.1, and the address is another one of
    127.0.0.0/8. Its clock is as `faults.clock` says. Raises as that.
    """
    clock = None if faults.clock is None else DeviceClock(faults.clock)
    hidden = replace(faults, lost_share=0.0)
    with serve_gige_camera(source, serial_number=serial_number, faults=hidden, clock=clock, wait=wait) as device:
        device.promise_resends(faults.resends)
        losses = Losses(share=faults.lost_share, resends=faults.resends)
        with lossy_network(camera=device.address, address=address, losses=losses, clock=clock):
            yield address


class _ServedCamera:
    """Makes the pictures that the device asks for, with the settings that its client has written."""

    def __init__(
        self,
        source: Camera,
        *,
        address: str,
        serial_number: str,
        faults: GigeFaults,
        clock: DeviceClock | None,
        wait: Callable[[float], None],
    ) -> None:
        self._source, self._wait = source, wait
        self._lost_share = faults.lost_share
        self._asked = (0.01, 0.0)
        self._settings = source.configure(exposure_s=self._asked[0], gain_db=self._asked[1])
        self.device = AravisDevice(
            address=address,
            serial_number=serial_number,
            edit_features=lambda xml: (
                registers.extended(xml) if clock is None else clock.features(registers.extended(xml))
            ),
            fill=self._fill,
        )
        self.power = FaultyPower(
            faults,
            power_down=self.device.power_down,
            power_up=self.power_up,
            forget=self._forget,
            cut=lambda: self.device.lose_packets(1.0),
        )

    def power_up(self) -> None:
        """Answer on the network, with the settings of a power-up."""
        self.device.power_up()
        self.device.lose_packets(self._lost_share)
        width, height = self._settings.width, self._settings.height
        for register, value in (
            (registers.SENSOR_WIDTH, width),
            (registers.SENSOR_HEIGHT, height),
            (registers.WIDTH, width),
            (registers.HEIGHT, height),
            (registers.EXPOSURE_AUTO, registers.EXPOSURE_AUTO_CONTINUOUS),
            (registers.GAIN_AUTO, registers.GAIN_AUTO_CONTINUOUS),
            (registers.GAMMA, 1),
            (registers.TEMPERATURE_TENTHS_C, _START_TEMPERATURE_TENTHS_C),
        ):
            self.device.write_register(register, value)

    def _fill(self, width: int, height: int, exposure_us: int, gain_db: int, pixel_format: int) -> bytes:
        """Return the bytes of a picture of the world as it is now."""
        self.power.before_picture()
        asked = (self._factor() * exposure_us / 1e6, float(gain_db))
        if asked != self._asked:
            self._settings = self._source.configure(exposure_s=asked[0], gain_db=asked[1])
            self._asked = asked
        counts = self._source.take_frame(timeout_s=_ENDLESS_S).counts
        self._wait(exposure_us / 1e6)
        self.power.after_picture()
        region = self._bent(self._region(counts, width, height))
        return bytes_of(region, bit_depth=self._settings.bit_depth, pixel_format=pixel_format)

    def _bent(self, counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Return counts as a screen wants them, where that was left on."""
        if not self.device.read_register(registers.GAMMA):
            return counts
        full_dn = 2**self._settings.bit_depth - 1
        bent: NDArray[np.uint16] = np.rint(full_dn * np.sqrt(counts / full_dn)).astype(np.uint16)
        return bent

    def _forget(self) -> None:
        self.device.write_register(registers.EXPOSURE_US, _FORGOTTEN_EXPOSURE_US)

    def _factor(self) -> float:
        is_manual = self.device.read_register(registers.EXPOSURE_AUTO) == registers.EXPOSURE_AUTO_OFF
        return 1.0 if is_manual else _AUTOMATIC_FACTOR

    def _region(self, counts: NDArray[np.uint16], width: int, height: int) -> NDArray[np.uint16]:
        left, top = (self.device.read_register(register) for register in (registers.OFFSET_X, registers.OFFSET_Y))
        region = counts[top : top + height, left : left + width]
        return region[:, ::-1] if self.device.read_register(registers.REVERSE_X) else region
