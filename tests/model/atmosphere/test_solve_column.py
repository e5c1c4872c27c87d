"""Layers extrapolated to none."""

from dataclasses import replace

import numpy as np
import pytest

from model.atmosphere.air import AtmosphereState, column
from model.atmosphere.layers import AerosolKind
from model.atmosphere.sky import SolverSettings, single_solution, solve_column
from model.atmosphere.solver import solve

MU = np.array([1.0, 0.7, 0.3, 0.05])
PHI_RAD = np.array([0.1, 1.0, 2.0, 3.0])
HEIGHTS_M = (12.0, 1500.0, 2700.0, 60e3)


def settings(cuts: int, *, height_m: float, extrapolated: bool = False) -> SolverSettings:
    return SolverSettings(
        fine_layers=False,
        nodes=6,
        element_depth=0.1 / cuts,
        tolerance=1e-9,
        layer_cuts=cuts,
        extrapolated=extrapolated,
        face_m=height_m,
    )


def light(solver, *, height_m: float, chosen: SolverSettings, zenith_deg: float = 50.0, visibility_m: float = 10e3):
    air = column(AtmosphereState(visibility_m=visibility_m), wavelength_m=450e-9)
    mu0 = float(np.cos(np.radians(zenith_deg)))
    found = solve_column(solver, air, chosen, mu0=mu0, albedo=0.2, aerosol=AerosolKind.POLARIZING)
    sky = found.stokes(air.depth, MU, PHI_RAD, looking="up")
    below = found.stokes(air.tau_above(height_m), MU, PHI_RAD, looking="down")
    totals = [found.ground_radiance, found.diffuse_irradiance]
    return np.concatenate([sky / sky[:, :1], below / below[:, :1], sky[:, :1], below[:, :1]], axis=None), totals


def worst(one, other) -> float:
    return float(np.max(np.abs(np.concatenate([one[0] - other[0], np.subtract(one[1], other[1])]))))


@pytest.mark.parametrize("height_m", HEIGHTS_M)
@pytest.mark.parametrize("solver", [solve, single_solution])
def test_what_is_left_of_the_layers_falls_as_the_fourth_power_at_every_height_of_the_sensor(solver, height_m):
    exact = light(solver, height_m=height_m, chosen=settings(4, height_m=height_m, extrapolated=True))
    plain = [worst(light(solver, height_m=height_m, chosen=settings(n, height_m=height_m)), exact) for n in (1, 2)]
    both = [
        worst(light(solver, height_m=height_m, chosen=settings(n, height_m=height_m, extrapolated=True)), exact)
        for n in (1, 2)
    ]
    # Elements of whole numbers to a layer, and t log t at the outer faces, keep the laws from being exact.
    assert plain[0] / plain[1] == pytest.approx(4.0, rel=0.2)
    assert both[0] < 0.25 * plain[1]
    assert both[1] < both[0] / 4.0


def test_many_thin_layers_go_to_the_same_light():
    chosen = settings(2, height_m=2700.0, extrapolated=True)
    thin = replace(settings(8, height_m=2700.0), fine_layers=True, element_depth=0.01)
    found, expected = (light(solve, height_m=2700.0, chosen=one) for one in (chosen, thin))
    # The thin ones have an error of their own, a 64th of what 78 layers have.
    coarse = light(solve, height_m=2700.0, chosen=replace(thin, layer_cuts=1))
    assert worst(found, expected) < 2.0 * worst(coarse, expected) / 64.0


def test_a_thick_haze_under_a_low_sun_is_no_worse():
    given = {"height_m": 1200.0, "zenith_deg": 84.0, "visibility_m": 2e3}
    exact = light(solve, chosen=settings(4, height_m=1200.0, extrapolated=True), **given)
    found = light(solve, chosen=settings(1, height_m=1200.0, extrapolated=True), **given)
    assert worst(found, exact) < 0.25 * worst(light(solve, chosen=settings(2, height_m=1200.0), **given), exact)


@pytest.mark.parametrize("height_m", [0.0, 100e3, 200e3])
def test_a_face_on_the_ground_or_above_the_air_changes_nothing(height_m):
    air = column(AtmosphereState(visibility_m=23e3), wavelength_m=550e-9)
    assert air.layers(fine=False, face_m=height_m) == air.layers(fine=False)


@pytest.mark.parametrize("height_m", [0.3, 12.0, 300.0, 2700.0, 2999.9999999])
def test_a_face_adds_layers_and_no_depth(height_m):
    air = column(AtmosphereState(visibility_m=23e3), wavelength_m=550e-9)
    layers = air.layers(fine=False, face_m=height_m)
    depth = np.cumsum([layer.depth for layer in layers])
    assert len(layers) > len(air.layers(fine=False))
    assert depth[-1] == pytest.approx(air.depth, rel=1e-12)
    assert np.min(np.abs(depth - air.tau_above(height_m))) < 1e-12


@pytest.mark.parametrize("solver", [solve, single_solution])
@pytest.mark.parametrize("cuts", [1, 2, 3, 4, 8])
def test_along_the_horizon_an_observer_below_the_last_face_by_rounding_sees_the_air(solver, cuts):
    air = column(AtmosphereState(visibility_m=23e3), wavelength_m=420e-9)
    found = solve_column(
        solver, air, settings(cuts, height_m=3000.0), mu0=0.6, albedo=0.2, aerosol=AerosolKind.DEPOLARIZING
    )
    beside = found.stokes(found.depth, 1e-9, 0.7, looking="up")
    for depth in (found.depth, *np.nextafter(found.depth, [0.0, np.inf]), found.depth * (1.0 + 4e-16)):
        np.testing.assert_allclose(found.stokes(depth, 0.0, 0.7, looking="up"), beside, atol=1e-7 * beside[0])
