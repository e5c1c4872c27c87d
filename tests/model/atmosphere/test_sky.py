"""Light of a band: published paths and beams, levels of fidelity, tables, wavelengths."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.atmosphere.air import AtmosphereState, column
from model.atmosphere.layers import AerosolKind
from model.atmosphere.sky import (
    FIDELITY_LEVELS,
    AnalyticLighting,
    Fidelity,
    SolarBand,
    SolverSettings,
    TableLighting,
    analytic_sky,
    compute_lighting,
    distance_factor,
    path_radiance,
    path_transmittance,
    single_solution,
    solve_column,
    spectral_rule,
)
from model.atmosphere.solver import solve

STATE = AtmosphereState(visibility_m=23e3)
MU0 = np.cos(np.radians(25.0))
WAVELENGTH_M = np.linspace(400e-9, 700e-9, 61)
# A smooth stand-in for the solar spectrum with a line in it [W m-2 m-1].
SUN = 1.8e9 * (1.0 - 0.2 * np.exp(-(((WAVELENGTH_M - 430e-9) / 8e-9) ** 2)))
BAND = SolarBand(wavelength_m=WAVELENGTH_M, irradiance_w_per_m3=SUN, response=np.ones(61))
ZENITH_RAD, PHI_RAD = (
    grid.ravel() for grid in np.meshgrid(np.radians([0, 20, 45, 65, 80]), np.radians([0, 50, 130, 180]))
)


@pytest.fixture(scope="module")
def at_550():
    one = column(STATE, wavelength_m=550e-9)
    return one, solve(one.layers(fine=True), mu0=MU0, albedo=0.0, nodes=10, element_depth=0.05)


# Transmittance and path radiance [1e-3 sr-1] in the meridian frame, phi of propagation, of an independent solver.
@pytest.mark.parametrize(
    ("height_m", "zenith_deg", "transmittance", "phi_0", "phi_90", "phi_180"),
    [
        (3e3, 10, 0.751, (7.133, -0.455, 0), (7.132, 0.221, 0.183), (7.162, -0.094, 0)),
        (3e3, 50, 0.645, (13.450, -1.761, 0), (11.742, -0.494, 1.169), (11.345, -0.258, 0)),
        (5e3, 10, 0.710, (9.458, -0.714, 0), (9.532, 0.346, 0.288), (9.649, -0.147, 0)),
        (5e3, 50, 0.592, (16.601, -2.782, 0), (14.934, -0.794, 1.838), (14.942, -0.419, 0)),
        (7e3, 50, 0.567, (18.432, -3.655, 0), (16.961, -1.056, 2.407), (17.408, -0.561, 0)),
        (9e3, 10, 0.679, (12.217, -1.110, 0), (12.435, 0.534, 0.449), (12.710, -0.227, 0)),
        (9e3, 50, 0.552, (19.666, -4.376, 0), (18.400, -1.275, 2.875), (19.231, -0.680, 0)),
    ],
)
def test_path_of_the_rural_atmosphere(at_550, height_m, zenith_deg, transmittance, phi_0, phi_90, phi_180):
    one, solution = at_550
    mu = np.cos(np.radians(zenith_deg))
    above = one.tau_above(height_m)
    assert float(path_transmittance(tau_below=one.depth - above, mu=mu)) == pytest.approx(transmittance, abs=6e-4)
    found = 1e3 * path_radiance(solution, tau_above=above, mu=mu, phi_rad=np.radians([180.0, 270.0, 360.0]))
    expected = np.array([phi_0, phi_90, phi_180]) * [1, -1, -1]
    # The other solver cut the same profile otherwise, and rounded it: 0.5 % of I, 0.3 % of I in Q and U.
    assert np.all(np.abs(found - expected) < np.array([5e-3, 3e-3, 3e-3]) * expected[:, :1])


def test_largest_degree_of_polarization_by_kind_of_aerosol():
    zenith, phi = np.meshgrid(np.radians(np.arange(0, 81, 5)), np.radians(np.arange(0, 181, 10)))
    layers = column(STATE, wavelength_m=550e-9).layers(fine=False)
    largest = []
    for kind in ("depolarizing", "polarizing"):
        solution = solve(layers, mu0=MU0, albedo=0.0, aerosol=kind, nodes=8, element_depth=0.1)
        sky = solution.stokes(solution.depth, np.cos(zenith), phi, looking="up")
        largest.append(np.max(np.hypot(sky[..., 1], sky[..., 2]) / sky[..., 0]))
    # 0.18 and 0.23 of the same atmosphere, two digits, on another grid of directions.
    assert largest == pytest.approx([0.18, 0.23], abs=0.01)


def test_path_of_a_rooftop_is_almost_nothing(at_550):
    one, solution = at_550
    above = one.tau_above(20.0)
    assert float(path_transmittance(tau_below=one.depth - above, mu=1.0)) == pytest.approx(0.9966, abs=2e-4)
    light = path_radiance(solution, tau_above=above, mu=1.0, phi_rad=0.0)
    assert 0.0 < light[0] < 1e-3 * MU0 / np.pi


def test_a_sensor_above_the_air_sees_all_of_it(at_550):
    one, solution = at_550
    np.testing.assert_array_equal(
        path_radiance(solution, tau_above=one.tau_above(1e6), mu=0.6, phi_rad=1.0),
        solution.stokes(0.0, 0.6, 1.0, looking="down"),
    )


def test_ground_under_a_black_target_is_taken_off_the_path():
    layers = column(STATE, wavelength_m=550e-9).layers(fine=False)
    bright = solve(layers, mu0=MU0, albedo=0.3, nodes=6)
    assert not np.any(path_radiance(bright, tau_above=bright.depth, mu=0.7, phi_rad=0.3)[0] > 1e-15)
    dark = solve(layers, mu0=MU0, albedo=0.0, nodes=6)
    added = path_radiance(bright, tau_above=0.0, mu=0.7, phi_rad=0.3) - path_radiance(
        dark, tau_above=0.0, mu=0.7, phi_rad=0.3
    )
    assert added[0] > 0.1 * bright.ground_radiance  # light of the surroundings, scattered into the view


@pytest.fixture(scope="module")
def standard():
    return compute_lighting(STATE, fidelity=Fidelity.STANDARD, band=BAND, mu0=MU0, albedo=0.2)


def relative(lighting, reference):
    """Differences of sky and of path from 5 km over the reference's S0."""
    found, wanted = (
        np.concatenate(
            [
                one.sky(zenith_rad=ZENITH_RAD, phi_rad=PHI_RAD),
                one.path(height_m=5e3, zenith_rad=ZENITH_RAD, phi_rad=PHI_RAD),
            ]
        )
        for one in (lighting, reference)
    )
    return np.abs(found - wanted) / wanted[:, :1]


