"""A rig's simulated camera on the network, where its address asks for that: ``sim:gige?lost=0.001``."""

from collections.abc import Iterator
from contextlib import contextmanager

from drivers.interfaces import Camera
from rigctl.errors import ConfigError
from sim_devices.cameras.gige import serve_gige_camera

_SCHEME = "sim:gige"
_HERE = "127.0.0.1"
_LOST = "lost="


@contextmanager
def serve_if_gige(address: str, camera: Camera) -> Iterator[str | None]:
    """Give where a camera is served as a GigE Vision camera, until the context is left; None for another address.

    Parameters
    ----------
    address : str
        The camera's in the rig file. ``lost`` is the share of packets that the simulation loses; what else there is
        behind the "?" is for the driver.
    camera : Camera
        The simulated one.

    Raises
    ------
    ConfigError
        ``lost`` is no share.
    NotConnectedError
        libaravis is not installed, or there is another GigE camera on this machine's own address.
    """
    scheme, _, tail = address.partition("?")
    if scheme != _SCHEME:
        yield None
        return
    options = [option for option in tail.split("&") if not option.startswith(_LOST)]
    lost = [option.removeprefix(_LOST) for option in tail.split("&") if option.startswith(_LOST)]
    serial_number = camera.identify().serial_number
    with serve_gige_camera(camera, address=_HERE, serial_number=serial_number, lost_share=_share(lost)):
        yield f"{_HERE}?{'&'.join(options)}"


def _share(texts: list[str]) -> float:
    try:
        (share,) = [float(text) for text in texts] or [0.0]
    except ValueError:
        share = -1.0
    if not 0.0 <= share < 1.0:
        raise ConfigError(f"camera.address: lost={','.join(texts)}: must be one number from 0 to below 1")
    return share
