"""Every fault of a simulated GigE camera and its network, at every call: how does the driver react, and when?

A cell is right if its call ends in a picture that is bit for bit one that was sent, or in an error of the right type,
within its deadline and half a second.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from drivers.cameras.bounded_camera import BoundedCamera
from drivers.cameras.gige import open_gige
from drivers.errors import DeviceError, DeviceTimeoutError, NotConnectedError, ProtocolError
from sim_devices.cameras.gige_server import GigeFaults, serve_behind_network
from tests.sim_devices.cameras.camera_process import CameraProcess, camera_process
from tests.sim_devices.cameras.gige_port import ADDRESS
from tests.sim_devices.cameras.known_pictures import KnownPictures, is_known

GRACE_S = 0.5
Cell = tuple[str, bool]  # how the call ended, and whether that is right
_OPTIONS = "pixel_format=Mono12Packed&retakes=5"
_EXPOSURE_S = 0.002
# What each call is allowed; taking a picture is told by the caller, the others by the driver.
CALLS = {"open": 30.0, "set": 5.0, "take": 2.0, "tell": 3.0, "close": 2.0}
_GONE = (NotConnectedError, DeviceTimeoutError)


@dataclass(frozen=True, kw_only=True)
class CameraFault:
    """A fault; it strikes the camera's process just before the call, or is in its network from the start."""

    name: str
    strikes: Callable[[CameraProcess], None] | None = None
    faults: GigeFaults | None = None  #: of the network; such cameras are served in this process
    errors: tuple[type[DeviceError], ...] = ()  #: the right errors; if empty, every call has to succeed


def _restart(process: CameraProcess) -> None:
    process.kill()
    process.start()


CAMERA_FAULTS = (
    CameraFault(name="none", strikes=lambda _: None),
    CameraFault(name="silent from here on", strikes=CameraProcess.hang, errors=_GONE),
    CameraFault(name="its power goes here", strikes=CameraProcess.kill, errors=_GONE),
    CameraFault(name="its power goes and comes back here", strikes=_restart, errors=_GONE),
    CameraFault(name="0.1 % of packets lost, sent again", faults=GigeFaults(lost_share=0.001)),
    CameraFault(name="1 % of packets lost, sent again", faults=GigeFaults(lost_share=0.01)),
    CameraFault(name="5 % of packets lost, sent again", faults=GigeFaults(lost_share=0.05)),
    CameraFault(
        name="0.1 % of packets lost, not sent again",
        faults=GigeFaults(lost_share=0.001, resends=False),
        errors=(ProtocolError, DeviceTimeoutError),
    ),
    CameraFault(
        name="5 % of packets lost, not sent again",
        faults=GigeFaults(lost_share=0.05, resends=False),
        errors=(ProtocolError, DeviceTimeoutError),
    ),
)


@dataclass(frozen=True, kw_only=True)
class CameraOutcome:
    """How a call ended, after how long [s], and whether that is right."""

    word: str
    duration_s: float
    is_right: bool


def run_camera_cell(fault: CameraFault, call: str) -> CameraOutcome | None:
    """Return how a call ended; None where the camera could not be opened before, as the fault makes it."""
    with _place_of(fault) as (place, strike):
        if call == "open":
            strike()
            return _judged(fault, call, lambda: open_gige(place).close())
        try:
            camera = open_gige(place)
            camera.configure(exposure_s=_EXPOSURE_S, gain_db=0.0)
        except fault.errors:
            return None
        strike()
        try:
            return _judged(fault, call, lambda: _make(camera, call))
        finally:
            camera.close()


@contextmanager
def _place_of(fault: CameraFault) -> Iterator[tuple[str, Callable[[], None]]]:
    """Give the address of a camera, and what lets the fault strike."""
    if fault.faults is not None:
        with serve_behind_network(KnownPictures(), faults=fault.faults) as address:
            yield f"{address}?{_OPTIONS}", lambda: None
        return
    with camera_process() as process:
        yield f"{ADDRESS}?{_OPTIONS}", lambda: None if fault.strikes is None else fault.strikes(process)


def _make(camera: BoundedCamera, call: str) -> None:
    if call == "take":
        if not is_known(camera.take_frame(timeout_s=CALLS["take"]).counts):
            raise AssertionError("this picture was never sent")
    elif call == "set":
        camera.configure(exposure_s=2.0 * _EXPOSURE_S, gain_db=1.0)
    elif call == "tell":
        camera.features()
    else:
        camera.close()


def _judged(fault: CameraFault, call: str, make: Callable[[], None]) -> CameraOutcome:
    start_s = time.monotonic()
    word, is_right = "right", True
    try:
        make()
    except DeviceError as error:
        word, is_right = type(error).__name__.removesuffix("Error"), isinstance(error, fault.errors)
    except AssertionError as error:
        word, is_right = str(error), False
    duration_s = time.monotonic() - start_s
    return CameraOutcome(word=word, duration_s=duration_s, is_right=is_right and duration_s <= CALLS[call] + GRACE_S)


def camera_rows() -> Iterator[tuple[str, list[Cell]]]:
    """Yield each fault with its cells."""
    for fault in CAMERA_FAULTS:
        outcomes = [run_camera_cell(fault, call) for call in CALLS]
        yield (
            fault.name,
            [("not reached", True) if o is None else (f"{o.word}; {o.duration_s:.1f} s", o.is_right) for o in outcomes],
        )