def test_four_wavelengths_are_enough_for_the_visible():
    four, six = (
        compute_lighting(STATE, fidelity=Fidelity.FAST, band=BAND, mu0=MU0, albedo=0.2, wavelengths=count)
        for count in (4, 6)
    )
    # 2e-4 rms are stated for a flat response; the worst direction is some times that.
    assert np.max(relative(four, six)) < 1e-3
    assert four.wavelength_error < 5e-4


def test_a_line_of_sight_asked_for_again_has_the_same_air_whatever_was_done_to_it(standard):
    lines = {"zenith_rad": ZENITH_RAD, "phi_rad": PHI_RAD}
    first = standard.path(height_m=5e3, **lines)
    kept = first.copy()
    first[:] = 0.0
    higher, turned = standard.path(height_m=9e3, **lines), standard.path(height_m=5e3, **(lines | {"phi_rad": 0.0}))
    np.testing.assert_array_equal(standard.path(height_m=5e3, **lines), kept)
    assert np.all(higher[:, 0] > kept[:, 0])
    assert not np.allclose(turned, kept)
    through = standard.transmittance(height_m=5e3, zenith_rad=ZENITH_RAD)
    assert np.all(through > standard.transmittance(height_m=9e3, zenith_rad=ZENITH_RAD))
    np.testing.assert_array_equal(standard.transmittance(height_m=5e3, zenith_rad=ZENITH_RAD), through)


