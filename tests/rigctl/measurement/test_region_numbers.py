"""Numbers of a region: errors that are neither too small nor too large."""

import numpy as np

from model.processing.reconstruction import design
from rigctl.measurement.region_numbers import measure_region

CYCLES, SIDE, RUNS = 8, 20, 60
ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)


def measured(pixels):
    return measure_region(
        name="paint",
        pixels=pixels,
        inside=np.ones((SIDE, SIDE), dtype=bool),
        excluded=0,
        edge=0,
        channel_names=("dn_0", "dn_45", "dn_90", "dn_135"),
        plan=design(np.deg2rad(ANGLES_DEG)),
        level_std_error=np.zeros(4),
        relative_error=np.zeros(4),
    )


def test_noise_of_pixels_is_counted_once_in_the_errors_of_ratios():
    draw = np.random.default_rng(5)
    scores = []
    for _ in range(RUNS):
        found = measured(1000.0 + 30.0 * draw.standard_normal((CYCLES, 4, SIDE**2)))
        scores += [one.value / one.std_error for one in (found.quantities[name]["mean"] for name in ("s1n", "s2n"))]
    # Twice as large a variance of the error would make it 0.5; 120 scores know theirs to 0.13.
    assert 0.62 < np.var(scores) < 1.4


def test_light_that_does_not_repeat_itself_is_in_the_errors():
    draw = np.random.default_rng(6)
    wander = 1.0 + 0.02 * draw.standard_normal((CYCLES, 4, 1))
    found = measured(1000.0 * wander + 3.0 * draw.standard_normal((CYCLES, 4, SIDE**2)))
    # 2 % from cycle to cycle, over eight; 28 degrees of freedom know it to a seventh.
    assert abs(found.repeatability - 0.02 / np.sqrt(CYCLES)) < 0.5 * 0.02 / np.sqrt(CYCLES)
