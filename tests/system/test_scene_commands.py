"""``rigctl predict`` and ``rigctl sky`` on scenes given by materials, from the command line to their files."""

import json

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
    assert "optical depth at 550 nm 0.421" in answer.err
    assert "largest uncertainty" in answer.err


def test_predict_answers_in_json(scene, capsys):
    assert main(["predict", scene, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert set(content["light"]["paint"]) >= {
        "reflected_sun",
        "reflected_sky",
        "path",
        "total",
        "transmittance",
        "error",
    }
    assert content["geometry"]["sun_zenith_deg"] == 50.0
    assert content["regions"]["paint"]["dolp"]["mean"] > 0.3


def test_a_sweep_writes_table_and_plot(scene, capsys, tmp_path):
    assert main(["predict", scene, "--sweep", "sun.zenith_deg=30:50:3", "--out", str(tmp_path / "out")]) == 0
    assert "sweep of sun.zenith_deg" in capsys.readouterr().out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"sweep.csv", "sweep.json", "sweep.png"}


def test_a_low_sun_is_refused_with_what_is_allowed(tmp_path, capsys):
    low = str(written(tmp_path, SCENE.replace("zenith_deg = 50.0\naz", "zenith_deg = 86.0\naz")))
    assert main(["predict", low]) == 2
    assert "solar zenith = 86.00 deg, allowed is 0 to 85 deg" in capsys.readouterr().err


def test_a_folder_without_a_sweep_is_refused(scene, capsys, tmp_path):
    assert main(["predict", scene, "--out", str(tmp_path / "out")]) == 2
    assert "--sweep" in capsys.readouterr().err


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

    monkeypatch.setattr("rigctl.scene.skies.sky_store.SkyStore._compute", refuse)
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
