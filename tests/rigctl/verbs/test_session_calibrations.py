"""Calibrations at the start of a session: refused before any frame is taken."""

import json
from pathlib import Path
from typing import Any

import pytest

from rigctl.cli import main
from rigctl.console import EXIT_DATA
from tests.rigctl.example_files import EXAMPLES

AXIS = {"schema_version": 2, "sense": -1, "offset_deg": {"value": 31.7, "std_error": 0.01}}
NUMBER = {"value": 0.24, "std_error": 0.001, "n": 4}
NOISE = {
    "schema_version": 2,
    "gain_dn_per_e": NUMBER,
    "read_noise_e": NUMBER,
    "black_level_dn": NUMBER,
} | dict.fromkeys(("dark_current_e_per_s", "saturation_e", "prnu", "dsnu_e"))


def acquire(folder: Path, option: str, content: dict[str, Any]) -> int:
    path = folder / "calibration.json"
    path.write_text(json.dumps(content))
    arguments = [
        "acquire",
        str(EXAMPLES / "rig-sim.toml"),
        str(EXAMPLES / "session.toml"),
        "--out",
        str(folder / "run"),
    ]
    return main([*arguments, option, str(path)])


@pytest.mark.parametrize(
    ("option", "content", "said"),
    [
        ("--noise", NOISE | {"made_for": {"camera_serial": "another"}}, "camera serial number: calibrated another"),
        ("--noise", NOISE | {"made_for": {"gain_db": 6.0}}, "gain setting"),
        ("--polarizer", AXIS | {"made_for": {"stage_serial": "another"}}, "stage serial number"),
        ("--polarizer", AXIS | {"sense": 1}, "put the calibrated ones there"),
    ],
)
def test_the_calibration_of_another_rig_is_refused_before_the_first_frame(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, content: dict[str, Any], said: str
) -> None:
    assert acquire(tmp_path, option, content) == EXIT_DATA
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "run").exists()
