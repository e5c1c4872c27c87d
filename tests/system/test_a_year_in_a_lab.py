"""A year of a rig: 30 runs, axis and gain that drift, four calibrations, a camera replaced, notes, exclusions."""

import hashlib
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import rigctl
from rigctl import cli
from rigctl.measure.frames import CalibrationPaths, selected_for_run
from rigctl.runs.check import run_to_measure
from rigctl.runs.records import FrameRecord
from rigctl.runs.writer import RunWriter
from rigctl.verbs.axis import axis
from rigctl.verbs.calibrate import noise
from rigctl.verbs.compare import compare_run
from rigctl.verbs.note import note
from rigctl.verbs.stokes import stokes
from rigctl.verbs.store import history
from tests.rigctl.calibrations.polarizer_runs import SENSE

START = datetime(2026, 1, 1, 9, tzinfo=UTC)
# When the rig was calibrated [days]; at 200 the camera was replaced, and calibrated a week later.
CALIBRATED_DAYS = (5, 95, 185, 280)
REPLACED_DAY, NEW_CAMERA_DAY = 200, 207
RUN_DAYS = tuple(range(8, 360, 12))
OFFSETS_DEG = (22.5, 22.9, 23.3, 23.7)
GAINS = (0.25, 0.28, 0.31, 0.34)
SHAPE, NOISE_SHAPE = (24, 32), (48, 64)
EXPOSURES_S = (0.0006, 0.002, 0.004, 0.006, 0.008, 0.010)
STORE = CalibrationPaths(uses_store=True)


def _utc(days, seconds=0.0):
    moment = START + timedelta(days=days, seconds=seconds)
    return f"{moment:%Y-%m-%dT%H:%M:%S.%f}000Z"


def _camera(day):
    return "A" if day < REPLACED_DAY else "B"


def _quarter(day):
    return max(place for place, at in enumerate(CALIBRATED_DAYS) if at <= day)


def _record(writer, day, **facts):
    known = {"kind": "scene", "bit_depth": 12, "saturation_dn": 4095.0, "exposure_s": 0.01, "gain_db": 0.0}
    known |= {"camera_serial": _camera(day), "stage_serial": "S1", "black_level_dn": 60.0}
    known |= {"start_utc": _utc(day, writer.next_sequence), "sequence": writer.next_sequence}
    return FrameRecord(**(known | facts))


def _counts(draws, light_e, gain, shape=SHAPE):
    charge_e = draws.poisson(light_e, shape) + 8.0 * draws.standard_normal(shape)
    return np.clip(np.rint(60.0 + gain * charge_e), 0, 4095).astype(np.uint16)


def _noise_run(path, day, gain):
    draws = np.random.default_rng(day)
    with RunWriter.create(path, {"origin": "simulated"}) as writer:
        for exposure_s in EXPOSURES_S:
            for kind, light in (("dark", 0.0), ("dark", 0.0), ("flat", 1e6), ("flat", 1e6)):
                record = _record(writer, day, kind=kind, exposure_s=exposure_s, polarizer_angle_deg=0.0)
                writer.write_frame(record, _counts(draws, light * exposure_s, gain, NOISE_SHAPE))
    return path


def _axis_run(path, day, offset_deg, light_deg):
    draws = np.random.default_rng(day)
    with RunWriter.create(path, {"origin": "simulated"}) as writer:
        for stage_deg in range(0, 360, 20):
            cosine = np.cos(np.radians(2.0 * (SENSE * stage_deg + offset_deg - light_deg)))
            record = _record(writer, day, stage_angle_deg=float(stage_deg), cycle=0)
            writer.write_frame(record, _counts(draws, 6000.0 * (1.0 + 0.99 * cosine), 0.25))
        for _ in range(4):
            writer.write_frame(_record(writer, day, kind="dark"), _counts(draws, 0.0, 0.25))
    return path


