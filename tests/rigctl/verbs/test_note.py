"""Notes and exclusions: journaled beside the frames, honoured wherever frames become numbers."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

import rigctl
from rigctl import cli
from rigctl.errors import ConfigError, RunFolderError
from rigctl.measure.frames import arrange
from rigctl.runs.check import run_to_measure
from rigctl.runs.folder import ANNOTATIONS_FILE, read_annotations
from rigctl.verbs.note import note
from rigctl.verbs.stokes import stokes
from rigctl.verbs.verify import verification_of
from rigctl.web.run_reader import RunReader
from tests.rigctl.made_runs import at, make_run

ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
NOW_NS = 1_777_890_000_000_000_000  # 2026-05-04T10:20:00Z


def _run(path, *, cycles=3, with_cycle=True):
    """Return a run of some cycles; the last one is much brighter, as if a bird were white."""
    generator = np.random.default_rng(3)
    frames = []
    for cycle in range(cycles):
        light = 400.0 if cycle == cycles - 1 else 200.0
        for place, angle_deg in enumerate(ANGLES_DEG):
            facts = at(angle_deg, exposure_s=0.001, start_utc=f"2026-05-04T10:{cycle:02d}:{place:02d}.000000000Z")
            facts |= {"cycle": cycle} if with_cycle else {}
            frames.append((facts, generator.poisson(light, (24, 32))))
    make_run(path, frames)
    return path


@pytest.fixture
def run(tmp_path):
    return _run(tmp_path / "run")


def _exclude(run, frames, reason="bird"):
    return note(run, reason, exclude=frames, by="ann")


def _include(run, frames):
    return note(run, include=frames, by="ann")


def test_a_line_has_the_keys_of_the_contract_and_its_seal(run):
    note(run, "a cloud passed", at="10:01", by="ann")
    line = json.loads((run / ANNOTATIONS_FILE).read_text())
    assert {"utc", "by", "kind", "frames", "text"} <= line.keys()
    assert (line["utc"], line["by"], line["kind"]) == ("2026-05-04T10:01:00.000000000Z", "ann", "note")
    assert (line["frames"], line["text"]) == ([], "a cloud passed")
    assert line["line_sha256"]


def test_excluded_frames_are_in_no_number_and_frames_do_not_change(run):
    before = {file.name: file.read_bytes() for file in run.rglob("*") if file.is_file()}
    _exclude(run, "8-11")
    found = stokes(run)
    assert found.measurement.grid.cycles == 2
    assert found.measurement.images.stokes[0].mean() == pytest.approx(400.0, rel=0.01)
    assert found.as_json()["left_out"][0] == "frame 8: excluded: bird (ann)"
    assert found.as_json()["annotations"][0]["kind"] == "exclude"
    after = {file.name: file.read_bytes() for file in run.rglob("*") if file.name in before}
    assert after == before


def test_ignore_exclusions_reads_excluded_frames_with_a_warning(run, tmp_path, capsys):
    _exclude(run, "8-11")
    assert cli.main(["stokes", str(run), "--out", str(tmp_path / "a"), "--json"]) == 0
    said = capsys.readouterr()
    assert (json.loads(said.out)["cycles"], "excluded frames are left out: 8-11: bird (ann)" in said.err) == (2, True)
    assert cli.main(["stokes", str(run), "--out", str(tmp_path / "b"), "--json", "--ignore-exclusions"]) == 0
    said = capsys.readouterr()
    assert (json.loads(said.out)["cycles"], "are taken all the same" in said.err) == (3, True)


def test_every_command_that_makes_numbers_of_a_run_has_the_option():
    calibrated = [f"calibrate {kind}" for kind in ("axis", "flat", "noise", "radiometric", "registration")]
    assert all(
        "ignore_exclusions" in cli.hints_of(cli.function_of(verb))
        for verb in (*calibrated, "compare", "detect", "export", "regions find", "status", "stokes")
    )


def test_python_leaves_them_out_too(run):
    _exclude(run, "8-11")
    with pytest.warns(UserWarning, match="excluded frames are left out"):
        opened = rigctl.open_run(run)
    assert len(opened.frames("scene").records) == 8
    with pytest.warns(UserWarning, match="excluded frames are taken all the same"):
        every = rigctl.open_run(run, ignore_exclusions=True)
    assert (len(every.frames("scene").records), every.stokes().measurement.grid.cycles) == (12, 3)


def test_include_takes_them_in_again(run):
    _exclude(run, "4,8-11")
    found = _include(run, "4,8-11")
    assert (found.annotation.kind, found.annotation.frames, found.excluded) == ("include", (4, 8, 9, 10, 11), ())
    assert arrange(run_to_measure(run)).cycles == 3


def test_excluding_a_frame_again_gives_a_remark_and_no_line(run):
    _exclude(run, "8-9")
    assert _exclude(run, "8").annotation is None
    again = _exclude(run, "9-10")
    assert again.annotation.frames == (10,)
    assert again.remarks[0] == "frames 9: excluded already; nothing changes for them"
    assert _include(run, "0").annotation is None
    assert len(read_annotations(run)) == 2


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        ("12", "not all of them are frames of"),
        ("3-400000000", "it has 0-11"),
        ("5-3", "'5-3' is not a frame"),
        ("", "is not a frame"),
        ("1,,2", "is not a frame"),
        ("-1", "is not a frame"),
        ("a", "is not a frame"),
        ("1.5", "is not a frame"),
    ],
)
def test_frames_that_are_not_there_are_refused(run, frames, said):
    with pytest.raises(ConfigError, match=said):
        _exclude(run, frames)
    assert not (run / ANNOTATIONS_FILE).exists()
    assert cli.main(["note", str(run), f"--exclude={frames}", "x"]) == 2


def test_a_reason_is_required(run):
    with pytest.raises(ConfigError, match="the reason: is empty"):
        _exclude(run, "1", reason=None)
    with pytest.raises(ConfigError, match="control characters"):
        _exclude(run, "1", reason="a \x1b[2J")


def test_an_angle_without_frames_gives_a_remark_and_the_rest_is_measured(run):
    found = _exclude(run, "1,5,9")
    assert any("no frame at 45 deg is left" in remark for remark in found.remarks)
    grid = arrange(run_to_measure(run))
    assert (grid.angles, grid.cycles) == (3, 3)
    assert any("does not determine S0, S1 and S2" in remark for remark in _exclude(run, "0,4,8").remarks)


def test_a_run_with_all_frames_excluded_gives_a_remark_and_is_refused(run):
    assert "no scene frame is left" in _exclude(run, "0-11").remarks[0]
    assert cli.main(["stokes", str(run), "--out", str(run.parent / "out")]) == 4


def test_cycles_without_a_number_keep_their_frames_together(tmp_path):
    run = _run(tmp_path / "imported", with_cycle=False)
    _exclude(run, "1")
    grid = arrange(run_to_measure(run))
    assert [[record.sequence for record in cycle] for cycle in grid.records] == [[4, 5, 6, 7], [8, 9, 10, 11]]
    assert grid.left_out[-1] == "cycle 0: incomplete, 3 of 4"


@pytest.mark.parametrize(
    ("at_time", "utc"),
    [
        ("10:01", "2026-05-04T10:01:00Z"),
        ("12:01+02:00", "2026-05-04T10:01:00Z"),
        ("2026-05-04T12:01+02:00", "2026-05-04T10:01:00Z"),
        ("23:59", "2026-05-04T23:59:00Z"),
        ("00:30+14:00", "2026-05-04T10:30:00Z"),
        ("23:30-02:00", "2026-05-05T01:30:00Z"),
    ],
)
def test_a_time_is_that_of_the_run_s_own_day(run, at_time, utc):
    assert note(run, "x", at=at_time, by="ann").annotation.utc[:19] + "Z" == utc


@pytest.mark.parametrize("at_time", ["25:00", "noon", "2026-05-04T10:00", ""])
def test_a_wrong_time_is_refused(run, at_time):
    with pytest.raises(ConfigError, match="--at: "):
        note(run, "x", at=at_time, by="ann")


def test_a_run_without_times_wants_the_day(tmp_path):
    make_run(tmp_path / "r", [(at(0.0), np.zeros((4, 4)))])
    with pytest.raises(ConfigError, match="write it with its day"):
        note(tmp_path / "r", "x", at="10:00", by="ann")
    assert note(tmp_path / "r", "x", by=None, utc_ns=lambda: NOW_NS).annotation.utc.startswith("2026")


def _spoil(run, change):
    file = run / ANNOTATIONS_FILE
    file.write_bytes(change(file.read_bytes()))


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data.replace(b"bird", b"bord"),
        lambda data: data.replace(b"[8]", b"[9]"),
        lambda data: data.partition(b"\n")[2],
        lambda data: data + b"{}\n",
        lambda data: b"\x00" + data[1:],
    ],
)
def test_a_damaged_line_is_reported_by_verify_and_the_run_is_not_measured(run, change):
    _exclude(run, "8")
    _exclude(run, "9")
    assert verification_of(run).state == "whole"
    _spoil(run, change)
    assert any(finding.file == ANNOTATIONS_FILE for finding in verification_of(run).bad)
    assert cli.main(["verify", str(run)]) == 4
    with pytest.raises(RunFolderError, match="the excluded frames are not known"):
        run_to_measure(run)
    assert cli.main(["status", "--contents", str(run), "--ignore-exclusions"]) == 0
    with pytest.raises(RunFolderError, match="annotations"):
        note(run, "more", by="ann")


def test_a_torn_last_line_was_never_acknowledged(run):
    _exclude(run, "8")
    _spoil(run, lambda data: data + b'{"utc": "2026')
    assert (verification_of(run).state, len(run_to_measure(run).excluded)) == ("whole", 1)
    _exclude(run, "9")
    assert [one.frames for one in read_annotations(run)] == [(8,), (9,)]


def test_many_at_once_lose_no_line(run):
    code = (
        "import sys; from pathlib import Path; from rigctl.verbs.note import note\n"
        f"for i in range(5): note(Path({str(run)!r}), f'{{sys.argv[1]}} {{i}}', by='x')"
    )
    together = [subprocess.Popen([sys.executable, "-c", code, str(k)], env=os.environ) for k in range(3)]
    assert [one.wait(60) for one in together] == [0, 0, 0]
    assert len({one.text for one in read_annotations(run)}) == 15


def test_notes_are_shown_in_log_contents_summary_and_on_the_page(run, tmp_path, capsys):
    note(run, "a cloud passed", at="10:01", by="ann")
    _exclude(run, "8-11")
    assert cli.main(["status", "--log", str(run), "--only", "note"]) == 0
    assert capsys.readouterr().out == "2026-05-04T10:01:00Z  note            a cloud passed (ann)\n"
    assert cli.main(["status", "--log", str(run), "--json", "--last", "1"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (len(told["events"]), [one["kind"] for one in told["annotations"]]) == (0, ["exclude"])
    assert cli.main(["status", "--contents", str(run), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["excluded"] == [8, 9, 10, 11]
    assert cli.main(["status", str(run), "--page", str(tmp_path / "s.html")]) == 0
    assert "a cloud passed" in (tmp_path / "s.html").read_text()
    assert {"note", "exclude"} <= {one["event"] for one in RunReader(run).look()["events"]}


def test_a_login_name_of_the_environment_is_made_to_fit_a_line(tmp_path, monkeypatch):
    run = _run(tmp_path / "run")
    monkeypatch.setenv("LOGNAME", "ann\n\x1b[31mbob")
    assert note(run, "seen", by=None).annotation.by == "ann??[31mbob"

    def unknown():
        raise KeyError("uid not found")

    monkeypatch.setattr("getpass.getuser", unknown)
    assert note(run, "seen", by=None).annotation.by == "unknown"
