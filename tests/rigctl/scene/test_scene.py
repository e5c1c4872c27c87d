"""The record of a scene: made of file and calibration, its numbers found and set by their keys, its inputs gathered."""

import re

import numpy as np
import pytest

from rigctl.errors import ConfigError
from rigctl.files.place import Place, SiteSection
from rigctl.files.scene_file import load_scene
from rigctl.files.toml import with_std_apart
from rigctl.prediction.predict import ScenePredictor
from rigctl.scene.light import SceneLight, SkyStore, build_scenario
from rigctl.scene.scene import (
    ANGLE,
    EXPOSURE_RATIO,
    OFFSET,
    describe,
    gather,
    get,
    parameters,
    rig_errors,
    scene_of_file,
    with_value,
    with_values,
)
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.noise_records import noise_parameters
from tests.rigctl.scene_texts import SCENE, scene_of, written

SCENES = sorted(path.name for path in EXAMPLES.glob("scene-*.toml"))
FULL = SCENE.replace("[[regions]]", "[errors]\nsurround_albedo = 0.2\n[rig]\nangle_std_deg = 0.1\n[[regions]]", 1)
NOISE = noise_parameters(
    {
        "gain_dn_per_e": {"value": 0.25, "std_error": 0.001, "n": 10},
        "read_noise_e": {"value": 9.0, "std_error": 0.05, "n": 10},
        "dark_current_e_per_s": {"value": -3.0, "std_error": 5.0, "n": 10},
        "black_level_dn": {"value": 60.0, "std_error": 0.01, "n": 10},
        "saturation_e": None,
        "prnu": {"value": 0.004, "std_error": 1e-5, "n": 10},
        "dsnu_e": None,
        "covariance": {"names": ["read_noise_e", "gain_dn_per_e"], "matrix": [[0.0025, -2e-5], [-2e-5, 1e-6]]},
    }
)


def record(path):
    return scene_of_file(load_scene(path))


@pytest.fixture(scope="module")
def panels():
    return record(EXAMPLES / "scene-panels.toml")


def changed_panels(folder, old, new):
    text = (EXAMPLES / "scene-panels.toml").read_text()
    assert old in text
    return record(written(folder, text.replace(old, new, 1)))


@pytest.mark.parametrize("name", SCENES)
def test_every_number_is_described_within_its_range_and_set_by_its_key_alone(name):
    scene = record(EXAMPLES / name)
    before, shown = parameters(scene), {row.key for row in describe()}
    regions = "|".join(re.escape(region.name) for region in scene.regions)
    for parameter in before:
        key = re.sub(rf"^regions\.({regions})\.", "regions.NAME.", parameter.key)
        assert re.sub(r"^rig\.angle_deg\..*", "rig.angle_deg.ANGLE", key) in shown
        assert parameter.least <= parameter.value <= parameter.most, parameter.key
        assert parameter.meaning
        assert parameter.unit or not re.search(r"_(deg|nm|um|mm|m|km|e|dn|px|du|hpa|ms)$", parameter.key)
        moved = 0.5 * parameter.value + 0.25
        after = {one.key: one for one in parameters(with_value(scene, parameter.key, moved))}
        assert after[parameter.key].value == pytest.approx(moved, rel=1e-14)
        assert after[parameter.key].std == parameter.std
        assert [one for one in before if one.key != parameter.key] == [
            one for key, one in after.items() if key != parameter.key
        ]


def test_keys_are_described_once():
    keys = [row.key for row in describe()]
    assert len(keys) == len(set(keys))


def test_several_are_set_at_once_and_the_scene_stays_as_it_was(tmp_path):
    scene = record(written(tmp_path, FULL))
    wanted = {"sun.zenith_deg": 30.0, "regions.paint.n": 1.6, "rig.angle_deg.45": 0.5}
    changed = with_values(scene, wanted)
    assert {key: get(changed, key).value for key in wanted} == wanted
    assert get(scene, "sun.zenith_deg").value == 50.0


def test_a_region_of_a_material_has_no_radiance_and_one_of_a_radiance_no_tilt(tmp_path, panels):
    keys = {parameter.key for parameter in parameters(record(written(tmp_path, FULL)))}
    assert ("regions.paint.tilt_deg" in keys, "regions.paint.stokes_radiance.0" in keys) == (True, False)
    keys = {parameter.key for parameter in parameters(panels)}
    assert ("regions.black_panel.tilt_deg" in keys, "regions.black_panel.stokes_radiance.0" in keys) == (False, True)


