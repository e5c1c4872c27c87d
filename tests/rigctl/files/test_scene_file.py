import shutil

import pytest

from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.scene_texts import LIGHT, REGIONS, SCENE, SENSOR, written


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("scene-*.toml")), ids=lambda path: path.stem)
def test_every_example_is_a_scene(path):
    assert load_scene(path).regions


def test_a_scene_of_materials_is_read(tmp_path):
    scene = load_scene(written(tmp_path))
    assert scene.has_materials
    assert scene.atmosphere.visibility_km.value == 23.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('material = "asphalt"', "stokes_radiance = [1, 0, 0]\nmaterial = 'asphalt'", "exactly one of stokes_radiance"),
        ('material = "asphalt"\n', "", "exactly one of stokes_radiance and material"),
        ("zenith_deg = 50.0\nazimuth", "azimuth", "exactly one of zenith_deg and time"),
        (
            "zenith_deg = 50.0\nazimuth",
            "time = 2010-05-25T13:07:40-04:00\nzenith_deg = 50.0\nazimuth",
            "exactly one of",
        ),
        ("day_of_year = 145", "day_of_year = 400", "sun.day_of_year"),
        ("camera_azimuth_deg = 0.0", "camera_azimuth_deg = 0.0\nphi_deg = 180", "camera_azimuth_deg and phi_deg"),
        ("camera_azimuth_deg = 0.0\n", "", "camera_azimuth_deg and phi_deg"),
        ("camera_zenith_deg = 50.0", "camera_zenith_deg = 90.0", r"must lie in \[0, 90\)"),
        ("visibility_km = 23.0", "", "visibility_km, aerosol_optical_depth, measured_depths and aeronet"),
        ("visibility_km = 23.0", "visibility_km = 23\naerosol_optical_depth = 0.2", "exactly one of visibility_km"),
        ('tier = "fast"', 'tier = "table"', "needs table"),
        ('tier = "fast"', 'tier = "best"', "atmosphere.tier"),
        ("band_nm = [400, 700]\n", "wavelength_nm = 550\n", "a band of the sensor"),
        ("band_nm = [400, 700]\n", "", "needs wavelength_nm, or a band"),
        ("texture_rms = 0.02", 'extent = "field"', r"also needs \[field_of_view\]"),
        (
            'material = "asphalt"',
            "stokes_radiance = [1, 0, 0]\ntexture_covariance = [[1, 2, 0], [2, 1, 0], [0, 0, 1]]",
            "texture_covariance is no covariance",
        ),
        ('material = "asphalt"', "stokes_radiance = [1, 0, 0]\ntexture_diagonal = [0, 0, 0]", "is for a material"),
        ("azimuth_deg = 180.0\n", "", "also needs sun.azimuth_deg"),
    ],
)
def test_what_does_not_fit_is_refused_with_what_is_needed(tmp_path, old, new, words):
    assert old in SCENE
    with pytest.raises(ConfigError, match=words):
        load_scene(written(tmp_path, SCENE.replace(old, new)))


@pytest.mark.parametrize("table", ["sun", "geometry", "atmosphere"])
def test_a_material_needs_light(tmp_path, table):
    parts = LIGHT.strip().split("[")
    text = "[" + "[".join(part for part in parts if part and not part.startswith(table))
    with pytest.raises(ConfigError, match=rf"also needs \[{table}\]"):
        load_scene(written(tmp_path, 'name = "made"\n' + SENSOR + text + REGIONS))


def test_a_time_needs_a_site_and_a_zone(tmp_path):
    by_time = SCENE.replace(
        "zenith_deg = 50.0\nazimuth_deg = 180.0\nday_of_year = 145\n", "time = 2010-05-25T13:07:40-04:00\n"
    )
    with pytest.raises(ConfigError, match=r"also needs \[site\]"):
        load_scene(written(tmp_path, by_time))
    site = "[site]\nlatitude_deg = 43.085\nlongitude_deg = -77.68\n"
    assert load_scene(written(tmp_path, by_time + site)).sun.time is not None
    with pytest.raises(ConfigError, match=r"sun.time"):
        load_scene(written(tmp_path, by_time.replace("-04:00", "") + site))


def test_a_tilted_region_needs_azimuths(tmp_path):
    by_phi = SCENE.replace("azimuth_deg = 180.0\n", "", 1).replace("camera_azimuth_deg = 0.0", "phi_deg = 180")
    assert load_scene(written(tmp_path, by_phi)).geometry.phi_deg.value == 180.0
    with pytest.raises(ConfigError, match="a tilted region needs azimuths"):
        load_scene(written(tmp_path, by_phi.replace("texture_rms = 0.02", "tilt_deg = 10")))


def test_a_material_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"regions.road: material 'tarmac.toml'"):
        load_scene(written(tmp_path, SCENE.replace('"asphalt"', '"tarmac.toml"')))


