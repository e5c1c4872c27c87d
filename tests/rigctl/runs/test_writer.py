import errno
import json
import os
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rigctl.base.durable import write_durably
from rigctl.errors import RunFolderError
from rigctl.runs.check import verify_run
from rigctl.runs.fits import decode_record
from rigctl.runs.folder import file_checksum, read_run
from rigctl.runs.writer import RunWriter
from tests.rigctl.run_samples import make_record, noisy_counts, write_run

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
