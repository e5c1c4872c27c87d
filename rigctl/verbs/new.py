"""`rigctl new`: a folder for a new rig, with files that work as they are and a README with the next commands."""

import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import Json
from rigctl.errors import ConfigError
from rigctl.verbs.options import FilePath, Part, Result, Writes

_COPIED = ("session.toml", "session-noise.toml", "session-flats.toml", "regions.toml")
# Directions of the polarizing sheet in front of the camera, with its Stokes radiance.
_SHEETS = {0: "[20.0, 19.8, 0.0]", 30: "[20.0, 9.9, 17.147]"}
_PLACEHOLDER = """sense = 1                       # a placeholder
offset_deg = 0.0                # a placeholder
placeholder = true              # until `rigctl calibrate axis ... --write rig.toml` has filled both in
"""
_AXIS = """# Frames for `rigctl calibrate axis`: a polarizing sheet of known direction, at many stage angles.
# Take it twice, with the sheet at 0 deg (passes horizontal light) and at 30 deg, counter-clockwise as the camera sees.
name = "axis"

[[take]]
kind = "dark"
exposure_ms = 0.03
cycles = 4

[[take]]
kind = "scene"
exposure_ms = 0.03
angles_deg = [
    0, 15, 30, 45, 60, 75, 90, 105, 120, 135, 150, 165,
    180, 195, 210, 225, 240, 255, 270, 285, 300, 315, 330, 345,
]
"""
_REST = """
# 2. Noise of the sensor: flats (an even light) and darks
rigctl acquire rig.toml session-noise.toml --out runs/noise
rigctl calibrate noise --run runs/noise --out noise.json --report noise.html

# 3. The scene
rigctl acquire rig.toml session.toml --out runs/first

# 4. What was measured, in the regions of regions.toml
rigctl stokes runs/first --regions regions.toml --noise noise.json --out stokes

# 5. Model compared with measurement: open compared/report.html
rigctl compare runs/first scene.toml --noise noise.json --out compared
"""


def new(
    folder: Annotated[FilePath, Writes(kind="new", is_argument=True)],
    /,
    *,
    simulated: bool = False,
    stage: str | None = None,
    camera: str | None = None,
    latitude_deg: Annotated[float | None, Parameter(validator=Number(gte=-90.0, lte=90.0))] = None,
    longitude_deg: Annotated[float | None, Parameter(validator=Number(gte=-180.0, lte=360.0))] = None,
    elevation_m: float = 0.0,
    no_input: bool = False,
) -> "NewFolder":
    """Write the files of a new rig: rig, sessions, scene and regions, ready to run, with a README.

    Without --simulated, --stage and --camera, the command asks for stage and camera. Sense and offset of the polarizer
    are placeholders until `rigctl calibrate axis ... --write rig.toml` writes them; every command reminds you.

    Example: rigctl new my-rig --simulated

    Example: rigctl new roof --stage /dev/ttyUSB0 --camera gige:192.168.0.5 --latitude-deg 43.1 --longitude-deg -77.7

    Parameters
    ----------
    folder : path
        New or empty folder.
    simulated : bool
        Use a simulated stage and camera.
    stage : str
        Port of an Elliptec stage, or DRIVER:PORT for other stages (see rigctl devices).
    camera : str
        Address of the camera, such as gige:192.168.0.5 or v4l2:/dev/video0.
    latitude_deg : float
        Latitude of the rig; north is positive.
    longitude_deg : float
        Longitude of the rig; east is positive.
    elevation_m : float
        Elevation of the rig above the sea.
    no_input : bool
        Never ask; fail if something is missing.
    """
    if simulated and (stage is not None or camera is not None):
        raise ConfigError("--simulated: has a stage and a camera of its own; leave out --stage and --camera")
    if not simulated and stage is None and camera is None:
        stage, camera = _asked(can_ask=not no_input and sys.stdin.isatty())
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"{folder}: is not empty; give a new folder, or an empty one")
    if (stage is None) != (camera is None):
        raise ConfigError("--stage, --camera: give both, or --simulated")
    if (latitude_deg is None) != (longitude_deg is None):
        raise ConfigError("--latitude-deg, --longitude-deg: give both, or neither")
    is_simulated = stage is None or camera is None
    rig = _example("rig-sim.toml").replace('name = "simulated rooftop rig"', f'name = "{folder.resolve().name}"')
    rig = re.sub(r"^sense = -1\noffset_deg = 31\.7\n", _PLACEHOLDER, rig, count=1, flags=re.MULTILINE)
    if stage is not None and camera is not None:
        rig = _with_devices(rig, stage, camera)
    if latitude_deg is not None:
        site = (
            f"# Where the rig stands; north and east are positive.\n[site]\nlatitude_deg = {latitude_deg:g}\n"
            f"longitude_deg = {longitude_deg:g}\nelevation_m = {elevation_m:g}\n\n"
        )
        rig = rig.replace("[camera]\n", f"{site}[camera]\n", 1)
    contents = {name: _example(name) for name in _COPIED}
    contents |= {
        "rig.toml": _looking_at(rig, "scene.toml"),
        "scene.toml": _example("scene-panels.toml"),
        "session-axis.toml": _AXIS,
    }
    if is_simulated:
        contents |= _sheets(rig)
    rig_text = "A simulated rig" if is_simulated else f"A rig: stage {stage}, camera {camera}"
    contents["README.md"] = _readme(folder.resolve().name, rig_text, is_simulated=is_simulated)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in contents.items():
        (folder / name).write_text(text, encoding="utf-8")
    return NewFolder(folder=folder, files=tuple(contents), is_simulated=is_simulated)


