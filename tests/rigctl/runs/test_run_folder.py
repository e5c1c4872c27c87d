import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from rigctl.errors import DataError, RunFolderError
from rigctl.runs.folder import parse_record, read_run
from rigctl.runs.records import SCHEMA_VERSION, SessionRecord
from rigctl.runs.writer import RunWriter
from tests.rigctl.run_samples import FULL_RECORD, make_record, noisy_counts, write_run


@pytest.fixture
def run_path(tmp_path):
    return write_run(tmp_path / "run")


def edit_session(run_path, **changes):
    file = run_path / "session.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))


def test_run_says_what_the_writer_was_told(run_path):
    run = read_run(run_path)
    assert run.session == SessionRecord(origin="simulated")
    assert run.session_json == {"origin": "simulated"}
    assert run.created_by.startswith("rigctl ")
    assert [record.sequence for record in run.frames] == [0, 1, 2]


def test_counts_are_those_that_were_written(run_path):
    run = read_run(run_path)
    np.testing.assert_array_equal(run.counts(run.frames[1]), noisy_counts(1))


def test_counts_may_be_changed_by_their_reader(run_path):
    run = read_run(run_path)
    assert run.counts(run.frames[0]).flags.writeable


def test_damaged_frame_is_not_handed_out(run_path):
    run = read_run(run_path)
    file = run_path / run.frames[0].file
    data = bytearray(file.read_bytes())
    data[-2880] ^= 1
    file.write_bytes(data)
    with pytest.raises(RunFolderError, match=r"000000_scene_a000\.fits: damaged or replaced"):
        run.counts(run.frames[0])


def test_frame_in_place_of_another_is_not_handed_out(run_path):
    run = read_run(run_path)
    (run_path / run.frames[0].file).write_bytes((run_path / run.frames[1].file).read_bytes())
    with pytest.raises(RunFolderError, match="damaged or replaced"):
        run.counts(run.frames[0])


def test_last_line_without_an_end_is_passed_over(run_path):
    with (run_path / "manifest.jsonl").open("ab") as manifest:
        manifest.write(b'{"kind": "scene", "seq')
    assert len(read_run(run_path).frames) == 3


def test_frames_come_in_the_order_of_their_sequence(tmp_path):
    with RunWriter.create(tmp_path / "run", {"origin": "simulated"}) as writer:
        for sequence in (2, 0, 1):
            writer.write_frame(make_record(sequence), noisy_counts(sequence))
    assert [record.sequence for record in read_run(tmp_path / "run").frames] == [0, 1, 2]


def test_every_problem_is_named_at_once(run_path):
    edit_session(run_path, schema_version=SCHEMA_VERSION + 1)
    with (run_path / "manifest.jsonl").open("a") as manifest:
        manifest.write("no json\n")
    (run_path / "frames" / "000001_scene_a045.fits").unlink()
    with pytest.raises(RunFolderError) as caught:
        read_run(run_path)
    for text in ("schema_version is 3", "manifest.jsonl: line 4", "000001_scene_a045.fits: missing"):
        assert text in str(caught.value)


def test_frame_named_twice_is_a_problem(run_path):
    manifest = run_path / "manifest.jsonl"
    manifest.write_bytes(manifest.read_bytes() + manifest.read_bytes().splitlines(keepends=True)[0])
    with pytest.raises(RunFolderError, match="sequence 0 stands 2 times"):
        read_run(run_path)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"kind": "sky"}, "kind"),
        ({"bit_depth": "12"}, "bit_depth"),
        ({"surprise": 1}, "surprise"),
        ({"file": "../secret.fits"}, "does not lie in frames/"),
        ({"file": "frames/../../secret.fits"}, "does not lie in frames/"),
    ],
)
def test_record_that_is_wrong_is_refused(change, text):
    content = asdict(replace(FULL_RECORD, file="frames/000007_scene.fits")) | change
    with pytest.raises(DataError, match=text):
        parse_record(json.dumps(content).encode())


def test_record_without_a_key_that_it_needs_is_refused():
    content = asdict(replace(FULL_RECORD, file="frames/000007_scene.fits"))
    del content["saturation_dn"]
    with pytest.raises(DataError, match="saturation_dn"):
        parse_record(json.dumps(content).encode())


def test_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(RunFolderError, match="there is no such folder"):
        read_run(tmp_path / "none")


def test_folder_of_something_else_is_refused(tmp_path):
    with pytest.raises(RunFolderError, match="not a run folder"):
        read_run(tmp_path)