def test_standard_is_as_accurate_as_stated(standard):
    layers = [one.layers(fine=True) for one in standard.columns]
    for one, solution, cut in list(zip(standard.columns, standard.solutions, layers, strict=True))[::2]:
        exact = solve(cut, mu0=MU0, albedo=0.2, nodes=16, element_depth=0.02, tolerance=1e-6)
        difference = solution.stokes(one.depth, np.cos(ZENITH_RAD), PHI_RAD, looking="up") - exact.stokes(
            one.depth, np.cos(ZENITH_RAD), PHI_RAD, looking="up"
        )
        mean = np.mean(exact.stokes(one.depth, np.cos(ZENITH_RAD), PHI_RAD, looking="up")[:, 0])
        assert np.max(np.abs(difference)) < 2e-4 * mean


def test_fast_is_as_accurate_as_stated(standard, fast):
    difference = relative(fast, standard)
    assert np.max(difference[:, 0]) < 7e-3
    assert np.sqrt(np.mean(difference[:, 0] ** 2)) < 3e-3
    assert np.max(difference[:, 1:]) < 2e-3


def test_single_scattering_lacks_light(standard):
    single = compute_lighting(STATE, fidelity=Fidelity.SINGLE, band=BAND, mu0=MU0, albedo=0.2)
    share = (
        single.sky(zenith_rad=ZENITH_RAD, phi_rad=PHI_RAD)[:, 0]
        / standard.sky(zenith_rad=ZENITH_RAD, phi_rad=PHI_RAD)[:, 0]
    )
    assert np.all((share > 0.2) & (share < 0.95))
    assert single.direct_irradiance == pytest.approx(standard.direct_irradiance, rel=1e-12)
    assert 0.3 < single.diffuse_irradiance / standard.diffuse_irradiance < 0.9


def test_single_solution_irradiance_is_that_of_its_sky():
    one = single_solution(column(STATE, wavelength_m=550e-9).layers(fine=False), mu0=MU0, albedo=0.0)
    root, weight = np.polynomial.legendre.leggauss(30)
    mu = ((root + 1) / 2) ** 2
    sky = one.stokes(one.depth, mu, np.linspace(0, 2 * np.pi, 120, endpoint=False)[:, np.newaxis], looking="up")
    exact = 2 * np.pi * np.mean(sky[..., 0], axis=0) @ (weight * np.sqrt(mu) * mu)
    assert one.diffuse_irradiance == pytest.approx(exact, rel=1e-3)


def test_direct_beam_is_the_attenuated_spectrum(standard):
    # Extinction 0.42 to 0.63 over the cosine 0.906, and 2 % of ozone: between these bounds, and near 60 %.
    outside = float(BAND.integral(np.ones(61)))
    assert 0.5 * outside < standard.direct_irradiance < 0.7 * outside


def test_ozone_darkens_beam_and_sky_alike():
    usual, bare = (
        compute_lighting(
            AtmosphereState(visibility_m=23e3, ozone_m=ozone_m),
            fidelity=Fidelity.FAST,
            band=BAND,
            mu0=MU0,
            albedo=0.2,
        )
        for ozone_m in (3.44e-3, 0.0)
    )
    # 2.2 % of the beam, 1.8 to 2.8 % of the diffuse light (400 to 700 nm, sun at 25 deg).
    assert 1 - usual.direct_irradiance / bare.direct_irradiance == pytest.approx(0.022, abs=3e-3)
    assert 1 - usual.diffuse_irradiance / bare.diffuse_irradiance == pytest.approx(0.02, abs=5e-3)


def test_analytic_sky_is_polarized_across_the_scattering_plane():
    sky = analytic_sky(mu0=0.6, zenith_radiance=2.0, dolp_max=0.3, zenith_rad=[0.0, 0.7], phi_rad=[0.0, 1.2])
    assert sky[0, 0] == pytest.approx(2.0)
    once = single_solution([], mu0=0.6, albedo=0.0)
    assert once.depth == 0.0
    # At the zenith cos = 0.6: 0.3 * 0.64 / 1.36, horizontal for a frame that faces the sun.
    assert sky[0, 1:] / sky[0, 0] == pytest.approx([0.3 * 0.64 / 1.36, 0.0], abs=1e-12)


