import numpy as np
import pytest

from model.stokes import aolp_rad
from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from rigctl.scene.light import SceneLight, SkyStore, camera_view
from rigctl.scene.reading import scene_of_file
from rigctl.scene.scene import with_value, with_values
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.scene_texts import SCENE, written


@pytest.fixture(scope="module")
def light(tmp_path_factory):
    return SceneLight(SkyStore(tmp_path_factory.mktemp("skies")))


def region_light(light, tmp_path, text=SCENE, *, region=0, **changes):
    scene = with_values(scene_of_file(load_scene(written(tmp_path, text))), changes)
    return light.region(scene, scene.regions[region])


# A facet that mirrors a sun at 43 deg into a camera at 53 deg across, phi = +90 deg: sun in the west, camera south.
SIDE = (
    SCENE.replace("zenith_deg = 50.0\nazimuth_deg = 180.0", "zenith_deg = 43.0\nazimuth_deg = 270.0")
    .replace(
        "camera_zenith_deg = 50.0\ncamera_azimuth_deg = 0.0", "camera_zenith_deg = 53.0\ncamera_azimuth_deg = 180.0"
    )
    .replace('"black-paint"', '"mirror.toml"')
)


def test_sign_of_s2_through_the_whole_chain_by_compass_azimuths(light, tmp_path):
    (tmp_path / "mirror.toml").write_text('name = "facets"\nn = 1.5\nslope_rms = 0.3\n')
    sun = region_light(light, tmp_path, SIDE).mean("reflected_sun")
    assert sun[2] / sun[0] == pytest.approx(0.440, abs=5e-4)


def test_phi_says_the_same_as_two_azimuths(light, tmp_path):
    (tmp_path / "mirror.toml").write_text('name = "facets"\nn = 1.5\nslope_rms = 0.3\n')
    by_phi = SIDE.replace("azimuth_deg = 270.0\n", "", 1).replace("camera_azimuth_deg = 180.0", "phi_deg = 90.0")
    np.testing.assert_allclose(
        region_light(light, tmp_path, by_phi).mean(), region_light(light, tmp_path, SIDE).mean(), rtol=1e-9
    )


def test_a_camera_that_rolls_sees_a_lower_angle(light, tmp_path):
    straight, rolled = (
        region_light(light, tmp_path, **{"geometry.camera_roll_deg": roll}).mean() for roll in (0.0, 10.0)
    )
    lowered = np.degrees(aolp_rad(straight) - aolp_rad(rolled)) % 180.0
    assert lowered == pytest.approx(10.0)


def test_a_field_of_view_is_cut_into_tiles(light, tmp_path):
    field = "[field_of_view]\nwidth_deg = 15\nheight_deg = 15\ntiles_per_side = 3\n"
    text = SCENE.replace("texture_rms = 0.02", 'extent = "field"') + field
    assert len(region_light(light, tmp_path, text, region=0).lights) == 1
    assert len(region_light(light, tmp_path, text, region=1).lights) == 9


def test_a_rectangle_of_the_picture_has_its_own_place_in_the_field(light, tmp_path):
    field = "[field_of_view]\nfocal_length_mm = 3\nwidth_pixels = 96\nheight_pixels = 48\ntiles_per_side = 3\n"
    whole = SCENE.replace("texture_rms = 0.02", 'extent = "field"') + field
    part = whole.replace('"field"', '"rectangle"')
    # 96 pixels of 8.3 um behind 3 mm are 15 deg; the rectangle is 40 of them, right of the middle.
    assert region_light(light, tmp_path, whole, region=1).spread > region_light(light, tmp_path, part, region=1).spread


def test_a_rectangle_without_a_picture_is_refused(light, tmp_path):
    field = "[field_of_view]\nwidth_deg = 15\nheight_deg = 15\n"
    text = SCENE.replace("texture_rms = 0.02", 'extent = "rectangle"') + field
    with pytest.raises(ConfigError, match=r"region road: extent = .rectangle. needs"):
        region_light(light, tmp_path, text, region=1)


def test_a_field_above_the_horizon_is_refused_by_name(light, tmp_path):
    field = "[field_of_view]\nwidth_deg = 15\nheight_deg = 15\n"
    text = SCENE.replace("texture_rms = 0.02", 'extent = "field"').replace(
        "camera_zenith_deg = 50.0", "camera_zenith_deg = 85.0"
    )
    with pytest.raises(ConfigError, match=r"region road: field of view: it reaches above the horizon"):
        region_light(light, tmp_path, text + field, region=1)


def test_a_low_sun_is_refused_by_name(light, tmp_path):
    with pytest.raises(ConfigError, match=r"scene made: solar zenith = 86.00 deg, allowed is 0 to 85 deg"):
        region_light(light, tmp_path, **{"sun.zenith_deg": 86.0})


def test_a_surface_that_cannot_be_is_refused_by_name(light, tmp_path):
    with pytest.raises(ConfigError, match=r"region paint: dhr = 0.01 is inconsistent"):
        region_light(light, tmp_path, **{"regions.paint.dhr": 0.01})


def test_what_was_computed_is_not_computed_again(light, tmp_path):
    first = region_light(light, tmp_path)
    assert region_light(light, tmp_path) is first
    assert region_light(light, tmp_path, **{"noise.read_noise_e": 3.0}) is first
    assert region_light(light, tmp_path, **{"regions.paint.n": 1.51}) is not first


def test_the_remarks_name_depth_tier_and_the_largest_uncertainty(light, tmp_path):
    text = " ".join(light.remarks(scene_of_file(load_scene(written(tmp_path)))))
    assert "optical depth at 550 nm 0.421" in text
    assert "tier fast (radiance 0.3 %" in text
    assert "kind of aerosol is the largest uncertainty" in text


def test_a_camera_that_keeps_its_azimuth_from_noon_sees_another_phi():
    scene = scene_of_file(load_scene(EXAMPLES / "scene-rooftop-morning-by-time.toml"))
    assert scene.sun.zenith_deg.value == pytest.approx(43.0, abs=0.03)
    azimuth_deg = scene.sun.azimuth_deg.value
    turned = np.degrees(np.radians(azimuth_deg) - camera_view(scene).azimuth_rad)
    assert turned == pytest.approx(90.0, abs=0.05)
    kept = camera_view(with_value(scene, "geometry.camera_azimuth_deg", 0.0))
    assert azimuth_deg - np.degrees(kept.azimuth_rad) == pytest.approx(106.45, abs=0.05)


def test_time_and_place_are_as_good_as_angles(light):
    found = []
    for name in ("scene-rooftop-noon", "scene-rooftop-noon-by-time"):
        scene = load_scene(EXAMPLES / f"{name}.toml")
        fast = scene.model_copy(update={"atmosphere": scene.atmosphere.model_copy(update={"tier": "fast"})})
        record = scene_of_file(fast)
        found.append(light.region(record, record.regions[0]).mean())
    # The sun stands 0.067 deg lower than 22: the lobe of the paint, some 15 deg wide, is brighter by 0.7 %.
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=0.01 * found[0][0])
