"""Numbers in sentences: as many digits as their error has."""

import numpy as np
import pytest

from calibration.estimate import number_with_error


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (-0.0122, 0.0354, "-0.012 +- 0.035"),
        (28300.0, 3912.0, "28300 +- 3900"),
        (0.579, 38.2, "1 +- 38"),
        (64.41, 0.0996, "64.410 +- 0.100"),
        (2.4e-9, 1.26e-10, "2.4e-09 +- 1.3e-10"),
        (3.0, np.inf, "3 +- inf"),
    ],
)
def test_a_number_is_written_to_the_second_digit_of_its_error(value: float, error: float, text: str) -> None:
    assert number_with_error(value, error) == text


def test_a_difference_has_its_sign() -> None:
    assert number_with_error(0.0845, 0.0086, sign="+") == "+0.0845 +- 0.0086"
