"""``rigctl predict`` and ``rigctl sky`` on scenes given by materials, from the command line to their files."""

import json

import numpy as np
import pytest

from rigctl.cli import main
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.scene_texts import SCENE, written


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def scene(tmp_path):
    return str(written(tmp_path))


def test_predict_says_what_the_light_is_made_of(scene, capsys):
    assert main(["predict", scene]) == 0
    answer = capsys.readouterr()
    for text in ("phi 180.00 deg", "reflected sun", "reflected sky", "path", "total at the aperture"):
        assert text in answer.out
    assert answer.out.startswith("DoLP of single pixels: paint 0.67")
    assert "optical depth at 550 nm 0.421" in answer.out
    assert "largest uncertainty" in answer.out


def test_a_low_sun_is_refused_with_what_is_allowed(tmp_path, capsys):
    low = str(written(tmp_path, SCENE.replace("zenith_deg = 50.0\naz", "zenith_deg = 86.0\naz")))
    assert main(["predict", low]) == 2
    assert "solar zenith = 86.00 deg, allowed is 0 to 85 deg" in capsys.readouterr().err


def test_a_grid_has_arrays_in_the_order_of_its_axes_and_every_warning(scene, capsys, tmp_path):
    ranges = ("acquisition.exposure_ms=0.02:2:2", "geometry.camera_zenith_deg=20:40:3")
    assert main(["sweep", scene, *ranges, "--roc", "paint,road", "--out", str(tmp_path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [axis["key"] for axis in found["axes"]] == ["acquisition.exposure_ms", "geometry.camera_zenith_deg"]
    assert np.shape(found["regions"]["paint"]["dolp_snr"]["mean"]) == (2, 3)
    assert np.shape(found["roc"]["intensity"]["auc"]) == (2, 3)
    assert np.shape(found["roc"]["stokes"]["p_detection"]) == (2, 3, len(found["roc"]["stokes"]["p_false_alarm"]))
    saturated = [one for one in found["warnings"] if "saturation" in one["message"]]
    assert {tuple(one["index"]) for one in saturated} == {(1, 0), (1, 1), (1, 2)}
    rows = (tmp_path / "sweep.csv").read_text().splitlines()
    assert ["saturation" in row for row in rows[1:]] == [False] * 3 + [True] * 3
    assert json.loads((tmp_path / "sweep.json").read_text())["warnings"] == found["warnings"]


def test_a_saturated_sweep_says_so_in_the_terminal(scene, capsys):
    assert main(["sweep", scene, "acquisition.exposure_ms=0.02:2:2"]) == 0
    found = capsys.readouterr()
    assert "warning" in found.out
    assert "saturation" in found.out


def test_a_prediction_to_a_tolerance_says_that_it_saturates(scene, capsys):
    assert main(["predict", scene, "--set", "acquisition.exposure_ms=2", "--tolerance", "0.05"]) == 0
    assert "saturation" in capsys.readouterr().out


def test_a_number_set_stands_in_place_of_the_files(scene, capsys):
    assert main(["predict", scene, "--set", "acquisition.exposure_ms=0.01", "--tolerance", "0.01", "--json"]) == 0
    set_ = json.loads(capsys.readouterr().out)
    assert main(["sweep", scene, "acquisition.exposure_ms=0.01:0.02:2", "--json"]) == 0
    swept = json.loads(capsys.readouterr().out)
    for statistic in ("mean", "std"):
        value = set_["regions"]["paint"]["s0"][statistic]
        # A sweep keeps 0.01 without being asked. An exposure of the file would be a whole step away.
        assert value == pytest.approx(swept["regions"]["paint"]["s0"][statistic][0], rel=0.02)
    assert any("changed: acquisition.exposure_ms = 0.01" in remark for remark in set_["remarks"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("sweep", "sun.zenith_deg=1:2:3", "sun.zenith_deg=2:3:2"), "sun.zenith_deg is given 2 times"),
        (("sweep", "sun.zenit=1:2", "sun.zenith_deg=20:30:2"), "KEY=start:stop:n"),
        (("predict", "--set", "sun.zenith_deg=1", "--set", "sun.zenith_deg=2"), "given twice"),
        (("sweep", "--set", "sun.zenith_deg=20", "sun.zenith_deg=20:30:2"), "set by --set as well"),
        (("predict", "--set", "sensor.optics_transmittance=1.5"), "allowed is 0 to 1"),
        (("predict", "--set", "sun.zenit_deg=3"), "did you mean"),
        (("predict", "--set", "sun.zenith_deg"), "KEY=VALUE"),
        (("predict", "--roc", "paint,sea"), "two of the scene's regions"),
        (("predict", "--snr", "exact", "--snr", "both"), "specified multiple times"),
    ],
)
def test_what_means_one_thing_is_not_given_twice_nor_wrong(scene, capsys, words, said):
    assert main([words[0], scene, *words[1:]]) == 2
    assert said in capsys.readouterr().err


def test_a_missing_number_of_a_sweep_has_its_reason(scene, capsys):
    unlit = ("--set", "acquisition.exposure_ms=1e-9")
    assert main(["sweep", scene, *unlit, "noise.read_noise_e=1:200:2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["regions"]["paint"].get("dolp_pixels", {"mean": [None, None]})["mean"][1] is None
    assert {(tuple(one["index"]), one["number"]) for one in found["reasons"]} >= {((1,), "paint.dolp_pixels")}


def test_sky_draws_four_panels_and_says_what_it_is(scene, capsys, tmp_path):
    assert main(["sky", scene, "--out", str(tmp_path / "out")]) == 0
    answer = capsys.readouterr().out
    for text in ("sun: zenith 50.00 deg", "largest DoLP", "optical depth", "tier fast"):
        assert text in answer
    content = json.loads((tmp_path / "out" / "sky.json").read_text())
    assert len(content["stokes"]) == len(content["zenith_deg"])
    assert (tmp_path / "out" / "sky.png").read_bytes().startswith(b"\x89PNG")


def test_skies_are_kept_between_runs(scene, tmp_path, monkeypatch):
    assert main(["sky", scene]) == 0
    entries = sorted((tmp_path / "cache" / "rigctl" / "skies").iterdir())
    assert len(entries) == 2  # wavelengths

    def refuse(*arguments, **settings):
        raise AssertionError("a kept sky was solved again")

    monkeypatch.setattr("rigctl.scene.light.solve", refuse)
    assert main(["sky", scene]) == 0


def test_a_damaged_kept_sky_is_computed_anew_and_said_so(scene, tmp_path, capsys):
    assert main(["sky", scene, "--json"]) == 0
    right = json.loads(capsys.readouterr().out)
    entry = sorted((tmp_path / "cache" / "rigctl" / "skies").iterdir())[0]
    data = bytearray(entry.read_bytes())
    data[len(data) // 2] ^= 1
    entry.write_bytes(bytes(data))
    assert main(["sky", scene, "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["stokes"] == right["stokes"]
    assert any("damaged" in remark for remark in again["remarks"])


def test_a_scene_without_sun_has_no_sky(capsys, tmp_path):
    assert main(["sky", str(EXAMPLES / "scene-panels.toml")]) == 2
    assert "[sun], [atmosphere]" in capsys.readouterr().err
