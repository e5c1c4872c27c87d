"""A run folder as it is read."""

import errno
import json
import os
import random
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.base.durable import write_durably
from rigctl.errors import DataError, RunFolderError
from rigctl.runs.check import verify_run
from rigctl.runs.fits import decode_record
from rigctl.runs.folder import file_checksum, parse_record, read_run
from rigctl.runs.records import SCHEMA_VERSION, SessionRecord
from rigctl.runs.writer import RunWriter
from tests.rigctl.run_samples import FULL_RECORD, make_record, noisy_counts, write_run

ROOT = Path(__file__).parents[3]


def fill_disk_at(monkeypatch, call):
    """Let the n-th flush to the disk fail as it does when the disk is full."""
    calls = iter(range(call))
    flush = os.fsync

    def failing(descriptor):
        if next(calls, None) is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        flush(descriptor)

    monkeypatch.setattr(os, "fsync", failing)


def files_in(path):
    return sorted(file.name for file in (path / "frames").iterdir())


def test_the_writer_adds_size_checksum_and_saturation(tmp_path):
    counts = np.array([[0, 4095, 4094], [4095, 1, 2]], dtype=np.uint16)
    with RunWriter.create(tmp_path / "run", {}) as writer:
        record = writer.write_frame(make_record(3, polarizer_angle_target_deg=-60.0), counts)
    assert record.file == "frames/000003_scene_a120.fits"
    assert (record.height, record.width) == (2, 3)
    assert record.saturated_fraction == 2 / 6


def test_manifest_can_be_made_again_from_the_frames(tmp_path):
    path = write_run(tmp_path / "run")
    made_again = []
    for file in sorted((path / "frames").iterdir()):
        data = file.read_bytes()
        name = file.relative_to(path).as_posix()
        made_again.append(decode_record(data, file=name, checksum=file_checksum(data))[0])
    assert tuple(made_again) == read_run(path).frames


def test_frame_is_on_the_disk_before_the_manifest_names_it(tmp_path, monkeypatch):
    steps = []
    flush, rename = os.fsync, os.replace
    with RunWriter.create(tmp_path / "run", {}) as writer:
        monkeypatch.setattr(
            os, "fsync", lambda fd: (steps.append(Path(f"/proc/self/fd/{fd}").readlink().name), flush(fd))
        )
        monkeypatch.setattr(os, "replace", lambda old, new: (steps.append("rename"), rename(old, new)))
        writer.write_frame(make_record(kind="dark"), noisy_counts())
    assert steps == ["000000_dark.fits.part", "rename", "frames", "manifest.jsonl"]


def test_a_folder_that_holds_something_and_a_place_in_a_file_are_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(RunFolderError, match="not empty"):
        RunWriter.create(tmp_path, {})
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]
    with pytest.raises(RunFolderError, match="cannot make a run folder here"):
        RunWriter.create(tmp_path / "notes.txt" / "run", {})


@pytest.mark.parametrize("call", [0, 2], ids=["frame", "manifest"])
def test_full_disk_leaves_no_trace_of_the_frame(tmp_path, monkeypatch, call):
    path = write_run(tmp_path / "run")
    before = (files_in(path), (path / "manifest.jsonl").read_bytes())
    with RunWriter.append(path) as writer:
        fill_disk_at(monkeypatch, call)
        with pytest.raises(RunFolderError, match="No space left"):
            writer.write_frame(make_record(3), noisy_counts())
    assert (files_in(path), (path / "manifest.jsonl").read_bytes()) == before


def test_writer_can_go_on_once_there_is_room_again(tmp_path):
    with RunWriter.create(tmp_path / "run", {}) as writer:
        with pytest.MonkeyPatch.context() as patch:
            fill_disk_at(patch, 2)
            with pytest.raises(RunFolderError):
                writer.write_frame(make_record(), noisy_counts())
        writer.write_frame(make_record(), noisy_counts())
    assert verify_run(tmp_path / "run").ok


