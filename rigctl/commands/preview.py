"""``rigctl preview``: a live picture and its sharpness, for focusing."""

import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from rigctl.commands.watch import place_of
from rigctl.console.terminal import progress, results, warn
from rigctl.errors import ConfigError

_LINE_EACH_S = 1.0
_THIS_MACHINE = "127.0.0.1"


def command(
    camera: Annotated[
        str, typer.Argument(metavar="RIG.toml|ADDRESS", help="Rig file, or a camera's address as it stands in one.")
    ],
    exposure_ms: Annotated[float, typer.Option(metavar="MS", help="Exposure.")] = 10.0,
    gain_db: Annotated[float, typer.Option(metavar="DB", help="Gain.")] = 0.0,
    zoom: Annotated[int, typer.Option(metavar="N", min=1, max=64, help="Show the middle, N times larger.")] = 1,
    listen: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="Where the page is; 0.0.0.0:8765 lets a telephone in too.")
    ] = f"{_THIS_MACHINE}:8765",
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE.jpg", help="Write the picture there, again and again; no page.")
    ] = None,
    frames: Annotated[int | None, typer.Option(metavar="N", min=1, help="End after so many pictures.")] = None,
) -> None:
    """Show what a camera sees, with a number that is largest where the picture is sharpest, until Ctrl-C.

    Open the page that is printed in a browser, turn the lens, and stop where the number was best. It is the page of
    `rigctl serve` at its camera: exposure, gain and zoom can be changed there. Saturated pixels are red. The picture is
    stretched for the eye: nothing is measured with it, and no stage is needed or moved.

    Example: rigctl preview sim:gc780 --exposure-ms 0.03
    """
    from rigctl.jobs.preview import PreviewRequest, doubt_of, preview_in_file, preview_on_page

    if exposure_ms <= 0:
        raise ConfigError(f"--exposure-ms: is {exposure_ms:g}; must be above 0")
    if (doubt := doubt_of(camera)) is not None:
        warn(doubt)
    request = PreviewRequest(camera=camera, exposure_s=exposure_ms / 1e3, gain_db=gain_db, zoom=zoom, frames=frames)
    if picture is None:
        lines = preview_on_page(request, place_of(listen, None, None), told=_told)
    else:
        lines = preview_in_file(request, picture, told=_told)
    said_s = float("-inf")
    try:
        with closing(lines):
            for line in lines:
                if line.is_last or time.monotonic() - said_s >= _LINE_EACH_S:
                    results().print(line.text, markup=False)
                    said_s = time.monotonic()
    except KeyboardInterrupt:
        sys.stderr.write("\n")


def _told(where: str) -> None:
    progress().print(f"the picture is at {where}; Ctrl-C ends it", markup=False)
