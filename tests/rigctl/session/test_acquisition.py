import json

import numpy as np
import pytest

from drivers.errors import DeviceFaultError, NotConnectedError, ProtocolError
from rigctl.errors import ConfigError, RunFolderError
from rigctl.rig.rig import open_rig
from rigctl.runs.folder import read_run
from rigctl.runs.writer import RunWriter
from rigctl.session.acquisition import acquire
from rigctl.session.plan import plan_steps
from rigctl.session.take import take_session
from tests.rigctl.example_files import small_rig, small_session


def _taken(tmp_path, rig, session):
    take_session(rig, session, tmp_path / "run", files={})
    return read_run(tmp_path / "run")


def test_every_step_is_a_frame_at_its_angle(tmp_path):
    run = _taken(tmp_path, small_rig(tmp_path), small_session(cycles=2))
    scene = [record for record in run.frames if record.kind == "scene"]
    assert [record.polarizer_angle_target_deg for record in scene] == [0, 90, 45, 135] * 2
    assert [record.cycle for record in scene] == [0] * 4 + [1] * 4
    # The tolerance of the rig file: what the stage reads back is never further off.
    off = [(r.polarizer_angle_deg - r.polarizer_angle_target_deg + 90) % 180 - 90 for r in scene]
    assert np.max(np.abs(off)) <= 0.05


def test_a_frame_says_all_that_is_needed_to_interpret_it(tmp_path):
    run = _taken(tmp_path, small_rig(tmp_path), small_session())
    record = run.frames[-1]
    # sense -1, offset 31.7: polarizer 135 is the stage at -103.3.
    assert record.stage_angle_target_deg == pytest.approx(-103.3)
    off_counts = record.stage_counts - record.stage_angle_deg / 360 * 143360
    assert (off_counts + 71680) % 143360 - 71680 == pytest.approx(0, abs=0.51)
    assert record.exposure_s == pytest.approx(30e-6)
    assert record.bit_depth == 12
    assert record.camera_model.startswith("simulated")
    assert record.stage_model == "ELL14"
    assert record.start_utc < record.end_utc
    assert run.session.origin == "simulated"
    assert (run.session.polarizer.sense, run.session.polarizer.offset_deg) == (-1, 31.7)


def test_dark_frames_are_dark_and_scene_frames_are_not(tmp_path):
    run = _taken(tmp_path, small_rig(tmp_path), small_session())
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


def test_what_was_taken_before_a_stall_is_kept(tmp_path):
    rig = small_rig(tmp_path, port="sim:ellx?speed=50&stall=3")
    with pytest.raises(DeviceFaultError, match="mechanical"):
        take_session(rig, small_session(), tmp_path / "run", files={})
    run = read_run(tmp_path / "run")
    assert [record.polarizer_angle_target_deg for record in run.frames if record.kind == "scene"] == [0, 90]


def test_events_tell_what_happened(tmp_path):
    _taken(tmp_path, small_rig(tmp_path), small_session())
    events = [json.loads(line)["event"] for line in (tmp_path / "run" / "events.jsonl").read_text().splitlines()]
    assert events == ["homed", "presented", "presented", "camera tally", "finished"]


def test_a_frame_taken_twice_stops_the_session(tmp_path):
    rig_file, session = small_rig(tmp_path), small_session()
    with open_rig(rig_file, session_name="repeated") as rig:
        rig.camera.configure(exposure_s=30e-6, gain_db=0.0)
        first = rig.camera.take_frame(timeout_s=1.0)
        stale = _StaleCamera(rig.camera, first)
        broken = type(rig)(**{**vars(rig), "camera": stale})
        with (
            RunWriter.create(tmp_path / "run", {"origin": "simulated"}) as writer,
            pytest.raises(ProtocolError, match="identical"),
        ):
            acquire(broken, rig_file, plan_steps(session), writer, progress=lambda _: None)
    assert len(read_run(tmp_path / "run").frames) == 1


class _StaleCamera:
    def __init__(self, camera, frame):
        self._camera, self._frame = camera, frame

    def configure(self, **settings):
        return self._camera.configure(**settings)

    def take_frame(self, *, timeout_s):
        return self._frame


@pytest.mark.parametrize("device", ["stage", "camera"])
def test_another_serial_number_is_refused(tmp_path, device):
    rig = small_rig(tmp_path)
    section = getattr(rig, device).model_copy(update={"serial_number": "other"})
    with pytest.raises(NotConnectedError, match=rf"{device}.*rig file asks for other"):
        take_session(rig.model_copy(update={device: section}), small_session(), tmp_path / "run", files={})
    assert not (tmp_path / "run").exists()


def test_an_unknown_driver_is_named_with_those_that_there_are(tmp_path):
    rig = small_rig(tmp_path)
    stage = rig.stage.model_copy(update={"driver": "esp301"})
    with pytest.raises(ConfigError, match=r"'esp301'.*ellx"):
        take_session(rig.model_copy(update={"stage": stage}), small_session(), tmp_path / "run", files={})


def test_a_run_folder_is_not_written_over(tmp_path):
    _taken(tmp_path, small_rig(tmp_path), small_session())
    with pytest.raises(RunFolderError, match="not empty"):
        take_session(small_rig(tmp_path), small_session(), tmp_path / "run", files={})


def test_a_wrong_simulation_address_is_a_problem_of_the_rig_file(tmp_path):
    with pytest.raises(ConfigError, match="wobble"):
        take_session(small_rig(tmp_path, port="sim:ellx?wobble=1"), small_session(), tmp_path / "run", files={})
