"""Tests of JSON in which a number that does not exist is null, with its reason beside it."""

import json
from math import inf, nan

from rigctl import cli
from rigctl.console.json_text import json_text
from tests.rigctl.example_files import SMALL_SCENE


def test_what_is_no_number_is_null_with_its_reason():
    told = json.loads(json_text({"a": nan, "b": {"c": inf}, "d": [1.0, nan], "e": 2.0}))
    assert told["a"] is None
    assert told["b"]["c"] is None
    assert told["d"] == [1.0, None]
    assert told["e"] == 2.0
    assert sorted(told) == ["a", "a_reason", "b", "d", "d_reason", "e"]
    assert "grows" in told["b"]["c_reason"]


def test_a_reason_that_is_known_stays():
    assert json.loads(json_text({"a": nan, "a_reason": "no light"})) == {"a": None, "a_reason": "no light"}


def test_a_scene_without_light_has_no_dolp_and_the_prediction_says_so(tmp_path, capsys):
    dark = SMALL_SCENE.replace("[10.0, 3.0, 1.0]", "[0.0, 0.0, 0.0]").replace("[40.0, -2.0, 3.0]", "[0.0, 0.0, 0.0]")
    (tmp_path / "scene.toml").write_text(dark)
    code = cli.main(["predict", str(tmp_path / "scene.toml"), "--json"])
    answer = capsys.readouterr()
    assert code in (0, 2), answer.err
    if code == 0:
        json.loads(answer.out, parse_constant=lambda name: 1 / 0)
    assert cli.main(["predict", str(tmp_path / "scene.toml")]) == code
    assert " nan" not in capsys.readouterr().out
