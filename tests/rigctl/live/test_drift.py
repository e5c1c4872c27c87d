"""How fast the light changes, found by looking at an angle twice."""

import math

import numpy as np
import pytest

from rigctl.runs.records import SessionNoise
from rigctl.session.numbers import LightLevels, drift_of, mean_noise
from tests.rigctl.live.made_frame_summaries import BLACK_DN, behind, cycle_of, dark, seen
from tests.rigctl.session.made_rig import MadeWorld
from tests.rigctl.session.watched_sessions import take_watched, trips_of

_STOKES_DN = (800.0, 200.0, -100.0)
_PER_S = 0.001


def _levels(noise=None):
    levels = LightLevels(noise=noise)
    levels.add_dark(dark())
    return levels


def _drifting(angles, *, start_s=0.0, step_s=1.0):
    times = [start_s + k * step_s for k in range(len(angles))]
    return tuple(
        seen(angle, level_dn=behind(_STOKES_DN, angle) * (1 + _PER_S * time), time_s=time)
        for angle, time in zip(angles, times, strict=True)
    )


def test_a_linear_drift_is_found_from_cycle_to_cycle():
    before, frames = _drifting((0, 90, 45, 135)), _drifting((0, 90, 45, 135), start_s=4.0)
    found = drift_of(frames, before, region="panel", levels=_levels())
    assert found.over_s == pytest.approx(4.0)
    # Relative to the light in the middle of both looks, 3.5 s: the light is weighted there, by 1 s at most.
    assert found.per_min == pytest.approx(60 * _PER_S / (1 + 3.5 * _PER_S), rel=_PER_S)


def test_a_palindrome_looks_twice_after_different_times():
    before, frames = _drifting((0, 90, 45, 135)), _drifting((135, 45, 90, 0), start_s=4.0)
    found = drift_of(frames, before, region="panel", levels=_levels())
    assert found.per_min == pytest.approx(60 * _PER_S / (1 + 3.5 * _PER_S), rel=_PER_S)


def test_a_closing_repeat_needs_no_cycle_before():
    found = drift_of(_drifting((0, 90, 45, 135, 0)), (), region="panel", levels=_levels())
    assert found.over_s == pytest.approx(4.0)
    assert found.change == pytest.approx(4 * _PER_S / (1 + 2 * _PER_S), rel=1e-9)


def test_polarization_is_no_drift():
    found = drift_of(cycle_of(_STOKES_DN, start_s=4.0), cycle_of(_STOKES_DN), region="panel", levels=_levels())
    assert found.change == pytest.approx(0.0, abs=1e-12)


def test_the_first_cycle_alone_tells_nothing():
    assert drift_of(cycle_of(_STOKES_DN), (), region="panel", levels=_levels()) is None


def test_its_sigma_is_that_of_draws():
    gain, read_e, draws = 0.24, 10.0, 4000
    numbers = SessionNoise(gain_dn_per_e=gain, read_noise_e=read_e, dark_current_e_per_s=0.0, black_level_dn=BLACK_DN)
    found = drift_of(
        cycle_of(_STOKES_DN, start_s=4.0), cycle_of(_STOKES_DN), region="panel", levels=_levels(mean_noise(numbers))
    )
    generator, changes = np.random.default_rng(5), []
    for _ in range(draws):
        cycles = []
        for start_s in (0.0, 4.0):
            levels = {angle: behind(_STOKES_DN, angle) for angle in (0, 90, 45, 135)}
            sigma = {a: math.sqrt(gain * level + (gain * read_e) ** 2 + 1 / 12) for a, level in levels.items()}
            cycles.append(
                [
                    seen(a, level_dn=levels[a] + sigma[a] * generator.standard_normal(), time_s=start_s + k)
                    for k, a in enumerate(levels)
                ]
            )
        changes.append(drift_of(cycles[1], cycles[0], region="panel", levels=_levels()).change)
    # Relative error of a sample's deviation: 1 / sqrt(2 N) = 1.1 %; four of them.
    assert found.sigma == pytest.approx(np.std(changes), rel=4 / math.sqrt(2 * draws))
    assert found.sigma_per_min == pytest.approx(found.sigma * 15)


def _brighter(counts):
    return (counts * 1.1).astype(np.uint16)


def test_light_that_jumps_between_two_cycles_is_noted(tmp_path):
    # A tenth more counts, black level included: 10 % in all four, far above 2 %.
    world = MadeWorld(camera_faults=dict.fromkeys((4, 5, 6, 7), _brighter))
    take_watched(world, tmp_path, drift="note")
    assert trips_of(tmp_path) == [("drift", "note")]


def test_a_closing_repeat_finds_a_jump_within_the_cycle(tmp_path):
    world = MadeWorld(camera_faults={4: _brighter})
    take_watched(world, tmp_path, take={"closing_repeat": True, "cycles": 1}, drift="note")
    assert trips_of(tmp_path) == [("drift", "note")]
