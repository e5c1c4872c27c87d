"""Raw frames as cameras give them, made by NumPy alone: a gain that bends, a readout that couples, mixed light."""

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.results import Flag, RefusedFramesError
from calibration.sensor.levels import LevelKind, LevelStatistics, level_statistics
from calibration.sensor.noise import NoiseCalibration, calibrate_noise, first_lines

FloatArray = NDArray[np.float64]
SHAPE = (128, 160)
GAIN, READ_E, BLACK_DN = 0.4, 8.0, 500.0
LIGHT_E = np.linspace(2000.0, 60_000.0, 12)


def level(kind: LevelKind, exposure_s: float, frames: list[FloatArray]) -> LevelStatistics:
    counts = [np.clip(np.rint(frame), 0, 65535).astype(np.uint16) for frame in frames]
    return level_statistics(counts, kind=kind, exposure_s=exposure_s)


def read_noise(draws: np.random.Generator, coupling: float, axis: int) -> FloatArray:
    """Noise of each pixel and a share of that of the pixel before it, as a slow video amplifier leaves it."""
    white = draws.standard_normal(SHAPE)
    return np.asarray(READ_E * (white + coupling * np.roll(white, 1, axis=axis)))


def coupled(
    coupling: float, axis: int = 1, *, dark_e_per_s: float = 0.0, filtered: bool = False
) -> list[LevelStatistics]:
    draws, levels = np.random.default_rng(5), []
    response = 1.0 + 0.005 * draws.standard_normal(SHAPE)

    def frame(light_e: float) -> FloatArray:
        charge = draws.poisson(light_e * response) + (0.0 if filtered else read_noise(draws, coupling, axis))
        charge = charge + (READ_E * draws.standard_normal(SHAPE) if filtered else 0.0)
        signal = charge + coupling * np.roll(charge, 1, axis=axis) if filtered else charge
        return BLACK_DN + GAIN * signal

    for light_e in LIGHT_E.tolist():
        exposure_s = light_e / 1e6
        for kind, charge_e in (("flat", light_e), ("dark", 0.0)):
            frames = [frame(charge_e + dark_e_per_s * exposure_s) for _ in range(2)]
            levels.append(level("flat" if kind == "flat" else "dark", exposure_s, frames))
    return levels


def flags(found: NoiseCalibration) -> dict[str, Flag]:
    return {flag.name: flag for flag in found.flags}


@pytest.mark.parametrize(
    ("coupling", "axis", "dark_e_per_s", "factor"),
    [(-0.07, 1, 0.0, "0.93"), (-0.07, 0, 0.0, "0.93"), (0.1, 1, 0.0, "1.09"), (-0.07, 1, 5000.0, "0.93")],
    ids=["rows", "columns", "positive", "most darks have more dark current than read noise"],
)
def test_a_readout_that_couples_neighbours_is_told_and_the_numbers_stand(
    coupling: float, axis: int, dark_e_per_s: float, factor: str
) -> None:
    found = calibrate_noise(coupled(coupling, axis, dark_e_per_s=dark_e_per_s), bit_depth=16)
    assert "compressed_frames" not in flags(found)
    flag = flags(found)["readout_correlation"]
    assert not flag.refuses
    assert f"a mean over many pixels is {factor} times" in flag.message
    assert abs(found.gain_dn_per_e.value - GAIN) < 4.0 * found.gain_dn_per_e.std_error
    assert found.read_noise_e is not None
    truth_e = READ_E * np.hypot(1.0, coupling)
    assert abs(found.read_noise_e.value - truth_e) < 4.0 * found.read_noise_e.std_error


def test_a_filter_shows_in_flats_too_and_is_refused() -> None:
    with pytest.raises(RefusedFramesError) as caught:
        calibrate_noise(coupled(-0.07, filtered=True), bit_depth=16)
    assert "compressed_frames" in {flag.name for flag in caught.value.flags if flag.refuses}


def bent(rise: float) -> list[LevelStatistics]:
    """Variance over signal goes from GAIN at no signal up by `rise` at the brightest level, the mean stays a line."""
    draws, levels = np.random.default_rng(6), []
    for light_e in LIGHT_E.tolist():
        for kind, charge_e in (("flat", light_e), ("dark", 0.0)):
            width_e = np.sqrt(READ_E**2 + charge_e * (1.0 + rise * charge_e / LIGHT_E[-1]))
            frames = [BLACK_DN + GAIN * (charge_e + width_e * draws.standard_normal(SHAPE)) for _ in range(4)]
            levels.append(level("flat" if kind == "flat" else "dark", light_e / 1e6, frames))
    return levels


def test_the_headline_is_not_better_than_a_gain_that_bends() -> None:
    found = calibrate_noise(bent(0.06), bit_depth=16)
    assert "bent_photon_transfer" in flags(found)
    headline, *_ = first_lines(found)
    assert "it depends on the level" in headline
    share = float(headline.removeprefix("Trust the gain to ").partition("%")[0]) / 100.0
    # The rise is known to a fifth of itself.
    assert 0.045 < share < 0.075
    assert share > 5.0 * found.gain_dn_per_e.std_error / found.gain_dn_per_e.value


def test_the_headline_of_a_line_is_its_error() -> None:
    found = calibrate_noise(bent(0.0), bit_depth=16)
    assert (
        first_lines(found)[0] == f"Trust the gain to {found.gain_dn_per_e.std_error / found.gain_dn_per_e.value:.1%}."
    )


@pytest.mark.parametrize("mixed", [{9}, set(range(12))], ids=["one level", "every level"])
def test_flats_that_differ_within_a_level_are_refused_for_that_alone(mixed: set[int]) -> None:
    draws, levels = np.random.default_rng(7), []
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, SHAPE[1]), np.linspace(-1.0, 1.0, SHAPE[0]))
    response = (1.0 - 0.2 * (x**2 + y**2)) * (1.0 + 0.01 * draws.standard_normal(SHAPE))
    for place, light_e in enumerate(LIGHT_E.tolist()):
        for kind, charge_e in (("flat", light_e), ("dark", 0.0)):
            lamp = [1.12 if place in mixed and number == 1 else 1.0 for number in range(3)]
            frames = [
                BLACK_DN + GAIN * (draws.poisson(charge_e * one * response) + READ_E * draws.standard_normal(SHAPE))
                for one in lamp
            ]
            levels.append(level("flat" if kind == "flat" else "dark", light_e / 1e6, frames))
    with pytest.raises(RefusedFramesError) as caught:
        calibrate_noise(levels, bit_depth=16)
    assert {flag.name for flag in caught.value.flags} <= {"mixed_level", "uneven_light"}
    (refusing,) = [flag for flag in caught.value.flags if flag.refuses]
    assert "differ by up to 1" in refusing.message
