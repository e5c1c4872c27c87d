"""``rigctl fit surface`` from runs with a known surface in them to the fitted material."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from model.surface.materials import material
from model.surface.pbrdf import Surface, Tilt, tilted_mueller
from rigctl.cli import main
from rigctl.console.failures import EXIT_DATA, EXIT_USAGE
from rigctl.files.materials import load_material, load_surface_fit
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.made_runs import at, make_run

# Lambert, because the coupled form is slow in a fit; the forms have their own tests.
TRUTH = Surface(n=1.55, slope_rms=0.2, dhr=0.07, diffuse="lambert")
REGIONS = """
[[regions]]
name = "level"
rectangle = { x = 0, y = 0, width = 40, height = 20 }
[[regions]]
name = "leaning"
rectangle = { x = 0, y = 20, width = 40, height = 20 }
"""
MATERIAL = 'name = "guess"\nn = 1.45\nslope_rms = 0.25\ndhr = 0.1\n'
# Sun zenith and azimuth, camera zenith and azimuth [deg]: a glint and its flank, azimuths that go nowhere near 0.
GEOMETRIES = {"morning": (55.0, 120.0, 50.0, 290.0), "noon": (35.0, 185.0, 50.0, 340.0)}
LEANING = Tilt(tilt_rad=np.deg2rad(20.0), azimuth_rad=np.deg2rad(250.0))
ROLL_DEG = 7.0
LEVELS = {"morning": 3000.0, "noon": 1200.0}


def _stokes(run: str, tilt: Tilt) -> np.ndarray:
    sun, sun_azimuth, camera, camera_azimuth = np.deg2rad(GEOMETRIES[run])
    angles = {
        "sun_zenith_rad": sun,
        "sun_azimuth_rad": sun_azimuth,
        "camera_zenith_rad": camera,
        "camera_azimuth_rad": camera_azimuth,
    }
    matrix = tilted_mueller(**angles, camera_roll_rad=np.deg2rad(ROLL_DEG), tilt=tilt, surface=TRUTH)
    to_sun = np.array([np.sin(sun) * np.sin(sun_azimuth), np.sin(sun) * np.cos(sun_azimuth), np.cos(sun)])
    return matrix[:, 0] * float(to_sun @ tilt.normal)


def _write_run(folder: Path, run: str, *, seed: int) -> None:
    """Counts behind an ideal polarizer, brightest region at the level of the run, noise of one count in a thousand."""
    rng = np.random.default_rng(seed)
    stokes = {"level": _stokes(run, Tilt(tilt_rad=0.0)), "leaning": _stokes(run, LEANING)}
    gain = LEVELS[run] / max(vector[0] for vector in stokes.values())
    frames = []
    for angle_deg in (0.0, 45.0, 90.0, 135.0):
        twice = 2.0 * np.deg2rad(angle_deg)
        analyser = 0.5 * np.array([1.0, np.cos(twice), np.sin(twice)])
        rows = [np.full((20, 40), gain * float(analyser @ stokes[name])) for name in ("level", "leaning")]
        expected = np.concatenate(rows)
        frames.append((at(angle_deg), np.rint(expected + rng.normal(0.0, 3.0, expected.shape) + 0.0).clip(0)))
    make_run(folder / run, frames)


def _observation(run: str, region: str) -> str:
    sun, sun_azimuth, camera, camera_azimuth = GEOMETRIES[run]
    tilt = "tilt_deg = 20.0\ntilt_azimuth_deg = 250.0\n" if region == "leaning" else ""
    return (
        f'[[observation]]\nrun = "{run}"\nregion = "{region}"\n'
        f"sun_zenith_deg = {sun}\nsun_azimuth_deg = {sun_azimuth}\n"
        f"camera_zenith_deg = {camera}\ncamera_azimuth_deg = {camera_azimuth}\ncamera_roll_deg = {ROLL_DEG}\n{tilt}"
    )


HEAD = 'name = "paint"\nregions = "regions.toml"\nmaterial = "guess.toml"\nwavelength_nm = 550\ndiffuse = "lambert"\n'
ALL = [(run, region) for run in GEOMETRIES for region in ("level", "leaning")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fit")
    (path / "regions.toml").write_text(REGIONS)
    (path / "guess.toml").write_text(MATERIAL)
    for seed, run in enumerate(GEOMETRIES):
        _write_run(path, run, seed=seed)
    return path


def _fit_file(folder: Path, observations: list[tuple[str, str]] = ALL, head: str = HEAD) -> Path:
    path = folder / "fit.toml"
    path.write_text(head + "".join(_observation(*observation) for observation in observations))
    return path


def _answer(capsys: pytest.CaptureFixture[str], path: Path, *options: str) -> dict[str, Any]:
    assert main(["fit", "surface", str(path), "--json", *options]) == 0
    answer: dict[str, Any] = json.loads(capsys.readouterr().out)
    return answer


def test_the_truth_lies_within_the_uncertainty(folder, capsys):
    answer = _answer(capsys, _fit_file(folder))
    for name, found in answer["parameters"].items():
        # Five standard errors: three parameters, a chance of 2e-6.
        assert abs(found["value"] - getattr(TRUTH, name)) < 5.0 * found["std_error"], name
        # Known well enough that a wrong turn of the axes, a wrong tilt or a wrong scale would show.
        assert found["std_error"] < 0.02
    # Twelve numbers, three parameters, a scale for each of two runs; an event of one in a thousand would be a bad fit.
    assert answer["degrees_of_freedom"] == 7
    assert answer["p_value"] > 1e-3


def test_a_wrong_roll_of_the_camera_is_noticed(folder, capsys):
    path = _fit_file(folder)
    path.write_text(path.read_text().replace(f"camera_roll_deg = {ROLL_DEG}", "camera_roll_deg = 0.0"))
    answer = _answer(capsys, path)
    assert answer["p_value"] < 1e-9
    assert any("misses the data" in words for words in answer["findings"])


def test_what_is_not_modelled_widens_the_uncertainty(folder, capsys):
    plain = _answer(capsys, _fit_file(folder))["parameters"]["n"]["std_error"]
    wide = _answer(capsys, _fit_file(folder, head=HEAD + "unmodelled_std = 0.05\n"))["parameters"]["n"]["std_error"]
    assert wide > 3.0 * plain


def test_the_fitted_material_can_be_used(folder, capsys):
    out = folder / "fitted.toml"
    assert main(["fit", "surface", str(_fit_file(folder)), "--out", str(out)]) == 0
    fitted = load_material(out)
    assert fitted.name == "paint"
    assert abs(fitted.n.at(550e-9) - TRUTH.n) < 5.0 * fitted.n.standard_uncertainty
    assert not fitted.n.assumed
    assert "morning, noon" in fitted.n.source
    assert fitted.specular_weight.assumed


def test_what_is_assumed_is_printed(folder, capsys):
    assert main(["fit", "surface", str(_fit_file(folder))]) == 0
    shown = capsys.readouterr().out
    assert "light: the sun alone, unpolarised" in shown
    assert "each run has one factor" in shown
    assert "the noise of the regions alone" in shown
    assert "held, assumed" in shown


def test_profile_intervals_are_near_the_first_order_ones_where_much_is_known(folder, capsys):
    plain = _answer(capsys, _fit_file(folder))["parameters"]["n"]["interval_95"]
    profiled = _answer(capsys, _fit_file(folder), "--profile")["parameters"]["n"]["interval_95"]
    # The ends are sought to 2e-3 of the half width; over an interval this small the model bends little.
    assert profiled == pytest.approx(plain, abs=0.05 * (plain[1] - plain[0]))
    assert profiled != plain


def test_a_parameter_that_cannot_be_told_gives_no_material(folder, capsys):
    head = HEAD + 'free = ["n", "slope_rms", "dhr", "specular_weight"]\n'
    path = _fit_file(folder, [("noon", "level")], head)
    out = folder / "never.toml"
    assert main(["fit", "surface", str(path), "--out", str(out)]) == EXIT_DATA
    assert not out.exists()
    assert "not at all" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("head", "said"),
    [
        (HEAD + 'free = ["m"]\n', "1 problem\n  first of free: must be 'n'"),
        (HEAD + "bounds = { n = [2.0, 1.0] }\n", "bounds of n"),
        (HEAD.replace("guess.toml", "teflon"), "teflon"),
        (HEAD.replace("guess.toml", "glass") + 'free = ["dhr"]\n', "give the start a dhr"),
        (HEAD.replace("550", "300").replace("guess.toml", "glass"), "covers 400 to 1000 nm"),
    ],
)
def test_a_question_that_cannot_be_is_refused(folder, capsys, head, said):
    assert main(["fit", "surface", str(_fit_file(folder, head=head))]) == EXIT_USAGE
    assert said in capsys.readouterr().err


def test_a_region_that_is_not_there_is_named(folder, capsys):
    assert main(["fit", "surface", str(_fit_file(folder, [("noon", "wall")]))]) == EXIT_USAGE
    assert "no region wall; it has level, leaning" in capsys.readouterr().err


def test_a_panel_that_faces_away_is_refused(folder, capsys):
    path = _fit_file(folder, [("noon", "leaning")])
    path.write_text(path.read_text().replace("tilt_deg = 20.0", "tilt_deg = 170.0"))
    assert main(["fit", "surface", str(path)]) == EXIT_USAGE
    assert "does not face" in capsys.readouterr().err


def test_the_example_names_what_the_other_examples_hold():
    file = load_surface_fit(EXAMPLES / "fit-black-panel.toml")
    assert file.regions.is_file()
    assert material(file.material).dhr is not None
    assert {section.region for section in file.observation} == {"black_panel"}
