import numpy as np
import pytest

from model.atmosphere.air import AtmosphereState, column
from model.atmosphere.sky import (
    FIDELITY_LEVELS,
    AnalyticLighting,
    Fidelity,
    SolarBand,
    TableLighting,
    analytic_sky,
    compute_lighting,
    path_radiance,
    path_transmittance,
    single_solution,
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


def test_sky_irradiance_of_the_rural_atmosphere(at_550):
    assert at_550[1].diffuse_irradiance == pytest.approx(0.2385, abs=2e-4)


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


def test_path_over_black_ground_from_the_ground_is_dark(at_550):
    one, solution = at_550
    assert not np.any(path_radiance(solution, tau_above=one.tau_above(0.0), mu=0.4, phi_rad=1.0))


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


def test_transmittance_lies_between_those_of_the_wavelengths(standard):
    value = float(standard.transmittance(height_m=5e3, zenith_rad=0.3))
    each = [np.exp(-(one.depth - float(one.tau_above(5e3))) / np.cos(0.3)) for one in standard.columns]
    assert min(each) < value < max(each)


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


def test_every_tier_states_its_accuracy_and_time():
    for fidelity in Fidelity:
        assert FIDELITY_LEVELS[fidelity].accuracy
        assert FIDELITY_LEVELS[fidelity].seconds >= 0.0


def test_a_table_is_not_computed():
    with pytest.raises(ValueError, match="TableLighting"):
        compute_lighting(STATE, fidelity=Fidelity.TABLE, band=BAND, mu0=MU0, albedo=0.2)


@pytest.mark.parametrize("zenith_rad", [-0.1, 1.6, np.nan])
def test_directions_below_the_horizon_are_refused(standard, zenith_rad):
    with pytest.raises(ValueError, match="zenith_rad"):
        standard.sky(zenith_rad=zenith_rad, phi_rad=0.0)


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


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"direct_irradiance": -1.0}, "direct_irradiance"),
        ({"zenith_rad": np.array([0.5, 0.1])}, "zenith_rad"),
        ({"phi_rad": np.array([0.0, 1.0, 2.0])}, "phi_rad"),
        ({"phi_rad": np.array([0.1, 1.0, np.pi])}, "phi_rad"),
        ({"sky_stokes": np.zeros((2, 2, 3))}, "sky_stokes"),
        ({"path_transmittance": np.full((1, 2), np.nan)}, "path_transmittance"),
    ],
)
def test_tables_that_do_not_fit_are_refused(change, named):
    given = {
        "direct_irradiance": 1.0,
        "zenith_rad": np.array([0.0, 1.0]),
        "phi_rad": np.array([0.0, 1.0, np.pi]),
        "sky_stokes": np.zeros((2, 3, 3)),
        "height_m": np.array([0.0]),
        "path_transmittance": np.ones((1, 2)),
        "path_stokes": np.zeros((1, 2, 3, 3)),
    }
    TableLighting(**given)
    with pytest.raises(ValueError, match=named):
        TableLighting(**(given | change))


def test_places_outside_a_table_are_refused(fast):
    table = tabulated(fast, np.arange(0, 181, 30.0), np.array([0.0, 40.0]))
    with pytest.raises(ValueError, match="zenith_rad"):
        table.sky(zenith_rad=1.0, phi_rad=0.0)
    with pytest.raises(ValueError, match="height_m"):
        table.path(height_m=6e3, zenith_rad=0.1, phi_rad=0.0)
