import json
import re

import pytest

from model.effects.effect import Effect
from rigctl.cli import main
from rigctl.files.scene_file import effect_names, effect_of, load_scene
from rigctl.prediction.predict import ScenePredictor
from tests.rigctl.example_files import EXAMPLES, SMALL_SCENE

PANELS = EXAMPLES / "scene-panels.toml"
LAMP = EXAMPLES / "effects" / "lamp.toml"


def answer(capsys, *arguments):
    assert main(["effects", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.fixture
def small(tmp_path):
    def written(extra=""):
        path = tmp_path / "scene.toml"
        path.write_text(SMALL_SCENE.replace("[sensor]", f"{extra}\n[sensor]", 1), encoding="utf-8")
        return path

    return written


def test_verified_bounds_hold_and_times_are_given(capsys):
    found = answer(capsys, PANELS, "--tolerance", 0.02, "--verify")
    assert sorted(one["effect"] for one in found["effects"]) == sorted(effect.value for effect in Effect)
    assert found["violations"] == []
    assert found["time_s"]["all_effects"] > 0.0
    left_out = [one for one in found["effects"] if not one["acts"]]
    assert all(one["actual"]["deviations"] <= one["bound"]["deviations"] + 1e-9 for one in left_out)


def test_table_is_printed_for_people(capsys):
    assert main(["effects", str(LAMP)]) == 0
    text = capsys.readouterr().out
    first, *table = text.splitlines()
    assert re.match(r"\d+ of 17 effects act; \d+ left out, which together change DoLP by at most \S+", first)
    assert "(allowed: 0.005)" in first
    rows = [line for line in table if line.startswith(tuple(effect.value for effect in Effect))]
    assert len(rows) == len(Effect)
    assert max(map(len, rows)) <= 80


def test_verification_adds_a_column_and_ends_with_one_line(capsys, monkeypatch):
    assert main(["effects", str(PANELS), "--verify"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (start,) = [place for place, line in enumerate(lines) if line.startswith("effect ")]
    assert "truly" in lines[start]
    assert max(map(len, lines[start : start + len(Effect) + 1])) <= 80
    assert lines[-1].startswith("Verified: every bound holds")
    monkeypatch.setattr("model.accuracy.effect_check.CheckedEffect.holds", False)
    assert main(["effects", str(PANELS), "--verify", "--wide"]) == 1
    shown = capsys.readouterr().out
    assert "DoLP <=" in shown
    assert "does NOT hold" in shown


def test_verification_obeys_what_a_scene_leaves_out(capsys):
    found = answer(capsys, LAMP, "--without", "quantisation", "--verify")
    assert found["violations"] == []
    (entry,) = [one for one in found["effects"] if one["effect"] == "quantisation"]
    assert entry["actual"]["deviations"] > 0.0


AIRBORNE = EXAMPLES / "scene-airborne.toml"


@pytest.mark.parametrize(
    ("effect", "stated"),
    [
        ("drift", "illumination_drift = 0.01"),
        ("adjacency", "surround_albedo = 0.5"),
        ("polarizer angle", "polarizer_angle_std_deg = 0.2"),
        ("misregistration", "misregistration_px = 0.5"),
    ],
)
def test_what_nobody_stated_is_named_with_its_size_and_the_line_to_add(capsys, tmp_path, effect, stated):
    found = answer(capsys, AIRBORNE)
    (entry,) = [one for one in found["effects"] if one["effect"] == effect]
    assert entry["answer"] == "not stated"
    assert (entry["table"], entry["line"]) == ("[errors]", stated)
    path = tmp_path / "scene.toml"
    path.write_text(f"{AIRBORNE.read_text(encoding='utf-8')}\n[errors]\n{stated}\n", encoding="utf-8")
    whole, with_it = (ScenePredictor(load_scene(one), None).predict().predictions for one in (AIRBORNE, path))
    actual = max(
        abs(with_it[name].quantities["dolp"]["mean"] - one.quantities["dolp"]["mean"]) for name, one in whole.items()
    )
    assert 0.5 * actual <= entry["sizes"][1]["ratios"] <= max(2.0 * actual, 1e-4)


def test_prediction_names_what_nobody_stated_in_one_line(capsys):
    assert main(["predict", str(PANELS), "--tolerance", "0.01"]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("not stated, ")]
    assert "drift" in line
    assert "polarizer angle" not in line


def test_falloff_follows_from_the_field_of_view_unless_frames_have_a_flat_field(capsys, tmp_path):
    (entry,) = [one for one in answer(capsys, AIRBORNE)["effects"] if one["effect"] == "off-axis falloff"]
    assert entry["answer"] == "acts"
    assert entry["sizes"][0]["radiance"] == pytest.approx(0.023, abs=0.001)
    path = tmp_path / "scene.toml"
    path.write_text(f"{AIRBORNE.read_text(encoding='utf-8')}\n[errors]\noff_axis_falloff = false\n", encoding="utf-8")
    (entry,) = [one for one in answer(capsys, path)["effects"] if one["effect"] == "off-axis falloff"]
    assert entry["answer"] == "left out"


def test_the_chart_is_written_with_the_numbers(tmp_path):
    assert main(["effects", str(PANELS), "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "effects.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "out" / "effects.json").read_text())["rule"] == "safe"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["effects", "--without", "coma"], "read-noise"),
        (["effects", "--with", "texture", "--without", "texture"], "both"),
        (["predict", "--effects", "all"], "--tolerance"),
    ],
)
def test_choices_that_cannot_be_are_refused(capsys, arguments, words):
    assert main([arguments[0], str(PANELS), *arguments[1:]]) == 2
    assert words in capsys.readouterr().err


def test_file_that_leaves_an_effect_out_is_predicted_without_it_and_says_so(small):
    whole = ScenePredictor(load_scene(small()), None).predict()
    without = ScenePredictor(load_scene(small('effects = { without = ["read-noise"] }')), None).predict()
    deviations = [one.predictions["left"].quantities["dn_0"]["std_temporal"] for one in (whole, without)]
    assert deviations[1] < deviations[0]
    assert any("left out by request: read-noise" in remark for remark in without.remarks)
    assert not any("left out" in remark for remark in whole.remarks)


def test_errors_of_a_scene_file_reach_the_prediction(small):
    whole = ScenePredictor(load_scene(small()), None).predictions()
    errors = "errors = { illumination_drift = 0.1, polarizer_angle_std_deg = 1.0, misregistration_px = 1.0 }"
    changed = ScenePredictor(load_scene(small(errors)), None).predictions()
    for quantity, statistic in (("dolp", "mean"), ("dn_0", "std_temporal"), ("s1", "std_spatial_mean")):
        one, other = (found["left"].quantities[quantity][statistic] for found in (whole, changed))
        assert abs(other / one - 1.0) > 1e-3


def test_planner_and_accuracy_share_a_tolerance():
    predictor = ScenePredictor(load_scene(LAMP), None)
    plan = predictor.effect_plan(0.02)
    found = predictor.to_tolerance(0.02, effects=plan)
    assert 0.0 < plan.spent.largest <= 0.01
    assert found.tolerance == pytest.approx(0.02 - plan.spent.largest, rel=1e-12)
    assert found.result.effects == plan.active


def test_names_of_files_lead_back_to_effects():
    assert [effect_of(name) for name in effect_names()] == list(Effect)


def test_what_is_left_out_by_request_is_not_said_to_act(capsys):
    assert main(["predict", str(PANELS), "--tolerance", "0.001", "--without", "texture"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "every effect of the scene acts" not in shown
    assert "left out by request: texture" in shown


def test_all_effects_act_where_nothing_decides(capsys):
    found = answer(capsys, PANELS, "--effects", "all")
    assert all(one["acts"] for one in found["effects"])
    assert main(["predict", str(PANELS), "--tolerance", "0.02", "--effects", "all", "--json"]) == 0
    effects = json.loads(capsys.readouterr().out)["effects"]
    assert effects["rule"] == "all"
    assert all(one["acts"] for one in effects["effects"])


def test_a_rig_file_shows_what_each_effect_of_its_pictures_costs(capsys):
    assert main(["effects", str(EXAMPLES / "rig-effects.toml"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    names = ["drift", "beam-wander", "point-spread", "vignetting", "smear", "cosmic-hits", "fixed-pattern"]
    assert [one["effect"] for one in found["rendering"]] == names
    assert 0.0 < sum(one["cost_s"] for one in found["rendering"]) < found["frame_s"]
    assert main(["effects", str(EXAMPLES / "rig-sim.toml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rendering"] == []
