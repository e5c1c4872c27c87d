"""`rigctl serve`: a rig, a run or the runs of a folder in a browser."""

import re
import subprocess
import sys
import webbrowser
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from rigctl.console import Json, note, progress
from rigctl.errors import ConfigError, RunFolderError
from rigctl.verbs.options import FilePath
from rigctl.verbs.result import Part, Result

if TYPE_CHECKING:
    from rigctl.files.regions import Region
    from rigctl.session.preparation import PreparedSession
    from rigctl.web.page import Question
    from rigctl.web.server import Addresses, PageServer, Place

_RIG_FILE = ".toml"
_REGIONS_FILE = "regions.toml"
# Beside the runs, for this user's eyes alone.
_TOKENS_FILE = ".rigctl-page.json"
# Such as gige:192.168.0.5; a run may be named by a time.
_ADDRESS = re.compile(r"[A-Za-z][\w-]*:")


def serve(
    what: str,
    /,
    *,
    sessions: FilePath | None = None,
    runs: FilePath | None = None,
    listen: str = "127.0.0.1:0",
    certificate: FilePath | None = None,
    key: FilePath | None = None,
    new_tokens: bool = False,
    open_page: Annotated[bool, Parameter(name="--open")] = False,
) -> "ServedPage":
    """Serve a page in the browser: operate a rig, draw regions, or watch a run while it is taken.

    For a rig, two addresses are printed: one to look only, and one to operate it as well. A session runs in its own
    process and continues if the page ends. It holds where the lens has to be covered, and the page says so. For a run,
    the page shows frames, maps, curves and events; for a folder, the list of its runs. Then it only reads and disturbs
    no session. Ctrl-C ends the page.

    Example: rigctl serve examples/rig-sim.toml --sessions examples --runs runs --listen 0.0.0.0:8765

    Example: rigctl serve runs/2026-05-04 --listen 0.0.0.0:8765

    Parameters
    ----------
    what : str
        Rig file, address of a camera, run folder (it need not exist yet) or folder of runs.
    sessions : path
        With a rig: folder of session files; default: this folder.
    runs : path
        With a rig: folder for runs; default: this folder.
    listen : str
        Address and port of the page; with 0.0.0.0:8765, other devices such as a phone can open it.
    certificate : path
        File with a TLS certificate, for https.
    key : path
        File with the key of the certificate.
    new_tokens : bool
        Make new addresses; the old ones stop working.
    open_page : bool
        Open the page in this machine's browser.

    Returns
    -------
    ServedPage
        Addresses of the page; `.follow` answers until Ctrl-C.

    Raises
    ------
    ConfigError
        A file is wrong, a folder is missing, or nothing can listen at that address.
    """
    from rigctl.web.page import page_app
    from rigctl.web.run_reader import RunsOfFolder, source_at
    from rigctl.web.server import PageServer, place_of

    what = str(what)
    place = place_of(listen, None if certificate is None else Path(certificate), None if key is None else Path(key))
    if what.endswith(_RIG_FILE) or (_ADDRESS.match(what) and not Path(what).exists()):
        server = _rig_server(what, Path(sessions or "."), Path(runs or "."), place, new_tokens=new_tokens)
    elif sessions is not None or runs is not None:
        raise ConfigError("--sessions, --runs: are for a rig; a page of runs starts no session")
    else:
        source, path = source_at(Path(what)), Path(what)
        kept = (path if isinstance(source, RunsOfFolder) else path.resolve().parent) / _TOKENS_FILE
        server = PageServer(page_app(source), place, can_act=False, kept=kept, is_new=new_tokens)
    note("everybody who has an address may use it; Ctrl-C ends the page")
    if open_page:
        webbrowser.open(server.addresses.act_url or server.addresses.look_url)
    return ServedPage(server=server)


@dataclass(frozen=True, kw_only=True, eq=False)
class ServedPage(Result):
    """A page that listens; it answers in `follow`."""

    server: "PageServer"

    @property
    def addresses(self) -> "Addresses":
        """Addresses with their tokens, to look and, of a rig, to act."""
        return self.server.addresses

    def content(self) -> Iterable[Part]:
        """Return the addresses."""
        yield f"look  {self.addresses.look_url}"
        if self.addresses.act_url is not None:
            yield f"act   {self.addresses.act_url}"

    def as_json(self) -> dict[str, Json]:
        """Return the addresses."""
        return asdict(self.addresses)

    def show_json(self) -> None:
        """Print the addresses in one line, for a program that reads it while the page is served."""
        from rigctl.console import json_text

        sys.stdout.write(json_text(self.as_json(), indent=None))

    def follow(self) -> None:
        """Answer until Ctrl-C."""
        if self.addresses.is_for_others and progress().is_terminal:
            from rigctl.web.server import qr_text

            code = qr_text(self.addresses.act_url or self.addresses.look_url)
            progress().print(code, markup=False, highlight=False)
        self.server.run()


