"""Sum rule, DoLP, drift and means of frames as they come, with deviations, against draws of the noise."""

import json
import math
from dataclasses import asdict, replace

import numpy as np
import pytest

from rigctl.errors import ConfigError
from rigctl.files.regions import Region
from rigctl.files.session_file import SessionFile
from rigctl.runs.records import SessionNoise
from rigctl.session.numbers import (
    FrameSummary,
    LightLevels,
    LiveNumbers,
    PixelMean,
    RegionMeans,
    drift_of,
    polarization,
    sum_rule,
)
from rigctl.session.status import read_status
from rigctl.session.take import take_session
from tests.rigctl.example_files import small_rig

BLACK_DN, EXPOSURE_S = 64.0, 0.01
ANGLES_DEG = (0.0, 90.0, 45.0, 135.0)
STOKES_DN = (800.0, 120.0, -60.0)
DOLP = math.hypot(120, 60) / 800
_GAIN, _READ_E, _DRAWS = 0.24, 10.0, 2_000
NOISE = SessionNoise(gain_dn_per_e=_GAIN, read_noise_e=_READ_E, dark_current_e_per_s=0.0, black_level_dn=BLACK_DN)
# A sample's deviation has a relative error of 1 / sqrt(2 N) = 1.6 %; four of them, and the tolerance of 0.1 % of the
# prediction itself.
_STD_TOLERANCE = 4 / math.sqrt(2 * _DRAWS) + 1e-3
_PER_S = 0.001
_LEFT = {"name": "left", "rectangle": {"x": 4, "y": 4, "width": 40, "height": 40}}
_RIGHT = {"name": "right", "polygon": [[52, 4], [91, 4], [91, 43], [52, 43]]}


def seen(angle_deg, *, level_dn, time_s=0.0, pixels=1, measured_deg=None, **facts):
    """Return a frame in which picture and panel have a level above black [DN]."""
    mean = PixelMean(mean_dn=BLACK_DN + level_dn, pixels=pixels)
    known = {"kind": "scene", "round": None, "cycle": 0, "exposure_s": EXPOSURE_S, "saturated_fraction": 0.0}
    return FrameSummary(
        angle_deg=angle_deg,
        measured_deg=angle_deg if measured_deg is None else measured_deg,
        time_s=time_s,
        means={"picture": mean, "panel": mean},
        **(known | facts),
    )


def dark(*, level_dn=0.0):
    return seen(None, level_dn=level_dn, kind="dark")


def behind(stokes_dn, angle_deg):
    """Return what an ideal polarizer lets through (Malus) [DN]."""
    s0, s1, s2 = stokes_dn
    return (s0 + s1 * math.cos(math.radians(2 * angle_deg)) + s2 * math.sin(math.radians(2 * angle_deg))) / 2


def cycle_of(stokes_dn, *, angles=ANGLES_DEG, start_s=0.0, per_s=0.0, **more):
    """Return a cycle of light, one frame a second, that grows by a share a second."""
    times = [start_s + k for k in range(len(angles))]
    return tuple(
        seen(angle, level_dn=behind(stokes_dn, angle) * (1 + per_s * time_s), time_s=time_s, **more)
        for angle, time_s in zip(angles, times, strict=True)
    )


def drawn_cycle(generator, **more):
    """Return a cycle with the noise of one pixel: shot noise, read noise, rounding (EMVA 1288)."""
    frames = []
    for frame in cycle_of(STOKES_DN, **more):
        level = frame.means["panel"].mean_dn - BLACK_DN
        sigma = math.sqrt(_GAIN * level + (_GAIN * _READ_E) ** 2 + 1 / 12)
        mean = PixelMean(mean_dn=BLACK_DN + level + sigma * generator.standard_normal(), pixels=1)
        frames.append(replace(frame, means={"panel": mean}))
    return tuple(frames)


def with_dark(noise=None):
    levels = LightLevels(noise)
    levels.add_dark(dark())
    return levels


def sum_of(frames, levels=None):
    return sum_rule(frames, region="panel", levels=levels or LightLevels(NOISE))


def polarization_of(frames, levels=None, *, extinction_ratio=None):
    return polarization(frames, region="panel", levels=levels or LightLevels(NOISE), extinction_ratio=extinction_ratio)


def drift(frames, before, noise=None):
    return drift_of(frames, before, region="panel", levels=with_dark(noise))


