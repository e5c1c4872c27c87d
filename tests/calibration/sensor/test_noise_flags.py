"""Every kind of bad input by its own name: refused where numbers would be wrong, flagged where they are not."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.results import CalibrationError, Flag, RefusedFramesError
from calibration.sensor.levels import LevelKind, LevelStatistics, describe_level, level_statistics
from calibration.sensor.noise import NoiseCalibration, calibrate_noise
from tests.calibration.sensor.synthetic_sensor import (
    EXPOSURES_S,
    SATURATING_EXPOSURES_S,
    SATURATING_SIGNALS_E,
    SIGNALS_E,
    SyntheticCamera,
    SyntheticSensor,
)

Frames = list[NDArray[np.uint16]]


@cache
def raw_frames() -> tuple[tuple[LevelKind, float, Frames], ...]:
    """A good sweep into saturation: kind, exposure, frames."""
    camera = SyntheticCamera(SyntheticSensor(), 1)
    groups: list[tuple[LevelKind, float, Frames]] = []
    for index, (light_e, exposure_s) in enumerate(zip(SATURATING_SIGNALS_E, SATURATING_EXPOSURES_S, strict=True)):
        n = 8 if index == 6 else 2
        groups.append(("flat", exposure_s, camera.frames(n, light_e=light_e, exposure_s=exposure_s)))
        groups.append(("dark", exposure_s, camera.frames(n, light_e=0.0, exposure_s=exposure_s)))
    return tuple(groups)


def levels(change: Callable[[Frames], Frames] = list) -> list[LevelStatistics]:
    return [level_statistics(change(f), kind=kind, exposure_s=time_s) for kind, time_s, f in raw_frames()]


def refused(given: list[LevelStatistics], *, bit_depth: int = 12) -> dict[str, Flag]:
    with pytest.raises(RefusedFramesError) as caught:
        calibrate_noise(given, bit_depth=bit_depth)
    flags = {flag.name: flag for flag in caught.value.flags}
    # The message of the error names what refuses.
    assert all(flag.name in str(caught.value) for flag in flags.values() if flag.refuses)
    return flags


def flag_names(calibration: NoiseCalibration) -> set[str]:
    return {flag.name for flag in calibration.flags}


def test_a_good_sweep_is_only_told_that_it_saturates() -> None:
    assert flag_names(calibrate_noise(levels(), bit_depth=12)) == {"saturated_levels"}


@pytest.mark.parametrize(("shift", "bit_depth"), [(4, 16), (4, 12), (1, 16)])
def test_left_justified_samples_are_refused(shift: int, bit_depth: int) -> None:
    shifted = levels(lambda frames: [np.left_shift(frame, np.uint16(shift)) for frame in frames])
    flags = refused(shifted, bit_depth=bit_depth)
    assert flags["left_justified"].refuses
    assert f"multiples of {2**shift}" in flags["left_justified"].message
    assert not {"wrong_bit_depth", "missing_codes"} & set(flags)


def test_samples_above_full_scale_are_refused() -> None:
    flag = refused(levels(), bit_depth=10)["wrong_bit_depth"]
    assert "at least 12 bits" in flag.message


def test_a_ceiling_below_full_scale_is_refused() -> None:
    flag = refused(levels(), bit_depth=16)["wrong_bit_depth"]
    assert "pile up" in flag.message


def test_unused_bits_without_a_ceiling_are_flagged() -> None:
    # 12 000 e- at 0.25 DN/e- reach 3160 of 65535 DN: it may be a camera of 16 bits in dim light.
    calibration = calibrate_noise(
        SyntheticCamera(SyntheticSensor(bit_depth=16), 1).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S),
        bit_depth=16,
    )
    assert "wrong_bit_depth" in flag_names(calibration)


def test_a_clipped_black_level_is_refused() -> None:
    # Black level at one standard deviation of the dark noise.
    camera = SyntheticCamera(SyntheticSensor(black_level_dn=2.5), 1)
    flags = refused(camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S))
    assert flags["clipped_black"].refuses
    assert "raise the camera's black level" in flags["clipped_black"].message


def test_a_frame_saved_twice_is_refused() -> None:
    kind, exposure_s, frames = raw_frames()[4]
    doubled = level_statistics([frames[0], frames[0].copy()], kind=kind, exposure_s=exposure_s)
    assert refused([*levels()[:4], doubled, *levels()[5:]])["repeated_frames"].refuses


def test_a_frame_of_another_level_is_refused() -> None:
    kind, exposure_s, frames = raw_frames()[4]
    stale = level_statistics([raw_frames()[2][2][0], frames[0]], kind=kind, exposure_s=exposure_s)
    assert refused([*levels()[:4], stale, *levels()[5:]])["repeated_frames"].refuses


def test_dark_frames_that_saw_light_are_refused() -> None:
    bright = SyntheticCamera(SyntheticSensor(), 16).level(2, kind="dark", light_e=18_000.0, exposure_s=0.03)
    assert refused([*levels(), bright])["saturated_dark"].refuses


def test_pictures_without_noise_are_refused() -> None:
    still = levels(lambda frames: [np.full_like(f, round(frames[0].mean())) for f in frames])
    assert refused(still)["no_noise"].refuses


def test_saturated_frames_may_be_equal() -> None:
    # All pixels at full scale but a dead one.
    full = np.full((56, 56), 4095, dtype=np.uint16)
    full[3, 4] = 60
    saturated = level_statistics([full, full.copy()], kind="flat", exposure_s=0.03)
    assert flag_names(calibrate_noise([*levels(), saturated], bit_depth=12)) == {"saturated_levels"}


def test_frames_of_different_light_in_one_level_are_refused() -> None:
    kind, exposure_s, frames = raw_frames()[4]
    mixed = level_statistics([*frames, *raw_frames()[8][2]], kind=kind, exposure_s=exposure_s)
    assert refused([*levels()[:4], mixed, *levels()[5:8], *levels()[9:]])["mixed_level"].refuses


def test_frames_that_flicker_are_flagged() -> None:
    camera = SyntheticCamera(SyntheticSensor(), 2)
    sweep = camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S, flicker=0.02)
    assert "unsteady_level" in flag_names(calibrate_noise(sweep, bit_depth=12))


def test_a_mean_that_falls_with_exposure_is_flagged() -> None:
    camera = SyntheticCamera(SyntheticSensor(), 3)
    signals_e = [*SIGNALS_E]
    signals_e[8] = 0.7 * signals_e[7]
    calibration = calibrate_noise(camera.sweep(signals_e=signals_e, exposures_s=EXPOSURES_S), bit_depth=12)
    assert "non_monotonic_sweep" in flag_names(calibration)


def test_a_flat_whose_frames_are_dark_is_named() -> None:
    signals_e = [*SIGNALS_E]
    signals_e[8] = 0.0
    sweep = SyntheticCamera(SyntheticSensor(), 3).sweep(signals_e=signals_e, exposures_s=EXPOSURES_S)
    dark_flat = next(one for one in sweep if one.kind == "flat" and one.exposure_s == EXPOSURES_S[8])
    named = {flag.level for flag in calibrate_noise(sweep, bit_depth=12).flags if flag.level is not None}
    assert named == {describe_level(dark_flat)}


def test_cosmic_hits_are_flagged_and_do_no_harm() -> None:
    def with_hit(frames: Frames) -> Frames:
        hit = frames[0].copy()
        hit[5, 7] = 4000
        return [hit, *frames[1:]]

    clean = calibrate_noise(levels(), bit_depth=12)
    hit = calibrate_noise(levels(with_hit), bit_depth=12)
    assert "outlier_pixels" in flag_names(hit)
    assert clean.read_noise_e is not None
    assert hit.read_noise_e is not None
    assert abs(hit.read_noise_e.value - clean.read_noise_e.value) < clean.read_noise_e.std_error


def test_uneven_light_is_flagged() -> None:
    camera = SyntheticCamera(SyntheticSensor(), 4)
    camera.response_map *= np.linspace(0.97, 1.03, camera.sensor.shape[1])
    calibration = calibrate_noise(camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S), bit_depth=12)
    assert "uneven_light" in flag_names(calibration)


def test_gamma_is_refused() -> None:
    sensor = SyntheticSensor(response=lambda signal_dn: 4000.0 * (np.maximum(signal_dn, 0.0) / 4000.0) ** (1 / 2.2))
    camera = SyntheticCamera(sensor, 5)
    flags = refused(camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S))
    assert flags["not_photon_noise"].refuses


def test_a_bent_curve_is_flagged() -> None:
    sensor = SyntheticSensor(shape=(160, 160), response=lambda signal_dn: signal_dn * (1.0 - signal_dn / 100_000.0))
    sweep = SyntheticCamera(sensor, 6).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)
    assert "bent_photon_transfer" in flag_names(calibrate_noise(sweep, bit_depth=12))


def test_points_beyond_their_errors_are_flagged() -> None:
    draws = np.random.default_rng(7)
    scattered = [
        replace(level, temporal_variance_dn2=level.temporal_variance_dn2 * (1.0 + 0.1 * draws.standard_normal()))
        if level.kind == "flat"
        else level
        for level in levels()
    ]
    assert "scattered_photon_transfer" in flag_names(calibrate_noise(scattered, bit_depth=12))


def test_a_sweep_that_stops_early_has_no_saturation() -> None:
    sweep = SyntheticCamera(SyntheticSensor(), 8).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)
    calibration = calibrate_noise(sweep, bit_depth=12)
    assert calibration.saturation_e is None
    assert "saturation_not_reached" in flag_names(calibration)


def test_darks_of_one_exposure_give_no_dark_current() -> None:
    one_dark = [level for level in levels() if level.kind == "flat" or level.exposure_s == EXPOSURES_S[6]]
    calibration = calibrate_noise(one_dark, bit_depth=12)
    assert calibration.dark_current_e_per_s is None
    assert "dark_current_e_per_s" not in calibration.covariance.names
    assert {"single_dark_exposure", "dark_exposure_missing"} <= flag_names(calibration)


def test_a_dark_current_within_its_error_is_flagged_and_given() -> None:
    camera = SyntheticCamera(SyntheticSensor(dark_current_e_per_s=1.0), 15)
    calibration = calibrate_noise(camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S), bit_depth=12)
    assert "dark_current_not_resolved" in flag_names(calibration)
    assert calibration.dark_current_e_per_s is not None


def test_unknown_exposures_give_no_dark_current() -> None:
    unknown = [replace(level, exposure_s=None) for level in levels()]
    calibration = calibrate_noise(unknown, bit_depth=12)
    assert calibration.dark_current_e_per_s is None
    assert "single_dark_exposure" in flag_names(calibration)


def test_few_levels_are_flagged() -> None:
    sweep = SyntheticCamera(SyntheticSensor(), 9).sweep(
        signals_e=SIGNALS_E[:3], exposures_s=EXPOSURES_S[:3], stack_index=1
    )
    calibration = calibrate_noise(sweep, bit_depth=12)
    assert "too_few_levels" in flag_names(calibration)
    gain = calibration.gain_dn_per_e
    assert abs(gain.value - 0.25) < 5.0 * gain.std_error


def test_one_flat_and_one_dark_pair_are_enough_for_a_gain() -> None:
    sweep = SyntheticCamera(SyntheticSensor(), 10).sweep(signals_e=(9000.0,), exposures_s=(0.009,))
    gain = calibrate_noise(sweep, bit_depth=12).gain_dn_per_e
    assert abs(gain.value - 0.25) < 5.0 * gain.std_error


def test_noise_below_half_a_count_is_not_called_a_read_noise() -> None:
    sensor = SyntheticSensor(gain_dn_per_e=0.04, read_noise_e=5.0, black_level_dn=60.3)
    signals_e = tuple(float(signal) for signal in np.linspace(3000.0, 75_000.0, 12))
    exposures_s = tuple(signal / 1e6 for signal in signals_e)
    calibration = calibrate_noise(
        SyntheticCamera(sensor, 11).sweep(signals_e=signals_e, exposures_s=exposures_s), bit_depth=12
    )
    assert calibration.read_noise_e is None
    assert "read_noise_e" not in calibration.covariance.names
    assert "quantisation_limited" in flag_names(calibration)
    gain = calibration.gain_dn_per_e
    assert abs(gain.value - 0.04) < 5.0 * gain.std_error


def test_a_read_noise_below_that_of_dark_current_is_not_given_a_number() -> None:
    # 180 to 3600 e- of dark current: the variance at no exposure, 2 DN^2, is known to some 4.
    sensor = SyntheticSensor(gain_dn_per_e=1.0, read_noise_e=1.5, dark_current_e_per_s=300_000.0, bit_depth=14)
    sweep = SyntheticCamera(sensor, 17).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)
    calibration = calibrate_noise(sweep, bit_depth=14)
    assert calibration.read_noise_e is None
    assert "read_noise_not_resolved" in flag_names(calibration)


def test_a_camera_that_clamps_its_black_level_is_flagged() -> None:
    sensor = SyntheticSensor(dark_current_e_per_s=200_000.0, shape=(96, 96))
    sweep = SyntheticCamera(sensor, 12).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)
    clamped = [replace(level, mean_dn=60.0) if level.kind == "dark" else level for level in sweep]
    assert "black_clamp" in flag_names(calibrate_noise(clamped, bit_depth=12))


@pytest.mark.parametrize(("prnu", "dsnu_e", "missing"), [(0.0, 4.0, "prnu"), (0.01, 0.0, "dsnu")])
def test_a_fixed_pattern_below_the_noise_is_not_given_a_number(prnu: float, dsnu_e: float, missing: str) -> None:
    camera = SyntheticCamera(SyntheticSensor(prnu=prnu, dsnu_e=dsnu_e), 13)
    calibration = calibrate_noise(camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S), bit_depth=12)
    assert (calibration.prnu is None) == (missing == "prnu")
    assert (calibration.dsnu_e is None) == (missing == "dsnu")
    assert f"{missing}_not_resolved" in flag_names(calibration)


def test_flats_that_are_all_saturated_are_refused() -> None:
    bright = [level for level in levels() if level.kind == "dark" or level.mean_dn > 4000.0]
    with pytest.raises(CalibrationError, match="no flat level can be used"):
        calibrate_noise(bright, bit_depth=12)


@pytest.mark.parametrize("kind", ["dark", "flat"])
def test_dark_and_flat_levels_are_both_needed(kind: str) -> None:
    with pytest.raises(CalibrationError, match="at least one of each"):
        calibrate_noise([level for level in levels() if level.kind == kind], bit_depth=12)


def test_levels_of_different_size_are_refused() -> None:
    camera = SyntheticCamera(SyntheticSensor(shape=(50, 56)), 14)
    other = camera.level(2, kind="dark", light_e=0.0, exposure_s=0.5)
    with pytest.raises(CalibrationError, match="differ in size"):
        calibrate_noise([*levels(), other], bit_depth=12)


@pytest.mark.parametrize("bit_depth", [0, 17])
def test_bit_depths_that_no_sample_has_are_refused(bit_depth: int) -> None:
    with pytest.raises(CalibrationError, match="1 to 16"):
        calibrate_noise(levels(), bit_depth=bit_depth)


def test_a_camera_that_saturates_below_full_scale_is_told_so() -> None:
    # All pixels of the brightest flats stand at 3800 of 4095: they do not change, and are no computed pictures.
    calibration = calibrate_noise(levels(lambda frames: [np.minimum(f, np.uint16(3800)) for f in frames]), bit_depth=12)
    assert flag_names(calibration) == {"low_ceiling", "saturated_levels"}
    message = next(flag.message for flag in calibration.flags if flag.name == "low_ceiling")
    assert "3800" in message
    # The gain is that of the same frames without it: only saturated levels differ.
    unclipped = calibrate_noise(levels(), bit_depth=12)
    assert abs(calibration.gain_dn_per_e.value - unclipped.gain_dn_per_e.value) < unclipped.gain_dn_per_e.std_error


def test_a_black_level_taken_off_after_saturation_is_no_picture_without_noise() -> None:
    # Each exposure has a ceiling of its own.
    taken_off = [
        level_statistics([f - np.uint16(index) for f in frames], kind=kind, exposure_s=time_s)
        for index, (kind, time_s, frames) in enumerate(raw_frames())
    ]
    assert not any(flag.refuses for flag in calibrate_noise(taken_off, bit_depth=12).flags)


def test_gamma_with_a_sweep_into_saturation_is_refused() -> None:
    # The variance is largest at the darkest flats, which looks like an early saturation.
    def toned(frames: Frames) -> Frames:
        return [np.rint(255.0 * (f / 4095.0) ** (1.0 / 2.2)).astype(np.uint16) for f in frames]

    assert refused(levels(toned), bit_depth=8)["not_photon_noise"].refuses


def limited() -> NoiseCalibration:
    """A sensor of 8 bits whose dark noise of 0.16 DN hardly crosses half a count: darks are alike, and 0.25 DN off."""
    sensor = SyntheticSensor(gain_dn_per_e=1.0 / 64.0, bit_depth=8, black_level_dn=3.75, shape=(96, 96))
    return calibrate_noise(SyntheticCamera(sensor, 19).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S), bit_depth=8)


def test_darks_that_rounding_makes_alike_are_no_copies() -> None:
    assert "quantisation_limited" in flag_names(limited())


def test_what_rounding_hides_in_the_dark_has_no_small_error() -> None:
    calibration = limited()
    assert calibration.dsnu_e is None
    assert calibration.dark_current_e_per_s is not None
    for found, truth in ((calibration.dark_current_e_per_s, 400.0), (calibration.black_level_dn, 3.75)):
        # Rounding is off by 0.5 DN at most: 1.7 of its standard deviations.
        assert abs(found.value - truth) < 2.0 * found.std_error
    # Four standard errors: the signal of every flat is off by the same.
    gain = calibration.gain_dn_per_e
    assert abs(gain.value - 1.0 / 64.0) < 4.0 * gain.std_error


def test_a_full_well_below_the_converters_range_is_no_change_of_light() -> None:
    # Charge stops at 9000 e-, the sweep goes on to 12 000.
    sensor = SyntheticSensor(response=lambda signal_dn: np.minimum(signal_dn, 2250.0), shape=(96, 96))
    sweep = SyntheticCamera(sensor, 27).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)
    assert "light_not_constant" not in flag_names(calibrate_noise(sweep, bit_depth=12))
