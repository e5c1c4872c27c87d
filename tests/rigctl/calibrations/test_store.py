"""Selecting from a store of calibrations: what fits, what is refused, and what is said of both."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from calibration.estimate import control_chart
from rigctl import cli
from rigctl.base.numbers import unix_ns, utc_moment
from rigctl.calibrations.kinds import KINDS, CalibrationKind, MadeFor, made_for, made_for_of_file, require_fit
from rigctl.calibrations.store import choose, read_store, selected_for_scene, store_doubts
from rigctl.errors import ConfigError, DataError
from rigctl.files.rig_file import load_rig
from rigctl.files.session_file import Take
from rigctl.runs.folder import read_run
from rigctl.runs.writer import RunWriter
from tests.docs.blocks import ROOT
from tests.rigctl.run_samples import make_record, noisy_counts

USED = MadeFor(
    camera_serial="A",
    gain_db=0.0,
    bit_depth=12,
    temperature_c=30.0,
    taken_utc="2026-06-15T12:00:00Z",
    exposure_range_s=(0.01, 0.01),
)


def write_noise(folder, name, *, taken, gain=0.25, **facts):
    """Write a noise calibration of the camera of `USED`, but for some facts."""
    made = vars(replace(USED, taken_utc=f"{taken}T12:00:00Z", **facts))
    number = {"value": gain, "std_error": 0.001, "n": 10}
    quantities = ("read_noise_e", "dark_current_e_per_s", "black_level_dn", "saturation_e", "dsnu_e")
    content = (
        {"kind": "noise"}
        | dict.fromkeys(quantities, number | {"value": 10.0})
        | {"gain_dn_per_e": number, "prnu": number}
    )
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(json.dumps(content | {"schema_version": 2, "made_for": made}))


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "calibrations"


def _selected(folder, used=USED, **options):
    return choose(read_store(folder), "noise", used, **{"require_usable": lambda file: None} | options)


def test_the_newest_before_the_frames_is_selected(folder):
    for day in ("2026-01-10", "2026-05-01", "2026-06-20"):
        write_noise(folder, f"{day}.json", taken=day)
    found = _selected(folder)
    assert (found.selection.file.name, found.selection.age_days) == ("2026-05-01.json", 45.0)
    assert "of 3 of these devices and settings" in found.selection.why
    assert all("fits, and another is nearer" in reason for _, reason in found.others)


def test_without_one_before_them_the_nearest_after_is_picked_and_that_is_said(folder):
    write_noise(folder, "late.json", taken="2026-06-20")
    write_noise(folder, "later.json", taken="2026-08-20")
    found = _selected(folder).selection
    assert (found.file.name, found.age_days) == ("late.json", -5.0)
    assert "AFTER the frames" in found.why


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"camera_serial": "B"}, "camera serial number: calibrated B, used A"),
        ({"gain_db": 6.0}, "gain setting [dB]: calibrated 6.0, used 0.0"),
        ({"bit_depth": 8}, "bit depth: calibrated 8, used 12"),
        ({"valid_days": 3.0}, "too far in time: 14 days from the frames, valid for 3"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_reason(folder, facts, said):
    write_noise(folder, "n.json", taken="2026-06-01", **facts)
    found = _selected(folder)
    assert found.selection is None
    assert said in found.others[0][1]
    assert said in found.line


def test_temperature_and_exposures_of_use_go_before_date(folder):
    write_noise(folder, "warm.json", taken="2026-05-01")
    write_noise(folder, "cold.json", taken="2026-06-10", temperature_c=5.0)
    write_noise(folder, "short.json", taken="2026-06-11", exposure_range_s=(1e-5, 1e-4))
    assert _selected(folder).selection.file.name == "warm.json"
    (folder / "warm.json").unlink()
    assert _selected(folder).selection.file.name == "short.json"
    (folder / "short.json").unlink()
    assert "25.0 K away" in _selected(folder).selection.why


def test_one_that_states_its_camera_goes_before_one_that_does_not(folder):
    write_noise(folder, "named.json", taken="2026-05-01")
    write_noise(folder, "unnamed.json", taken="2026-06-10", camera_serial=None)
    assert _selected(folder).selection.file.name == "named.json"


def test_one_that_cannot_be_used_after_all_gives_way_to_the_next(folder):
    write_noise(folder, "a.json", taken="2026-05-01")
    write_noise(folder, "b.json", taken="2026-06-01")

    def require_usable(path):
        if path.name == "b.json":
            raise DataError(f"{path}: spoilt")

    found = _selected(folder, require_usable=require_usable)
    assert (found.selection.file.name, found.others[0][1]) == ("a.json", "spoilt")


def test_frames_without_a_time_take_the_newest(folder):
    for day in ("2026-05-01", "2026-06-20", "2026-01-10"):
        write_noise(folder, f"{day}.json", taken=day)
    found = _selected(folder, replace(USED, taken_utc=None)).selection
    assert (found.file.name, found.age_days) == ("2026-06-20.json", None)


def test_files_that_are_no_calibrations_are_said(folder, capsys):
    write_noise(folder, "n.json", taken="2026-05-01")
    (folder / "empty.json").write_text("")
    (folder / "list.json").write_text("[1]")
    (folder / "flat.npz").write_bytes(b"PK")
    (folder / "readme.txt").write_text("no calibration, and none that is meant to be one")
    (folder / "2025").mkdir()
    write_noise(folder / "2025", "old.json", taken="2025-05-01")
    store = read_store(folder)
    assert [one.file.name for one in store.calibrations] == ["old.json", "n.json"]
    assert [one.file.name for one in store.unread] == ["empty.json", "flat.npz", "list.json"]
    assert cli.main(["calibrate", "list", str(folder), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["not_read"]) == 3


def test_a_store_that_is_not_there_is_a_usage_error(tmp_path):
    with pytest.raises(ConfigError, match="there is no such folder"):
        read_store(tmp_path / "none")
    assert cli.main(["calibrate", "list", str(tmp_path / "none")]) == 2


def test_plan_warns_of_what_is_missing_and_of_what_expires(folder, tmp_path):
    rig_file = tmp_path / "rig.toml"
    rig_file.write_text((ROOT / "examples/rig-sim.toml").read_text())
    now_ns = unix_ns(utc_moment("2026-06-15T12:00:00Z"))
    rig = load_rig(rig_file)
    assert store_doubts(rig, rig_file, now_ns=now_ns) == ()
    write_noise(folder, "n.json", taken="2026-06-01", valid_days=20.0)
    missing, expires = sorted(store_doubts(rig, rig_file, now_ns=now_ns))
    assert "has no polarizer calibration" in missing
    assert "n.json expires in 6 days" in expires
    write_noise(folder, "n.json", taken="2026-06-01", valid_days=10.0)
    assert any("too far in time" in doubt for doubt in store_doubts(rig, rig_file, now_ns=now_ns))
    write_noise(folder, "n.json", taken="2027-06-01")
    (folder / "torn.json").write_text('{"kind": "noise", "gain_dn_per_e": {"val')
    doubts = store_doubts(rig, rig_file, now_ns=now_ns)
    assert any("has a date 351 days ahead: check both clocks" in doubt for doubt in doubts)
    assert any("calibration not read: " in doubt and "torn.json: this is no JSON file" in doubt for doubt in doubts)


def test_of_equal_times_the_last_by_name_is_used_and_that_is_said(folder):
    for name in ("b.json", "a.json", "c.json"):
        write_noise(folder, name, taken="2026-05-01")
    found = _selected(folder).selection
    assert found.file.name == "c.json"
    assert "taken at the same time: b.json, a.json; the last by name is used" in found.why


def test_a_damaged_file_of_the_store_is_said_beside_what_is_selected(folder):
    write_noise(folder, "n.json", taken="2026-05-01")
    (folder / "torn.json").write_text('{"kind": "noise", "gain_dn_per_e": {"val')
    (folder / "cut.json").write_text('{"gain_dn_per')
    (folder / "lens.json").write_text('{"kind": "lens"}')
    used = replace(USED, camera_serial=None)
    found = selected_for_scene(folder.parent / "scene.toml", used, None, None)
    assert [line.partition(":")[0] for line in found.lines] == ["noise calibration", *2 * ["calibration not read"]]
    assert [one["file"] for one in found.as_json()["calibrations_not_read"]] == [
        str(folder / name) for name in ("cut.json", "torn.json")
    ]


def test_control_limits_hold_what_does_not_move_and_show_what_does():
    draws, years = np.random.default_rng(5), np.linspace(0.0, 3.0, 12)
    errors = np.full(12, 0.1)
    outside = [
        (~control_chart(years, 5.0 + 0.1 * draws.standard_normal(12), errors).is_inside).sum() for _ in range(500)
    ]
    # 27 in 10 000 of 6000: 16.2 expected, within four standard deviations.
    assert sum(outside) < 16.2 + 4.0 * np.sqrt(16.2)
    drifting = control_chart(years, 5.0 + 0.4 * years, errors)
    assert not drifting.is_inside.all()
    assert drifting.drift_per_year == pytest.approx(0.4, abs=1e-9)


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
    with pytest.raises(DataError, match=f"{KINDS[kind].name} was made for other devices") as refused:
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


def test_flat_fields_are_taken_at_each_angle() -> None:
    take = Take(kind="flat", exposure_ms=0.05, angles_deg=[0.0, 45.0, 90.0, 135.0])
    assert take.polarizer_angles_deg == (0.0, 45.0, 90.0, 135.0)


def test_flats_of_a_noise_calibration_are_taken_at_one_angle() -> None:
    with pytest.raises(ValidationError, match="at one angle"):
        Take(kind="flat", exposure_ms=[0.05, 0.1], angles_deg=[0.0, 45.0])
