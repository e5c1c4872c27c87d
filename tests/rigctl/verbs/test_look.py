"""`rigctl look`: maps of a few images, whose angles stand in names or headers."""

import json

import cv2
import numpy as np
import pytest
from astropy.io import fits

from rigctl.cli import main
from rigctl.console import EXIT_DATA, EXIT_USAGE
from rigctl.verbs.look import look

DOLP, AOLP_DEG = 0.4, 30.0
ANGLES_DEG = (0, 45, 90, 135)


def picture(angle_deg, shape=(20, 24)):
    seen = 1500.0 * (1.0 + DOLP * np.cos(2.0 * np.radians(angle_deg - AOLP_DEG)))
    return np.full(shape, round(seen), np.uint16)


def drawn(folder, names, angles=ANGLES_DEG):
    paths = [folder / name for name in names]
    for path, angle in zip(paths, angles, strict=True):
        cv2.imwrite(str(path), picture(angle))
    return paths


def is_right(found):
    assert found.maps.dolp == pytest.approx(np.full((20, 24), DOLP), abs=1e-3)
    assert found.maps.aolp_deg == pytest.approx(np.full((20, 24), AOLP_DEG), abs=0.1)


@pytest.mark.parametrize(
    "names",
    [
        ["a_0.png", "a_45.png", "a_90.png", "a_135.png"],
        ["1-pol0deg.png", "2-pol45deg.png", "3-pol90deg.png", "4-pol135deg.png"],
        ["0_frame12.png", "45_frame13.png", "90_frame14.png", "135_frame15.png"],
        ["p_+0.png", "p_-135.png", "p_-90.png", "p_-45.png"],
    ],
)
def test_four_pictures_and_nothing_else_show_a_map(tmp_path, monkeypatch, capsys, names):
    paths = drawn(tmp_path, names)
    monkeypatch.chdir(tmp_path)
    assert main(["look", *map(str, paths)]) == 0
    first, second, *_ = capsys.readouterr().out.splitlines()
    assert first.startswith("DoLP 0.400 (median")
    assert first.endswith("uncalibrated")
    assert second.startswith("clipped in one image or more: 0 % of the pixels at 2047 DN, 0 % at 0")
    assert (tmp_path / "look.png").read_bytes().startswith(b"\x89PNG")
    is_right(look(paths, out=tmp_path / "again.png"))


def test_a_folder_and_a_mosaic_are_looked_at_too(tmp_path):
    (tmp_path / "set").mkdir()
    drawn(tmp_path / "set", [f"{angle}.png" for angle in ANGLES_DEG])
    is_right(look([tmp_path / "set"], out=tmp_path / "a.png"))
    mosaic = np.zeros((40, 48), np.uint16)
    for k, angle in enumerate((90, 45, 135, 0)):
        mosaic[k // 2 :: 2, k % 2 :: 2] = picture(angle)
    cv2.imwrite(str(tmp_path / "m.png"), mosaic)
    is_right(look([tmp_path / "m.png"], mosaic=(90, 45, 135, 0), out=tmp_path / "b.png"))


def test_a_header_goes_before_a_name(tmp_path, capsys):
    for k, angle in enumerate((0, 60, -60)):
        unit = fits.PrimaryHDU(picture(angle).astype(np.int32))
        unit.header["POLAR"] = f"{angle} Deg"
        unit.writeto(tmp_path / f"{10 * k}.fits")
    words = [str(path) for path in sorted(tmp_path.glob("*.fits"))]
    assert main(["look", *words, "--out", str(tmp_path / "a.png"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert list(found["angles_deg"].values()) == [0.0, 60.0, -60.0]
    assert found["dolp"]["p50"] == pytest.approx(DOLP, abs=1e-3)


@pytest.mark.parametrize(
    ("names", "words", "code", "said"),
    [
        (["1.png", "2.png", "3.png", "4.png"], [], EXIT_USAGE, "say --angles"),  # a counter
        (["x_0.png", "x_90.png", "x_180.png", "x_270.png"], [], EXIT_USAGE, "say --angles"),
        (["a.png", "b.png", "c.png", "d.png"], ["--angles", "0,90,180,270"], EXIT_USAGE, "there are 0, 90 deg"),
        (["a.png", "b.png", "c.png", "d.png"], ["--angles", "0,90"], EXIT_USAGE, "2 angles for 4 files"),
    ],
)
def test_angles_that_are_not_known_are_asked_for(tmp_path, capsys, names, words, code, said):
    paths = drawn(tmp_path, names)
    assert main(["look", *map(str, paths), *words, "--out", str(tmp_path / "l.png")]) == code
    assert said in " ".join(capsys.readouterr().err.split())


def test_pictures_of_two_sizes_are_refused(tmp_path, capsys):
    paths = drawn(tmp_path, [f"{angle}.png" for angle in ANGLES_DEG])
    cv2.imwrite(str(paths[-1]), picture(0, (10, 10)))
    assert main(["look", *map(str, paths), "--out", str(tmp_path / "l.png")]) == EXIT_DATA
    assert "24 x 20 and 10 x 10 pixels" in " ".join(capsys.readouterr().err.split())
