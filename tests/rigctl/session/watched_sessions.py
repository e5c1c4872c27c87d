"""Sessions on a rig of stand-ins with interlocks as a test wants them."""

from rigctl.files.session_file import SessionFile
from rigctl.runs.check import verify_run
from rigctl.runs.folder import read_run
from rigctl.session.take import take_session
from tests.rigctl.session.made_rig import RIG_FILE, events_of


def watched_session(*, take=None, **locks):
    """Return a session of two cycles whose interlocks are quiet but for those that are given."""
    # Simulated time costs nothing: the session outruns any disk.
    quiet = {"disk_free_mb": 0, "queue": "off", "drift": "off", "low_signal": "off"}
    steps = {"kind": "scene", "exposure_ms": 10, "cycles": 2} | (take or {})
    return SessionFile.model_validate({"name": "watched", "take": [steps], "interlocks": quiet | locks})


def take_watched(world, tmp_path, *, rig_file=RIG_FILE, take=None, noise=None, **locks):
    session = watched_session(take=take, **locks)
    return take_session(
        rig_file, session, tmp_path / "run", files={}, noise=noise, clock=world.time.clock, opener=world.open
    )


def trips_of(tmp_path):
    events = events_of(tmp_path / "run")
    return [(e["facts"]["interlock"], e["facts"]["action"]) for e in events if e["event"] == "interlock"]


def assert_whole(tmp_path, frames=8):
    assert [record.sequence for record in read_run(tmp_path / "run").frames] == list(range(frames))
    assert verify_run(tmp_path / "run").ok
