"""Numbers of a scene file that may have a standard uncertainty, and reach the model with it."""

import numpy as np
import pytest

from rigctl.errors import ConfigError
from rigctl.files.place import Place, SiteSection
from rigctl.files.scene_file import load_scene
from rigctl.files.toml import with_std_apart
from rigctl.prediction.predict import ScenePredictor
from rigctl.scene.light import SceneLight, SkyStore
from rigctl.scene.scene import gather, get, scene_of_file
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.scene_texts import SCENE, written

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
