"""Tables of measured BRDF, in the two layouts that are understood."""

import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from model.stokes import rotation
from model.surface.materials import MATERIALS, assumed_properties, material, surface_of
from model.surface.pbrdf import Surface, mueller
from rigctl.errors import ConfigError
from rigctl.files.materials import find_material, load_material, material_toml, read_brdf_table
from tests.rigctl.example_files import EXAMPLES

SMALLEST = 'name = "mine"\nn = 1.5\nslope_rms = 0.2\n'


def _written(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text)
    return path


def test_a_plain_number_is_assumed_and_of_no_source(tmp_path):
    index = load_material(_written(tmp_path, SMALLEST)).n
    assert (index.at(550e-9), index.standard_uncertainty, index.assumed, index.confidence) == (1.5, 0.0, True, "low")
    assert index.source == "no source given"


def test_what_the_file_leaves_out_is_said_to_be_assumed(tmp_path):
    mine = load_material(_written(tmp_path, SMALLEST))
    assert (mine.k.at(550e-9), mine.specular_weight.at(550e-9), mine.dhr) == (0.0, 1.0, None)
    assert {"k", "specular_weight"} <= set(assumed_properties(mine))
    assert "not in the file" in mine.k.source


def test_a_measured_value_keeps_its_uncertainty_and_its_source(tmp_path):
    measured = '[dhr]\nvalue = 0.31\nstd = 0.01\nsource = "reflectometer"\nconfidence = "high"\nassumed = false\n'
    mine = load_material(_written(tmp_path, SMALLEST + measured))
    assert mine.dhr is not None
    assert (mine.dhr.at(550e-9), mine.dhr.standard_uncertainty, mine.dhr.source) == (0.31, 0.01, "reflectometer")
    assert "dhr" not in assumed_properties(mine)


def test_a_table_holds_at_its_own_wavelengths_to_the_last_digit_and_between_them(tmp_path):
    table = "dhr = { wavelength_nm = [450, 550, 650], value = [0.10, 0.20, 0.40] }\n"
    mine = load_material(_written(tmp_path, SMALLEST + table))
    assert mine.dhr is not None
    assert [mine.dhr.at(w) for w in (450e-9, 550e-9, 650e-9)] == [0.10, 0.20, 0.40]
    # Linear between: two roundings of a number near 0.3.
    assert mine.dhr.at(600e-9) == pytest.approx(0.30, rel=1e-14)


def test_a_material_file_may_have_a_table_alone(tmp_path):
    shutil.copy(EXAMPLES / "measured-panel.csv", tmp_path / "measured.csv")
    path = tmp_path / "panel.toml"
    path.write_text('name = "panel"\ntable = "measured.csv"\n')
    assert load_material(path).name == "panel"
    path.write_text('name = "panel"\ntable = "measured.csv"\nn = 1.5\n')
    with pytest.raises(ConfigError, match="n: is no known key"):
        load_material(path)


def test_the_angle_of_the_dhr_is_in_degrees(tmp_path):
    assert load_material(_written(tmp_path, "dhr_angle_deg = 10\n" + SMALLEST)).dhr_angle_rad == math.radians(10)
    assert load_material(_written(tmp_path, SMALLEST)).dhr_angle_rad == math.radians(8)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("n = 0.0", "n: is 0, must be above 0"),
        ("k = -0.1", "k: is -0.1, must not be below 0"),
        ("dhr = 1.2", r"dhr: is 1.2, must lie in \[0, 1\]"),
        ("specular_weight = -0.5", r"specular_weight: is -0.5, must lie in \[0, 1\]"),
        ("n = { value = [1.5, 1.6] }", "n: has 2 values, needs one"),
        ("n = { value = [1.5, 1.6], wavelength_nm = [400, 500, 600] }", "n: has 2 values"),
        ("n = { value = [1.5, 1.6], wavelength_nm = [500, 400] }", "n: .*does not ascend"),
        ("n = { value = 1.5, std = -0.1 }", "n.std: must be at least 0"),
        ('n = { value = 1.5, source = " " }', "n.source: "),
        ('n = { value = 1.5, confidence = "some" }', "n.confidence: "),
        ("n = true", "first of n.value: must be a number .found true"),
        ('n = "glass"', "first of n.value: must be a number"),
        ("dhr_angle_deg = 90", "dhr_angle_deg: must be below 90"),
        ("colour = 1", "colour: is no known key"),
    ],
)
def test_a_wrong_value_is_named_with_its_key(tmp_path, line, said):
    key = line.split(" = ")[0]
    others = "".join(f"{text}\n" for text in SMALLEST.splitlines() if not text.startswith(f"{key} ="))
    with pytest.raises(ConfigError, match=said):
        load_material(_written(tmp_path, f"{line}\n{others}"))


