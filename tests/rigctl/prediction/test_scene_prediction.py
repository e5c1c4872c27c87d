import json

import numpy as np
import pytest

from model.effects.names import LIGHT, Effect
from model.prediction import detections_of_sweep
from rigctl.cli import main
from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import ScenePredictor, parse_sweeps
from rigctl.prediction.sweep import Sweep, sweep_over
from rigctl.report.light import light_json, phi_text
from rigctl.report.sweep import sweep_csv, sweep_json, sweep_png, sweep_tables
from rigctl.scene.light import SceneLight, SkyStore
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
    assert found.geometry.phi_deg == pytest.approx(180.0)
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
    with pytest.raises(ConfigError, match=r"no region of .* is given by its material"):
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


def test_a_sweep_over_the_camera_solves_no_sky_anew(predictor, store):
    predictor.predictions()
    before = store.taken + store.computed
    sweep(predictor, "geometry.camera_azimuth_deg=0:180:5")
    sweep(predictor, "regions.paint.slope_rms=0.1:0.2:3")
    assert store.taken + store.computed == before


def test_a_sweep_of_the_exposure(predictor):
    found = sweep(predictor, "acquisition.exposure_ms=0.01:0.02:2")
    s0 = found.series("paint", "s0", "mean")
    assert s0[1] == pytest.approx(2.0 * s0[0])


def test_a_sweep_of_a_scene_given_by_radiance():
    predictor = ScenePredictor(load_scene(EXAMPLES / "scene-panels.toml"), None)
    found = sweep(predictor, "regions.asphalt.stokes_radiance.0=14:28:2")
    s0 = found.series("asphalt", "s0", "mean")
    assert s0[1] == pytest.approx(2.0 * s0[0])


def test_files_of_a_sweep(predictor):
    found = sweep(predictor, "geometry.camera_zenith_deg=20:60:3")
    header, *rows = sweep_csv(found).decode().splitlines()
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
    header, _, last = sweep_csv(found).decode().splitlines()
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