def test_several_frames_are_written_all_or_none(tmp_path):
    path = write_run(tmp_path / "run", frames=1)
    frames = [(make_record(i), noisy_counts()) for i in (1, 2, 2)]
    with RunWriter.append(path) as writer, pytest.raises(ValueError, match="sequence 2 is in this run already"):
        writer.write_frames(frames)
    assert files_in(path) == ["000000_scene_a000.fits"]
    assert len(read_run(path).frames) == 1


@pytest.mark.parametrize("counts", [np.zeros((2, 2)), np.zeros(4, np.uint16), np.zeros((0, 3), np.uint16)])
def test_arrays_that_are_not_frames_are_refused(tmp_path, counts):
    with RunWriter.create(tmp_path / "run", {}) as writer, pytest.raises(ValueError, match="array of uint16"):
        writer.write_frame(make_record(), counts)


def test_a_time_that_is_not_marked_as_utc_is_refused_and_numbers_of_numpy_are_numbers(tmp_path):
    path = tmp_path / "run"
    with RunWriter.create(path, {}) as writer:
        writer.write_frame(make_record(exposure_s=np.float64(0.1), saturation_dn=np.float64(4095)), noisy_counts())
        with pytest.raises(ValueError, match="must be UTC"):
            writer.write_frame(make_record(1, start_utc="2026-05-04T10:00:00+02:00"), noisy_counts())
    assert verify_run(path).ok


def test_torn_line_is_cut_off_before_more_is_added(tmp_path):
    path = write_run(tmp_path / "run", frames=1)
    with (path / "manifest.jsonl").open("ab") as manifest:
        manifest.write(b'{"kind": "sce')
    with RunWriter.append(path) as writer:
        writer.write_frame(make_record(1), noisy_counts())
    assert len(read_run(path).frames) == 2


def test_frame_that_was_not_acknowledged_is_not_overwritten(tmp_path):
    path = write_run(tmp_path / "run", frames=2)
    manifest = path / "manifest.jsonl"
    manifest.write_bytes(manifest.read_bytes().splitlines(keepends=True)[0])
    with RunWriter.append(path) as writer:
        assert writer.next_sequence == 2


def test_events_tell_both_clocks_and_are_numbered(tmp_path):
    path = tmp_path / "run"
    with RunWriter.create(path, {}, utc_ns=lambda: 1_777_888_999_000_000_001, monotonic_ns=lambda: 42) as writer:
        writer.event("stage", what="button", angle_deg=45.0)
        writer.event("end")
    first, second = map(json.loads, (path / "events.jsonl").read_text().splitlines())
    assert first == {
        "id": 0,
        "utc": "2026-05-04T10:03:19.000000001Z",
        "monotonic_ns": 42,
        "event": "stage",
        "facts": {"what": "button", "angle_deg": 45.0},
        "line_sha256": first["line_sha256"],
        "chain_sha256": first["chain_sha256"],
    }
    assert second["id"] == 1


def test_failed_replacement_leaves_the_file_as_it_was(tmp_path, monkeypatch):
    file = tmp_path / "noise.json"
    file.write_bytes(b"old")
    fill_disk_at(monkeypatch, 0)
    with pytest.raises(OSError, match=r"No space left.*noise\.json"):
        write_durably(file, b"new")
    assert [(f.name, f.read_bytes()) for f in tmp_path.iterdir()] == [("noise.json", b"old")]


WRITER = """
import sys
from pathlib import Path
from rigctl.runs.writer import RunWriter
from tests.rigctl.run_samples import make_record, noisy_counts
with RunWriter.create(Path(sys.argv[1]), {}) as writer:
    for i in range(100000):
        writer.write_frame(make_record(i), noisy_counts(i, (582, 782)))
        print(i, flush=True)
"""


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_killed_writer_leaves_only_whole_frames(tmp_path, seed):
    path = tmp_path / "run"
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, cwd=ROOT, text=True
    ) as process:
        process.stdout.readline()
        # A frame takes about 10 ms: the kill falls anywhere in the writing of the first twenty.
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(timeout=random.Random(seed).uniform(0.0, 0.2))
        process.kill()
        acknowledged = 1 + len(process.stdout.readlines())
    verification = verify_run(path)
    assert verification.bad == ()
    # The frame that was being acknowledged when the kill came may be in the manifest as well.
    assert acknowledged <= verification.frames <= acknowledged + 1
    for record in read_run(path).frames:
        np.testing.assert_array_equal(read_run(path).counts(record), noisy_counts(record.sequence, (582, 782)))


