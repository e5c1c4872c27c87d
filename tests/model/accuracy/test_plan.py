"""Levels of the numerical settings: their forecast, and the choice of the cheapest that suffice."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from model.accuracy.chain import LightStore, evaluate
from model.accuracy.plan import (
    HEMISPHERE,
    NUMERICAL_SETTINGS,
    STREAMS,
    TILES,
    WAVELENGTHS,
    Budget,
    allocate,
    at_level,
    expected_s,
    forecast,
    plan_beside,
    seen,
    settings_at,
    spectral_error,
)
from model.accuracy.predict import predict
from model.atmosphere.aerosols import AerosolType
from model.atmosphere.air import AtmosphereState
from rigctl.scene.sun import response_band
from tests.model.accuracy.random_scenes import random_scene

EVEN = dict.fromkeys(NUMERICAL_SETTINGS, 1.0)


AHEAD = forecast(random_scene(0))


@pytest.mark.parametrize("allowed", [1e-1, 1e-2, 1e-3])
def test_the_plan_keeps_to_what_is_allowed(allowed):
    assert AHEAD.error(allocate(random_scene(0), AHEAD, EVEN, allowed), EVEN) <= allowed


def test_a_plan_is_within_a_third_of_the_cheapest_of_all():
    # All plans of three levels a knob; steepest descent is no search, a third is what it may lose here.
    scene, allowed = random_scene(0), 2e-3
    plans = [
        dict(zip(NUMERICAL_SETTINGS, levels, strict=True))
        for levels in product(range(4), repeat=len(NUMERICAL_SETTINGS))
    ]
    least = min(expected_s(scene, plan, AHEAD) for plan in plans if AHEAD.error(plan, EVEN) <= allowed)
    assert expected_s(scene, allocate(scene, AHEAD, EVEN, allowed), AHEAD) <= 1.34 * least


def test_a_knob_whose_errors_count_more_is_raised():
    scales = EVEN | {"streams": 100.0}
    assert (
        allocate(random_scene(0), AHEAD, scales, 1e-2)["streams"]
        > allocate(random_scene(0), AHEAD, EVEN, 1e-2)["streams"]
    )


def test_levels_never_fall_below_the_start():
    start = dict.fromkeys(NUMERICAL_SETTINGS, 2)
    assert all(level >= 2 for level in allocate(random_scene(0), AHEAD, EVEN, 1e-2, start=start).values())


def test_what_cannot_be_reached_ends_at_the_finest_of_all():
    finest = {name: len(knob.levels) - 1 for name, knob in NUMERICAL_SETTINGS.items()}
    assert allocate(random_scene(0), AHEAD, EVEN, 0.0) == finest


# A target before a background that fills 20 by 16 deg of the field.
WIDE = 14


CHEAP = dict.fromkeys(NUMERICAL_SETTINGS, 0) | {TILES: 2}


def test_the_errors_of_every_knob_fall_with_its_levels():
    found = forecast(random_scene(WIDE))
    for name in NUMERICAL_SETTINGS:
        assert len(found.errors[name]) == len(found.efforts[name]) == len(NUMERICAL_SETTINGS[name].levels)
        if name != WAVELENGTHS:
            assert np.all(np.diff(found.errors[name]) < 0.0)


def test_an_aerosol_with_a_stronger_forward_peak_asks_for_more_streams():
    scene = random_scene(WIDE)
    assert scene.air is not None
    clear, dusty = (
        forecast(
            replace(scene, air=replace(scene.air, state=AtmosphereState(visibility_m=10e3, boundary_aerosol=kind)))
        )
        for kind in ("tropospheric", "dust")
    )
    level = 3
    assert dusty.errors[STREAMS][level] > clear.errors[STREAMS][level]


def test_tiles_follow_the_law_of_the_field():
    scene = random_scene(WIDE)
    before = forecast(scene)
    result = evaluate(scene, settings_at(CHEAP, 0.1))
    after = seen(before, scene, result)
    ratios = np.array(after.errors[TILES][1:]) / np.array(after.errors[TILES][:-1])
    # From 2 to 6 tiles a side one more in each step, each step the same factor.
    assert ratios[:4] == pytest.approx(np.full(4, ratios[0]))
    assert 0.05 <= ratios[0] <= 0.7
    assert {name: after.errors[name] for name in NUMERICAL_SETTINGS if name != TILES} == {
        name: before.errors[name] for name in NUMERICAL_SETTINGS if name != TILES
    }


COARSE = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), 1e-4)


# Directions all over the sky.
ZENITH_RAD, PHI_RAD = np.meshgrid(np.radians([20.0, 50.0, 75.0]), np.radians([15.0, 90.0, 165.0]))


def band(short_nm, long_nm):
    return response_band(wavelength_nm=np.array([short_nm, long_nm]), response=np.ones(2), distance_factor=1.0)


def air(**changes):
    wide = {
        "band": band(400.0, 700.0),
        "state": AtmosphereState(aerosol_optical_depth=0.3),
        "ground_albedo": 0.2,
        "sun_zenith_rad": np.radians(50.0),
    }
    return replace(random_scene(0).air, **(wide | changes))


def sky_error(one, settings):
    """Largest relative error of S0 of the sky, against twelve wavelengths between the tables' entries."""
    finest = at_level(settings, WAVELENGTHS, len(NUMERICAL_SETTINGS[WAVELENGTHS].levels) - 1)
    own, fine = (
        LightStore()
        .illumination(one, chosen, sun_azimuth_rad=0.0)
        .lighting.sky(zenith_rad=ZENITH_RAD, phi_rad=PHI_RAD)[..., 0]
        for chosen in (settings, finest)
    )
    return float(np.max(np.abs(own / fine - 1.0)))


