"""A folder for a new rig: files with comments that run as they are, and a README of the next commands."""

import re
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from rigctl.errors import ConfigError

_SIMULATED = ("sim:ellx?speed=20", "sim:gc780")
_COPIED = ("session.toml", "session-noise.toml", "session-flats.toml", "regions.toml")
# Directions of the polarizing sheet before the camera, and the Stokes radiance that it then sends.
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
angles_deg = [0, 15, 30, 45, 60, 75, 90, 105, 120, 135, 150, 165]
cycles = 2
"""
_REST = """
# 2. Noise of the sensor: flats (an even light) and darks
rigctl acquire rig.toml session-noise.toml --out runs/noise
rigctl calibrate noise --run runs/noise --out noise.json --report noise.html

# 3. The scene
rigctl acquire rig.toml session.toml --out runs/first

# 4. What was measured, in the regions of regions.toml
rigctl stokes runs/first --regions regions.toml --noise noise.json --out stokes

# 5. Model beside measurement: open compared/report.html
rigctl compare runs/first scene.toml --noise noise.json --out compared
"""


@dataclass(frozen=True, kw_only=True)
class NewRequest:
    """A new folder.

    Attributes
    ----------
    folder : Path
        New, or empty.
    stage, camera : str or None
        Addresses; None, both: a simulated rig. A stage is PORT, or DRIVER:PORT where it is no Elliptec.
    latitude_deg, longitude_deg : float or None
        Where the rig stands, north and east positive.
    elevation_m : float
        Above the sea.
    """

    folder: Path
    stage: str | None = None
    camera: str | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    elevation_m: float = 0.0

    @property
    def is_simulated(self) -> bool:
        """Whether nothing of the rig is real."""
        return self.stage is None and self.camera is None


def new_folder(request: NewRequest) -> tuple[str, ...]:
    """Write the files of a new rig; return their names.

    Raises
    ------
    ConfigError
        The folder holds something, or one of two things that belong together is missing.
    """
    folder = request.folder
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"{folder}: is not empty; give a new folder, or an empty one")
    if (request.stage is None) != (request.camera is None):
        raise ConfigError("--stage, --camera: give both, or --simulated")
    if (request.latitude_deg is None) != (request.longitude_deg is None):
        raise ConfigError("--latitude-deg, --longitude-deg: give both, or neither")
    contents = {name: _example(name) for name in _COPIED}
    contents |= {"rig.toml": _rig(request), "scene.toml": _example("scene-panels.toml"), "session-axis.toml": _AXIS}
    if request.is_simulated:
        contents |= _sheets(request)
    contents["README.md"] = _readme(request)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in contents.items():
        (folder / name).write_text(text, encoding="utf-8")
    return tuple(contents)


def _example(name: str) -> str:
    return (files("rigctl") / "data" / "examples" / name).read_text(encoding="utf-8")


def _rig(request: NewRequest, scene: str = "scene.toml") -> str:
    text = _example("rig-sim.toml").replace("scene-panels.toml", scene)
    text = text.replace('name = "simulated rooftop rig"', f'name = "{request.folder.resolve().name}"')
    text = re.sub(r"^sense = -1\noffset_deg = 31\.7\n", _PLACEHOLDER, text, count=1, flags=re.MULTILINE)
    if request.stage is not None and request.camera is not None:
        text = _with_devices(text, request.stage, request.camera)
    if request.latitude_deg is not None:
        site = (
            f"# Where the rig stands; north and east are positive.\n[site]\nlatitude_deg = {request.latitude_deg:g}\n"
            f"longitude_deg = {request.longitude_deg:g}\nelevation_m = {request.elevation_m:g}\n\n"
        )
        text = text.replace("[camera]\n", f"{site}[camera]\n", 1)
    return text


def _with_devices(text: str, stage: str, camera: str) -> str:
    """Return a rig file with real devices; the table of the simulation stays where one of them is simulated."""
    driver, _, port = stage.partition(":") if not stage.startswith(("/", "sim:")) else ("ellx", ":", stage)
    if not port:
        raise ConfigError(f"--stage: is {stage!r}; wanted is a port such as /dev/ttyUSB0, or DRIVER:PORT")
    if ":" not in camera:
        raise ConfigError(f"--camera: is {camera!r}; wanted is an address such as gige:192.168.0.5 or v4l2:/dev/video0")
    text = re.sub(r"^driver = .*$", f'driver = "{driver}"', text, count=1, flags=re.MULTILINE)
    text = re.sub(r"^port = .*$", f'port = "{port}"', text, count=1, flags=re.MULTILINE)
    text = re.sub(r"^address = \"sim:gc780\"$", f'address = "{camera}"', text, count=1, flags=re.MULTILINE)
    if driver != "ellx":
        text = re.sub(r'^address = "0"\n', "", text, count=1, flags=re.MULTILINE)
    if port.startswith("sim:") or camera.startswith("sim:"):
        return text
    kept = text[: text.index("# What the simulated rig truly is.")].rstrip() + "\n"
    return re.sub(r"\A(?:#[^\n]*\n)+", "# The rig: stage, camera, and the polarizer's seat.\n", kept)


def _sheets(request: NewRequest) -> dict[str, str]:
    """Return rig and scene files of a polarizing sheet at each direction, for the simulated rig to look at."""
    head, _, _ = _example("scene-panels.toml").partition("# Stokes radiance (S0")
    found = {}
    for angle_deg, stokes in _SHEETS.items():
        region = "{ x = 0, y = 0, width = 782, height = 582 }"
        scene = f'{head}[[regions]]\nname = "sheet"\nrectangle = {region}\nstokes_radiance = {stokes}\n'
        found[f"sheet-{angle_deg}.toml"] = scene
        found[f"rig-sheet-{angle_deg}.toml"] = _rig(request, f"sheet-{angle_deg}.toml")
    return found


def _readme(request: NewRequest) -> str:
    what = "A simulated rig" if request.is_simulated else f"A rig: stage {request.stage}, camera {request.camera}"
    axis = "# 1. How the polarizer sits: a polarizing sheet at 0 deg and at 30 deg before the camera\n"
    for angle_deg in _SHEETS:
        rig = f"rig-sheet-{angle_deg}.toml" if request.is_simulated else "rig.toml"
        axis += f"rigctl acquire {rig} session-axis.toml --out runs/axis{angle_deg}\n"
    axis += (
        "rigctl calibrate axis runs/axis0 runs/axis30 --reference-deg 0 --reference-deg 30 --out polarizer.json "
        "--write rig.toml\n"
    )
    real = (
        ""
        if request.is_simulated
        else "First `rigctl doctor rig.toml session.toml`, and `rigctl preview CAMERA --exposure-ms 1` for focus and\n"
        "exposure; put your exposures into the session files, your sensor and materials into scene.toml.\n\n"
    )
    return (
        f"# {request.folder.resolve().name}\n\n{what}. Sense and offset of the polarizer in rig.toml are placeholders "
        f"until step 1.\nRegions of your own: `rigctl regions draw runs/first --out regions.toml`.\n\n{real}"
        f"```sh\n{axis}{_REST}```\n"
    )
