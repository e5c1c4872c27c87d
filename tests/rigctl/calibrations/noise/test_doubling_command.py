"""``rigctl calibrate doubling``."""

import json
from pathlib import Path

import pytest

from rigctl.cli import main
from rigctl.console.failures import EXIT_DATA, EXIT_USAGE
from tests.rigctl.noise_sessions import write_noise_run


def calibrations(folder: Path, *, serials: tuple[str, ...] = ("1", "1", "1")) -> list[str]:
    """Files of a dark current that doubles every 8 K."""
    assert (
        main(["calibrate", "noise", "--run", str(write_noise_run(folder / "run")), "--out", str(folder / "n.json")])
        == 0
    )
    content = json.loads((folder / "n.json").read_text())
    names = []
    for place, serial in enumerate(serials):
        current = {"value": 100.0 * 2.0**place, "std_error": 1.0, "n": 10}
        made_for = content["made_for"] | {"temperature_c": 20.0 + 8.0 * place, "camera_serial": serial}
        changed = content | {"dark_current_e_per_s": current, "made_for": made_for}
        names.append(str(folder / f"noise_{place}.json"))
        Path(names[-1]).write_text(json.dumps(changed))
    return names


def test_finds_the_interval(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = calibrations(tmp_path)
    capsys.readouterr()
    assert main(["calibrate", "doubling", *names, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["value_k"] == pytest.approx(8.0, rel=1e-6)
    assert found["n_temperatures"] == 3


def test_says_it_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "doubling", *calibrations(tmp_path)]) == 0
    assert "doubles every 8.00" in capsys.readouterr().out


def test_different_cameras_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "doubling", *calibrations(tmp_path, serials=("1", "2", "1"))]) == EXIT_DATA
    assert "different cameras" in capsys.readouterr().err


def test_temperatures_have_to_match_the_files(tmp_path: Path) -> None:
    assert main(["calibrate", "doubling", *calibrations(tmp_path), "--temperature-c", "20"]) == EXIT_USAGE
