"""A plug is pulled in every phase of a session: the message names the device, and what was taken before is whole."""

import pytest

from drivers.errors import DeviceError, NotConnectedError
from rigctl.files.session_file import SessionFile
from rigctl.runs.check import verify_run
from rigctl.runs.folder import read_run
from rigctl.session.take import take_session
from tests.rigctl.example_files import small_rig
from tests.sim_devices.cameras.gige_port import gige_port

SESSION = SessionFile.model_validate(
    {
        "name": "unplugged",
        "take": [{"kind": "scene", "exposure_ms": 2.0, "cycles": 2}],
        "interlocks": {"gone": "stop"},
    }
)


def rig_with(tmp_path, *, port="sim:ellx?speed=200", camera="sim:gc780"):
    rig = small_rig(tmp_path, port=port)
    return rig.model_copy(update={"camera": rig.camera.model_copy(update={"address": camera})})


def assert_what_was_taken_is_whole(path, *, at_least):
    run = read_run(path)
    assert len(run.frames) >= at_least
    assert verify_run(path).ok or at_least == 0


# The commands of a session: 1 asks what it is, 2 and 3 find the mark, then three for each of eight angles.
@pytest.mark.parametrize(
    ("command", "frames"),
    [(1, None), (3, None), (6, 0), (12, 1), (20, 3)],
    ids=["opening", "homing", "turning", "2", "4"],
)
def test_a_stage_whose_port_vanishes(tmp_path, command, frames):
    rig = rig_with(tmp_path, port=f"sim:ellx?speed=200&vanish={command}&back=3600")
    with pytest.raises(NotConnectedError, match=r"port.*(gone away|Check the cable|no such port)"):
        take_session(rig, SESSION, tmp_path / "run", files={})
    if frames is not None:
        assert_what_was_taken_is_whole(tmp_path / "run", at_least=frames)


@pytest.mark.slow
@pytest.mark.parametrize(("picture", "frames"), [(2, 0), (5, 2)], ids=["first frame", "between frames"])
def test_a_camera_whose_power_goes(tmp_path, picture, frames):
    rig = rig_with(tmp_path, camera=f"sim:gige?die={picture}")
    rig = rig.model_copy(update={"camera": rig.camera.model_copy(update={"timeout_s": 1.0})})
    with gige_port(), pytest.raises(DeviceError, match=r"GigE camera 127\.0\.0\.1"):
        take_session(rig, SESSION, tmp_path / "run", files={})
    assert_what_was_taken_is_whole(tmp_path / "run", at_least=frames)
