"""The cameras that the contract suite is run on, each opened by a function that gives it until its context is left."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from tempfile import TemporaryDirectory

from drivers.cameras.file_folder import open_folder
from drivers.cameras.gige import open_aravis, open_gige
from drivers.interfaces import Camera
from sim_devices.cameras.gige_server import serve_gige_camera
from tests.drivers.cameras.other_program import other_program
from tests.sim_devices.camera_builders import mosaic_camera, small_camera
from tests.sim_devices.cameras.gige_port import ADDRESS, gige_port, need_aravis
from tests.sim_devices.cameras.known_pictures import KnownPictures


def gige(options: str) -> Callable[[], AbstractContextManager[Camera]]:
    """Return what opens a GigE camera on this machine, of 782 x 582 pixels."""

    @contextmanager
    def opened() -> Iterator[Camera]:
        with gige_port(), serve_gige_camera(KnownPictures()), open_gige(f"{ADDRESS}?{options}") as camera:
            yield camera

    return opened


def in_library(options: str) -> Callable[[], AbstractContextManager[Camera]]:
    """Return what opens the camera that libaravis simulates within this program: not of a network, as USB ones are."""

    @contextmanager
    def opened() -> Iterator[Camera]:
        need_aravis()
        with open_aravis(f"Fake_1?width=512&height=512&{options}") as camera:
            yield camera

    return opened


@contextmanager
def filled_folder() -> Iterator[Camera]:
    """Give a folder into which another program writes DNG files all the time."""
    with TemporaryDirectory() as folder, other_program(Path(folder)), open_folder(f"{folder}?plane=red") as camera:
        yield camera


def camera_at(address: str) -> Camera:
    """Return the camera at an address that the user gave: DRIVER:PLACE."""
    scheme, _, place = address.partition(":")
    (driver,) = entry_points(group="rigctl.cameras", name=scheme)
    camera: Camera = driver.load()(place)
    return camera


CAMERAS: dict[str, Callable[[], AbstractContextManager[Camera]]] = {
    "simulated": small_camera,
    "dng-files": filled_folder,
    "gige-mono8": gige("pixel_format=Mono8"),
    "gige-mono12": gige("pixel_format=Mono12"),
    "gige-mono12packed": gige("pixel_format=Mono12Packed"),
    "gige-polarizemono12p": gige("pixel_format=PolarizeMono12p"),
    "mosaic": mosaic_camera,
    "fake-mono8": in_library("pixel_format=Mono8"),
    "fake-mono16": in_library("pixel_format=Mono16"),
    "gige-running": gige("pixel_format=Mono12&trigger=free&frame_rate_hz=30"),
}
