"""Tables of measured BRDF, in the two layouts that are understood."""

from pathlib import Path

import numpy as np
import pytest

from model.stokes import rotation
from model.surface.pbrdf import Surface, mueller
from rigctl.errors import ConfigError
from rigctl.files.materials import read_brdf_table

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
