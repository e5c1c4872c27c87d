import pytest

from rigctl.comparison.checks import diagnose
from rigctl.comparison.rows import Row


def _row(quantity, agrees, statistic="mean", predicted=1.0, measured=1.0, region="a"):
    return Row(
        region=region, quantity=quantity, statistic=statistic, predicted=predicted, measured=measured, std_error=0.01,
        z=9.0, agrees=agrees,
    )  # fmt: skip


def _aolp(predicted, measured, region):
    return _row("aolp_deg", False, predicted=predicted, measured=measured, region=region)


def test_where_all_agree_nothing_is_pointed_to():
    assert diagnose([_row("s0", True), _row("dolp", True)]).points_to == ()


def test_counts_off_and_dolp_right_is_a_scale():
    assert diagnose([_row("s0", False), _row("dn_0", False), _row("s1", False), _row("dolp", True)]).points_to == (
        "scale",
    )


def test_dolp_off_is_the_polarization_whatever_else_is():
    assert diagnose([_row("dolp", False), _row("s0", False), _row("s1n", False)]).points_to == ("polarization",)


def test_all_angles_turned_alike_is_the_offset():
    rows = [_aolp(10, 12.0, "a"), _aolp(95, 97.1, "b"), _aolp(179, 1.0, "c"), _row("dolp", True)]
    assert diagnose(rows).points_to == ("axis-offset",)


def test_all_angles_mirrored_is_the_sense():
    rows = [_aolp(10, 53.4, "a"), _aolp(95, 148.4, "b"), _aolp(168, 75.5, "c"), _row("dolp", True)]
    assert diagnose(rows).points_to == ("axis-sense",)


def test_an_axis_and_a_scale_are_both_named():
    rows = [_aolp(10, 12, "a"), _aolp(95, 97, "b"), _row("s0", False), _row("dolp", True)]
    assert diagnose(rows).points_to == ("axis-offset", "scale")


def test_only_deviations_off_is_the_noise():
    rows = [_row("dn_0", False, statistic="std_temporal"), _row("dn_0", True), _row("s0", True)]
    assert diagnose(rows).points_to == ("noise",)


@pytest.mark.parametrize("quantity", ["s0", "dolp", "aolp_deg"])
def test_every_cause_comes_with_advice(quantity):
    found = diagnose([_row(quantity, False)])
    assert len(found.advice) == len(found.points_to) == 1
