"""Tests of the range that numbers of files and options keep to, and of files that are judged before they are read."""

import pytest

from rigctl import cli
from rigctl.base.numbers import range_problem, wild_numbers
from tests.rigctl.example_files import EXAMPLES


@pytest.mark.parametrize("value", [1e300, -1e13, float("inf"), float("nan"), 10**400, 1e-200])
def test_a_number_beyond_the_range_is_refused(value):
    assert range_problem(value) is not None


@pytest.mark.parametrize("value", [0, 0.0, -1e12, 1e-30, 4095, True])
def test_a_number_of_the_world_is_taken(value):
    assert range_problem(value) is None


def test_every_wild_number_is_named_by_its_key():
    found = dict(wild_numbers({"a": [1.0, {"b": 1e300}], "c": -1e99}))
    assert sorted(found) == ["a.1.b", "c"]


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (
            ["tradeoff", str(EXAMPLES / "scene-panels.toml"), "--acquisition", "--drift-percent-per-min", "1e300"],
            "drift",
        ),
        (["calibrate", "axis", "nowhere", "--out", "nowhere.json", "--reference-deg", "1e300"], "--reference-deg"),
    ],
)
def test_options_keep_to_the_range(capsys, arguments, option):
    assert cli.main(arguments) == 2
    assert option in capsys.readouterr().err


@pytest.mark.parametrize("text", ["a = " + "[" * 100_000, "a = " + "9" * 5000, "a = 1" + "0" * 400, "a = 'x\x00'"])
def test_a_file_that_is_meant_to_break_the_reader_is_refused(tmp_path, capsys, text):
    (tmp_path / "scene.toml").write_text(text)
    assert cli.main(["predict", str(tmp_path / "scene.toml")]) == 2
    assert len(capsys.readouterr().err) < 1000


def test_a_name_of_thousands_of_characters_is_a_usage_error(capsys):
    assert cli.main(["verify", "x" * 5000]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_a_year_of_no_sun_table_is_refused(tmp_path, capsys):
    (tmp_path / "session.toml").write_text("[schedule]\nstart = 9999-12-31T00:00:00Z\n")
    assert cli.main(["plan", str(EXAMPLES / "rig-sim.toml"), str(tmp_path / "session.toml")]) == 2
    assert "schedule.start: the year must lie between 1900 and 2200" in capsys.readouterr().err