def test_analytic_lighting_keeps_beam_and_path_of_single_scattering():
    analytic = compute_lighting(STATE, fidelity=Fidelity.ANALYTIC, band=BAND, mu0=MU0, albedo=0.2, dolp_max=0.25)
    single = compute_lighting(STATE, fidelity=Fidelity.SINGLE, band=BAND, mu0=MU0, albedo=0.2)
    assert isinstance(analytic, AnalyticLighting)
    assert analytic.direct_irradiance == single.direct_irradiance
    np.testing.assert_array_equal(
        analytic.path(height_m=3e3, zenith_rad=0.4, phi_rad=0.3), single.path(height_m=3e3, zenith_rad=0.4, phi_rad=0.3)
    )
    sky = analytic.sky(zenith_rad=ZENITH_RAD, phi_rad=PHI_RAD)
    assert np.max(np.hypot(sky[:, 1], sky[:, 2]) / sky[:, 0]) <= 0.25


def test_a_store_may_stand_in_for_the_solver():
    seen = []

    def remembering(layers, **settings):
        seen.append(settings["nodes"])
        return solve(layers, **settings)

    compute_lighting(STATE, fidelity=Fidelity.FAST, band=BAND, mu0=MU0, albedo=0.2, wavelengths=2, solver=remembering)
    assert seen == [FIDELITY_LEVELS[Fidelity.FAST].settings.nodes] * 2


@pytest.fixture(scope="module")
def fast():
    return compute_lighting(STATE, fidelity=Fidelity.FAST, band=BAND, mu0=MU0, albedo=0.2)


def tabulated(lighting, phi_deg, zenith_deg):
    """Another lighting as a table."""
    zenith, phi = np.radians(zenith_deg), np.radians(phi_deg)
    heights = np.array([0.0, 3e3, 5e3])
    grid = np.meshgrid(zenith, phi, indexing="ij")
    return TableLighting(
        direct_irradiance=lighting.direct_irradiance,
        zenith_rad=zenith,
        phi_rad=phi,
        sky_stokes=lighting.sky(zenith_rad=grid[0], phi_rad=grid[1]),
        height_m=heights,
        path_transmittance=np.array([lighting.transmittance(height_m=h, zenith_rad=zenith) for h in heights]),
        path_stokes=np.array([lighting.path(height_m=h, zenith_rad=grid[0], phi_rad=grid[1]) for h in heights]),
    )


