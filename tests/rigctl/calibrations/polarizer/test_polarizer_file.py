"""The file of a polarizer calibration: read again, refused for other devices, set beside what a rig file says."""

import json
from pathlib import Path
from typing import Any

import pytest

from rigctl.calibrations.made_for import MadeFor
from rigctl.calibrations.polarizer.polarizer_file import read_polarizer_file, require_polarizer_fits
from rigctl.cli import main
from rigctl.errors import DataError
from rigctl.files.rig_file import PolarizerSection
from tests.rigctl.calibrations.polarizer.polarizer_runs import OFFSET_DEG, SENSE, write_reference_run

FOUND = {"schema_version": 2, "sense": -1, "offset_deg": {"value": 22.5, "std_error": 0.01}}
MADE_FOR = {"camera_serial": "11", "stage_serial": "7", "gain_db": 0.0, "taken_utc": "2026-05-04T10:00:00.000000000Z"}


def axis(sense: Any = -1, offset_deg: float = 22.5) -> PolarizerSection:
    return PolarizerSection(sense=sense, offset_deg=offset_deg)


def test_what_a_calibration_writes_is_read(tmp_path: Path) -> None:
    runs = [str(write_reference_run(tmp_path / f"run{angle}", angle)) for angle in (0.0, 30.0)]
    out = tmp_path / "polarizer.json"
    more = ["--reference-deg", "0", "--reference-deg", "30", "--valid-days", "20"]
    assert main(["calibrate", "axis", *runs, *more, "--out", str(out)]) == 0
    content = read_polarizer_file(out)
    assert content["sense"] == SENSE
    assert content["made_for"]["valid_days"] == 20.0
    assert require_polarizer_fits(content, MadeFor(), polarizer=axis(SENSE, OFFSET_DEG)) == ()


@pytest.mark.parametrize("offset_deg", [22.5, 22.5299, 202.5, -157.5])
def test_an_axis_within_its_error_fits(offset_deg: float) -> None:
    assert require_polarizer_fits(FOUND, MadeFor(), polarizer=axis(offset_deg=offset_deg)) == ()


@pytest.mark.parametrize("stated", [axis(sense=1), axis(offset_deg=22.54), axis(offset_deg=-22.5)])
def test_another_axis_in_the_rig_file_is_refused(stated: PolarizerSection) -> None:
    with pytest.raises(DataError, match="put the calibrated ones there"):
        require_polarizer_fits(FOUND, MadeFor(), polarizer=stated)


def test_another_stage_is_refused_and_another_gain_is_not() -> None:
    content = FOUND | {"made_for": MADE_FOR}
    assert require_polarizer_fits(content, MadeFor(gain_db=6.0), polarizer=None) == ()
    with pytest.raises(DataError, match="stage serial number: calibrated 7, used 8"):
        require_polarizer_fits(content, MadeFor(stage_serial="8"), polarizer=None)


def test_a_file_of_version_1_is_read(tmp_path: Path) -> None:
    path = tmp_path / "polarizer.json"
    path.write_text(json.dumps(FOUND | {"schema_version": 1, "devices": {"stage_serial": "7"}}))
    with pytest.raises(DataError, match="calibrated 7, used 8"):
        require_polarizer_fits(read_polarizer_file(path), MadeFor(stage_serial="8"), polarizer=None)


@pytest.mark.parametrize("change", [{"sense": None}, {"schema_version": 3}, {"offset_deg": None}])
def test_a_file_that_cannot_be_used_says_what_makes_one(tmp_path: Path, change: dict[str, Any]) -> None:
    path = tmp_path / "polarizer.json"
    path.write_text(json.dumps(FOUND | change))
    with pytest.raises(DataError, match="rigctl calibrate axis"):
        read_polarizer_file(path)
