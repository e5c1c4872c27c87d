"""``rigctl new``: a folder with the files of a new rig."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import print_json, progress, results
from rigctl.errors import ConfigError


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A new folder, or an empty one.")],
    simulated: Annotated[bool, typer.Option("--simulated", help="A simulated rig.")] = False,
    stage: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="PORT of an Elliptec stage, or DRIVER:PORT (rigctl devices).")
    ] = None,
    camera: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Such as gige:192.168.0.5 or v4l2:/dev/video0.")
    ] = None,
    latitude_deg: Annotated[float | None, typer.Option(metavar="DEG", help="Of the rig; north is positive.")] = None,
    longitude_deg: Annotated[float | None, typer.Option(metavar="DEG", help="Of the rig; east is positive.")] = None,
    elevation_m: Annotated[float, typer.Option(metavar="M", help="Of the rig above the sea.")] = 0.0,
    no_input: Annotated[bool, typer.Option("--no-input", help="Ask nothing.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Write rig, session, noise, flat and axis sessions, scene and regions that run as they are, with a README.

    What no option says is asked: simulated or real, which stage and which camera. Sense and offset of the polarizer
    are placeholders, and every command says so, until `rigctl calibrate axis ... --write rig.toml` has filled them in.

    Example: rigctl new my-rig --simulated

    Example: rigctl new roof --stage /dev/ttyUSB0 --camera gige:192.168.0.5 --latitude-deg 43.1 --longitude-deg -77.7
    """
    from rigctl.jobs.new_folder import NewRequest, new_folder

    if simulated and (stage is not None or camera is not None):
        raise ConfigError("--simulated: has a stage and a camera of its own; leave out --stage and --camera")
    if not simulated and stage is None and camera is None:
        stage, camera = _asked(can_ask=not no_input and sys.stdin.isatty())
    request = NewRequest(
        folder=folder,
        stage=stage,
        camera=camera,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        elevation_m=elevation_m,
    )
    written = new_folder(request)
    if as_json:
        print_json({"folder": str(folder), "files": list(written), "is_simulated": request.is_simulated})
        return
    for name in written:
        results().print(str(folder / name), markup=False)
    progress().print(f"next: cd {folder}, and the commands of README.md", markup=False)


def _asked(*, can_ask: bool) -> tuple[str | None, str | None]:
    """Return addresses of stage and camera by asking; None, both, for a simulated rig."""
    if not can_ask:
        raise ConfigError("give --simulated, or --stage ADDRESS and --camera ADDRESS (`rigctl devices` finds them)")
    if typer.confirm("A simulated rig?", default=True):
        return None, None
    progress().print("`rigctl devices` lists what is connected", markup=False)
    return typer.prompt("Stage (a port, or DRIVER:PORT)"), typer.prompt("Camera (such as gige:192.168.0.5)")