@pytest.mark.parametrize("phi_deg", [np.arange(0, 361, 10.0), np.arange(0, 181, 10.0)])
def test_a_table_gives_back_what_it_holds(fast, phi_deg):
    table = tabulated(fast, phi_deg, np.arange(0, 81, 40.0))
    for zenith_deg, phi in ((0.0, 30.0), (40.0, 130.0), (80.0, 230.0), (40.0, -50.0)):
        place = {"zenith_rad": np.radians(zenith_deg), "phi_rad": np.radians(phi)}
        np.testing.assert_allclose(table.sky(**place), fast.sky(**place), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(
            table.path(height_m=3e3, **place), fast.path(height_m=3e3, **place), rtol=1e-9, atol=1e-12
        )
    assert float(table.transmittance(height_m=5e3, zenith_rad=np.radians(40.0))) == pytest.approx(
        float(fast.transmittance(height_m=5e3, zenith_rad=np.radians(40.0)))
    )


@pytest.mark.parametrize("way", ["sky", "path"])
def test_the_zenith_is_no_special_point_of_a_table(fast, way):
    # Five degrees from the zenith, between the rows at 0 and 10: the frame there turns by half a turn a turn.
    table = tabulated(fast, np.arange(0, 361, 10.0), np.array([0.0, 10.0, 20.0]))
    extra = {} if way == "sky" else {"height_m": 5e3}
    for phi in np.radians([5.0, 95.0, 200.0]):
        place = {"zenith_rad": np.radians(5.0), "phi_rad": phi} | extra
        read, true = getattr(table, way)(**place), getattr(fast, way)(**place)
        # Curvature over 10 degrees: some percent of the polarized part; a frame not turned would cost all of it.
        assert np.hypot(*(read - true)[1:]) < 0.15 * np.hypot(*true[1:])


def test_distance_on_the_25th_of_may():
    # Ephemeris: 0.9748; Spencer's series is within 1e-3 of it.
    assert distance_factor(day_of_year=145) == pytest.approx(0.9748, abs=1e-3)


def test_the_sun_is_nearest_in_january():
    days = np.arange(1, 366)
    factors = [distance_factor(day_of_year=day) for day in days]
    assert days[np.argmax(factors)] <= 6
    assert np.mean(factors) == pytest.approx(1.0, abs=3e-4)  # 1 + 3/2 e^2 - ... over time


def band(**change):
    wavelength = np.linspace(400e-9, 500e-9, 11)
    given = {"wavelength_m": wavelength, "irradiance_w_per_m3": np.full(11, 2e9), "response": np.ones(11)}
    return SolarBand(**(given | change))


def test_limits_enclose_the_response():
    response = np.zeros(11)
    response[3:6] = 1.0
    assert band(response=response).limits_m == pytest.approx((420e-9, 460e-9))


SPECTRUM_M = np.linspace(400e-9, 700e-9, 301)
# A spectrum that is not smooth: lines of all depths.
JAGGED = np.random.default_rng(5).uniform(0.2, 2.0, 301)


def mean(rule, function):
    return float(rule.irradiance @ function(1e-6 / rule.wavelength_m) / np.sum(rule.irradiance))


def mean_of_all(function, irradiance=JAGGED):
    return float(irradiance @ function(1e-6 / SPECTRUM_M) / np.sum(irradiance))


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_polynomials_of_twice_the_degree_are_exact(count):
    rule = spectral_rule(wavelength_m=SPECTRUM_M, irradiance=JAGGED, count=count)
    for degree in range(2 * count):
        # Products of terms between 1.4 and 2.5: rounding only.
        assert mean(rule, lambda x, k=degree: (x - 2.0) ** k) == pytest.approx(
            mean_of_all(lambda x, k=degree: (x - 2.0) ** k), abs=1e-12
        )


def test_wavelengths_rise_and_weights_are_of_the_band():
    rule = spectral_rule(wavelength_m=SPECTRUM_M, irradiance=JAGGED, count=6)
    assert np.all(np.diff(rule.wavelength_m) > 0.0)
    assert np.all(rule.irradiance > 0.0)
    assert np.sum(rule.irradiance) == pytest.approx(np.sum(JAGGED), rel=1e-12)


def kinked(x):
    """Slope that changes where the wavelength is 550 nm."""
    return np.exp(-np.abs(x - 1.0 / 0.55))


def test_a_kink_is_met_by_rules_on_either_side():
    plain = spectral_rule(wavelength_m=SPECTRUM_M, irradiance=JAGGED, count=8)
    split = spectral_rule(wavelength_m=SPECTRUM_M, irradiance=JAGGED, count=8, kinks_m=(550e-9,))
    errors = [abs(mean(rule, kinked) - mean_of_all(kinked)) for rule in (plain, split)]
    assert errors[1] < 1e-8 < 1e-5 < errors[0]


def test_stretches_share_the_wavelengths_by_their_width():
    rule = spectral_rule(
        wavelength_m=SPECTRUM_M, irradiance=JAGGED, count=8, kinks_m=(300e-9, 550e-9, 694.3e-9, 1.06e-6)
    )
    counts = np.histogram(rule.wavelength_m, bins=[400e-9, 550e-9, 694.3e-9, 700e-9])[0]
    # In inverse wavelength the stretches are 64, 35 and 1 % of the band.
    np.testing.assert_array_equal(counts, [6, 3, 1])


def test_dark_samples_do_not_count():
    dark = np.where(SPECTRUM_M < 500e-9, 0.0, JAGGED)
    rule = spectral_rule(wavelength_m=SPECTRUM_M, irradiance=dark, count=4)
    assert np.all(rule.wavelength_m >= 500e-9)
    assert mean(rule, np.square) == pytest.approx(mean_of_all(np.square, dark), rel=1e-12)


@given(seed=st.integers(0, 10_000), samples=st.integers(2, 400), count=st.integers(1, 20))
@settings(deadline=None, max_examples=60)
def test_any_spectrum_has_a_rule_within_it(seed, samples, count):
    draw = np.random.default_rng(seed)
    wavelength_m = np.sort(draw.uniform(3e-7, 1e-6, samples))
    irradiance = draw.exponential(size=samples)
    rule = spectral_rule(wavelength_m=wavelength_m, irradiance=irradiance, count=count)
    assert rule.wavelength_m.size == min(count, samples)
    # Eigenvalues to some rounding errors of the width.
    assert np.all(rule.wavelength_m > wavelength_m[0] * (1.0 - 1e-12))
    assert np.all(rule.wavelength_m < wavelength_m[-1] * (1.0 + 1e-12))
    assert np.sum(rule.irradiance) == pytest.approx(np.sum(irradiance), rel=1e-10)
    x, nodes = 1e-6 / wavelength_m, 1e-6 / rule.wavelength_m
    assert rule.irradiance @ nodes == pytest.approx(irradiance @ x, rel=1e-9)


MU = np.array([1.0, 0.7, 0.3, 0.05])
COLUMN_PHI_RAD = np.array([0.1, 1.0, 2.0, 3.0])
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
    sky = found.stokes(air.depth, MU, COLUMN_PHI_RAD, looking="up")
    below = found.stokes(air.tau_above(height_m), MU, COLUMN_PHI_RAD, looking="down")
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


def small_table(**change):
    table = {
        "direct_irradiance": 1.0,
        "zenith_rad": np.array([0.0, 1.0]),
        "phi_rad": np.array([0.0, 1.0, np.pi]),
        "sky_stokes": np.zeros((2, 3, 3)),
        "height_m": np.array([0.0]),
        "path_transmittance": np.ones((1, 2)),
        "path_stokes": np.zeros((1, 2, 3, 3)),
    }
    return TableLighting(**(table | change))


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: small_table(direct_irradiance=-1.0), "direct_irradiance"),
        (lambda: small_table(zenith_rad=np.array([0.5, 0.1])), "zenith_rad"),
        (lambda: small_table(phi_rad=np.array([0.0, 1.0, 2.0])), "phi_rad"),
        (lambda: small_table(phi_rad=np.array([0.1, 1.0, np.pi])), "phi_rad"),
        (lambda: small_table(sky_stokes=np.zeros((2, 2, 3))), "sky_stokes"),
        (lambda: small_table(path_transmittance=np.full((1, 2), np.nan)), "path_transmittance"),
        (lambda: small_table().sky(zenith_rad=1.1, phi_rad=0.0), "zenith_rad"),
        (lambda: small_table().path(height_m=6e3, zenith_rad=0.1, phi_rad=0.0), "height_m"),
        (lambda: compute_lighting(STATE, fidelity=Fidelity.TABLE, band=BAND, mu0=MU0, albedo=0.2), "TableLighting"),
        *((lambda day=day: distance_factor(day_of_year=day), "day_of_year") for day in (0.5, 367.0, np.nan)),
        (lambda: band(response=np.zeros(11)), "SolarBand"),
        (lambda: band(response=np.full(11, 1.1)), "SolarBand"),
        (lambda: band(irradiance_w_per_m3=np.full(11, -1.0)), "SolarBand"),
        (lambda: band(irradiance_w_per_m3=np.ones(10)), "SolarBand"),
        (lambda: band(wavelength_m=np.linspace(500e-9, 400e-9, 11)), "SolarBand"),
    ],
)
def test_what_is_outside_its_range_is_refused(call, named):
    with pytest.raises(ValueError, match=named):
        call()


@pytest.mark.parametrize("zenith_rad", [-0.1, 1.6, np.nan])
def test_directions_below_the_horizon_are_refused(standard, zenith_rad):
    with pytest.raises(ValueError, match="zenith_rad"):
        standard.sky(zenith_rad=zenith_rad, phi_rad=0.0)
