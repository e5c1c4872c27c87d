"""Finds GigE and USB3 Vision cameras."""

from collections.abc import Iterator

from drivers.cameras.aravis_library import load_aravis
from drivers.cameras.gige_link import find_cameras
from drivers.interfaces import DeviceIdentity


def find_gige() -> Iterator[tuple[str, DeviceIdentity]]:
    """Give address and identity of each GigE Vision camera that answers a call to all; none is opened.

    Raises
    ------
    NotConnectedError
        libaravis is not installed.
    """
    for camera in find_cameras(load_aravis()):
        yield (
            f"gige:{camera.address}",
            # What firmware it has it tells only to whoever opens it.
            DeviceIdentity(model=camera.name, serial_number=camera.serial_number, firmware="not asked"),
        )


def find_usb3() -> Iterator[tuple[str, DeviceIdentity]]:
    """Give address and identity of each USB3 Vision camera that is plugged in; none is opened.

    Raises
    ------
    NotConnectedError
        libaravis is not installed.
    """
    for camera in find_cameras(load_aravis(), link="usb3"):
        yield (
            f"u3v:{camera.serial_number or camera.name}",
            DeviceIdentity(model=camera.name, serial_number=camera.serial_number, firmware="not asked"),
        )
