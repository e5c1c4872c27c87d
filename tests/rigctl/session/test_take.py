"""A session from open devices to its run; a resumed one equals one that was not interrupted, apart from times."""

from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from itertools import pairwise

import numpy as np
import pytest

from drivers.errors import DeviceError, NotConnectedError
from rigctl.base.durable import PART_SUFFIX
from rigctl.base.numbers import unix_ns
from rigctl.errors import ConfigError, RunFolderError
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
from tests.sim_devices.cameras.gige_port import gige_port

# Without landing errors the polarizer stands where it stood in the other run, and the light is the same.
_EXACT_STAGE = "sim:ellx?speed=50&landing=0"
# Facts of the moment: clocks, and the stage's own timing.
_OF_THE_MOMENT = ("start_utc", "end_utc", "start_monotonic_ns", "settle_s", "checksum")


def _taken(tmp_path, rig, session):
    take_session(rig, session, tmp_path / "run", files={})
    return read_run(tmp_path / "run")


def test_every_step_is_a_frame_with_all_that_is_needed_to_interpret_it(tmp_path):
    run = _taken(tmp_path, small_rig(tmp_path), small_session(cycles=2))
    scene = [record for record in run.frames if record.kind == "scene"]
    assert [record.polarizer_angle_target_deg for record in scene] == [0, 90, 45, 135] * 2
    assert [record.cycle for record in scene] == [0] * 4 + [1] * 4
    # The tolerance of the rig file: what the stage reads back is never further off.
    off = [(r.polarizer_angle_deg - r.polarizer_angle_target_deg + 90) % 180 - 90 for r in scene]
    assert np.max(np.abs(off)) <= 0.05
    record = run.frames[-1]
    # sense -1, offset 31.7: polarizer 135 is the stage at -103.3.
    assert record.stage_angle_target_deg == pytest.approx(-103.3)
    off_counts = record.stage_counts - record.stage_angle_deg / 360 * 143360
    assert (off_counts + 71680) % 143360 - 71680 == pytest.approx(0, abs=0.51)
    assert record.exposure_s == pytest.approx(30e-6)
    assert record.start_utc < record.end_utc
    assert (record.bit_depth, record.stage_model, run.session.origin) == (12, "ELL14", "simulated")
    means = {record.kind: run.counts(record).mean() for record in run.frames}
    assert means["dark"] == pytest.approx(64, abs=1)
    assert means["scene"] > 300


def test_the_same_seed_gives_the_same_frames_and_another_session_does_not(tmp_path):
    frames = []
    for k, name in enumerate(("one", "one", "two")):
        folder = tmp_path / str(k)
        folder.mkdir()
        run = _taken(folder, small_rig(folder), small_session(name=name))
        frames.append(run.counts(run.frames[0]))
    assert np.array_equal(frames[0], frames[1])
    assert not np.array_equal(frames[0], frames[2])


@pytest.mark.parametrize(
    ("device", "change", "error", "match"),
    [
        ("stage", {"serial_number": "other"}, NotConnectedError, "stage.*rig file asks for other"),
        ("camera", {"serial_number": "other"}, NotConnectedError, "camera.*rig file asks for other"),
        ("stage", {"driver": "esp301"}, ConfigError, "'esp301'.*ellx"),
        ("stage", {"port": "sim:ellx?wobble=1"}, ConfigError, "wobble"),
    ],
)
def test_a_rig_that_is_not_as_its_file_says_is_refused(tmp_path, device, change, error, match):
    rig = small_rig(tmp_path)
    rig = rig.model_copy(update={device: getattr(rig, device).model_copy(update=change)})
    with pytest.raises(error, match=match):
        take_session(rig, small_session(), tmp_path / "run", files={})
    assert not (tmp_path / "run").exists()


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
    return _taken(folder, small_rig(folder, port=_EXACT_STAGE), small_session())


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
        assert replace(one, **{name: getattr(two, name) for name in _OF_THE_MOMENT}) == two
        np.testing.assert_array_equal(run.counts(one), other.counts(two))


@pytest.mark.parametrize("frames", [0, 1, 5])
def test_a_resumed_run_is_the_undisturbed_one(tmp_path, undisturbed, frames):
    run = _cut_after(tmp_path, frames)
    assert len(read_run(run).frames) == frames
    # A request of the session that ended is not one of the next; nor is it damage, nor is the scene needed any more.
    ask(run, "stop")
    assert (repair_run(run).set_aside, verify_run(run).leftovers) == ((), ())
    (tmp_path / "scene.toml").unlink()
    assert resume_session(run).is_finished
    _assert_equal_apart_from_times(read_run(run), undisturbed)
    assert verify_run(run).ok
    before = _contents(run)
    assert resume_session(run).was_finished
    assert _contents(run) == before


def _contents(run):
    return {path: path.read_bytes() for path in run.rglob("*") if path.is_file() and path.name != "writer.lock"}


