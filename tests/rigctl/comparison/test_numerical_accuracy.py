"""Numerical settings of a comparison: errors of rows by those of a prediction, and the next tolerance."""

from types import SimpleNamespace

import numpy as np
import pytest

from model.accuracy.chain import Reading
from model.effects.names import Bound, Effect
from rigctl.comparison.compare import ALLOWED_SHARE, NumericalAccuracy
from rigctl.comparison.rows import Row

QUANTITIES = {
    "s0": {"mean": 1000.0},
    "s1": {"mean": 1.0},
    "s1n": {"mean": 1e-3},
    "s2n": {"mean": 0.1},
    "dolp": {"mean": 0.1},
    "aolp_deg": {"mean": 45.0},
    "dn_0": {"mean": 500.0},
    "dn_90": {"mean": 499.0},
    "ratio_0": {"mean": 1.001},
}
ERRORS = {("s0", 2e-4), ("s1", 1e-4), ("s1n", 3e-5), ("s2n", 4e-5), ("dolp", 5e-5), ("dn_0", 2e-4), ("dn_90", 3e-4)}


def _row(quantity, error, statistic="mean"):
    predicted = QUANTITIES[quantity][statistic]
    row = Row(region="a", quantity=quantity, statistic=statistic, predicted=predicted, measured=predicted)
    return Row(**{**vars(row), "std_error": error, "std_error_inputs": 0.0, "z": 0.0, "agrees": True})


def _accuracy(*rows, spent=None, tolerance=0.01, expected_s=1.0):
    total = {Reading("a", name, "mean"): error for name, error in ERRORS}
    found = NumericalAccuracy(
        tolerance=tolerance,
        predicted=SimpleNamespace(budget=SimpleNamespace(total=total), estimated_only=False, expected_s=expected_s),
        effects=SimpleNamespace(spent=Bound() if spent is None else spent),
        left_out=frozenset() if spent is None else frozenset({Effect.SKYLIGHT}),
        taken=frozenset(),
    )
    return found.of_rows(rows, {"a": SimpleNamespace(quantities=QUANTITIES)})


@pytest.mark.parametrize(
    ("quantity", "error"),
    [
        ("s0", 0.2),  # relative
        ("s1", 0.1),  # a share of S0, not of itself
        ("dolp", 5e-5),  # absolute
        ("aolp_deg", np.degrees(0.5 * 5e-5 / 0.1)),  # (s1, s2) may turn by 5e-5 of 0.1
        # (s1, s2) turn by 5e-5, over the channels' level of 0.999; of the counts' own errors few percents
        ("ratio_0", 5e-5 * 2.001 / 0.999 + 0.03 * 1.001 * (2e-4 + 3e-4)),
    ],
)
def test_the_numerical_error_of_a_row_is_in_its_own_unit(quantity, error):
    assert _accuracy(_row(quantity, 1.0)).share == pytest.approx(error, rel=1e-6)


def test_what_left_out_effects_may_change_is_part_of_it():
    assert _accuracy(_row("dolp", 1e-3), spent=Bound(ratios=1e-4)).share == pytest.approx(0.15)


def test_the_worst_row_asks_for_the_next_tolerance():
    found = _accuracy(_row("dolp", 1e-4), _row("s0", 100.0))
    assert found.row.quantity == "dolp"
    assert not found.is_kept
    assert found.next_tolerance < 0.01 * ALLOWED_SHARE / found.share
    assert "dolp" in found.remark


def test_no_smaller_tolerance_is_tried_where_this_one_does_or_there_is_none():
    assert _accuracy(_row("dolp", 1.0)).next_tolerance is None
    assert _accuracy(_row("dolp", 1e-9), tolerance=1e-6).next_tolerance is None
    assert _accuracy().share == 0.0


def test_settings_that_would_take_minutes_are_not_tried_and_the_reached_error_is_said():
    found = _accuracy(_row("dolp", 1e-4), expected_s=60.0)
    assert found.next_tolerance is None
    assert "at most 0.5 of a standard error" in found.remark
    assert "take minutes" in found.remark


def test_an_error_of_s0_hardly_asks_for_a_smaller_tolerance_of_ratios():
    assert _accuracy(_row("ratio_0", 4.2e-4)).is_kept
