"""Every kind of bad input by its own name: refused where numbers would be wrong, flagged where they are not."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.estimate import Estimate
from calibration.results import CalibrationError, Flag, RefusedFramesError
from calibration.sensor.findings import StatedExposures, frame_flags, parameter_flags
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

Frame = NDArray[np.uint16]
Change = Callable[[Frame], Frame]
Levels = list[LevelStatistics]
SHAPE = (64, 96)


@cache
def raw_frames(*, saturating: bool = False) -> tuple[tuple[LevelKind, float, tuple[Frame, ...]], ...]:
    """A good sweep, into saturation or not: kind, exposure and frames of each level."""
    camera = SyntheticCamera(SyntheticSensor(shape=(56, 56) if saturating else SHAPE), 1 if saturating else 21)
    signals = SATURATING_SIGNALS_E if saturating else SIGNALS_E
    exposures = SATURATING_EXPOSURES_S if saturating else EXPOSURES_S
    found: list[tuple[LevelKind, float, tuple[Frame, ...]]] = []
    for index, (light_e, exposure_s) in enumerate(zip(signals, exposures, strict=True)):
        n = 8 if saturating and index == 6 else 2
        found.append(("flat", exposure_s, tuple(camera.frames(n, light_e=light_e, exposure_s=exposure_s))))
        found.append(("dark", exposure_s, tuple(camera.frames(n, light_e=0.0, exposure_s=exposure_s))))
    return tuple(found)


def levels(change: Change = lambda frame: frame, *, kinds: str = "dark flat", saturating: bool = False) -> Levels:
    return [
        level_statistics([change(frame) if kind in kinds else frame for frame in frames], kind=kind, exposure_s=time_s)
        for kind, time_s, frames in raw_frames(saturating=saturating)
    ]


def sweep(
    sensor: SyntheticSensor, seed: int, *, signals_e: Sequence[float] = SIGNALS_E, flicker: float = 0.0
) -> Levels:
    return SyntheticCamera(sensor, seed).sweep(signals_e=signals_e, exposures_s=EXPOSURES_S, flicker=flicker)


def timed(given: Levels, factor: float) -> Levels:
    return [replace(level, exposure_s=factor * (level.exposure_s or 0.0)) for level in given]


def flags(given: Levels, *, bit_depth: int = 12) -> dict[str, Flag]:
    try:
        found = calibrate_noise(given, bit_depth=bit_depth).flags
    except RefusedFramesError as error:
        found = error.flags
    return {flag.name: flag for flag in found}


def names(calibration: NoiseCalibration) -> set[str]:
    return {flag.name for flag in calibration.flags}


def test_a_good_sweep_is_only_told_that_it_saturates() -> None:
    assert set(flags(levels(saturating=True))) == {"saturated_levels"}
    assert set(flags(levels())) == {"saturation_not_reached"}


def shifted(bits: int) -> Levels:
    return levels(lambda frame: np.left_shift(frame, np.uint16(bits)), saturating=True)


def replaced(index: int, frames: Sequence[Frame]) -> Levels:
    """The saturating sweep with other frames in one level."""
    kind, exposure_s, _ = raw_frames(saturating=True)[index]
    given = levels(saturating=True)
    given[index] = level_statistics(frames, kind=kind, exposure_s=exposure_s)
    return given


def repeated(*places: int) -> Levels:
    """Level 4 holds the first frames of levels, itself or another, that are there already."""
    frames = [raw_frames(saturating=True)[place][2][0] for place in places]
    return replaced(4, frames)


def lit_dark() -> Levels:
    bright = SyntheticCamera(SyntheticSensor(), 16).level(2, kind="dark", light_e=18_000.0, exposure_s=0.03)
    return [*levels(saturating=True), bright]


def still() -> Levels:
    return levels(lambda frame: np.full_like(frame, round(frame.mean() / 4.0)))


def swapped() -> Levels:
    return [replace(one, kind="dark" if one.kind == "flat" else "flat") for one in levels()]


def mixed_light() -> Levels:
    frames = [one for _, _, one in raw_frames(saturating=True)]
    given = replaced(4, [*frames[4], *frames[8]])
    del given[8]
    return given


def blurred(share: float) -> Levels:
    kernel = np.array([[0.0, share, 0.0], [share, 1.0 - 4.0 * share, share], [0.0, share, 0.0]])
    return levels(lambda frame: np.rint(cv2.filter2D(frame.astype(np.float64), -1, kernel)).astype(np.uint16))


def mosaic(contrast: float) -> Levels:
    gains = np.ones(SHAPE)
    gains[::2, ::2] = 1.0 - contrast
    return levels(lambda frame: np.rint(60.0 + gains * (frame - 60.0)).astype(np.uint16), kinds="flat")


def striped(shape: tuple[int, int]) -> Levels:
    draws = np.random.default_rng(3)
    # 1 DN beside 2.5 DN of each pixel.
    return levels(lambda frame: np.rint(frame + draws.normal(0.0, 1.0, shape)).astype(np.uint16))


def banded(depth: float) -> Levels:
    """A lamp on a rolling shutter: 0.4 % of 1800 DN are 5 DN rms beside 20 DN of photons."""
    draws, phases = np.random.default_rng(5), 2.0 * np.pi * np.arange(SHAPE[0])[:, None] / 17.0

    def change(frame: Frame) -> Frame:
        light = 1.0 + depth * np.sin(phases + draws.uniform(0.0, 2.0 * np.pi))
        return np.rint(60.0 + light * (frame - 60.0)).astype(np.uint16)

    return levels(change, kinds="flat")


def uneven() -> Levels:
    camera = SyntheticCamera(SyntheticSensor(), 4)
    camera.response_map *= np.linspace(0.97, 1.03, camera.sensor.shape[1])
    return camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)


def changed(kind: str, change: Callable[[LevelStatistics], Any], *, saturating: bool = False) -> Levels:
    return [replace(level, **change(level)) if level.kind == kind else level for level in levels(saturating=saturating)]


def darkening() -> Levels:
    return changed("dark", lambda one: {"mean_dn": one.mean_dn - 20.0 * (one.exposure_s or 0.0) / EXPOSURES_S[-1]})


def few_photons() -> Levels:
    return changed("flat", lambda one: {"photons": 5e5 * (one.exposure_s or 0.0)})


def scattered() -> Levels:
    draws = np.random.default_rng(7)
    return changed(
        "flat",
        lambda level: {"temporal_variance_dn2": level.temporal_variance_dn2 * (1.0 + 0.1 * draws.standard_normal())},
        saturating=True,
    )


def clamped() -> Levels:
    given = sweep(SyntheticSensor(dark_current_e_per_s=200_000.0, shape=(96, 96)), 12)
    return [replace(level, mean_dn=60.0) if level.kind == "dark" else level for level in given]


def dimmed() -> Levels:
    """The lamp goes down by a third after the sixth exposure."""
    late = EXPOSURES_S[6]
    return [
        replace(one, exposure_s=(one.exposure_s or 0.0) * (1.5 if (one.exposure_s or 0) >= late else 1.0))
        for one in levels()
    ]


def unsteady() -> Levels:
    draws = np.random.default_rng(4)
    signals_e = [light_e * (1.0 + 0.03 * draws.standard_normal()) for light_e in SIGNALS_E]
    return sweep(SyntheticSensor(shape=SHAPE), 22, signals_e=signals_e)


def falling(share: float = 0.7) -> Levels:
    """Level 8 has less light than the one before."""
    return sweep(SyntheticSensor(), 3, signals_e=[*SIGNALS_E[:8], share * SIGNALS_E[7], *SIGNALS_E[9:]])


WARM = SyntheticSensor(shape=(160, 160), dark_current_e_per_s=5000.0, dsnu_e=1.0)


BENT = SyntheticSensor(shape=(160, 160), response=lambda dn: dn * (1.0 - dn / 100_000.0))
GAMMA = SyntheticSensor(response=lambda dn: 4000.0 * (np.maximum(dn, 0.0) / 4000.0) ** (1 / 2.2))
EIGHT_BIT_GAMMA: Change = lambda frame: np.rint(255.0 * (frame / 4095.0) ** (1.0 / 2.2)).astype(np.uint16)  # noqa: E731
STRETCHED: Change = lambda frame: np.left_shift(frame, np.uint16(4)) | np.right_shift(frame, np.uint16(8))  # noqa: E731
FEW_BITS: Change = lambda frame: np.full_like(frame, 255) if frame.mean() > 3000.0 else frame  # noqa: E731


@pytest.mark.parametrize(
    ("make", "bit_depth", "flag", "refuses", "said"),
    [
        (lambda: shifted(4), 16, "left_justified", True, "multiples of 16"),
        (lambda: shifted(4), 12, "left_justified", True, "multiples of 16"),
        (lambda: shifted(1), 16, "left_justified", True, "multiples of 2,"),
        (lambda: levels(saturating=True), 10, "wrong_bit_depth", True, "at least 12 bits"),
        (lambda: levels(saturating=True), 16, "wrong_bit_depth", True, "pile up"),
        # 3160 of 65535 DN: it may be a camera of 16 bits in dim light.
        (lambda: sweep(SyntheticSensor(bit_depth=16), 1), 16, "wrong_bit_depth", False, "brighter flats"),
        (lambda: levels(FEW_BITS), 12, "mixed_bit_depth", True, "full scale of 8 bits"),
        (lambda: levels(lambda frame: np.floor(1.5 * frame).astype(np.uint16)), 13, "missing_codes", False, "digital"),
        # The upper bits once more below, so that no bit is unused: a gain 16 times too large.
        (lambda: levels(STRETCHED), 16, "missing_codes", True, "not stretched"),
        # Black level at one standard deviation of the dark noise.
        (lambda: sweep(SyntheticSensor(black_level_dn=2.5), 1), 12, "clipped_black", True, "raise the camera's black"),
        (lambda: repeated(4, 4), 12, "repeated_frames", True, "copies"),
        (lambda: repeated(2, 4), 12, "repeated_frames", True, "copies"),
        (lit_dark, 12, "saturated_dark", True, ""),
        (still, 12, "no_noise", True, ""),
        (mixed_light, 12, "mixed_level", True, ""),
        (lambda: sweep(SyntheticSensor(), 2, flicker=0.02), 12, "unsteady_level", False, ""),
        (lambda: sweep(SyntheticSensor(shape=(160, 160)), 25, flicker=0.003), 12, "lamp_flicker", False, ""),
        (falling, 12, "non_monotonic_sweep", False, ""),
        (uneven, 12, "uneven_light", False, ""),
        (lambda: sweep(GAMMA, 5), 12, "not_photon_noise", True, ""),
        # The variance is largest at the darkest flats, which looks like an early saturation.
        (lambda: levels(EIGHT_BIT_GAMMA, saturating=True), 8, "not_photon_noise", True, ""),
        (lambda: sweep(BENT, 6), 12, "bent_photon_transfer", False, ""),
        (lambda: sweep(BENT, 6), 12, "response_not_linear", False, "off its slope"),
        (scattered, 12, "scattered_photon_transfer", False, ""),
        (clamped, 12, "black_clamp", False, ""),
        (dimmed, 12, "light_not_constant", False, ""),
        (unsteady, 12, "unsteady_lamp", False, ""),
        (lambda: blurred(0.1), 12, "correlated_noise", True, "noise reduction"),
        # Neighbours of a pixel get 2 %: their noise goes together by some 2 * 0.02 / 0.92.
        (lambda: blurred(0.02), 12, "correlated_noise", False, ""),
        (lambda: mosaic(0.4), 12, "colour_mosaic", True, "--plane"),
        (lambda: mosaic(0.06), 12, "colour_mosaic", False, "--plane"),
        (lambda: striped((SHAPE[0], 1)), 12, "row_noise", False, "DN by row"),
        (lambda: striped((1, SHAPE[1])), 12, "row_noise", False, "DN by column"),
        (lambda: banded(0.004), 12, "banded_light", False, ""),
        (lambda: banded(0.02), 12, "banded_light", True, ""),
        (lambda: [one for one in levels() if one.kind == "flat"], 12, "missing_levels", True, "One of each"),
        (lambda: [one for one in levels() if one.kind == "dark"], 12, "missing_levels", True, "One of each"),
        (lambda: levels(lambda frame: np.full_like(frame, 4095), kinds="flat"), 12, "no_usable_level", True, ""),
        (swapped, 12, "darks_brighter_than_flats", True, ""),
        (lambda: [*levels(), *levels(saturating=True)], 12, "mixed_size", True, "differ in size"),
        # 2000 e-/s over 12 ms, the times read as a thousandth: 2e6 e-/s. Where they were stated was not said.
        (lambda: timed(sweep(WARM, 23), 1e-3), 12, "wrong_time_unit", False, "with --exposure-unit ns, us, ms or s"),
        (lambda: timed(levels(), 0.0), 12, "wrong_time_unit", True, ""),
        (lambda: timed(levels(), 1e-6), 12, "wrong_time_unit", True, ""),
        (lambda: timed(levels(), 1e6), 12, "wrong_time_unit", True, ""),
        (darkening, 12, "negative_dark_current", False, ""),
        (few_photons, 12, "quantum_efficiency_above_one", False, ""),
    ],
)  # fmt: skip
def test_a_finding_has_its_name(
    make: Callable[[], Levels], bit_depth: int, flag: str, refuses: bool, said: str
) -> None:
    found = flags(make(), bit_depth=bit_depth)
    assert found[flag].refuses is refuses
    assert said in found[flag].message
    # One cause has one name.
    if flag in ("left_justified", "mixed_bit_depth"):
        assert not {"wrong_bit_depth", "missing_codes", "no_noise"} & set(found)


def test_a_flat_whose_frames_are_dark_is_named() -> None:
    given = falling(0.0)
    dark_flat = next(one for one in given if one.kind == "flat" and one.exposure_s == EXPOSURES_S[8])
    named = {flag.level for flag in calibrate_noise(given, bit_depth=12).flags if flag.level is not None}
    assert named == {describe_level(dark_flat)}


def test_saturated_frames_may_be_equal() -> None:
    # All pixels at full scale but a dead one.
    full = np.full((56, 56), 4095, dtype=np.uint16)
    full[3, 4] = 60
    saturated = level_statistics([full, full.copy()], kind="flat", exposure_s=0.03)
    assert set(flags([*levels(saturating=True), saturated])) == {"saturated_levels"}


def test_cosmic_hits_are_flagged_and_do_no_harm() -> None:
    def hit(frames: tuple[Frame, ...]) -> list[Frame]:
        first = frames[0].copy()
        first[5, 7] = 4000
        return [first, *frames[1:]]

    clean = calibrate_noise(levels(saturating=True), bit_depth=12).read_noise_e
    found = calibrate_noise(
        [level_statistics(hit(f), kind=kind, exposure_s=time_s) for kind, time_s, f in raw_frames(saturating=True)],
        bit_depth=12,
    )
    assert "outlier_pixels" in names(found)
    assert clean is not None
    assert found.read_noise_e is not None
    assert abs(found.read_noise_e.value - clean.value) < clean.std_error


def test_a_sweep_that_stops_early_has_no_saturation() -> None:
    calibration = calibrate_noise(levels(), bit_depth=12)
    assert calibration.saturation_e is None
    assert "saturation_not_reached" in names(calibration)


def test_darks_of_one_or_unknown_exposure_give_no_dark_current() -> None:
    given = levels(saturating=True)
    one_dark = [level for level in given if level.kind == "flat" or level.exposure_s == EXPOSURES_S[6]]
    for changed, also in (
        (one_dark, {"dark_exposure_missing"}),
        ([replace(one, exposure_s=None) for one in given], set()),
    ):
        calibration = calibrate_noise(changed, bit_depth=12)
        assert calibration.dark_current_e_per_s is None
        assert "dark_current_e_per_s" not in calibration.covariance.names
        assert {"single_dark_exposure"} | also <= names(calibration)


def test_a_dark_current_within_its_error_is_flagged_and_given() -> None:
    calibration = calibrate_noise(sweep(SyntheticSensor(dark_current_e_per_s=1.0), 15), bit_depth=12)
    assert "dark_current_not_resolved" in names(calibration)
    assert calibration.dark_current_e_per_s is not None


@pytest.mark.parametrize(("signals_e", "seed"), [(SIGNALS_E[:3], 9), ((9000.0,), 10)])
def test_few_levels_are_flagged_and_enough_for_a_gain(signals_e: tuple[float, ...], seed: int) -> None:
    given = SyntheticCamera(SyntheticSensor(), seed).sweep(
        signals_e=signals_e, exposures_s=[one / 1e6 for one in signals_e], stack_index=1
    )
    calibration = calibrate_noise(given, bit_depth=12)
    assert "too_few_levels" in names(calibration)
    gain = calibration.gain_dn_per_e
    assert abs(gain.value - 0.25) < 5.0 * gain.std_error


def test_noise_below_half_a_count_is_not_called_a_read_noise() -> None:
    sensor = SyntheticSensor(gain_dn_per_e=0.04, read_noise_e=5.0, black_level_dn=60.3)
    signals_e = np.linspace(3000.0, 75_000.0, 12).tolist()
    given = SyntheticCamera(sensor, 11).sweep(signals_e=signals_e, exposures_s=[one / 1e6 for one in signals_e])
    calibration = calibrate_noise(given, bit_depth=12)
    assert calibration.read_noise_e is None
    assert "read_noise_e" not in calibration.covariance.names
    assert "quantisation_limited" in names(calibration)
    gain = calibration.gain_dn_per_e
    assert abs(gain.value - 0.04) < 5.0 * gain.std_error


def test_a_read_noise_below_that_of_dark_current_is_not_given_a_number() -> None:
    # 180 to 3600 e- of dark current: the variance at no exposure, 2 DN^2, is known to some 4.
    sensor = SyntheticSensor(gain_dn_per_e=1.0, read_noise_e=1.5, dark_current_e_per_s=300_000.0, bit_depth=14)
    calibration = calibrate_noise(sweep(sensor, 17), bit_depth=14)
    assert calibration.read_noise_e is None
    assert "read_noise_not_resolved" in names(calibration)


@pytest.mark.parametrize(("prnu", "dsnu_e", "missing"), [(0.0, 4.0, "prnu"), (0.01, 0.0, "dsnu")])
def test_a_fixed_pattern_below_the_noise_is_not_given_a_number(prnu: float, dsnu_e: float, missing: str) -> None:
    calibration = calibrate_noise(sweep(SyntheticSensor(prnu=prnu, dsnu_e=dsnu_e), 13), bit_depth=12)
    assert (calibration.prnu is None) == (missing == "prnu")
    assert (calibration.dsnu_e is None) == (missing == "dsnu")
    assert f"{missing}_not_resolved" in names(calibration)


@pytest.mark.parametrize("bit_depth", [0, 17])
def test_bit_depths_that_no_sample_has_are_refused(bit_depth: int) -> None:
    with pytest.raises(CalibrationError, match="1 to 16"):
        calibrate_noise(levels(), bit_depth=bit_depth)


def test_a_camera_that_saturates_below_full_scale_is_told_so() -> None:
    # All pixels of the brightest flats stand at 3800 of 4095: they do not change, and are no computed pictures.
    given = levels(lambda frame: np.minimum(frame, np.uint16(3800)), saturating=True)
    calibration = calibrate_noise(given, bit_depth=12)
    assert names(calibration) == {"low_ceiling", "saturated_levels"}
    assert "3800" in next(flag.message for flag in calibration.flags if flag.name == "low_ceiling")
    # The gain is that of the same frames without it: only saturated levels differ.
    gain = calibrate_noise(levels(saturating=True), bit_depth=12).gain_dn_per_e
    assert abs(calibration.gain_dn_per_e.value - gain.value) < gain.std_error


def test_a_black_level_taken_off_after_saturation_is_no_picture_without_noise() -> None:
    # Each exposure has a ceiling of its own.
    taken_off = [
        level_statistics([f - np.uint16(index) for f in frames], kind=kind, exposure_s=time_s)
        for index, (kind, time_s, frames) in enumerate(raw_frames(saturating=True))
    ]
    assert not any(flag.refuses for flag in calibrate_noise(taken_off, bit_depth=12).flags)


def test_what_rounding_hides_in_the_dark_has_no_small_error() -> None:
    # Dark noise of 0.16 DN hardly crosses half a count: darks are alike, no copies, and 0.25 DN off.
    sensor = SyntheticSensor(gain_dn_per_e=1.0 / 64.0, bit_depth=8, black_level_dn=3.75, shape=(96, 96))
    calibration = calibrate_noise(sweep(sensor, 19), bit_depth=8)
    assert "quantisation_limited" in names(calibration)
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
    assert "light_not_constant" not in flags(sweep(sensor, 27))


def test_a_lamp_that_hardly_flickers_is_not_flagged() -> None:
    assert "lamp_flicker" not in flags(sweep(SyntheticSensor(shape=(160, 160)), 25, flicker=0.0003))


def test_frames_that_went_through_jpeg_are_refused() -> None:
    def through_jpeg(frame: Frame) -> Frame:
        small = np.clip(np.rint(frame / 16.0), 0, 255).astype(np.uint8)
        packed = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1]
        return cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE).astype(np.uint16)

    # Which of these comes first depends on how much noise the format has left.
    refusing = {name for name, flag in flags(levels(through_jpeg), bit_depth=8).items() if flag.refuses}
    assert refusing & {"correlated_noise", "repeated_frames", "no_noise", "not_photon_noise"}


def test_dim_flats_with_row_noise_are_not_called_filtered_or_banded() -> None:
    draws, camera = np.random.default_rng(6), SyntheticCamera(SyntheticSensor(shape=SHAPE), 24)

    def striped_level(kind: LevelKind, light_e: float, exposure_s: float) -> LevelStatistics:
        frames = camera.frames(2, light_e=light_e, exposure_s=exposure_s)
        noisy = [np.rint(frame + draws.normal(0.0, 2.0, (SHAPE[0], 1))).astype(np.uint16) for frame in frames]
        return level_statistics(noisy, kind=kind, exposure_s=exposure_s)

    # 200 e- at most: 2 DN of each row's noise beside 2.5 DN of read noise and 3.5 DN of photons.
    dim = [striped_level("flat", 20.0 * place, 1e-3 * place) for place in range(1, 11)]
    found = flags([*dim, *(striped_level("dark", 0.0, 1e-3 * place) for place in range(1, 11))])
    assert "row_noise" in found
    assert not {"correlated_noise", "banded_light"} & set(found)


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        (StatedExposures(where="the column x", unit="ms"), "if the column x has seconds, it is"),
        (StatedExposures(where="the descriptor", unit="ns"), "--exposure-unit us"),
        (StatedExposures(where="the names of the images"), "with --exposure-unit ns, us, ms or s"),
        (StatedExposures(where="the record of the run", unit="s", has_option=False), "correct the record of the run"),
    ],
)
def test_advice_on_a_unit_is_about_where_exposures_are_stated(stated: StatedExposures, said: str) -> None:
    found = frame_flags(timed(levels(), 2e-7 / max(EXPOSURES_S)), bit_depth=12, stated=stated)
    (flag,) = [flag for flag in found if flag.name == "wrong_time_unit"]
    assert said in flag.message
    assert f"read from {stated.where}" in flag.message
    assert ("nanoseconds" in flag.message) is (stated.unit == "ns")
    assert ("--exposure-unit" in flag.message) is stated.has_option


@pytest.mark.parametrize(
    ("value", "error", "said"),
    [
        (0.028, 0.004, "below 0.04 e-/s, as of cooled sensors"),
        (0.0, 1e-3, "--exposure-unit us"),
        (2.8e4, 4e3, "above 1.6e+04 e-/s, as of hot or infrared sensors"),
        (2.8e4, 4e3, "--exposure-unit s"),
        (28.0, 4.0, None),
        (0.05, 0.04, None),
        (6e3, 1e3, None),
        (-0.2, 1e-3, None),
    ],
)
def test_a_dark_current_of_few_cameras_may_be_one_of_another_unit(value: float, error: float, said: str | None) -> None:
    stated = StatedExposures(where="the column exposure_ms", unit="ms")
    current = Estimate(value=value, std_error=error, n=20)
    given = parameter_flags(dark_current_e_per_s=current, quantum_efficiency=None, stated=stated)
    found = [flag for flag in given if flag.name == "unusual_dark_current"]
    assert [said in flag.message and not flag.refuses for flag in found if said] == [True] * bool(said)
    assert len(found) == bool(said)


@pytest.mark.parametrize(("share", "refuses"), [(0.5, True), (0.06, False), (0.0, None)])
def test_frames_that_the_camera_averaged_in_time(share: float, refuses: bool | None) -> None:
    camera, given = SyntheticCamera(SyntheticSensor(shape=(160, 160)), 33), []
    kinds: tuple[tuple[LevelKind, float], ...] = (("flat", 8000.0), ("dark", 0.0))
    for kind, light_e in kinds:
        frames = camera.frames(12, light_e=light_e, exposure_s=0.008)
        mixed = [frames[0].astype(np.float64)]
        for frame in frames[1:]:
            mixed.append(share * mixed[-1] + (1.0 - share) * frame)
        # The first half lets the mixture settle.
        given.append(level_statistics([np.rint(f).astype(np.uint16) for f in mixed[6:]], kind=kind, exposure_s=0.008))
    flag = flags(given).get("frames_go_together")
    assert (None if flag is None else flag.refuses) is refuses


def test_cosmic_hits_are_no_memory() -> None:
    camera = SyntheticCamera(SyntheticSensor(shape=(160, 160)), 34)
    frames = camera.frames(3, light_e=8000.0, exposure_s=0.008)
    for place, frame in enumerate(frames):
        frame[place::40, ::37] = 4000
    lag = level_statistics(frames, kind="flat", exposure_s=0.008).lag
    assert lag is not None
    # Some of the hits lie within what noise does; five standard errors of the other pixels.
    assert abs(lag[0]) < 5.0 * lag[1]


def test_rounding_that_hides_the_noise_is_no_memory() -> None:
    camera = SyntheticCamera(SyntheticSensor(gain_dn_per_e=0.01, shape=(96, 96)), 35)
    given = camera.sweep(signals_e=[100.0 * one for one in SIGNALS_E[:6]], exposures_s=EXPOSURES_S[:6], stack_index=2)
    assert "frames_go_together" not in flags(given)
