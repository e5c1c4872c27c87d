"""A session that was interrupted and gone on with is the session that was not, apart from times."""

from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from itertools import pairwise

import numpy as np
import pytest

from drivers.errors import NotConnectedError
from rigctl.base.durable import PART_SUFFIX
from rigctl.base.numbers import unix_ns
from rigctl.errors import RunFolderError
from rigctl.files.session_file import SessionFile
from rigctl.rig.rig import open_rig
from rigctl.rig.simulation import with_simulation
from rigctl.runs.check import repair_run, verify_run
from rigctl.runs.folder import RunLock, read_run
from rigctl.session.control import ask
from rigctl.session.take import resume_session, take_session
from rigctl.session.timing import clock_of
from tests.rigctl.example_files import small_rig, small_session
from tests.rigctl.resealed import with_session

# Without landing errors the polarizer stands where it stood in the other run, and the light is the same.
_EXACT_STAGE = "sim:ellx?speed=50&landing=0"
# What is of the moment: clocks, and the stage's own timing.
_OF_THE_MOMENT = ("start_utc", "end_utc", "start_monotonic_ns", "settle_s", "checksum")


class _PowerCutError(Exception):
    pass


class _CutCamera:
    """Lets so many frames pass, then the lights go out."""

    def __init__(self, camera, frames):
        self._camera, self._left = camera, frames

    def configure(self, **settings):
        return self._camera.configure(**settings)

    def take_frame(self, *, timeout_s):
        if self._left == 0:
            raise _PowerCutError
        self._left -= 1
        return self._camera.take_frame(timeout_s=timeout_s)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    take_session(small_rig(folder, port=_EXACT_STAGE), small_session(), folder / "run", files={})
    return read_run(folder / "run")


def _cut_after(tmp_path, frames, session=None, *, begins=None):
    rig_file, session = small_rig(tmp_path, port=_EXACT_STAGE), session or small_session()
    rig_file = with_simulation(rig_file, clock_ns=begins, perturb=None)
    clock = clock_of(rig_file)

    @contextmanager
    def opener():
        with open_rig(rig_file, session_name=session.name, clock=clock.simulated) as rig:
            yield replace(rig, camera=_CutCamera(rig.camera, frames))

    with pytest.raises(_PowerCutError):
        take_session(rig_file, session, tmp_path / "run", files={}, opener=opener, clock=clock)
    return tmp_path / "run"


def _assert_equal_apart_from_times(run, other):
    assert len(run.frames) == len(other.frames)
    for one, two in zip(run.frames, other.frames, strict=True):
        same = {name: getattr(two, name) for name in _OF_THE_MOMENT}
        assert replace(one, **same) == two
        np.testing.assert_array_equal(run.counts(one), other.counts(two))


@pytest.mark.parametrize("frames", [0, 1, 5])
def test_a_resumed_run_is_the_undisturbed_one(tmp_path, undisturbed, frames):
    run = _cut_after(tmp_path, frames)
    assert len(read_run(run).frames) == frames
    outcome = resume_session(run)
    assert outcome.is_finished
    _assert_equal_apart_from_times(read_run(run), undisturbed)
    assert verify_run(run).ok


def test_a_resumed_run_of_a_simulated_clock_goes_on_at_its_own_time(tmp_path, undisturbed):
    run = _cut_after(tmp_path, 3, begins=unix_ns(datetime.fromisoformat("2010-05-25T14:09:40Z")))
    assert resume_session(run).is_finished
    found = read_run(run)
    _assert_equal_apart_from_times(found, undisturbed)
    starts = [datetime.fromisoformat(frame.start_utc) for frame in found.frames]
    steps_s = np.array([(later - earlier).total_seconds() for earlier, later in pairwise(starts)])
    # Neither the day of the resume, nor the beginning again.
    assert np.all((steps_s > 0.0) & (steps_s < 5.0))
    assert verify_run(run).ok


def test_whole_frames_that_were_not_acknowledged_are_adopted(tmp_path, undisturbed):
    run = _cut_after(tmp_path, 4)
    manifest = (run / "manifest.jsonl").read_bytes().splitlines(keepends=True)
    # One was renamed and not named, of the other only the name was missing; and a line was torn.
    (run / "manifest.jsonl").write_bytes(b"".join(manifest[:2]) + manifest[2][:40])
    last = read_run(run).path / "frames" / sorted(p.name for p in (run / "frames").iterdir())[-1]
    last.rename(last.with_name(last.name + PART_SUFFIX))
    outcome = resume_session(run)
    assert [finding.file for finding in outcome.repair.adopted] == [
        "frames/000002_scene_a000.fits", "frames/000003_scene_a090.fits",
    ]  # fmt: skip
    assert outcome.repair.set_aside == ()
    _assert_equal_apart_from_times(read_run(run), undisturbed)


