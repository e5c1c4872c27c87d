"""``rigctl surface`` from the command line to tables, numbers and plots."""

import csv
import json
from typing import Any

import numpy as np
import pytest

from model.surface.pbrdf import Surface, mueller
from rigctl.cli import main
from rigctl.console import EXIT_USAGE
from tests.rigctl.example_files import EXAMPLES

PNG = b"\x89PNG\r\n\x1a\n"


def _answer(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["surface", *arguments, "--json"]) == 0
    answer: dict[str, Any] = json.loads(capsys.readouterr().out)
    return answer


def test_the_glint_side_has_positive_angles_and_horizontal_polarization(capsys):
    answer = _answer(capsys, "glass", "--sun-zenith-deg", "50")
    seen = {light["camera_zenith_deg"]: light for light in answer["principal_plane"]}
    there = mueller(np.deg2rad(50.0), np.deg2rad(50.0), np.pi, surface=Surface(n=1.51852, slope_rms=0.02))
    # The same function at the same angles: equal but for the rounding of degrees to radians.
    assert seen[50.0]["f00_per_sr"] == pytest.approx(there[0, 0], rel=1e-12)
    assert seen[50.0]["s1n"] == pytest.approx(there[1, 0] / there[0, 0], rel=1e-12)
    assert seen[50.0]["s1n"] > 0.9


def test_no_light_has_no_degree_of_polarization(capsys):
    seen = {light["camera_zenith_deg"]: light for light in _answer(capsys, "glass")["principal_plane"]}
    assert (seen[-85.0]["f00_per_sr"], seen[-85.0]["s1n"], seen[-85.0]["dolp"]) == (0.0, None, None)


def test_the_reflectance_at_the_angle_of_measurement_is_that_of_the_material(tmp_path, capsys):
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\ndhr_angle_deg = 30\nn = 1.5\nslope_rms = 0.2\ndhr = 0.4\n')
    rows = {row["zenith_deg"]: row for row in _answer(capsys, str(path))["reflectance"]}
    # The diffuse term is fixed by the DHR there; the series of the lobe's share is good to 1e-7 and its quadrature too.
    assert rows[30.0]["total"] == pytest.approx(0.4, abs=2e-7)
    assert rows[30.0]["horizontal"] + rows[30.0]["vertical"] == pytest.approx(2 * rows[30.0]["total"], rel=1e-14)


def test_the_table_says_which_values_are_assumed_and_whence_they_come(capsys):
    assert main(["surface", "glass"]) == 0
    lines = capsys.readouterr().out.splitlines()
    index = next(line for line in lines if line.startswith("n "))
    slope = next(line for line in lines if line.startswith("slope_rms"))
    assert "1.5185" in index
    assert "0.005" in index
    assert "measured" in index
    assert "SCHOTT" in index
    assert "assumed" in slope


def test_columns_keep_their_units(capsys):
    main(["surface", "glass"])
    assert "camera [deg] F00 [1/sr]" in " ".join(capsys.readouterr().out.split())


