"""Disks that are full, read-only or slow, for real: ext4 on a loop device, and a flush that takes its time."""

import os
import subprocess
import time
from pathlib import Path

import pytest

from benchmarks.trials.disk_faults import run_disk_cell
from benchmarks.trials.loop_disk import call, ext4_image, mounted, why_not
from benchmarks.trials.power_cut import one_cut
from rigctl.base.durable import PART_SUFFIX
from rigctl.files.session_file import SessionFile
from rigctl.runs.check import verify_run
from rigctl.runs.folder import read_run
from rigctl.runs.records import read_events
from rigctl.session.acquisition import QUEUE_FRAMES
from rigctl.session.take import take_session
from tests.rigctl.example_files import EXAMPLES, small_rig
from tests.system.programs import DEADLINE_S, RIGCTL, frames_on, rigctl, wait_for

_DISK_BYTES = 48 * 1024 * 1024
_FREE_BYTES = 6 * 1024 * 1024  # six frames of 0.9 MB
_FRAMES = 12
_SESSION = """
name = "small"
[[take]]
kind = "scene"
exposure_ms = 0.03
cycles = 3
[interlocks]
disk_free_mb = 0
"""


@pytest.fixture
def image(tmp_path):
    reason = why_not()
    if reason is not None:
        pytest.skip(f"{reason}: run it as root where loop devices can be mounted")
    return ext4_image(tmp_path / "disk.img", size_bytes=_DISK_BYTES)


@pytest.fixture
def disk(tmp_path, image):
    with mounted(image, tmp_path / "disk") as place:
        yield place


def _fill(disk):
    """Leave room for some frames; return the file that takes the rest."""
    ballast = disk / "ballast"
    free = os.statvfs(disk).f_bfree * os.statvfs(disk).f_frsize
    call("fallocate", "-l", str(free - _FREE_BYTES), ballast)
    return ballast


def _started(tmp_path, run, *, more=""):
    session = tmp_path / "session.toml"
    session.write_text(_SESSION + more)
    command = [*RIGCTL, "acquire", EXAMPLES / "rig-sim.toml", session, "--out", run]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def _words(process, until=""):
    """Return what the session has written to stderr up to these words, or to its end."""
    text = ""
    for line in process.stderr:
        text = " ".join([text, *line.split()])
        if until and until in text:
            return text
    assert not until, text
    return text


def _assert_every_frame_once(run):
    assert [record.sequence for record in read_run(run).frames] == list(range(_FRAMES))
    verification = verify_run(run)
    assert verification.ok
    assert verification.leftovers == ()


def test_a_full_disk_holds_until_there_is_room_and_no_frame_is_lost(tmp_path, disk):
    ballast, run = _fill(disk), disk / "run"
    with _started(tmp_path, run) as process:
        warned = _words(process, until="No space left on device: make room, or stop")
        assert "disk has room for" in warned
        assert process.poll() is None
        ballast.unlink()
        rest = _words(process)
    assert process.returncode == 0, rest
    assert [event for event in read_events(run) if event.event == "disk was full"]
    _assert_every_frame_once(run)


@pytest.mark.slow
def test_a_session_that_waits_for_room_can_be_stopped_and_resumed(tmp_path, disk):
    ballast, run = _fill(disk), disk / "run"
    with _started(tmp_path, run) as process:
        _words(process, until="No space left on device: make room, or stop")
        # Not even the request fits on the disk.
        assert rigctl("stop", run).returncode == 0
        rest = _words(process)
    assert process.returncode == 75, rest
    assert verify_run(run).ok
    # The camera's tally comes after it.
    stopped = next(event for event in reversed(read_events(run)) if event.event == "stopped")
    assert stopped.facts["reason"] == "requested"
    assert stopped.facts["not_stored"]
    ballast.unlink()
    assert rigctl("resume", run).returncode == 0
    _assert_every_frame_once(run)


