"""Hot and dead pixels: counted, named, and not in the DSNU and PRNU of all the others."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.sensor.levels import LevelStatistics, level_statistics
from calibration.sensor.noise import NoiseCalibration, calibrate_noise
from tests.calibration.sensor.synthetic_sensor import EXPOSURES_S, SIGNALS_E, SyntheticCamera, SyntheticSensor

Frame = NDArray[np.uint16]
SHAPE = (96, 96)
# 9 of 9216 pixels, about a thousandth.
PLACES = (slice(5, None, 32), slice(7, None, 32))
DSNU_E, PRNU = 4.0, 0.01


def hot(frame: Frame) -> Frame:
    changed = frame.copy()
    changed[PLACES] = np.minimum(changed[PLACES] + np.uint16(300), np.uint16(4095))
    return changed


def dead(frame: Frame) -> Frame:
    changed = frame.copy()
    # A tenth of the light, and what noise it has.
    changed[PLACES] = np.rint(60.0 + (changed[PLACES] - 60.0) / 10.0).astype(np.uint16)
    return changed


@cache
def calibration(kind: str) -> NoiseCalibration:
    camera = SyntheticCamera(SyntheticSensor(shape=SHAPE, dsnu_e=DSNU_E, prnu=PRNU), 41)
    change = {"hot": hot, "dead": dead, "none": np.copy}[kind]
    levels: list[LevelStatistics] = []
    for index, (light_e, exposure_s) in enumerate(zip(SIGNALS_E, EXPOSURES_S, strict=True)):
        for level_kind, electrons in (("flat", light_e), ("dark", 0.0)):
            frames = camera.frames(16 if index == 6 else 2, light_e=electrons, exposure_s=exposure_s)
            levels.append(
                level_statistics(
                    map(change, frames), kind="flat" if level_kind == "flat" else "dark", exposure_s=exposure_s
                )
            )
    return calibrate_noise(levels, bit_depth=12)


@pytest.mark.parametrize("kind", ["hot", "dead", "none"])
@pytest.mark.parametrize(("name", "truth"), [("dsnu_e", DSNU_E), ("prnu", PRNU), ("gain_dn_per_e", 0.25)])
def test_the_others_are_as_they_are_without_defects(kind: str, name: str, truth: float) -> None:
    found = getattr(calibration(kind), name)
    # Of 300 DN in a thousandth of the pixels the DSNU would be 38 e-, of dead ones the PRNU 3 %.
    assert abs(found.value - truth) < 4.0 * found.std_error
    assert found.std_error < 0.03 * truth


@pytest.mark.parametrize(("kind", "stack"), [("hot", "dark"), ("dead", "flat")])
def test_they_are_counted_and_named(kind: str, stack: str) -> None:
    flag = next(flag for flag in calibration(kind).flags if flag.name == "defect_pixels")
    assert f"9 in the {stack} stack" in flag.message
    assert not flag.refuses


def test_a_sensor_without_defects_has_none() -> None:
    found = calibration("none")
    assert {level.ordinary.left_out for level in (*found.flats, *found.darks)} == {0}
    assert "defect_pixels" not in {flag.name for flag in found.flags}


def test_the_standards_own_numbers_hold_them() -> None:
    figure = calibration("hot").emva1288["dsnu_e"]
    assert figure is not None
    # 300 DN, 1200 e-, in 9 of 9216 pixels.
    assert figure.value == pytest.approx(np.hypot(DSNU_E, 1200.0 * np.sqrt(9.0 / 9216.0)), rel=0.05)


def test_a_dark_corner_is_no_defect() -> None:
    camera = SyntheticCamera(SyntheticSensor(shape=SHAPE), 42)
    camera.response_map[:20, :20] *= 0.7
    level = camera.level(16, kind="flat", light_e=8000.0, exposure_s=0.008)
    # 4 % of the pixels: shading, which the smooth part of the pattern shows.
    assert level.ordinary.left_out == 0
