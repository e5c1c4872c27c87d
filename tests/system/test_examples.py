"""Every example file runs as it is."""

import json

import pytest

from rigctl.cli import main
from rigctl.files.regions import load_regions
from rigctl.files.scene_file import load_scene
from rigctl.files.study_file import load_study
from rigctl.prediction.predict import ScenePredictor
from rigctl.study import cases_of
from tests.rigctl.example_files import EXAMPLES

SCENES = sorted(path.name for path in EXAMPLES.glob("scene-*.toml"))
RIGS = sorted(path.name for path in EXAMPLES.glob("rig-*.toml"))
SESSIONS = sorted(path.name for path in EXAMPLES.glob("session*.toml"))
# Of these the first plan wants a rig with a site.
RIG_OF = {"session-rooftop.toml": "rig-rooftop.toml"}
OTHERS = {"material-mine.toml", "regions.toml", "study-panels.toml"}
AT = "2026-05-04T14:00Z"


def named(name):
    return str(EXAMPLES / name)


@pytest.fixture(autouse=True)
def shared_cache(monkeypatch, tmp_path_factory):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


def test_no_example_is_left_out():
    found = {path.name for path in EXAMPLES.glob("*.toml")}
    assert found == {*SCENES, *RIGS, *SESSIONS, *OTHERS}


def test_the_study_is_of_scenes_and_numbers_that_are_there():
    study = load_study(EXAMPLES / "study-panels.toml")
    scenes = [ScenePredictor(load_scene(path), None).scene for path in study.scenes]
    assert len(cases_of(study.cases, scenes)) == 24


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_predicted(name, capsys):
    assert main(["predict", named(name), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["regions"]
    assert all(region["s0"]["mean"] > 0.0 for region in content["regions"].values())


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_plans_a_session(name, capsys):
    assert main(["plan", named(name), named("session.toml"), "--at", AT]) == 0
    assert capsys.readouterr().out


@pytest.mark.parametrize("name", SESSIONS)
def test_a_session_is_planned(name, capsys):
    rig = named(RIG_OF.get(name, "rig-sim.toml"))
    assert main(["plan", rig, named(name), "--at", AT]) == 0
    assert capsys.readouterr().out


def test_a_material_is_shown(capsys):
    assert main(["surface", named("material-mine.toml")]) == 0
    assert "weathered" in capsys.readouterr().out


def test_regions_are_read():
    assert [region.name for region in load_regions(EXAMPLES / "regions.toml")][:2] == ["black_panel", "white_panel"]