def test_a_number_that_is_not_there_says_which_are_alike(panels):
    with pytest.raises(ConfigError, match=r"no number 'noise.read_noise'; did you mean noise.read_noise_e"):
        with_value(panels, "noise.read_noise", 1.0)
    with pytest.raises(ConfigError, match=r"no number 'q'; there are sensor\.pixel_pitch_um, "):
        get(panels, "q")


def test_inputs_put_into_the_scene_are_the_scene(tmp_path):
    inputs = gather(record(written(tmp_path, FULL)))
    assert parameters(inputs.at(inputs.values)) == parameters(inputs.scene)
    moved = gather(inputs.at(inputs.values * 1.5))
    np.testing.assert_allclose(moved.values, inputs.values * 1.5, rtol=1e-14)


def test_units_of_the_file_become_si_and_a_changed_value_reaches_the_scenario(panels):
    scene = with_value(panels, "regions.asphalt.stokes_radiance.1", 0.5)
    scenario = build_scenario(scene, exposure_s=3e-5)
    assert scenario.regions[2].stokes_radiance[1] == 0.5
    assert scenario.sensor.pixel_pitch_m == pytest.approx(8.3e-6)
    assert scenario.sensor.wavelength_m == pytest.approx(550e-9)
    assert scenario.sensor.tau_perpendicular == pytest.approx(0.8 / 500)
    assert scenario.readout.angles_rad == pytest.approx(np.deg2rad([0, 45, 90, 135]))
    assert scenario.readout.channel_names == ("dn_0", "dn_45", "dn_90", "dn_135")


def test_a_calibration_takes_the_place_of_the_assumed_noise_with_the_covariance_of_its_errors(panels):
    assert any("noise.gain_dn_per_e = 0.24" in remark for remark in panels.remarks)
    inputs = gather(scene_of_file(load_scene(EXAMPLES / "scene-panels.toml"), NOISE))
    assert [inputs.of(f"noise.{name}") for name in ("gain_dn_per_e", "prnu")] == [0.25, 0.004]
    # What it cannot give stays assumed; an estimate below zero is used as zero.
    assert [inputs.of(f"noise.{name}") for name in ("dsnu_e", "dark_current_e_per_s")] == [1.0, 0.0]
    said = " ".join(inputs.scene.remarks)
    assert "assumed, not calibrated: noise.dsnu_e = 1" in said
    assert "noise.dark_current_e_per_s: the calibration's estimate -3 is below 0" in said
    places = [inputs.names.index(f"noise.{name}") for name in ("gain_dn_per_e", "read_noise_e")]
    np.testing.assert_array_equal(inputs.cov[np.ix_(places, places)], [[1e-6, -2e-5], [-2e-5, 0.0025]])


def test_a_stated_uncertainty_stands_on_the_diagonal(tmp_path):
    inputs = gather(changed_panels(tmp_path, "f_number = 2.0", "f_number = { value = 2.0, std = 0.02 }"))
    place = inputs.names.index("sensor.f_number")
    assert inputs.cov[place, place] == pytest.approx(4e-4)
    assert np.count_nonzero(inputs.cov) == 1


def test_an_exact_rig_adds_no_inputs(panels):
    assert OFFSET not in gather(panels).names
    assert rig_errors(panels) is None


def test_each_angle_is_an_input_of_its_own_and_a_stated_offset_turns_every_angle(tmp_path):
    rig = "[rig]\nangle_std_deg = 0.2\npolarizer_offset_deg = 1.5\n[[regions]]"
    found = gather(changed_panels(tmp_path, "[[regions]]", rig))
    names = [f"{ANGLE}{angle}" for angle in ("0", "45", "90", "135")]
    assert [name for name in found.names if name.startswith(ANGLE)] == names
    places = [found.names.index(name) for name in names]
    np.testing.assert_allclose(found.cov[np.ix_(places, places)], 0.04 * np.eye(4))
    np.testing.assert_allclose(rig_errors(found.scene).turned_rad, np.deg2rad(1.5))


