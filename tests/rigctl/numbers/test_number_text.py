"""Numbers as people write them."""

from math import inf, nan

import pytest

from rigctl.base.numbers import NO_NUMBER, NOTHING, chance, p_value, percent, size, to_digits


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
