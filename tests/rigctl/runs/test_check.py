"""Checks and repairs of runs: whole, unfinished or damaged; no damage is missed."""

import json
import logging
import os
import shutil
from dataclasses import replace

import pytest

from benchmarks.trials.damaged_runs import faults, make_run
from rigctl import cli
from rigctl.errors import RunFolderError
from rigctl.runs.check import repair_run, run_to_measure, verify_run
from rigctl.runs.folder import read_frame, read_run
from rigctl.runs.writer import RunWriter
from rigctl.session.take import resume_session
from rigctl.verbs.verify import verification_of
from tests.rigctl.resealed import with_line
from tests.rigctl.run_samples import write_run

FIRST = "frames/000000_scene_a000.fits"


@pytest.fixture
def written(tmp_path):
    """Three frames that a writer has closed."""
    return write_run(tmp_path / "written")


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    return make_run(tmp_path_factory.mktemp("taken"))


@pytest.fixture
def run(taken, tmp_path):
    """A session of ten frames."""
    return shutil.copytree(taken, tmp_path / "run")


def flip_a_bit(file, place):
    data = bytearray(file.read_bytes())
    data[place] ^= 1
    file.write_bytes(data)


def lines_of(file):
    return file.read_bytes().splitlines(keepends=True)


def findings(found):
    return {finding.file: finding.problem for finding in found}


@pytest.mark.parametrize("place", [700, -2880], ids=["header", "samples"])
def test_a_flipped_bit_is_found(written, place):
    flip_a_bit(written / FIRST, place)
    assert "damaged" in findings(verify_run(written).bad)[FIRST]


def test_a_missing_frame_is_found(written):
    (written / FIRST).unlink()
    assert findings(verify_run(written).bad) == {FIRST: "missing"}


def test_a_manifest_that_contradicts_a_header_is_found_and_refused_by_readers(written):
    with_line(written, 1, lambda line: line.update(polarizer_angle_deg=135.0))
    problem = findings(verify_run(written).bad)["frames/000001_scene_a045.fits"]
    assert problem.partition(": ")[2] == "manifest and header contradict each other: polarizer_angle_deg"
    read = read_run(written)
    with pytest.raises(RunFolderError, match="contradict each other: polarizer_angle_deg"):
        read.counts(read.frames[1])


def test_a_damaged_manifest_line_and_session_are_found(written):
    (written / "session.json").write_text("{")
    with (written / "manifest.jsonl").open("a") as manifest:
        manifest.write("{}\n")
    assert set(findings(verify_run(written).bad)) >= {"session.json", "manifest.jsonl"}


def test_files_of_a_killed_writer_are_left_over_and_not_bad(tmp_path):
    run = write_run(tmp_path / "run", is_closed=False)
    lines = lines_of(run / "manifest.jsonl")
    (run / "manifest.jsonl").write_bytes(b"".join(lines[:2]) + lines[2][:50])
    (run / "frames" / "000003_scene_a135.fits.part").write_bytes(b"SIMPLE")
    found = verify_run(run)
    assert (found.ok, found.frames) == (True, 2)
    leftovers = findings(found.leftovers)
    assert set(leftovers) == {
        "frames/000002_scene_a090.fits",
        "frames/000003_scene_a135.fits.part",
        "manifest.jsonl",
    }
    assert leftovers["frames/000003_scene_a135.fits.part"] == "begun and not finished"


def test_a_frame_file_that_is_not_in_the_manifest_is_reported(run, caplog):
    (run / "frames" / "999999_scene_a000.fits").write_bytes((run / "frames" / "000002_scene_a000.fits").read_bytes())
    with caplog.at_level(logging.WARNING, logger="rigctl"):
        assert len(run_to_measure(run).frames) == 10
    assert "999999_scene_a000.fits: 1 files missing from the manifest are not used" in caplog.text
    assert verification_of(run).state == "damaged"


def test_a_torn_frame_under_a_final_name_is_bad(written):
    (written / "frames" / "000003_scene_a135.fits").write_bytes((written / FIRST).read_bytes()[:-100])
    assert set(findings(verify_run(written).bad)) == {"frames/000003_scene_a135.fits"}


