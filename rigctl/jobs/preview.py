"""Looking through a camera while the lens is turned: pictures for the eye, and how sharp each is."""

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path

from drivers.interfaces import Camera
from rigctl.devices.focus import focus_of, jpeg_of, middle
from rigctl.devices.rig import open_rig
from rigctl.devices.stages import SIMULATED, find_driver
from rigctl.files.rig_file import RigFile, load_rig, placeholder_doubt

_TIMEOUT_S = 10.0
_RIG_FILE = ".toml"
_EXAMPLE = "rig-sim.toml"


@dataclass(frozen=True, kw_only=True, eq=False)
class PreviewPicture:
    """A picture to look at, as a JPEG file, and its numbers in words."""

    jpeg: bytes
    text: str
    is_last: bool


@contextmanager
def open_camera(what: str) -> Iterator[Camera]:
    """Give the open camera of a rig file, or the one at an address such as ``gige:192.168.0.5``.

    A simulated camera sees what its rig file says; without one, the example rig's scene. No stage need be there.

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


def doubt_of(what: str) -> str | None:
    """Return in words what is not calibrated yet of a rig file; None where nothing is, or for a camera's address.

    Raises
    ------
    ConfigError
        The rig file is wrong.
    """
    return placeholder_doubt(load_rig(Path(what))) if what.endswith(_RIG_FILE) else None


def preview_pictures(
    camera: Camera, *, exposure_s: float, gain_db: float, zoom: int, frames: int | None
) -> Iterator[PreviewPicture]:
    """Set a camera, and return picture after picture, stretched for the eye.

    Parameters
    ----------
    camera : Camera
        Open.
    exposure_s : float
        Integration time [s].
    gain_db : float
        The camera's gain setting [dB].
    zoom : int
        The middle is shown, so many times larger; at least 1.
    frames : int or None
        How many pictures; None does not end.

    Raises
    ------
    DeviceError
        The camera fails.
    """
    camera.configure(exposure_s=exposure_s, gain_db=gain_db)
    return _pictures(camera, timeout_s=exposure_s + _TIMEOUT_S, zoom=zoom, frames=frames)


def _pictures(camera: Camera, *, timeout_s: float, zoom: int, frames: int | None) -> Iterator[PreviewPicture]:
    best = 0.0
    for number in itertools.count(1):
        frame = camera.take_frame(timeout_s=timeout_s)
        shown, bit_depth = middle(frame.counts, zoom=zoom), frame.settings.bit_depth
        focus = focus_of(shown, bit_depth=bit_depth)
        best = max(best, focus.sharpness)
        text = focus.text(best)
        jpeg = jpeg_of(shown, bit_depth=bit_depth, text=text)
        yield PreviewPicture(jpeg=jpeg, text=text, is_last=number == frames)
        if number == frames:
            return


def _with_address(rig: RigFile, address: str) -> RigFile:
    return rig.model_copy(update={"camera": rig.camera.model_copy(update={"address": address})})
