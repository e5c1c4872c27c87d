"""Sum rule and DoLP of a cycle, with the deviations that noise predicts, against draws of that noise."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rigctl.runs.records import SessionNoise
from rigctl.session.numbers import LightLevels, mean_noise, polarization, sum_rule
from tests.rigctl.live.made_frame_summaries import BLACK_DN, EXPOSURE_S, behind, cycle_of, dark, seen

_GAIN, _READ_E = 0.24, 10.0
_NUMBERS = SessionNoise(
    gain_dn_per_e=_GAIN,
    read_noise_e=_READ_E,
    dark_current_e_per_s=0.0,
    black_level_dn=BLACK_DN,
)
_STOKES_DN = (800.0, 120.0, -60.0)
_ANGLES_DEG = (0.0, 90.0, 45.0, 135.0)
_DRAWS = 2_000


def _levels():
    return LightLevels(noise=mean_noise(_NUMBERS))


def _drawn(generator):
    """Return a cycle with the noise of one pixel: shot noise, read noise, rounding (EMVA 1288)."""
    frames = []
    for angle in _ANGLES_DEG:
        level = behind(_STOKES_DN, angle)
        sigma = math.sqrt(_GAIN * level + (_GAIN * _READ_E) ** 2 + 1 / 12)
        frames.append(seen(angle, level_dn=level + sigma * generator.standard_normal()))
    return tuple(frames)


@pytest.fixture(scope="module")
def drawn():
    generator = np.random.default_rng(4)
    cycles = [_drawn(generator) for _ in range(_DRAWS)]
    without = LightLevels()
    without.add_dark(dark())
    sums = [sum_rule(frames, region="panel", levels=without).value for frames in cycles]
    degrees = [
        polarization(frames, region="panel", levels=without, extinction_ratio=None).dolp.value for frames in cycles
    ]
    return np.array(sums), np.array(degrees)


# A sample's deviation has a relative error of 1 / sqrt(2 N) = 1.6 %; four of them, and the tolerance of 0.1 % of the
# prediction itself.
_STD_TOLERANCE = 4 / math.sqrt(2 * _DRAWS) + 1e-3


def test_the_sigma_of_the_sum_rule_is_that_of_draws(drawn):
    found = sum_rule(cycle_of(_STOKES_DN), region="panel", levels=_levels())
    assert found.value == pytest.approx(1.0, abs=1e-12)
    assert found.sigma == pytest.approx(drawn[0].std(), rel=_STD_TOLERANCE)


def test_the_sigma_of_dolp_is_that_of_draws(drawn):
    found = polarization(cycle_of(_STOKES_DN), region="panel", levels=_levels(), extinction_ratio=None)
    assert found.dolp.value == pytest.approx(math.hypot(120, 60) / 800, abs=1e-12)
    assert found.aolp_deg == pytest.approx(math.degrees(math.atan2(-60, 120) / 2) % 180, abs=1e-9)
    assert found.dolp.sigma == pytest.approx(drawn[1].std(), rel=_STD_TOLERANCE)


def test_a_hundred_pixels_have_a_tenth_of_the_sigma_of_one():
    one, many = (
        polarization(cycle_of(_STOKES_DN, pixels=n), region="panel", levels=_levels(), extinction_ratio=None)
        for n in (100, 10_000)
    )
    # Both are far from the kink at DoLP = 0, and to first order there; what is beyond is below 0.1 %.
    assert many.dolp.sigma == pytest.approx(one.dolp.sigma / 10, rel=2e-3)


def test_the_readback_is_used_and_not_the_command():
    turned = tuple(
        seen(angle, level_dn=behind(_STOKES_DN, angle + 1.5), measured_deg=angle + 1.5) for angle in _ANGLES_DEG
    )
    found = polarization(turned, region="panel", levels=_levels(), extinction_ratio=None)
    assert found.dolp.value == pytest.approx(math.hypot(120, 60) / 800, abs=1e-12)


def test_a_closing_repeat_is_used_too():
    frames = cycle_of(_STOKES_DN, angles=(0.0, 90.0, 45.0, 135.0, 0.0))
    found = polarization(frames, region="panel", levels=_levels(), extinction_ratio=None)
    assert found.dolp.value == pytest.approx(math.hypot(120, 60) / 800, abs=1e-12)


def test_a_leaking_polarizer_is_undone():
    leak = 1 / 50
    stokes = (800.0 * (1 + leak), 120.0 * (1 - leak), -60.0 * (1 - leak))
    found = polarization(cycle_of(stokes), region="panel", levels=_levels(), extinction_ratio=50.0)
    assert found.dolp.value == pytest.approx(math.hypot(120, 60) / 800, abs=1e-12)


def test_without_a_calibration_there_is_no_sigma():
    levels = LightLevels()
    levels.add_dark(dark())
    assert sum_rule(cycle_of(_STOKES_DN), region="panel", levels=levels).sigma is None
    assert polarization(cycle_of(_STOKES_DN), region="panel", levels=levels, extinction_ratio=None).dolp.sigma is None


@pytest.mark.parametrize("angles", [(0.0, 90.0), (0.0, 90.0, 0.0)])
def test_two_angles_have_neither(angles):
    frames = cycle_of(_STOKES_DN, angles=angles)
    assert sum_rule(frames, region="panel", levels=_levels()) is None
    assert polarization(frames, region="panel", levels=_levels(), extinction_ratio=None) is None


def test_darkness_has_neither():
    frames = cycle_of((0.0, 0.0, 0.0))
    assert sum_rule(frames, region="panel", levels=_levels()) is None
    assert polarization(frames, region="panel", levels=_levels(), extinction_ratio=None) is None


def test_dark_frames_come_before_the_calibration_and_that_before_nothing():
    levels = LightLevels()
    assert levels.source(EXPOSURE_S).startswith("not known")
    assert levels.dark_dn("panel", EXPOSURE_S) == 0.0
    levels = LightLevels(noise=mean_noise(replace(_NUMBERS, dark_current_e_per_s=100.0)))
    assert levels.source(EXPOSURE_S) == "calibration"
    assert levels.dark_dn("panel", EXPOSURE_S) == pytest.approx(BLACK_DN + 0.24 * 100.0 * EXPOSURE_S)
    levels.add_dark(dark(level_dn=3.0))
    assert levels.source(EXPOSURE_S) == "dark frames"
    assert levels.dark_dn("panel", EXPOSURE_S) == BLACK_DN + 3.0
    assert levels.source(2 * EXPOSURE_S) == "calibration"
