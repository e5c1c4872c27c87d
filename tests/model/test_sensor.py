"""Electrons, noise, imperfections and moments of the counts, against draws and numbers worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from model.moments import Moments
from model.processing.reconstruction import MODIFIED_PICKERING_RAD, design, stokes_moments
from model.sensor import (
    PERFECT,
    Imperfections,
    angle_variance,
    aperture_factor,
    channel_moments,
    counts_per_radiance,
    effective_wavelength_m,
    electrons_per_radiance,
)
from tests.model.sensors import sensor

FOUR = np.array(MODIFIED_PICKERING_RAD)
STOKES = np.array([30.0, 9.0, 4.0])


def pixel_cov_dn2(found):
    return found.scene_cov_dn2 + found.fixed_pattern_cov_dn2 + found.temporal_var_dn2[..., None] * np.eye(4)


def _light(stokes=(30.0, 9.0, 3.0), cov=None):
    return Moments(mean=stokes, cov=np.zeros((3, 3)) if cov is None else cov)


def test_electrons_of_the_published_example_with_pi():
    # 30 W m-2 sr-1, half of it behind an ideal polarizer: 6424 e-, four digits given.
    assert electrons_per_radiance(sensor()) * 15.0 == pytest.approx(6424.0, abs=0.5)


@pytest.mark.parametrize(
    "change", [{"exposure_s": 60e-6}, {"pixel_pitch_m": 8.3e-6 * np.sqrt(2.0)}, {"quantum_efficiency": 0.9}]
)
def test_doubled_time_area_or_efficiency_doubles_the_electrons(change):
    ratio = electrons_per_radiance(sensor(**change)) / electrons_per_radiance(sensor())
    assert ratio == pytest.approx(2.0, rel=1e-14)


def test_aperture_forms_differ_as_they_should():
    sine = electrons_per_radiance(sensor(aperture="sine"))
    assert sine / electrons_per_radiance(sensor()) == pytest.approx(17.0 / 16.0, rel=1e-14)


def test_field_angle_darkens_by_the_fourth_power_of_its_cosine():
    ratio = aperture_factor(sensor(field_angle_rad=np.deg2rad(7.5))) / aperture_factor(sensor())
    assert ratio == pytest.approx(0.966, abs=5e-4)


def test_temporal_variance_is_shot_dark_read_and_rounding():
    s = sensor(dark_current_e_per_s=1e7, noise_factor=1.0)
    found = channel_moments(_light(), angles_rad=FOUR, sensor=s)
    dark_e = 1e7 * 30e-6
    expected = 0.1 * found.mean_dn + 0.01 * (dark_e + 20.0**2) + 1.0 / 12.0
    np.testing.assert_allclose(found.temporal_var_dn2, expected, rtol=1e-14)
    assert found.dark_signal_dn == pytest.approx(0.1 * dark_e, rel=1e-14)
    np.testing.assert_array_equal(found.mean_dn, channel_moments(_light(), angles_rad=FOUR, sensor=sensor()).mean_dn)


def test_noise_factor_scales_the_temporal_noise_only():
    light = _light(cov=np.diag([0.5, 0.3, 0.2]))
    once, thrice = (
        channel_moments(light, angles_rad=FOUR, sensor=sensor(noise_factor=k, prnu=0.01)) for k in (1.0, 3.0)
    )
    np.testing.assert_allclose(thrice.temporal_var_dn2, 9.0 * once.temporal_var_dn2, rtol=1e-14)
    np.testing.assert_array_equal(thrice.scene_cov_dn2, once.scene_cov_dn2)
    np.testing.assert_array_equal(thrice.fixed_pattern_cov_dn2, once.fixed_pattern_cov_dn2)


def test_scene_covariance_comes_back_through_the_inverse():
    light = _light(cov=[[0.5, 0.1, 0.0], [0.1, 0.3, 0.05], [0.0, 0.05, 0.2]])
    found = channel_moments(light, angles_rad=FOUR, sensor=sensor())
    scale = 0.1 * electrons_per_radiance(sensor())
    stokes = stokes_moments(design(FOUR), Moments(mean=found.mean_dn, cov=found.scene_cov_dn2))
    np.testing.assert_allclose(stokes.mean / scale, light.mean, rtol=1e-13)
    np.testing.assert_allclose(stokes.cov / scale**2, light.cov, atol=1e-13)


def test_fixed_pattern_is_common_to_all_angles_and_a_flat_field_removes_that_of_the_response():
    found = channel_moments(_light(), angles_rad=FOUR, sensor=sensor(prnu=0.02, dsnu_e=30.0))
    s = found.mean_dn
    np.testing.assert_allclose(found.fixed_pattern_cov_dn2, 4e-4 * np.outer(s, s) + 9.0, rtol=1e-14)
    flat = channel_moments(_light(), angles_rad=FOUR, sensor=sensor(prnu=0.02), flat_fielded=True)
    np.testing.assert_array_equal(flat.fixed_pattern_cov_dn2, 0.0)


def test_response_pattern_drops_out_of_dolp_at_first_order():
    found = channel_moments(_light(), angles_rad=FOUR, sensor=sensor(prnu=0.02))
    stokes = stokes_moments(design(FOUR), Moments(mean=found.mean_dn, cov=found.fixed_pattern_cov_dn2))
    s0, s1, s2 = stokes.mean
    q = np.hypot(s1, s2)
    gradient = np.array([-q / s0, s1 / q, s2 / q]) / s0
    assert abs(gradient @ stokes.cov @ gradient) < 1e-14


def test_gain_drops_out_of_signal_to_noise_without_rounding():
    def ratio(gain):
        found = channel_moments(_light(), angles_rad=FOUR, sensor=sensor(gain_dn_per_e=gain))
        return found.mean_dn / np.sqrt(found.temporal_var_dn2 - 1.0 / 12.0)

    # Taking 1/12 off again cancels less than one digit.
    np.testing.assert_allclose(ratio(0.2), ratio(0.1), rtol=1e-13)


@pytest.mark.parametrize(
    ("change", "saturated", "words"),
    [
        ({}, 0.0, []),
        ({"gain_dn_per_e": 0.001, "read_noise_e": 20.0}, 0.0, ["not dithered"]),
        ({"gain_dn_per_e": 0.5}, 0.5, ["saturation"]),  # of the converter
        ({"saturation_e": 6000.0}, 0.99, ["saturation"]),  # of the well
    ],
)
def test_too_little_noise_for_the_rounding_and_saturation_are_flagged(change, saturated, words):
    found = channel_moments(_light(), angles_rad=FOUR, sensor=sensor(**change))
    assert found.saturation_probability[0] >= saturated
    assert [word in text for word, text in zip(words, found.warnings, strict=True)] == [True] * len(words)


def test_saturation_probability_is_normal_beyond_the_top():
    s = sensor(gain_dn_per_e=0.47)
    found = channel_moments(_light((30.0, 9.0, 0.0)), angles_rad=[0.0, 1.0, 2.0], sensor=s)
    sigma = np.sqrt(found.temporal_var_dn2[0] - 1.0 / 12.0)
    expected = ndtr((found.mean_dn[0] + 50.0 - 4095.5) / sigma)
    np.testing.assert_allclose(found.saturation_probability[0], expected, rtol=1e-10)


def test_zero_light_across_an_ideal_polarizer_is_allowed():
    found = channel_moments(_light((30.0, 30.0, 0.0)), angles_rad=FOUR, sensor=sensor())
    assert found.mean_dn[2] == 0.0


def test_regions_are_computed_together():
    light = Moments(mean=[[30.0, 9.0, 3.0], [10.0, 0.0, 1.0]], cov=np.zeros((3, 3)))
    found = channel_moments(light, angles_rad=FOUR, sensor=sensor(prnu=0.01))
    alone = channel_moments(_light((10.0, 0.0, 1.0)), angles_rad=FOUR, sensor=sensor(prnu=0.01))
    np.testing.assert_allclose(pixel_cov_dn2(found)[1], pixel_cov_dn2(alone), rtol=1e-14)


def test_counts_per_radiance_is_what_unpolarized_light_gives():
    one = sensor(tau_parallel=0.8, tau_perpendicular=0.1)
    light = Moments(mean=[1.0, 0.0, 0.0], cov=np.zeros((3, 3)))
    counts = channel_moments(light, angles_rad=[0.0, 1.0], sensor=one).mean_dn
    assert counts == pytest.approx(counts_per_radiance(one), rel=1e-12)


NODES = np.linspace(400e-9, 700e-9, 301)


def test_flat_band_has_its_mean_wavelength():
    # The trapezoid is exact for a linear integrand.
    assert effective_wavelength_m(NODES, np.ones(NODES.size)) == pytest.approx(550e-9, rel=1e-13)


def test_effective_wavelength_makes_the_band_form_exact():
    radiance = 1e8 * (700e-9 / NODES) ** 4
    centre = effective_wavelength_m(NODES, radiance)
    band = np.trapezoid(radiance, NODES) * electrons_per_radiance(sensor(wavelength_m=centre))
    # Electrons of unit radiance go with the wavelength.
    each = electrons_per_radiance(sensor(wavelength_m=550e-9)) * NODES / 550e-9
    assert np.trapezoid(each * radiance, NODES) == pytest.approx(band, rel=1e-13)
    assert centre < 550e-9


def channels(imperfections, *, stokes=STOKES, cov=None, smooth=None):
    made = Moments(mean=stokes, cov=np.zeros((3, 3)) if cov is None else cov)
    return channel_moments(made, angles_rad=FOUR, sensor=sensor(), imperfections=imperfections, smooth_cov=smooth)


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


def test_shift_of_a_pixel_keeps_what_the_autocorrelation_leaves():
    draws = np.random.default_rng(5)
    shifts = draws.normal(0.0, 0.7, size=(400_000, 2, 2))
    apart = np.sum((shifts[:, 0] - shifts[:, 1]) ** 2, axis=-1)
    kept = np.exp(-apart / (2.0 * 1.5**2))
    found = Imperfections(misregistration_pixels=0.7, texture_correlation_pixels=1.5).kept_correlation
    assert abs(kept.mean() - found) < 5.0 * kept.std() / np.sqrt(kept.size)


def test_shifts_take_from_covariances_of_what_does_not_vary_slowly():
    cov = 0.01 * np.outer(STOKES, STOKES)
    steady = channels(PERFECT, cov=cov).scene_cov_dn2
    shifted = channels(Imperfections(misregistration_pixels=1.0), cov=cov).scene_cov_dn2
    np.testing.assert_allclose(np.diag(shifted), np.diag(steady), rtol=1e-14)
    off = ~np.eye(4, dtype=bool)
    np.testing.assert_allclose(shifted[off], steady[off] / 3.0, rtol=1e-14)
    smooth = channels(Imperfections(misregistration_pixels=1.0), cov=cov, smooth=cov).scene_cov_dn2
    np.testing.assert_allclose(smooth, steady, rtol=1e-12)


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


@pytest.mark.parametrize(
    "change",
    [
        {"f_number": 0.0},
        {"quantum_efficiency": 1.2},
        {"bit_depth": 0},
        {"exposure_s": -1.0},
        {"gain_dn_per_e": 0.0},
        {"read_noise_e": -1.0},
        {"tau_perpendicular": 1.5},
        {"field_angle_rad": 1.6},
        {"black_level_dn": np.inf},
        {"saturation_e": 0.0},
        {"f_number": 0.4, "aperture": "sine"},
        {"aperture": "none"},
    ],
)
def test_values_out_of_range_are_refused_by_name(change):
    with pytest.raises(ValueError, match=next(iter(change)).split("_")[0]):
        sensor(**change)


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Imperfections(polarizer_angle_std_rad=-0.1), "polarizer_angle_std_rad"),
        (lambda: Imperfections(misregistration_pixels=np.nan), "misregistration_pixels"),
        (lambda: Imperfections(texture_correlation_pixels=0.0), "texture_correlation_pixels"),
        (lambda: Imperfections(drift=1.5), "drift"),
        (lambda: Imperfections(surround_albedo=1.1), "surround_albedo"),
        (lambda: Imperfections(drift=0.1, drift_order=(0, 1, 1)).light_factors(3), "drift_order"),
        (lambda: channel_moments(_light((30.0, 31.0, 0.0)), angles_rad=FOUR, sensor=sensor()), "negative light"),
        (lambda: effective_wavelength_m([500e-9], np.ones(1)), "increasing samples"),
        (lambda: effective_wavelength_m([500e-9, 400e-9], np.ones(2)), "increasing samples"),
        (lambda: effective_wavelength_m([-1e-9, 1e-9], np.ones(2)), "increasing samples"),
        (lambda: effective_wavelength_m(NODES, np.zeros(NODES.size)), "> 0 somewhere"),
    ],
)
def test_what_cannot_be_is_refused(make, word):
    with pytest.raises(ValueError, match=word):
        make()
