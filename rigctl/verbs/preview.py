"""`rigctl preview`: a live picture and its sharpness, for focusing."""

import sys
import time
from collections.abc import Callable, Generator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import note, results, warn
from rigctl.errors import ConfigError
from rigctl.verbs.options import FilePath, Writes

if TYPE_CHECKING:
    from rigctl.web.rig import LiveRig, Task
    from rigctl.web.server import Place

_LOOK_EACH_S = 1.0
_LINE_EACH_S = 1.0
_RIG_FILE = ".toml"

#: Lines about the pictures.
Lines: TypeAlias = Generator[str]


def preview(
    camera: str,
    /,
    *,
    exposure_ms: Annotated[float | None, Parameter(validator=Number(gt=0.0))] = None,
    gain_db: float = 0.0,
    zoom: Annotated[int, Parameter(validator=Number(gte=1, lte=64))] = 1,
    listen: str = "127.0.0.1:8765",
    picture: Annotated[FilePath | None, Writes()] = None,
    frames: Annotated[int | None, Parameter(validator=Number(gte=1))] = None,
) -> None:
    """Show the live picture of a camera with its sharpness, for focusing, until Ctrl-C.

    Open the printed address in a browser, turn the lens, and stop where the sharpness is largest. Exposure, gain and
    zoom can be changed on the page. Saturated pixels are red. The contrast is stretched. No stage is needed
    or moved.

    Example: rigctl preview sim:gc780 --exposure-ms 0.03

    Parameters
    ----------
    camera : str
        Rig file, or address of a camera as in a rig file.
    exposure_ms : float
        Exposure [ms]; default: automatic.
    gain_db : float
        Gain [dB].
    zoom : int
        Magnification of the middle of the picture.
    listen : str
        Address and port of the page; with 0.0.0.0:8765, other devices such as a phone can open it.
    picture : path
        JPEG file to overwrite with each picture, instead of a page.
    frames : int
        Number of pictures after which to stop.
    """
    from rigctl.files.rig_file import load_rig, placeholder_doubt
    from rigctl.web.rig import Task
    from rigctl.web.server import place_of

    doubt = placeholder_doubt(load_rig(Path(camera))) if camera.endswith(_RIG_FILE) else None
    if doubt is not None:
        warn(doubt)
    task = Task(kind="preview", exposure_ms=exposure_ms, gain_db=gain_db, zoom=zoom)
    if picture is None:
        lines = preview_on_page(camera, task, place_of(listen), opened=_report)
    else:
        lines = _preview_in_file(camera, task, Path(picture))
    printed_s = float("-inf")
    try:
        with closing(lines):
            for number, line in enumerate(lines, 1):
                if number == frames or time.monotonic() - printed_s >= _LINE_EACH_S:
                    results().print(line, markup=False)
                    printed_s = time.monotonic()
                if number == frames:
                    break
    except KeyboardInterrupt:
        sys.stderr.write("\n")


def _report(where: str) -> None:
    note(f"the picture is at {where}; Ctrl-C ends it")


def preview_on_page(camera: str, task: "Task", place: "Place", *, opened: Callable[[str], None]) -> Lines:
    """Show the picture of a camera on a page, call `opened` with its address, and yield the numbers."""
    from rigctl.web.acts import camera_acts
    from rigctl.web.page import Actions, page_app
    from rigctl.web.rig import LiveRig
    from rigctl.web.run_reader import NoRuns
    from rigctl.web.server import PageServer

    rig = LiveRig(camera, camera_only=True)
    name = Path(camera).name if camera.endswith(_RIG_FILE) else camera
    actions = Actions(view=rig, acts=camera_acts(rig), title=f"preview {name}")
    with PageServer(page_app(NoRuns(), actions), place, can_act=True) as server:
        opened(server.addresses.act_url or "")
        yield from _lines(rig, task)


def _preview_in_file(camera: str, task: "Task", file: Path) -> Lines:
    """Write the pictures of a camera with stretched contrast into a file; yield their numbers."""
    from rigctl.base.durable import write_durably
    from rigctl.web.rig import VIEW, LiveRig

    rig = LiveRig(camera, camera_only=True)
    _report(str(file))
    with closing(_lines(rig, task)) as lines:
        for line in lines:
            picture = rig.picture(VIEW)
            try:
                write_durably(file, b"" if picture is None else picture.jpeg)
            except OSError as error:
                raise ConfigError(f"--picture {file}: cannot be written: {error.strerror}") from error
            yield line


def _lines(rig: "LiveRig", task: "Task") -> Lines:
    """Yield the numbers of each picture of a rig; its devices are closed at the end."""
    from rigctl.web.rig import REST

    seen = 0
    rig.begin(task)
    try:
        while True:
            look = rig.newer_look(seen, timeout_s=_LOOK_EACH_S)
            if look.width and look.sequence != seen:
                seen = look.sequence
                yield str(look)
    finally:
        rig.begin(REST)
