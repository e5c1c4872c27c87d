"""The light of a scene as plain radiances: a scene file that a simulated rig paints."""

import json

import numpy as np
import pytest

from benchmarks.trials.pointing import POINTED, drawn, pointing_predictor, propagated
from model.effects.effect import LIGHT, Effect
from model.prediction import detections_of_sweep
from rigctl.cli import main
from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import ScenePredictor, parse_sweeps, predicted_uncertainty
from rigctl.prediction.sweep import Sweep, sweep_over
from rigctl.prediction.truth_file import write_truth
from rigctl.report.light import light_json, phi_text
from rigctl.report.prediction import input_effect_tables, input_effects_json, quantity_tables, with_input_errors
from rigctl.report.sweep import sweep_json, sweep_png, sweep_table, sweep_tables
from rigctl.scene.light import SceneLight, SkyStore, build_scenario
from rigctl.scene.scene import gather, scene_of_file
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.scene_texts import SCENE, written


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return SkyStore(tmp_path_factory.mktemp("skies"))


@pytest.fixture
def predictor(store, tmp_path):
    return ScenePredictor(load_scene(written(tmp_path)), None, light=SceneLight(store))


def sweep(predictor: ScenePredictor, request: str) -> Sweep:
    return sweep_over(predictor, parse_sweeps([request]))


def snr(predictions, region="paint"):
    return predictions[region].quantities["dolp_snr"]["mean"]


def test_materials_become_numbers_with_their_uncertainties(tmp_path):
    inputs = gather(scene_of_file(load_scene(written(tmp_path))))
    place = inputs.names.index("regions.paint.slope_rms")
    assert (inputs.values[place], inputs.cov[place, place]) == pytest.approx((0.15, 0.04**2))
    assert any("slope_rms" in remark and "black paint" in remark for remark in inputs.scene.remarks)


def test_the_effective_wavelength_follows_from_the_band(tmp_path):
    inputs = gather(scene_of_file(load_scene(written(tmp_path))))
    # By its own spectrum, which falls by a fifth from 460 to 700 nm, sunlight has its mean a little below the middle.
    assert inputs.of("sensor.wavelength_nm") == pytest.approx(545.0, abs=1.0)
    stated = SCENE.replace("band_nm", "wavelength_nm = 600\nband_nm")
    assert scene_of_file(load_scene(written(tmp_path, stated))).sensor.wavelength_nm.value == 600.0


def test_parts_of_the_light_are_kept_apart(predictor):
    found = predictor.predict()
    parts = light_json(found)["light"]["paint"]
    total = np.add(np.add(parts["reflected_sun"], parts["reflected_sky"]), parts["path"])
    np.testing.assert_allclose(total, parts["total"])
    assert all(parts[part][0] > 0.0 for part in ("reflected_sun", "reflected_sky", "path"))
    assert found.geometry["phi_deg"] == pytest.approx(180.0)
    assert json.dumps(light_json(found))


def test_each_part_can_be_predicted_alone(store, tmp_path):
    scene = load_scene(written(tmp_path))
    counts = {
        source: ScenePredictor(scene, None, light=SceneLight(store), source=source).predictions()["road"]
        for source in ("total", "reflected", "path")
    }
    total, reflected, path = (counts[source].quantities["s0"]["mean"] for source in ("total", "reflected", "path"))
    assert total == pytest.approx(reflected + path)
    # Texture is of the surface: the light of the path has none.
    assert counts["path"].channels.scene_cov_dn2 == pytest.approx(0.0)
    assert counts["total"].channels.scene_cov_dn2 == pytest.approx(counts["reflected"].channels.scene_cov_dn2)


def test_a_part_of_given_radiance_is_refused():
    with pytest.raises(ConfigError, match=r"no region of .* has a material"):
        ScenePredictor(load_scene(EXAMPLES / "scene-panels.toml"), None, source="path")


def test_the_noise_factor_multiplies_temporal_noise_alone(predictor):
    one, three = (predictor.predictions({"noise.noise_factor": factor})["road"].channels for factor in (1.0, 3.0))
    np.testing.assert_allclose(three.temporal_var_dn2, 9.0 * one.temporal_var_dn2)
    np.testing.assert_array_equal(three.scene_cov_dn2, one.scene_cov_dn2)


def test_a_sweep_says_what_single_predictions_say(predictor):
    found = sweep(predictor, "geometry.camera_zenith_deg=20:60:3")
    np.testing.assert_allclose(found.values, [20.0, 40.0, 60.0])
    single = predictor.predictions({"geometry.camera_zenith_deg": 40.0})
    assert found.series("paint", "dolp_snr", "mean")[1] == snr(single)


def test_a_sweep_over_the_camera_solves_no_sky_anew(predictor, monkeypatch):
    predictor.predictions()
    monkeypatch.setattr(SkyStore, "__call__", lambda *_, **__: pytest.fail("a sky was solved again"))
    sweep(predictor, "geometry.camera_azimuth_deg=0:180:5")
    sweep(predictor, "regions.paint.slope_rms=0.1:0.2:3")


