"""A run folder as it is read."""

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
        "sequence 0 stands 2 times",
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
