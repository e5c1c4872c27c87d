"""A camera by itself, without the rest of its rig: for focusing, when the stage need not be there yet."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import as_file, files
from pathlib import Path

from drivers.interfaces import Camera
from rigctl.devices.rig import open_rig
from rigctl.devices.stages import SIMULATED, find_driver
from rigctl.files.rig_file import RigFile, load_rig

_RIG_FILE = ".toml"
_EXAMPLE = "rig-sim.toml"


@contextmanager
def open_camera(what: str) -> Iterator[Camera]:
    """Give the open camera of a rig file, or the one at an address such as ``gige:192.168.0.5``.

    A simulated camera sees what its rig file says; without one, the example rig's scene.

    Raises
    ------
    DeviceError
        It cannot be opened.
    ConfigError
        The rig file is wrong, or there is no such driver.
    """
    with as_file(files("rigctl") / "data" / "examples") as examples:
        rig = load_rig(Path(what)) if what.endswith(_RIG_FILE) else _with_address(load_rig(examples / _EXAMPLE), what)
        if rig.camera.address.startswith(SIMULATED):
            with open_rig(rig, session_name="preview") as opened:
                yield opened.camera
            return
    scheme, _, place = rig.camera.address.partition(":")
    camera: Camera
    with find_driver("rigctl.cameras", scheme, key="camera.address").load()(place) as camera:
        yield camera


def _with_address(rig: RigFile, address: str) -> RigFile:
    return rig.model_copy(update={"camera": rig.camera.model_copy(update={"address": address})})
