"""Sessions that are killed at random moments and resumed; the long version is `make trials`."""

from dataclasses import replace

import pytest

from benchmarks.trials.kills import (
    killed_session,
    mislabelled,
    problems_after_resume,
    problems_of,
    undisturbed_run,
    write_files,
)
from sim_devices.truth_log import read_truth


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    files = write_files(folder)
    return files, undisturbed_run(files), folder / "truth.jsonl"


@pytest.mark.slow
@pytest.mark.parametrize("delay_s", [0.05, 0.6, 1.4])
def test_a_killed_and_resumed_session_equals_the_undisturbed_session(tmp_path, undisturbed, delay_s):
    files, run, truth = undisturbed
    killed_session(tmp_path / "run", files, delay_s=delay_s)
    assert problems_of(tmp_path / "run") == []
    assert problems_after_resume(tmp_path / "run", run, truth) == []


def test_the_labels_of_an_undisturbed_session_are_the_truth(undisturbed):
    _, run, truth = undisturbed
    assert mislabelled(run, read_truth(truth)) == []


@pytest.mark.parametrize(
    ("field", "shift", "said"),
    [("polarizer_angle_deg", 0.01, "angle"), ("exposure_s", 1e-6, "exposure"), ("start_monotonic_ns", 1, "time")],
)
def test_a_wrong_label_is_found(undisturbed, field, shift, said):
    _, run, truth = undisturbed
    last = run.frames[-1]
    wrong = replace(last, **{field: getattr(last, field) + shift})
    found = mislabelled(replace(run, frames=(*run.frames[:-1], wrong)), read_truth(truth))
    assert found == [f"{last.file}: the simulator's log has another {said}"]
