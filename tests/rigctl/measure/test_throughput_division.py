"""Frames divided by the throughput of their polarizer angle."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from rigctl.calibrations.polarizer import PolarizerParameters
from rigctl.cli import main
from rigctl.console import EXIT_DATA
from rigctl.errors import DataError
from rigctl.files.regions import Rectangle, Region
from rigctl.measure.frames import RunCalibrations
from rigctl.measure.measure import measure, temporal_noise, temporal_variance
from rigctl.runs.folder import Run
from tests.rigctl.made_runs import at, make_run
from tests.rigctl.noise_records import noise_parameters

ANGLES_DEG, PASSED, ERROR = (0.0, 45.0, 90.0, 135.0), (1.03, 0.97, 1.0, 0.99), 2e-3
GAIN, LIGHT_E, SIZE, CYCLES = 0.25, 8000.0, (70, 80), 6
REGION = Region(name="a", rectangle=Rectangle(x=2, y=2, width=75, height=65))
POLARIZER: dict[str, Any] = {
    "schema_version": 2,
    "sense": 1,
    "offset_deg": {"value": 10.0, "std_error": 0.01},
    "made_for": {"stage_serial": "7"},
    "channels": [
        {"stage_angle_deg": angle - 10.0, "throughput": {"value": passed, "std_error": ERROR}}
        for angle, passed in zip(ANGLES_DEG, PASSED, strict=True)
    ],
}
NOISE = noise_parameters(
    {
        "gain_dn_per_e": {"value": GAIN, "std_error": 1e-5, "n": 10},
        "read_noise_e": {"value": 0.0, "std_error": 1e-3, "n": 10},
        "dark_current_e_per_s": None,
        "covariance": None,
    }
)


def dim_run(path: Path, *, offset_deg: float = 10.0, **facts: Any) -> Run:
    draws = np.random.default_rng(6)
    frames = []
    for cycle in range(CYCLES):
        for angle, passed in zip(ANGLES_DEG, PASSED, strict=True):
            known = {"exposure_s": 0.01, "stage_angle_deg": angle - 10.0, "cycle": cycle} | facts
            frames.append((at(angle, **known), np.rint(GAIN * draws.poisson(LIGHT_E * passed, SIZE))))
    rig = {"polarizer": {"sense": 1, "offset_deg": offset_deg}}
    return make_run(path, frames, session={"origin": "device", "rig": rig})


def parameters(content: dict[str, Any]) -> PolarizerParameters:
    return TypeAdapter(PolarizerParameters).validate_python(content)


def kept(folder: Path, content: dict[str, Any]) -> Path:
    path = folder / "polarizer.json"
    path.write_text(json.dumps(content))
    return path


def test_false_polarization_goes_away_and_its_error_is_carried(tmp_path: Path) -> None:
    run = dim_run(tmp_path / "run")
    before = measure(run, regions=[REGION]).regions["a"].quantities["s1n"]["mean"]
    found = (
        measure(run, regions=[REGION], calibrations=RunCalibrations(polarizer=parameters(POLARIZER)))
        .regions["a"]
        .quantities["s1n"]["mean"]
    )
    # (1.03 - 1.00) / 2 of the mean light; counts of 4875 pixels and 6 cycles are good to 1e-4.
    assert before.value == pytest.approx(0.015, abs=1e-3)
    # Two frames with 2e-3 each, over twice their mean.
    assert found.std_error == pytest.approx(ERROR / np.sqrt(2.0), rel=0.02)
    assert abs(found.value) < 1e-3


def test_noise_is_predicted_with_the_throughput(tmp_path: Path) -> None:
    found = measure(
        dim_run(tmp_path / "run"), regions=[REGION], calibrations=RunCalibrations(polarizer=parameters(POLARIZER))
    )
    region = found.regions["a"]
    predicted = np.sqrt(temporal_variance(found, region, temporal_noise(NOISE).values))
    for name, deviation in zip(found.grid.channel_names, predicted, strict=True):
        # 4875 pixels, 5 degrees of freedom: 0.45 %.
        assert region.quantities[name]["std_temporal"].value == pytest.approx(deviation, rel=5.0 * 0.0046)


def test_an_angle_that_was_not_calibrated_is_refused(tmp_path: Path) -> None:
    some = POLARIZER | {"channels": POLARIZER["channels"][:3]}
    with pytest.raises(DataError, match="calibrate at the angles that are used"):
        measure(dim_run(tmp_path / "run"), regions=[], calibrations=RunCalibrations(polarizer=parameters(some)))


def test_a_run_that_was_taken_with_another_axis_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="put the calibrated ones there"):
        PolarizerParameters.read_fitting(kept(tmp_path, POLARIZER), dim_run(tmp_path / "run", offset_deg=11.0))
    with pytest.raises(DataError, match="stage serial number"):
        PolarizerParameters.read_fitting(kept(tmp_path, POLARIZER), dim_run(tmp_path / "other", stage_serial="8"))


def test_a_calibration_without_throughput_divides_nothing_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, path = dim_run(tmp_path / "run"), kept(tmp_path, POLARIZER | {"channels": None})
    arguments = ["stokes", str(run.path), "--out", str(tmp_path / "stokes"), "--force", "--polarizer"]
    assert main([*arguments, str(path)]) == 0
    assert "without throughput" in " ".join(capsys.readouterr().err.split())
    assert main([*arguments, str(kept(tmp_path, POLARIZER))]) == 0
    assert "divided by the throughput of their angle, 0.9700 to 1.0300" in " ".join(capsys.readouterr().err.split())


def test_a_damaged_calibration_is_refused_with_its_keys(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    channels = [POLARIZER["channels"][0] | {"throughput": 1.0}, *POLARIZER["channels"][1:]]
    path = kept(tmp_path, POLARIZER | {"channels": channels, "created_utc": "x"})
    run = dim_run(tmp_path / "run")
    arguments = ["stokes", str(run.path), "--out", str(tmp_path / "stokes"), "--polarizer", str(path)]
    assert main(arguments) == EXIT_DATA
    said = capsys.readouterr().err
    assert "channels.0.throughput: " in said
    assert "created_utc: is 'x', must be a time" in said
