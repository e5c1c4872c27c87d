"""The actions of a page: on the camera, the stage, sessions and regions.

A session runs in a process of its own and outlives the page. A name in a request is looked up among the known names; it
never becomes a path.
"""

import queue
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError

from rigctl.base.destination import replace_keeping
from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.errors import ConfigError, DataError, RunFolderError
from rigctl.files.regions import Markers, Region, RegionsFile, load_regions, regions_text
from rigctl.files.toml import describe
from rigctl.outlines import search_markers, stretched
from rigctl.runs.folder import writing_process
from rigctl.session.control import ask_process
from rigctl.session.plan import estimate
from rigctl.session.preparation import PreparedSession, prepare_session, require_takeable
from rigctl.web.page import Act, Actions, page_app
from rigctl.web.rig import REST, LiveRig, StillPicture, Task
from rigctl.web.run_reader import NoRuns
from rigctl.web.server import PageServer, Place

_RIG_FILE = ".toml"
_REGIONS_FILE = "regions.toml"
Question = Literal["hold", "resume", "stop"]
_TASK = TypeAdapter(Task)
# Bodies of one key each.
_TURN: TypeAdapter[dict[Literal["angle_deg"], float]] = TypeAdapter(
    Annotated[dict[Literal["angle_deg"], Annotated[float, Field(ge=-360.0, le=360.0)]], Field(min_length=1)]
)
_SESSION: TypeAdapter[dict[Literal["session"], str]] = TypeAdapter(
    Annotated[dict[Literal["session"], Annotated[str, Field(max_length=200)]], Field(min_length=1)]
)


class Sessions:
    """Session files of a folder, and their runs."""

    def __init__(self, rig: str, sessions: Path, runs: Path) -> None:
        self._rig, self._sessions, self._runs = rig, sessions, runs
        self.regions = runs / _REGIONS_FILE

    def names(self) -> tuple[str, ...]:
        """Return the session files of the folder by name."""
        if not self._rig.endswith(_RIG_FILE):
            return ()
        return tuple(file.name for file in sorted(self._sessions.glob("*.toml")) if _is_session(file))

    def drawn(self) -> Sequence[Region]:
        """Return the regions that were drawn on this page; none if their file cannot be read."""
        try:
            return load_regions(self.regions) if self.regions.is_file() else ()
        except ConfigError:
            return ()

    def plan(self, name: str) -> str:
        """Return a text on frames, time and disk of a session; raise the error that would refuse it."""
        prepared = prepare_session(Path(self._rig), self._file(name), regions=self.regions if self.drawn() else None)
        doubts, light = require_takeable(prepared, self._new_run(name), asks_by_hold=True)
        return "\n".join([_need_text(name, prepared), *prepared.selected.lines, *prepared.doubts, *doubts, *light])

    def start(self, name: str) -> str:
        """Start the session of a file in a process of its own; return the name of its run."""
        self.plan(name)
        run = self._new_run(name)
        drawn = ("--regions", str(self.regions)) if self.drawn() else ()
        self._spawn("acquire", self._rig, str(self._file(name)), "--out", str(run), *drawn, log=run)
        return run.name

    def ask(self, name: str, what: Question) -> None:
        """Send a request to the session of a run; a session that has ended is resumed in a process of its own."""
        run = self._run(name)
        process = writing_process(run)
        if process is not None:
            ask_process(run, process, "continue" if what == "resume" else what)
        elif what == "resume":
            self._spawn("resume", str(run), log=run)
        else:
            raise RunFolderError(f"{name}: no session writes into this run")

    def _spawn(self, *words: str, log: Path) -> None:
        """Start rigctl in a process that outlives this page; its output goes into a file next to the run."""
        with log.with_name(f"{log.name}.log").open("ab") as output:
            subprocess.Popen(
                [sys.executable, "-m", "rigctl", *words, "--ask", "hold"],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )

    def _file(self, name: str) -> Path:
        if name not in self.names():
            raise ConfigError(f"{name!r}: there is no such session; there are {', '.join(self.names()) or 'none'}")
        return self._sessions / name

    def _run(self, name: str) -> Path:
        known = {path.name: path for path in self._runs.iterdir() if path.is_dir()}
        if name not in known:
            raise RunFolderError(f"{name!r}: there is no such run")
        return known[name]

    def _new_run(self, name: str) -> Path:
        return self._runs / f"{datetime.now(UTC):%Y-%m-%dT%H%M%SZ}-{Path(name).stem}"


def _is_session(file: Path) -> bool:
    """Return whether a path is a session file; dangling links, folders and pipes are not."""
    try:
        return b"[[take]]" in read_bounded(file, MOST_TEXT_BYTES)
    except OSError:
        return False