def test_every_problem_of_a_file_is_named_at_once(tmp_path):
    with pytest.raises(ConfigError, match="3 problems"):
        load_material(_written(tmp_path, 'name = " "\nn = -1\n'))


def test_a_name_of_the_library_is_found_anywhere(tmp_path):
    assert find_material("asphalt", beside=tmp_path) is material("asphalt")


def test_a_relative_file_counts_from_where_it_was_named(tmp_path):
    _written(tmp_path, SMALLEST)
    assert find_material("mine.toml", beside=tmp_path).name == "mine"


def test_neither_name_nor_file_says_what_there_is(tmp_path):
    with pytest.raises(ConfigError, match=r"'teflon'.*black-paint, white-paint, asphalt, glass, aluminium.*none at"):
        find_material("teflon", beside=tmp_path)


def test_the_example_makes_a_surface():
    surface = surface_of(load_material(EXAMPLES / "material-mine.toml"), wavelength_m=550e-9)
    assert (surface.n, surface.slope_rms, surface.dhr, surface.specular_weight) == (1.49, 0.18, 0.064, 0.9)


@pytest.mark.parametrize("name", MATERIALS)
def test_what_is_written_is_read_back(tmp_path, name):
    text = material_toml(material(name))
    read = load_material(_written(tmp_path, text))
    # A wavelength such as 364.66 nm may differ from the library's by its last bit; its text does not.
    assert material_toml(read) == text
    assert read.n.values == material(name).n.values


SURFACE = Surface(n=1.5, slope_rms=0.4, dhr=0.5, diffuse="polarised")
GEOMETRIES = np.array([[30.0, 40.0, 180.0], [60.0, 50.0, 130.0], [60.0, 50.0, -130.0], [10.0, 70.0, 20.0]])
NIST = "lambda,thetai,phi,thetar,phir,f_r11," + ",".join(
    f"f_r{i}{j}/f_r11" for i in range(1, 5) for j in range(1, 5) if (i, j) != (1, 1)
)


def matrices() -> np.ndarray:
    return mueller(*np.deg2rad(GEOMETRIES).T, surface=SURFACE)


def nist_file(path: Path, *, side: float) -> Path:
    """Rows of outgoing light count from axes that stand still; incidence on one side or the other."""
    lines = [NIST]
    for (theta_i, theta_r, phi), matrix in zip(GEOMETRIES, matrices(), strict=True):
        around = phi - 180.0
        still = np.zeros((4, 4))
        still[:3, :3] = rotation(-np.deg2rad(around)) @ matrix / matrix[0, 0]
        numbers = [0.55, side * theta_i, 0.0, theta_r, around + (180.0 if side > 0 else 0.0), matrix[0, 0]]
        lines.append(",".join(f"{number:.10g}" for number in [*numbers, *still.ravel()[1:]]))
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_layout_of_nist_is_turned_into_the_projects_axes(tmp_path: Path, side: float) -> None:
    read = read_brdf_table(nist_file(tmp_path / "nist.csv", side=side))
    np.testing.assert_allclose(read.wavelength_m, 550e-9)
    there = mueller(read.theta_i_rad, read.theta_r_rad, read.phi_rad, surface=SURFACE)
    np.testing.assert_allclose(read.f00_per_sr, there[:, 0, 0], rtol=1e-9)
    np.testing.assert_allclose(read.ratios, there / there[:, :1, :1], atol=1e-8)


def test_what_was_not_measured_is_not_made_up(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text("incidence_deg,reflection_deg,azimuth_deg,wavelength_nm,f00_per_sr,dolp\n30,40,180,550,0.3,0.1\n")
    read = read_brdf_table(path)
    assert read.is_degree
    assert np.isnan(read.ratios[0, 2, 0])
    assert read.ratios[0, 1, 0] == 0.1


def test_every_wrong_row_is_named_at_once(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text(
        "incidence_deg,reflection_deg,azimuth_deg,wavelength_nm,f00_per_sr,s1,s2\n"
        "95,40,180,550,0.3,0,0\n30,x,180,550,0.3,0,0\n30,40,180,550,-0.3,0,2\n"
    )
    with pytest.raises(ConfigError) as caught:
        read_brdf_table(path)
    message = str(caught.value)
    for part in (
        "line 2: incidence_deg is 95",
        "line 3: reflection_deg is 'x'",
        "line 4: f00_per_sr",
        "line 4: s2 is 2",
    ):
        assert part in message


def test_an_unknown_layout_is_told_which_are_known(tmp_path: Path) -> None:
    path = tmp_path / "other.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(ConfigError, match="allowed are incidence_deg,reflection_deg"):
        read_brdf_table(path)
