"""The page of a noise calibration."""

import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.estimate import Bound
from rigctl.calibrations.noise_calibration import calibrate_frames
from rigctl.calibrations.noise_frames import emva_frames
from rigctl.cli import main
from rigctl.report.noise import calibration_rows, snr_png
from tests.rigctl.noise_sessions import SHAPE, write_emva_set, write_noise_run


def write(tmp_path: Path, *options: str) -> Path:
    descriptor = write_emva_set(tmp_path)
    out = tmp_path / "noise.json"
    assert main(["calibrate", "noise", "--emva", str(descriptor), "--out", str(out), *options]) == 0
    return out


def test_the_page_needs_no_other_file_and_names_what_there_is(tmp_path: Path) -> None:
    page = tmp_path / "noise.html"
    write(tmp_path, "--report", str(page))
    text = page.read_text()
    assert not re.search(r"(src|href)=\"(?!data:)", text)
    for heading in ("Photon transfer", "Linearity", "Dark signal", "Fixed pattern", "EMVA 1288 summary sheet"):
        assert f"{heading}</h2>" in text
    # Photon transfer, SNR, linearity, dark signal; maps, histograms, spectrograms.
    assert text.count("data:image/png;base64,") == 7
    assert "saturated_levels" in text
    assert "sigma_d" in text


def test_the_page_of_a_run_says_which_camera(tmp_path: Path) -> None:
    run, page = write_noise_run(tmp_path / "run"), tmp_path / "noise.html"
    arguments = ["--run", str(run), "--out", str(tmp_path / "noise.json"), "--report", str(page)]
    assert main(["calibrate", "noise", *arguments]) == 0
    assert '<td class="l">camera serial</td><td class="l">42</td>' in page.read_text()


def test_numbers_are_shown_to_the_digits_of_their_errors(tmp_path: Path) -> None:
    content = json.loads(write(tmp_path).read_text())
    noise = calibrate_frames(emva_frames(write_emva_set(tmp_path)))
    rows = {(row["quantity"], row["unit"]): row for row in calibration_rows(noise)}
    gain = rows["gain", "DN/e-"]
    assert gain["symbol"] == "K"
    assert float(gain["value"]) == pytest.approx(
        content["gain_dn_per_e"]["value"], abs=content["gain_dn_per_e"]["std_error"]
    )
    assert gain["frames"] == str(content["gain_dn_per_e"]["n"])
    threshold = rows["sensitivity threshold", "e-"]
    assert float(threshold["value"]) == pytest.approx(content["performance"]["threshold_e"]["value"], rel=0.01)


def test_a_read_noise_that_is_a_bound_bounds_the_curve_of_the_signal_to_noise_ratio(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    noise = calibrate_frames(emva_frames(write_emva_set(tmp_path)))
    drawn: list[str] = []
    monkeypatch.setattr(
        "rigctl.report.noise.legend_beside",
        lambda axes: drawn.extend(line.get_label() for line in axes.get_lines()),
    )
    coarse = replace(noise, read_noise_e=None, bounds=noise.bounds | {"read_noise_e": Bound(bound="<", value=19.8)})
    snr_png(coarse)
    assert "at least: read noise below 19.8 e-" in drawn
    assert "flats, temporal noise" in drawn


def test_the_defect_map_is_a_picture_of_the_sensor(tmp_path: Path) -> None:
    content = json.loads(write(tmp_path, "--defects", str(tmp_path / "defects.png")).read_text())
    found = cv2.imread(str(tmp_path / "defects.png"), cv2.IMREAD_UNCHANGED)
    assert found.shape == SHAPE
    assert np.count_nonzero(found) == content["fixed_pattern"]["defects"]["n"]
