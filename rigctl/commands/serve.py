"""``rigctl serve``: the rig in a browser, with hands."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.commands.watch import place_of, tell


def command(
    rig: Annotated[str, typer.Argument(metavar="RIG.toml|ADDRESS", help="Rig file, or a camera's address.")],
    sessions: Annotated[Path, typer.Option(metavar="DIR", help="Folder of session files.")] = Path(),
    runs: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the runs; it must be there.")] = Path(),
    listen: Annotated[
        str, typer.Option(metavar="ADDRESS:PORT", help="Where the page is; 0.0.0.0:8765 lets a telephone in too.")
    ] = "127.0.0.1:0",
    certificate: Annotated[Path | None, typer.Option(metavar="FILE.pem", help="TLS certificate.")] = None,
    key: Annotated[Path | None, typer.Option(metavar="FILE.pem", help="Key of the certificate.")] = None,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in this machine's browser.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the addresses as one line of JSON.")] = False,
) -> None:
    """Focus, see polarization live, draw regions, start, hold and stop sessions from a browser.

    Two addresses are printed: with the one a person may look, with the other act as well. A session runs in a process
    of its own and goes on without the page; where somebody has to cover the lens it holds, and the page says so.

    Example: rigctl serve examples/rig-sim.toml --sessions examples --runs runs --listen 0.0.0.0:8765
    """
    from rigctl.jobs.serve import ServeRequest, serve

    place = place_of(listen, certificate, key)
    serve(
        ServeRequest(rig=rig, sessions=sessions, runs=runs),
        place,
        told=lambda addresses: tell(addresses, as_json, open_page),
    )
