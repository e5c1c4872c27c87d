"""Simulated roofs at noon and in the morning: are scores standard normal in each row, are changes of the roof named?"""

from collections import Counter
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from itertools import product
from pathlib import Path
from typing import Literal

from benchmarks.trials.harness import are_normal, by_row, over, scratch
from model.surface.materials import MATERIALS, properties
from rigctl.base.numbers import unix_ns
from rigctl.comparison.compare import Comparison, compare_with_scene
from rigctl.comparison.explain import InputAttribution
from rigctl.files.choices import ROOF_CHANGES, RoofChange
from rigctl.files.rig_file import RigFile, load_rig
from rigctl.files.scene_file import load_scene
from rigctl.files.session_file import SessionFile
from rigctl.measure.diagnose import measure_run
from rigctl.rig.simulation import with_simulation
from rigctl.runs.folder import read_run
from rigctl.scene.scene import scene_of_file
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


NAMES: dict[RoofChange, str] = {
    "visibility": "atmosphere.visibility_km",
    "aerosol": "atmosphere.alternative.share",
    "dhr": "regions.black_panel.dhr",
    "tilt": "regions.black_panel.tilt_deg",
    "drift": "errors.illumination_drift",
}


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
    return compare_with_scene(
        measure_run(read_run(folder / "run"), list(scene.regions)), scene_of_file(scene), alpha=ALPHA
    )


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


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of a run: z of each row, whether it agrees, and what the comparison says would explain it."""

    agrees: bool | None
    z: dict[tuple[str, str, str], float]
    first: str
    indistinguishable: tuple[str, ...]
    flags: tuple[str, ...]

    def verdict(self, name: str) -> str:
        """Return "named", "indistinguishable", "misnamed" or "missed" for an input that was changed.

        A drift of the light is named by the run's own check of its cycles, before any model.
        """
        if name == NAMES["drift"] and "drift of the light" in self.flags:
            return "named"
        if self.agrees is not False:
            return "missed"
        return "named" if self.first == name else "indistinguishable" if name in self.indistinguishable else "misnamed"


def one_run(hour: Hour, seed: int, *, perturb: RoofChange | None) -> Outcome:
    """Take a run of a roof and compare it; one that was changed with a scene file that states what is not known."""
    with scratch() as folder:
        found = roof_comparison(folder, hour=hour, seed=seed, perturb=perturb, uncertain=perturb is not None)
    best = None if found.attribution is None else found.attribution.best
    return Outcome(
        agrees=found.agrees,
        z={(row.region, row.quantity, row.statistic): row.z for row in found.rows if row.z is not None},
        first="" if best is None else best.name,
        indistinguishable=() if best is None else _alike(found.attribution, best.name),
        flags=tuple(check.name for check in found.flags),
    )


def _alike(attribution: InputAttribution | None, first: str) -> tuple[str, ...]:
    """Return what is said to look the same as the first, either way, and what is said not to be seen."""
    if attribution is None:
        return ()
    best = attribution.moves[0]
    others = (move.name for move in attribution.moves if first in move.indistinguishable_from)
    return (*best.indistinguishable_from, *others, *attribution.unseen)


def run_roof(*, seeds: int = 40, changed_seeds: int = 4) -> bool:
    """Compare runs of a roof at noon and in the morning, then runs of a roof in which something was changed."""
    sound = True
    for hour in TIMES:
        outcomes = list(over(partial(one_run, hour, perturb=None), range(1, seeds + 1)))
        sound &= are_normal(f"roof at {hour}, {seeds} seeds", by_row(outcome.z for outcome in outcomes))
        print(f"disagree: {sum(outcome.agrees is False for outcome in outcomes)} of {seeds}")
    for what, hour in product(ROOF_CHANGES, TIMES):
        outcomes = list(over(partial(one_run, hour, perturb=what), range(1, changed_seeds + 1)))
        verdicts = Counter(outcome.verdict(NAMES[what]) for outcome in outcomes)
        firsts = ", ".join(sorted({outcome.first for outcome in outcomes}))
        print(f"  {what:10} {hour:8} {dict(verdicts)}; first: {firsts}")
        sound &= set(verdicts) <= {"named", "indistinguishable"}
    return sound
