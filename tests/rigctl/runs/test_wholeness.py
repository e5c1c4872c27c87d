"""Runs held against what they say of themselves: whole, unfinished or damaged."""

import logging
import os
import shutil

import pytest

from benchmarks.trials.damaged_runs import faults, make_run
from rigctl import cli
from rigctl.errors import RunFolderError
from rigctl.runs.check import used_run
from rigctl.runs.folder import read_run
from rigctl.session.take import resume_session
from rigctl.verbs.verify import verification_of
from tests.rigctl.resealed import with_line
from tests.rigctl.run_samples import write_run


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    return make_run(tmp_path_factory.mktemp("taken"))


@pytest.fixture
def run(taken, tmp_path):
    return shutil.copytree(taken, tmp_path / "run")


def _without_last_line(file):
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join(lines[:-1]))


def test_a_session_that_has_finished_is_whole(run, capsys):
    assert cli.main(["verify", str(run)]) == 0
    assert "10 frames, whole" in capsys.readouterr().out


def test_a_session_without_its_last_word_is_unfinished(run, capsys):
    _without_last_line(run / "events.jsonl")
    assert verification_of(run).state == "unfinished"
    assert cli.main(["verify", str(run)]) == 75
    assert "UNFINISHED" in capsys.readouterr().out


def test_events_that_are_gone_leave_no_whole_run(run):
    (run / "events.jsonl").write_bytes(b"")
    assert verification_of(run).state == "unfinished"


def test_what_an_earlier_kill_would_have_left_is_unfinished_and_its_steps_are_named(run):
    (run / "events.jsonl").write_bytes(b"")
    _without_last_line(run / "manifest.jsonl")
    sorted((run / "frames").iterdir())[-1].unlink()
    found = verification_of(run)
    assert (found.state, found.frames) == ("unfinished", 9)
    assert found.gaps == ("step 9 (scene, cycle 1, 135 deg) has no frame",)


def test_a_frame_deleted_with_its_line_is_found_and_its_step_is_named(run):
    manifest = run / "manifest.jsonl"
    lines = manifest.read_bytes().splitlines(keepends=True)
    manifest.write_bytes(b"".join(lines[:3] + lines[4:]))
    sorted((run / "frames").iterdir())[3].unlink()
    found = verification_of(run)
    assert found.state == "damaged"
    assert [gap.partition(" (")[0] for gap in found.gaps] == ["step 3"]


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("session.json", b'"offset_deg": ', b'"offset_deg": 1'),
        ("inputs/rig.toml", b"rig", b"rog"),
        ("manifest.jsonl", b'"polarizer_angle_deg": ', b'"polarizer_angle_deg": 1'),
        ("events.jsonl", b"homed", b"horned"),
    ],
)
def test_an_edited_file_is_damage(run, file, old, new):
    content = (run / file).read_bytes()
    assert old in content
    (run / file).write_bytes(content.replace(old, new, 1))
    found = verification_of(run)
    assert found.state == "damaged"
    assert file in {finding.file for finding in found.bad}


def test_a_label_that_only_its_header_contradicts_is_refused_by_readers(run):
    with_line(run, 2, lambda line: line.update(polarizer_angle_deg=64.99))
    read = read_run(run)
    with pytest.raises(RunFolderError, match="contradict each other: polarizer_angle_deg"):
        read.counts(read.frames[2])


def test_readers_work_on_an_unfinished_run_and_say_so(run, caplog):
    _without_last_line(run / "events.jsonl")
    with caplog.at_level(logging.WARNING, logger="rigctl"):
        assert len(used_run(run).frames) == 10
    assert "is unfinished" in caplog.text


def test_a_repair_that_makes_the_manifest_again_leaves_a_whole_run(run):
    manifest = run / "manifest.jsonl"
    manifest.write_bytes(manifest.read_bytes().replace(b'"exposure_s": ', b'"exposure_s": 1', 1))
    assert verification_of(run).state == "damaged"
    assert resume_session(run).is_finished
    assert verification_of(run).state == "whole"


@pytest.mark.parametrize("name", ["session.json", "manifest.jsonl", "events.jsonl", "status.json", "writer.lock"])
def test_a_pipe_in_the_place_of_a_file_hangs_nobody(tmp_path, name):
    run = write_run(tmp_path / "run")
    (run / name).unlink(missing_ok=True)
    os.mkfifo(run / name)
    assert cli.main(["status", str(run)]) in (0, 4)
    assert cli.main(["verify", str(run)]) in (0, 4, 75)


def test_damage_of_any_kind_is_found(tmp_path):
    assert faults(25, seed=24, folder=tmp_path) == []