def test_damaged_frames_are_set_aside_and_taken_again(tmp_path, undisturbed):
    run = _cut_after(tmp_path, 5)
    files = sorted((run / "frames").iterdir())
    files[1].write_bytes(b"")
    files[3].write_bytes(files[3].read_bytes()[:-2880])
    (run / "frames" / "000005_scene_a135.fits.part").write_bytes(b"SIMPLE  =")
    outcome = resume_session(run)
    assert len(outcome.repair.set_aside) == 3
    assert len(list((run / "damaged").iterdir())) == 3
    _assert_equal_apart_from_times(read_run(run), undisturbed)
    assert verify_run(run).leftovers == ()


def test_a_lost_manifest_is_made_again_from_the_frames(tmp_path, undisturbed):
    run = _cut_after(tmp_path, 5)
    (run / "manifest.jsonl").write_bytes(b"{no json}\n")
    assert len(resume_session(run).repair.adopted) == 5
    _assert_equal_apart_from_times(read_run(run), undisturbed)


def test_a_metered_session_goes_on_with_the_exposure_it_had(tmp_path):
    session = SessionFile.model_validate(
        {"name": "small", "take": [{"kind": "scene", "exposure_ms": "auto", "cycles": 2}], "darks": {"every_cycles": 1}}
    )
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    whole.mkdir(), cut.mkdir()
    take_session(small_rig(whole, port=_EXACT_STAGE), session, whole / "run", files={})
    metering_frames = read_run(whole / "run").frames[0].camera_frame
    assert metering_frames >= 4
    run = _cut_after(cut, metering_frames + 7, session)
    assert len(read_run(run).frames) == 7
    resume_session(run)
    _assert_equal_apart_from_times(read_run(run), read_run(whole / "run"))


def test_a_finished_run_is_left_as_it_is(tmp_path):
    take_session(small_rig(tmp_path), small_session(), tmp_path / "run", files={})
    before = _contents(tmp_path / "run")
    assert resume_session(tmp_path / "run").is_finished
    assert _contents(tmp_path / "run") == before


def _contents(run):
    return {path: path.read_bytes() for path in run.rglob("*") if path.is_file() and path.name != "writer.lock"}


def test_two_processes_cannot_write_one_run(tmp_path):
    run = _cut_after(tmp_path, 3)
    lock = RunLock(run)
    try:
        with pytest.raises(RunFolderError, match=r"process \d+ is writing into this run"):
            resume_session(run)
    finally:
        lock.release()
    assert resume_session(run).is_finished


def test_what_was_asked_of_the_session_that_ended_is_not_asked_of_the_next(tmp_path):
    run = _cut_after(tmp_path, 3)
    ask(run, "stop")
    assert resume_session(run).is_finished


def test_a_request_under_way_is_no_damage_of_the_run(tmp_path):
    run = _cut_after(tmp_path, 3)
    ask(run, "hold")
    assert repair_run(run).set_aside == ()
    assert verify_run(run).leftovers == ()


def test_another_camera_than_the_one_it_began_with_is_refused(tmp_path):
    run = _cut_after(tmp_path, 3)
    with_session(run, lambda session: session["camera"].update(serial_number="another"))
    with pytest.raises(NotConnectedError, match=r"began with .* another"):
        resume_session(run)


def test_a_run_of_another_plan_is_refused(tmp_path):
    run = _cut_after(tmp_path, 4)
    take = [{"kind": "dark", "exposure_ms": 1, "cycles": 9}]
    with_session(run, lambda session: session["session"].update(take=take))
    with pytest.raises(RunFolderError, match="not made by this session"):
        resume_session(run)


def test_the_scene_of_a_simulated_rig_is_kept_in_the_run(tmp_path, undisturbed):
    run = _cut_after(tmp_path, 3)
    (tmp_path / "scene.toml").unlink()
    resume_session(run)
    _assert_equal_apart_from_times(read_run(run), undisturbed)
