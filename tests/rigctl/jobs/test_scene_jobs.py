"""Verbs on a scene or a material: records come back, files are written where asked for, nothing is printed."""

import pytest

import rigctl
from model.effects.names import Effect
from rigctl.errors import ConfigError
from rigctl.verbs.effects import effects
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.scene_texts import SCENE, written

SINGLE = SCENE.replace('tier = "fast"', 'tier = "single"')


@pytest.fixture(autouse=True)
def cache_folder(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


def test_a_sky_comes_back_and_is_written(tmp_path, capsys):
    found = rigctl.sky(written(tmp_path, SINGLE), out=tmp_path / "sky")
    assert found.sky.sun_zenith_deg == pytest.approx(50.0)
    assert found.dolp.shape == (len(found.zenith_deg), len(found.azimuth_deg))
    assert {path.name for path in (tmp_path / "sky").iterdir()} == {"sky.png", "sky.json"}
    assert capsys.readouterr() == ("", "")


def test_skies_of_kinds_of_aerosol_have_one_of_the_file(tmp_path):
    found = rigctl.sky(written(tmp_path, SINGLE), compare_aerosols=True)
    assert [one.is_chosen for one in found.kinds].count(True) == 1
    assert len(found.kinds) > 1


def test_a_surface_comes_back_and_is_written(tmp_path, capsys):
    found = rigctl.surface("black-paint", sun_zenith_deg=50.0, out=tmp_path / "paint")
    assert (found.sheet.material, found.sheet.sun_zenith_deg) == ("black paint", 50.0)
    names = {path.name for path in (tmp_path / "paint").iterdir()}
    assert names == {"surface.png", "hemisphere.png", "surface.json"}
    assert capsys.readouterr() == ("", "")


def test_a_sun_below_the_surface_is_refused():
    with pytest.raises(ConfigError, match=r"must lie in \[0, 90\)"):
        rigctl.surface("black-paint", sun_zenith_deg=90.0)


def test_effects_come_back_with_what_is_forced():
    found = effects(EXAMPLES / "scene-panels.toml", tolerance=0.02, left_out=["texture"])
    forced = {one.effect for one in found.plan.decisions if one.forced}
    assert forced == {Effect.TEXTURE}
    assert found.checked is None
    assert any("left out by request: texture" in remark for remark in found.remarks)
