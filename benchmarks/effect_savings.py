"""What deciding on effects saves: ten scenes with all effects, with those they call for, and by the paper's shortcuts.

Usage: python -m benchmarks.effect_savings. Prints the table of docs/effects.md.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from benchmarks.timing import least_s
from model.accuracy.chain import ChainResult, evaluate
from model.accuracy.effect_check import change
from model.atmosphere.sky import Fidelity
from model.effects.effect import ALL, Effect
from rigctl.files.scene_file import SceneFile, load_scene
from rigctl.prediction.predict import ScenePredictor
from rigctl.scene.light import SceneLight

_EXAMPLES = Path(__file__).parents[1] / "examples"
_TOLERANCE = 1e-2
_MS = 1e3
# Example, and numbers of its tables that are changed.
_SCENES: dict[str, tuple[str, dict[str, dict[str, object]]]] = {
    "panels of given radiance": ("scene-panels", {}),
    "lamp on the bench": ("effects/bench", {}),
    "the same, 350 to 1000 nm": ("effects/bench", {"sensor": {"band_nm": (350.0, 1000.0)}}),
    "street lamp, 10 nm": ("effects/lamp", {}),
    "the same, 1 nm": ("effects/lamp", {"sensor": {"band_nm": (549.5, 550.5)}}),
    "roof, 40 nm": ("effects/roof-3m", {}),
    "the same, 400 to 700 nm": ("effects/roof-3m", {"sensor": {"band_nm": (400.0, 700.0)}}),
    "airborne, 15 x 15 deg": ("effects/airborne", {}),
    "the same, 40 x 40 deg": ("effects/airborne", {"field_of_view": {"width_deg": 40.0, "height_deg": 40.0}}),
    "twilight": ("effects/twilight", {}),
}


def _scene(name: str) -> SceneFile:
    file, changes = _SCENES[name]
    content = load_scene(_EXAMPLES / f"{file}.toml").model_dump(by_alias=True, exclude_none=True)
    for table, numbers in changes.items():
        content[table] |= numbers
    return SceneFile.model_validate(content)


def lines() -> Iterator[str]:
    """Yield the rows of the table."""
    for name in _SCENES:
        scene = _scene(name)
        all_s, _, _ = _predicted(scene, is_all=True)
        safe_s, left_out, result = _predicted(scene, is_all=False)
        shortcuts = " | ".join(_shortcut(scene, result, is_single=one) for one in (False, True))
        times = f"{_MS * all_s:.0f} | {_MS * safe_s:.0f} | {all_s / safe_s:.1f}"
        yield f"| {name} | {times} | {left_out or '-'} | {shortcuts} |"


def _predicted(file: SceneFile, *, is_all: bool) -> tuple[float, str, ChainResult]:
    """Return the least processor time of planning and predicting, what was left out, and the result."""

    def run() -> tuple[str, ChainResult]:
        predictor = ScenePredictor(file, None, light=SceneLight(is_kept_between_runs=False))
        plan = predictor.effect_plan(_TOLERANCE, rule="all" if is_all else "safe")
        found = predictor.to_tolerance(_TOLERANCE, effects=plan, estimated_only=True)
        names = [one.effect.value for one in plan.decisions if one.answer == "left out" and one.bound.largest > 0.0]
        return ", ".join(names), found.result

    names, result = run()
    return least_s(run, rounds=2)[0], names, result


def _shortcut(file: SceneFile, whole: ChainResult, *, is_single: bool) -> str:
    """Return time [ms] and largest error of DoLP of one wavelength, or of single scattering; "-" without any air."""
    scene = ScenePredictor(file, None).lit_scene()
    if scene.air is None:
        return "-"
    if is_single:
        scene = replace(scene, air=replace(scene.air, fidelity=Fidelity.SINGLE))
    effects = ALL if is_single else ALL - {Effect.WAVELENGTHS}

    def run() -> ChainResult:
        return evaluate(scene, whole.settings, effects=effects)

    error = change(whole.readings, run().readings)
    return f"{_MS * least_s(run, rounds=2)[0]:.0f}, {error.ratios:.1g}"


if __name__ == "__main__":
    print("\n".join(lines()))