def test_files_of_a_sweep(predictor):
    found = sweep(predictor, "geometry.camera_zenith_deg=20:60:3")
    header, *rows = sweep_table(found).csv().splitlines()
    columns = header.split(",")
    assert columns[0] == "geometry.camera_zenith_deg"
    place = columns.index("paint.dolp_snr.mean")
    assert [float(row.split(",")[place]) for row in rows] == found.series("paint", "dolp_snr", "mean").tolist()
    content = json.loads(json.dumps(sweep_json(found), allow_nan=False))
    assert content["regions"]["paint"]["dolp_snr"]["mean"] == found.series("paint", "dolp_snr", "mean").tolist()
    assert sweep_png(found).startswith(b"\x89PNG")


def test_a_sweep_shows_detection_of_each_pair(predictor):
    found = sweep(predictor, "geometry.camera_zenith_deg=20:60:2")
    assert found.pairs == (("paint", "road"), ("road", "paint"))
    (alone,) = detections_of_sweep([predictor.predictions({"geometry.camera_zenith_deg": 60.0})], [1e-2])
    assert found.detection(("paint", "road"), 1e-2)[1] == pytest.approx(alone[0].p_detection[0])
    header, _, last = sweep_table(found).csv().splitlines()
    place = header.split(",").index("paint_on_road.p_detection.0.01")
    assert float(last.split(",")[place]) == found.detection(("paint", "road"), 1e-2)[1]
    assert sweep_json(found)["detection"][1]["p_detection"]["0.01"] == found.detection(("road", "paint"), 1e-2).tolist()
    *of_regions, of_pairs = sweep_tables(found)
    assert [table.title for table in of_regions] == ["paint", "road"]
    assert of_pairs.title == "P_D at P_FA 0.001"
    assert of_pairs.columns[-1].title == "road on paint"


def test_independent_texture_reaches_the_prediction(store, tmp_path):
    text = SCENE.replace("texture_rms = 0.02", "texture_diagonal = [0.05, 0.04, 0.03]")
    scene = load_scene(written(tmp_path, text))
    predictor = ScenePredictor(scene, None, light=SceneLight(store))
    one = predictor.predictions()["road"].channels.scene_cov_dn2
    double = predictor.predictions({f"regions.road.texture_diagonal.{k}": 2 * (0.05, 0.04, 0.03)[k] for k in range(3)})
    np.testing.assert_allclose(double["road"].channels.scene_cov_dn2, 4.0 * one)
    assert np.linalg.matrix_rank(one) == 3


def test_phi_is_never_said_to_be_minus_180():
    assert [phi_text(one) for one in (-179.9999, -179.98, 180.0)] == ["180.00", "-179.98", "180.00"]


GRID = ["sensor.f_number=2:2.5:3", "acquisition.exposure_ms=0.1:0.2:3"]


def test_a_grid_keeps_a_tolerance_and_says_of_each_point_whether_it_was_judged(capsys):
    panels = str(EXAMPLES / "scene-panels.toml")
    assert main(["sweep", panels, *GRID, "--tolerance", "0.01", "--effects", "all", "--json"]) == 0
    accuracy = json.loads(capsys.readouterr().out)["accuracy"]
    assert accuracy["judged"] == [True, False, True, False, True, False, True, False, True]
    assert max(accuracy["largest_error"]) <= 0.01
    assert accuracy["left_out"] == [[]] * 9
    assert (accuracy["spot_checks"], accuracy["spot_checks_held"]) == (1, 1)


def test_the_rule_of_effects_is_of_a_tolerance(capsys):
    assert main(["sweep", str(EXAMPLES / "scene-panels.toml"), *GRID, "--effects", "safe"]) == 2
    assert "give --tolerance" in capsys.readouterr().err


def test_in_daylight_no_bound_is_looked_for_of_one_scene():
    day, lamp = (
        ScenePredictor(load_scene(EXAMPLES / "effects" / f"{name}.toml"), None).effect_plan(0.01)
        for name in ("roof-3m", "lamp")
    )
    assert {one.effect for one in day.decisions if one.reason == "no useful bound"} == LIGHT
    assert not lamp.active >= LIGHT - {Effect.ADJACENCY}


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
    assert "as [pointing] states" in said


def test_the_truth_is_a_scene_file_of_the_same_light(tmp_path):
    write_truth(EXAMPLES / "scene-roof.toml", tmp_path / "truth.toml")
    truth = load_scene(tmp_path / "truth.toml")
    assert not truth.has_materials
    scenes = [scene_of_file(file) for file in (load_scene(EXAMPLES / "scene-roof.toml"), truth)]
    computed, stated = (build_scenario(scene, exposure_s=1e-5) for scene in scenes)
    assert [region.name for region in stated.regions] == ["black_panel", "white_panel", "asphalt"]
    for one, other in zip(computed.regions, stated.regions, strict=True):
        assert other.stokes_radiance == pytest.approx(one.stokes_radiance, rel=1e-14)
        assert np.allclose(other.aperture_moments().cov, one.aperture_moments().cov, rtol=1e-12, atol=0.0)
    assert "# Sun: zenith 22.07 deg" in (tmp_path / "truth.toml").read_text()


def test_what_is_left_of_rounding_is_zero_and_a_small_mean_is_not():
    regions = {"panel": {"s2": {"mean": 8.3e-13, "std": 29.0}, "dolp": {"mean": 8.3e-7, "std": 0.01}}}
    (table,) = quantity_tables(regions)
    mean = next(column for column in table.columns if column.title == "mean")
    assert [mean.text(row) for row in table.rows] == ["0", "8.300e-07"]
