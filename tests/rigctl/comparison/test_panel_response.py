"""Counts per radiance from a panel: the truth is in the run, what is told of the panel is off by its own error."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.calibrations.made_for import MadeFor
from rigctl.calibrations.radiometric import RadiometricResponse
from rigctl.cli import main
from rigctl.comparison.scale import PanelResponse, panel_response
from rigctl.console import EXIT_USAGE
from rigctl.errors import DataError
from rigctl.files.scene_file import load_scene
from rigctl.measure.measure import measure
from rigctl.scene.scene import scene_of_file
from tests.rigctl.comparison.panel_runs import panel_run, response_dn, scene_text
from tests.rigctl.scene_texts import SCENE, written


def response(folder: Path, *, panel: str = "white", seed: int = 1, told: float = 1.0, **run: Any) -> PanelResponse:
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
        value = found.scale.common * found.modelled_dn_per_radiance
        scores.append((value / response_dn(0.5) - 1.0) / (found.scale.common_error / found.scale.common))
    # Standard normal, 30 of them: 4 sigma of mean and variance.
    assert abs(np.mean(scores)) < 4.0 / np.sqrt(30)
    assert abs(np.var(scores) - 1.0) < 4.0 * np.sqrt(2.0 / 30)


def test_the_panel_makes_the_error_and_the_gain_none(tmp_path: Path) -> None:
    found = response(tmp_path)
    assert set(found.shares) == {"regions.white.stokes_radiance.0", "measurement"}
    assert found.shares["regions.white.stokes_radiance.0"] > 0.99
    assert found.scale.common_error == pytest.approx(0.02, rel=0.02)
    assert found.radiance_error == pytest.approx(0.02 * found.radiance, rel=1e-6)


def test_an_angle_that_passes_less_is_noticed(tmp_path: Path) -> None:
    assert response(tmp_path).remarks == ()
    found = response(tmp_path, seed=2, throughput=(1.0, 0.97, 1.0, 1.0))
    assert not found.scale.channels_agree
    assert "throughput depends on the angle" in found.remarks[-1]
    # 1600 pixels, two cycles, 2 % common: 0.97 stands out by 3 % of the others' mean.
    assert found.scale.channel[1] / np.delete(found.scale.channel, 1).mean() == pytest.approx(0.97, abs=0.002)


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
    assert "holds for 30" in found.doubts(used)[0]
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
        radiance[elevation] = found.radiance
    # A lower sun is weaker; forward scatter makes up for part of it.
    assert radiance[25.0] < 0.95 * radiance[40.0]
    assert found.shares["regions.road.dhr"] > 0.1
    assert any("65.00 of the run" in remark for remark in found.remarks)
