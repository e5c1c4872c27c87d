"""Sessions over a network that loses packets: is every stored frame whole, and how does each session end?

Each picture holds its own number, and is noise that follows from it, so that every stored frame can be held against
what was sent, bit for bit. The stage is there at once; the camera is the simulated one, behind its driver and UDP
packets.
"""

import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.cameras.aravis import load_aravis
from drivers.cameras.bounded_camera import BoundedCamera
from drivers.cameras.gige import open_gige
from drivers.errors import DeviceError, NotConnectedError
from drivers.interfaces import CameraSettings, DeviceIdentity, Frame, Move, StagePosition, StageStatus
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.rig.rig import Rig
from rigctl.runs.folder import Run, read_run
from rigctl.runs.records import EVENTS_FILE
from rigctl.session.take import take_session
from sim_devices.cameras.gige_server import GigeFaults, serve_behind_network, serve_gige_camera

ADDRESS = "127.0.0.1"
PLACE = f"{ADDRESS}?pixel_format=Mono12Packed"
WIDTH, HEIGHT, BIT_DEPTH = 782, 582, 12
EXPOSURE_MS = 2.0
# Share of packets lost, and whether the camera sends them again on request.
_LOSSES = ((0.0, False), (1e-4, False), (1e-3, False), (1e-2, False), (0.01, True), (0.05, True))
_RIG = {
    "name": "lossy network",
    "stage": {"driver": "none", "port": "none"},
    "polarizer": {"sense": 1, "offset_deg": 0.0},
    "camera": {"address": f"gige:{PLACE}"},
}
_TOP = 2**BIT_DEPTH
_NOISE = np.random.default_rng(1).integers(0, _TOP, (HEIGHT, WIDTH), dtype=np.uint16)


class NumberedPictures:
    """A source of pictures that follow from their number."""

    def __init__(self) -> None:
        self._number = 0
        self.configure(exposure_s=EXPOSURE_MS / 1e3, gain_db=0.0)

    def __enter__(self) -> "NumberedPictures":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        return DeviceIdentity(model="numbered pictures", serial_number="1", firmware="none")

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        self._settings = CameraSettings(
            exposure_s=exposure_s, gain_db=gain_db, width=WIDTH, height=HEIGHT, bit_depth=BIT_DEPTH
        )
        return self._settings

    def take_frame(self, *, timeout_s: float) -> Frame:
        self._number += 1
        return Frame(
            counts=picture(self._number),
            settings=self._settings,
            sequence=self._number,
            start_utc_ns=0,
            end_utc_ns=0,
            start_monotonic_ns=0,
        )

    def close(self) -> None:
        pass


class StillStage:
    """A stage that is where it was sent to at once."""

    def __enter__(self) -> "StillStage":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        return DeviceIdentity(model="still", serial_number="1", firmware="none")

    def home(self) -> StagePosition:
        return self.position()

    def move_to(self, angle_deg: float, *, way: str = "short") -> Move:
        position = StagePosition(angle_deg=angle_deg, counts=0)
        return Move(target_deg=angle_deg, position=position, tries=1, duration_s=0.0)

    def position(self) -> StagePosition:
        return StagePosition(angle_deg=0.0, counts=0)

    def status(self) -> StageStatus:
        return StageStatus(moving=False, homed=True, code=0, meaning="ok")

    def stop(self) -> None:
        pass

    def close(self) -> None:
        pass


def picture(number: int) -> NDArray[np.uint16]:
    """Return the picture of a number."""
    counts: NDArray[np.uint16] = (_NOISE + np.uint16(13 * number % _TOP)) % np.uint16(_TOP)
    counts[0, 0] = number % _TOP
    return counts


@contextmanager
def _lossy_camera(lost_share: float, *, resends: bool) -> Iterator[BoundedCamera]:
    """Give a camera whose network loses packets: from the start where they are sent again, else once it is open."""
    if resends:
        with (
            serve_behind_network(NumberedPictures(), faults=GigeFaults(lost_share=lost_share)) as address,
            open_gige(PLACE.replace(ADDRESS, address)) as camera,
        ):
            yield camera
        return
    with serve_gige_camera(NumberedPictures(), address=ADDRESS) as device, open_gige(PLACE) as camera:
        device.lose_packets(lost_share)
        yield camera


@contextmanager
def lossy_rig(lost_share: float, *, resends: bool) -> Iterator[Rig]:
    """Give a rig whose network loses packets."""
    with _lossy_camera(lost_share, resends=resends) as camera:
        stage = StillStage()
        yield Rig(
            stage=stage,
            camera=camera,
            stage_identity=stage.identify(),
            camera_identity=camera.identify(),
            present=lambda _: None,
            origin="device",
        )


def one_session(
    lost_share: float, *, resends: bool, frames: int, folder: Path
) -> tuple[str | None, int, int, dict[str, int]]:
    """Take a session; return its error, how many frames are stored and broken, and what became of the pictures."""
    take = {"kind": "scene", "exposure_ms": EXPOSURE_MS, "cycles": frames // 4}
    session = SessionFile.model_validate({"name": "lossy network", "take": [take]})
    error = None
    try:
        opener = partial(lossy_rig, lost_share, resends=resends)
        take_session(RigFile.model_validate(_RIG), session, folder, files={}, opener=opener)
    except DeviceError as failure:
        error = f"{type(failure).__name__}: {failure}"
    run = read_run(folder)
    broken = sum(not np.array_equal(counts, picture(int(counts[0, 0]))) for counts in map(run.counts, run.frames))
    return error, len(run.frames), broken, _tally(run)


def _tally(run: Run) -> dict[str, int]:
    events = [json.loads(line) for line in (run.path / EVENTS_FILE).read_text().splitlines()]
    return dict(next(event["facts"] for event in reversed(events) if event["event"] == "camera tally"))


def run_losses(*, frames: int = 100) -> bool:
    """Take a session for each share of lost packets and print how it ended; return whether no frame is broken."""
    if (reason := why_no_camera()) is not None:
        print(f"not run: {reason}")
        return True
    broken = 0
    for share, resends in _LOSSES:
        with tempfile.TemporaryDirectory() as folder:
            error, stored, bad, tally = one_session(share, resends=resends, frames=frames, folder=Path(folder) / "run")
        broken += bad
        print(
            f"{100 * share:g} % lost, {'' if resends else 'not '}sent again: {stored} of {frames} frames stored, {bad} "
            f"broken; {tally['damaged']} damaged and {tally['never_came']} missing pictures taken again; "
            f"{tally['packets_lost']} of {tally['packets']} packets lost, {tally['packets_resent']} sent again; "
            f"{error or 'complete'}"
        )
    return broken == 0


def why_no_camera() -> str | None:
    """Return why no GigE camera can be simulated on this machine's network, or None."""
    try:
        load_aravis()
    except NotConnectedError as error:
        return str(error)
    return None
