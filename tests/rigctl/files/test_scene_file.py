"""The scene file: what it holds, and what is refused with the key and what is allowed."""

import shutil

import numpy as np
import pytest

from model.atmosphere.mie import aerosol_scattering
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
            "texture_covariance is not a covariance",
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
        ([ZENITH, "regions.sea.tilt_deg"], [[1.0, 0.5], [0.5, 1.0]], "'regions.sea.tilt_deg' is not an angle"),
        ([ZENITH, "noise.prnu"], [[1.0, 0.5], [0.5, 1.0]], "'noise.prnu' is not an angle of camera or panel"),
        ([ZENITH, "regions.paint.tilt_deg"], [[1.0, 0.5], [0.5, 1.0]], "regions.paint.tilt_deg is stated as exact"),
        (
            [ZENITH, AZIMUTH, "geometry.camera_roll_deg"],
            [[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]],
            "correlation is impossible",
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


ATMOSPHERE = "wavelengths = 2\n"
FINE = "number_median_radius_um = 0.03\nlog10_sigma = 0.35\nn = 1.53\nk = 0.0066\n"
COARSE = "number_median_radius_um = 0.5\nlog10_sigma = 0.4\nn = 1.53\nk = 0.0066\n"


def modes(*texts, head=""):
    body = "".join(f"[[atmosphere.own_aerosol.modes]]\n{text}" for text in texts)
    return SCENE.replace(ATMOSPHERE, f"{ATMOSPHERE}{head}[atmosphere.own_aerosol]\n{body}")


def loaded(tmp_path, text):
    return load_scene(written(tmp_path, text)).atmosphere


def test_the_dry_rural_aerosol_written_out_has_its_albedo_and_asymmetry(tmp_path):
    air = loaded(tmp_path, modes("number_share = 0.999875\n" + FINE, "number_share = 0.000125\n" + COARSE))
    scattering = aerosol_scattering(air.lower, wavelength_m=550e-9, tolerance=1e-2)
    # The published values have three digits: 0.940 and 0.655.
    assert scattering.ssa == pytest.approx(0.940, abs=1e-3)
    assert scattering.matrix.g == pytest.approx(0.655, abs=1e-3)


def test_a_share_of_volume_is_that_of_as_many_particles(tmp_path):
    sigma, number = 0.5, np.array([0.9, 0.1])
    volume_radius_um = np.array([0.2, 2.0])
    volume = number * volume_radius_um**3 * np.exp(-4.5 * sigma**2)
    texts = [f"volume_median_radius_um = {r}\nln_sigma = {sigma}\nn = 1.5\nk = 0.01\n" for r in volume_radius_um]
    by_number, by_volume = (
        loaded(tmp_path, modes(*(f"{key} = {share}\n{text}" for share, text in zip(shares, texts, strict=True))))
        for key, shares in (("number_share", number), ("volume_share", volume))
    )
    one, other = ([mode.number_share for mode in air.lower.modes] for air in (by_number, by_volume))
    assert other[1] / other[0] == pytest.approx(one[1] / one[0])


def test_sizes_and_indices_as_tables(tmp_path):
    text = (
        "radius_um = [0.1, 0.2, 0.4]\nnumber_per_log_radius = [0.0, 1.0, 0.0]\n"
        "wavelength_nm = [400, 700]\nn = [1.5, 1.4]\nk = [0.01, 0.0]\n"
    )
    (mode,) = loaded(tmp_path, modes(text)).lower.modes
    assert mode.index.at(550e-9) == pytest.approx(1.45 + 0.005j)
    assert mode.sizes.breaks_m == pytest.approx((1e-7, 2e-7, 4e-7))


@pytest.mark.parametrize(
    ("mode", "problem"),
    [
        ("n = 1.5\nk = 0\nln_sigma = 0.5\n", "needs exactly one of number_median_radius_um"),
        ("n = 1.5\nk = 0\nnumber_median_radius_um = 0.1\n", "needs exactly one of ln_sigma"),
        ("volume_share = 1.0\n" + FINE, "volume_share needs volume_median_radius_um"),
        ("volume_share = 1.0\nnumber_share = 1.0\n" + FINE, "one of number_share and volume_share, not both"),
        ("radius_um = [0.1, 0.2]\n" + FINE, "a table of sizes needs radius_um and number_per_log_radius"),
        (FINE.replace("k = 0.0066", "k = -1"), "k = .* 0 or more"),
        (FINE.replace("log10_sigma = 0.35", "ln_sigma = 9"), "ln_sigma = 9"),
        (FINE + "colour = 3\n", "colour: is no known key"),
    ],
)
def test_problems_of_a_mode_are_named(tmp_path, mode, problem):
    with pytest.raises(ConfigError, match=rf"atmosphere.own_aerosol.modes.*{problem}"):
        loaded(tmp_path, modes(mode))


def test_several_modes_need_shares_of_one_kind(tmp_path):
    with pytest.raises(ConfigError, match="several need number_share or volume_share"):
        loaded(tmp_path, modes(FINE, COARSE))
    with pytest.raises(ConfigError, match="all need number_share, or all volume_share"):
        loaded(tmp_path, modes("number_share = 1.0\n" + FINE, COARSE))


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        ("aerosol_optical_depth = 0.2\n", "needs exactly one of visibility_km, aerosol_optical_depth"),
        ("angstrom_exponent = 5.0\n", None),
    ],
)
def test_one_source_of_depth(tmp_path, lines, problem):
    text = SCENE.replace(ATMOSPHERE, ATMOSPHERE + lines)
    if problem is None:
        assert loaded(tmp_path, text).angstrom_exponent.value == 5.0
        return
    with pytest.raises(ConfigError, match=problem):
        loaded(tmp_path, text)


DEPTHS = (
    "measured_depths = [{ wavelength_nm = 440, optical_depth = 0.3 }, { wavelength_nm = %s, optical_depth = 0.1 }]\n"
)


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        (DEPTHS % 870 + "angstrom_exponent = 1.3\n", "give the angstrom_exponent"),
        (DEPTHS % 440, "two different wavelengths"),
    ],
)
def test_measured_depths_stand_alone(tmp_path, lines, problem):
    with pytest.raises(ConfigError, match=problem):
        loaded(tmp_path, SCENE.replace("visibility_km = 23.0\n", lines))


def test_a_table_has_its_own_aerosol(tmp_path):
    text = modes(FINE).replace('tier = "fast"', 'tier = "table"').replace("visibility_km = 23.0", 'table = "sky.npz"')
    with pytest.raises(ConfigError, match="tier 'table' has its own aerosol"):
        loaded(tmp_path, text)
