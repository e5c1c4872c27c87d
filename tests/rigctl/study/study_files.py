"""Studies of the small panels scene, for tests."""

from pathlib import Path

from tests.rigctl.example_files import SMALL_SCENE

EXPOSURE, EFFICIENCY = "acquisition.exposure_ms", "sensor.quantum_efficiency"
GRID = f"""
kind = "grid"
[cases.parameters]
"{EXPOSURE}" = {{ start = 0.01, stop = 0.03, n = 5 }}
"{EFFICIENCY}" = {{ values = [0.3, 0.5] }}
"""


def study_file(
    folder: Path, cases: str, *, quantities: str = '["dolp.mean", "s0", "p_detection"]', rest: str = ""
) -> Path:
    """Write a study and its scene; return the study's path."""
    (folder / "small.toml").write_text(SMALL_SCENE)
    path = folder / "study.toml"
    path.write_text(f'name = "small"\nscenes = ["small.toml"]\nquantities = {quantities}\n{rest}\n[cases]\n{cases}')
    return path
