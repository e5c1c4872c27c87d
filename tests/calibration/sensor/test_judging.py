"""Sets with known truth: wrong levels by name, no false names, intervals; single darks. The trial has more seeds."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from calibration.estimate import Estimate
from calibration.results import Flag, RefusedFramesError
from calibration.sensor.judging import sound_darks
from calibration.sensor.levels import LevelStatistics, level_statistics
from calibration.sensor.noise import NoiseCalibration, calibrate_noise, first_lines, with_pattern
from tests.calibration.sensor import noise_sets
from tests.calibration.sensor.drawn_sets import DRAWN_GOOD, DRAWN_WRONG, drawn_ten_errors
from tests.calibration.sensor.noise_sets import GOOD, NoiseSet, SetMaker, calibrated, names_level

# Seeds that the trial over 200 of each kind holds; here a few of them.
SEEDS = (3, 4)
# No number that is given is further off.
FURTHEST = 5.0


def off_by(found: NoiseCalibration, truth: dict[str, float]) -> dict[str, float]:
    estimates: dict[str, Estimate | None] = {name: getattr(found, name) for name in truth}
    return {name: abs(one.value - truth[name]) / one.std_error for name, one in estimates.items() if one is not None}


def named(found: NoiseCalibration) -> list[Flag]:
    return [flag for flag in found.flags if flag.level is not None]


def assert_covers(found: NoiseCalibration, given: NoiseSet) -> None:
    assert {name: off for name, off in off_by(found, given.truth).items() if off > FURTHEST} == {}


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("make", GOOD)
def test_good_sets_name_no_level(make: SetMaker, seed: int) -> None:
    given = make(seed)
    found = calibrated(given)
    assert named(found) == []
    assert_covers(found, given)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("make", "cause"),
    [
        (noise_sets.wrong_photons, "wrong_light"),
        (noise_sets.mislabelled_stack, "wrong_light"),
        (noise_sets.one_other_gain, "another_gain"),
        (noise_sets.averaged_frames, "wrong_variance"),
        (noise_sets.lit_dark, "wrong_dark"),
    ],
)
def test_the_wrong_level_is_named_and_no_other(make: SetMaker, cause: str, seed: int) -> None:
    given = make(seed)
    found = calibrated(given)
    assert any(flag.name == cause for flag in named(found))
    assert all(any(names_level(flag, mean_dn) for mean_dn in given.wrong_means_dn) for flag in named(found))
    assert_covers(found, given)


@pytest.mark.parametrize(
    ("make", "cause"),
    [
        (noise_sets.gain_changed, "gain_changed"),
        (noise_sets.clipped_black, "clipped_black"),
        (noise_sets.left_justified, "left_justified"),
        (noise_sets.compressed, "compressed_frames"),
    ],
)
def test_what_no_photon_transfer_can_read_is_refused_by_its_cause(make: SetMaker, cause: str) -> None:
    with pytest.raises(RefusedFramesError) as caught:
        calibrated(make(SEEDS[0]))
    assert cause in {flag.name for flag in caught.value.flags if flag.refuses}


@pytest.mark.parametrize("make", DRAWN_GOOD)
def test_sensors_with_drawn_settings_name_no_level(make: SetMaker) -> None:
    given = make(SEEDS[0])
    found = calibrated(given)
    assert named(found) == []
    assert_covers(found, given)


@pytest.mark.parametrize("make", DRAWN_WRONG)
def test_wrong_levels_at_either_end_and_two_at_once_are_named(make: SetMaker) -> None:
    given = make(SEEDS[1])
    found = calibrated(given)
    for mean_dn in given.wrong_means_dn:
        assert any(names_level(flag, mean_dn) for flag in named(found))
    assert_covers(found, given)


def test_a_large_dark_current_without_pixel_maps_is_a_bound() -> None:
    given = noise_sets.leak(SEEDS[0])
    found = with_pattern(calibrate_noise(given.levels, bit_depth=given.bits), None)
    assert found.dark_current_e_per_s is None
    assert "dark_current_or_light" in {flag.name for flag in found.flags}
    assert found.bounds["dark_current_e_per_s"].value > given.truth["dark_current_e_per_s"]


def test_pixels_with_gains_of_their_own_are_no_light_in_the_darks() -> None:
    # The share of the gain in what pixels differ by is known to an eighth of itself with so many pixels.
    sensor = noise_sets.Sensor(seed=SEEDS[0], bits=16, gain=2.1, read_e=1.6, gain_spread=0.02, shape=(160, 192))
    found = calibrated(noise_sets.noise_set(sensor, noise_sets.sweep(sensor)))
    assert "light_in_darks" not in {flag.name for flag in found.flags}
    # The dark current is known to a hundredth, not to itself.
    assert found.dark_current_e_per_s is not None
    assert found.dark_current_e_per_s.std_error < 0.05 * found.dark_current_e_per_s.value


def test_light_in_the_darks_leaves_no_dark_current_and_all_else() -> None:
    given = noise_sets.leak(SEEDS[0])
    found = calibrated(given)
    assert found.dark_current_e_per_s is None
    assert "dark_current_e_per_s" not in found.covariance.names
    assert "light_in_darks" in {flag.name for flag in found.flags}
    assert_covers(found, given)


def test_black_that_is_hardly_clipped_is_in_the_error() -> None:
    given = noise_sets.hardly_clipped(SEEDS[0])
    assert 0.0 < max(level.samples.zero_fraction for level in given.levels) < 0.005
    assert_covers(calibrated(given), given)


def test_a_sensor_that_warms_up_has_no_single_dark_current() -> None:
    found = calibrated(noise_sets.warming(SEEDS[0]))
    assert found.dark_current_e_per_s is None
    assert "dark_current_changed" in {flag.name for flag in found.flags}


def test_a_wrong_photon_number_is_left_out_of_the_light_and_not_of_the_gain() -> None:
    given = noise_sets.wrong_photons(SEEDS[0])
    found = calibrated(given)
    wrong = [index for index, level in enumerate(found.influence) if level.cause == "wrong_light"]
    assert len(wrong) == 1
    assert bool(found.transfer.used[wrong[0]])
    deviation = found.influence[wrong[0]].mean_off
    # 4 % more or less photons than there were.
    assert deviation is not None
    assert abs(abs(deviation) - 0.04) < 0.01


@pytest.mark.parametrize("at", [0.88, 0.96])
def test_a_wrong_light_between_the_range_of_the_fit_and_saturation_is_named(at: float) -> None:
    sensor = noise_sets.Sensor(seed=SEEDS[0])
    exposures = noise_sets.sweep(sensor, fractions=(*np.linspace(0.05, 0.8, 10), 0.88, 0.96, 1.05, 1.12))
    full_e = (sensor.full_dn - sensor.black_dn) / sensor.gain
    wrong = next(one for one in exposures if np.isclose(one.light_e, at * full_e))
    wrong.time_s *= 1.08
    found = calibrated(noise_sets.noise_set(sensor, exposures, wrong=[wrong]))
    assert [flag.name for flag in named(found)] == ["wrong_light"]
    assert names_level(named(found)[0], wrong.level().mean_dn)
    assert found.transfer.saturation is not None


def test_a_change_of_gain_that_saturates_all_but_one_level_behind_it_is_refused() -> None:
    # Darks show the step, and the light of levels that are too bright for the fit.
    sensor = noise_sets.Sensor(seed=SEEDS[0])
    fractions = np.linspace(0.04, 0.98, 14)
    exposures = noise_sets.sweep(sensor, fractions=fractions, gain_of=lambda place: 1.3 if place >= 7 else 1.0)
    with pytest.raises(RefusedFramesError) as refusal:
        calibrated(noise_sets.noise_set(sensor, exposures))
    assert [flag.name for flag in refusal.value.flags if flag.refuses] == ["gain_changed"]


def test_offsets_of_pixels_that_rounding_hides_in_the_dark_are_no_light() -> None:
    sensor = noise_sets.Sensor(seed=SEEDS[0], bits=8, gain=0.02, read_e=8.0, black_dn=3.0)
    found = calibrated(noise_sets.noise_set(sensor, noise_sets.sweep(sensor)))
    assert "light_in_darks" not in {flag.name for flag in found.flags}
    assert "quantisation_limited" in {flag.name for flag in found.flags}


# Told though the odds are for the bend, or for a fixed number: this level alone speaks for them.
@pytest.mark.parametrize(("seed", "factor"), [(105, 1.012), (106, 1.014)])
def test_what_a_bend_explains_as_well_as_a_wrong_level_is_named_with_both(seed: int, factor: float) -> None:
    given = noise_sets.good_lamp(seed)
    faintest = min((level for level in given.levels if level.kind == "flat"), key=lambda level: level.mean_dn)
    assert faintest.photons is not None
    off = replace(faintest, photons=faintest.photons / factor)
    found = calibrate_noise([off if level is faintest else level for level in given.levels], bit_depth=given.bits)
    flags = named(found)
    assert [flag.name for flag in flags] == ["unclear_level"]
    assert names_level(flags[0], faintest.mean_dn)
    assert "all levels bend, scatter or are late by more than usual" in flags[0].message
    # Nothing is left out of a response whose curve may be right.
    assert found.influence[0].cause == "unclear_level"
    assert found.transfer.linearity is not None
    assert "named as wrong" not in first_lines(found)[0]


def test_a_level_that_alone_speaks_for_an_unusual_shutter_is_unclear() -> None:
    given = drawn_ten_errors(42)
    flags = named(calibrated(given))
    assert [flag.name for flag in flags] == ["unclear_level"]
    assert names_level(flags[0], given.wrong_means_dn[0])


def test_a_fixed_time_that_is_usual_is_told_and_blames_no_level() -> None:
    given = drawn_ten_errors(28)
    found = calibrated(given)
    assert named(found) == []
    told = [flag.message for flag in found.flags if flag.name == "exposure_offset"]
    assert len(told) == 1
    assert f"mean {given.wrong_means_dn[0]:.4g} DN" in told[0]
    assert "all exposures are shorter than stated by 0.0028 ms" in told[0]


def test_a_lamp_sweep_is_not_told_to_expose_longer() -> None:
    found = calibrated(noise_sets.good_lamp(SEEDS[0]))
    (message,) = [flag.message for flag in found.flags if flag.name == "saturation_not_reached"]
    assert "a brighter lamp" in message
    assert not any("longer exposures" in text for text in (message, *first_lines(found)))


def test_the_worst_is_told_first() -> None:
    found = calibrated(noise_sets.wrong_photons(SEEDS[0]))
    assert found.flags[0].level is not None


def test_influence_is_the_change_of_the_gain_by_leaving_a_level_out() -> None:
    found = calibrated(noise_sets.good(SEEDS[0]))
    shifts = np.array([level.gain_shift_errors for level in found.influence if level.gain_shift_errors is not None])
    assert len(shifts) == np.count_nonzero(found.transfer.used)
    # A level of sixteen holds a quarter of the gain's error by itself, a few errors at the ends at most.
    assert 0.0 < np.abs(shifts).max() < 4.0


@pytest.mark.parametrize(("name", "bound"), [("saturation_e", ">"), ("read_noise_e", "<"), ("dsnu_e", "<")])
def test_what_is_not_known_has_a_bound(name: str, bound: str) -> None:
    given = noise_sets.coarse(SEEDS[0])
    found = calibrated(given)
    assert getattr(found, name) is None
    assert found.bounds[name].bound == bound
    if name in given.truth:
        assert given.truth[name] < found.bounds[name].value


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
