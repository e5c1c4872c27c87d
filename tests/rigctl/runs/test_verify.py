import json

import pytest

from rigctl import cli
from rigctl.runs.check import verify_run
from tests.rigctl.resealed import with_line
from tests.rigctl.run_samples import write_run


@pytest.fixture
def run_path(tmp_path):
    return write_run(tmp_path / "run")


def first_frame(run_path):
    return run_path / "frames" / "000000_scene_a000.fits"


def flip_a_bit(file, place):
    data = bytearray(file.read_bytes())
    data[place] ^= 1
    file.write_bytes(data)


def findings(found):
    return {finding.file: finding.problem for finding in found}


def test_sound_run_is_ok(run_path):
    verification = verify_run(run_path)
    assert (verification.ok, verification.frames, verification.leftovers) == (True, 3, ())


@pytest.mark.parametrize("place", [700, -2880], ids=["header", "samples"])
def test_flipped_bit_is_found(run_path, place):
    flip_a_bit(first_frame(run_path), place)
    assert "damaged" in findings(verify_run(run_path).bad)["frames/000000_scene_a000.fits"]


def test_missing_frame_is_found(run_path):
    first_frame(run_path).unlink()
    assert findings(verify_run(run_path).bad) == {"frames/000000_scene_a000.fits": "missing"}


def test_manifest_that_contradicts_a_header_is_found(run_path):
    with_line(run_path, 1, lambda line: line.update(polarizer_angle_deg=135.0))
    problem = findings(verify_run(run_path).bad)["frames/000001_scene_a045.fits"]
    assert problem.partition(": ")[2] == "manifest and header contradict each other: polarizer_angle_deg"


def test_damaged_manifest_line_and_session_are_found(run_path):
    (run_path / "session.json").write_text("{")
    with (run_path / "manifest.jsonl").open("a") as manifest:
        manifest.write("{}\n")
    assert set(findings(verify_run(run_path).bad)) >= {"session.json", "manifest.jsonl"}


def test_unfinished_frame_is_left_over_and_not_bad(run_path):
    (run_path / "frames" / "000003_scene_a135.fits.part").write_bytes(b"SIMPLE")
    verification = verify_run(run_path)
    assert verification.ok
    assert findings(verification.leftovers) == {"frames/000003_scene_a135.fits.part": "begun and not finished"}


def test_whole_frame_without_a_line_is_left_over_and_not_bad(tmp_path):
    run_path = write_run(tmp_path / "run", is_closed=False)
    manifest = run_path / "manifest.jsonl"
    lines = manifest.read_bytes().splitlines(keepends=True)
    manifest.write_bytes(b"".join(lines[:2]) + lines[2][:50])
    verification = verify_run(run_path)
    assert (verification.ok, verification.frames) == (True, 2)
    assert set(findings(verification.leftovers)) == {"frames/000002_scene_a090.fits", "manifest.jsonl"}


def test_torn_frame_under_a_final_name_is_bad(run_path):
    data = first_frame(run_path).read_bytes()
    (run_path / "frames" / "000003_scene_a135.fits").write_bytes(data[:-100])
    assert set(findings(verify_run(run_path).bad)) == {"frames/000003_scene_a135.fits"}


def test_command_answers_in_json(run_path, capsys):
    assert cli.main(["verify", str(run_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "ok": True,
        "frames": 3,
        "bad": [],
        "leftovers": [],
        "state": "whole",
        "gaps": [],
        "unchecked": [],
    }


def test_command_ends_with_4_when_bad_and_still_answers(run_path, capsys):
    flip_a_bit(first_frame(run_path), -2880)
    assert cli.main(["verify", str(run_path), "--json"]) == 4
    answer = json.loads(capsys.readouterr().out)
    assert answer["ok"] is False
    assert [finding["file"] for finding in answer["bad"]] == ["frames/000000_scene_a000.fits"]


def test_command_ends_with_4_where_there_is_no_run(tmp_path, capsys):
    assert cli.main(["verify", str(tmp_path / "none")]) == 4
    assert "there is no such folder" in capsys.readouterr().err


def test_command_names_every_bad_file_for_people(run_path, capsys):
    flip_a_bit(first_frame(run_path), -2880)
    cli.main(["verify", str(run_path)])
    out = capsys.readouterr().out
    assert "3 frames, DAMAGED" in out
    assert "bad: frames/000000_scene_a000.fits: " in out
