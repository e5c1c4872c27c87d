"""Sessions over a network that loses packets: is every stored frame whole, and how does each session end?

Every picture is known bit for bit. The stage is there at once; the camera is a simulated one, behind its driver and the
network.
"""

import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from drivers.cameras.aravis import load_aravis
from drivers.cameras.bounded_camera import BoundedCamera
from drivers.cameras.gige import open_gige
from drivers.errors import DeviceError, NotConnectedError
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.rig.rig import Rig
from rigctl.runs.folder import Run, read_run
from rigctl.runs.records import EVENTS_FILE
from rigctl.session.take import take_session
from sim_devices.cameras.gige_server import GigeFaults, serve_behind_network, serve_gige_camera
from tests.sim_devices.cameras.known_pictures import KnownPictures, is_known, marking_rig

ADDRESS = "127.0.0.1"
PLACE = f"{ADDRESS}?pixel_format=Mono12Packed"
EXPOSURE_MS = 2.0
# Share of packets lost, and whether the camera sends them again on request.
_LOSSES = ((0.0, False), (1e-4, False), (1e-3, False), (1e-2, False), (0.01, True), (0.05, True))
_RIG = {
    "name": "lossy network",
    "stage": {"driver": "none", "port": "none"},
    "polarizer": {"sense": 1, "offset_deg": 0.0},
    "camera": {"address": f"gige:{PLACE}"},
}


@contextmanager
def _lossy_camera(source: KnownPictures, lost_share: float, *, resends: bool) -> Iterator[BoundedCamera]:
    """Give a camera whose network loses packets: from the start where they are sent again, else once it is open."""
    if resends:
        with (
            serve_behind_network(source, faults=GigeFaults(lost_share=lost_share)) as address,
            open_gige(PLACE.replace(ADDRESS, address)) as camera,
        ):
            yield camera
        return
    with serve_gige_camera(source, address=ADDRESS) as device, open_gige(PLACE) as camera:
        device.lose_packets(lost_share)
        yield camera


@contextmanager
def lossy_rig(lost_share: float, *, resends: bool) -> Iterator[Rig]:
    """Give a rig whose network loses packets."""
    source = KnownPictures()
    with _lossy_camera(source, lost_share, resends=resends) as camera, marking_rig(source, camera) as rig:
        yield rig


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
    broken = sum(not is_known(run.counts(record)) for record in run.frames)
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
