"""A simulated camera on the network: any GigE Vision program can take pictures of the simulated world with it."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Camera
from sim_devices.cameras import gige_features as registers
from sim_devices.cameras.aravis_device import AravisDevice, serve_device
from sim_devices.cameras.sample_bytes import bytes_of

_ENDLESS_S = 1e9
_START_TEMPERATURE_TENTHS_C = 285
# An automatic exposure that was left on shows in the picture.
_AUTOMATIC_FACTOR = 2.0


@contextmanager
def serve_gige_camera(
    source: Camera,
    *,
    address: str = "127.0.0.1",
    serial_number: str = "SIM1",
    lost_share: float = 0.0,
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
    lost_share : float
        Share of the packets of pictures that are not sent.
    wait : callable
        Waits out an exposure [s] once the picture is made, so that light is from the exposure's start and the picture
        leaves at its end.

    Raises
    ------
    NotConnectedError
        libaravis is not installed, or the address is not this machine's or in use.

    Notes
    -----
    It powers up with automatic exposure and gain, as real cameras do; then pictures are of twice the exposure that was
    set. It serves no packet twice, and does not bin. Nobody is answered during an exposure: longer ones than 2 s look
    like a camera that hangs.
    """
    pictures = _Pictures(source, wait)
    with serve_device(
        address=address, serial_number=serial_number, edit_features=registers.extended, fill=pictures.fill
    ) as device:
        pictures.device = device
        device.lose_packets(lost_share)
        _power_up(device, pictures.settings.width, pictures.settings.height)
        yield device


def _power_up(device: AravisDevice, width: int, height: int) -> None:
    for register, value in (
        (registers.SENSOR_WIDTH, width),
        (registers.SENSOR_HEIGHT, height),
        (registers.WIDTH, width),
        (registers.HEIGHT, height),
        (registers.EXPOSURE_AUTO, registers.EXPOSURE_AUTO_CONTINUOUS),
        (registers.GAIN_AUTO, registers.GAIN_AUTO_CONTINUOUS),
        (registers.TEMPERATURE_TENTHS_C, _START_TEMPERATURE_TENTHS_C),
    ):
        device.write_register(register, value)


class _Pictures:
    """Makes the pictures that the device asks for, with the settings that its client has written."""

    def __init__(self, source: Camera, wait: Callable[[float], None]) -> None:
        self._source, self._wait = source, wait
        self._asked = (0.01, 0.0)
        self.settings = source.configure(exposure_s=self._asked[0], gain_db=self._asked[1])
        self.device: AravisDevice | None = None

    def fill(self, width: int, height: int, exposure_us: int, gain_db: int, pixel_format: int) -> bytes:
        """Return the bytes of a picture of the world as it is now."""
        asked = (self._factor() * exposure_us / 1e6, float(gain_db))
        if asked != self._asked:
            self.settings = self._source.configure(exposure_s=asked[0], gain_db=asked[1])
            self._asked = asked
        counts = self._source.take_frame(timeout_s=_ENDLESS_S).counts
        self._wait(exposure_us / 1e6)
        region = self._region(counts, width, height)
        return bytes_of(region, bit_depth=self.settings.bit_depth, pixel_format=pixel_format)

    def _factor(self) -> float:
        if self.device is None or self.device.read_register(registers.EXPOSURE_AUTO) == registers.EXPOSURE_AUTO_OFF:
            return 1.0
        return _AUTOMATIC_FACTOR

    def _region(self, counts: NDArray[np.uint16], width: int, height: int) -> NDArray[np.uint16]:
        if self.device is None:
            return counts[:height, :width]
        left, top = (self.device.read_register(register) for register in (registers.OFFSET_X, registers.OFFSET_Y))
        region = counts[top : top + height, left : left + width]
        return region[:, ::-1] if self.device.read_register(registers.REVERSE_X) else region
