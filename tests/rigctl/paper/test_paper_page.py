"""`rigctl paper` and the statements that it judges."""

import json

from rigctl.cli import main
from rigctl.paper.statements import statements

# How many statements the issue of each figure's text has at least.
LEAST = {"5": 1, "7": 1, "8": 2, "9": 5, "10": 2, "11": 1, "12": 2, "13": 3, "14": 2, "15": 1}


def test_every_figure_has_its_sentences():
    by_figure = [one.figure.rstrip("ab") for one in statements()]
    for figure, least in LEAST.items():
        assert by_figure.count(figure) >= least


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
