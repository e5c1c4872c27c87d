"""docs/paper-statements.md against the program: no sentence can be left out, and its verdicts are those computed."""

import json

import pytest

from rigctl.cli import main
from rigctl.paper.statements import statements
from rigctl.verbs.paper import PaperResult, paper
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.paper.statements_page import verdict_cell

PAGE = EXAMPLES.parent / "docs" / "paper-statements.md"
# How many statements the issue of each figure's text has at least.
LEAST = {"5": 1, "7": 1, "8": 2, "9": 5, "10": 2, "11": 1, "12": 2, "13": 3, "14": 2, "15": 1}


def page_rows():
    rows = [line.strip("|\n").split(" | ") for line in PAGE.read_text().splitlines() if line.startswith("|")]
    return {row[1].strip(): [cell.strip() for cell in row] for row in rows if len(row) == 7}


def test_the_page_has_every_sentence_of_the_program_and_no_other():
    rows = page_rows()
    assert set(rows) - {"id", "---"} == {one.id for one in statements()}
    for one in statements():
        assert rows[one.id][:5] == [one.figure, one.id, one.sentence, one.geometry, one.check]


def test_every_figure_has_its_sentences():
    by_figure = [one.figure.rstrip("ab") for one in statements()]
    for figure, least in LEAST.items():
        assert by_figure.count(figure) >= least


@pytest.mark.parametrize("materials", ["library", "rough"])
def test_verdicts_and_numbers_of_the_page_are_those_computed(materials):
    # The figures with the most sentences; benchmarks/trial_paper.py does the whole page.
    column = 5 + ["library", "rough"].index(materials)
    computed = paper(figures=(9, 10), materials=(materials,))
    assert isinstance(computed, PaperResult)
    rows, found = (
        page_rows(),
        [one for one in computed.found.results if one.statement.figure.rstrip("ab") in ("9", "10")],
    )
    assert len(found) >= LEAST["9"] + LEAST["10"]
    for one in found:
        assert rows[one.statement.id][column] == verdict_cell(one)


def test_a_figure_that_is_not_computed_is_refused(capsys):
    assert main(["paper", "--figure", "3"]) == 2
    assert "--figure: 3" in capsys.readouterr().err


def test_points_of_the_paper_are_drawn_over_and_bad_ones_refused(tmp_path, capsys):
    points = tmp_path / "points.csv"
    points.write_text("figure,panel,label,x,y\n5,a,theirs,10,0.9\n")
    assert main(["paper", "--figure", "5", "--materials", "library", "--digitised", str(points),
                 "--out", str(tmp_path / "out"), "--json"]) == 0  # fmt: skip
    rows = json.loads(capsys.readouterr().out)
    keys = ["id", "figure", "sentence", "geometry", "check", "numbers", "margin", "numerical_error", "verdict"]
    assert list(rows[0])[: len(keys)] == keys
    assert rows == json.loads((tmp_path / "out" / "statements.json").read_text())
    assert {row["verdict"] for row in rows if row["figure"] == "5"} == {"holds"}
    assert (tmp_path / "out" / "fig5-model.png").read_bytes().startswith(b"\x89PNG")
    points.write_text("figure,panel,label,x,y\n5,a,theirs,ten,0.9\n")
    assert main(["paper", "--figure", "5", "--digitised", str(points)]) == 2
    assert "line 2" in capsys.readouterr().err
