import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.atmosphere.layers import AerosolKind
from model.atmosphere.solver import Layer, single_scattering, solve

MU = np.array([0.03, 0.15, 0.4, 0.7, 0.95])
PHI = np.array([0.0, 0.4, 1.7, 2.9])
GRID_MU, GRID_PHI = np.meshgrid(MU, PHI)
MIXED = [Layer(0.03, 0.02, 0.96, 0.65, 0.958), Layer(0.06, 0.2, 0.94, 0.66, 0.958)]
KINDS = [AerosolKind.DEPOLARIZING, AerosolKind.POLARIZING]


def both_ways(solution):
    """Light that leaves at the top and at the ground."""
    return np.stack(
        [
            solution.stokes(0.0, GRID_MU, GRID_PHI, looking="down"),
            solution.stokes(solution.depth, GRID_MU, GRID_PHI, looking="up"),
        ]
    )


def hemisphere(solution, tau_above, looking):
    """Irradiance on a horizontal plane: 24 Gauss nodes in the square root of the cosine, mode 0 by 8 azimuths."""
    root, weight = np.polynomial.legendre.leggauss(24)
    root = (root + 1) / 2
    azimuths = 2 * np.pi * np.arange(48) / 48
    mu, phi = np.meshgrid(root**2, azimuths)
    intensity = solution.stokes(tau_above, mu, phi, looking=looking)[..., 0].mean(axis=0)
    return 2 * np.pi * np.sum(weight * root * root**2 * intensity)


