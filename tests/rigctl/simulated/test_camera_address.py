"""Where a simulated rig is asked to note what it truly did."""

import pytest

from benchmarks.trials.kills import mislabelled
from rigctl.errors import ConfigError
from rigctl.rig.simulated_parts import split_truth
from rigctl.runs.folder import read_run
from rigctl.session.take import take_session
from sim_devices.truth_log import read_truth
from tests.rigctl.example_files import small_rig, small_session


def test_the_option_is_taken_off_the_address(tmp_path):
    address, log = split_truth(f"sim:gige?lost=0.1&truth={tmp_path / 'truth.jsonl'}&retakes=2")
    assert address == "sim:gige?lost=0.1&retakes=2"
    assert log is not None
    assert split_truth("sim:gc780") == ("sim:gc780", None)


@pytest.mark.parametrize("tail", ["truth=", "truth=a&truth=b", "truth=/no/such/folder/truth.jsonl"])
def test_a_truth_that_cannot_be_written_is_refused(tail):
    with pytest.raises(ConfigError, match="truth="):
        split_truth(f"sim:gc780?{tail}")


def test_labels_are_the_truth_where_the_stage_lands_beside_its_target(tmp_path):
    rig_file = small_rig(tmp_path, port="sim:ellx?speed=50&landing=0.02")
    camera = rig_file.camera.model_copy(update={"address": f"sim:gc780?truth={tmp_path / 'truth.jsonl'}"})
    take_session(rig_file.model_copy(update={"camera": camera}), small_session(), tmp_path / "run", files={})
    run = read_run(tmp_path / "run")
    off = [r.polarizer_angle_deg - r.polarizer_angle_target_deg for r in run.frames if r.kind == "scene"]
    # The commands would not do as labels: some are off by more than the half step of the encoder that is allowed.
    assert max(abs((value + 90) % 180 - 90) for value in off) > 0.003
    assert mislabelled(run, read_truth(tmp_path / "truth.jsonl")) == []