def test_the_cycle_is_in_the_order_of_the_files_angles(tmp_path):
    scene = scene_of(tmp_path, SCENE.replace("[acquisition]", "[acquisition]\nangles_deg = [0, 90, 45, 135]"))
    assert (scene.rig.angle_names, scene.rig.frame_order) == (("0", "45", "90", "135"), (0, 2, 1, 3))


def test_the_uncertainty_of_the_exposure_is_that_of_its_ratio(tmp_path):
    scene = record(written(tmp_path, SCENE.replace("exposure_ms = 0.03", "exposure_ms = { value = 0.03, std = 3e-4 }")))
    found = gather(scene)
    place = found.names.index(EXPOSURE_RATIO)
    assert found.cov[place, place] == pytest.approx(1e-4)


FIELD = """
[field_of_view]
width_deg = { value = 15.0, std = 0.3 }
height_deg = { range = [14.0, 16.0] }
[errors]
polarizer_angle_std_deg = { value = 1.0, std = 0.2 }
misregistration_px = { value = 0.5, std = 0.1 }
texture_correlation_px = { value = 2.0, std = 0.5 }
illumination_drift = { value = 0.01, std = 0.005 }
surround_albedo = { value = 0.2, std = 0.1 }
"""
STATED = (
    SCENE.replace("day_of_year = 145", "distance_factor = { value = 0.975, std = 0.01 }")
    .replace("wavelengths = 2", "wavelengths = 2\nrelative_humidity = { value = 0.5, std = 0.1 }")
    .replace('material = "asphalt"', 'material = "asphalt"\nextent = "field"')
    .replace("[[regions]]", FIELD + "[[regions]]", 1)
)
NEW = {
    "sun.distance_factor": (0.975, 0.01),
    "atmosphere.relative_humidity": (0.5, 0.1),
    "field_of_view.width_deg": (15.0, 0.3),
    "field_of_view.height_deg": (15.0, 2.0 / np.sqrt(12.0)),
    "errors.polarizer_angle_std_deg": (1.0, 0.2),
    "errors.misregistration_px": (0.5, 0.1),
    "errors.texture_correlation_px": (2.0, 0.5),
    "errors.illumination_drift": (0.01, 0.005),
    "errors.surround_albedo": (0.2, 0.1),
}
BY_TIME = SCENE.replace(
    "zenith_deg = 50.0\nazimuth_deg = 180.0\nday_of_year = 145",
    "time = 2010-05-25T10:09:40-04:00\n[site]\nlatitude_deg = { value = 43.085, std = 0.5 }\n"
    "longitude_deg = { value = -77.68, std = 0.25 }",
)
COVARIANCE = """
texture_covariance = [
  [{ value = 0.04, std = 0.004 }, 0.01, 0.0],
  [0.01, { value = 0.02, std = 0.002 }, 0.0],
  [0.0, 0.0, 0.02],
]
"""


@pytest.fixture(scope="module")
def light(tmp_path_factory):
    return SceneLight(SkyStore(tmp_path_factory.mktemp("skies")))


@pytest.fixture
def predictor(tmp_path, light):
    return ScenePredictor(load_scene(written(tmp_path, STATED)), None, light=light)


def stated(inputs, name):
    place = inputs.names.index(name)
    return inputs.values[place], np.sqrt(inputs.cov[place, place])


@pytest.mark.parametrize("name", NEW)
def test_a_number_has_the_uncertainty_that_the_file_states(predictor, name):
    assert stated(predictor.inputs, name) == pytest.approx(NEW[name])


@pytest.mark.parametrize("name", NEW)
def test_a_number_moves_the_prediction(predictor, name):
    plain = predictor.predictions()["road"].quantities
    found = predictor.predictions({name: NEW[name][0] + NEW[name][1]})["road"].quantities
    moved = [
        abs(found[quantity][statistic] - value) > 1e-9 * abs(value)
        for quantity, statistics in plain.items()
        for statistic, value in statistics.items()
    ]
    assert any(moved)