@dataclass(frozen=True, kw_only=True)
class NewFolder(Result):
    """Files that were written for a new rig."""

    folder: Path
    files: tuple[str, ...]
    is_simulated: bool  #: stage and camera were not given

    def content(self) -> Iterable[Part]:
        """Return the next step and the files."""
        yield f"{len(self.files)} files of a new rig; next: cd {self.folder}, and the commands of README.md"
        yield from (str(self.folder / name) for name in self.files)

    def as_json(self) -> dict[str, Json]:
        """Return folder and files."""
        return {"folder": str(self.folder), "files": list(self.files), "is_simulated": self.is_simulated}


def _asked(*, can_ask: bool) -> tuple[str | None, str | None]:
    """Ask for the addresses of stage and camera; both are None for a simulated rig."""
    if not can_ask:
        raise ConfigError("give --simulated, or --stage ADDRESS and --camera ADDRESS (`rigctl devices` finds them)")
    if _answer("A simulated rig? [Y/n]: ").lower() in ("", "y", "yes"):
        return None, None
    sys.stderr.write("`rigctl devices` lists what is connected\n")
    return _answer("Stage (a port, or DRIVER:PORT): "), _answer("Camera (such as gige:192.168.0.5): ")


def _answer(question: str) -> str:
    sys.stderr.write(question)
    sys.stderr.flush()
    line = sys.stdin.readline()
    if not line:
        raise ConfigError("give --simulated, or --stage ADDRESS and --camera ADDRESS (`rigctl devices` finds them)")
    return line.strip()


def _example(name: str) -> str:
    return (files("rigctl") / "data" / "examples" / name).read_text(encoding="utf-8")


def _looking_at(rig: str, scene: str) -> str:
    """Return a rig file whose simulated camera sees a scene."""
    return rig.replace("scene-panels.toml", scene)


def _with_devices(text: str, stage: str, camera: str) -> str:
    """Return a rig file with real devices; the simulation stays if one of them is simulated."""
    driver, _, port = stage.partition(":") if not stage.startswith(("/", "sim:")) else ("ellx", ":", stage)
    if not port:
        raise ConfigError(f"--stage: is {stage!r}; give a port such as /dev/ttyUSB0, or DRIVER:PORT")
    if ":" not in camera:
        raise ConfigError(f"--camera: is {camera!r}; give an address such as gige:192.168.0.5 or v4l2:/dev/video0")
    from rigctl.rig.rig import find_driver

    find_driver("rigctl.stages", driver, key="--stage")
    find_driver("rigctl.cameras", camera.partition(":")[0], key="--camera")
    text = re.sub(r"^driver = .*$", f'driver = "{driver}"', text, count=1, flags=re.MULTILINE)
    text = re.sub(r"^port = .*$", f'port = "{port}"', text, count=1, flags=re.MULTILINE)
    text = re.sub(r"^address = \"sim:gc780\"$", f'address = "{camera}"', text, count=1, flags=re.MULTILINE)
    if driver != "ellx":
        text = re.sub(r'^address = "0"\n', "", text, count=1, flags=re.MULTILINE)
    if port.startswith("sim:") or camera.startswith("sim:"):
        return text
    kept = text[: text.index("# What the simulated rig truly is.")].rstrip() + "\n"
    return re.sub(r"\A(?:#[^\n]*\n)+", "# The rig: stage, camera, and the polarizer's seat.\n", kept)


def _sheets(rig: str) -> dict[str, str]:
    """Return the rig and scene files of a polarizing sheet in each direction, for the simulated rig."""
    head, _, _ = _example("scene-panels.toml").partition("# Stokes radiance (S0")
    found = {}
    for angle_deg, stokes in _SHEETS.items():
        region = "{ x = 0, y = 0, width = 782, height = 582 }"
        scene = f'{head}[[regions]]\nname = "sheet"\nrectangle = {region}\nstokes_radiance = {stokes}\n'
        found[f"sheet-{angle_deg}.toml"] = scene
        found[f"rig-sheet-{angle_deg}.toml"] = _looking_at(rig, f"sheet-{angle_deg}.toml")
    return found


def _readme(name: str, rig: str, *, is_simulated: bool) -> str:
    axis = "# 1. How the polarizer sits: a polarizing sheet at 0 deg and at 30 deg before the camera\n"
    for angle_deg in _SHEETS:
        rig_file = f"rig-sheet-{angle_deg}.toml" if is_simulated else "rig.toml"
        axis += f"rigctl acquire {rig_file} session-axis.toml --out runs/axis{angle_deg}\n"
    axis += (
        "rigctl calibrate axis runs/axis0 runs/axis30 --reference-deg 0 --reference-deg 30 --out polarizer.json "
        "--write rig.toml\n"
    )
    real = (
        ""
        if is_simulated
        else "First `rigctl doctor rig.toml session.toml`, and `rigctl preview CAMERA --exposure-ms 1` for focus and\n"
        "exposure; put your exposures into the session files, your sensor and materials into scene.toml.\n\n"
    )
    return (
        f"# {name}\n\n{rig}. Sense and offset of the polarizer in rig.toml are placeholders "
        f"until step 1.\nRegions of your own: `rigctl regions draw runs/first --out regions.toml`.\n\n{real}"
        f"```sh\n{axis}{_REST}```\n"
    )
