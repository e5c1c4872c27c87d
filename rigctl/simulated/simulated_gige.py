"""A rig's simulated camera on the network, where its address asks for that: ``sim:gige?lost=0.001&hang=20``."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from drivers.interfaces import Camera
from rigctl.errors import ConfigError
from sim_devices.cameras.gige import serve_gige_camera
from sim_devices.cameras.gige_faults import GigeFaults

SCHEME = "sim:gige"
_HERE = "127.0.0.1"


@contextmanager
def serve_if_gige(address: str, camera: Camera) -> Iterator[str | None]:
    """Give where a camera is served as a GigE Vision camera, until the context is left; None for another address.

    Parameters
    ----------
    address : str
        The camera's in the rig file. Keys of faults (see `split_faults`) are for the simulation; what else there is
        behind the "?" is for the driver.
    camera : Camera
        The simulated one.

    Raises
    ------
    ConfigError
        A fault is none.
    NotConnectedError
        libaravis is not installed, or there is another GigE camera on this machine's own address.
    """
    scheme, _, tail = address.partition("?")
    if scheme != SCHEME:
        yield None
        return
    faults, rest = split_faults(tail)
    serial_number = camera.identify().serial_number
    with serve_gige_camera(camera, address=_HERE, serial_number=serial_number, faults=faults):
        yield f"{_HERE}?{rest}"


def split_faults(options: str) -> tuple[GigeFaults, str]:
    """Return the faults that options of an address ask for, and the options that are none.

    Parameters
    ----------
    options : str
        ``key=value&key=value``. ``lost`` is the share of packets that are not sent; ``die``, ``restart``, ``hang`` and
        ``forget`` are the picture, counted from the camera's power-up, at which its power goes for good, goes and
        comes back, at which it answers nobody for a while, and after which its exposure is not what was set;
        ``off_s`` and ``hang_s`` say for how long.

    Raises
    ------
    ConfigError
        Values are not allowed, or given twice: all are named.
    """
    values: dict[str, Any] = {}
    rest, problems = [], []
    for option in filter(None, options.split("&")):
        key, _, text = option.partition("=")
        if key not in _FAULTS:
            rest.append(option)
            continue
        field, read, allowed = _FAULTS[key]
        value = _read_or_none(text, read)
        if value is None or field in values:
            problems.append(f"{option}: must be one {allowed}")
        values[field] = value
    if problems:
        raise ConfigError(f"camera.address: {'; '.join(problems)}")
    return GigeFaults(**values), "&".join(rest)


def _share(text: str) -> float | None:
    share = float(text)
    return share if 0.0 <= share < 1.0 else None


def _picture(text: str) -> int | None:
    number = int(text)
    return number if number >= 2 else None


def _seconds(text: str) -> float | None:
    seconds = float(text)
    return seconds if 0.0 <= seconds <= 3600.0 else None


_Reader = Callable[[str], float | int | None]
_PICTURE = "whole number from 2 on: the driver takes the first picture when it opens the camera"
_FAULTS: dict[str, tuple[str, _Reader, str]] = {
    "lost": ("lost_share", _share, "number from 0 to below 1"),
    "die": ("die", _picture, _PICTURE),
    "restart": ("restart", _picture, _PICTURE),
    "off_s": ("off_s", _seconds, "number of seconds, 0 to 3600"),
    "hang": ("hang", _picture, _PICTURE),
    "hang_s": ("hang_s", _seconds, "number of seconds, 0 to 3600"),
    "forget": ("forget", _picture, _PICTURE),
}


def _read_or_none(text: str, read: _Reader) -> float | int | None:
    try:
        return read(text)
    except ValueError:
        return None
