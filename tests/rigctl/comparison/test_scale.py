"""The scale of the counts: told, by a panel, or fitted to the run."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from calibration.radiometric import fit_free_scale
from calibration.results import CalibrationError
from rigctl.calibrations.kinds import MadeFor
from rigctl.calibrations.radiometric import RadiometricResponse
from rigctl.cli import main
from rigctl.comparison.compare import Comparison, compare_with_scene
from rigctl.comparison.rows import Row
from rigctl.comparison.scale import panel_response, with_panel_scale
from rigctl.console import EXIT_DATA, EXIT_USAGE
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import ScaleKind
from rigctl.files.scene_file import SceneFile, load_scene
from rigctl.measure.diagnose import measure_run
from rigctl.measure.frames import RunCalibrations
from rigctl.measure.measure import measure
from rigctl.prediction.predict import ScenePredictor
from rigctl.report.comparison import compared_json
from rigctl.scene.scene import scene_of_file
from rigctl.verbs.compare import compare_run
from tests.rigctl.comparison.panel_runs import panel_run, response_dn, scene_text
from tests.rigctl.scene_texts import SCENE, written

# The true efficiency is 12 % above what the scene file says.
TRUE = 0.45 * 1.12


def scene(folder: Path, **options: Any) -> SceneFile:
    return load_scene(written(folder, scene_text(**options)))


def calibrated(folder: Path, told: SceneFile, *, exposure_s: float = 6e-5) -> RadiometricResponse:
    run = panel_run(folder / "panel-run", seed=9, efficiency=TRUE, exposure_s=exposure_s / 4.0)
    measurement = measure(run, regions=list(told.regions))
    content = panel_response(measurement, scene_of_file(told), panel="white")
    return TypeAdapter(RadiometricResponse).validate_python(content)


def compared(
    folder: Path, told: SceneFile, scale: ScaleKind = "free", radiometric: RadiometricResponse | None = None
) -> Comparison:
    run = panel_run(folder / "run", seed=3, efficiency=TRUE)
    measured = measure_run(run, list(told.regions), RunCalibrations(radiometric=radiometric))
    return compare_with_scene(measured, scene_of_file(told), alpha=1e-3, scale=scale)


def rows(found: Comparison, quantity: str, statistic: str = "mean") -> dict[str, Row]:
    return {row.region: row for row in found.rows if (row.quantity, row.statistic) == (quantity, statistic)}


def test_a_wrong_efficiency_shows_in_an_absolute_comparison(tmp_path: Path) -> None:
    found = compared(tmp_path, scene(tmp_path), scale="absolute")
    assert all(row.agrees is False for row in rows(found, "s0").values())
    assert found.scale is not None
    assert found.scale.value == 1.0


def test_an_absolute_scale_says_how_well_the_file_knows_it(tmp_path: Path) -> None:
    told = scene(tmp_path, f_number="{value=2.0, std=0.02}", quantum_efficiency="{value=0.45, std=0.03}")
    found = compared(tmp_path, told, scale="absolute").scale
    assert found is not None
    # The logarithm of 1 / (1 + 4 f^2) has the slope -8 f / (1 + 4 f^2); a difference over 0.067 bends by 0.067^2 / 3.
    assert found.std_error == pytest.approx(np.hypot(16.0 * 0.02 / 17.0, 0.03 / 0.45), rel=2e-3)


def test_a_free_scale_is_found_with_its_error_and_the_noise_follows(tmp_path: Path) -> None:
    found = compared(tmp_path, scene(tmp_path))
    assert found.scale is not None
    # Three means of 3200 values: 4 sigma of what it says, and that is small.
    assert abs(found.scale.value - 1.12) < 4.0 * found.scale.std_error
    assert found.scale.std_error < 2e-3
    # 12 % more electrons: 6 % more noise than was told, some 20 standard errors.
    temporal = [row for row in found.rows if row.statistic == "std_temporal"]
    assert all(row.agrees for row in temporal)
    assert all(row.agrees for row in rows(found, "s0").values())
    assert "the scale of the counts: it was fitted to S0 of this run" in found.not_tested


def test_a_free_scale_needs_no_knowledge_of_the_sensor(tmp_path: Path) -> None:
    sure, unsure = (
        compared(tmp_path / name, scene(tmp_path, quantum_efficiency=text)).scale
        for name, text in (("a", "0.45"), ("b", "{value=0.45, std=0.2}"))
    )
    assert sure is not None
    assert unsure is not None
    assert sure.std_error == pytest.approx(unsure.std_error, rel=1e-9)


def test_what_a_fitted_scale_makes_up_for_is_not_uncertain_any_more(tmp_path: Path) -> None:
    one = scene(tmp_path, error={"white": 0.05})
    one = one.model_copy(update={"regions": [region for region in one.regions if region.name == "white"]})
    found = compared(tmp_path, one)
    assert found.scale is not None
    assert found.scale.std_error == pytest.approx(0.05 * found.scale.value, rel=0.01)
    (row,) = rows(found, "s0").values()
    # The panel's reflectance moves the prediction up and the scale down: what is left is the measurement's error.
    assert row.std_error is not None
    assert row.std_error_inputs == pytest.approx(row.std_error, rel=0.1)


def test_the_weight_goes_to_the_surface_that_is_known(tmp_path: Path) -> None:
    told = {"black": 1.3, "white": 1.0, "grey": 1.0}
    found = compared(tmp_path, scene(tmp_path, error={"black": 0.2, "white": 0.01, "grey": 0.1}, told=told))
    assert found.scale is not None
    assert abs(found.scale.value - 1.12) < 4.0 * found.scale.std_error
    assert found.scale.std_error == pytest.approx(0.0112, rel=0.05)


def test_a_panel_on_another_day_and_exposure_gives_the_scale(tmp_path: Path) -> None:
    told = scene(tmp_path, error={"white": 0.02})
    found = compared(tmp_path, told, scale="panel", radiometric=calibrated(tmp_path, told))
    assert found.scale is not None
    assert found.scale.value == pytest.approx(1.12, rel=2e-3)
    assert found.scale.std_error == pytest.approx(0.02 * 1.12, rel=0.05)
    assert all(row.agrees for row in rows(found, "s0").values())
    # Every region carries the error of the panel.
    grey = rows(found, "s0")["grey"]
    assert grey.std_error_inputs == pytest.approx(0.02 * grey.predicted, rel=0.05)


def test_the_gain_drops_out_of_means_that_a_panel_scales(tmp_path: Path) -> None:
    told = scene(tmp_path, gain_dn_per_e="{value=0.24, std=0.01}")
    found = compared(tmp_path, told, scale="panel", radiometric=calibrated(tmp_path, told))
    for row in rows(found, "s0").values():
        assert row.std_error_inputs is not None
        # The gain alone is known to 4 %.
        assert row.std_error_inputs < 2e-3 * row.predicted


def test_a_panel_at_another_stop_is_refused(tmp_path: Path) -> None:
    radiometric = calibrated(tmp_path, scene(tmp_path))
    with pytest.raises(DataError, match="f/2, the scene file says f/4"):
        compared(tmp_path, scene(tmp_path, f_number=4.0), scale="panel", radiometric=radiometric)


def test_more_electrons_than_photons_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="electrons per photon"):
        compared(tmp_path, scene(tmp_path, told={"black": 0.1, "white": 0.1, "grey": 0.1}))


@pytest.mark.parametrize("options", [{"scale": "panel"}, {"scale": "free", "radiometric": {}}])
def test_scale_and_calibration_go_together(tmp_path: Path, options: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="go together"):
        compared(tmp_path, scene(tmp_path), **options)


def test_the_free_scale_of_numbers_with_a_common_error() -> None:
    # By hand: two numbers, one input that both follow, independent noise of 1 and 2 %.
    found = fit_free_scale(
        measured=np.array([2.2, 3.3]),
        measured_error=np.array([0.022, 0.066]),
        predicted=np.array([2.0, 3.0]),
        jacobian=np.array([[2.0], [3.0]]),
        input_cov=np.array([[0.05**2]]),
    )
    assert found.value == pytest.approx(1.1, rel=1e-12)
    assert found.variance == pytest.approx(1.0 / (1e4 + 2.5e3) + 0.05**2, rel=1e-9)
    assert found.common == pytest.approx([-(0.05**2)], rel=1e-9)


def test_no_light_has_no_scale() -> None:
    none = np.array([0.0])
    with pytest.raises(CalibrationError, match="no light"):
        fit_free_scale(measured=none, measured_error=none, predicted=none, jacobian=none[:, None], input_cov=np.eye(1))


def test_compare_says_its_scale(tmp_path: Path) -> None:
    panel_run(tmp_path / "run", efficiency=TRUE)
    found = compare_run(tmp_path / "run", scene=written(tmp_path, scene_text()), scale="free")
    said = compared_json(found)["scale"]
    assert said["kind"] == "free"
    assert said["value"] == pytest.approx(1.12, rel=1e-3)
    assert any(remark.startswith("Scale of the counts: 1.12") for remark in found.remarks)


def test_a_scale_by_a_panel_needs_its_calibration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    panel_run(tmp_path / "run")
    arguments = ["compare", str(tmp_path / "run"), str(written(tmp_path, scene_text())), "--scale", "panel"]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == EXIT_USAGE
    assert "--radiometric FILE" in capsys.readouterr().err


def test_compare_refuses_the_calibration_of_another_camera(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    panel_run(tmp_path / "other", camera_serial="12")
    panel_run(tmp_path / "run", camera_serial="11")
    path, out = str(written(tmp_path, scene_text())), str(tmp_path / "radiometric.json")
    made = ["calibrate", "radiometric", str(tmp_path / "other"), "--panel", "white", "--scene", path, "--out", out]
    assert main(made) == 0
    arguments = ["compare", str(tmp_path / "run"), path, "--scale", "panel", "--radiometric", out]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == EXIT_DATA
    assert "calibrated 12, used 11" in capsys.readouterr().err


def test_predict_takes_the_panels_scale(tmp_path: Path) -> None:
    told = scene(tmp_path)
    by_panel = partial(with_panel_scale, radiometric=calibrated(tmp_path, told))
    plain, scaled = (ScenePredictor(told, None, scaled=by).predict() for by in (None, by_panel))
    for name, region in plain.predictions.items():
        ratio = scaled.predictions[name].quantities["s0"]["mean"] / region.quantities["s0"]["mean"]
        assert ratio == pytest.approx(1.12, rel=2e-3)
    assert any("Scale of the counts: 1.1" in remark for remark in scaled.remarks)


def response(folder: Path, *, panel: str = "white", seed: int = 1, told: float = 1.0, **run: Any) -> dict[str, Any]:
    scene = load_scene(
        written(folder, scene_text(error={panel: 0.02}, told={panel: told}, gain_dn_per_e="{value=0.24, std=0.1}"))
    )
    measurement = measure(panel_run(folder / f"run{seed}", seed=seed, **run), regions=list(scene.regions))
    return panel_response(measurement, scene_of_file(scene), panel=panel)


def test_the_response_is_found_with_its_error(tmp_path: Path) -> None:
    draws = np.random.default_rng(5)
    scores = []
    for seed in range(30):
        told = 1.0 + 0.02 * draws.standard_normal()
        found = response(tmp_path, seed=seed, told=told, efficiency=0.5)
        value, error = (found["response_dn_per_radiance"][name] for name in ("value", "std_error"))
        scores.append((value / response_dn(0.5) - 1.0) / (error / value))
    # Standard normal, 30 of them: 4 sigma of mean and variance.
    assert abs(np.mean(scores)) < 4.0 / np.sqrt(30)
    assert abs(np.var(scores) - 1.0) < 4.0 * np.sqrt(2.0 / 30)


def test_the_panel_makes_the_error_and_the_gain_none(tmp_path: Path) -> None:
    found = response(tmp_path)
    assert set(found["variance_shares"]) == {"regions.white.stokes_radiance.0", "measurement"}
    assert found["variance_shares"]["regions.white.stokes_radiance.0"] > 0.99
    assert found["over_scene_file"]["std_error"] == pytest.approx(0.02, rel=0.02)
    radiance = found["panel"]["radiance_w_per_m2_sr"]
    assert radiance["std_error"] == pytest.approx(0.02 * radiance["value"], rel=1e-6)


def test_an_angle_that_passes_less_is_noticed(tmp_path: Path) -> None:
    assert response(tmp_path)["remarks"] == ()
    found = response(tmp_path, seed=2, throughput=(1.0, 0.97, 1.0, 1.0))
    assert not found["channels_agree"]
    assert "throughput depends on the angle" in found["remarks"][-1]
    # 1600 pixels, two cycles, 2 % common: 0.97 stands out by 3 % of the others' mean.
    channels = np.array([one["response_dn_per_radiance"]["value"] for one in found["channels"]])
    assert channels[1] / np.delete(channels, 1).mean() == pytest.approx(0.97, abs=0.002)


def test_a_saturated_panel_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="saturated or missing"):
        response(tmp_path, saturation_dn=1250.0)


def calibrate(folder: Path, *more: str, facts: dict[str, Any] | None = None) -> tuple[int, Path]:
    scene, out = written(folder, scene_text(error={"white": 0.02})), folder / "radiometric.json"
    panel_run(folder / "run", **(facts or {}))
    arguments = ["calibrate", "radiometric", str(folder / "run"), "--scene", str(scene), "--out", str(out), *more]
    return main(arguments), out


def test_the_file_says_all_that_is_needed_later(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    facts = {"camera_serial": "11", "gain_db": 3.0, "start_utc": "2026-05-04T10:00:00.000000000Z"}
    code, out = calibrate(tmp_path, "--panel", "white", "--valid-days", "30", facts=facts)
    assert code == 0
    content, found = json.loads(out.read_text()), RadiometricResponse.read(out)
    assert found.panel.name == "white"
    assert content["response_dn_per_radiance"]["n"] == 8
    assert [channel["name"] for channel in content["channels"]] == ["dn_0", "dn_45", "dn_90", "dn_135"]
    assert set(content["source"]) == {"run", "scene"}
    shown = capsys.readouterr().out
    assert "regions.white.stokes_radiance.0" in shown
    assert "times what the scene file says" in shown
    used = MadeFor(camera_serial="11", gain_db=3.0, taken_utc="2026-06-05T10:00:00.000000000Z")
    assert "valid for 30" in found.doubts(used)[0]
    with pytest.raises(DataError, match="gain setting"):
        found.doubts(MadeFor(camera_serial="11", gain_db=0.0))


def test_a_panel_of_another_name_is_a_usage_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert calibrate(tmp_path, "--panel", "blue")[0] == EXIT_USAGE
    assert "there are black, white, grey" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"schema_version": 2}, "schema_version"),
        ({"kind": "noise"}, "this is a noise calibration"),
        ({"exposure_s": 0.0}, "exposure_s"),
        ({"response_dn_per_radiance": {"value": -1.0, "std_error": 0.0, "n": 1}}, "response_dn_per_radiance.value"),
        ({"panel": {"name": 3}}, "panel.name"),
        ({"panel": "white"}, "panel"),
        ({"f_number": 1e300}, "f_number"),
        ({"made_for": {"taken_utc": "x"}}, "made_for.taken_utc"),
    ],
)
def test_a_wrong_file_is_refused_with_its_problem(tmp_path: Path, change: dict[str, Any], problem: str) -> None:
    _, out = calibrate(tmp_path, "--panel", "white")
    out.write_text(json.dumps(json.loads(out.read_text()) | change))
    with pytest.raises(DataError, match=f"(?s){problem}.*rigctl calibrate radiometric"):
        RadiometricResponse.read(out)


def test_a_panel_of_a_material_takes_the_sun_of_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    scene, radiance = load_scene(written(tmp_path, SCENE)), {}
    for elevation in (40.0, 25.0):
        run = panel_run(tmp_path / f"run{elevation}", sun_azimuth_deg=180.0, sun_elevation_deg=elevation)
        measurement = measure(run, regions=list(scene.regions))
        found = panel_response(measurement, scene_of_file(scene), panel="road")
        radiance[elevation] = found["panel"]["radiance_w_per_m2_sr"]["value"]
    # A lower sun is weaker; forward scatter makes up for part of it.
    assert radiance[25.0] < 0.95 * radiance[40.0]
    assert found["variance_shares"]["regions.road.dhr"] > 0.1
    assert any("65.00 of the run" in remark for remark in found["remarks"])
