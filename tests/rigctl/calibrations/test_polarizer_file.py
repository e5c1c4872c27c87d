"""The file of a polarizer calibration: read again, refused for other devices, set beside what a rig file says."""

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from rigctl.calibrations.made_for import MadeFor
from rigctl.calibrations.polarizer import PolarizerParameters, read_polarizer_file, require_polarizer_fits
from rigctl.cli import main
from rigctl.errors import DataError
from rigctl.files.rig_file import PolarizerSection
from rigctl.runs.records import PolarizerAsTaken
from tests.rigctl.calibrations.polarizer_runs import OFFSET_DEG, SENSE, write_reference_run

FOUND = {"schema_version": 2, "sense": -1, "offset_deg": {"value": 22.5, "std_error": 0.01}}
MADE_FOR = {"camera_serial": "11", "stage_serial": "7", "gain_db": 0.0, "taken_utc": "2026-05-04T10:00:00.000000000Z"}


def parameters(**more: Any) -> PolarizerParameters:
    return TypeAdapter(PolarizerParameters).validate_python(FOUND | more)


def axis(sense: Any = -1, offset_deg: float = 22.5) -> PolarizerSection:
    return PolarizerSection(sense=sense, offset_deg=offset_deg)


def test_what_a_calibration_writes_is_read(tmp_path: Path) -> None:
    runs = [str(write_reference_run(tmp_path / f"run{angle}", angle)) for angle in (0.0, 30.0)]
    out = tmp_path / "polarizer.json"
    more = ["--reference-deg", "0", "--reference-deg", "30", "--valid-days", "20"]
    assert main(["calibrate", "axis", *runs, *more, "--out", str(out)]) == 0
    found = read_polarizer_file(out)
    assert found.sense == SENSE
    assert found.made_for is not None
    assert found.made_for.valid_days == 20.0
    assert found.channels is None
    assert require_polarizer_fits(found, MadeFor(), polarizer=axis(SENSE, OFFSET_DEG)) == ()


@pytest.mark.parametrize("offset_deg", [22.5, 22.5299, 202.5, -157.5])
def test_an_axis_within_its_error_fits(offset_deg: float) -> None:
    assert require_polarizer_fits(parameters(), MadeFor(), polarizer=axis(offset_deg=offset_deg)) == ()


@pytest.mark.parametrize("stated", [axis(sense=1), axis(offset_deg=22.54), axis(offset_deg=-22.5)])
def test_another_axis_in_the_rig_file_is_refused(stated: PolarizerSection) -> None:
    with pytest.raises(DataError, match="put the calibrated ones there"):
        require_polarizer_fits(parameters(), MadeFor(), polarizer=stated)


def test_another_stage_is_refused_and_another_gain_is_not() -> None:
    found = parameters(made_for=MADE_FOR)
    assert require_polarizer_fits(found, MadeFor(gain_db=6.0), polarizer=PolarizerAsTaken()) == ()
    with pytest.raises(DataError, match="stage serial number: calibrated 7, used 8"):
        require_polarizer_fits(found, MadeFor(stage_serial="8"), polarizer=PolarizerAsTaken())


@pytest.mark.parametrize("change", [{"sense": None}, {"schema_version": 3}, {"offset_deg": None}])
def test_a_file_that_cannot_be_used_says_what_makes_one(tmp_path: Path, change: dict[str, Any]) -> None:
    path = tmp_path / "polarizer.json"
    path.write_text(json.dumps(FOUND | change))
    with pytest.raises(DataError, match="rigctl calibrate axis"):
        read_polarizer_file(path)


CHANNEL = {"stage_angle_deg": 0.0, "throughput": {"value": 1.0, "std_error": 0.001}}


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"channels": []}, "channels: has 0 items, must have at least 1"),
        ({"channels": 3}, "channels: "),
        ({"channels": [CHANNEL, CHANNEL | {"throughput": 1.0}]}, "channels.1.throughput: "),
        ({"channels": [CHANNEL | {"throughput": {"value": -1, "std_error": 0}}]}, "channels.0.throughput.value: "),
        ({"channels": [CHANNEL | {"throughput": {"value": 0, "std_error": 0}}]}, "channels.0.throughput.value: "),
        ({"channels": [CHANNEL | {"throughput": {"value": 1e300, "std_error": 0}}]}, "channels.0.throughput.value: "),
        ({"channels": [CHANNEL | {"throughput": {"value": 1, "std_error": -5}}]}, "channels.0.throughput.std_error: "),
        ({"channels": [{"throughput": CHANNEL["throughput"]}]}, "channels.0.stage_angle_deg: is missing"),
        ({"offset_deg": {"value": 1e300, "std_error": 0}}, "offset_deg.value: "),
        ({"made_for": {"taken_utc": "x"}}, "made_for.taken_utc: is 'x', must be a time"),
        ({"created_utc": "x"}, "created_utc: is 'x', must be a time"),
        ({"made_for": {"stage_serial": 7}}, "made_for.stage_serial: "),
    ],
)
def test_whatever_is_used_is_checked(tmp_path: Path, change: dict[str, Any], problem: str) -> None:
    path = tmp_path / "polarizer.json"
    path.write_text(json.dumps(FOUND | change))
    with pytest.raises(DataError, match=f"(?s)1 problem.*{problem}"):
        read_polarizer_file(path)


def test_keys_of_others_are_let_be(tmp_path: Path) -> None:
    path = tmp_path / "polarizer.json"
    path.write_text(json.dumps(FOUND | {"channels": [CHANNEL | {"note": "dusty"}], "operator": "me"}))
    assert read_polarizer_file(path) == parameters(channels=[CHANNEL])
