"""The example files, and a small rig made from them, for tests."""

from pathlib import Path

from rigctl.files.rig_file import RigFile, load_rig
from rigctl.files.session_file import SessionFile

EXAMPLES = Path(__file__).parents[2] / "examples"

SHORT_SESSION = """
name = "short"
[[take]]
kind = "dark"
exposure_ms = 0.03
cycles = 1
[[take]]
kind = "scene"
exposure_ms = 0.03
cycles = 1
"""

SMALL_SCENE = """
name = "small"
background_radiance = 20.0
[sensor]
pixel_pitch_um = 8.3
f_number = 2.0
optics_transmittance = 0.9
quantum_efficiency = 0.45
wavelength_nm = 550.0
bit_depth = 12
polarizer_transmittance = 0.8
extinction_ratio = 500
[noise]
gain_dn_per_e = 0.24
read_noise_e = 10.0
dark_current_e_per_s = 20.0
black_level_dn = 64.0
prnu = 0.005
dsnu_e = 1.0
[acquisition]
exposure_ms = 0.03
cycles = 2
[[regions]]
name = "left"
rectangle = { x = 4, y = 4, width = 40, height = 40 }
stokes_radiance = [10.0, 3.0, 1.0]
texture_rms = 0.01
[[regions]]
name = "right"
rectangle = { x = 52, y = 4, width = 40, height = 40 }
stokes_radiance = [40.0, -2.0, 3.0]
"""


def small_rig(folder: Path, *, seed: int = 1, port: str = "sim:ellx?speed=50") -> RigFile:
    """Return the example rig with a picture of 96 x 48 pixels; its scene file is written into `folder`."""
    (folder / "scene.toml").write_text(SMALL_SCENE)
    rig = load_rig(EXAMPLES / "rig-sim.toml")
    simulation = rig.simulation
    camera = simulation.camera.model_copy(update={"width": 96, "height": 48})
    simulation = simulation.model_copy(update={"camera": camera, "scene": folder / "scene.toml", "seed": seed})
    return rig.model_copy(update={"simulation": simulation, "stage": rig.stage.model_copy(update={"port": port})})


def small_rig_text(folder: Path) -> str:
    """Return the example rig's text with a picture of 96 x 48 pixels; its scene file is written into `folder`."""
    (folder / "scene.toml").write_text(SMALL_SCENE)
    text = (EXAMPLES / "rig-sim.toml").read_text().replace("scene-panels.toml", "scene.toml")
    return text.replace("width = 782", "width = 96").replace("height = 582", "height = 48")


def small_session(*, cycles: int = 2, name: str = "small") -> SessionFile:
    """Return a session of dark frames and four angles."""
    return SessionFile.model_validate(
        {
            "name": name,
            "take": [
                {"kind": "dark", "exposure_ms": 0.03, "cycles": 2},
                {"kind": "scene", "exposure_ms": 0.03, "cycles": cycles},
            ],
        }
    )
