"""What a person sees of a session: status, log, warnings, plan."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rigctl
from rigctl.cli import main
from rigctl.console import EXIT_DATA
from rigctl.errors import RunFolderError
from rigctl.files.rig_file import load_rig
from rigctl.files.scene_file import load_scene
from rigctl.files.session_file import SessionFile
from rigctl.runs.folder import read_run
from rigctl.runs.records import SessionNoise
from rigctl.session.forecast import predict_rounds
from rigctl.session.plan import plan_session
from rigctl.session.take import take_session
from rigctl.verbs.session import hold, resume
from tests.rigctl.example_files import EXAMPLES, SHORT_SESSION, small_rig, small_rig_text
from tests.rigctl.scene_texts import SCENE, written
from tests.rigctl.session.made_rig import START_NS, MadeWorld, take_watched, unplugged

_NOISE = SessionNoise(gain_dn_per_e=0.5, read_noise_e=1.0, dark_current_e_per_s=0.0, black_level_dn=100.0)


def _said(capsys, *arguments):
    assert main(list(map(str, arguments))) == 0
    return capsys.readouterr()


@pytest.fixture
def run(tmp_path):
    world = MadeWorld(camera_faults={2: unplugged(), 5: lambda counts: np.zeros_like(counts)})
    take_watched(world, tmp_path, noise=_NOISE)
    return tmp_path / "run"


def test_status_tells_sum_rule_dolp_and_drift_with_their_sigma(run, capsys):
    text = _said(capsys, "status", run).out
    assert "8 of 8" in text
    assert " MB free" in text
    for what in ("(I0 + I90) / (I45 + I135)  ", "DoLP of picture  0.3", "drift of picture  ", " +/- "):
        assert what in text


def test_status_in_json_has_them_as_numbers(run, capsys):
    live = json.loads(_said(capsys, "status", run, "--json").out)["live"]
    assert set(live["angles"]) == {"0", "45", "90", "135"}
    assert live["angles"]["45"]["saturated_fraction"] == 0.0
    # Noise of one count in 192 pixels, four angles, 1000 DN: 1e-4 of DoLP.
    assert live["regions"]["picture"]["dolp"]["value"] == pytest.approx(0.3, abs=1e-3)
    assert 0.0 < live["regions"]["picture"]["dolp"]["sigma"] < 0.01
    assert live["sum_rule"]["value"] == pytest.approx(1.0, abs=1e-3)
    assert {"per_min", "sigma_per_min", "region"} <= set(live["drift"])


def test_the_log_prints_events_in_words(run, capsys):
    lines = _said(capsys, "status", "--log", run).out.splitlines()
    assert lines[0].startswith("2026-05-04T13:06:40Z  homed")
    assert any("interlock: gone; action: retry; message: stand-in: it has disconnected" in line for line in lines)
    assert lines[-1].endswith("finished        frames: 6; rounds missed: 0")


def test_the_log_can_be_cut_down(run, capsys):
    lines = _said(capsys, "status", "--log", run, "--only", "interlock", "--last", 1).out.splitlines()
    assert len(lines) == 1
    assert "black" in lines[0]
    events = json.loads(_said(capsys, "status", "--log", run, "--only", "interlock", "--json").out)["events"]
    assert [event["facts"]["interlock"] for event in events] == ["gone", "black"]


def test_grouping_is_warned_about_with_its_cost(tmp_path, capsys):
    session = tmp_path / "session.toml"
    session.write_text('name = "x"\n[[take]]\nkind = "scene"\nexposure_ms = 1\ncycles = 4\norder = "grouped"\n')
    answer = _said(capsys, "acquire", EXAMPLES / "rig-sim.toml", session, "--out", tmp_path / "run", "--dry-run")
    assert "shows a false DoLP of" in " ".join(answer.err.split())


@pytest.mark.parametrize(("angles", "is_too_few"), [("[0, 180]", True), ("[0, 60, 120]", False)])
def test_too_few_axes_are_refused_and_a_plan_warns_of_them(tmp_path, capsys, angles, is_too_few):
    session = tmp_path / "session.toml"
    session.write_text(f'name = "x"\n[[take]]\nkind = "scene"\nexposure_ms = 1\nangles_deg = {angles}\n')
    rig, run = EXAMPLES / "rig-sim.toml", tmp_path / "run"
    code = main([str(word) for word in ("acquire", rig, session, "--out", run, "--dry-run")])
    assert code == (2 if is_too_few else 0)
    assert ("polarimetry = false" in " ".join(capsys.readouterr().err.split())) is is_too_few
    assert ("need 3" in " ".join(_said(capsys, "plan", rig, session).err.split())) is is_too_few


def test_a_plan_has_the_sun_at_every_step_against_the_camera(capsys):
    text = _said(
        capsys, "plan", EXAMPLES / "rig-rooftop.toml", EXAMPLES / "session-rooftop.toml", "--at", "2026-05-04T14:00Z",
        "--until", "2026-05-04T14:05Z",
    ).out  # fmt: skip
    head = next(line for line in text.splitlines() if line.startswith("step"))
    assert head.split()[2:6] == ["UTC", "zenith", "azimuth", "phi"]
    assert max(map(len, text.splitlines())) <= 80


def test_acquire_in_python_gives_the_run_and_resume_finds_nothing_left(tmp_path):
    (tmp_path / "rig.toml").write_text(small_rig_text(tmp_path).replace("speed=20", "speed=200"))
    (tmp_path / "session.toml").write_text(SHORT_SESSION)
    taken = rigctl.acquire(tmp_path / "rig.toml", tmp_path / "session.toml", out=tmp_path / "run")
    assert (taken.exit_code, len(taken.run.frames("scene"))) == (0, 4)
    again = resume(taken.run)
    assert again.as_json() == {
        "run": str(tmp_path / "run"), "process": None, "frames": 5, "planned": 5, "is_finished": True,
        "was_finished": True, "adopted": [], "set_aside": [],
    }  # fmt: skip
    with pytest.raises(RunFolderError, match="no session writes into this run"):
        hold(taken.run)


def test_the_disk_of_a_real_camera_is_that_of_its_pictures(tmp_path, capsys):
    text = (EXAMPLES / "rig-sim.toml").read_text().partition("\n[simulation]\n")[0]
    (tmp_path / "rig.toml").write_text(text.replace("sim:ellx?speed=20", "/dev/ttyUSB0").replace("sim:gc780", "gige:"))
    plan = ("plan", tmp_path / "rig.toml", EXAMPLES / "session.toml", "--json")
    assert json.loads(_said(capsys, *plan).out)["disk_bytes"] is None
    told = json.loads(_said(capsys, *plan, "--frame", "782x582").out)
    assert told["disk_bytes"] == len(told["steps"]) * (2 * 782 * 582 + 5760 + 1024)


@pytest.mark.parametrize("frame", ["782", "0x582", "ax582"])
def test_a_wrong_frame_size_is_refused(frame, capsys):
    assert main(["plan", str(EXAMPLES / "rig-sim.toml"), str(EXAMPLES / "session.toml"), "--frame", frame]) == 2
    assert "--frame" in capsys.readouterr().err


def test_a_planned_scene_is_measured_as_predicted(tmp_path):
    rig_file = small_rig(tmp_path)
    session = SessionFile.model_validate({"name": "x", "take": [{"kind": "scene", "exposure_ms": 0.03}]})
    planned = plan_session(rig_file, session, now_ns=START_NS)
    rows = tuple(predict_rounds(load_scene(tmp_path / "scene.toml"), None, planned, rig_file, session.metering))
    take_session(rig_file, session, tmp_path / "run", files={})
    run = read_run(tmp_path / "run")
    places = {"left": np.s_[4:44, 4:44], "right": np.s_[4:44, 52:92]}
    assert [row["region"] for row in rows] == list(places)
    for row in rows:
        assert row["exposure_ms"] == pytest.approx(0.03)
        for record in run.frames:
            found = run.counts(record)[places[row["region"]]].mean() - 64.0
            predicted = row["mean_dn"][f"dn_{record.polarizer_angle_target_deg:g}"]
            # 1600 pixels of 1000 to 2000 DN: shot noise of 22 DN, PRNU 0.5 % and texture 1 % of each: below 32 DN,
            # 0.8 DN in the mean; five of that; the readback is off by 0.05 deg at most, 1e-3 of the polarized part.
            assert found == pytest.approx(predicted, abs=4.0 + 1e-3 * predicted)


def test_a_planned_scene_is_lit_by_the_sun_of_each_round(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    session = SessionFile.model_validate(
        {
            "name": "x",
            "take": [{"kind": "scene", "exposure_ms": "auto"}],
            "schedule": {"every_min": 120, "duration_h": 4},
        }
    )
    rig_file = load_rig(EXAMPLES / "rig-rooftop.toml")
    planned = plan_session(rig_file, session, now_ns=START_NS)
    rows = tuple(predict_rounds(load_scene(written(tmp_path, SCENE)), None, planned, rig_file, session.metering))
    assert {row["round"] for row in rows} == {0, 1}
    first, second = (next(row for row in rows if row["round"] == number) for number in (0, 1))
    # 13:07 and 15:07 UTC in Rochester: the sun rises from 33 deg to 53 deg, and a brighter scene is exposed shorter.
    assert second["exposure_ms"] < first["exposure_ms"]
    brightest = max(max(row["mean_dn"].values()) for row in rows if row["round"] == 0)
    assert brightest == pytest.approx(0.8 * 4095, rel=1e-6)
    assert all(row["dolp_snr"] > 0 for row in rows)


AXIS = {"schema_version": 2, "sense": -1, "offset_deg": {"value": 31.7, "std_error": 0.01}}
NUMBER = {"value": 0.24, "std_error": 0.001, "n": 4}
NOISE = {
    "schema_version": 2,
    "gain_dn_per_e": NUMBER,
    "read_noise_e": NUMBER,
    "black_level_dn": NUMBER,
} | dict.fromkeys(("dark_current_e_per_s", "saturation_e", "prnu", "dsnu_e"))


def acquire(folder: Path, option: str, content: dict[str, Any]) -> int:
    path = folder / "calibration.json"
    path.write_text(json.dumps(content))
    arguments = [
        "acquire",
        str(EXAMPLES / "rig-sim.toml"),
        str(EXAMPLES / "session.toml"),
        "--out",
        str(folder / "run"),
    ]
    return main([*arguments, option, str(path)])


@pytest.mark.parametrize(
    ("option", "content", "said"),
    [
        ("--noise", NOISE | {"made_for": {"camera_serial": "another"}}, "camera serial number: calibrated another"),
        ("--noise", NOISE | {"made_for": {"gain_db": 6.0}}, "gain setting"),
        ("--polarizer", AXIS | {"made_for": {"stage_serial": "another"}}, "stage serial number"),
        ("--polarizer", AXIS | {"sense": 1}, "put the calibrated ones there"),
    ],
)
def test_the_calibration_of_another_rig_is_refused_before_the_first_frame(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, content: dict[str, Any], said: str
) -> None:
    assert acquire(tmp_path, option, content) == EXIT_DATA
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "run").exists()
