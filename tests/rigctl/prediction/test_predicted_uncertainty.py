import numpy as np
import pytest

from benchmarks.trials.pointing import POINTED, drawn, pointing_predictor, propagated
from rigctl.cli import main
from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import ScenePredictor, predicted_uncertainty
from rigctl.report.prediction import input_effect_tables, input_effects_json, with_input_errors
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.scene_texts import written

UNCERTAIN = (EXAMPLES / "scene-panels-uncertain.toml").read_text()
PLAIN = (EXAMPLES / "scene-panels.toml").read_text()


def found_for(tmp_path, text):
    predictor = ScenePredictor(load_scene(written(tmp_path, text)), None)
    predictions = predictor.predict().predictions
    return predictions, predicted_uncertainty(predictor, predictions)


def only(section, stated):
    """Return the plain scene with one section more."""
    return PLAIN.replace("[acquisition]", f"[{section}]\n{stated}\n[acquisition]")


def test_an_offset_of_the_polarizer_moves_s1_by_twice_s2(tmp_path):
    std_deg = 0.1
    predictions, found = found_for(tmp_path, only("rig", f"polarizer_offset_deg = {{ value = 0.0, std = {std_deg} }}"))
    for region, prediction in predictions.items():
        s1, s2 = (prediction.quantities[name]["mean"] for name in ("s1n", "s2n"))
        # First order in 0.0035 rad; what is left, of the other component, is half of its square.
        turned = 2.0 * np.deg2rad(std_deg)
        errors = [found.std_errors[region][name]["mean"] for name in ("s1n", "s2n")]
        assert errors == pytest.approx([turned * abs(s) for s in (s2, s1)], abs=0.5 * turned**2 * (abs(s1) + abs(s2)))


def test_an_exposure_moves_counts_and_no_ratio(tmp_path):
    predictions, found = found_for(
        tmp_path, PLAIN.replace("exposure_ms = 0.03", "exposure_ms = { value = 0.03, std = 0.0003 }")
    )
    for region, prediction in predictions.items():
        s0 = prediction.quantities["s0"]["mean"]
        assert found.std_errors[region]["s0"]["mean"] == pytest.approx(0.01 * s0, rel=1e-9)
        assert found.std_errors[region]["s1n"]["mean"] == pytest.approx(0.0, abs=1e-12)


def test_independent_inputs_add_in_quadrature(tmp_path):
    region, key = "black_panel", ("black_panel", "dolp", "mean")
    _, found = found_for(tmp_path, UNCERTAIN)
    # DoLP is bent in none of these inputs by a tenth of its error.
    assert found.std_errors[region]["dolp"]["mean"] == pytest.approx(np.linalg.norm(found.effects[key]), rel=2e-2)


def test_inputs_are_ranked_by_what_they_move(tmp_path):
    _, found = found_for(tmp_path, UNCERTAIN)
    ranked = found.ranked("black_panel", "dolp")
    assert [name for name, _ in ranked[:2]] == [f"regions.black_panel.stokes_radiance.{k}" for k in range(2)]
    assert [abs(effect) for _, effect in ranked] == sorted((abs(effect) for _, effect in ranked), reverse=True)
    # Another panel's radiance, and what is common to all angles, moves it by nothing.
    assert not {"sensor.f_number", "regions.asphalt.stokes_radiance.0"} & {name for name, _ in ranked}


def test_each_number_of_the_answer_has_its_error(tmp_path):
    predictions, found = found_for(tmp_path, UNCERTAIN)
    answer = with_input_errors(predictions, found)["asphalt"]["dolp"]
    assert set(answer) == {"mean", "std", "mean_std_error_inputs", "std_std_error_inputs"}
    assert input_effects_json(found)["input_effects"]["asphalt"]["dolp"]
    assert [len(table.rows) for table in input_effect_tables(found)] == [6, 6, 6]


def test_without_uncertain_inputs_every_error_is_zero(tmp_path):
    _, found = found_for(tmp_path, PLAIN)
    assert found.std_errors["asphalt"]["dolp"]["mean"] == 0.0
    assert list(input_effect_tables(found)) == []


def test_a_rig_that_is_not_as_recorded_is_predicted(tmp_path):
    turned = ScenePredictor(load_scene(written(tmp_path, only("rig", "polarizer_offset_deg = 2.0"))), None)
    plain = ScenePredictor(load_scene(written(tmp_path, PLAIN)), None)
    aolp = [one.predict().predictions["black_panel"].quantities["aolp_deg"]["mean"] for one in (turned, plain)]
    assert aolp[0] - aolp[1] == pytest.approx(-2.0, abs=1e-9)


def test_a_rig_that_is_not_as_recorded_has_no_prediction_to_a_tolerance(tmp_path):
    turned = ScenePredictor(load_scene(written(tmp_path, only("rig", "polarizer_offset_deg = 2.0"))), None)
    with pytest.raises(ConfigError, match="polarizer_offset_deg = 0"):
        turned.to_tolerance(0.01)


def test_uncertainty_is_of_a_prediction_without_a_tolerance(tmp_path):
    words = ["--uncertainty", "--tolerance", "0.01"]
    assert main(["predict", str(written(tmp_path, UNCERTAIN)), *words]) == 2


def test_the_command_shows_errors_and_what_makes_them(tmp_path, capsys):
    assert main(["predict", str(written(tmp_path, UNCERTAIN)), "--uncertainty"]) == 0
    shown = capsys.readouterr().out
    assert "0.380 ± 0.045" in shown
    assert "regions.black_panel.stokes_radiance.0" in shown


def test_the_command_says_that_inputs_are_uncertain(tmp_path, capsys):
    assert main(["predict", str(written(tmp_path, UNCERTAIN))]) == 0
    assert "--uncertainty" in capsys.readouterr().out


def test_angles_that_are_off_together_are_propagated_as_draws_of_them(tmp_path):
    correlation = 0.9
    predictor = pointing_predictor(tmp_path, correlation)
    places = [predictor.inputs.names.index(key) for key in POINTED[:2]]
    assert predictor.inputs.cov[places[0], places[1]] == pytest.approx(correlation * 2.0 * 2.5)
    # Of eight pairs of draws; the trial has 150. Taken as independent S0 would be three times as uncertain.
    ratio = propagated(predictor) / drawn(predictor, 16)
    assert ratio == pytest.approx(1.0, abs=0.6)


def test_the_listing_says_which_errors_go_together(tmp_path, capsys):
    numbers = "camera_zenith_deg = { value = 53.0, std = 1.0 }\ncamera_azimuth_deg = { value = 0.0, std = 2.0 }\n"
    text = only("geometry", numbers)
    names = ["geometry.camera_zenith_deg", "geometry.camera_azimuth_deg"]
    pointing = f"[pointing]\nparameters = {names}\ncorrelation = [[1.0, -0.6], [-0.6, 1.0]]\n"
    scene = written(tmp_path, text + pointing)
    assert main(["predict", str(scene), "--uncertainty"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "errors of geometry.camera_zenith_deg and geometry.camera_azimuth_deg go together: correlation -0.60" in said
    assert "as [pointing] says" in said