@pytest.mark.parametrize("mu0", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("tau", [0.05, 0.5, 2.0])
def test_a_conservative_atmosphere_over_black_ground_keeps_the_energy(mu0, tau):
    solution = solve([Layer(tau, 0.0, 0.0, 0.0, 1.0)], mu0=mu0, albedo=0.0, tolerance=1e-8)
    leaving = hemisphere(solution, 0.0, "down") + hemisphere(solution, tau, "up") + mu0 * np.exp(-tau / mu0)
    # Quadrature of the solver is stated as 1e-5 of the radiance, the test's is finer.
    assert leaving == pytest.approx(mu0, rel=1e-5)


def test_energy_is_kept_with_aerosol_and_a_white_ground():
    layers = [Layer(0.1, 0.2, 1.0, 0.65, 0.958)]
    solution = solve(layers, mu0=0.6, albedo=1.0, tolerance=1e-8)
    # All light that came in leaves at the top.
    assert hemisphere(solution, 0.0, "down") == pytest.approx(0.6, rel=2e-5)


def test_diffuse_irradiance_is_the_integral_of_the_sky():
    solution = solve(MIXED, mu0=0.6, albedo=0.3)
    assert hemisphere(solution, solution.depth, "up") == pytest.approx(solution.diffuse_irradiance, rel=2e-5)


def test_ground_radiance_is_that_of_all_light_that_falls_on_it():
    solution = solve(MIXED, mu0=0.6, albedo=0.3)
    irradiance = 0.6 * np.exp(-solution.depth / 0.6) + solution.diffuse_irradiance
    assert solution.ground_radiance == pytest.approx(0.3 * irradiance / np.pi, rel=1e-12)
    seen = solution.stokes(solution.depth, MU, 0.0, looking="down")
    np.testing.assert_allclose(seen, solution.ground_radiance * np.array([[1.0, 0.0, 0.0]] * 5), atol=1e-15)


@pytest.mark.parametrize("kind", KINDS)
@settings(deadline=None, max_examples=5)
@given(share=st.floats(0.001, 0.999))
def test_the_result_does_not_depend_on_how_a_layer_is_split(kind, share):
    upper, lower = MIXED
    parts = [
        Layer(lower.tau_rayleigh * s, lower.tau_aerosol * s, lower.ssa_aerosol, lower.g_aerosol, lower.delta)
        for s in (share, 1 - share)
    ]
    whole = both_ways(solve(MIXED, mu0=0.5, albedo=0.1, aerosol=kind, nodes=6))
    split = both_ways(solve([upper, *parts], mu0=0.5, albedo=0.1, aerosol=kind, nodes=6))
    np.testing.assert_allclose(split, whole, rtol=1e-9, atol=1e-14)  # alike layers are joined: rounding only


def test_the_result_does_not_depend_on_where_elements_lie():
    # A difference of composition too small to matter keeps the two halves apart.
    whole = both_ways(solve([Layer(0.5, 0.0, 0.0, 0.0, 1.0)], mu0=0.3, albedo=0.2))
    halves = [Layer(0.23, 0.0, 0.0, 0.0, 1.0), Layer(0.27, 0.0, 0.0, 0.0, 1.0 - 1e-9)]
    split = both_ways(solve(halves, mu0=0.3, albedo=0.2))
    np.testing.assert_allclose(split, whole, atol=1e-5 * np.max(whole))


@pytest.mark.parametrize("kind", KINDS)
@settings(deadline=None, max_examples=10)
@given(mu=st.floats(0.0, 1.0), phi=st.floats(-3.1, 3.1), mu0=st.floats(0.0872, 1.0))
def test_reversing_the_azimuth_reverses_s2_alone(kind, mu, phi, mu0):
    solution = solve(MIXED, mu0=mu0, albedo=0.1, aerosol=kind, nodes=4, element_depth=0.2)
    for looking in ("up", "down"):
        one = solution.stokes(0.1, mu, phi, looking=looking)
        other = solution.stokes(0.1, mu, -phi, looking=looking)
        np.testing.assert_allclose(other, one * [1, 1, -1], rtol=1e-12, atol=1e-14)


def test_s2_vanishes_on_the_principal_plane():
    solution = solve(MIXED, mu0=0.6, albedo=0.1, aerosol=AerosolKind.POLARIZING)
    for phi in (0.0, np.pi):
        assert np.max(np.abs(solution.stokes(0.2, MU, phi, looking="up")[:, 2])) < 1e-15


def test_the_frame_turns_with_the_azimuth_at_the_zenith():
    solution = solve(MIXED, mu0=0.6, albedo=0.1)
    along, across = solution.stokes(solution.depth, 1.0, [0.0, np.pi / 2], looking="up")
    np.testing.assert_allclose(across, along * [1, -1, 1], rtol=1e-9, atol=1e-12)


def test_a_sun_at_the_zenith_lights_every_azimuth_alike():
    sky = solve(MIXED, mu0=1.0, albedo=0.1).stokes(0.31, GRID_MU, GRID_PHI, looking="up")
    np.testing.assert_allclose(sky, np.broadcast_to(sky[:1], sky.shape), rtol=1e-12, atol=1e-15)
    assert np.max(np.abs(sky[..., 2])) < 1e-15


def test_horizon_sky_under_a_sun_at_the_zenith_vibrates_horizontally():
    s0, s1, _ = solve([Layer(0.1, 0.0, 0.0, 0.0, 1.0)], mu0=1.0, albedo=0.0).stokes(0.1, 0.01, 0.0, looking="up")
    assert s1 / s0 > 0.7


def test_a_thin_atmosphere_scatters_once():
    tau = 1e-6
    solution = solve([Layer(tau, 0.0, 0.0, 0.0, 1.0)], mu0=0.6, albedo=0.0)
    once = single_scattering(
        solution.layers, mu0=0.6, tau_above=np.full(5, tau), mu=MU, phi_rad=np.full(5, 0.4), upward=False
    )
    sky = solution.stokes(tau, MU, 0.4, looking="up")
    # Second order over first is the depth times its slant logarithm, below 20 tau.
    np.testing.assert_allclose(sky, once * [1, -1, -1], atol=20 * tau * np.max(once))


def test_no_light_comes_up_from_black_ground_nor_down_from_space():
    solution = solve(MIXED, mu0=0.6, albedo=0.0)
    assert not np.any(solution.stokes(solution.depth, MU, 0.3, looking="down"))
    assert not np.any(solution.stokes(0.0, MU, 0.3, looking="up"))


def test_no_atmosphere_leaves_the_ground_in_the_beam():
    solution = solve([], mu0=0.5, albedo=0.4)
    np.testing.assert_allclose(solution.stokes(0.0, 0.7, 0.0, looking="down"), [0.4 * 0.5 / np.pi, 0.0, 0.0])
    assert not np.any(solution.stokes(0.0, 0.7, 0.0, looking="up"))


@pytest.mark.parametrize("looking", ["up", "down"])
def test_view_along_the_sun_is_no_special_direction(looking):
    solution = solve(MIXED, mu0=0.6, albedo=0.1)
    at, near = solution.stokes(0.2, [0.6, 0.6 + 1e-9], 0.4, looking=looking)
    np.testing.assert_allclose(at, near, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("looking", ["up", "down"])
def test_horizon_is_the_limit_of_low_lines_of_sight(looking):
    solution = solve(MIXED, mu0=0.6, albedo=0.1)
    at, near = solution.stokes(0.2, [0.0, 1e-7], 0.4, looking=looking)
    np.testing.assert_allclose(at, near, rtol=1e-4)  # the sine, and the source over a depth of 1e-7


def test_radiance_is_continuous_across_levels():
    solution = solve(MIXED, mu0=0.6, albedo=0.1)
    for tau in solution.edges[1:-1]:
        below, above = solution.stokes([tau - 1e-9, tau + 1e-9], 0.3, 0.7, looking="up")
        np.testing.assert_allclose(below, above, rtol=1e-6, atol=1e-9)  # slope times 2e-9 over mu


def test_pure_absorbers_make_no_light():
    solution = solve([Layer(0.0, 0.3, 0.0, 0.0, 0.0)], mu0=0.5, albedo=0.0)
    assert not np.any(both_ways(solution))
    assert solution.converged


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("mu0", "albedo"), [(0.15, 0.0), (0.9, 0.5)])
def test_the_error_is_not_larger_than_estimated(kind, mu0, albedo):
    layers = [Layer(0.03, 0.02, 0.96, 0.7, 0.958), Layer(0.06, 0.2, 0.94, 0.72, 0.958)]
    exact = both_ways(solve(layers, mu0=mu0, albedo=albedo, aerosol=kind, nodes=20, tolerance=1e-8))
    mean = np.mean(exact[..., 0], axis=(1, 2), keepdims=True)[..., np.newaxis]
    for nodes in (6, 8, 12):
        coarse = solve(layers, mu0=mu0, albedo=albedo, aerosol=kind, nodes=nodes, element_depth=0.1)
        # The estimate is of one order more on a finer grid; within a factor two it is an upper bound.
        assert np.max(np.abs(both_ways(coarse) - exact) / mean) < 2 * coarse.error_estimate


def test_the_estimate_falls_with_the_effort():
    estimates = [solve(MIXED, mu0=0.5, albedo=0.1, nodes=nodes).error_estimate for nodes in (4, 8, 16)]
    assert estimates[0] > 3 * estimates[1] > 9 * estimates[2]


def test_orders_left_out_are_estimated():
    layers = [Layer(1.0, 0.0, 0.0, 0.0, 1.0)]
    exact = both_ways(solve(layers, mu0=0.6, albedo=0.5, tolerance=1e-10))
    short = solve(layers, mu0=0.6, albedo=0.5, max_orders=10)
    assert not short.converged
    missing = np.max(np.abs(both_ways(short) - exact)[..., 0] / exact[..., 0])
    # Geometric tail: right within a factor two, plus what the quadrature adds.
    assert 0.5 * missing < short.error_estimate < 3 * missing


def test_a_looser_tolerance_takes_fewer_orders():
    loose, tight = (solve(MIXED, mu0=0.6, albedo=0.2, tolerance=t) for t in (1e-3, 1e-7))
    assert loose.orders < tight.orders
    assert loose.converged
    assert tight.converged


def test_a_polarizing_aerosol_polarizes_the_sky_more():
    dolp = []
    for kind in KINDS:
        sky = solve(MIXED, mu0=0.9, albedo=0.0, aerosol=kind).stokes(0.31, GRID_MU, GRID_PHI, looking="up")
        dolp.append(np.max(np.hypot(sky[..., 1], sky[..., 2]) / sky[..., 0]))
    assert dolp[1] > dolp[0] * 1.1


def test_shapes_broadcast():
    solution = solve(MIXED, mu0=0.6, albedo=0.1, nodes=4)
    assert solution.stokes(0.1, MU[:, np.newaxis], PHI, looking="up").shape == (5, 4, 3)
    assert solution.stokes(0.1, 0.5, 0.2, looking="down").shape == (3,)
    assert solution.stokes(0.1, np.zeros(0), 0.2, looking="down").shape == (0, 3)


def test_many_directions_equal_the_same_one_by_one():
    solution = solve(MIXED, mu0=0.6, albedo=0.1, nodes=4)
    mu = np.linspace(0.0, 1.0, 1200)
    many = solution.stokes(0.1, mu, 0.4, looking="up")
    np.testing.assert_allclose(
        many[[0, 511, 512, 1199]],
        [solution.stokes(0.1, mu[i], 0.4, looking="up") for i in (0, 511, 512, 1199)],
        rtol=1e-12,
    )


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"mu0": np.cos(np.radians(85.1))}, "85.10 deg"),
        ({"mu0": 1.01}, "mu0"),
        ({"mu0": np.nan}, "mu0"),
        ({"albedo": -0.1}, "albedo"),
        ({"albedo": np.nan}, "albedo"),
        ({"nodes": 3}, "nodes"),
        ({"element_depth": 0.0}, "element_depth"),
        ({"tolerance": np.nan}, "tolerance"),
        ({"max_orders": 0}, "max_orders"),
        ({"aerosol": "bright"}, "bright"),
    ],
)
def test_arguments_out_of_range_are_refused(change, named):
    with pytest.raises(ValueError, match=named):
        solve(MIXED, **({"mu0": 0.5, "albedo": 0.1} | change))


def test_a_sun_at_85_degrees_is_allowed():
    assert solve(MIXED, mu0=np.cos(np.radians(85.0)), albedo=0.0).converged


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ((-0.1, 0.5, 0.0, "up"), "tau_above"),
        ((0.4, 0.5, 0.0, "up"), "tau_above"),
        ((0.1, 1.1, 0.0, "up"), "mu"),
        ((0.1, np.nan, 0.0, "up"), "mu"),
        ((0.1, 0.5, np.inf, "up"), "phi_rad"),
        ((0.1, 0.5, 0.0, "sideways"), "looking"),
    ],
)
def test_requests_out_of_range_are_refused(arguments, named):
    solution = solve(MIXED, mu0=0.6, albedo=0.1, nodes=4)
    with pytest.raises(ValueError, match=named):
        solution.stokes(*arguments[:3], looking=arguments[3])
