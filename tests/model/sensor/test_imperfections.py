"""Scatter of angles, shifts and drift against draws and against numbers worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from model.moments import Moments
from model.processing.reconstruction import design
from model.sensor import PERFECT, Imperfections, angle_variance, channel_moments, electrons_per_radiance
from tests.model.sensors import sensor

FOUR = np.deg2rad([0.0, 45.0, 90.0, 135.0])
STOKES = np.array([30.0, 9.0, 4.0])


def channels(imperfections, *, stokes=STOKES, cov=None, smooth=None):
    made = Moments(mean=stokes, cov=np.zeros((3, 3)) if cov is None else cov)
    return channel_moments(made, angles_rad=FOUR, sensor=sensor(), imperfections=imperfections, smooth_cov=smooth)


def test_perfect_session_changes_nothing():
    one, other = channels(PERFECT), channels(replace(PERFECT, texture_correlation_pixels=3.0))
    np.testing.assert_array_equal(one.mean_dn, other.mean_dn)
    np.testing.assert_array_equal(one.temporal_var_dn2, other.temporal_var_dn2)


@pytest.mark.parametrize("std_rad", [0.01, 0.3])
def test_angles_that_scatter_have_the_moments_of_draws(std_rad):
    drawn = np.random.default_rng(3).normal(FOUR, std_rad, size=(400_000, 4))
    values = STOKES[1] * np.cos(2.0 * drawn) + STOKES[2] * np.sin(2.0 * drawn)
    variance = angle_variance(np.outer(STOKES, STOKES), angles_rad=FOUR, std_rad=std_rad)
    fourth = ((values - values.mean(axis=0)) ** 4).mean(axis=0)
    # Five standard errors of a mean and of a variance, the latter by the fourth moment of these draws.
    assert np.all(np.abs(values.var(axis=0) - variance) < 5.0 * np.sqrt((fourth - variance**2) / 400_000))
    kept = Imperfections(polarizer_angle_std_rad=std_rad).kept_polarization
    steady = kept * (STOKES[1] * np.cos(2.0 * FOUR) + STOKES[2] * np.sin(2.0 * FOUR))
    assert np.all(np.abs(values.mean(axis=0) - steady) < 5.0 * np.sqrt(variance / 400_000))


def test_small_scatter_is_the_slope_times_the_angle():
    variance = angle_variance(np.outer(STOKES, STOKES), angles_rad=FOUR, std_rad=1e-9)
    slope = 2.0 * (-STOKES[1] * np.sin(2.0 * FOUR) + STOKES[2] * np.cos(2.0 * FOUR))
    # Next order: relative (2 s)^2, far below rounding.
    np.testing.assert_allclose(variance, (slope * 1e-9) ** 2, rtol=1e-12)


def test_scatter_adds_to_the_noise_from_frame_to_frame_and_lowers_the_degree():
    steady, scattered = channels(PERFECT), channels(Imperfections(polarizer_angle_std_rad=0.1))
    assert np.all(scattered.temporal_var_dn2[1:3] > steady.temporal_var_dn2[1:3])
    inverse = design(FOUR).inverse
    first, second = (inverse @ one.mean_dn for one in (steady, scattered))
    np.testing.assert_allclose(second[1:] / first[1:], np.exp(-0.02), rtol=1e-12)
    assert second[0] == pytest.approx(first[0], rel=1e-12)


@pytest.mark.parametrize(
    ("order", "share"),
    [
        # Shares of the drift: half the root of the sum of squares of the time between 0 and 90, and 45 and 135 deg.
        ((0, 1, 2, 3), 0.4714),
        ((0, 2, 1, 3), 0.2357),
        ((0, 1, 3, 2), 0.5270),
    ],
)
def test_drift_gives_unpolarised_light_a_degree_that_depends_on_the_order(order, share):
    found = channels(Imperfections(drift=0.01, drift_order=order), stokes=np.array([30.0, 0.0, 0.0]))
    s0, s1, s2 = design(FOUR).inverse @ found.mean_dn
    assert np.hypot(s1, s2) / s0 == pytest.approx(share * 0.01, rel=1e-3)


def test_drift_keeps_the_mean_of_the_cycle():
    factors = Imperfections(drift=0.1).light_factors(4)
    assert factors.mean() == pytest.approx(1.0, rel=1e-15)
    assert factors[-1] - factors[0] == pytest.approx(0.1, rel=1e-12)


def test_order_that_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="drift_order"):
        Imperfections(drift=0.1, drift_order=(0, 1, 1)).light_factors(3)


def test_shift_of_a_pixel_keeps_what_the_autocorrelation_leaves():
    draws = np.random.default_rng(5)
    shifts = draws.normal(0.0, 0.7, size=(400_000, 2, 2))
    apart = np.sum((shifts[:, 0] - shifts[:, 1]) ** 2, axis=-1)
    kept = np.exp(-apart / (2.0 * 1.5**2))
    found = Imperfections(misregistration_pixels=0.7, texture_correlation_pixels=1.5).kept_correlation
    assert abs(kept.mean() - found) < 5.0 * kept.std() / np.sqrt(kept.size)


def test_shifts_leave_variances_and_take_from_covariances():
    cov = 0.01 * np.outer(STOKES, STOKES)
    steady = channels(PERFECT, cov=cov).scene_cov_dn2
    shifted = channels(Imperfections(misregistration_pixels=1.0), cov=cov).scene_cov_dn2
    np.testing.assert_allclose(np.diag(shifted), np.diag(steady), rtol=1e-14)
    off = ~np.eye(4, dtype=bool)
    np.testing.assert_allclose(shifted[off], steady[off] / 3.0, rtol=1e-14)


def test_shifts_leave_alone_what_varies_slowly():
    cov = 0.01 * np.outer(STOKES, STOKES)
    steady = channels(PERFECT, cov=cov).scene_cov_dn2
    shifted = channels(Imperfections(misregistration_pixels=1.0), cov=cov, smooth=cov).scene_cov_dn2
    np.testing.assert_allclose(shifted, steady, rtol=1e-12)


@pytest.mark.parametrize(
    "numbers",
    [
        {"polarizer_angle_std_rad": -0.1},
        {"misregistration_pixels": np.nan},
        {"texture_correlation_pixels": 0.0},
        {"drift": 1.5},
        {"surround_albedo": 1.1},
    ],
)
def test_number_outside_its_range_is_refused(numbers):
    with pytest.raises(ValueError, match=next(iter(numbers))):
        Imperfections(**numbers)


def test_noise_that_is_left_out_is_not_in_the_variance():
    noise = sensor().noise
    bare = replace(sensor(), noise=replace(noise, shot_noise=False, quantisation=False))
    whole = channels(PERFECT).temporal_var_dn2
    light = Moments(mean=STOKES, cov=np.zeros((3, 3)))
    left = channel_moments(light, angles_rad=FOUR, sensor=bare)
    gain = noise.gain_dn_per_e
    electrons = left.mean_dn / gain
    assert electrons_per_radiance(bare) > 0.0
    np.testing.assert_allclose(
        whole - left.temporal_var_dn2, noise.noise_factor**2 * (gain**2 * electrons + 1.0 / 12.0), rtol=1e-9
    )