def test_a_material_file_is_sought_beside_the_scene(tmp_path):
    (tmp_path / "tarmac.toml").write_text('name = "tarmac"\nn = 1.6\nslope_rms = 0.3\n')
    scene = load_scene(written(tmp_path, SCENE.replace('"asphalt"', '"tarmac.toml"')))
    assert scene.regions[1].material == str(tmp_path / "tarmac.toml")


def test_a_table_of_measured_brdf_is_a_material(tmp_path):
    shutil.copy(EXAMPLES / "measured-panel.csv", tmp_path / "measured.csv")
    for given in ('{ table = "measured.csv" }', '"measured.csv"'):
        scene = load_scene(written(tmp_path, SCENE.replace('"asphalt"', given)))
        assert scene.regions[1].material == str(tmp_path / "measured.csv")
    with pytest.raises(ConfigError, match=r"must be a file that ends in \.csv"):
        load_scene(written(tmp_path, SCENE.replace('"asphalt"', '{ table = "measured.toml" }')))


def test_a_response_table_takes_the_place_of_a_flat_band(tmp_path):
    response = "response = { wavelength_nm = [450, 550, 650], response = [0, 1, 0] }"
    scene = load_scene(written(tmp_path, SCENE.replace("band_nm = [400, 700]", response)))
    assert scene.sensor.response.response == [0, 1, 0]
    with pytest.raises(ConfigError, match="one of response and band_nm"):
        load_scene(written(tmp_path, SCENE.replace("band_nm", response + "\nband_nm")))
    with pytest.raises(ConfigError, match="wavelength_nm must rise"):
        load_scene(written(tmp_path, SCENE.replace("band_nm = [400, 700]", response.replace("450", "560"))))


def test_a_region_given_by_its_material_has_no_radiance_to_paint(tmp_path):
    scene = load_scene(written(tmp_path))
    with pytest.raises(ConfigError, match="region paint is given by its material"):
        scene.regions[0].given_radiance()


@pytest.mark.parametrize(
    "text",
    [
        "width_deg = 15",
        "width_deg = 15\nheight_deg = 15\nfocal_length_mm = 35",
        "focal_length_mm = 35\nwidth_pixels = 782",
    ],
)
def test_a_field_of_view_is_angles_or_a_picture(tmp_path, text):
    with pytest.raises(ConfigError, match="needs width_deg and height_deg, or focal_length_mm"):
        load_scene(written(tmp_path, SCENE + "[field_of_view]\n" + text))


ZENITH, AZIMUTH = "geometry.camera_zenith_deg", "geometry.camera_azimuth_deg"


@pytest.mark.parametrize(
    ("names", "rows", "said"),
    [
        ([ZENITH, AZIMUTH], [[1.0, 1.0], [1.0, 1.0]], "correlation is singular"),
        ([ZENITH, AZIMUTH], [[1.0, 0.5], [0.4, 1.0]], "correlation is not symmetric: [0][1] is 0.5, [1][0] is 0.4"),
        ([ZENITH, AZIMUTH], [[4.0, 0.5], [0.5, 1.0]], "pointing.correlation"),
        ([ZENITH, AZIMUTH], [[0.9, 0.5], [0.5, 1.0]], "not 1 on its diagonal"),
        ([ZENITH, AZIMUTH], [[1.0, 0.5]], "correlation needs 2 rows of 2 numbers"),
        ([ZENITH, ZENITH], [[1.0, 0.5], [0.5, 1.0]], "names one twice"),
        ([ZENITH], [[1.0]], "pointing.parameters"),
        ([ZENITH, "regions.sea.tilt_deg"], [[1.0, 0.5], [0.5, 1.0]], "'regions.sea.tilt_deg' is no angle"),
        ([ZENITH, "noise.prnu"], [[1.0, 0.5], [0.5, 1.0]], "'noise.prnu' is no angle of camera or panel"),
        ([ZENITH, "regions.paint.tilt_deg"], [[1.0, 0.5], [0.5, 1.0]], "regions.paint.tilt_deg is stated as exact"),
        (
            [ZENITH, AZIMUTH, "geometry.camera_roll_deg"],
            [[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]],
            "correlation is that of no errors",
        ),
    ],
)
def test_errors_that_cannot_go_together_are_refused(tmp_path, names, rows, said):
    text = SCENE.replace("camera_zenith_deg = 50.0", "camera_zenith_deg = { value = 50.0, std = 1.0 }")
    text = text.replace(
        "camera_azimuth_deg = 0.0",
        "camera_azimuth_deg = { value = 0.0, std = 2.0 }\ncamera_roll_deg = { value = 0.0, std = 1.0 }",
    )
    with pytest.raises(ConfigError) as refused:
        load_scene(written(tmp_path, f"{text}[pointing]\nparameters = {names}\ncorrelation = {rows}\n"))
    assert said in str(refused.value)
