"""``rigctl watch``: a run in a browser, as it grows."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.json_text import json_text
from rigctl.console.terminal import progress, results
from rigctl.errors import ConfigError

if TYPE_CHECKING:
    from rigctl.web.server import Addresses, Place


def command(
    run: Annotated[
        Path, typer.Argument(metavar="RUN|FOLDER", help="Run folder, also one yet to come, or a folder of runs.")
    ],
    listen: Annotated[
        str, typer.Option(metavar="ADDRESS:PORT", help="Where the page is; 0.0.0.0:8765 lets a telephone in too.")
    ] = "127.0.0.1:0",
    certificate: Annotated[Path | None, typer.Option(metavar="FILE.pem", help="TLS certificate.")] = None,
    key: Annotated[Path | None, typer.Option(metavar="FILE.pem", help="Key of the certificate.")] = None,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in this machine's browser.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the addresses as one line of JSON.")] = False,
) -> None:
    """Show a run in a browser as it grows: frames, maps, curves, events; for a folder, the list of its runs.

    It only reads, in a process of its own, so that it can disturb no session. Whoever has the address that is printed
    may look; nobody else. Ctrl-C ends it.

    Example: rigctl watch runs/2026-05-04 --listen 0.0.0.0:8765
    """
    from rigctl.jobs.watch import watch

    watch(run, place_of(listen, certificate, key), told=lambda addresses: tell(addresses, as_json, open_page))


def place_of(listen: str, certificate: Path | None, key: Path | None) -> "Place":
    """Return where a page is, by its options.

    Raises
    ------
    ConfigError
        ``--listen`` is no address and port, or the key is missing.
    """
    from rigctl.web.server import Place

    host, _, port = listen.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise ConfigError(f"--listen {listen}: must be an address and a port, such as 127.0.0.1:8765")
    if (certificate is None) != (key is None):
        raise ConfigError("--certificate and --key belong together")
    return Place(host=host, port=int(port), certificate=certificate, key=key)


def tell(addresses: "Addresses", as_json: bool, open_page: bool) -> None:
    """Print where a page is, and open it where that is wanted."""
    import webbrowser
    from dataclasses import asdict

    if as_json:
        sys.stdout.write(json_text(asdict(addresses), indent=None))
        sys.stdout.flush()
    else:
        results().print(f"look  {addresses.look_url}")
        if addresses.act_url is not None:
            results().print(f"act   {addresses.act_url}")
        progress().print("whoever has an address may use it; Ctrl-C ends the page")
        if addresses.is_for_others and progress().is_terminal:
            from rigctl.web.qr_code import qr_text

            progress().print(qr_text(addresses.act_url or addresses.look_url), markup=False, highlight=False)
    if open_page:
        webbrowser.open(addresses.act_url or addresses.look_url)
