"""What a page reads of a run, against the run itself."""

import json
import os
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from rigctl.calibrations.noise import QUANTITIES
from rigctl.errors import DataError
from rigctl.runs.folder import read_run
from rigctl.runs.writer import RunWriter
from rigctl.session.take import take_session
from rigctl.verbs.note import note
from rigctl.web.pictures import last_cycle, picture_of
from rigctl.web.run_reader import RunReader, RunsOfFolder, source_at
from tests.rigctl.example_files import small_rig, small_session
from tests.rigctl.made_runs import at, make_run

RNG = np.random.default_rng(4)


def frames(*, angles: tuple[float, ...] = (0.0, 45.0, 90.0, 135.0), cycles: int = 2) -> list:
    """Return frames of light of S = (1000, 300, 400)."""
    found = []
    for cycle in range(cycles):
        for angle in angles:
            twice = 2.0 * np.deg2rad(angle)
            mean = 0.5 * (1000.0 + 300.0 * np.cos(twice) + 400.0 * np.sin(twice))
            found.append((at(angle, cycle=cycle, exposure_s=0.01), RNG.normal(mean, 3.0, (32, 40)).round()))
    return found


def test_a_run_that_does_not_exist_yet_is_waited_for(tmp_path: Path) -> None:
    reader = RunReader(tmp_path / "run")
    assert reader.look()["state"] == "waiting"
    assert reader.picture("0") is None
    make_run(tmp_path / "run", frames())
    assert reader.look()["state"] == "finished"
    assert reader.look()["frames"] == 8
    assert reader.picture("0") is not None


def test_each_state_of_a_session_is_shown(tmp_path: Path) -> None:
    path, reader = tmp_path / "run", RunReader(tmp_path / "run")
    with RunWriter.create(path, {"origin": "import"}) as writer:
        assert reader.look()["state"] == "live"
        writer.event("hold", reason="Cover the lens")
        assert (reader.look()["state"], reader.look()["advice"][:14]) == ("holding", "Cover the lens")
        writer.event("continue")
        assert reader.look()["state"] == "live"
        for file in path.iterdir():
            os.utime(file, (1e9, 1e9))
        assert reader.look()["state"] == "stale"
        assert reader.look()["since_utc"].startswith("2001-09-09")
    look = reader.look()
    assert look["state"] == "interrupted"
    assert f"rigctl resume {path}" in look["advice"]


def test_frames_that_come_are_read_once_and_shown(tmp_path: Path) -> None:
    make_run(tmp_path / "run", frames(cycles=1))
    manifest = tmp_path / "run" / "manifest.jsonl"
    lines = manifest.read_bytes().splitlines(keepends=True)
    manifest.write_bytes(b"".join(lines[:2]) + lines[2][:40])
    reader = RunReader(tmp_path / "run")
    assert [one["name"] for one in reader.look()["newest"]] == ["0", "45"]
    manifest.write_bytes(b"".join(lines))
    look = reader.look()
    assert [one["name"] for one in look["newest"]] == ["0", "45", "90", "135"]
    assert look["problems"] == []


def test_a_damaged_line_is_named_and_the_rest_is_shown(tmp_path: Path) -> None:
    make_run(tmp_path / "run", frames(cycles=1))
    manifest = tmp_path / "run" / "manifest.jsonl"
    manifest.write_bytes(manifest.read_bytes().replace(b'"cycle": 0', b'"cycle": 7', 1))
    look = RunReader(tmp_path / "run").look()
    assert look["frames"] == 3
    assert any("manifest" in problem for problem in look["problems"])


def test_maps_are_of_the_last_whole_cycle(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", frames(cycles=2)[:-1])
    assert {frame.cycle for frame in last_cycle(run.frames)} == {0}
    reader = RunReader(tmp_path / "run")
    picture = reader.picture("dolp")
    assert picture is not None
    shown = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
    # DoLP is 0.5 all over: the colour half-way up viridis, to what JPEG leaves.
    middle = cv2.applyColorMap(np.full((1, 1), 127, np.uint8), cv2.COLORMAP_VIRIDIS)[0, 0]
    assert np.abs(shown.reshape(-1, 3).mean(axis=0) - middle).max() < 6
    assert reader.picture("dolp", dolp_top=0.5).jpeg != picture.jpeg


def test_a_single_saturated_pixel_is_striped_in_a_picture_made_smaller() -> None:
    counts = np.full((400, 4000), 100, np.uint16)
    counts[205, 2005] = 4095
    picture = picture_of(counts, saturation_dn=4095, most_width=400, zebra=True)
    shown = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR).astype(int)
    assert shown.shape == (40, 400, 3)
    assert (shown[..., 2] - shown[..., 0]).max() > 40
    assert picture.clipped == 1 / counts.size
    assert sum(picture.histogram) == counts.size


@pytest.mark.parametrize("name", ["../session", "s0/../..", "", "nan", "45; rm", "thumb\x00"])
def test_a_name_that_is_not_known_gives_nothing(tmp_path: Path, name: str) -> None:
    make_run(tmp_path / "run", frames())
    assert RunReader(tmp_path / "run").picture(name) is None
    assert RunsOfFolder(tmp_path).reader(name) is None
    assert RunsOfFolder(tmp_path).document("run", name) is None


def test_a_session_has_curves_of_its_cycles(tmp_path: Path) -> None:
    take_session(small_rig(tmp_path), small_session(cycles=2), tmp_path / "run", files={})
    reader = RunReader(tmp_path / "run")
    curves = _curves(reader)
    assert [region["name"] for region in curves["regions"]] == ["picture"]
    assert len(curves["time_s"]) == 2
    assert all(0.0 < value < 1.0 for value in curves["regions"][0]["dolp"])
    assert reader.look()["is_simulated"]


