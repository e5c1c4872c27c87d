"""The rig in a browser: looking through the camera, drawing regions, starting sessions and asking them."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.devices.rig import open_rig
from rigctl.errors import ConfigError, RunFolderError
from rigctl.files.regions import Markers, regions_text
from rigctl.files.rig_file import PolarizerSection, load_rig
from rigctl.jobs.acquire import AcquireRequest, prepare_session, require_takeable
from rigctl.jobs.preview import NO_STAGE, open_camera_alone
from rigctl.outlines.markers import search_markers, stretched
from rigctl.runs.run_lock import writing_process
from rigctl.session.control import ask_process
from rigctl.storage.durable_file import write_durably
from rigctl.web.hands import Hands, Question, camera_acts, region_acts, session_acts, stage_acts
from rigctl.web.live_look import Cell, OpenDevices
from rigctl.web.live_rig import LiveRig
from rigctl.web.page import page_app
from rigctl.web.regions_page import sent_regions
from rigctl.web.server import Addresses, PageServer, Place
from rigctl.web.sources import RunsOfFolder

_RIG_FILE = ".toml"
_REGIONS_FILE = "regions.toml"


@dataclass(frozen=True, kw_only=True)
class ServeRequest:
    """A rig that is to be served.

    Attributes
    ----------
    rig : str
        Rig file, or a camera's address.
    sessions, runs : Path
        Folder of session files, and folder in which runs come to be.
    """

    rig: str
    sessions: Path
    runs: Path


def serve(request: ServeRequest, place: Place, *, told: Callable[[Addresses], None]) -> None:
    """Serve a page with hands until Ctrl-C. Sessions that it started go on without it.

    Parameters
    ----------
    request : ServeRequest
        What.
    place : Place
        Where the page is.
    told : callable
        Told its addresses once it is there.

    Raises
    ------
    ConfigError
        A file is wrong, a folder is missing, or nothing can listen at that place.
    """
    for name, folder in (("--sessions", request.sessions), ("--runs", request.runs)):
        if not folder.is_dir():
            raise ConfigError(f"{name} {folder}: there is no such folder")
    sessions = _Sessions(request)
    rig = LiveRig(lambda: open_devices(request.rig), polarizer_of(request.rig))
    regions = request.runs / _REGIONS_FILE
    drawing = region_acts(lambda body: write_regions(regions, body, rig.newest_counts()))
    acts = {**camera_acts(rig), **stage_acts(rig), **session_acts(sessions, rig), **drawing}
    hands = Hands(view=rig, acts=acts, session_names=sessions.names, regions_file=regions.name)
    server = PageServer(page_app(RunsOfFolder(request.runs), hands), place, can_act=True)
    told(server.addresses)
    server.run()


class _Sessions:
    """Session files of a folder, and the runs that they become."""

    def __init__(self, request: ServeRequest) -> None:
        self._request = request

    def names(self) -> tuple[str, ...]:
        """Return the session files by name; other files of the folder that cannot be one are left out."""
        if not self._request.rig.endswith(_RIG_FILE):
            return ()
        found = sorted(self._request.sessions.glob("*.toml"))
        return tuple(file.name for file in found if b"[[take]]" in file.read_bytes())

    def plan(self, name: str) -> str:
        """Return what a session will take, in words; or raise what refuses it."""
        prepared = prepare_session(self._acquire_request(name))
        found = require_takeable(prepared, self._new_run(name), at_ns=None, until_ns=None)
        need, steps = prepared.need, prepared.steps
        minutes, seconds = divmod(round(need.duration_s), 60)
        disk = "" if need.disk_bytes is None else f", {need.disk_bytes / 1e6:.0f} MB"
        kinds = ", ".join(f"{sum(step.kind == kind for step in steps)} {kind}" for kind in ("dark", "flat", "scene"))
        lines = [f"{name}: {len(steps)} frames ({kinds}), about {minutes} min {seconds} s{disk}"]
        doubts = (*prepared.picked.lines, *(doubt for doubt in prepared.doubts if doubt), *found.doubts)
        return "\n".join([*lines, *doubts, *found.light])

    def start(self, name: str) -> str:
        """Start the session of a file in a process of its own; return the name of its run."""
        self.plan(name)
        run = self._new_run(name)
        self._spawn("acquire", self._request.rig, str(self._file(name)), "--out", str(run), log=run)
        return run.name

    def ask(self, name: str, what: Question) -> None:
        """Ask something of the session of a run; one that has ended is gone on with in a process of its own."""
        run = self._run(name)
        process = writing_process(run)
        if process is not None:
            ask_process(run, process, "go on" if what == "resume" else what)
        elif what == "resume":
            self._spawn("resume", str(run), log=run)
        else:
            raise RunFolderError(f"{name}: no session writes into this run")

    def _spawn(self, *words: str, log: Path) -> None:
        """Start rigctl so that it outlives this page; what it says goes into a file beside the run."""
        with log.with_name(f"{log.name}.log").open("ab") as said:
            subprocess.Popen(
                [sys.executable, "-m", "rigctl", *words, "--ask", "hold"],
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
                start_new_session=True,
            )

    def _acquire_request(self, name: str) -> AcquireRequest:
        return AcquireRequest(rig=Path(self._request.rig), session=self._file(name), asks_by_hold=True, picks=True)

    def _file(self, name: str) -> Path:
        if name not in self.names():
            raise ConfigError(f"{name!r}: there is no such session; there are {', '.join(self.names()) or 'none'}")
        return self._request.sessions / name

    def _run(self, name: str) -> Path:
        known = {path.name: path for path in self._request.runs.iterdir() if path.is_dir()}
        if name not in known:
            raise RunFolderError(f"{name!r}: there is no such run")
        return known[name]

    def _new_run(self, name: str) -> Path:
        return self._request.runs / f"{datetime.now(UTC):%Y-%m-%dT%H%M%SZ}-{Path(name).stem}"


@contextmanager
def open_devices(what: str) -> Iterator[OpenDevices]:
    """Give the open devices of a rig file, or the camera at an address alone, until the context is left.

    Raises
    ------
    DeviceError
        One cannot be opened.
    ConfigError
        The rig file is wrong, or there is no such driver.
    """
    if not what.endswith(_RIG_FILE):
        with open_camera_alone(what) as devices:
            yield devices
        return
    rig_file = load_rig(Path(what))
    axes_deg = rig_file.cell_deg
    cell = None if axes_deg is None else Cell(axes_deg=axes_deg, interpolation=rig_file.camera.interpolation)
    with open_rig(rig_file, session_name="live") as rig:
        rig.present("scene")
        yield OpenDevices(camera=rig.camera, stage=rig.stage, cell=cell)


def polarizer_of(what: str) -> PolarizerSection:
    """Return how the polarizer sits by a rig file; for a camera alone its angle is the stage's."""
    return load_rig(Path(what)).polarizer if what.endswith(_RIG_FILE) else NO_STAGE


def write_regions(file: Path, body: bytes, picture: NDArray[np.uint16] | None) -> str:
    """Write regions that a page sent, with the markers that the picture shows; return the name of the file.

    Regions that were there stay beside them as ``.bak``.

    Raises
    ------
    DataError
        They are no regions.
    """
    regions = sent_regions(body)
    seen = [] if picture is None else search_markers(stretched(picture), "4x4_50")
    if seen and regions.markers is None:
        regions = regions.model_copy(update={"markers": Markers(seen=seen)})
    if file.exists():
        file.replace(file.with_suffix(".toml.bak"))
    write_durably(file, regions_text(regions).encode())
    return file.name