def _rig_server(rig: str, sessions: Path, runs: Path, place: "Place", *, new_tokens: bool) -> "PageServer":
    """Return the server of a rig: its page acts on camera, stage, regions and sessions."""
    from rigctl.web.page import Actions, camera_acts, page_app, region_acts, session_acts, stage_acts
    from rigctl.web.regions_page import write_regions
    from rigctl.web.rig import LiveRig
    from rigctl.web.run_reader import RunsOfFolder
    from rigctl.web.server import PageServer

    if not sessions.is_dir():
        raise ConfigError(f"--sessions {sessions}: there is no such folder")
    own = _Sessions(rig, sessions, runs)
    live = LiveRig(rig)
    try:
        runs.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"--runs {runs}: cannot be made: {error.strerror}") from error
    regions = runs / _REGIONS_FILE
    drawing = region_acts(lambda body: write_regions(regions, body, live.newest_counts()))
    acts = {**camera_acts(live), **stage_acts(live), **session_acts(own, live), **drawing}
    actions = Actions(view=live, acts=acts, session_names=own.names, drawn=own.drawn, regions_file=regions.name)
    page = page_app(RunsOfFolder(runs), actions)
    return PageServer(page, place, can_act=True, kept=runs / _TOKENS_FILE, is_new=new_tokens)


class _Sessions:
    """Session files of a folder, and the runs that they become."""

    def __init__(self, rig: str, sessions: Path, runs: Path) -> None:
        self._rig, self._sessions, self._runs = rig, sessions, runs
        self._regions = runs / _REGIONS_FILE

    def names(self) -> tuple[str, ...]:
        """Return the session files by name; other files of the folder are left out."""
        if not self._rig.endswith(_RIG_FILE):
            return ()
        return tuple(file.name for file in sorted(self._sessions.glob("*.toml")) if _is_session(file))

    def drawn(self) -> "Sequence[Region]":
        """Return the regions that were drawn here; none where their file cannot be read."""
        from rigctl.files.regions import load_regions

        try:
            return load_regions(self._regions) if self._regions.is_file() else ()
        except ConfigError:
            return ()

    def plan(self, name: str) -> str:
        """Return frames, time and disk of a session in words; or raise what refuses it."""
        from rigctl.session.preparation import prepare_session, require_takeable

        prepared = prepare_session(Path(self._rig), self._file(name), regions=self._regions if self.drawn() else None)
        doubts, light = require_takeable(prepared, self._new_run(name), asks_by_hold=True)
        return "\n".join([_need_text(name, prepared), *prepared.picked.lines, *prepared.doubts, *doubts, *light])

    def start(self, name: str) -> str:
        """Start the session of a file in a process of its own; return the name of its run."""
        self.plan(name)
        run = self._new_run(name)
        drawn = ("--regions", str(self._regions)) if self.drawn() else ()
        self._spawn("acquire", self._rig, str(self._file(name)), "--out", str(run), *drawn, log=run)
        return run.name

    def ask(self, name: str, what: "Question") -> None:
        """Send a request to the session of a run; an ended session is resumed in a process of its own."""
        from rigctl.runs.folder import writing_process
        from rigctl.session.control import ask_process

        run = self._run(name)
        process = writing_process(run)
        if process is not None:
            ask_process(run, process, "go on" if what == "resume" else what)
        elif what == "resume":
            self._spawn("resume", str(run), log=run)
        else:
            raise RunFolderError(f"{name}: no session writes into this run")

    def _spawn(self, *words: str, log: Path) -> None:
        """Start rigctl so that it outlives this page; its output goes into a file beside the run."""
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
    """Return whether a file of the folder is for a session; links to nowhere, folders and pipes are not."""
    from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded

    try:
        return b"[[take]]" in read_bounded(file, MOST_TEXT_BYTES)
    except OSError:
        return False


def _need_text(name: str, prepared: "PreparedSession") -> str:
    from rigctl.session.plan import estimate

    steps = prepared.steps
    duration_s, disk_bytes = estimate(steps, prepared.rig_file)
    minutes, seconds = divmod(round(duration_s), 60)
    disk = "" if disk_bytes is None else f", {disk_bytes / 1e6:.0f} MB"
    kinds = ", ".join(f"{sum(step.kind == kind for step in steps)} {kind}" for kind in ("dark", "flat", "scene"))
    regions = ", ".join(region.name for region in prepared.session_file.regions)
    watched = f"; regions {regions}" if regions else ""
    return f"{name}: {len(steps)} frames ({kinds}), about {minutes} min {seconds} s{disk}{watched}"
