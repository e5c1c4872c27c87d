"""Numbers of a region: errors that are neither too small nor too large."""

import numpy as np

from model.processing.reconstruction import design
from model.processing.samples import repeated
from rigctl.measure.measure import measure_region

CYCLES, SIDE, RUNS = 8, 20, 60
ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)


def measured(pixels):
    plan = design(np.deg2rad(ANGLES_DEG))
    return measure_region(
        name="paint",
        pixels=repeated(pixels, plan.inverse),
        inside=np.ones((SIDE, SIDE), dtype=bool),
        excluded=0,
        edge=0,
        channel_names=("dn_0", "dn_45", "dn_90", "dn_135"),
        plan=plan,
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
    assert abs(found.repeatability.own - 0.02 / np.sqrt(CYCLES)) < 0.5 * 0.02 / np.sqrt(CYCLES)
    # An angle's own wander is no light that all angles share.
    assert found.repeatability.common < 0.02 / np.sqrt(CYCLES)


def test_light_that_wanders_alike_behind_all_angles_is_in_the_errors_of_counts_and_not_of_ratios():
    draw = np.random.default_rng(7)
    wander = 1.0 + 0.02 * draw.standard_normal((CYCLES, 1, 1))
    noise = 3.0 * draw.standard_normal((CYCLES, 4, SIDE**2))
    still, found = measured(1000.0 + noise), measured(1000.0 * wander + noise)
    # Seven degrees of freedom know it to a quarter; its slope by chance is some tenth of it.
    assert abs(found.repeatability.common * np.sqrt(CYCLES) - 0.02) < 0.01
    assert found.repeatability.own < 0.4 * found.repeatability.common
    assert found.quantities["s0"]["mean"].std_error > 20.0 * still.quantities["s0"]["mean"].std_error


def test_light_that_drifts_reaches_the_angles_one_after_the_other():
    draw = np.random.default_rng(8)
    drift = 1.0 + 0.01 * (np.arange(CYCLES * 4) / 4.0).reshape(CYCLES, 4, 1)
    found = measured(1000.0 * drift + 3.0 * draw.standard_normal((CYCLES, 4, SIDE**2)))
    for name in ("s1n", "s2n"):
        one = found.quantities[name]["mean"]
        # Half a cycle between its two angles, where any two are 0.41 apart in the root mean square of all orders.
        assert 1.0 < abs(one.value) / one.std_error < 1.5


def test_what_rounding_leaves_of_zero_is_zero():
    # 0.1 is no binary number: its sums leave 1e-17 of what is nothing.
    found = measured(np.full((CYCLES, 4, SIDE**2), 0.1)).quantities
    for quantity, statistics in found.items():
        for statistic, sample in statistics.items():
            assert sample.std_error == 0.0, (quantity, statistic)
            assert abs(sample.value) > 0.01 or sample.value == 0.0, (quantity, statistic)
