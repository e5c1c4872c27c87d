"""Lens of a simulated camera: turned in its rig file while the camera runs."""

import json
from pathlib import Path

import numpy as np
import pytest

from rigctl.cli import main
from rigctl.files.rig_file import load_rig
from rigctl.rig.focus import focus_of
from rigctl.rig.rig import open_rig
from tests.rigctl.example_files import EXAMPLES


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """Return a rig file with its scene beside it."""
    (tmp_path / "rig.toml").write_text((EXAMPLES / "rig-sim.toml").read_text())
    (tmp_path / "scene-panels.toml").write_text((EXAMPLES / "scene-panels.toml").read_text())
    return tmp_path / "rig.toml"


def turn(rig: Path, defocus_mm: float) -> int:
    return main(["sim", "lens", str(rig), "--defocus-mm", str(defocus_mm)])


def test_a_running_camera_sees_the_lens_turned_and_its_sharpness_falls_away_from_the_focus(rig: Path) -> None:
    seen = []
    with open_rig(load_rig(rig), session_name="focus") as devices:
        devices.camera.configure(exposure_s=3e-5, gain_db=0.0)
        for defocus_mm in (-0.1, -0.03, 0.0, 0.03, 0.1):
            assert turn(rig, defocus_mm) == 0
            seen.append(focus_of(devices.camera.take_frame(timeout_s=5.0).counts, bit_depth=12).sharpness)
        rig.write_text("half a file [")
        focus_of(devices.camera.take_frame(timeout_s=5.0).counts, bit_depth=12)
    assert int(np.argmax(seen)) == 2
    assert seen[0] < seen[1] < 0.9 * seen[2]
    assert seen[4] < seen[3] < 0.9 * seen[2]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_only_the_one_key_of_the_file_changes(rig: Path, end: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = rig.read_bytes().replace(b"\n", end.encode())
    rig.write_bytes(before)
    assert turn(rig, 0.25) == 0
    assert turn(rig, -0.5) == 0
    capsys.readouterr()
    assert main(["sim", "lens", str(rig), "--defocus-mm", "0.0166", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["defocus_mm"], told["was_mm"]) == (0.0166, -0.5)
    assert told["blur_px"] == pytest.approx(1.0)
    added = f"defocus_mm = 0.0166{end}".encode()
    assert rig.read_bytes().replace(added, b"") == before
    assert load_rig(rig).simulation.camera.defocus_mm == 0.0166


def test_a_note_behind_the_number_stays(rig: Path) -> None:
    rig.write_text(rig.read_text().replace("bit_depth = 12", "bit_depth = 12\ndefocus_mm = 0.2   # as it came"))
    assert turn(rig, 1.0) == 0
    assert "defocus_mm = 1   # as it came\n" in rig.read_text()


@pytest.mark.parametrize("defocus_mm", [5.1, -7.0, float("nan"), float("inf")])
def test_a_lens_is_not_turned_out_of_its_mount(rig: Path, defocus_mm: float) -> None:
    before = rig.read_bytes()
    assert turn(rig, defocus_mm) == 2
    assert rig.read_bytes() == before


def test_a_file_of_no_simulated_camera_is_refused(rig: Path) -> None:
    text = rig.read_text()
    rig.write_text(
        text[: text.index("# What the simulated rig")]
        .replace("sim:ellx?speed=20", "/dev/x")
        .replace("sim:gc780", "gige:x")
    )
    assert turn(rig, 0.1) == 2
    assert turn(rig.with_name("none.toml"), 0.1) == 2