@pytest.mark.slow
def test_a_full_disk_ends_the_session_where_that_is_asked_for(tmp_path, disk):
    ballast, run = _fill(disk), disk / "run"
    with _started(tmp_path, run, more='disk = "stop"\n') as process:
        said = process.communicate(timeout=DEADLINE_S)[1]
    assert process.returncode == 4, said
    taken = len(read_run(run).frames)
    assert 3 < taken < _FRAMES
    assert verify_run(run).ok
    ballast.unlink()
    assert rigctl("resume", run).returncode == 0
    _assert_every_frame_once(run)


@pytest.mark.slow
def test_a_disk_that_becomes_read_only_stops_the_session_and_a_resume_takes_the_rest(tmp_path, image):
    place, run = tmp_path / "disk", tmp_path / "disk" / "run"
    with mounted(image, place), _started(tmp_path, run) as process:
        wait_for(lambda: frames_on(run) > 2)
        # What ext4 itself does when its disk fails under it.
        call("mount", "-o", "remount,abort", place)
        said = " ".join(process.communicate(timeout=DEADLINE_S)[1].split())
        assert process.returncode == 4, said
        assert "Read-only file system" in said
        refused = rigctl("resume", run)
        assert refused.returncode == 4
        assert "Read-only file system" in " ".join(refused.stderr.split())
    # Mounted again, which replays the journal.
    with mounted(image, place):
        acknowledged = len(read_run(run).frames)
        assert acknowledged > 1
        assert verify_run(run).ok
        assert rigctl("resume", run).returncode == 0
        _assert_every_frame_once(run)


def test_a_slow_flush_makes_the_session_wait_and_loses_nothing(tmp_path, monkeypatch):
    flush, flushed_ns, run = os.fsync, [], tmp_path / "run"

    def slow(descriptor):
        name = Path(f"/proc/self/fd/{descriptor}").readlink().name
        flush(descriptor)
        if name.endswith(f".fits{PART_SUFFIX}"):
            # The first flush lasts until the session has found its queue full, the others a moment.
            wait_for(lambda: flushed_ns or "frames wait for the disk" in (run / "events.jsonl").read_text())
            time.sleep(0.1)
            flushed_ns.append(time.monotonic_ns())

    monkeypatch.setattr(os, "fsync", slow)
    take = [{"kind": "scene", "exposure_ms": 0.03, "cycles": 3}]
    session = SessionFile.model_validate({"name": "slow", "take": take, "interlocks": {"disk_free_mb": 0}})
    take_session(small_rig(tmp_path, port="sim:ellx?speed=200"), session, run, files={})
    _assert_every_frame_once(run)
    assert len(flushed_ns) == _FRAMES
    # One is being flushed, four wait and one is in hand: the next is taken once the first of them is on the disk, and
    # bears the time at which it was taken.
    starts_ns = [record.start_monotonic_ns for record in read_run(run).frames]
    ahead = QUEUE_FRAMES + 2
    assert all(start > done for start, done in zip(starts_ns[ahead:], flushed_ns, strict=False))


@pytest.mark.parametrize("before_flush", [8, 12], ids=["the session itself writes", "frames are written"])
def test_a_disk_that_freezes_ends_the_session_in_time(tmp_path, before_flush):
    reason = why_not()
    if reason is not None:
        pytest.skip(f"{reason}: run it as root where loop devices can be mounted")
    outcome, flushes = run_disk_cell(small_rig(tmp_path, port="sim:ellx?speed=400"), before_flush)
    assert outcome.word == "the disk hangs"
    assert outcome.is_right, (outcome, flushes)


def test_no_acknowledged_frame_is_lost_by_a_power_cut():
    reason = why_not()
    if reason is not None:
        pytest.skip(f"{reason}: run it as root where loop devices can be mounted")
    told, problems = one_cut(0.02, after_frames=3)
    assert problems == []
    assert told >= 3
