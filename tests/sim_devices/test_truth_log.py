"""The simulator's own record of what it exposed."""

import pytest

from drivers.errors import DeviceTimeoutError
from sim_devices.truth_log import TruthLog, read_truth
from tests.sim_devices.camera_builders import small_camera


def test_every_exposure_is_noted_with_its_number_and_fault(tmp_path):
    log = TruthLog(tmp_path / "truth.jsonl")
    camera = small_camera(truth=log, faults={1: "lost"})
    camera.configure(exposure_s=0.002, gain_db=6.0)
    first = camera.take_frame(timeout_s=1.0)
    with pytest.raises(DeviceTimeoutError):
        camera.take_frame(timeout_s=1.0)
    noted = read_truth(tmp_path / "truth.jsonl")
    assert [(frame.sequence, frame.fault) for frame in noted] == [(0, None), (1, "lost")]
    assert noted[0].start_utc_ns == first.start_utc_ns
    assert (noted[0].exposure_s, noted[0].gain_db, noted[0].subject) == (0.002, 6.0, "scene")


def test_the_log_grows_from_session_to_session(tmp_path):
    for _ in range(2):
        small_camera(truth=TruthLog(tmp_path / "truth.jsonl")).take_frame(timeout_s=1.0)
    assert len(read_truth(tmp_path / "truth.jsonl")) == 2


def test_a_line_that_is_no_frame_is_refused(tmp_path):
    (tmp_path / "truth.jsonl").write_text('{"sequence": 1}\n')
    with pytest.raises(ValueError, match="no frame"):
        read_truth(tmp_path / "truth.jsonl")


def test_a_file_that_is_no_log_is_not_added_to(tmp_path):
    (tmp_path / "session.toml").write_text("mine")
    with pytest.raises(FileExistsError, match="no log of exposures"):
        TruthLog(tmp_path / "session.toml")
    assert (tmp_path / "session.toml").read_text() == "mine"
