"""Metering: one exposure that serves all angles, found once a round."""

import pytest

from rigctl.files.session_file import MeteringSection, SessionFile
from rigctl.runs.folder import read_run
from rigctl.session.rig_work import meter
from rigctl.session.take import take_session
from tests.rigctl.session.made_rig import RIG_FILE, MadeWorld, events_of


def metered(slopes_per_s, *, pedestal=0.0, **section):
    def probe(exposure_s):
        return {angle: min(pedestal + slope * exposure_s, 1.0) for angle, slope in slopes_per_s.items()}

    return meter(probe, MeteringSection(**section))


@pytest.mark.parametrize("brightest_per_s", [0.5, 20.0, 3000.0])
def test_the_brightest_angle_comes_near_the_target(brightest_per_s):
    slopes_per_s = {0.0: brightest_per_s, 90.0: brightest_per_s / 3}
    _, shares, remark = metered(slopes_per_s, pedestal=0.02, longest_ms=10_000)
    # Within the tenth at which metering is content.
    assert shares[0.0] == pytest.approx(0.8, rel=0.1)
    assert remark is None


@pytest.mark.parametrize(
    ("slopes_per_s", "exposure_s", "words"),
    [
        ({0.0: 100.0, 90.0: 0.1}, 0.008, "bracket"),
        ({0.0: 1e9}, 1e-5, "stop down"),
        ({0.0: 1e-9}, 1.0, "bracket"),
    ],
    ids=["contrast", "too much light", "darkness"],
)
def test_metering_remarks_on_angles_that_one_exposure_cannot_serve(slopes_per_s, exposure_s, words):
    found_s, _, remark = metered(slopes_per_s)
    assert found_s == pytest.approx(exposure_s, rel=0.15)
    assert words in remark


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
    (event,) = [event["facts"] for event in events_of(tmp_path / "run") if event["event"] == "metered"]
    run = read_run(tmp_path / "run")
    assert len(run.frames) == 16
    assert {record.exposure_s for record in run.frames} == {event["exposure_s"], event["exposure_s"] / 2}
    brightest = max(run.counts(record).max() for record in run.frames)
    # 0.8 of 4095, within a tenth, and noise of 1 DN.
    assert 0.72 * 4095 - 10 < brightest < 0.88 * 4095 + 10
