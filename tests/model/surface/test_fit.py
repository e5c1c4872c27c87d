"""Fits of simulated regions: truth comes back, intervals cover it, and what cannot be known is said."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import bdtr, bdtrc, chdtrc

from model.surface.fit import Observation, fit_surface, gauss_interval, profile_interval, sunlit
from model.surface.pbrdf import Surface, mueller

# Sun zenith, camera zenith, phi [deg]: glint, its flanks, and directions without it.
WIDE = [(50, 50, 180), (50, 40, 180), (60, 45, 160), (30, 30, 170), (40, 50, 90), (20, 60, 0), (65, 55, 180)]
PAINT = Surface(n=1.5, slope_rms=0.2, dhr=0.1, shadowing="smith", diffuse="lambert")
DUSTY = Surface(n=1.6, slope_rms=0.3, dhr=0.09, specular_weight=0.7, shadowing="smith", diffuse="lambert")


def regions(surface: Surface, angles_deg: list, *, relative: float, seed: int) -> list[Observation]:
    rng = np.random.default_rng(seed)
    observations = []
    for theta_i, theta_r, phi in np.deg2rad(angles_deg):
        irradiance = 1000.0 * np.cos(theta_i)
        truth = mueller(theta_i, theta_r, phi, surface=surface)[:, 0] * irradiance
        spread = relative * truth[0]
        # S0, S1 and S2 share part of their noise, as Stokes parameters from four angles do.
        covariance = spread**2 * np.array([[1.0, 0.2, -0.1], [0.2, 2.0, 0.3], [-0.1, 0.3, 2.0]])
        observations.append(
            sunlit(
                theta_i_rad=theta_i,
                theta_r_rad=theta_r,
                phi_rad=phi,
                irradiance=irradiance,
                stokes=rng.multivariate_normal(truth, covariance),
                covariance=covariance,
            )
        )
    return observations


def counted(observations: list[Observation], *, gain: float, scale: str) -> list[Observation]:
    """The same regions in counts of a camera whose calibration nobody knows."""
    return [
        replace(
            observation,
            stokes=gain * np.asarray(observation.stokes),
            covariance=gain**2 * np.asarray(observation.covariance),
            scale=scale,
        )
        for observation in observations
    ]


def require_rate(hits: int, trials: int, level: float) -> None:
    """Two-sided binomial test at 1e-4: a right interval fails it once in ten thousand seeds."""
    assert bdtr(hits, trials, level) > 5e-5
    assert hits == 0 or bdtrc(hits - 1, trials, level) > 5e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "free"),
    [(PAINT, ("n", "slope_rms", "dhr")), (DUSTY, ("n", "slope_rms", "dhr", "specular_weight"))],
    ids=["paint", "dusty"],
)
def test_intervals_cover_the_truth_at_their_rate(truth: Surface, free: tuple) -> None:
    trials = 120
    hits = dict.fromkeys(free, 0)
    for seed in range(trials):
        fit = fit_surface(regions(truth, WIDE, relative=0.003, seed=seed), start=truth, free=free)
        for name in free:
            low, high = gauss_interval(fit, name)
            hits[name] += low <= getattr(truth, name) <= high
    for name in free:
        require_rate(hits[name], trials, 0.95)


def test_coupled_fit_scatters_as_it_says() -> None:
    truth = Surface(n=1.5, slope_rms=0.2, dhr=0.4, shadowing="smith", diffuse="coupled")
    free, trials, distance = ("n", "slope_rms", "dhr"), 12, 0.0
    for seed in range(trials):
        fit = fit_surface(regions(truth, WIDE, relative=0.003, seed=seed), start=truth, free=free)
        spread = fit.information.standard_uncertainty
        offset = (fit.values - np.array([truth.n, truth.slope_rms, truth.dhr])) / spread
        distance += float(offset @ np.linalg.solve(fit.information.correlation, offset))
    # Sum of squared normal deviates, three a fit.
    assert 1e-4 < chdtrc(3 * trials, distance) < 1.0 - 1e-4


def test_a_start_far_off_finds_the_truth() -> None:
    fit = fit_surface(
        regions(DUSTY, WIDE, relative=1e-4, seed=1),
        start=Surface(n=1.3, slope_rms=0.15, dhr=0.3, shadowing="smith", diffuse="lambert"),
        free=("n", "slope_rms", "dhr", "specular_weight"),
    )
    truth = np.array([DUSTY.n, DUSTY.slope_rms, DUSTY.dhr, DUSTY.specular_weight])
    # Five standard uncertainties; four parameters, so a chance of 2e-6.
    assert np.all(np.abs(fit.values - truth) < 5.0 * fit.information.standard_uncertainty)
    assert fit.degrees_of_freedom == 17
    assert fit.p_value > 1e-4
    assert fit.findings == ()


def test_a_metal_is_fitted_where_k_matters() -> None:
    # Neutral to colour, n and k show in the depth of the pseudo-Brewster dip alone: angles up to 75 deg.
    truth = Surface(n=1.8, k=1.5, slope_rms=0.2, shadowing="smith")
    glints = [(angle, angle, 180) for angle in (20, 40, 55, 65, 70, 75)]
    fit = fit_surface(
        regions(truth, glints, relative=1e-3, seed=2),
        start=Surface(n=1.5, k=1.0, slope_rms=0.25, shadowing="smith"),
        free=("n", "k", "slope_rms"),
    )
    offset = np.abs(fit.values - [1.8, 1.5, 0.2])
    assert np.all(offset < 5.0 * fit.information.standard_uncertainty)
    assert fit.information.standard_uncertainty[1] < 0.05


def test_sky_light_is_summed_over_its_sources() -> None:
    truth = PAINT
    theta, phi = np.array([0.3, 0.8, 1.1]), np.array([3.0, -1.0, 0.5])
    irradiance = np.array([[500.0, 0.0, 0.0], [40.0, -10.0, 5.0], [30.0, 3.0, -8.0]])
    observations = []
    for theta_r in (0.3, 0.8, 1.0):
        stokes = np.einsum("jab,jb->a", mueller(theta, theta_r, phi, surface=truth), irradiance)
        covariance = np.diag([1e-4, 1e-4, 1e-4]) * stokes[0] ** 2
        observations.append(
            Observation(
                theta_i_rad=theta,
                phi_rad=phi,
                theta_r_rad=theta_r,
                irradiance=irradiance,
                stokes=stokes,
                covariance=covariance,
            )
        )
    start = Surface(n=1.45, slope_rms=0.25, dhr=0.15, shadowing="smith", diffuse="lambert")
    fit = fit_surface(observations, start=start)
    # No noise: what is left is the search's own tolerance, 1e-8 of chi-square.
    np.testing.assert_allclose(fit.values, [1.5, 0.2, 0.1], atol=1e-4)
    assert fit.chi_square < 1e-4


def test_counts_of_unknown_scale_give_the_same_surface_whatever_the_scale() -> None:
    seen = regions(PAINT, WIDE, relative=0.003, seed=10)
    fits = [fit_surface(counted(seen, gain=gain, scale="run"), start=PAINT) for gain in (1.0, 1e6)]
    # The factor drops out of the residuals up to rounding, which the search magnifies to its own tolerance at most.
    np.testing.assert_allclose(fits[1].values, fits[0].values, rtol=1e-7)
    assert fits[0].chi_square == pytest.approx(fits[1].chi_square, rel=1e-7)
    assert fits[0].degrees_of_freedom == fit_surface(seen, start=PAINT).degrees_of_freedom - 1


def test_each_scale_has_its_own_factor() -> None:
    seen = regions(PAINT, WIDE, relative=1e-4, seed=11)
    runs = [*counted(seen[:3], gain=50.0, scale="morning"), *counted(seen[3:], gain=0.2, scale="noon")]
    start = Surface(n=1.4, slope_rms=0.25, dhr=0.2, shadowing="smith", diffuse="lambert")
    fit = fit_surface(runs, start=start)
    # Five standard uncertainties; three parameters, so a chance of 2e-6.
    assert np.all(np.abs(fit.values - [1.5, 0.2, 0.1]) < 5.0 * fit.information.standard_uncertainty)
    assert fit.degrees_of_freedom == 21 - 3 - 2


@pytest.mark.slow
def test_intervals_cover_the_truth_where_every_region_has_a_scale_of_its_own() -> None:
    trials, hits = 120, dict.fromkeys(("n", "slope_rms", "dhr"), 0)
    for seed in range(trials):
        seen = regions(PAINT, WIDE, relative=0.003, seed=seed)
        fit = fit_surface([replace(region, scale=str(i)) for i, region in enumerate(seen)], start=PAINT)
        for name in hits:
            low, high = gauss_interval(fit, name)
            hits[name] += low <= getattr(PAINT, name) <= high
    for name in hits:
        require_rate(hits[name], trials, 0.95)


def test_the_weight_of_a_bare_lobe_needs_a_known_scale() -> None:
    bare = Surface(n=1.5, slope_rms=0.2, specular_weight=0.7, shadowing="smith")
    seen = regions(bare, WIDE[:4], relative=0.003, seed=12)
    run = counted(seen, gain=3.0, scale="run")
    with pytest.raises(ValueError, match="unknown: give the start a dhr"):
        fit_surface(run, start=bare, free=("n", "slope_rms", "specular_weight"))
    fit = fit_surface([*run, seen[0]], start=bare, free=("n", "slope_rms", "specular_weight"))
    weight = fit.names.index("specular_weight")
    # Five standard uncertainties: a chance of 6e-7.
    assert abs(fit.values[weight] - 0.7) < 5.0 * fit.information.standard_uncertainty[weight] < 0.1


def test_directions_without_the_glint_cannot_tell() -> None:
    truth = Surface(n=1.5, slope_rms=0.1, dhr=0.5, diffuse="lambert")
    fit = fit_surface(
        regions(truth, [(30, 50, 0), (40, 20, 0)], relative=0.003, seed=3),
        start=truth,
        free=("n", "dhr", "specular_weight"),
    )
    assert np.isinf(fit.information.standard_uncertainty[fit.names.index("specular_weight")])
    assert any("not at all" in words and "specular_weight" in words for words in fit.findings)
    assert gauss_interval(fit, "specular_weight") == (-np.inf, np.inf)


def test_one_glint_gives_a_product_of_slope_and_weight_only() -> None:
    fit = fit_surface(
        regions(Surface(n=1.5, slope_rms=0.1), [(50, 50, 180), (45, 45, 180)], relative=0.003, seed=4),
        start=Surface(n=1.5, slope_rms=0.1, specular_weight=0.9),
        free=("slope_rms", "specular_weight"),
    )
    assert any("slope_rms and specular_weight" in words for words in fit.findings)


def test_a_wrong_model_is_noticed() -> None:
    truth = Surface(n=1.5, slope_rms=0.2, dhr=0.5, shadowing="smith", diffuse="polarised")
    fit = fit_surface(regions(truth, WIDE, relative=0.001, seed=5), start=PAINT)
    assert fit.p_value < 1e-3
    assert any("misses the data" in words for words in fit.findings)


def test_a_bound_is_noticed() -> None:
    fit = fit_surface(
        regions(PAINT, WIDE, relative=0.003, seed=6),
        start=Surface(n=1.4, slope_rms=0.2, dhr=0.1, shadowing="smith", diffuse="lambert"),
        free=("n", "slope_rms"),
        bounds={"n": (1.2, 1.45)},
    )
    assert fit.surface.n == pytest.approx(1.45, abs=1e-6)
    assert any("n ends at its upper bound" in words for words in fit.findings)


def test_profile_agrees_with_first_order_where_the_model_is_straight() -> None:
    fit = fit_surface(regions(PAINT, WIDE, relative=1e-3, seed=8), start=PAINT)
    for name in fit.names:
        straight, profiled = gauss_interval(fit, name), profile_interval(fit, name)
        width = straight[1] - straight[0]
        # Ends are sought to 2e-3 of the half width; what the model bends over 1e-3 relative noise is of that order.
        np.testing.assert_allclose(profiled, straight, atol=0.01 * width)


@pytest.mark.slow
def test_profile_covers_where_the_model_bends() -> None:
    # Noisy glints: with the first seed n = 1.435, 1.350 to 1.520 to first order, 1.370 to 1.572 by the profile.
    truth = Surface(n=1.4, slope_rms=0.25, shadowing="smith")
    flanks, trials, hits = [(40, 40, 180), (60, 30, 180), (20, 50, 160)], 60, 0
    for seed in range(trials):
        fit = fit_surface(regions(truth, flanks, relative=0.1, seed=seed), start=truth, free=("n", "slope_rms"))
        low, high = profile_interval(fit, "n")
        hits += low <= truth.n <= high
    require_rate(hits, trials, 0.95)


def test_profile_stops_at_a_bound() -> None:
    truth = Surface(n=1.5, slope_rms=0.2, dhr=0.1, specular_weight=0.995, shadowing="smith", diffuse="lambert")
    fit = fit_surface(
        regions(truth, WIDE, relative=0.003, seed=9), start=truth, free=("n", "slope_rms", "dhr", "specular_weight")
    )
    low, high = profile_interval(fit, "specular_weight")
    assert low < 0.995
    assert high == 1.0


def test_dhr_never_falls_below_the_lobe() -> None:
    # Black: the diffuse part is zero, and noise would take it below.
    share = 0.0409
    truth = Surface(n=1.5, slope_rms=0.2, dhr=share, shadowing="smith", diffuse="lambert")
    for seed in range(5):
        fit = fit_surface(
            regions(truth, WIDE, relative=0.02, seed=seed),
            start=Surface(n=1.5, slope_rms=0.2, dhr=0.06, shadowing="smith", diffuse="lambert"),
        )
        assert fit.surface.diffuse_term is not None
        assert fit.surface.diffuse_term.excess >= 0.0


def test_a_fixed_dhr_that_the_lobe_exceeds_is_refused() -> None:
    # Glints so bright that a diffuse part of a few hundredths does not matter: they want n = 1.9, whose 0.096 at
    # normal incidence the DHR of 0.05 does not allow.
    glints = [(20, 20, 180), (45, 45, 180), (60, 60, 180)]
    with pytest.raises(ValueError, match="specular_weight"):
        fit_surface(
            regions(Surface(n=1.9, slope_rms=0.05), glints, relative=0.003, seed=1),
            start=Surface(n=1.5, slope_rms=0.05, dhr=0.05, diffuse="lambert"),
            free=("n", "slope_rms"),
        )


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"free": ("m",)}, "allowed are n, k"),
        ({"free": ()}, "allowed are n, k"),
        ({"bounds": {"n": (2.0, 1.0)}}, "bounds of n"),
        ({"bounds": {"slope_rms": (0.0, 1.0)}}, "bounds of slope_rms"),
        ({"bounds": {"dhr": (0.0, 0.5)}}, "dhr takes no bounds"),
        ({"start": Surface(n=1.5, slope_rms=0.2), "free": ("dhr",)}, "give the start a dhr"),
    ],
)
def test_questions_are_checked(arguments: dict, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        fit_surface(regions(PAINT, WIDE, relative=0.01, seed=1), **{"start": PAINT, **arguments})


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"theta_i_rad": [0.1, 0.2]}, "phi_rad"),
        ({"theta_r_rad": -0.1}, "theta_r_rad"),
        ({"irradiance": [1.0, 0.0, 0.0]}, "irradiance"),
        ({"stokes": [1.0, np.nan, 0.0]}, "stokes"),
        ({"covariance": np.diag([1.0, 0.0, 1.0])}, "positive definite"),
        ({"covariance": [[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]}, "symmetric"),
    ],
)
def test_observations_are_checked(changes: dict, word: str) -> None:
    plain = {
        "theta_i_rad": [0.1],
        "phi_rad": [0.2],
        "theta_r_rad": 0.3,
        "irradiance": [[1.0, 0.0, 0.0]],
        "stokes": [1.0, 0.0, 0.0],
        "covariance": np.eye(3),
    }
    with pytest.raises(ValueError, match=word):
        Observation(**{**plain, **changes})


@pytest.mark.parametrize("name", ["m", "k"])
def test_intervals_are_of_fitted_parameters(name: str) -> None:
    fit = fit_surface(regions(PAINT, WIDE, relative=0.003, seed=1), start=PAINT)
    with pytest.raises(ValueError, match="was not fitted"):
        gauss_interval(fit, name)
    with pytest.raises(ValueError, match="level"):
        gauss_interval(fit, "n", level=1.0)
