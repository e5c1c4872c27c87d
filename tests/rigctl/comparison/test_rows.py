import pytest

from rigctl.comparison.rows import Row, decide, off_prediction, scored


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