def test_a_resumed_run_continues_at_its_simulated_time(tmp_path, undisturbed):
    run = _cut_after(tmp_path, 3, begins=unix_ns(datetime.fromisoformat("2010-05-25T14:09:40Z")))
    assert resume_session(run).is_finished
    found = read_run(run)
    _assert_equal_apart_from_times(found, undisturbed)
    starts = [datetime.fromisoformat(frame.start_utc) for frame in found.frames]
    steps_s = np.array([(later - earlier).total_seconds() for earlier, later in pairwise(starts)])
    # Neither the day of the resume, nor the beginning again.
    assert np.all((steps_s > 0.0) & (steps_s < 5.0))


def test_whole_frames_that_were_not_acknowledged_are_adopted(tmp_path, undisturbed):
    run = _cut_after(tmp_path, 4)
    manifest = (run / "manifest.jsonl").read_bytes().splitlines(keepends=True)
    # One was renamed and not named, of the other only the name was missing; and a line was torn.
    (run / "manifest.jsonl").write_bytes(b"".join(manifest[:2]) + manifest[2][:40])
    last = sorted((run / "frames").iterdir())[-1]
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
    assert len(resume_session(run).repair.set_aside) == 3
    assert len(list((run / "damaged").iterdir())) == 3
    _assert_equal_apart_from_times(read_run(run), undisturbed)
    assert verify_run(run).leftovers == ()


def test_a_lost_manifest_is_made_again_from_the_frames(tmp_path, undisturbed):
    run = _cut_after(tmp_path, 5)
    (run / "manifest.jsonl").write_bytes(b"{no json}\n")
    assert len(resume_session(run).repair.adopted) == 5
    _assert_equal_apart_from_times(read_run(run), undisturbed)


def test_metered_exposures_are_those_of_the_part_before(tmp_path):
    session = SessionFile.model_validate(
        {"name": "small", "take": [{"kind": "scene", "exposure_ms": "auto", "cycles": 2}], "darks": {"every_cycles": 1}}
    )
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    whole.mkdir(), cut.mkdir()
    undisturbed = _taken(whole, small_rig(whole, port=_EXACT_STAGE), session)
    metering_frames = undisturbed.frames[0].camera_frame
    assert metering_frames >= 4
    run = _cut_after(cut, metering_frames + 7, session)
    assert len(read_run(run).frames) == 7
    resume_session(run)
    _assert_equal_apart_from_times(read_run(run), undisturbed)


def test_two_processes_cannot_write_one_run(tmp_path):
    run = _cut_after(tmp_path, 3)
    lock = RunLock(run)
    try:
        with pytest.raises(RunFolderError, match=r"process \d+ is writing into this run"):
            resume_session(run)
    finally:
        lock.release()
    assert resume_session(run).is_finished


@pytest.mark.parametrize(
    ("edit", "error", "match"),
    [
        (lambda s: s["camera"].update(serial_number="another"), NotConnectedError, "began with .* another"),
        (
            lambda s: s["session"].update(take=[{"kind": "dark", "exposure_ms": 1, "cycles": 9}]),
            RunFolderError,
            "not made by this session",
        ),
    ],
    ids=["camera", "plan"],
)
def test_a_run_of_another_camera_or_plan_is_refused(tmp_path, edit, error, match):
    run = _cut_after(tmp_path, 4)
    with_session(run, edit)
    with pytest.raises(error, match=match):
        resume_session(run)


UNPLUGGED = SessionFile.model_validate(
    {
        "name": "unplugged",
        "take": [{"kind": "scene", "exposure_ms": 0.03, "cycles": 2}],
        "interlocks": {"gone": "stop"},
    }
)


# The commands of a session: 1 asks what it is, 2 and 3 find the mark, then three for each of eight angles.
@pytest.mark.parametrize(
    ("command", "frames"),
    [(1, None), (3, None), (6, 0), (12, 1), (20, 3)],
    ids=["opening", "homing", "turning", "2", "4"],
)
def test_a_stage_whose_port_vanishes(tmp_path, command, frames):
    rig = small_rig(tmp_path, port=f"sim:ellx?speed=200&vanish={command}&back=3600")
    with pytest.raises(NotConnectedError, match=r"port.*(disconnected|Check the cable|no such port)"):
        take_session(rig, UNPLUGGED, tmp_path / "run", files={})
    if frames is not None:
        assert len(read_run(tmp_path / "run").frames) >= frames
        assert verify_run(tmp_path / "run").ok or frames == 0


@pytest.mark.slow
@pytest.mark.parametrize(("picture", "frames"), [(2, 0), (5, 2)], ids=["first frame", "between frames"])
def test_a_camera_whose_power_goes(tmp_path, picture, frames):
    rig = small_rig(tmp_path, port="sim:ellx?speed=200")
    camera = {"address": f"sim:gige?die={picture}", "timeout_s": 1.0}
    rig = rig.model_copy(update={"camera": rig.camera.model_copy(update=camera)})
    with gige_port(), pytest.raises(DeviceError, match=r"GigE camera 127\.0\.0\.1"):
        take_session(rig, UNPLUGGED, tmp_path / "run", files={})
    assert len(read_run(tmp_path / "run").frames) >= frames
    assert verify_run(tmp_path / "run").ok or frames == 0