def test_the_command_answers_for_people_and_programs(written, tmp_path, capsys):
    assert cli.main(["verify", str(written), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "ok": True,
        "frames": 3,
        "bad": [],
        "leftovers": [],
        "state": "whole",
        "gaps": [],
        "unchecked": [],
    }
    flip_a_bit(written / FIRST, -2880)
    assert cli.main(["verify", str(written), "--json"]) == 4
    answer = json.loads(capsys.readouterr().out)
    assert (answer["ok"], [finding["file"] for finding in answer["bad"]]) == (False, [FIRST])
    cli.main(["verify", str(written)])
    out = capsys.readouterr().out
    assert "3 frames, DAMAGED" in out
    assert f"bad: {FIRST}: " in out
    assert cli.main(["verify", str(tmp_path / "none")]) == 4
    assert "there is no such folder" in capsys.readouterr().err


def test_a_session_that_has_finished_is_whole_and_without_its_last_word_unfinished(run, capsys, caplog):
    assert cli.main(["verify", str(run)]) == 0
    assert "10 frames, whole" in capsys.readouterr().out
    (run / "events.jsonl").write_bytes(b"".join(lines_of(run / "events.jsonl")[:-1]))
    assert cli.main(["verify", str(run)]) == 75
    assert "UNFINISHED" in capsys.readouterr().out
    # Readers work on it and say so.
    with caplog.at_level(logging.WARNING, logger="rigctl"):
        assert len(run_to_measure(run).frames) == 10
    assert "is unfinished" in caplog.text


def test_a_run_as_after_an_earlier_kill_is_unfinished_and_its_steps_are_listed(run):
    (run / "events.jsonl").write_bytes(b"")
    assert verification_of(run).state == "unfinished"
    (run / "manifest.jsonl").write_bytes(b"".join(lines_of(run / "manifest.jsonl")[:-1]))
    sorted((run / "frames").iterdir())[-1].unlink()
    found = verification_of(run)
    assert (found.state, found.frames) == ("unfinished", 9)
    assert found.gaps == ("step 9 (scene, cycle 1, 135 deg) has no frame",)


def test_a_frame_deleted_with_its_line_is_found_and_its_step_is_named(run):
    lines = lines_of(run / "manifest.jsonl")
    (run / "manifest.jsonl").write_bytes(b"".join(lines[:3] + lines[4:]))
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
    assert file in findings(found.bad)


def test_a_repair_that_makes_the_manifest_again_leaves_a_whole_run(run):
    manifest = run / "manifest.jsonl"
    manifest.write_bytes(manifest.read_bytes().replace(b'"exposure_s": ', b'"exposure_s": 1', 1))
    assert verification_of(run).state == "damaged"
    assert resume_session(run).is_finished
    assert verification_of(run).state == "whole"


def test_a_repair_refuses_a_damaged_session_file_and_that_of_another_run(run, tmp_path):
    before = {file: file.read_bytes() for file in run.rglob("*") if file.is_file()}
    other = make_run(tmp_path / "other")
    shutil.copy(other / "session.json", run / "session.json")
    with pytest.raises(RunFolderError, match="belongs to another run than manifest and events"):
        repair_run(run)
    (run / "session.json").write_text("{")
    with pytest.raises(RunFolderError, match=r"session\.json: .*the plan of the session is not known"):
        repair_run(run)
    (run / "session.json").write_bytes(before[run / "session.json"])
    assert {file: file.read_bytes() for file in run.rglob("*") if file.is_file()} == before


def test_a_finished_run_that_was_killed_while_more_frames_came_is_unfinished(run):
    last = read_run(run).frames[-1]
    counts = read_frame(run, last)
    with RunWriter.append(run) as writer:
        writer.write_frame(replace(last, sequence=10, file="", checksum=""), counts)
    assert verify_run(run).state == "unfinished"
    lines = lines_of(run / "manifest.jsonl")
    (run / "manifest.jsonl").write_bytes(b"".join([lines[0], *lines[2:]]))  # nothing later excuses another manifest
    assert verify_run(run).state == "damaged"


def test_a_repair_keeps_every_damaged_file(run, taken):
    name = read_run(run).frames[0].file
    for _ in range(3):
        shutil.copy(taken / name, run / name)
        flip_a_bit(run / name, 700)
        (finding,) = repair_run(run).set_aside
        assert (finding.file, "damaged" in finding.problem) == (name, True)
    base = name.rpartition("/")[2]
    assert sorted(file.name for file in (run / "damaged").iterdir()) == [base, f"{base}.1", f"{base}.2"]


@pytest.mark.parametrize("name", ["session.json", "manifest.jsonl", "events.jsonl", "status.json", "writer.lock"])
def test_a_pipe_in_place_of_a_file_does_not_hang(written, name):
    (written / name).unlink(missing_ok=True)
    os.mkfifo(written / name)
    assert cli.main(["status", str(written)]) in (0, 4)
    assert cli.main(["verify", str(written)]) in (0, 4, 75)


def test_damage_of_any_kind_is_found(tmp_path):
    assert faults(25, seed=24, folder=tmp_path) == []