@pytest.mark.slow
@pytest.mark.parametrize("level", [0, 1, 2, 4])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"sun_zenith_rad": np.radians(75.0)},
        {"band": band(450.0, 550.0)},
        {"state": AtmosphereState(aerosol_optical_depth=0.5, angstrom_exponent=-0.2)},
        {"state": AtmosphereState(aerosol_optical_depth=0.5, boundary_aerosol=AerosolType.SOOT)},
    ],
)
def test_the_sky_is_off_by_no_more_and_not_by_far_less(level, changes):
    one, settings = air(**changes), at_level(COARSE, WAVELENGTHS, level)
    true, estimated = sky_error(one, settings), spectral_error(one, settings).scattered
    # Elements of a depth of 0.1 come and go with the wavelength: 2e-6 of noise at these coarse settings.
    assert true < estimated + 2e-6
    assert true > 0.05 * estimated - 2e-6


def test_a_narrow_band_needs_one_wavelength():
    # The beam's light falls and rises as powers up to 8 of the wavelength: curvature 72 / 2, variance of 2 nm in 520.
    expected = 36.0 * (1.0 / 520.0) ** 2 / 3.0
    assert spectral_error(air(band=band(519.0, 521.0)), at_level(COARSE, WAVELENGTHS, 0)).scattered < 2.0 * expected


def test_transmittance_is_that_of_all_wavelengths():
    one = air()
    errors = [abs(spectral_error(one, at_level(COARSE, WAVELENGTHS, k)).transmittance(slant=2.0)) for k in (0, 1, 4)]
    assert errors[0] > 1e-2 > errors[1] > 1e-4 > 1e-5 > errors[2]


def test_air_without_aerosol_has_one_part():
    clear = air(state=AtmosphereState(aerosol_optical_depth=0.0))
    settings = at_level(COARSE, WAVELENGTHS, 1)
    assert sky_error(clear, settings) < spectral_error(clear, settings).scattered < 0.01


TOLERANCE = 0.03


@pytest.fixture(scope="module")
def neighbour():
    scene = random_scene(4)
    points = tuple(replace(region, part=None) for region in scene.regions)
    scene = replace(scene, regions=points)
    return scene, predict([scene], tolerance=TOLERANCE, store=LightStore()).cases[0]


def beside(scene, known, tolerance):
    sky = known.result.air_key
    return plan_beside(scene, known.plan, known.budget, sky=sky, tolerance=tolerance, store=LightStore())


def test_a_number_that_no_rules_keep_makes_nothing_else_finer_than_it_was(neighbour):
    # As where a tilted glossy panel mirrors the horizon: the finest rules leave two thirds of the tolerance.
    scene, known = neighbour
    key, left = next(iter(known.budget.total)), 2.0 / 3.0 * TOLERANCE
    by_setting = {name: {key: left} if name == HEMISPHERE else {} for name in known.plan}
    finest = {**known.plan, HEMISPHERE: len(NUMERICAL_SETTINGS[HEMISPHERE].levels) - 1}
    budget = Budget(by_setting=by_setting, total={key: left})
    stuck = replace(known, plan=finest, budget=budget)
    plan = beside(scene, stuck, 0.5 * TOLERANCE)
    assert all(plan[name] <= finest[name] for name in plan)
