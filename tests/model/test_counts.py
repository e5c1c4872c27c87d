"""The law of a count against sums over its numbers, and a likelihood that another program maximises."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import norm, poisson

from model.counts import (
    estimate_signal,
    find_hits,
    find_single_hits,
    least_variance,
    rounded_moments,
    rounding_error_rms,
    spread_error_rms,
    variance_error_rms,
)


@pytest.mark.parametrize("std", [0.3, 0.4, 0.5, 0.7, 1.3])
@pytest.mark.parametrize("level", [12.0, 12.1, 12.25, 12.5, 12.8])
def test_moments_of_rounded_counts_are_those_of_a_sum_over_whole_numbers(std, level):
    k = np.arange(0, 30)
    share = norm.cdf(k + 0.5, level, std) - norm.cdf(k - 0.5, level, std)
    mean = share @ k
    shift, variance = rounded_moments(level, std**2)
    # Eight harmonics leave exp(-2 (9 pi 0.3)^2) of nothing; the sum stops at 12 deviations.
    assert shift == pytest.approx(mean - level, abs=1e-10)
    assert variance == pytest.approx(share @ (k - mean) ** 2, abs=1e-10)


@pytest.mark.parametrize("level", [12.0, 12.25, 12.5, 12.75])
def test_moments_of_rounded_photons_are_those_of_a_sum_over_electrons(level):
    gain, electrons, read_e = 0.014, 540.0, 10.0
    n, k = np.arange(300, 800)[:, None], np.arange(0, 30)
    at = level + gain * (n - electrons)
    share = norm.cdf(k + 0.5, at, gain * read_e) - norm.cdf(k - 0.5, at, gain * read_e)
    share = poisson.pmf(n[:, 0], electrons) @ share
    mean = share @ k
    shift, variance = rounded_moments(level, gain**2 * (electrons + read_e**2), 0.0, gain**3 * electrons)
    # Without the third moment they are off by up to 0.0015 and by 0.7 %.
    assert shift == pytest.approx(mean - level, abs=1e-4)
    assert variance == pytest.approx(share @ (k - mean) ** 2, rel=3e-4)


@pytest.mark.parametrize("std", [0.05, 0.2, 0.45])
def test_error_of_a_rounded_mean_is_the_root_mean_square_over_where_it_lies(std):
    means = np.arange(0.0, 1.0, 1e-3) + 5e-4
    k = np.arange(-6, 8)[:, None]
    errors = np.sum((norm.cdf(k + 0.5, means, std) - norm.cdf(k - 0.5, means, std)) * k, axis=0) - means
    assert rounding_error_rms(std) == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-6)


def test_texture_dithers_and_is_not_noise():
    at, k = np.linspace(-8.0, 8.0, 4001), np.arange(0, 30)[:, None]
    weight = norm.pdf(at) / norm.pdf(at).sum()
    levels = 12.2 + 0.3 * at
    share = norm.cdf(k + 0.5, levels, 0.4) - norm.cdf(k - 0.5, levels, 0.4)
    means = np.sum(share * k, axis=0)
    shift, variance = rounded_moments(12.2, 0.16, 0.09)
    assert shift == pytest.approx(means @ weight - 12.2, abs=1e-9)
    # Squares of each pixel's shift are taken by their first harmonic: the next is exp(-16 pi^2 0.16) of it.
    assert variance == pytest.approx(np.sum(share * (k - means) ** 2, axis=0) @ weight, abs=1e-8)


PLACES_DN = np.linspace(0.0, 1.0, 50, endpoint=False)
COUNTS = np.arange(-6.0, 8.0)


def rounded(noise_dn2, places_dn=PLACES_DN):
    """Mean and variance of the whole counts that noise about each place is rounded to."""
    at = (COUNTS[:, None] - places_dn) / np.sqrt(noise_dn2)
    half = 0.5 / np.sqrt(noise_dn2)
    share = norm.cdf(at + half) - norm.cdf(at - half)
    mean = COUNTS @ share
    return mean, np.square(COUNTS) @ share - np.square(mean)


@pytest.mark.parametrize("noise_dn2", [0.06, 0.1, 0.16, 0.25])
def test_first_harmonics_are_nearly_all_of_it(noise_dn2):
    variance = rounded(noise_dn2)[1]
    noise, none = np.array(noise_dn2), np.array(0.0)
    found = np.sqrt(np.mean(np.square(variance - noise_dn2 - 1.0 / 12.0)))
    assert found == pytest.approx(float(variance_error_rms(noise, none)), rel=0.05)


@pytest.mark.parametrize("noise_dn2", [0.08, 0.1, 0.16, 0.25, 0.5])
def test_a_measured_variance_promises_no_more_dither_than_there_is(noise_dn2):
    variance = rounded(noise_dn2)[1]
    least = least_variance(variance, np.zeros_like(variance))
    # The second harmonic tells where noise is a quarter of a count and less.
    assert least.max() <= noise_dn2 + 0.01
    # Half-way between two counts it is the noise itself; where nothing is hidden all over.
    assert least[len(PLACES_DN) // 2] == pytest.approx(noise_dn2, abs=0.01)


@pytest.mark.parametrize(("noise_dn2", "pattern_dn"), [(0.1, 0.12), (0.13, 0.2), (0.2, 0.3)])
def test_pixels_are_pushed_together_or_apart(noise_dn2, pattern_dn):
    nodes, weights = np.polynomial.hermite_e.hermegauss(40)
    weights = weights / weights.sum()
    off = []
    for place_dn in PLACES_DN:
        means = rounded(noise_dn2, place_dn + pattern_dn * nodes)[0]
        off.append(weights @ np.square(means) - (weights @ means) ** 2 - pattern_dn**2)
    stated = spread_error_rms(np.array(noise_dn2), np.array(pattern_dn**2))
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(float(stated), rel=0.1)


@pytest.mark.parametrize(("mean", "std", "highest"), [(10.0, 10.5, 255), (12.47, 0.37, 255), (3.0, 6.0, 9)])
def test_the_signal_behind_counts_is_that_of_greatest_likelihood(mean, std, highest):
    signal = np.random.default_rng(3).normal(mean, std, 4000)
    counts = np.clip(np.rint(signal), 0, highest).astype(int)
    found = estimate_signal(counts, highest=highest)

    def loss(at):
        low = np.where(counts == 0, -np.inf, counts - 0.5)
        high = np.where(counts == highest, np.inf, counts + 0.5)
        z_low, z_high = (low - at[0]) / np.exp(at[1]), (high - at[0]) / np.exp(at[1])
        return -np.sum(np.log(norm.cdf(z_high) - norm.cdf(z_low)))

    other = minimize(loss, [counts.mean(), np.log(counts.std() + 0.1)], method="Nelder-Mead", options={"xatol": 1e-7})
    assert found.mean_dn == pytest.approx(other.x[0], abs=1e-4 * std)
    assert found.std_dn == pytest.approx(np.exp(other.x[1]), abs=1e-4 * std)
    # What counts stand for has the estimate as its mean, and its error as its scatter.
    stands_for = found.stands_for[counts]
    assert stands_for.mean() == pytest.approx(found.mean_dn, abs=1e-6 * std)
    curvature = np.array(
        [[loss(other.x + a + b) for b in np.diag([1e-3 * std, 1e-3])] for a in np.diag([1e-3 * std, 1e-3])]
    )
    one = np.array([loss(other.x + a) for a in np.diag([1e-3 * std, 1e-3])])
    hessian = (curvature - one[:, None] - one[None, :] + loss(other.x)) / np.outer(
        [1e-3 * std, 1e-3], [1e-3 * std, 1e-3]
    )
    # Expected and observed information of 4000 counts differ by some per cent.
    assert stands_for.std() / 4000**0.5 == pytest.approx(np.sqrt(np.linalg.inv(hessian)[0, 0]), rel=0.1)
    assert found.misfit == 0.0
    assert found.is_tested


def test_counts_of_two_kinds_tell_of_no_deviation_and_two_lights_do_not_fit():
    assert estimate_signal(np.array([3, 3, 4, 4, 3]), highest=255) is None
    # Three kinds fit some deviation whatever made them: dark spots of a picture as well as noise.
    assert not estimate_signal(np.repeat([10, 11, 12], [179, 6214, 7]), highest=255).is_tested
    draws = np.random.default_rng(4)
    far = np.append(np.rint(draws.normal(90.0, 3.0, 2000)).astype(int), 255)
    assert estimate_signal(far, highest=255).misfit == np.inf
    two = np.concatenate([draws.normal(4.0, 3.0, 2000), draws.normal(34.0, 3.0, 2000)])
    assert estimate_signal(np.maximum(np.rint(two), 0.0).astype(int), highest=255).misfit > 0.1


@pytest.mark.parametrize("cycles", [3, 12], ids=["three cycles", "a third of the pixels hit"])
def test_hits_are_found_in_uneven_light_and_noise_that_reaches_far_is_none(cycles):
    rng, light = np.random.default_rng(12), np.linspace(100.0, 2000.0, 4000)
    pixels = rng.poisson(light, (cycles, 4, 4000)).astype(float)
    assert find_hits(pixels) is None
    assert find_hits(100.0 + 5.0 * rng.standard_t(4.0, pixels.shape)) is None
    hit = rng.random(pixels.shape) < 0.01
    found = find_hits(pixels + hit * rng.exponential(2000.0, pixels.shape))
    assert not np.any(found.pixels & ~hit.any(axis=(0, 1)))
    # Six deviations of the brightest pixels, 44 counts, hide 12 % of the hits.
    assert found.pixels.sum() > 0.8 * hit.any(axis=(0, 1)).sum()
    assert np.all(np.abs(found.small - 0.01 * 0.12) < 5.0 * found.small_error)
    # Not more of the dark pixels than of the bright ones.
    dark, bright = found.pixels[:2000].sum(), found.pixels[2000:].sum()
    assert abs(int(dark) - int(bright)) < 5.0 * np.sqrt(dark + bright)


def test_hits_are_found_against_neighbours_in_uneven_light():
    rng, light = np.random.default_rng(14), np.tile(np.linspace(100.0, 2000.0, 4000), (4, 1))
    off = rng.poisson(light) - light
    assert find_single_hits(off, light) is None
    hit = rng.random(off.shape) < 0.01
    found = find_single_hits(off + hit * 2000.0, light)
    assert np.array_equal(found.pixels, hit.any(axis=0) & (hit.sum(axis=0) < 3))


def test_hits_too_small_to_be_found_leave_what_is_said_in_mean_and_variance():
    rng = np.random.default_rng(13)
    off, squares = [], []
    for _ in range(20):
        pixels = rng.normal(500.0, 10.0, (3, 4, 4000))
        hit = rng.random(pixels.shape) < 0.01
        pixels[hit] += rng.exponential(400.0, int(hit.sum()))
        found = find_hits(pixels)
        kept = pixels[:, :, ~found.pixels]
        left = kept.mean(axis=(0, 2)) - 500.0 - found.small * found.mean
        off.append(left / np.hypot(found.small_error * found.mean, 10.0 / np.sqrt(12000.0)))
        excess = kept.var(axis=2).mean(axis=0) - 100.0 - found.small * found.square
        squares.append(excess / (found.small_error * found.square))
        assert np.all(found.small > 0.0)
    # Chance of the variance itself is some 0.9 of its error by hits.
    assert abs(np.mean(off)) < 4.0 / np.sqrt(80.0)
    assert abs(np.mean(squares)) < 4.0 * 1.5 / np.sqrt(80.0)
