"""AERONET files in the layout of version 3, written here, as the air of a scene."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from model.atmosphere.layers import AerosolKind
from model.atmosphere.mie import MieAerosol
from rigctl.errors import ConfigError
from rigctl.files.aeronet import read_aeronet
from rigctl.files.scene_file import load_scene
from tests.rigctl.scene_texts import SCENE, written

HEAD = """AERONET Version 3;
Made_Up
Version 3: {product} Level {level}
The following data are automatically cloud cleared and quality assured.
Contact: PI=Nobody; PI Email=nobody@example.org
{kind},UNITS can be found at,,, https://aeronet.gsfc.nasa.gov/new_web/units.html
"""
DEPTHS = (
    "Date(dd:mm:yyyy),Time(hh:mm:ss),Day_of_Year,AOD_1640nm,AOD_870nm,AOD_675nm,AOD_500nm,AOD_440nm,AOD_Empty,AOD_Empty,"
    "440-870_Angstrom_Exponent,AERONET_Site_Name,Ozone(Dobson)\n"
)
MORNING = "25:05:2010,09:00:00,145,-999.,0.080000,0.11,0.16,0.190000,-999.,-999.,1.27,Made_Up,310.0\n"
NOON = "25:05:2010,17:05:00,145,-999.,0.100000,0.14,0.21,0.240000,-999.,-999.,1.28,Made_Up,330.0\n"
NOON_TIME = datetime(2010, 5, 25, 17, 7, tzinfo=UTC)
RADII = 0.05 * (15.0 / 0.05) ** (np.arange(22) / 21)
INDEX = [f"Refractive_Index-{part}_Part[{nm}nm]" for part in ("Real", "Imaginary") for nm in (440, 675, 870, 1020)]


def depth_file(folder: Path, rows: str = MORNING + NOON, *, level: str = "2.0", kind: str = "All Points") -> Path:
    path = folder / "site.lev20"
    path.write_text(HEAD.format(product="AOD", level=level, kind=kind) + DEPTHS + rows)
    return path


def inversion_file(folder: Path) -> Path:
    volume = 0.05 * np.exp(-0.5 * (np.log(RADII / 0.18) / 0.45) ** 2) + 0.04 * np.exp(
        -0.5 * (np.log(RADII / 2.5) / 0.65) ** 2
    )
    names = ["Site", "Date(dd:mm:yyyy)", "Time(hh:mm:ss)", "AOD_Coincident_Input[440nm]", "AOD_Coincident_Input[870nm]"]
    names += [*INDEX, "Sphericity_Factor(%)", *(f"{radius:.6f}" for radius in RADII)]
    numbers = [0.25, 0.11, 1.45, 1.46, 1.47, 1.48, 0.010, 0.009, 0.008, 0.007, 99.0, *volume]
    row = ",".join(["Made_Up", "25:05:2010", "16:40:00", *(f"{number:.6f}" for number in numbers)])
    path = folder / "site.all"
    head = HEAD.format(product="Almucantar", level="1.5", kind="All Points")
    path.write_text(f"{head}{','.join(names)}\n{row}\n")
    return path


def test_the_row_next_to_a_time_is_taken(tmp_path: Path) -> None:
    found = read_aeronet([depth_file(tmp_path)], near=NOON_TIME)
    assert found.depths == ((440.0, 0.24, 0.01), (870.0, 0.10, 0.01))
    assert found.ozone_du == 330.0
    assert "Made_Up, level 2.0, 2010-05-25 17:05 UTC" in found.source
    assert not found.has_particles


def test_without_a_time_the_spread_of_the_rows_is_an_error(tmp_path: Path) -> None:
    found = read_aeronet([depth_file(tmp_path)], near=None)
    assert found.depths[0] == pytest.approx((440.0, 0.215, np.hypot(0.01, 0.025)))
    assert found.ozone_du == pytest.approx(320.0)


def test_one_wavelength_and_the_exponent_say_the_other(tmp_path: Path) -> None:
    one = NOON.replace("0.100000,0.14,0.21,", "-999.,-999.,-999.,")
    (_, first, _), (nm, second, _) = read_aeronet([depth_file(tmp_path, one)], near=NOON_TIME).depths
    assert (first, nm) == (0.24, 870.0)
    assert second == pytest.approx(0.24 * (870 / 440) ** -1.28)


def test_the_depth_of_the_aod_file_goes_before_that_of_the_inversion(tmp_path: Path) -> None:
    files = [inversion_file(tmp_path), depth_file(tmp_path)]
    found = read_aeronet(files, near=NOON_TIME)
    assert found.depths[0][1] == 0.24
    assert found.n == (1.45, 1.46, 1.47, 1.48)
    assert found.k == (0.010, 0.009, 0.008, 0.007)
    np.testing.assert_allclose(found.radius_um, RADII, atol=1e-6)
    assert read_aeronet(files[:1], near=NOON_TIME).depths[0][1] == 0.25


def test_a_scene_has_the_air_of_its_time(tmp_path: Path) -> None:
    depth_file(tmp_path)
    inversion_file(tmp_path)
    scene = load_scene(written(tmp_path, SCENE.replace("visibility_km = 23.0", 'aeronet = ["site.lev20", "site.all"]')))
    air = scene.atmosphere
    assert air is not None
    assert air.measured_depths is not None
    # The scene states angles and no time: the mean of both rows.
    assert [one.optical_depth.value for one in air.measured_depths] == pytest.approx([0.215, 0.09])
    assert air.ozone_du.value == pytest.approx(320.0)
    assert air.aerosol is AerosolKind.SPHERES
    assert isinstance(air.lower, MieAerosol)
    # Sizes are volumes in the file: the number of the smallest particles is largest by far.
    number = air.lower.modes[0].sizes.number_per_log_radius(np.array([0.1e-6, 2.5e-6]))
    assert number[0] > 1000.0 * number[1]
    assert air.lower.modes[0].index.at(400e-9) == complex(1.45, 0.010)


def test_what_the_scene_states_stays(tmp_path: Path) -> None:
    inversion_file(tmp_path)
    text = 'aeronet = "site.all"\naerosol = "depolarizing"\nozone_du = 300\naerosol_type = "soot"'
    air = load_scene(written(tmp_path, SCENE.replace("visibility_km = 23.0", text))).atmosphere
    assert air is not None
    assert (air.aerosol, air.ozone_du.value, air.lower) == (AerosolKind.DEPOLARIZING, 300.0, "soot")


def test_every_problem_of_a_file_is_named_at_once(tmp_path: Path) -> None:
    rows = MORNING.replace("0.190000", "x") + NOON.replace("25:05:2010", "2010-05-25")
    with pytest.raises(ConfigError) as caught:
        read_aeronet([depth_file(tmp_path, rows)], near=None)
    assert "line 8: AOD_440nm is 'x', must be a number" in str(caught.value)
    assert "line 9: date and time" in str(caught.value)


def test_files_that_do_not_serve_are_refused_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no row within 3 h"):
        read_aeronet([depth_file(tmp_path)], near=datetime(2010, 5, 26, 3, 0, tzinfo=UTC))
    assert read_aeronet([depth_file(tmp_path, kind="Daily Averages")], near=datetime(2010, 5, 26, 3, 0, tzinfo=UTC))
    with pytest.raises(ConfigError, match=r"is of level 1\.0"):
        read_aeronet([depth_file(tmp_path, level="1.0")], near=None)
    with pytest.raises(ConfigError, match="lack optical depths"):
        read_aeronet(
            [depth_file(tmp_path, NOON.replace("0.100000,0.14,0.21,0.240000", "-999.,-999.,-999.,-999."))], near=None
        )
    other = tmp_path / "other.txt"
    other.write_text("a,b\n")
    with pytest.raises(ConfigError, match="AERONET file of version 3"):
        read_aeronet([other], near=None)
