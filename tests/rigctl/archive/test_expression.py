import sqlite3

import pytest

from rigctl.archive.index import COLUMNS, parse
from rigctl.errors import ConfigError


@pytest.mark.parametrize(
    ("expression", "sql", "values"),
    [
        ("dolp > 0.1", '"dolp" > ?', (0.1,)),
        ("region='a b'", '"region" = ?', ("a b",)),
        ('run != "x\'y"', '"run" != ?', ("x'y",)),
        ("verdict = 'disagree'", '"verdict" = ?', ("disagrees",)),
        ("dolp<=-1e-3 and frames>=2", '("dolp" <= ?) AND ("frames" >= ?)', (-1e-3, 2.0)),
        ("not (dolp < 1 OR dolp > 2)", 'NOT (("dolp" < ?) OR ("dolp" > ?))', (1.0, 2.0)),
    ],
)
def test_expressions_become_bound_conditions(expression, sql, values):
    found = parse(expression)
    assert (found.sql, found.values) == (sql, values)


def test_and_binds_closer_than_or():
    table = sqlite3.connect(":memory:")
    names = ", ".join(f'"{column.name}"' for column in COLUMNS)
    table.execute(f"CREATE TABLE found ({names})")
    for frames, dolp, bits in [(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)]:
        table.execute("INSERT INTO found (frames, dolp, bit_depth) VALUES (?, ?, ?)", (frames, dolp, bits))
    found = parse("frames = 1 or dolp = 1 and not bit_depth = 1")
    rows = table.execute(f"SELECT frames, dolp, bit_depth FROM found WHERE {found.sql}", found.values).fetchall()
    table.close()
    assert sorted(rows) == sorted(
        (a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1) if a == 1 or (b == 1 and c != 1)
    )


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        ("", "a column is wanted"),
        ("dolq > 1", "no column 'dolq'; did you mean dolp"),
        ("dolp > ", "a number, or a text in quotes"),
        ("dolp > 'x'", "dolp is compared with a number"),
        ("region = 3", "region is compared with a text"),
        ("dolp > 1 dolp < 2", "and, or, or the end"),
        ("(dolp > 1", "closing bracket"),
        ("dolp ~ 1", "character 6: cannot be read"),
        ("dolp > 1e999", "too large"),
        ("region = 'x", "cannot be read here"),
        ("dolp > 1; drop table runs", "cannot be read here"),
        ("(" * 200 + "dolp > 1" + ")" * 200, "within each other"),
        ("not " * 200 + "dolp > 1", "within each other"),
    ],
)
def test_what_cannot_be_read_is_told_with_its_place(expression, words):
    with pytest.raises(ConfigError, match="EXPR") as problem:
        parse(expression)
    assert words in str(problem.value)
