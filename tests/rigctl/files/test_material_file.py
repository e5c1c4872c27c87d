import math
import shutil
from pathlib import Path

import pytest

from model.surface.materials import MATERIALS, assumed_properties, material, surface_of
from rigctl.errors import ConfigError
from rigctl.files.materials import find_material, load_material, material_toml
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