def _calibrate(lab, day, *, gain, offset_deg, name):
    store = lab / "calibrations"
    noise(out=store / f"noise-{name}.json", run=_noise_run(lab / f"n-{name}", day, gain))
    runs = tuple(_axis_run(lab / f"a-{name}-{light:.0f}", day, offset_deg, light) for light in (0.0, 30.0))
    axis(*runs, reference_deg=(0.0, 30.0), axis_std_deg=0.05, out=store / f"axis-{name}.json")
    return json.loads((store / f"axis-{name}.json").read_text())["offset_deg"]["value"]


def _run(path, day, offset_deg, *, gain_db=0.0):
    draws = np.random.default_rng(1000 + day)
    rig = {"polarizer": {"sense": SENSE, "offset_deg": offset_deg}}
    with RunWriter.create(path, {"origin": "simulated", "rig": rig, "files": {"rig": {"name": "rig.toml"}}}) as writer:
        for cycle in range(3):
            for angle_deg in (0.0, 45.0, 90.0, 135.0):
                stage_deg = (SENSE * (angle_deg - offset_deg)) % 360.0
                angles = {"polarizer_angle_target_deg": angle_deg, "polarizer_angle_deg": angle_deg}
                record = _record(writer, day, cycle=cycle, stage_angle_deg=stage_deg, gain_db=gain_db, **angles)
                light_e = 3000.0 * (1.0 + 0.2 * np.cos(np.radians(2.0 * angle_deg)))
                writer.write_frame(record, _counts(draws, light_e, 0.25))
        writer.closing_event("finished", frames=12)
    return path


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    lab = tmp_path_factory.mktemp("lab")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("os.fsync", lambda descriptor: None)  # hundreds of frames that no power cut threatens
        (lab / "calibrations").mkdir()
        (lab / "rig.toml").write_text("")
        offsets = []
        for place, day in enumerate(CALIBRATED_DAYS):
            offsets.append(_calibrate(lab, day, gain=GAINS[place], offset_deg=OFFSETS_DEG[place], name=f"{place}"))
        gain = 0.31  # of the new camera
        noise(out=lab / "calibrations/noise-new.json", run=_noise_run(lab / "n-new", NEW_CAMERA_DAY, gain))
        for day in RUN_DAYS:
            _run(lab / f"run-{day:03d}", day, offsets[_quarter(day)])
    return lab


def _wanted_noise(day):
    if _camera(day) == "A":
        return f"noise-{_quarter(day)}.json"
    return "noise-3.json" if day >= CALIBRATED_DAYS[3] else "noise-new.json"


def test_each_run_is_given_the_calibration_that_was_in_force(lab):
    assert len(RUN_DAYS) == 30
    for day in RUN_DAYS:
        run = run_to_measure(lab / f"run-{day:03d}")
        found = selected_for_run(STORE, run, ("noise", "polarizer")).as_json()["calibrations"]
        noise = lab / "calibrations" / _wanted_noise(day)
        assert found["noise"]["file"] == str(noise)
        assert found["noise"]["sha256"].removeprefix("sha256:") == hashlib.sha256(noise.read_bytes()).hexdigest()
        # With the new camera the axis was measured late, and then it was another than the rig file had till then.
        axis = None if REPLACED_DAY <= day < CALIBRATED_DAYS[3] else f"axis-{_quarter(day)}.json"
        assert (Path(found["polarizer"]["file"]).name if "polarizer" in found else None) == axis
        assert found["noise"]["age_days"] == pytest.approx(
            day - (NEW_CAMERA_DAY if noise.name == "noise-new.json" else CALIBRATED_DAYS[_quarter(day)]), abs=0.01
        )


def test_the_old_camera_s_calibrations_are_refused_for_the_new_one(lab):
    day = min(day for day in RUN_DAYS if day >= REPLACED_DAY)
    found = compare_run(lab / f"run-{day:03d}", regions=_regions(lab))
    selected = found.run.calibrations.selected
    refused = {file.name: reason for choice in selected.choices for file, reason in choice.others}
    assert refused["noise-0.json"] == "camera serial number: calibrated A, used B"
    assert Path(found.files["noise"]["path"]).name == "noise-new.json"
    assert selected.as_json()["calibrations"]["noise"]["age_days"] < 0.0
    assert "AFTER the frames" in selected.as_json()["calibrations"]["noise"]["why"]


