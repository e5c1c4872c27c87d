"""``rigctl preview``: a live picture and its sharpness, for focusing."""

import sys
import time
from collections.abc import Iterable
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.commands.watch import place_of
from rigctl.console.terminal import progress, results, warn
from rigctl.errors import ConfigError
from rigctl.storage.durable_file import write_durably

if TYPE_CHECKING:
    from rigctl.jobs.preview import PreviewPicture
    from rigctl.web.preview_page import PreviewPage

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

    Open the page that is printed in a browser, turn the lens, and stop where the number was best. Saturated pixels are
    red. The picture is stretched for the eye: nothing is measured with it, and no stage is needed or moved.

    Example: rigctl preview sim:gc780 --exposure-ms 0.03
    """
    from rigctl.jobs.preview import doubt_of, open_camera, preview_pictures
    from rigctl.web.preview_page import PreviewPage

    if exposure_ms <= 0:
        raise ConfigError(f"--exposure-ms: is {exposure_ms:g}; must be above 0")
    if (doubt := doubt_of(camera)) is not None:
        warn(doubt)
    page = None if picture is not None else PreviewPage(place_of(listen, None, None))
    with page or nullcontext(), open_camera(camera) as opened:
        pictures = preview_pictures(opened, exposure_s=exposure_ms / 1e3, gain_db=gain_db, zoom=zoom, frames=frames)
        where = str(picture) if page is None else page.address
        progress().print(f"the picture is at {where}; Ctrl-C ends it", markup=False)
        try:
            _show(pictures, page, picture)
        except KeyboardInterrupt:
            sys.stderr.write("\n")


def _show(pictures: Iterable["PreviewPicture"], page: "PreviewPage | None", file: Path | None) -> None:
    said_s = float("-inf")
    for picture in pictures:
        if page is not None:
            page.show(picture.jpeg, picture.text)
        if file is not None:
            _write(file, picture.jpeg)
        if picture.is_last or time.monotonic() - said_s >= _LINE_EACH_S:
            results().print(picture.text, markup=False)
            said_s = time.monotonic()


def _write(picture: Path, jpeg: bytes) -> None:
    try:
        write_durably(picture, jpeg)
    except OSError as error:
        raise ConfigError(f"--picture {picture}: cannot be written: {error.strerror}") from error