@pytest.mark.parametrize(
    ("name", "most"),
    [("atmosphere.relative_humidity", 0.8), ("field_of_view.width_deg", 170.0), ("errors.surround_albedo", 1.0)],
)
def test_a_number_stays_within_its_range(predictor, name, most):
    assert get(predictor.scene, name).most == most


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("relative_humidity = { value = 0.5", "relative_humidity = { value = 0.9"),
        ("width_deg = { value = 15.0", "width_deg = { value = 175.0"),
        ("illumination_drift = { value = 0.01", "illumination_drift = { value = 1.5"),
        ("texture_correlation_px = { value = 2.0", "texture_correlation_px = { value = 0.0"),
        ("distance_factor = {", "day_of_year = 145\ndistance_factor = {"),
    ],
)
def test_a_value_outside_its_range_is_refused(tmp_path, old, new):
    assert old in STATED
    with pytest.raises(ConfigError, match=new.partition(" ")[0] if "day" not in new else "distance_factor"):
        load_scene(written(tmp_path, STATED.replace(old, new)))


def test_a_covariance_of_the_texture_may_be_uncertain(tmp_path):
    text = (EXAMPLES / "scene-panels.toml").read_text()
    first = text.index("texture_rms", text.index("[[regions]]"))
    scene = load_scene(written(tmp_path, text[:first] + COVARIANCE.lstrip() + text[first:]))
    name = f"regions.{scene.regions[0].name}.texture_covariance"
    predictor = ScenePredictor(scene, None)
    assert stated(predictor.inputs, f"{name}.0.0") == pytest.approx((0.04, 0.004))
    assert stated(predictor.inputs, f"{name}.0.1") == (0.01, 0.0)
    wider = predictor.predictions({f"{name}.0.0": 0.05})[scene.regions[0].name].quantities["s0"]
    assert wider["std"] > predictor.predictions()[scene.regions[0].name].quantities["s0"]["std"]


def test_a_covariance_that_is_not_symmetric_is_refused(tmp_path):
    text = (EXAMPLES / "scene-panels.toml").read_text()
    first = text.index("texture_rms", text.index("[[regions]]"))
    lopsided = COVARIANCE.replace("[0.01, { value", "[0.02, { value")
    with pytest.raises(ConfigError, match="not symmetric"):
        load_scene(written(tmp_path, text[:first] + lopsided.lstrip() + text[first:]))


def test_a_site_that_is_not_known_moves_the_sun(tmp_path):
    inputs = gather(scene_of_file(load_scene(written(tmp_path, BY_TIME))))
    places = [inputs.names.index(f"sun.{name}_deg") for name in ("zenith", "azimuth")]
    _, azimuth_rad = np.deg2rad(inputs.values[places])
    cov = inputs.cov[np.ix_(places, places)]
    # Spherical triangle of pole, zenith and sun: dz = -cos(A) dlat - cos(lat) sin(A) dlon, A the azimuth from north.
    by_latitude = 0.5 * np.cos(azimuth_rad)
    by_longitude = 0.25 * np.cos(np.deg2rad(43.085)) * np.sin(azimuth_rad)
    # Refraction is none, the Earth's flattening none; what is left is of the square of half a degree.
    assert cov[0, 0] == pytest.approx(by_latitude**2 + by_longitude**2, rel=1e-3)
    assert np.linalg.eigvalsh(cov)[0] > 0.0
    assert abs(cov[0, 1]) > 0.1 * np.sqrt(cov[0, 0] * cov[1, 1])


def test_a_site_is_the_same_place_with_and_without_an_uncertainty():
    plain = SiteSection(latitude_deg=43.0, longitude_deg=-77.0)
    told = SiteSection.model_validate({"latitude_deg": {"value": 43.0, "std": 0.1}, "longitude_deg": -77.0})
    assert told.place == plain.place
    assert told.std == Place(latitude_deg=0.1, longitude_deg=0.0, elevation_m=0.0)
    assert (told.is_uncertain, plain.is_uncertain) == (True, False)
    assert SiteSection.model_validate(told.model_dump()) == told


def test_a_standard_uncertainty_stands_apart_by_name():
    found = with_std_apart({"a_deg": {"value": 2.0, "std": 0.5}, "b_m": 1.0}, "a_deg", "b_m")
    assert found == {"a_deg": 2.0, "a_std_deg": 0.5, "b_m": 1.0}


def test_what_is_no_table_is_left_to_the_check_of_types():
    assert with_std_apart("text", "a_deg") == "text"