def _regions(lab):
    file = lab / "regions.toml"
    file.write_text(
        'schema_version = 1\n[[regions]]\nname = "all"\nrectangle = { x = 2, y = 2, width = 28, height = 20 }\n'
    )
    return file


def test_python_picks_as_the_commands_do(lab):
    path = lab / f"run-{RUN_DAYS[2]:03d}"
    found = rigctl.compare(path, regions=_regions(lab))
    selected = selected_for_run(STORE, run_to_measure(path), ("noise", "polarizer"))
    assert found.calibrations == selected.as_json()["calibrations"]
    assert found.calibrations["noise"]["why"].startswith("the newest before the frames, of 3")
    assert "with noise noise-0.json, polarizer axis-0.json" in repr(found)
    assert set(rigctl.stokes(path, noise="none").calibrations) == {"polarizer"}
    assert rigctl.stokes(path, calibrations="none").calibrations == {}
    assert "noise calibration: " in rigctl.open_run(path).stokes()._repr_html_()
    elsewhere = rigctl.stokes(path, calibrations=lab / "calibrations", polarizer="none")
    assert Path(elsewhere.calibrations["noise"]["file"]).name == "noise-0.json"


def test_python_warns_where_none_of_the_store_fits(lab, caplog):
    run = _run(lab / "run-other-gain", 30, 22.5, gain_db=6.0)
    assert "noise" not in rigctl.stokes(run, polarizer="none").calibrations
    (warning,) = [one for one in caplog.records if one.levelname == "WARNING"]
    assert "no noise calibration: of 5 in the store none fits" in warning.getMessage()


def test_another_gain_setting_is_refused_with_its_reason_and_none_is_selected(lab, tmp_path, capsys):
    run = _run(lab / "run-gain", 30, 22.5, gain_db=6.0)
    assert cli.main(["stokes", str(run), "--out", str(tmp_path / "out"), "--polarizer", "none", "--json"]) == 0
    said = capsys.readouterr()
    assert "noise" not in json.loads(said.out)["calibrations"]
    assert "no noise calibration: of 5 in the store none fits" in said.err
    assert "gain setting [dB]: calibrated 0.0, used 6.0" in said.err


def test_drift_and_replacement_show_in_the_history(lab, tmp_path):
    found = history(lab / "rig.toml", out=tmp_path / "h.png")
    histories = {(one.quantity, one.device): one for one in found.histories}
    gain = histories["gain_dn_per_e", "camera A at 0 dB"]
    assert len(gain.points) == 3
    assert not all(point.is_inside for point in gain.points)
    assert gain.drift_per_year == pytest.approx(0.1217, abs=4.0 * gain.drift_error)
    assert len(histories["gain_dn_per_e", "camera B at 0 dB"].points) == 2
    axis = histories["offset_deg", "stage S1, camera A"]
    assert axis.drift_per_year == pytest.approx(1.62, abs=5.0 * axis.drift_error)
    assert "IT CHANGES" in axis.line
    assert (tmp_path / "h.png").stat().st_size > 10_000


def test_notes_and_exclusions_go_along(lab):
    run = lab / f"run-{RUN_DAYS[3]:03d}"
    note(run, "a cloud passed", at="09:00", by="ann")
    note(run, "bird", exclude="4-7", by="bob")
    found = compare_run(run, regions=_regions(lab))
    assert found.measurement.grid.cycles == 2
    assert [one.by for one in found.measurement.run.annotations] == ["ann", "bob"]


def test_without_a_store_nothing_is_selected(lab):
    run = _run(lab.parent / "elsewhere", 30, 22.5)
    found = stokes(run)
    assert (found.selected.store, "calibrations" in found.as_json()) == (None, False)
