"""`rigctl serve`: a rig, a run or the runs of a folder in a browser."""

import re
import sys
import webbrowser
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from rigctl.console import Json, note, progress
from rigctl.errors import ConfigError
from rigctl.verbs.options import FilePath, Part, Result

if TYPE_CHECKING:
    from rigctl.web.server import Addresses, PageServer, Place

_RIG_FILE = ".toml"
# File next to the runs, readable only by this user.
_TOKENS_FILE = ".rigctl-page.json"
# Address of a camera, such as gige:192.168.0.5; a run may be named by a time with colons.
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
    """A page that listens, and answers in `follow`."""

    server: "PageServer"

    @property
    def addresses(self) -> "Addresses":
        """Addresses with tokens: to look and, for a rig, to act."""
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
        """Print the addresses in one line, for programs that read it while the page is served."""
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
    """Return the server of a rig, whose page operates camera, stage, regions and sessions."""
    from rigctl.web.acts import Sessions, camera_acts, region_acts, session_acts, stage_acts
    from rigctl.web.page import Actions, page_app
    from rigctl.web.rig import LiveRig
    from rigctl.web.run_reader import RunsOfFolder
    from rigctl.web.server import PageServer

    if not sessions.is_dir():
        raise ConfigError(f"--sessions {sessions}: there is no such folder")
    own, live = Sessions(rig, sessions, runs), LiveRig(rig)
    try:
        runs.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"--runs {runs}: cannot be made: {error.strerror}") from error
    drawing = region_acts(own.regions, live.newest_counts)
    acts = {**camera_acts(live), **stage_acts(live), **session_acts(own, live), **drawing}
    actions = Actions(view=live, acts=acts, session_names=own.names, drawn=own.drawn, regions_file=own.regions.name)
    page = page_app(RunsOfFolder(runs), actions)
    return PageServer(page, place, can_act=True, kept=runs / _TOKENS_FILE, is_new=new_tokens)