@pytest.fixture
def run_path(tmp_path):
    return write_run(tmp_path / "run")


def test_a_run_is_read_as_it_was_written(run_path):
    run = read_run(run_path)
    assert run.session == SessionRecord(origin="simulated")
    assert run.session_json == {"origin": "simulated"}
    assert run.created_by.startswith("rigctl ")
    assert [record.sequence for record in run.frames] == [0, 1, 2]
    np.testing.assert_array_equal(run.counts(run.frames[1]), noisy_counts(1))
    assert run.counts(run.frames[0]).flags.writeable


def test_a_damaged_frame_and_one_in_place_of_another_are_not_handed_out(run_path):
    run = read_run(run_path)
    first, second = (run_path / record.file for record in run.frames[:2])
    data = bytearray(first.read_bytes())
    data[-2880] ^= 1
    first.write_bytes(data)
    with pytest.raises(RunFolderError, match=r"000000_scene_a000\.fits: damaged or replaced"):
        run.counts(run.frames[0])
    first.write_bytes(second.read_bytes())
    with pytest.raises(RunFolderError, match="damaged or replaced"):
        run.counts(run.frames[0])


def test_a_last_line_without_an_end_is_passed_over(run_path):
    with (run_path / "manifest.jsonl").open("ab") as manifest:
        manifest.write(b'{"kind": "scene", "seq')
    assert len(read_run(run_path).frames) == 3


def test_frames_come_in_the_order_of_their_sequence(tmp_path):
    with RunWriter.create(tmp_path / "run", {"origin": "simulated"}) as writer:
        for sequence in (2, 0, 1):
            writer.write_frame(make_record(sequence), noisy_counts(sequence))
    assert [record.sequence for record in read_run(tmp_path / "run").frames] == [0, 1, 2]


def test_every_problem_is_named_at_once(run_path):
    file = run_path / "session.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"schema_version": SCHEMA_VERSION + 1}))
    lines = (run_path / "manifest.jsonl").read_bytes().splitlines(keepends=True)
    (run_path / "manifest.jsonl").write_bytes(b"".join([*lines, b"no json\n", lines[0]]))
    (run_path / "frames" / "000001_scene_a045.fits").unlink()
    with pytest.raises(RunFolderError) as caught:
        read_run(run_path)
    for text in (
        "schema_version is 3",
        "manifest.jsonl: line 4",
        "000001_scene_a045.fits: missing",
        "sequence 0 occurs 2 times",
    ):
        assert text in str(caught.value)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"kind": "sky"}, "kind"),
        ({"bit_depth": "12"}, "bit_depth"),
        ({"surprise": 1}, "surprise"),
        ({"saturation_dn": None}, "saturation_dn"),
        ({"file": "../secret.fits"}, "does not lie in frames/"),
        ({"file": "frames/../../secret.fits"}, "does not lie in frames/"),
    ],
)
def test_a_record_that_is_wrong_is_refused(change, text):
    content = asdict(replace(FULL_RECORD, file="frames/000007_scene.fits")) | change
    content = {key: value for key, value in content.items() if (key, value) != ("saturation_dn", None)}
    with pytest.raises(DataError, match=text):
        parse_record(json.dumps(content).encode())


def test_other_folders_are_refused(tmp_path):
    with pytest.raises(RunFolderError, match="there is no such folder"):
        read_run(tmp_path / "none")
    with pytest.raises(RunFolderError, match="not a run folder"):
        read_run(tmp_path)