def _curves(reader: RunReader) -> dict:
    # Frames are read in a thread of its own, which a busy machine lets wait.
    deadline_s = time.monotonic() + 60.0
    while (curves := reader.curves())["frames_read"] < curves["frames_there"]:
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    return curves


def test_excluded_frames_leave_curves_and_maps_of_an_open_page(tmp_path: Path) -> None:
    run = tmp_path / "run"
    take_session(small_rig(tmp_path), small_session(cycles=3), run, files={})
    reader = RunReader(run)
    before, maps_before = _curves(reader), reader.look()["maps_of"]
    last = read_run(run).frames[-1]
    note(run, "a bird", exclude=str(last.sequence), by="ann")
    after = _curves(reader)
    assert (len(before["time_s"]), len(after["time_s"]), after["frames_there"]) == (3, 2, before["frames_there"] - 1)
    assert after["time_s"] == before["time_s"][:2]
    assert (before["left_out"], after["left_out"]) == ("", f"{last.sequence}: a bird (ann)")
    assert (maps_before[:7], reader.look()["maps_of"][:7]) == ("scene, ", "scene, ")
    assert (f"cycle {last.cycle + 1}" in maps_before, f"cycle {last.cycle}" in reader.look()["maps_of"]) == (True, True)
    assert reader.look()["frames"] == len(read_run(run).frames)  # they are there all the same
    note(run, include=str(last.sequence), by="ann")
    assert _curves(reader) == before


def test_curves_are_refused_if_exclusions_cannot_be_read(tmp_path: Path) -> None:
    run = tmp_path / "run"
    take_session(small_rig(tmp_path), small_session(cycles=2), run, files={})
    note(run, "a bird", exclude="1", by="ann")
    file = run / "annotations.jsonl"
    file.write_bytes(file.read_bytes().replace(b"bird", b"bard"))
    reader = RunReader(run)
    with pytest.raises(DataError, match="the excluded frames are not known"):
        reader.curves()
    assert any("the excluded frames are not known" in text for text in reader.look()["problems"])
    assert (reader.look()["maps_of"], reader.picture("0") is not None) == ("", True)


def test_a_folder_lists_its_runs_with_verdicts_and_pages(tmp_path: Path) -> None:
    make_run(tmp_path / "run", frames())
    make_run(tmp_path / "other", frames(cycles=1))
    (tmp_path / "compared").mkdir()
    content = {"verdict": "agrees_with_reservations", "provenance": {"run": {"path": "runs/run"}}}
    (tmp_path / "compared" / "comparison.json").write_text(json.dumps(content))
    (tmp_path / "compared" / "report.html").write_text("<p>report</p>")
    (tmp_path / "run-summary.html").write_text("<p>summary</p>")
    source = source_at(tmp_path)
    rows = {row["run"]: row for row in source.rows()}
    assert rows["run"]["verdict"] == "agrees with reservations"
    assert rows["run"]["pages"] == ["summary", "compared"]
    assert (rows["other"]["verdict"], rows["other"]["pages"], rows["other"]["frames"]) == ("", [], 4)
    assert source.document("run", "compared") == b"<p>report</p>"
    assert source.document("run", "summary") == b"<p>summary</p>"


def test_calibrations_beside_a_run_say_whether_they_hold_for_it(tmp_path: Path) -> None:
    facts = {"camera_serial": "42", "start_utc": "2026-05-04T10:00:00Z"}
    make_run(tmp_path / "runs" / "run", [(one | facts, counts) for one, counts in frames()])
    known = {"value": 1.0, "std_error": 0.1, "n": 9}
    noise = (
        {"schema_version": 2, "kind": "noise"}
        | dict.fromkeys(QUANTITIES)
        | {"gain_dn_per_e": known, "black_level_dn": known}
    )
    made_for = {
        "ours": {"camera_serial": "42", "taken_utc": "2026-05-01T10:00:00Z", "valid_days": 30},
        "old": {"camera_serial": "42", "taken_utc": "2020-05-01T10:00:00Z"},
        "theirs": {"camera_serial": "<b>7", "taken_utc": "2026-05-01T10:00:00Z"},
    }
    for name, made in made_for.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(noise | {"made_for": made}))
    (tmp_path / "runs" / "axis.json").write_text('{"kind": "polarizer", "half": ')
    (tmp_path / "runs" / "else.json").write_text('{"kind": "chair"}')
    (tmp_path / "runs" / "lock.json").symlink_to("nowhere")
    (tmp_path / "runs" / "folder.json").mkdir()
    os.mkfifo(tmp_path / "runs" / "pipe.json")
    with (tmp_path / "runs" / "large.json").open("wb") as file:
        file.truncate(6_000_000_000)
    found = {one["file"]: one for one in RunReader(tmp_path / "runs" / "run").calibrations()}
    assert {name: (one["kind"], one["verdict"]) for name, one in found.items()} == {
        "ours.json": ("noise", "valid"),
        "old.json": ("noise", "doubtful"),
        "theirs.json": ("noise", "not valid"),
        "axis.json": ("polarizer", "not valid"),
    }
    assert (found["ours.json"]["made_utc"], found["ours.json"]["valid_days"]) == ("2026-05-01T10:00:00Z", 30.0)
    assert found["old.json"]["valid_days"] == 365.0
    assert "valid for 365" in found["old.json"]["words"]
    assert "camera serial number" in found["theirs.json"]["words"]
