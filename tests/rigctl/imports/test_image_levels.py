import numpy as np
import pytest

from rigctl.imports.levels import histogram, odd_pattern


def _smooth_counts():
    return np.random.default_rng(4).normal(120.0, 30.0, (200, 200)).clip(0, 255).astype(np.uint16)


@pytest.mark.parametrize(
    ("odd", "text"),
    [
        (lambda counts: counts, ""),
        (lambda counts: np.where(np.arange(200)[:, None] < 20, 0, counts), ""),
        # A narrow border is an end of its own where the light keeps away from nothing.
        (lambda counts: np.where(np.arange(200)[:, None] < 7, 0, counts // 4 + 60), ""),
        (lambda counts: counts | 4, "bit 2 is 1"),
        (lambda counts: counts & ~np.uint16(8), "bit 3 is 0"),
        (lambda counts: np.round(counts * 1.25), "never occur"),
        (lambda counts: np.where(counts % 8 == 5, counts + 1, counts), "never occur"),
        (lambda counts: counts * 16, ""),
    ],
)
def test_bits_that_are_no_cameras_own_are_named(odd, text):
    found = odd_pattern(histogram(odd(_smooth_counts()).astype(np.uint16)))
    assert (text in found) if text else (found == "")
