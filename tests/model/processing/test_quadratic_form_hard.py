"""Forms that defeat the usual methods, against 32-digit oracles; the worst of random scans are kept here."""

import mpmath as mp
import numpy as np
import pytest

from model.processing.quadratic_forms import tail_probabilities
from tests.model.processing.quadratic_form_oracles import mixture_tail, ray_log_tail

# The default tolerance is 1e-10 for half of the nodes in use; rounding of a threshold and of offsets b adds about
# b times 1e-16. Geometric convergence leaves less than 1e-12 of all that in every case here.
RELATIVE = 1e-12

MIXTURES = [
    (60.0, [1.0, 2.0, 3.0], [0.5, -1.0, 2.0], True),
    (110.0, [1.0, 2.0, 3.0], [0.5, -1.0, 2.0], True),
    (0.003, [1.0, 2.0, 3.0], [0.5, -1.0, 2.0], False),
    (2.0, [0.5, 0.7, 1.1, 0.9], [6.0, 0.0, 4.0, -3.0], False),
    (3.0, [0.14, 0.48, 0.49], [-12.0, -1.5, 2.8], False),
    (30.0, [1.0, 1.0 + 1e-9, 1.0 - 1e-9], [1.0, 2.0, 0.0], True),
]

RAYS = [
    # (threshold, weights, offsets, upper)
    (11.3, [1e-12, 1.0, 1e6], [1.0, 2.0, 3.0], False),
    (2.4, [1e-12, 1.0, 1e6], [0.0, 0.0, 0.0], False),
    (3e7, [1e-12, 1.0, 1e6], [1.0, 2.0, 3.0], True),
    (1650.0, [1e-6, 1.0, 2.0], [4e4, 1.0, -1.0], True),  # a narrow component at 40 sigma beside two wide ones
    (1590.0, [1e-6, 1.0, 2.0], [4e4, 1.0, -1.0], False),
    (1e6 + 5e4, [1.0, 0.3], [1e3, 2.0], True),
    (9e5, [1.0, 0.3], [1e3, 2.0], False),
    (30.66484970621360, [0.02, 0.03, 0.05], [1.0, 0.0, 0.0], True),  # 6e-135
    (2.365973884375338, [0.139675, 0.482143, 0.484825], [-52.6127, -1.47938, 10.8357], False),  # 1e-540
    (50.0, [0.5**k for k in range(12)], [0.1 * k for k in range(12)], True),
    (164463.5552304844, [2.28309971, 5.83185265], [253.805556, 0.0204860363], True),
]

MIXED = [
    # (threshold, weights, offsets, degrees, upper, angle of the oracle's ray)
    (0.0, [1e-12, 1.0, 1e6, -1.0], [1.0, 2.0, 3.0, 0.0], [1.0, 1.0, 1.0, 3.0], False, 60),
    (0.0, [0.02, 0.03, 0.05, -1.0], [1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 3.0], True, 60),
    (0.0, [1e-10, 1e-10, 1e-10, -1.0], [1e5, 2e5, 1e5, 0.0], [1.0, 1.0, 1.0, 3.0], True, 120),
    # DoLP: two positive weights, a negative one that is a threshold but for 1e-3 or 1e-6 of it
    (0.0, [1.0, 1.2, -1e-6], [0.1, 0.2, 1e3], [1.0, 1.0, 1.0], True, 60),
    (0.0, [1.0, 1.2, -9e-12], [0.1, 0.2, 1e6], [1.0, 1.0, 1.0], True, 60),
    # found by random scans: cancellation at a negative weight beyond 1e12 of the positive ones, and its mirror
    (319579165.3361443, [-1.45810044e-05, 3.47870638e07], [-7.32440215, 5.39912215], [7.0, 2.0], False, 120),
    (
        -253663603932.91553,
        [1.13592271e-12, -1.75506725e-05, -3.88554108e10],
        [-5.94616792, 1.85740628, -2.35125466],
        [1.0, 1.0, 1.0],
        True,
        120,
    ),
    (0.0304256978393522, [-2.2034424498e-11, 0.00176597411], [-4.96566674, -6.51463161], [1.0, 1.0], False, 120),
]


@pytest.mark.parametrize(("threshold", "weights", "offsets", "upper"), MIXTURES)
def test_comparable_weights_against_the_mixture_of_chi_squares(
    threshold: float, weights: list[float], offsets: list[float], upper: bool
) -> None:
    tails = tail_probabilities(threshold, weights, offsets)
    expected = mixture_tail(threshold, weights, offsets, upper=upper)
    assert float((tails.upper if upper else tails.lower) / expected) == pytest.approx(1.0, abs=RELATIVE)


@pytest.mark.parametrize(("threshold", "weights", "offsets", "upper"), RAYS)
def test_spread_weights_against_a_straight_ray(
    threshold: float, weights: list[float], offsets: list[float], upper: bool
) -> None:
    tails = tail_probabilities(threshold, weights, offsets)
    expected = ray_log_tail(threshold, weights, offsets, upper=upper)
    found = float(tails.log_upper if upper else tails.log_lower)
    # a double holds the logarithm of a tail of 1e-540 to 1e-13
    assert found == pytest.approx(float(expected), abs=RELATIVE)


@pytest.mark.parametrize(("threshold", "weights", "offsets", "degrees", "upper", "angle_deg"), MIXED)
def test_weights_of_both_signs_against_a_straight_ray(
    threshold: float, weights: list[float], offsets: list[float], degrees: list[float], upper: bool, angle_deg: int
) -> None:
    tails = tail_probabilities(threshold, weights, offsets, degrees=degrees)
    expected = ray_log_tail(threshold, weights, offsets, upper=upper, angle_deg=angle_deg, degrees=degrees)
    found = float(tails.log_upper if upper else tails.log_lower)
    assert found == pytest.approx(float(expected), abs=RELATIVE)


def test_the_two_oracles_agree() -> None:
    args = (60.0, [1.0, 2.0, 3.0], [0.5, -1.0, 2.0])
    difference = mp.log(mixture_tail(*args, upper=True)) - ray_log_tail(*args, upper=True)
    assert abs(difference) < mp.mpf("1e-16")


def test_nearly_equal_weights_are_continuous() -> None:
    threshold = np.array([0.1, 3.0, 20.0, 60.0])
    equal = tail_probabilities(threshold, [1.0, 1.0, 1.0], [1.0, 2.0, 0.0])
    # a weight of 1 +- d changes a tail by d (t/2) relative at most: 3e-8 at t = 60 and d = 1e-9, and to first
    # order the two changes here cancel but for the difference of their offsets
    for spread in (1e-9, 1e-11, 1e-13):
        near = tail_probabilities(threshold, [1.0 - spread, 1.0, 1.0 + spread], [1.0, 2.0, 0.0])
        np.testing.assert_allclose(near.upper, equal.upper, rtol=31.0 * spread + 1e-13)


def test_error_estimate_grows_with_the_exponent() -> None:
    # offsets of 1e7: the exponent at the saddle is a difference of terms of 1e14 s, which rounding blurs
    easy = tail_probabilities(1.21, [1e-10] * 2, [1e5, 0.0])
    blurred = tail_probabilities(1.21, [1e-14] * 2, [1e7, 0.0])
    assert blurred.error > 10.0 * easy.error
