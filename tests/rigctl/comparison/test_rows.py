import numpy as np
import pytest
from scipy.special import ndtr

from model.processing.samples import deviation
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
