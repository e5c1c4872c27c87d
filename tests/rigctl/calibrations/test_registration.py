"""``rigctl calibrate registration`` on a run whose picture walks, and on a real mosaic."""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from rigctl.calibrations.registration import register_run
from rigctl.cli import main
from rigctl.console import EXIT_DATA
from rigctl.runs.folder import read_run
from rigctl.runs.writer import RunWriter
from rigctl.verbs.import_images import import_images
from tests.rigctl.run_samples import make_record, write_run

STAGE_DEG = (0.0, 45.0, 90.0, 135.0)
RADIUS = 2.0


def walking_run(path: Path) -> Path:
    draws = np.random.default_rng(3)
    scene = 1000.0 + 600.0 * cv2.GaussianBlur(draws.standard_normal((240, 300)), (0, 0), 3.0) * 10.0
    with RunWriter.create(path, {"origin": "simulated"}) as writer:
        for stage_deg in STAGE_DEG:
            walk = RADIUS * np.exp(1j * np.radians(stage_deg)) - RADIUS
            motion = np.array([[1.0, 0.0, walk.real], [0.0, 1.0, walk.imag]])
            picture = cv2.warpAffine(scene, motion, (300, 240), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
            counts = np.clip(np.rint(picture), 0, 4095).astype(np.uint16)
            writer.write_frame(
                make_record(
                    writer.next_sequence,
                    stage_angle_deg=stage_deg,
                    polarizer_angle_deg=stage_deg,
                    black_level_dn=0.0,
                    cycle=0,
                ),
                counts,
            )
    return path


def test_the_circle_is_found_and_the_table_has_a_row_an_angle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = str(walking_run(tmp_path / "run"))
    assert main(["calibrate", "registration", run, "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    # OpenCV moves a picture in steps of 1 / 32 pixel; half of that is the error of the truth here.
    assert shown["wander"]["radius_pixels"] == pytest.approx(RADIUS, abs=0.03)
    assert shown["wander"]["residual_pixels"] < 0.04
    assert [row["angle_deg"] for row in shown["angles"]] == list(STAGE_DEG)
    assert main(["calibrate", "registration", run]) == 0
    assert "135.00" in capsys.readouterr().out


def test_small_pictures_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "registration", str(write_run(tmp_path / "run"))]) == EXIT_DATA
    assert capsys.readouterr().err


def test_what_is_kept_moves_frames_of_the_same_devices_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, run = tmp_path / "walk.json", walking_run(tmp_path / "run")
    assert main(["calibrate", "registration", str(run), "--out", str(out)]) == 0
    assert "shifted_frames: " in capsys.readouterr().out
    content = json.loads(out.read_text())
    moved = ["stokes", str(run), "--register", str(out), "--out", str(tmp_path / "stokes")]
    assert main(moved) == 0
    out.write_text(json.dumps(content | {"schema_version": 9}))
    assert main([*moved, "--force"]) == EXIT_DATA
    assert "rigctl calibrate registration" in capsys.readouterr().err


REAL_DATA = os.environ.get("RIGCTL_REAL_DATA")


@pytest.mark.skipif(REAL_DATA is None, reason="set RIGCTL_REAL_DATA to the folder of real frames")
def test_the_pictures_of_a_mosaic_are_half_a_pixel_apart(tmp_path: Path) -> None:
    file = Path(REAL_DATA or "") / "imx250_fruits" / "fruits_IMX250MZR.png"
    import_images(tmp_path / "run", [file], kind="scene", mosaic=(90, 45, 135, 0), black_level_dn=0)
    file, found = register_run(read_run(tmp_path / "run"))
    # 90 and 45 above, 135 and 0 below: a pixel that sits half a pixel to the right sees the scene moved to the left.
    truth = -np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [0.5, 0.5]])
    # Found within 0.12 pixel: fruit is glossy, and its polarization is at its edges.
    np.testing.assert_allclose(found.shift_pixels, truth, atol=0.15)
    assert file["finding"] is not None
