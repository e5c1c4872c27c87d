"""``rigctl preview``: a live picture and its sharpness, for focusing."""

import itertools
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from drivers.interfaces import Camera, Frame
from rigctl.devices.focus import focus_of, jpeg_of, middle
from rigctl.devices.preview_camera import open_camera
from rigctl.devices.preview_page import PreviewPage
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError
from rigctl.terminal import progress, results

_TIMEOUT_S = 10.0
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
    page = None if picture is not None else PreviewPage(*_place(listen))
    with page or nullcontext(), open_camera(camera) as opened:
        opened.configure(exposure_s=exposure_ms / 1e3, gain_db=gain_db)
        where = str(picture) if page is None else page.address
        progress().print(f"the picture is at {where}; Ctrl-C ends it", markup=False)
        try:
            _show(opened, page, picture, zoom=zoom, frames=frames, exposure_s=exposure_ms / 1e3)
        except KeyboardInterrupt:
            sys.stderr.write("\n")


def _place(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise ConfigError(f"--listen {text}: must be an address and a port, such as 127.0.0.1:8765")
    return host, int(port)


def _show(
    camera: Camera, page: PreviewPage | None, picture: Path | None, *, zoom: int, frames: int | None, exposure_s: float
) -> None:
    best, said_s = 0.0, float("-inf")
    for number in itertools.count(1):
        frame = camera.take_frame(timeout_s=exposure_s + _TIMEOUT_S)
        text, jpeg, best = _seen(frame, zoom=zoom, best=best)
        if page is not None:
            page.show(jpeg)
        if picture is not None:
            _write(picture, jpeg)
        is_last = number == frames
        if is_last or time.monotonic() - said_s >= _LINE_EACH_S:
            results().print(text, markup=False)
            said_s = time.monotonic()
        if is_last:
            return


def _write(picture: Path, jpeg: bytes) -> None:
    try:
        write_durably(picture, jpeg)
    except OSError as error:
        raise ConfigError(f"--picture {picture}: cannot be written: {error.strerror}") from error


def _seen(frame: Frame, *, zoom: int, best: float) -> tuple[str, bytes, float]:
    """Return the line of numbers, the picture to show, and the best sharpness so far."""
    shown, bit_depth = middle(frame.counts, zoom=zoom), frame.settings.bit_depth
    focus = focus_of(shown, bit_depth=bit_depth)
    best = max(best, focus.sharpness)
    text = focus.text(best)
    return text, jpeg_of(shown, bit_depth=bit_depth, text=text), best
