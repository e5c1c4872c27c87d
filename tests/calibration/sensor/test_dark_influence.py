"""Single darks compared with the others, by statistics that are drawn and not measured."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from calibration.sensor.judging import sound_darks
from calibration.sensor.levels import LevelStatistics, level_statistics

FloatArray = NDArray[np.float64]
N_PIXELS = 7680
# What the limits of mean and variance of darks allow together.
FALSE_NAMES = 1e-3


def template() -> LevelStatistics:
    draw = np.random.default_rng(1)
    frames = [np.rint(100.0 + 3.0 * draw.standard_normal((80, 96))).astype(np.uint16) for _ in range(2)]
    return level_statistics(frames, kind="dark", exposure_s=1.0)


def drawn_darks(one: LevelStatistics, exposures_s: FloatArray, draw: np.random.Generator) -> list[LevelStatistics]:
    """Pairs of dark frames, most of whose noise is dark current, each variance with the error that it has by itself."""
    darks = []
    for exposure_s in exposures_s:
        variance = 4.0 + 100.0 * exposure_s
        seen = variance * (1.0 + np.sqrt(2.0 / N_PIXELS) * draw.standard_normal())
        means = 100.0 + 200.0 * exposure_s + np.sqrt(variance / N_PIXELS) * draw.standard_normal(2)
        darks.append(
            replace(
                one,
                exposure_s=float(exposure_s),
                mean_dn=float(means.mean()),
                frame_means_dn=tuple(means.tolist()),
                temporal_variance_dn2=float(seen),
                temporal_std_error_dn2=float(seen * np.sqrt(2.0 / N_PIXELS)),
            )
        )
    return darks


def test_sound_darks_whose_noise_grows_are_not_named() -> None:
    # A lamp sweep with darks of three exposures: 2 % of such were named, with the errors of the middle.
    draw, one = np.random.default_rng(3), template()
    exposures_s, n_sets = np.tile([1.0, 0.5, 2.0], 8), 150
    named = sum(bool(sound_darks(drawn_darks(one, exposures_s, draw))[1]) for _ in range(n_sets))
    assert named <= binom.ppf(1.0 - 1e-3, n_sets, FALSE_NAMES)


def test_a_dark_off_by_ten_errors_is_named_wherever_it_stands() -> None:
    draw, one = np.random.default_rng(4), template()
    darks = drawn_darks(one, np.linspace(0.1, 2.0, 16), draw)
    assert sound_darks(darks) == (darks, ())
    for place, dark in enumerate(darks):
        # Errors of the difference from a curve through the others, which has twice the error at the shortest exposure.
        off_dn2 = (20.5 if place == 0 else 10.0) * dark.temporal_std_error_dn2
        wrong = replace(dark, temporal_variance_dn2=dark.temporal_variance_dn2 + off_dn2)
        kept, flags = sound_darks([*darks[:place], wrong, *darks[place + 1 :]])
        assert kept == [*darks[:place], *darks[place + 1 :]]
        assert [flag.name for flag in flags] == ["wrong_dark"]


def test_one_long_dark_that_decides_the_curve_is_not_judged_by_it() -> None:
    # Nearly all exposures are short, and the curve of each degree goes through the few long ones.
    draw, one = np.random.default_rng(5), template()
    for n_long in (1, 2, 3):
        exposures_s = np.concatenate([np.linspace(1e-5, 1e-2, 20), [0.1, 1.0, 10.0][:n_long]])
        darks = drawn_darks(one, exposures_s, draw)
        assert sound_darks(darks) == (darks, ())
