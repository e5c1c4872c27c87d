import json

import numpy as np
import pytest

from rigctl.cli import main
from rigctl.errors import ConfigError
from rigctl.report.light import kinds_json, kinds_picture
from rigctl.scene.sky_map import skies_of_kinds, sky_map
from rigctl.verbs.sky import sky
from tests.rigctl.scene_texts import SCENE, scene_of, written

ONE_WAVELENGTH = SCENE.replace("wavelengths = 2", "wavelengths = 1")


@pytest.fixture(autouse=True)
def cache_folder(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))
        yield dict(skies_of_kinds(scene_of(folder, ONE_WAVELENGTH)))


def test_the_file_stands_first_and_every_kind_once(kinds):
    labels = list(kinds)
    assert labels[:3] == ["depolarizing, rural", "polarizing, rural", "spheres, rural"]
    assert labels[3:] == [f"spheres, {name}" for name in ("tropospheric", "water-soluble", "dust", "soot")]
    assert [one["is_chosen"] for one in kinds_json(kinds)["kinds"]] == [True] + 6 * [False]


def test_the_depth_at_550_nm_is_that_of_the_file_in_all_of_them(kinds):
    depths = {sky.remarks[0].split(";")[0] for sky in kinds.values()}
    assert len(depths) == 1


def test_spheres_polarize_most_and_a_depolarizing_aerosol_least(kinds):
    largest = [sky.largest_dolp[0] for sky in list(kinds.values())[:3]]
    assert largest == sorted(largest)
    assert largest[2] > 1.5 * largest[0]


def test_differences_are_from_the_sky_of_the_file(kinds):
    found = kinds_json(kinds)["kinds"]
    assert found[0]["difference"] == {"s0_rms": 0.0, "largest_dolp": 0.0}
    first, _, third, *_ = kinds.values()
    expected = np.max(np.abs(third.dolp - first.dolp))
    assert found[2]["difference"]["largest_dolp"] == pytest.approx(expected)


def test_a_file_of_spheres_is_compared_with_what_it_is_not(tmp_path):
    text = ONE_WAVELENGTH.replace('tier = "fast"', 'tier = "single"\naerosol = "spheres"\naerosol_type = "dust"')
    labels = [label for label, _ in skies_of_kinds(scene_of(tmp_path, text))]
    assert labels[:3] == ["spheres, dust", "depolarizing, dust", "polarizing, dust"]
    assert len(labels) == len(set(labels)) == 7


def test_the_picture_is_one(kinds):
    assert kinds_picture(kinds).startswith(b"\x89PNG")


def test_a_doubt_about_the_kind_is_left_out_of_the_comparison(tmp_path):
    doubt = '[atmosphere.alternative]\naerosol = "spheres"\nshare = 0.5\n'
    text = ONE_WAVELENGTH.replace('tier = "fast"', 'tier = "single"').replace("[[regions]]", doubt + "[[regions]]", 1)
    scene = scene_of(tmp_path, text)
    mixed, (_, alone) = sky_map(scene), next(iter(skies_of_kinds(scene)))
    assert mixed.largest_dolp[0] > 1.1 * alone.largest_dolp[0]


def test_a_scene_without_a_computed_atmosphere_is_refused(tmp_path):
    text = ONE_WAVELENGTH.replace('tier = "fast"\nvisibility_km = 23.0', 'tier = "table"\ntable = "sky.npz"')
    with pytest.raises(ConfigError, match="no computed atmosphere"):
        next(iter(skies_of_kinds(scene_of(tmp_path, text))))


def test_the_command_writes_picture_and_numbers(tmp_path, capsys):
    scene = written(tmp_path, ONE_WAVELENGTH.replace('tier = "fast"', 'tier = "single"'))
    assert main(["sky", str(scene), "--compare-aerosols", "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert "depolarizing, rural *" in shown
    assert (tmp_path / "out" / "sky-aerosols.png").read_bytes().startswith(b"\x89PNG")
    assert len(json.loads((tmp_path / "out" / "sky-aerosols.json").read_text())["kinds"]) == 7
    assert main(["sky", str(scene), "--compare-aerosols", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kinds"][0]["is_chosen"] is True


def test_a_sky_comes_back_in_python_and_is_written_and_nothing_is_printed(tmp_path, capsys):
    scene = written(tmp_path, ONE_WAVELENGTH.replace('tier = "fast"', 'tier = "single"'))
    found = sky(scene, out=tmp_path / "sky")
    assert found.dolp.shape == (len(found.zenith_deg), len(found.azimuth_deg))
    assert {path.name for path in (tmp_path / "sky").iterdir()} == {"sky.png", "sky.json"}
    assert capsys.readouterr() == ("", "")
