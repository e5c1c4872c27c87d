"""Looking through a camera while the lens is turned: pictures for the eye, and how sharp each is."""

import itertools
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path

from drivers.interfaces import Camera
from rigctl.devices.focus import Focus, focus_of, jpeg_of, middle
from rigctl.devices.rig import open_rig
from rigctl.devices.stages import SIMULATED, find_driver
from rigctl.errors import ConfigError
from rigctl.files.rig_file import PolarizerSection, RigFile, load_rig, placeholder_doubt
from rigctl.storage.durable_file import write_durably
from rigctl.web.hands import Hands, camera_acts
from rigctl.web.live_look import OpenDevices, Task
from rigctl.web.live_rig import LiveRig
from rigctl.web.page import page_app
from rigctl.web.server import PageServer, Place
from rigctl.web.sources import NoRuns

_TIMEOUT_S = 10.0
_LOOK_EACH_S = 1.0
_RIG_FILE = ".toml"
_EXAMPLE = "rig-sim.toml"
# A camera alone has no stage, whose angles would have to be told.
NO_STAGE = PolarizerSection(sense=1, offset_deg=0.0)


@dataclass(frozen=True, kw_only=True)
class PreviewRequest:
    """A camera that is to be looked through.

    Attributes
    ----------
    camera : str
        Rig file, or a camera's address.
    exposure_s : float
        Integration time, above 0 [s].
    gain_db : float
        The camera's gain setting [dB].
    zoom : int
        The middle is shown, so many times larger; at least 1.
    frames : int or None
        How many pictures; None does not end.
    """

    camera: str
    exposure_s: float
    gain_db: float = 0.0
    zoom: int = 1
    frames: int | None = None


@dataclass(frozen=True, kw_only=True)
class PreviewLine:
    """Numbers of a picture in words."""

    text: str
    is_last: bool


def preview_on_page(request: PreviewRequest, place: Place, *, told: Callable[[str], None]) -> Generator[PreviewLine]:
    """Show what a camera sees on the page of `rigctl serve`, where its settings can be changed; return its numbers.

    Parameters
    ----------
    request : PreviewRequest
        What.
    place : Place
        Where the page is.
    told : callable
        Told the address of the page.

    Raises
    ------
    ConfigError
        Nothing can listen there, or a file is wrong.
    DeviceError
        The camera fails.
    """
    rig = LiveRig(lambda: open_camera_alone(request.camera), NO_STAGE)
    hands = Hands(view=rig, acts=camera_acts(rig), title=f"preview {_name_of(request.camera)}")
    task = Task(kind="preview", exposure_s=request.exposure_s, gain_db=request.gain_db, zoom=request.zoom)
    with PageServer(page_app(NoRuns(), hands), place, can_act=True) as server:
        told(server.addresses.act_url or "")
        rig.begin(task)
        try:
            yield from _lines(rig, request.frames)
        finally:
            rig.begin(Task())


def _name_of(camera: str) -> str:
    return Path(camera).name if camera.endswith(_RIG_FILE) else camera


def _lines(rig: LiveRig, frames: int | None) -> Generator[PreviewLine]:
    seen = 0
    while frames is None or seen < frames:
        look = rig.newer_look(seen, timeout_s=_LOOK_EACH_S)
        if look.width and look.sequence != seen:
            seen = look.sequence
            focus = Focus(sharpness=look.sharpness, brightest=look.brightest, saturated=look.clipped)
            yield PreviewLine(text=focus.text(look.best_sharpness), is_last=frames is not None and seen >= frames)


def preview_in_file(request: PreviewRequest, file: Path, *, told: Callable[[str], None]) -> Generator[PreviewLine]:
    """Write what a camera sees into a file, stretched for the eye, picture after picture; return its numbers.

    Parameters
    ----------
    request : PreviewRequest
        What.
    file : Path
        JPEG file.
    told : callable
        Told where the file is, once the camera is open.

    Raises
    ------
    ConfigError
        The file cannot be written, or a file is wrong.
    DeviceError
        The camera fails.
    """
    best = 0.0
    with open_camera(request.camera) as camera:
        told(str(file))
        camera.configure(exposure_s=request.exposure_s, gain_db=request.gain_db)
        for number in itertools.count(1):
            frame = camera.take_frame(timeout_s=request.exposure_s + _TIMEOUT_S)
            shown, bit_depth = middle(frame.counts, zoom=request.zoom), frame.settings.bit_depth
            focus = focus_of(shown, bit_depth=bit_depth)
            best = max(best, focus.sharpness)
            text = focus.text(best)
            _write(file, jpeg_of(shown, bit_depth=bit_depth, text=text))
            yield PreviewLine(text=text, is_last=number == request.frames)
            if number == request.frames:
                return


def _write(file: Path, jpeg: bytes) -> None:
    try:
        write_durably(file, jpeg)
    except OSError as error:
        raise ConfigError(f"--picture {file}: cannot be written: {error.strerror}") from error


@contextmanager
def open_camera_alone(what: str) -> Iterator[OpenDevices]:
    """Give a camera as in `open_camera`, without a stage."""
    with open_camera(what) as camera:
        yield OpenDevices(camera=camera, stage=None)


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


def _with_address(rig: RigFile, address: str) -> RigFile:
    return rig.model_copy(update={"camera": rig.camera.model_copy(update={"address": address})})
