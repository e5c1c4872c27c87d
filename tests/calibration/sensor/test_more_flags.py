"""Bad input that shows in neighbours, in the values themselves, in the light or in the times: each by its own name."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.estimate import Estimate
from calibration.results import Flag, RefusedFramesError
from calibration.sensor.curves import StatedExposures, impossible_exposures, unusual_dark_current
from calibration.sensor.levels import LevelKind, LevelStatistics, level_statistics
from calibration.sensor.noise import calibrate_noise
from tests.calibration.sensor.synthetic_sensor import EXPOSURES_S, SIGNALS_E, SyntheticCamera, SyntheticSensor

Frame = NDArray[np.uint16]
Change = Callable[[Frame], Frame]
SHAPE = (64, 96)


@cache
def raw_frames() -> tuple[tuple[LevelKind, float, tuple[Frame, ...]], ...]:
    camera = SyntheticCamera(SyntheticSensor(shape=SHAPE), 21)
    found: list[tuple[LevelKind, float, tuple[Frame, ...]]] = []
    for light_e, exposure_s in zip(SIGNALS_E, EXPOSURES_S, strict=True):
        found.append(("flat", exposure_s, tuple(camera.frames(2, light_e=light_e, exposure_s=exposure_s))))
        found.append(("dark", exposure_s, tuple(camera.frames(2, light_e=0.0, exposure_s=exposure_s))))
    return tuple(found)


def levels(change: Change = lambda frame: frame, *, kinds: str = "dark flat") -> list[LevelStatistics]:
    return [
        level_statistics([change(frame) if kind in kinds else frame for frame in frames], kind=kind, exposure_s=time_s)
        for kind, time_s, frames in raw_frames()
    ]


def flags(given: list[LevelStatistics], *, bit_depth: int = 12) -> dict[str, Flag]:
    try:
        found = calibrate_noise(given, bit_depth=bit_depth).flags
    except RefusedFramesError as error:
        found = error.flags
    return {flag.name: flag for flag in found}


NEW = {
    "correlated_noise",
    "frames_go_together",
    "colour_mosaic",
    "row_noise",
    "missing_codes",
    "wrong_time_unit",
    "unusual_dark_current",
    "light_not_constant",
    "response_not_linear",
    "unsteady_lamp",
    "banded_light",
    "darks_brighter_than_flats",
    "negative_dark_current",
    "quantum_efficiency_above_one",
}


def test_a_good_sweep_has_none_of_these() -> None:
    assert not NEW & set(flags(levels()))


def blurred(share: float) -> Change:
    def change(frame: Frame) -> Frame:
        kernel = np.array([[0.0, share, 0.0], [share, 1.0 - 4.0 * share, share], [0.0, share, 0.0]])
        return np.rint(cv2.filter2D(frame.astype(np.float64), -1, kernel)).astype(np.uint16)

    return change


def test_frames_that_were_smoothed_are_refused() -> None:
    flag = flags(levels(blurred(0.1)))["correlated_noise"]
    assert flag.refuses
    assert "noise reduction" in flag.message


def test_noise_that_neighbours_share_a_little_is_flagged() -> None:
    # Neighbours of a pixel get 2 %: their noise goes together by some 2 * 0.02 / 0.92.
    flag = flags(levels(blurred(0.02)))["correlated_noise"]
    assert not flag.refuses


def test_frames_that_went_through_jpeg_are_refused() -> None:
    def through_jpeg(frame: Frame) -> Frame:
        small = np.clip(np.rint(frame / 16.0), 0, 255).astype(np.uint8)
        return cv2.imdecode(
            cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1], cv2.IMREAD_GRAYSCALE
        ).astype(np.uint16)

    # Which of these comes first depends on how much noise the format has left.
    refusing = {name for name, flag in flags(levels(through_jpeg), bit_depth=8).items() if flag.refuses}
    assert refusing & {"correlated_noise", "repeated_frames", "no_noise", "not_photon_noise"}


def mosaic(contrast: float) -> Change:
    def change(frame: Frame) -> Frame:
        gains = np.ones(SHAPE)
        gains[::2, ::2] = 1.0 - contrast
        return np.rint(60.0 + gains * (frame - 60.0)).astype(np.uint16)

    return change


@pytest.mark.parametrize(("contrast", "refuses"), [(0.4, True), (0.06, False)])
def test_a_colour_mosaic(contrast: float, refuses: bool) -> None:
    flag = flags(levels(mosaic(contrast), kinds="flat"))["colour_mosaic"]
    assert flag.refuses is refuses
    assert "--plane" in flag.message


@pytest.mark.parametrize("axis", [0, 1])
def test_noise_that_a_line_shares_is_flagged(axis: int) -> None:
    draws = np.random.default_rng(3)
    shape = (SHAPE[0], 1) if axis == 0 else (1, SHAPE[1])

    def striped(frame: Frame) -> Frame:
        # 1 DN beside 2.5 DN of each pixel.
        return np.rint(frame + draws.normal(0.0, 1.0, shape)).astype(np.uint16)

    flag = flags(levels(striped))["row_noise"]
    assert not flag.refuses
    assert f"DN by {('row', 'column')[axis]}" in flag.message


@pytest.mark.parametrize(("depth", "refuses"), [(0.004, False), (0.02, True)])
def test_a_lamp_that_makes_bands_on_a_rolling_shutter(depth: float, refuses: bool) -> None:
    draws = np.random.default_rng(5)
    phases = 2.0 * np.pi * np.arange(SHAPE[0])[:, None] / 17.0

    def banded(frame: Frame) -> Frame:
        light = 1.0 + depth * np.sin(phases + draws.uniform(0.0, 2.0 * np.pi))
        return np.rint(60.0 + light * (frame - 60.0)).astype(np.uint16)

    # 0.4 % of 1800 DN, 5 DN rms, beside 20 DN of photons: some per cent of the variance.
    assert flags(levels(banded, kinds="flat"))["banded_light"].refuses is refuses


def test_levels_that_are_missing_are_named() -> None:
    assert flags([level for level in levels() if level.kind == "flat"])["missing_levels"].refuses


def test_flats_that_are_all_saturated_are_named() -> None:
    full = levels(lambda frame: np.full_like(frame, 4095), kinds="flat")
    assert flags(full)["no_usable_level"].refuses


def test_darks_and_flats_that_are_mixed_up_are_refused() -> None:
    swapped = [replace(level, kind="dark" if level.kind == "flat" else "flat") for level in levels()]
    assert flags(swapped)["darks_brighter_than_flats"].refuses


def sweep_flags(sensor: SyntheticSensor, *, factor: float = 1.0) -> dict[str, Flag]:
    sweep = SyntheticCamera(sensor, 23).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)
    return flags([replace(level, exposure_s=factor * (level.exposure_s or 0.0)) for level in sweep])


def test_an_absurd_dark_current_is_flagged() -> None:
    # 2000 e-/s over 12 ms, the times read as a thousandth: 2e6 e-/s.
    sensor = SyntheticSensor(shape=(160, 160), dark_current_e_per_s=5000.0, dsnu_e=1.0)
    found = sweep_flags(sensor, factor=1e-3)["wrong_time_unit"]
    assert not found.refuses
    # Where they were stated was not said.
    assert "state its unit with --exposure-unit ns, us, ms or s" in found.message


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        (
            StatedExposures(where="the column exposure_ms", unit="ms"),
            "if seconds stand in the column exposure_ms, it is",
        ),
        (StatedExposures(where="the descriptor", unit="ns"), "--exposure-unit us"),
        (StatedExposures(where="the names of the images"), "with --exposure-unit ns, us, ms or s"),
        (StatedExposures(where="the record of the run", unit="s", has_option=False), "correct the record of the run"),
    ],
)
def test_advice_on_a_unit_is_about_where_exposures_are_stated(stated: StatedExposures, said: str) -> None:
    longest_s = max(EXPOSURES_S)
    given = [replace(level, exposure_s=2e-7 / longest_s * (level.exposure_s or 0.0)) for level in levels()]
    (flag,) = impossible_exposures(given, stated=stated)
    assert said in flag.message
    assert f"read from {stated.where}" in flag.message
    assert ("nanoseconds" in flag.message) is (stated.unit == "ns")
    assert ("--exposure-unit" in flag.message) is stated.has_option


def test_a_dark_mean_that_falls_with_exposure_is_flagged() -> None:
    rising = levels()
    longest = max(EXPOSURES_S)
    falling = [
        replace(level, mean_dn=level.mean_dn - 20.0 * (level.exposure_s or 0.0) / longest)
        if level.kind == "dark"
        else level
        for level in rising
    ]
    assert "negative_dark_current" in flags(falling)


def test_more_electrons_than_photons_are_flagged() -> None:
    stated = [
        replace(level, photons=5e5 * (level.exposure_s or 0.0)) if level.kind == "flat" else level for level in levels()
    ]
    assert "quantum_efficiency_above_one" in flags(stated)


def test_dim_flats_with_row_noise_are_not_called_filtered_or_banded() -> None:
    draws = np.random.default_rng(6)
    camera = SyntheticCamera(SyntheticSensor(shape=SHAPE), 24)

    def striped(kind: LevelKind, light_e: float, exposure_s: float) -> LevelStatistics:
        frames = camera.frames(2, light_e=light_e, exposure_s=exposure_s)
        noisy = [np.rint(frame + draws.normal(0.0, 2.0, (SHAPE[0], 1))).astype(np.uint16) for frame in frames]
        return level_statistics(noisy, kind=kind, exposure_s=exposure_s)

    # 200 e- at most: 2 DN of each row's noise beside 2.5 DN of read noise and 3.5 DN of photons.
    dim = [striped("flat", 20.0 * place, 1e-3 * place) for place in range(1, 11)]
    found = flags([*dim, *(striped("dark", 0.0, 1e-3 * place) for place in range(1, 11))])
    assert "row_noise" in found
    assert not {"correlated_noise", "banded_light"} & set(found)


@pytest.mark.parametrize(("flicker", "flagged"), [(0.003, True), (0.0003, False)])
def test_a_lamp_that_flickers_a_little_is_flagged(flicker: float, flagged: bool) -> None:
    sensor = SyntheticSensor(shape=(160, 160))
    sweep = SyntheticCamera(sensor, 25).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S, flicker=flicker)
    assert ("lamp_flicker" in flags(sweep)) is flagged


def test_files_of_eight_bits_among_others_are_no_copies_of_one_frame() -> None:
    def saved(frame: Frame) -> Frame:
        return np.full_like(frame, 255) if frame.mean() > 3000.0 else frame

    found = flags(levels(saved))
    assert found["mixed_bit_depth"].refuses
    assert "full scale of 8 bits" in found["mixed_bit_depth"].message
    assert "no_noise" not in found


def test_a_digital_gain_is_flagged() -> None:
    flag = flags(levels(lambda frame: np.floor(1.5 * frame).astype(np.uint16)), bit_depth=13)["missing_codes"]
    assert "digital gain" in flag.message
    assert not flag.refuses


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_times_in_a_wrong_unit_are_refused(factor: float) -> None:
    wrong = [replace(level, exposure_s=factor * (level.exposure_s or 0.0)) for level in levels()]
    assert flags(wrong)["wrong_time_unit"].refuses


@pytest.mark.parametrize(
    ("value", "error", "said"),
    [
        (0.028, 0.004, "below 0.04 e-/s, as of cooled sensors"),
        (0.0, 1e-3, "--exposure-unit us"),
        (2.8e4, 4e3, "above 1.6e+04 e-/s, as of hot or infrared sensors"),
        (2.8e4, 4e3, "--exposure-unit s"),
    ],
)
def test_a_dark_current_of_few_cameras_may_be_one_of_another_unit(value: float, error: float, said: str) -> None:
    stated = StatedExposures(where="the column exposure_ms", unit="ms")
    (flag,) = unusual_dark_current(Estimate(value=value, std_error=error, n=20), stated=stated)
    assert said in flag.message
    assert not flag.refuses


@pytest.mark.parametrize(("value", "error"), [(28.0, 4.0), (0.05, 0.04), (6e3, 1e3), (-0.2, 1e-3)])
def test_a_usual_or_uncertain_dark_current_says_nothing_of_units(value: float, error: float) -> None:
    assert unusual_dark_current(Estimate(value=value, std_error=error, n=20)) == ()


def test_exposures_of_nothing_are_refused() -> None:
    assert flags([replace(level, exposure_s=0.0) for level in levels()])["wrong_time_unit"].refuses


def test_light_that_drops_by_a_third_is_flagged() -> None:
    # The lamp goes down after the sixth exposure: all later ones belong to a brighter lamp's shorter exposure.
    late = EXPOSURES_S[6]
    dimmed = [
        replace(level, exposure_s=level.exposure_s * (1.5 if level.exposure_s >= late else 1.0))
        if level.exposure_s is not None
        else level
        for level in levels()
    ]
    assert not flags(dimmed)["light_not_constant"].refuses


def test_a_response_that_bends_is_flagged() -> None:
    sensor = SyntheticSensor(shape=(160, 160), response=lambda signal_dn: signal_dn * (1.0 - signal_dn / 100_000.0))
    found = flags(SyntheticCamera(sensor, 6).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S))
    assert "off its slope" in found["response_not_linear"].message


def test_a_lamp_that_is_unsteady_between_levels_is_flagged() -> None:
    draws = np.random.default_rng(4)
    camera = SyntheticCamera(SyntheticSensor(shape=SHAPE), 22)
    signals_e = [light_e * (1.0 + 0.03 * draws.standard_normal()) for light_e in SIGNALS_E]
    assert "unsteady_lamp" in flags(camera.sweep(signals_e=signals_e, exposures_s=EXPOSURES_S))


def test_samples_that_were_stretched_to_sixteen_bits_are_refused() -> None:
    # The upper bits once more below, so that no bit is unused: 12 bits as 16, and a gain 16 times too large.
    def stretched(frame: Frame) -> Frame:
        return (np.left_shift(frame, np.uint16(4)) | np.right_shift(frame, np.uint16(8))).astype(np.uint16)

    flag = flags(levels(stretched), bit_depth=16)["missing_codes"]
    assert flag.refuses
    assert "not stretched" in flag.message


def averaged(frames: tuple[Frame, ...], share: float) -> list[Frame]:
    """Return frames each of which holds a share of the one before, as cameras that reduce noise in time give them."""
    mixed = [frames[0].astype(np.float64)]
    for frame in frames[1:]:
        mixed.append(share * mixed[-1] + (1.0 - share) * frame)
    return [np.rint(frame).astype(np.uint16) for frame in mixed[len(mixed) // 2 :]]


@pytest.mark.parametrize(("share", "refuses"), [(0.5, True), (0.06, False), (0.0, None)])
def test_frames_that_the_camera_averaged_in_time(share: float, refuses: bool | None) -> None:
    camera = SyntheticCamera(SyntheticSensor(shape=(160, 160)), 33)
    found = []
    kinds: tuple[LevelKind, ...] = ("flat", "dark")
    for kind, light_e in zip(kinds, (8000.0, 0.0), strict=True):
        # The first half lets the mixture settle.
        frames = tuple(camera.frames(12, light_e=light_e, exposure_s=0.008))
        found.append(level_statistics(averaged(frames, share), kind=kind, exposure_s=0.008))
    flag = flags(found).get("frames_go_together")
    assert (None if flag is None else flag.refuses) is refuses


def test_cosmic_hits_are_no_memory() -> None:
    camera = SyntheticCamera(SyntheticSensor(shape=(160, 160)), 34)
    frames = camera.frames(3, light_e=8000.0, exposure_s=0.008)
    for place, frame in enumerate(frames):
        frame[place::40, ::37] = 4000
    lag = level_statistics(frames, kind="flat", exposure_s=0.008).lag
    assert lag is not None
    # Some of the hits lie within what noise does; five standard errors of the other pixels.
    assert abs(lag.share) < 5.0 * lag.std_error


def test_rounding_that_hides_the_noise_is_no_memory() -> None:
    camera = SyntheticCamera(SyntheticSensor(gain_dn_per_e=0.01, shape=(96, 96)), 35)
    sweep = camera.sweep(signals_e=[100.0 * one for one in SIGNALS_E[:6]], exposures_s=EXPOSURES_S[:6], stack_index=2)
    assert "frames_go_together" not in flags(sweep)
