import pytest

from rigctl.archive.index import find, update_index
from rigctl.errors import ConfigError
from tests.rigctl.made_runs import at, make_run


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
