"""Numbers as people write them, and the range that numbers of files and options keep to."""

from math import inf, nan

import numpy as np
import pytest

from rigctl import cli
from rigctl.base.numbers import (
    NO_NUMBER,
    NOTHING,
    chance,
    p_value,
    percent,
    range_problem,
    size,
    to_digits,
    wild_numbers,
    wrapped,
)
from tests.rigctl.example_files import EXAMPLES


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (443.5213, 0.049, "443.521"),
        (0.379953, 4.9e-5, "0.379953"),
        (12345.6, 230.0, "12346"),
        (1.5, 0.0, "1.5"),
        (nan, 0.1, NO_NUMBER),
        (inf, 0.1, NO_NUMBER),
    ],
)
def test_a_number_has_two_digits_of_its_error(value, error, text):
    assert to_digits(value, error) == text


@pytest.mark.parametrize(
    ("share", "text"),
    [(1.0, "100 %"), (0.99996, "100 %"), (0.5, "50 %"), (0.0123, "1.2 %"), (1.3e-4, "0.013 %"), (0.0, "0 %"),
     (12.5, "1250 %"), (nan, NO_NUMBER)],
)  # fmt: skip
def test_a_share_has_no_power_of_ten(share, text):
    assert percent(share) == text


def test_a_change_has_its_sign():
    assert percent(0.0123, sign=True) == "+1.2 %"
    assert percent(-0.0123, sign=True) == "-1.2 %"


@pytest.mark.parametrize(("value", "text"), [(4.3e-293, "0"), (1.23e-5, "1.2e-05"), (0.0, "0"), (nan, NOTHING)])
def test_what_is_left_of_rounding_is_nothing(value, text):
    assert size(value) == text


@pytest.mark.parametrize(("p", "text"), [(1e-264, "< 1e-6"), (0.0321, "0.032"), (1.0, "1"), (nan, NO_NUMBER)])
def test_how_small_a_very_small_chance_is_is_not_said(p, text):
    assert chance(p) == text


def test_a_chance_behind_its_name():
    assert (p_value(1e-9), p_value(0.5)) == ("p < 1e-6", "p = 0.5")


@pytest.mark.parametrize(
    ("angle", "turn", "expected"),
    [(350.0, 360.0, -10.0), (-190.0, 360.0, 170.0), (180.0, 360.0, -180.0), (90.0, 180.0, -90.0), (179.0, 180.0, -1.0)],
)
def test_an_angle_is_brought_into_half_a_turn_about_zero(angle, turn, expected):
    assert wrapped(angle, turn=turn) == expected


def test_arrays_are_wrapped_element_by_element():
    np.testing.assert_array_equal(wrapped(np.array([350.0, 10.0]), turn=360.0), [-10.0, 10.0])


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