def _need_text(name: str, prepared: PreparedSession) -> str:
    steps = prepared.steps
    duration_s, disk_bytes = estimate(steps, prepared.rig_file)
    minutes, seconds = divmod(round(duration_s), 60)
    disk = "" if disk_bytes is None else f", {disk_bytes / 1e6:.0f} MB"
    kinds = ", ".join(f"{sum(step.kind == kind for step in steps)} {kind}" for kind in ("dark", "flat", "scene"))
    regions = ", ".join(region.name for region in prepared.session_file.regions)
    watched = f"; regions {regions}" if regions else ""
    return f"{name}: {len(steps)} frames ({kinds}), about {minutes} min {seconds} s{disk}{watched}"


def camera_acts(rig: LiveRig) -> Mapping[str, Act]:
    """Return the action on a camera: begin a task."""

    def begin(_: str, body: bytes) -> dict[str, str]:
        task = _TASK.validate_json(body)
        rig.begin(task)
        return {"done": task.kind}

    return {"task": begin}


def stage_acts(rig: LiveRig) -> Mapping[str, Act]:
    """Return the actions on a rotating polarizer: turn it, and take the dark level for maps."""

    def turn(_: str, body: bytes) -> dict[str, str]:
        rig.turn(_TURN.validate_json(body)["angle_deg"])
        return {"done": "turning"}

    def take_dark(*_: object) -> dict[str, str]:
        rig.take_dark()
        return {"done": "dark level taken"}

    return {"turn": turn, "dark": take_dark}


def session_acts(sessions: Sessions, rig: LiveRig) -> Mapping[str, Act]:
    """Return the actions on sessions: hold, resume, stop, plan, and start after the page has closed the devices."""

    def requesting(what: Question) -> Act:
        def ask(run: str, _: bytes) -> dict[str, str]:
            sessions.ask(run, what)
            return {"done": f"{what} requested"}

        return ask

    def plan(_: str, body: bytes) -> dict[str, str]:
        return {"plan": sessions.plan(_SESSION.validate_json(body)["session"])}

    def start(_: str, body: bytes) -> dict[str, str]:
        name = _SESSION.validate_json(body)["session"]
        rig.begin(REST)
        return {"run": sessions.start(name)}

    return {
        "hold": requesting("hold"),
        "resume": requesting("resume"),
        "stop": requesting("stop"),
        "plan": plan,
        "start": start,
    }


def region_acts(file: Path, newest_counts: Callable[[], NDArray[np.uint16] | None]) -> Mapping[str, Act]:
    """Return the action on regions: write them into a file, with the markers in the newest picture.

    An existing file is kept as ``.bak``, ``.bak2`` and so on.
    """

    def write(_: str, body: bytes) -> dict[str, str]:
        regions, picture = _sent_regions(body), newest_counts()
        seen = [] if picture is None else search_markers(stretched(picture), "4x4_50")
        if seen and regions.markers is None:
            regions = regions.model_copy(update={"markers": Markers(seen=seen)})
        replace_keeping(file, regions_text(regions).encode())
        return {"file": file.name}

    return {"regions": write}


class RegionsPage:
    """A page with one picture, served to this machine until it sends regions."""

    def __init__(
        self, picture: NDArray[np.uint8], *, drawn: list[Region], title: str, file: str, port: int = 0
    ) -> None:
        self._file, self._sent = file, queue.SimpleQueue[RegionsFile]()
        actions = Actions(
            view=StillPicture(picture),
            acts={"regions": self._take},
            title=title,
            drawn=lambda: drawn,
            regions_file=file,
            is_once=True,
        )
        self._server = PageServer(page_app(NoRuns(), actions), Place(port=port), can_act=True)

    @property
    def address(self) -> str:
        """Address of the page."""
        return self._server.addresses.act_url or ""

    def wait(self, *, seconds: float) -> RegionsFile:
        """Return the regions that were drawn; raise DataError if none are sent in time."""
        with self._server:
            try:
                return self._sent.get(timeout=seconds)
            except queue.Empty:
                minutes = seconds / 60.0
                raise DataError(f"no regions were sent from {self.address} within {minutes:g} minutes") from None

    def _take(self, _: str, body: bytes) -> dict[str, str]:
        self._sent.put(_sent_regions(body))
        return {"file": self._file}


def _sent_regions(body: bytes) -> RegionsFile:
    """Return regions that a page sent as JSON."""
    try:
        return RegionsFile.model_validate_json(body)
    except ValidationError as error:
        raise DataError(describe(Path("regions"), error)) from error
