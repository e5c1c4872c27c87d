import hashlib
import json
import os
import shutil
import sqlite3

import numpy as np
import pytest

from rigctl.archive.index import INDEX_FILE, find, update_index
from rigctl.errors import ConfigError, DataError
from rigctl.verbs.note import note
from tests.rigctl.made_runs import at, make_run

COUNTS = np.full((4, 6), 100)


def runs_of(root, expression):
    return [row["run"] for row in find(root, expression)]


@pytest.fixture
def archive(tmp_path):
    for name in ("a", "b", "deep/c"):
        make_run(tmp_path / name, [(at(angle), COUNTS) for angle in (0, 45, 90, 135)])
    return tmp_path


def compare(root, run, name, *, verdict="agrees", dolp=0.3):
    """Write a comparison as `rigctl compare` has it, as far as the index reads it."""
    manifest = hashlib.sha256((root / run / "manifest.jsonl").read_bytes()).hexdigest()
    row = {"region": "panel", "statistic": "mean", "predicted": 0.31, "std_error": 0.01, "z": -1.0}
    content = {
        "verdict": verdict,
        "flags": ["drift"],
        "checks": [{"verdict": "sound"}, {"verdict": "flagged"}],
        "regions": {"panel": {"verdict": verdict}},
        "rows": [row | {"quantity": "dolp", "measured": dolp}, row | {"quantity": "aolp_deg", "measured": 12.0}],
        "provenance": {"files": {"manifest": {"sha256": manifest}, "scene": {"sha256": "5" * 64}}},
    }
    (root / name).mkdir()
    (root / name / "comparison.json").write_text(json.dumps(content))


def test_runs_at_any_depth_are_indexed_and_only_changes_are_read_again(archive):
    first = update_index(archive)
    assert (first.runs, first.new, first.changed, first.gone, first.damaged) == (3, 3, 0, 0, 0)
    assert runs_of(archive, "scenes = 4") == ["a", "b", "deep/c"]
    again = update_index(archive)
    assert (again.new, again.changed) == (0, 0)
    shutil.rmtree(archive / "b")
    note(archive / "a", "a cloud", by="me")
    make_run(archive / "d", [(at(0), COUNTS)])
    later = update_index(archive)
    assert (later.runs, later.new, later.changed, later.gone) == (3, 1, 1, 1)
    assert runs_of(archive, "notes = 1") == ["a"]


def test_a_damaged_run_is_a_row(archive):
    manifest = archive / "b" / "manifest.jsonl"
    manifest.write_bytes(manifest.read_bytes().replace(b'"kind"', b'"kinb"', 1))
    (archive / "a" / "session.json").unlink()
    (archive / "deep" / "c" / "frames" / "000000.fits").unlink(missing_ok=True)
    assert update_index(archive).damaged >= 2
    rows = find(archive, "state = 'damaged'")
    assert {"a", "b"} <= {row["run"] for row in rows}
    assert all(row["problem"] for row in rows)


def test_the_newest_comparison_of_a_run_counts(archive):
    compare(archive, "a", "old", verdict="disagrees", dolp=0.2)
    compare(archive, "a", "new", verdict="agrees", dolp=0.3)
    compare(archive, "b", "other", verdict="disagrees", dolp=0.1)
    os.utime(archive / "old" / "comparison.json", ns=(1, 1))
    update_index(archive)
    assert runs_of(archive, "verdict = 'disagree'") == ["b"]
    (row,) = find(archive, "region = 'panel' and dolp > 0.25")
    assert (row["run"], row["dolp"], row["dolp_sigma"], row["aolp_deg"]) == ("a", 0.3, 0.01, 12.0)
    assert (row["flags"], row["unsound"], row["report"]) == (1, 1, "new")
    # A run that nobody compared has no verdict: neither this nor its contrary holds.
    assert runs_of(archive, "not verdict = 'agrees'") == ["b"]


def test_others_files_among_the_runs_do_no_harm(archive):
    (archive / "x").mkdir()
    (archive / "x" / "comparison.json").write_text("{not json")
    assert update_index(archive).comparisons == 1
    assert runs_of(archive, "frames > 0") == ["a", "b", "deep/c"]


def test_no_index_no_folder_and_a_spoilt_index_are_told(archive):
    with pytest.raises(ConfigError, match="rigctl archive index"):
        find(archive, "frames > 0")
    with pytest.raises(ConfigError, match="there is no such folder"):
        update_index(archive / "nowhere")
    update_index(archive)
    (archive / INDEX_FILE).write_bytes(b"no database at all, but long enough to be read as the head of one" * 20)
    with pytest.raises(DataError, match="remove it and build it again"):
        update_index(archive)


def test_a_database_of_another_program_is_left_alone(archive):
    other = sqlite3.connect(archive / INDEX_FILE)
    other.execute("CREATE TABLE theirs (x)")
    other.commit()
    other.close()
    with pytest.raises(DataError, match="another program"):
        update_index(archive)


def test_an_index_of_an_older_layout_is_made_anew(archive):
    update_index(archive)
    older = sqlite3.connect(archive / INDEX_FILE)
    older.execute("PRAGMA user_version = 0")
    older.commit()
    older.close()
    assert update_index(archive).new == 3


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        ("", "cannot be read"),
        ("dolq > 1", "no column 'dolq'; did you mean dolp"),
        ("dolp > ", "write for instance sun_zenith < 40"),
        ("dolp > 'x'", "dolp is compared with a number"),
        ("region = 3", "region is compared with a text"),
        ("dolp > 1 dolp < 2", 'near "dolp": syntax error'),
        ("(dolp > 1", "cannot be read"),
        ("dolp ~ 1", "syntax error"),
        ("region = 'x", "unrecognized token"),
        ("dolp > 1; drop table runs", "cannot be read"),
        ("1) ; drop table runs --", "cannot be read"),
        ("name = '\0'", "cannot be read"),
        (" or ".join(["frames > 1"] * 5000), "too large"),
        ("(" * 2000 + "dolp > 1" + ")" * 2000, "cannot be read"),
        ("randomblob(1e9) > 1", "not authorized to use function: randomblob"),
        ("load_extension('x')", "not authorized"),
        ("frames in (select rootpage from sqlite_master)", "cannot be read"),
    ],
)
def test_a_condition_that_is_wrong_or_does_more_than_read_is_refused_in_words(expression, words, tmp_path):
    with pytest.raises(ConfigError, match="EXPR") as problem:
        find(tmp_path, expression)
    assert words in str(problem.value)


@pytest.mark.parametrize(
    ("expression", "runs"),
    [
        ("frames=2 or exposure_ms > 15 and not bit_depth = 12", ["it's", "short"]),
        ("(frames=2 or exposure_ms > 15) and not bit_depth = 12", []),
        ('run = "short"', ["short"]),
        ("run = 'it''s'", ["it's"]),
        ("frames in (3, 4) and run like 'l%'", ["long"]),
        ("exposure_ms<=1.5e1", ["it's", "short"]),
        ("verdict is null and verdict = 'disagree'", []),
    ],
)
def test_conditions_are_those_of_sql(expression, runs, tmp_path):
    for name, frames, exposure_s in (("short", 2, 0.01), ("it's", 2, 0.015), ("long", 4, 0.02)):
        make_run(tmp_path / name, [(at(45.0 * k, exposure_s=exposure_s), [[100] * 4] * 4) for k in range(frames)])
    update_index(tmp_path)
    assert [row["run"] for row in find(tmp_path, expression)] == runs
