"""What a calibration was made for, and for which frames it may be used."""

from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from rigctl.calibrations.made_for import KINDS, CalibrationKind, MadeFor, made_for, made_for_of_file, require_fit
from rigctl.errors import DataError
from rigctl.runs.folder import read_run
from rigctl.runs.writer import RunWriter
from tests.rigctl.run_samples import make_record, noisy_counts

CALIBRATED = MadeFor(
    camera_model="GC780",
    camera_serial="11",
    stage_model="ELL14",
    stage_serial="7",
    gain_db=0.0,
    bit_depth=12,
    pixel_format="Mono12",
    binning=1,
    temperature_c=30.0,
    taken_utc="2026-05-04T10:00:00.000000001Z",
    valid_days=30.0,
)


@pytest.mark.parametrize(
    ("kind", "other", "named"),
    [
        ("noise", {"camera_serial": "12"}, "camera serial number: calibrated 11, used 12"),
        ("noise", {"gain_db": 6.0}, "gain setting"),
        ("noise", {"bit_depth": 8}, "bit depth"),
        ("noise", {"binning": 2}, "binning"),
        ("flat", {"stage_serial": "8"}, "stage serial number"),
    ],
)
def test_another_device_or_setting_is_refused(kind: CalibrationKind, other: dict[str, object], named: str) -> None:
    with pytest.raises(DataError, match=f"{KINDS[kind].name} is not of these devices") as refused:
        require_fit(kind, CALIBRATED, replace(CALIBRATED, **other))
    assert named in str(refused.value)


@pytest.mark.parametrize(
    ("kind", "other", "doubt"),
    [
        ("noise", {"taken_utc": "2026-06-04T10:00:00.000000000Z"}, "31 days"),
        # A calibration that is made long after the frames is no better than one made long before.
        ("noise", {"taken_utc": "2026-04-01T10:00:00.000000000Z"}, "33 days"),
        ("noise", {"temperature_c": 36.0}, "36.0 deg C"),
        ("noise", {"pixel_format": "Mono12Packed"}, "pixel format Mono12"),
        ("noise", {}, None),
        # A gain that is read back differs from the one that was set in its last digits; noise knows no stage.
        ("noise", {"gain_db": 0.04}, None),
        ("noise", {"temperature_c": 34.0}, None),
        ("noise", {"stage_serial": "8"}, None),
        ("noise", {"taken_utc": "2026-06-03T09:59:59.000000000Z"}, None),
        ("flat", dict.fromkeys(vars(CALIBRATED)), None),  # unknown facts are not compared
        ("polarizer", {"gain_db": 12.0}, None),
    ],
)
def test_doubts_about_a_calibration_that_fits(
    kind: CalibrationKind, other: dict[str, object], doubt: str | None
) -> None:
    doubts = require_fit(kind, CALIBRATED, replace(CALIBRATED, **other))
    assert len(doubts) == (doubt is not None)
    assert all(doubt in one for one in doubts if doubt is not None)


def test_a_run_says_what_it_was_taken_with(tmp_path: Path) -> None:
    session = {
        "origin": "device",
        "rig": {"camera": {"address": "gige:x?pixel_format=Mono12Packed&binning=2"}},
    }
    facts = {"camera_serial": "11", "gain_db": 3.0, "stage_serial": "7"}
    with RunWriter.create(tmp_path / "run", session) as writer:
        for minute in (0, 1):
            start = f"2026-05-04T10:0{minute}:00.000000000Z"
            writer.write_frame(
                make_record(minute, start_utc=start, camera_temperature_c=41.0 + minute, **facts), noisy_counts()
            )
        writer.write_frame(make_record(2, gain_db=4.0), noisy_counts())
    run = read_run(tmp_path / "run")
    found = made_for(run, run.frames[:2])
    assert found == MadeFor(
        **facts,
        bit_depth=12,
        pixel_format="Mono12Packed",
        binning=2,
        temperature_c=41.5,
        taken_utc="2026-05-04T10:01:00.000000000Z",
    )
    # Frames of two gains have none in common.
    assert made_for(run, run.frames).gain_db is None


def test_a_file_says_again_what_was_written() -> None:
    read = TypeAdapter(MadeFor).validate_python(CALIBRATED.as_json())
    assert made_for_of_file("noise", read, created_utc="2027-05-04T10:00:00Z") == CALIBRATED


def test_a_file_that_does_not_say_when_was_made_when_it_was_written() -> None:
    found = made_for_of_file("radiometric", MadeFor(stage_serial="7"), created_utc="2026-05-04T10:00:00Z")
    assert found == MadeFor(stage_serial="7", taken_utc="2026-05-04T10:00:00Z", valid_days=90.0)
