"""Recorded sessions over the network while camera and network misbehave: no wrong frame, and it is said how it went.

Every picture tells its number, its exposure and where the polarizer stood when it was exposed; it is known bit for bit.
"""

from contextlib import contextmanager

import pytest

from drivers.cameras.gige import open_gige
from drivers.errors import DeviceError, ProtocolError
from rigctl.files.session_file import SessionFile
from rigctl.runs.check import verify_run
from rigctl.runs.folder import read_run
from rigctl.runs.records import pictures_lost, read_description, read_events
from rigctl.session.take import resume_session, take_session
from sim_devices.cameras.gige_server import GigeFaults, serve_behind_network, serve_gige_camera
from tests.rigctl.session.made_rig import RIG_FILE, events_of
from tests.sim_devices.cameras.gige_port import ADDRESS, gige_port
from tests.sim_devices.cameras.known_pictures import EXPOSURE, MARK, KnownPictures, assert_known, marking_rig

EXPOSURE_MS = 4.0
OPTIONS = "pixel_format=Mono12Packed&retakes=10"


@contextmanager
def served(source, faults):
    """Give a camera that is served, and where: behind a network that sends again, where the faults lose packets."""
    if faults is not None and faults.lost_share:
        with serve_behind_network(source, faults=faults) as place:
            yield None, place
        return
    with serve_gige_camera(source, faults=faults) as device:
        yield device, ADDRESS


def opener(*, faults=None, lost_from_then_on=0.0, width=64, height=48):
    """What opens the rig: a stage, and a camera on this machine's network."""

    @contextmanager
    def opened():
        source = KnownPictures(width=width, height=height)
        with served(source, faults) as (device, place), open_gige(f"{place}?{OPTIONS}") as camera:
            if device is not None:
                device.lose_packets(lost_from_then_on)
            with marking_rig(source, camera) as rig:
                yield rig

    return opened


def session(*, cycles, gone="retry"):
    return SessionFile.model_validate(
        {
            "name": "troubles",
            "take": [{"kind": "scene", "exposure_ms": EXPOSURE_MS, "cycles": cycles}],
            "interlocks": {"gone": gone, "reconnect_s": 60},
        }
    )


def take(tmp_path, plan, **opening):
    with gige_port():
        return take_session(RIG_FILE, plan, tmp_path / "run", files={}, opener=opener(**opening))


def assert_no_wrong_frame(run, frames):
    """Every stored picture is whole, of the exposure that was asked for, and of the angle that its record says."""
    assert len(run.frames) == frames
    for record in run.frames:
        counts = run.counts(record)
        assert_known(counts)
        assert counts[MARK] == round(record.stage_angle_deg % 360.0)
        assert counts[EXPOSURE] == round(EXPOSURE_MS / 1e3 * 1e5)
        assert record.exposure_s == EXPOSURE_MS / 1e3
    assert verify_run(run.path).ok


def tally_of(run):
    """The counts of all parts of a run together."""
    parts = [event["facts"] for event in events_of(run.path) if event["event"] == "camera tally"]
    return {name: sum(part[name] for part in parts) for name in parts[0]}


@pytest.mark.parametrize(
    "faults",
    [GigeFaults(restart=7, off_s=0.2), GigeFaults(forget=7)],
    ids=["restarted", "forgot its exposure"],
)
def test_a_camera_that_lost_its_settings_gets_them_back_before_a_frame_counts(tmp_path, faults):
    take(tmp_path, session(cycles=2), faults=faults)
    run = read_run(tmp_path / "run")
    assert_no_wrong_frame(run, frames=8)
    assert tally_of(run)["reopened"] >= 1


@pytest.mark.slow
def test_a_session_continues_after_a_camera_hung_for_a_while(tmp_path):
    # Longer than the library asks for; the timeout of a frame is 5 s.
    take(tmp_path, session(cycles=2), faults=GigeFaults(hang=7, hang_s=2.8))
    run = read_run(tmp_path / "run")
    assert_no_wrong_frame(run, frames=8)
    assert tally_of(run)["never_came"] + tally_of(run)["reopened"] >= 1


# That it ends at its deadline is what a BoundedCamera promises: tests/drivers/cameras/test_bounded_camera.py.
@pytest.mark.slow
def test_a_dead_camera_ends_the_session_and_it_is_resumed_with_the_next_one(tmp_path):
    with pytest.raises(DeviceError, match=ADDRESS):
        take(tmp_path, session(cycles=3, gone="stop"), faults=GigeFaults(die=7))
    run = read_run(tmp_path / "run")
    # The first picture is the driver's own.
    assert_no_wrong_frame(run, frames=5)
    with gige_port():
        assert resume_session(run.path, opener=opener()).is_finished
    run = read_run(tmp_path / "run")
    assert_no_wrong_frame(run, frames=12)
    assert tally_of(run)["accepted"] == 12 + 2


@pytest.mark.parametrize("share", [0.0, 1e-3])
def test_a_session_through_a_lossy_network_is_complete_and_tells_its_losses(tmp_path, share):
    take(tmp_path, session(cycles=3), lost_from_then_on=share, width=782, height=582)
    run = read_run(tmp_path / "run")
    assert_no_wrong_frame(run, frames=12)
    tally = tally_of(run)
    assert tally["accepted"] == 12 + 1
    if share == 1e-3:
        # Of 470 packets none is lost with p = 0.999^470 = 0.62; that all of twelve pictures come at once, 0.004.
        assert tally["damaged"] + tally["never_came"] >= 1
    if share == 0.0:
        # The very first picture after a start may be damaged.
        assert tally["damaged"] <= 1


@pytest.mark.parametrize("share", [0.01, 0.05])
def test_with_packets_sent_again_a_session_is_complete_and_bit_exact(tmp_path, share):
    take(tmp_path, session(cycles=2), faults=GigeFaults(lost_share=share), width=782, height=582)
    run = read_run(tmp_path / "run")
    assert_no_wrong_frame(run, frames=8)
    tally = tally_of(run)
    assert tally["accepted"] == 8 + 1
    # 470 packets a picture, 9 pictures: 42 or 211 are lost, 26 and 139 with five standard deviations less.
    assert tally["packets_resent"] >= {0.01: 10, 0.05: 139}[share]
    pictures, packets = pictures_lost(read_events(run.path))
    assert "9 were taken" in pictures
    assert f"{tally['packets_resent']} of these came" in packets


def test_a_network_that_loses_every_picture_ends_the_session_with_that_error_and_the_counts(tmp_path):
    # At 1 % a picture of 470 packets is whole with p = 0.009: one of eleven with 0.09; at 2 %, 0.0008.
    with pytest.raises(ProtocolError, match=r"The network loses .*interface lo"):
        take(tmp_path, session(cycles=3), lost_from_then_on=0.02, width=782, height=582)
    run = read_run(tmp_path / "run")
    assert_no_wrong_frame(run, frames=len(run.frames))
    assert tally_of(run)["damaged"] + tally_of(run)["never_came"] >= 11


def test_the_run_says_how_counts_came_about(tmp_path):
    take(tmp_path, session(cycles=1))
    facts = read_description(tmp_path / "run" / "session.json").session["camera_facts"]
    assert (facts["sample_format"], facts["justified"], facts["linear"]) == ("Mono12Packed", "right", True)
    assert facts["features"].items() >= {"ExposureAuto": "Off", "GammaEnable": "False", "ReverseX": "False"}.items()
    assert read_run(tmp_path / "run").frames[0].camera_temperature_c == 28.5
