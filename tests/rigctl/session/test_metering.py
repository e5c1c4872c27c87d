import pytest

from rigctl.files.session_file import MeteringSection, SessionFile
from rigctl.runs.folder import read_run
from rigctl.session.rig_work import meter
from rigctl.session.take import take_session
from tests.rigctl.session.made_rig import RIG_FILE, MadeWorld, events_of


def _linear(slopes_per_s, pedestal=0.02):
    return lambda exposure_s: {angle: min(pedestal + k * exposure_s, 1.0) for angle, k in slopes_per_s.items()}


@pytest.mark.parametrize("brightest_per_s", [0.5, 20.0, 3000.0])
def test_the_brightest_angle_comes_near_the_target(brightest_per_s):
    found = meter(_linear({0.0: brightest_per_s, 90.0: brightest_per_s / 3}), MeteringSection(longest_ms=10_000))
    # Within the tenth at which metering is content.
    assert found.shares[0.0] == pytest.approx(0.8, rel=0.1)
    assert found.remark is None


def test_a_scene_of_too_much_contrast_asks_for_a_bracket():
    found = meter(_linear({0.0: 100.0, 90.0: 0.1}, pedestal=0.0), MeteringSection())
    assert "bracket" in found.remark


def test_too_much_light_says_to_stop_down():
    found = meter(_linear({0.0: 1e9}), MeteringSection())
    assert found.exposure_s == pytest.approx(1e-5)
    assert "stop down" in found.remark


def test_a_dark_scene_ends_at_the_longest_exposure():
    assert meter(_linear({0.0: 1e-9}, pedestal=0.0), MeteringSection()).exposure_s == pytest.approx(1.0)


def test_a_session_meters_each_round_once_and_does_not_store_those_frames(tmp_path):
    world = MadeWorld()
    session = SessionFile.model_validate(
        {
            "name": "metered",
            "take": [{"kind": "scene", "exposure_ms": "auto", "cycles": 2, "bracket": [1, 0.5]}],
            "interlocks": {"disk_free_mb": 0},
        }
    )
    take_session(RIG_FILE, session, tmp_path / "run", files={}, clock=world.time.clock, opener=world.open)
    metered = [event["facts"] for event in events_of(tmp_path / "run") if event["event"] == "metered"]
    assert len(metered) == 1
    run = read_run(tmp_path / "run")
    exposure_s = metered[0]["exposure_s"]
    assert len(run.frames) == 16
    assert {record.exposure_s for record in run.frames} == {exposure_s, exposure_s / 2}
    brightest = max(run.counts(record).max() for record in run.frames)
    # 0.8 of 4095, within a tenth, and noise of 1 DN.
    assert 0.72 * 4095 - 10 < brightest < 0.88 * 4095 + 10
