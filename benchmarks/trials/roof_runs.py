"""Small simulated roofs, noon and morning: runs of them, and the scene files that made them."""

from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Literal

from model.surface.materials import MATERIALS, properties
from rigctl.base.numbers import unix_ns
from rigctl.comparison.checks import registration_of, run_checks
from rigctl.comparison.compare import Comparison, compare_with_scene
from rigctl.files.choices import RoofChange
from rigctl.files.rig_file import RigFile, load_rig
from rigctl.files.scene_file import load_scene
from rigctl.files.session_file import SessionFile
from rigctl.measure.measure import measure
from rigctl.rig.simulation import with_simulation
from rigctl.runs.folder import read_run
from rigctl.scene.reading import scene_of_file
from rigctl.session.take import take_session

Hour = Literal["noon", "morning"]
TIMES: dict[Hour, datetime] = {
    "noon": datetime.fromisoformat("2010-05-25T17:07:40Z"),
    "morning": datetime.fromisoformat("2010-05-25T14:09:40Z"),
}
EXAMPLES = Path(__file__).parents[2] / "examples"
ALPHA = 1e-3
_WIDTH, _HEIGHT, _SIDE = 150, 50, 40
_PANELS = {"black_panel": ("black-paint", 0.012), "white_panel": ("white-paint", 0.008), "asphalt": ("asphalt", 0.02)}
# What a person might know of a roof; each change of `rigctl.rig.roof` is five of these or more.
_VISIBILITY_STD_KM, _DHR_STD, _TILT_STD_DEG, _DRIFT_STD, _SHARE_STD = 1.0, 0.03, 0.5, 5e-4, 0.05


def scene_text(folder: Path, *, uncertain: bool) -> str:
    """Return the roof of the example as a small picture; its materials are written into a folder.

    Parameters
    ----------
    folder : Path
        For the materials.
    uncertain : bool
        Visibility, kind of aerosol, reflectance and tilt of the black panel and drift have a standard uncertainty, and
        nothing else; otherwise every number is exact.
    """
    head = (EXAMPLES / "scene-roof.toml").read_text().partition("[[regions]]")[0]
    visibility = (
        f"visibility_km = {{ value = 23.0, std = {_VISIBILITY_STD_KM} }}" if uncertain else "visibility_km = 23.0"
    )
    head = head.replace("visibility_km = { value = 23.0, std = 2.0 }", visibility)
    if uncertain:
        head += f'[atmosphere.alternative]\naerosol = "spheres"\nshare = {{ value = 0.0, std = {_SHARE_STD} }}\n'
        head += f"[errors]\nillumination_drift = {{ value = 0.0, std = {_DRIFT_STD} }}\n"
    for place, (name, (material, texture)) in enumerate(_PANELS.items()):
        is_known = not (uncertain and name == "black_panel")
        (folder / f"{material}.toml").write_text(_material_text(material, dhr_std=None if is_known else _DHR_STD))
        head += f'[[regions]]\nname = "{name}"\nmaterial = "{material}.toml"\ntexture_rms = {texture}\n'
        head += f"rectangle = {{ x = {5 + 50 * place}, y = 5, width = {_SIDE}, height = {_SIDE} }}\n"
        head += "" if is_known else f"tilt_deg = {{ value = 0.0, std = {_TILT_STD_DEG} }}\n"
    return head


def roof_comparison(folder: Path, *, hour: Hour, seed: int, perturb: RoofChange | None, uncertain: bool) -> Comparison:
    """Return what a comparison says of a run of the roof that is taken into a folder, with the scene that made it.

    Parameters
    ----------
    folder : Path
        Empty.
    hour : str
        Of the run.
    seed : int
        Of noise, texture and fixed pattern.
    perturb : str or None
        What is changed in the roof, though not in the scene file that it is compared with.
    uncertain : bool
        As `scene_text` has it.
    """
    path = folder / "scene.toml"
    path.write_text(scene_text(folder, uncertain=uncertain))
    session = SessionFile.model_validate(_SESSION | {"name": f"{hour}-{seed}"})
    take_session(_rig(path, hour, seed, perturb), session, folder / "run", files={})
    scene = load_scene(path)
    measurement = measure(read_run(folder / "run"), regions=list(scene.regions))
    found = compare_with_scene(measurement, scene_of_file(scene), alpha=ALPHA)
    return replace(found, checks=run_checks(measurement, registration_of(measurement)))


_SESSION = {
    "take": [
        {"kind": "dark", "exposure_ms": 0.02, "cycles": 8},
        {"kind": "scene", "exposure_ms": 0.02, "angles_deg": [0, 90, 45, 135], "cycles": 8},
    ]
}


def _rig(scene: Path, hour: Hour, seed: int, perturb: RoofChange | None) -> RigFile:
    rig = with_simulation(load_rig(EXAMPLES / "rig-roof.toml"), clock_ns=unix_ns(TIMES[hour]), perturb=perturb)
    if rig.simulation is None:
        raise RuntimeError("the example of a roof is simulated")
    camera = rig.simulation.camera.model_copy(update={"width": _WIDTH, "height": _HEIGHT})
    simulation = rig.simulation.model_copy(update={"camera": camera, "scene": scene, "seed": seed})
    stage = rig.stage.model_copy(update={"port": "sim:ellx?speed=500"})
    return rig.model_copy(update={"simulation": simulation, "stage": stage})


def _material_text(name: str, *, dhr_std: float | None) -> str:
    """Return a material of the library as a file of exact numbers; its reflectance may have a relative uncertainty."""
    material = MATERIALS[name]
    text = f'name = "{name}"\ndhr_angle_deg = {material.dhr_angle_rad * 57.29577951308232:.12g}\n'
    for key, found in properties(material).items():
        value = found.at(550e-9)
        std = f"std = {value * dhr_std:.6g}\n" if key == "dhr" and dhr_std is not None else ""
        text += f'[{key}]\nvalue = {value!r}\n{std}source = "library at 550 nm"\n'
    return text