def test_a_measured_surface_is_refused_where_it_was_not_measured(tmp_path, capsys):
    geometries = tmp_path / "geometries.csv"
    geometries.write_text("incidence_deg,reflection_deg,azimuth_deg\n50,40,180\n80,80,180\n")
    material = str(EXAMPLES / "measured-panel.csv")
    assert main(["surface", material, "--at", str(geometries)]) == EXIT_USAGE
    assert "outside of the measured range" in capsys.readouterr().err
    geometries.write_text("incidence_deg,reflection_deg,azimuth_deg\n50,40,180\n")
    assert main(["surface", material, "--at", str(geometries)]) == 0
    row = next(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert 0.0 < float(row["f00_per_sr_std"]) < 0.01 * float(row["f00_per_sr"])
    out = tmp_path / "measured"
    assert main(["surface", material, "--out", str(out), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["principal_plane"]
    assert (rows[0]["camera_zenith_deg"], rows[-1]["camera_zenith_deg"]) == (-75.0, 75.0)
    assert (out / "hemisphere.png").read_bytes().startswith(PNG)


def test_findings_are_printed(capsys):
    main(["surface", "white-paint", "--shadowing", "none"])
    assert "finding: reflects more" in capsys.readouterr().out


def test_another_wavelength_takes_other_values_of_the_tables(capsys):
    values = {
        wavelength: next(p["value"] for p in _answer(capsys, "glass", "--wavelength-nm", wavelength)["properties"])
        for wavelength in ("400", "550", "1000")
    }
    assert values == {"400": 1.53085, "550": 1.51852, "1000": 1.50750}


def test_forms_of_shadowing_and_of_the_diffuse_term_are_taken(capsys):
    answer = _answer(capsys, "white-paint", "--shadowing", "smith", "--diffuse", "polarised")
    assert (answer["surface"]["shadowing"], answer["surface"]["diffuse"]) == ("smith", "polarised")


def test_plots_and_numbers_go_into_the_folder(tmp_path):
    out = tmp_path / "plots"
    assert main(["surface", str(EXAMPLES / "material-mine.toml"), "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {"surface.png", "hemisphere.png", "surface.json"}
    assert all((out / name).read_bytes().startswith(PNG) for name in ("surface.png", "hemisphere.png"))
    assert json.loads((out / "surface.json").read_text())["material"] == "my weathered panel"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["teflon"], "teflon"),
        (["glass", "--sun-zenith-deg", "90"], "--sun-zenith-deg"),
        (["glass", "--wavelength-nm", "300"], "covers 400 to 1000 nm"),
        (["glass", "--shadowing", "deep"], "smith-correlated"),
    ],
)
def test_what_cannot_be_is_refused_with_its_reason(capsys, arguments, said):
    assert main(["surface", *arguments]) == EXIT_USAGE
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_an_index_that_the_reflectance_does_not_converge_for_is_refused(tmp_path, capsys):
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\nn = 0.5\nslope_rms = 0.2\ndhr = 0.9\nspecular_weight = 0.5\n')
    assert main(["surface", str(path)]) == EXIT_USAGE
    assert "give the absorption k" in capsys.readouterr().err


def test_a_reflectance_below_that_of_the_index_is_inconsistent(tmp_path, capsys):
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\nn = 1.5\nslope_rms = 0.2\ndhr = 0.02\n')
    assert main(["surface", str(path)]) == EXIT_USAGE
    assert "dhr = 0.02 is inconsistent" in capsys.readouterr().err


@pytest.mark.parametrize("dhr", ["0.0", "0.5"])
def test_a_surface_that_is_the_same_from_everywhere_can_be_plotted(tmp_path, dhr):
    path = tmp_path / "dull.toml"
    path.write_text(f'name = "dull"\nn = 1.5\nslope_rms = 0.2\nspecular_weight = 0\ndhr = {dhr}\n')
    assert main(["surface", str(path), "--diffuse", "lambert", "--out", str(tmp_path)]) == 0


def test_every_material_is_listed_with_its_sources(capsys):
    assert main(["surface", "--list", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["materials"]
    assert {"black-paint", "white-paint", "asphalt", "examples/paper/rough-paint.toml"} <= set(found)
    assert all(given["source"] for one in found.values() for given in one.values())
    assert main(["surface", "--list"]) == 0
    assert "rough-asphalt.toml" in capsys.readouterr().out


def test_a_surface_needs_a_material(capsys):
    assert main(["surface"]) == 2
    assert "--list" in capsys.readouterr().err


def test_several_materials_stand_side_by_side_and_in_one_picture(tmp_path, capsys):
    materials = ("black-paint", "asphalt", "glass")
    assert main(["surface", *materials, "--out", str(tmp_path / "out")]) == 0
    first, *lines = capsys.readouterr().out.splitlines()
    single = {name: _answer(capsys, name) for name in materials}
    peaks = {}
    for name, one in single.items():
        f00, dolp = np.array([(light["f00_per_sr"], light["dolp"] or 0.0) for light in one["principal_plane"]]).T
        peaks[name] = dolp[f00 >= f00.max() / 4096].max()  # what 12 bits see beside the brightest
    best = max(peaks, key=lambda name: peaks[name])
    assert first.startswith(f"{single[best]['material']} polarizes most: DoLP {peaks[best]:.3f}")
    assert all(len(line) <= 80 for line in lines)
    assert (tmp_path / "out" / "surface.png").read_bytes().startswith(PNG)
    assert json.loads((tmp_path / "out" / "surface.json").read_text())["materials"] == list(single.values())


def test_geometries_of_a_file_come_back_with_light_and_its_uncertainty(tmp_path, capsys):
    at, mine = tmp_path / "at.csv", tmp_path / "mine.toml"
    at.write_text("wavelength_nm,azimuth_deg,reflection_deg,incidence_deg\n400,180,40,50\n550,90,40,50\n550,0,95,50\n")
    mine.write_text('name = "mine"\nn = { value = 1.5, std = 0.01 }\nslope_rms = 0.2\n')
    assert main(["surface", str(mine), "--at", str(at), "--out", str(tmp_path / "out")]) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert rows == list(csv.DictReader((tmp_path / "out" / "surface.csv").read_text().splitlines()))
    angles = np.deg2rad([[50.0, 40.0, 180.0], [50.0, 40.0, 90.0]]).T
    low, high = (mueller(*angles, surface=Surface(n=n, slope_rms=0.2))[..., 0] for n in (1.49, 1.51))
    for k, row in enumerate(rows[:2]):
        stokes = mueller(*angles[:, k], surface=Surface(n=1.5, slope_rms=0.2))[:, 0]
        expected = [stokes[0], *stokes[1:] / stokes[0], np.hypot(*stokes[1:]) / stokes[0]]
        assert [float(row[key]) for key in ("f00_per_sr", "s1", "s2", "dolp")] == pytest.approx(expected, rel=1e-12)
        # A parabola through the ends has the slope of the middle to second order of 0.01 / 1.5.
        assert float(row["f00_per_sr_std"]) == pytest.approx(abs(high[k, 0] - low[k, 0]) / 2, rel=1e-2)
    assert (rows[2]["f00_per_sr"], rows[2]["dolp"]) == ("0.0", "")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("incidence_deg,reflection_deg\n1,2\n", "lacks the column azimuth_deg"),
        ("incidence_deg,reflection_deg,azimuth_deg\n1,x,3\n", "line 2: reflection_deg is 'x'"),
        ("incidence_deg,reflection_deg,azimuth_deg\n", "has no row"),
        ("incidence_deg,reflection_deg,azimuth_deg\n200,2,3\n", "allowed is 0 to pi"),
    ],
)
def test_a_file_of_geometries_that_cannot_be_read_is_named_with_its_fault(text, words, tmp_path, capsys):
    at = tmp_path / "at.csv"
    at.write_text(text)
    assert main(["surface", "glass", "--at", str(at)]) == EXIT_USAGE
    assert words in " ".join(capsys.readouterr().err.split())