@pytest.mark.slow
def test_sigmas_are_those_of_draws():
    generator = np.random.default_rng(4)
    cycles = [drawn_cycle(generator) for _ in range(_DRAWS)]
    later = [drawn_cycle(generator, start_s=4.0) for _ in range(_DRAWS)]
    found = sum_of(cycle_of(STOKES_DN))
    assert found.value == pytest.approx(1.0, abs=1e-12)
    drawn = [sum_of(frames, with_dark()).value for frames in cycles]
    assert found.sigma == pytest.approx(np.std(drawn), rel=_STD_TOLERANCE)
    found = polarization_of(cycle_of(STOKES_DN))
    assert found.dolp.value == pytest.approx(DOLP, abs=1e-12)
    assert found.aolp_deg == pytest.approx(math.degrees(math.atan2(-60, 120) / 2) % 180, abs=1e-9)
    drawn = [polarization_of(frames, with_dark()).dolp.value for frames in cycles]
    assert found.dolp.sigma == pytest.approx(np.std(drawn), rel=_STD_TOLERANCE)
    found = drift(cycle_of(STOKES_DN, start_s=4.0), cycle_of(STOKES_DN), NOISE)
    drawn = [drift(two, one).change for one, two in zip(cycles, later, strict=True)]
    assert found.sigma == pytest.approx(np.std(drawn), rel=_STD_TOLERANCE)
    assert found.sigma_per_min == pytest.approx(found.sigma * 15)


def test_a_hundred_pixels_have_a_tenth_of_the_sigma_of_one():
    one, many = (polarization_of(cycle_of(STOKES_DN, pixels=n)) for n in (100, 10_000))
    # Both are far from the kink at DoLP = 0, and to first order there; what is beyond is below 0.1 %.
    assert many.dolp.sigma == pytest.approx(one.dolp.sigma / 10, rel=2e-3)


_LEAK = 1 / 50


@pytest.mark.parametrize(
    ("frames", "extinction_ratio"),
    [
        # The readback is used, and not the command.
        (tuple(seen(a, level_dn=behind(STOKES_DN, a + 1.5), measured_deg=a + 1.5) for a in ANGLES_DEG), None),
        (cycle_of(STOKES_DN, angles=(*ANGLES_DEG, 0.0)), None),
        (cycle_of((800.0 * (1 + _LEAK), 120.0 * (1 - _LEAK), -60.0 * (1 - _LEAK))), 50.0),
    ],
    ids=["readback", "closing repeat", "leaking polarizer"],
)
def test_dolp_is_that_of_the_light(frames, extinction_ratio):
    assert polarization_of(frames, extinction_ratio=extinction_ratio).dolp.value == pytest.approx(DOLP, abs=1e-12)


def test_without_a_calibration_there_is_no_sigma():
    assert sum_of(cycle_of(STOKES_DN), with_dark()).sigma is None
    assert polarization_of(cycle_of(STOKES_DN), with_dark()).dolp.sigma is None


@pytest.mark.parametrize(
    "frames",
    [cycle_of(STOKES_DN, angles=(0.0, 90.0)), cycle_of(STOKES_DN, angles=(0.0, 90.0, 0.0)), cycle_of((0.0, 0.0, 0.0))],
    ids=["two angles", "two angles and one again", "darkness"],
)
def test_too_few_angles_or_no_light_give_nothing(frames):
    assert sum_of(frames) is None
    assert polarization_of(frames) is None


def test_dark_frames_come_before_the_calibration_and_that_before_nothing():
    levels = LightLevels()
    assert levels.source(EXPOSURE_S).startswith("not known")
    assert levels.dark_dn("panel", EXPOSURE_S) == 0.0
    levels = LightLevels(replace(NOISE, dark_current_e_per_s=100.0))
    assert levels.source(EXPOSURE_S) == "calibration"
    assert levels.dark_dn("panel", EXPOSURE_S) == pytest.approx(BLACK_DN + 0.24 * 100.0 * EXPOSURE_S)
    levels.add_dark(dark(level_dn=3.0))
    assert levels.source(EXPOSURE_S) == "dark frames"
    assert levels.dark_dn("panel", EXPOSURE_S) == BLACK_DN + 3.0
    assert levels.source(2 * EXPOSURE_S) == "calibration"


@pytest.mark.parametrize("order", [ANGLES_DEG, ANGLES_DEG[::-1]], ids=["again", "palindrome"])
def test_a_linear_drift_is_found_from_cycle_to_cycle(order):
    found = drift(cycle_of(STOKES_DN, angles=order, start_s=4.0, per_s=_PER_S), cycle_of(STOKES_DN, per_s=_PER_S))
    # Relative to the light in the middle of both looks, 3.5 s: the light is weighted there, by 1 s at most.
    assert found.per_min == pytest.approx(60 * _PER_S / (1 + 3.5 * _PER_S), rel=_PER_S)


def test_a_closing_repeat_needs_no_cycle_before():
    found = drift(cycle_of(STOKES_DN, angles=(*ANGLES_DEG, 0.0), per_s=_PER_S), ())
    assert found.over_s == pytest.approx(4.0)
    assert found.change == pytest.approx(4 * _PER_S / (1 + 2 * _PER_S), rel=1e-9)


def test_polarization_is_no_drift_and_one_cycle_tells_nothing():
    unchanged = drift(cycle_of(STOKES_DN, start_s=4.0), cycle_of(STOKES_DN))
    assert unchanged.change == pytest.approx(0.0, abs=1e-12)
    assert drift(cycle_of(STOKES_DN), ()) is None


