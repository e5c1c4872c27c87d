"""A running session seen and steered from another terminal, by command and by signal."""

import json
import signal
import subprocess
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
from tests.rigctl.example_files import small_rig_text
from tests.system.programs import DEADLINE_S, INCOMPLETE, RIGCTL, frames_on, rigctl, wait_for


def _status(run):
    return json.loads(rigctl("status", run, "--json").stdout)


def _events(run):
    return (run / "events.jsonl").read_text() if (run / "events.jsonl").exists() else ""


@pytest.fixture
def running(tmp_path):
    """A session that would take minutes."""
    session = tmp_path / "session.toml"
    session.write_text('name = "long"\n[[take]]\nkind = "scene"\nexposure_ms = 0.03\ncycles = 1000\n')
    run = tmp_path / "run"
    (tmp_path / "rig.toml").write_text(small_rig_text(tmp_path))
    command = [*RIGCTL, "acquire", tmp_path / "rig.toml", session, "--out", run]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        wait_for(lambda: frames_on(run))
        yield run, process
        process.kill()


@pytest.mark.slow
def test_status_hold_resume_and_stop_by_command(running):
    run, process = running
    assert _status(run)["state"] == "running"
    assert _status(run)["process"] == process.pid
    assert rigctl("hold", run).returncode == 0
    wait_for(lambda: '"hold"' in _events(run))
    held = _status(run)
    assert held["state"] == "holding"
    assert held["live"]["frames_planned"] == 4000
    assert held["live"]["remaining_s"] > 0
    assert rigctl("resume", run).returncode == 0
    wait_for(lambda: '"continue"' in _events(run))
    wait_for(lambda: frames_on(run) > held["frames"] + 4)
    assert set(_status(run)["live"]["angles"]) == {"0", "45", "90", "135"}
    assert rigctl("stop", run).returncode == 0
    assert process.wait(DEADLINE_S) == INCOMPLETE
    assert _status(run)["state"] == "stopped"
    assert rigctl("verify", run).returncode == INCOMPLETE
    assert rigctl("stop", run).returncode == 4


def test_signals_hold_and_go_on(running):
    run, process = running
    process.send_signal(signal.SIGUSR1)
    wait_for(lambda: '"hold"' in _events(run))
    process.send_signal(signal.SIGUSR2)
    wait_for(lambda: '"continue"' in _events(run))
    assert _events(run).index('"hold"') < _events(run).index('"continue"')


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, INCOMPLETE), (signal.SIGINT, INCOMPLETE)])
def test_a_signal_stops_between_frames(running, number, code):
    run, process = running
    process.send_signal(number)
    assert process.wait(DEADLINE_S) == code
    assert '"stopped"' in _events(run)
    assert json.loads(rigctl("verify", run, "--json").stdout)["leftovers"] == []


@pytest.mark.slow
def test_of_two_simultaneous_resumes_only_one_writes(running):
    run, process = running
    process.kill()
    process.wait()
    command = [*RIGCTL, "resume", run]
    # More than a minute of frames is left: whoever comes first is writing still when the other comes.
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) for _ in range(2)]
    loser = _first_to_end(both)
    winner = both[1 - both.index(loser)]
    printed = " ".join(loser.communicate()[0].split())
    # It found the lock taken, or found a process to which its request was handed on.
    expected = {4: "is writing into this run", 0: f"process {winner.pid} continues"}
    assert expected[loser.returncode] in printed
    wait_for(lambda: rigctl("stop", run).returncode == 0)
    assert winner.wait(DEADLINE_S) == INCOMPLETE
    winner.communicate()
    assert rigctl("verify", run).returncode == INCOMPLETE


def _first_to_end(processes):
    wait_for(lambda: any(process.poll() is not None for process in processes))
    return next(process for process in processes if process.poll() is not None)


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
