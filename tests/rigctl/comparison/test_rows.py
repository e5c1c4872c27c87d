"""Numerical settings of a comparison: errors of rows by those of a prediction, and the next tolerance."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtr

from model.accuracy.chain import Reading
from model.effects.effect import Bound, Effect
from model.processing.samples import deviation
from rigctl.comparison.compare import ALLOWED_SHARE, NumericalAccuracy
from rigctl.comparison.rows import Row, decide, off_prediction, pair, scored


def _row(predicted=1.0, measured=1.0, std_error=0.1, quantity="s0", **facts):
    return Row(
        region="a", quantity=quantity, statistic="mean", predicted=predicted, measured=measured, std_error=std_error,
        **facts,
    )  # fmt: skip


def test_z_is_taken_against_both_errors():
    row = scored(_row(measured=1.5, std_error=0.3), 0.4)
    assert row.z_measurement == pytest.approx(0.5 / 0.3)
    assert row.z == pytest.approx(0.5 / 0.5)


def test_without_any_error_there_is_no_score():
    row = scored(_row(measured=1.5, std_error=0.0), 0.0)
    assert row.z is None
    assert row.z_measurement is None


@pytest.mark.parametrize(("predicted", "measured", "off"), [(1.0, 179.0, -2.0), (179.0, 1.0, 2.0), (45.0, 50.0, 5.0)])
def test_angles_of_polarization_differ_the_shorter_way_round(predicted, measured, off):
    row = _row(predicted=predicted, measured=measured, quantity="aolp_deg")
    assert off_prediction(row, row.measured) == pytest.approx(off)


def test_a_row_without_score_is_no_test_and_takes_no_share_of_alpha():
    rows = (_row(), scored(_row(measured=1.0 + 0.1 * 3.3), 0.0))
    decided = decide(rows, alpha=1e-3)
    # |z| = 3.3 has p = 9.7e-4: below alpha for one test, above alpha / 2 for two.
    assert decided[0].agrees is None
    assert decided[1].agrees is False


def _z_of_deviation(pixels):
    (row,) = pair("a", {"s0": {"std": 1.0}}, {"s0": {"std": deviation(pixels)}})
    return scored(row, 0.0).z


@pytest.mark.parametrize("count", [64, 400])
def test_a_deviation_is_called_too_small_no_oftener_than_chance_has_it(count):
    generator = np.random.default_rng(22)
    z = np.array([_z_of_deviation(pixels) for pixels in generator.standard_normal((10_000, count))])
    # Of 10 000, 62 are expected below -2.5; with the error by its own pixels alone there are 200 of 64 pixels.
    assert np.sum(z < -2.5) < 2.0 * z.size * ndtr(-2.5)
    assert np.std(z) == pytest.approx(1.0, abs=0.08)


def test_a_deviation_above_its_prediction_has_its_own_error():
    pixels = np.random.default_rng(22).normal(scale=2.0, size=400)
    (row,) = pair("a", {"s0": {"std": 1.0}}, {"s0": {"std": deviation(pixels)}})
    assert row.std_error == deviation(pixels).std_error


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


def _row_of(quantity, error, statistic="mean"):
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
    assert _accuracy(_row_of(quantity, 1.0)).share == pytest.approx(error, rel=1e-6)


def test_what_left_out_effects_may_change_is_part_of_it():
    assert _accuracy(_row_of("dolp", 1e-3), spent=Bound(ratios=1e-4)).share == pytest.approx(0.15)


def test_the_worst_row_asks_for_the_next_tolerance():
    found = _accuracy(_row_of("dolp", 1e-4), _row_of("s0", 100.0))
    assert found.row.quantity == "dolp"
    assert not found.is_kept
    assert found.next_tolerance < 0.01 * ALLOWED_SHARE / found.share
    assert "dolp" in found.remark


def test_no_smaller_tolerance_is_tried_where_this_one_does_or_there_is_none():
    assert _accuracy(_row_of("dolp", 1.0)).next_tolerance is None
    assert _accuracy(_row_of("dolp", 1e-9), tolerance=1e-6).next_tolerance is None
    assert _accuracy().share == 0.0


def test_settings_that_would_take_minutes_are_not_tried_and_the_reached_error_is_said():
    found = _accuracy(_row_of("dolp", 1e-4), expected_s=60.0)
    assert found.next_tolerance is None
    assert "at most 0.5 of a standard error" in found.remark
    assert "take minutes" in found.remark


def test_an_error_of_s0_hardly_asks_for_a_smaller_tolerance_of_ratios():
    assert _accuracy(_row_of("ratio_0", 4.2e-4)).is_kept
