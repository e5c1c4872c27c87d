"""`rigctl paper`: verdicts of inequalities, statements with their points, estimators."""

import json

import pytest

from rigctl.cli import main
from rigctl.paper.scenes import Number
from rigctl.paper.statements import Judged, Reading, above, falls, peak_within, some_step_rises, statements

# Least number of statements about each figure.
LEAST = {"5": 1, "7": 1, "8": 2, "9": 5, "10": 2, "11": 1, "12": 2, "13": 3, "14": 2, "15": 1}


def number(value, *, error=0.0, kind="plain"):
    return Number(label=f"{value}", value=value, error=error, kind=kind)


@pytest.mark.parametrize(
    ("more", "less", "verdict"),
    [
        (number(2.0, error=0.1), number(1.0, error=0.1), "holds"),
        (number(1.0, error=0.1), number(2.0, error=0.1), "opposite"),
        (number(2.0, error=0.3), number(1.0, error=0.3), "ambiguous"),
        (number(0.9995, kind="p_detection"), number(0.9999, kind="p_detection"), "saturated"),
        (number(0.9995, kind="p_detection"), number(0.99, kind="p_detection"), "holds"),
        (number(1.957, kind="exact_snr"), number(1.950, kind="exact_snr"), "noise_floor"),
        (number(2.07, kind="exact_snr"), number(2.80, kind="exact_snr"), "opposite"),
    ],
)
def test_a_margin_is_judged_by_its_error_and_by_what_can_be_seen(more, less, verdict):
    assert above(more, less).verdict == verdict


def test_one_reversed_inequality_refutes_a_reading():
    reading = Reading(name="falls", tests=falls([number(3.0), number(1.0), number(2.0)]))
    assert reading.verdict == "opposite"
    assert reading.deciding.margin == -1.0


@pytest.mark.parametrize(
    ("others", "verdict"),
    [
        ([above(number(1.92, kind="exact_snr"), number(1.95, kind="exact_snr"))], "opposite"),
        ([above(number(2.0), number(1.0))], "ambiguous"),
        ([above(number(1.0, error=0.1), number(1.1, error=0.1))], "ambiguous"),
    ],
)
def test_a_sentence_with_a_reversed_reading_is_opposite_unless_another_may_hold(others, verdict):
    tests = [above(number(1.0), number(2.0)), *others]
    readings = tuple(Reading(name=str(k), tests=(test,)) for k, test in enumerate(tests))
    assert Judged(statement=statements()[0], materials="library", readings=readings).verdict == verdict


def test_a_reading_without_numbers_needs_unpublished_data():
    assert Reading(name="their data", tests=()).verdict == "unpublished"


def test_peaks_and_steps():
    numbers = [number(value) for value in (1.0, 3.0, 2.0)]
    assert peak_within(numbers, (10.0, 50.0, 80.0), 40.0, 60.0).verdict == "holds"
    assert peak_within(numbers, (10.0, 50.0, 80.0), 60.0, 80.0).verdict == "opposite"
    assert some_step_rises(numbers).verdict == "holds"
    assert some_step_rises(numbers[1:]).verdict == "opposite"


def test_every_figure_has_its_sentences():
    by_figure = [one.figure.rstrip("ab") for one in statements()]
    assert all(by_figure.count(figure) >= least for figure, least in LEAST.items())


def test_a_figure_that_is_not_computed_is_refused(capsys):
    assert main(["paper", "--figure", "3"]) == 2
    assert "--figure: 3" in capsys.readouterr().err


def test_points_of_the_paper_are_drawn_over_and_bad_ones_refused(tmp_path, capsys):
    points = tmp_path / "points.csv"
    points.write_text("figure,panel,label,x,y\n5,a,theirs,10,0.9\n")
    assert main(["paper", "--figure", "5", "--materials", "library", "--digitised", str(points),
                 "--out", str(tmp_path / "out"), "--json"]) == 0  # fmt: skip
    rows = json.loads(capsys.readouterr().out)
    assert rows == json.loads((tmp_path / "out" / "statements.json").read_text())
    assert {row["verdict"] for row in rows if row["figure"] == "5"} == {"holds"}
    assert (tmp_path / "out" / "fig5-model.png").read_bytes().startswith(b"\x89PNG")
    points.write_text("figure,panel,label,x,y\n5,a,theirs,ten,0.9\n")
    assert main(["paper", "--figure", "5", "--digitised", str(points)]) == 2
    assert "line 2" in capsys.readouterr().err


def test_estimators_are_shown_with_bias_and_rms_error(tmp_path, capsys):
    assert main(["paper", "--estimators", "--json", "--out", str(tmp_path / "out")]) == 0
    content = json.loads(capsys.readouterr().out)
    # Unpolarized light: the naive estimate is biased by sqrt(pi / 2), its rms error is sqrt 2 (Rice with no signal).
    assert abs(content["naive"]["bias"][0] - 1.2533141373155) < 1e-9
    assert abs(content["naive"]["rms"][0] - 1.4142135623731) < 1e-9
    assert (tmp_path / "out" / "estimators.png").exists()
    assert main(["paper", "--estimators"]) == 0
    assert capsys.readouterr().out.startswith("at a true SNR of 2 ")