def filled(*cycles, live=None):
    live = live or LiveNumbers()
    live.add(dark(), ends_cycle=False)
    for frames in cycles:
        for frame in frames:
            live.add(frame, ends_cycle=frame is frames[-1])
    return live


def test_numbers_are_of_the_last_whole_cycle():
    live = filled(cycle_of((800.0, 80.0, 0.0)))
    live.add(seen(0.0, level_dn=2000.0, cycle=1), ends_cycle=False)
    content = live.content()
    assert content.regions["panel"].dolp.value == pytest.approx(0.1)
    assert content.cycle == {"round": None, "cycle": 0, "exposure_ms": 10.0}
    assert content.angles["0"].mean_dn == pytest.approx(2064.0)
    assert content.dark == {"source": "dark frames", "mean_dn": 64.0}
    json.dumps(asdict(content), allow_nan=False)


def test_frames_grouped_by_angle_are_set_against_each_other_as_they_come():
    live = filled()
    for cycle in range(2):
        for frame in cycle_of((800.0, 80.0, 0.0), cycle=cycle):
            live.add(frame, ends_cycle=False)
    assert live.content().regions["panel"].dolp.value == pytest.approx(0.1)


def test_a_saturated_bracket_is_left_to_its_shorter_exposure():
    short = cycle_of((800.0, 80.0, 0.0))
    long = cycle_of((800.0, 0.0, 0.0), exposure_s=0.04, saturated_fraction=0.3)
    content = filled([frame for pair in zip(short, long, strict=True) for frame in pair]).content()
    assert content.cycle["exposure_ms"] == 10.0
    assert content.regions["panel"].dolp.value == pytest.approx(0.1)


def test_drift_is_that_of_the_reference_region_and_not_over_the_pause_between_rounds():
    live = LiveNumbers(reference="panel")
    assert filled(cycle_of((800.0, 0, 0)), live=live).content().drift is None
    filled(cycle_of((808.0, 0, 0), start_s=4.0, cycle=1), live=live)
    assert live.content().drift.region == "panel"
    assert live.content().drift.change == pytest.approx(8 / 804)
    filled(cycle_of((900.0, 0, 0), start_s=604.0, round=1), live=live)
    assert live.content().drift is None


def test_region_means_are_those_of_a_plain_mask():
    counts = np.random.default_rng(2).integers(0, 4096, (48, 96), dtype=np.uint16)
    found = RegionMeans([Region.model_validate(_LEFT), Region.model_validate(_RIGHT)]).of(counts)
    assert found["picture"].mean_dn == pytest.approx(counts.mean())
    assert (found["left"].mean_dn, found["left"].pixels) == (pytest.approx(counts[4:44, 4:44].mean()), 1600)
    # Pixel centres on the left and upper edges of a polygon are inside, those on the others are not.
    assert found["right"].pixels == 39 * 39
    assert found["right"].mean_dn == pytest.approx(counts[4:43, 52:91].mean(), rel=0.02)
    with pytest.raises(ConfigError, match="lies outside of the picture of 20 x 10"):
        RegionMeans([Region.model_validate(_LEFT)]).of(np.zeros((10, 20), dtype=np.uint16))


def test_a_session_tells_of_its_regions_and_their_sigma(tmp_path):
    session = SessionFile.model_validate(
        {
            "name": "watched",
            "take": [{"kind": "scene", "exposure_ms": 0.03, "cycles": 3}],
            "regions": [_LEFT, _RIGHT],
            "reference_region": "right",
            "darks": {"every_cycles": 3},
        }
    )
    noise = replace(NOISE, dark_current_e_per_s=20.0)
    take_session(small_rig(tmp_path), session, tmp_path / "run", files={}, noise=noise)
    live = read_status(tmp_path / "run").numbers
    for name, truth in {"left": math.hypot(3, 1) / 10, "right": math.hypot(-2, 3) / 40}.items():
        found = live.regions[name].dolp
        # Temporal noise, and the dark level: the last dark frame's mean of 1600 pixels of 2.4 DN (0.06 DN), off by
        # five times that at most against a signal of 100 DN or more.
        assert found.value == pytest.approx(truth, abs=5 * found.sigma + truth * 5 * 0.06 / 100)
        assert 0.0 < found.sigma < 0.01
    assert live.sum_rule.value == pytest.approx(1.0, abs=5 * live.sum_rule.sigma + 1e-4)
    assert live.drift.region == "right"
    assert abs(live.drift.per_min) < 5 * live.drift.sigma_per_min


@pytest.mark.parametrize(
    ("extra", "match"),
    [
        ({"regions": [_LEFT, _LEFT]}, "more than once"),
        ({"regions": [_LEFT | {"name": "picture"}]}, "'picture'"),
        ({"regions": [_LEFT], "reference_region": "white"}, r"'white'; \[\[regions\]\] has left"),
    ],
)
def test_regions_that_make_no_sense_are_refused(extra, match):
    with pytest.raises(ValueError, match=match):
        SessionFile.model_validate({"name": "x", "take": [{"kind": "scene", "exposure_ms": 1}], **extra})
