from fractions import Fraction

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from model.processing.dolp_law import product

number = st.floats(-1e20, 1e20).filter(lambda value: value == 0.0 or abs(value) > 1e-20)


@settings(deadline=None)
@given(number, number)
def test_product_is_exact(first, second):
    found = product(np.array(first), np.array(second))
    assert Fraction(float(found.high)) + Fraction(float(found.low)) == Fraction(first) * Fraction(second)


@settings(deadline=None)
@given(number, number, number, number)
def test_difference_of_products_keeps_its_digits(a, b, c, d):
    found = (product(np.array(a), np.array(b)) - product(np.array(c), np.array(d))).value
    exact = Fraction(a) * Fraction(b) - Fraction(c) * Fraction(d)
    size = abs(Fraction(a) * Fraction(b)) + abs(Fraction(c) * Fraction(d))
    # Twice the precision: 2^-104 of the terms, and the rounding of the result.
    assert abs(Fraction(float(found)) - exact) <= abs(exact) * Fraction(2) ** -52 + size * Fraction(2) ** -100


@settings(deadline=None)
@given(number, number)
def test_product_of_sums_keeps_its_digits(first, second):
    a, b = product(np.array(first), np.array(1.1)), product(np.array(second), np.array(0.7))
    exact = Fraction(first) * Fraction(1.1) * Fraction(second) * Fraction(0.7)
    assert abs(Fraction(float((a * b).value)) - exact) <= abs(exact) * Fraction(2) ** -52
