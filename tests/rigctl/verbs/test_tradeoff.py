import csv
import json
import re

import pytest

from rigctl import cli
from tests.rigctl.example_files import EXAMPLES

# Every radiance is given: no sky is solved, and the knobs of the light have no error.
PANELS = str(EXAMPLES / "scene-panels.toml")


def test_curves_choices_and_floor_are_written(tmp_path, capsys):
    assert cli.main(["tradeoff", PANELS, "--tolerances", "0.01,0.001", "--out", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith(
        "The inputs have no uncertainty, so every tolerance buys something: --tolerance 0.001 costs"
    )
    assert "worth having" in shown
    assert {"tradeoff.png", "settings.png", "stages.png", "digits.png"} <= {one.name for one in tmp_path.iterdir()}
    rows = list(csv.DictReader((tmp_path / "tradeoff.csv").read_text().splitlines()))
    assert [row["setting"] for row in rows if row["knob"] == "whole chain"] == ["tolerance 0.01", "tolerance 0.001"]
    assert all(float(row["true_error"]) <= 0.001 for row in rows)
    assert (tmp_path / "tradeoff.png").read_bytes().startswith(b"\x89PNG")
    assert len(json.loads((tmp_path / "tradeoff.json").read_text())["choices"]) == 2


def test_wide_shows_each_setting_and_the_floor(capsys):
    assert cli.main(["tradeoff", PANELS, "--tolerances", "0.01", "--wide"]) == 0
    shown = capsys.readouterr().out
    assert "what --tolerance chooses" in shown
    assert "stated without uncertainty: no floor" in shown


def test_uncertain_inputs_say_which_tolerance_is_worth_having(capsys):
    assert cli.main(["tradeoff", str(EXAMPLES / "scene-panels-uncertain.toml"), "--tolerances", "0.1,0.001"]) == 0
    first, _, *rows = capsys.readouterr().out.splitlines()
    floor = float(re.match(r"A tolerance below (\S+) buys nothing for DoLP", first)[1])
    (worth,) = [float(row.split()[1]) for row in rows if "worth having" in row]
    assert worth <= floor
    assert all(len(row.rstrip()) <= 80 for row in rows if row.startswith("--tolerance"))


def test_a_prediction_to_a_tolerance_says_its_error(capsys):
    assert cli.main(["predict", PANELS, "--tolerance", "0.001", "--json"]) == 0
    accuracy = json.loads(capsys.readouterr().out)["accuracy"]
    # Effects that are left out have their share of it.
    assert 0.0005 <= accuracy["tolerance"] <= 0.001
    assert all(one["error"] <= 0.001 for one in accuracy["estimated_errors"])
    assert accuracy["not_promised"] == {}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["tradeoff", "--tolerances", "0.5"], "--tolerances"),
        (["tradeoff", "--tolerances", "1e-9"], "--tolerances"),
        (["tradeoff", "--tolerances", "fine"], "--tolerances"),
        (["tradeoff", "--target-dolp-sigma", "0.002"], "--acquisition"),
        (["predict", "--tolerance", "0.5"], "--tolerance. Must be <= 0.1"),
    ],
)
def test_options_that_cannot_be_are_refused(arguments, words, capsys):
    assert cli.main([arguments[0], PANELS, *arguments[1:]]) == 2
    assert words in capsys.readouterr().err
