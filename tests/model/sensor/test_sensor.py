import numpy as np
import pytest
from scipy.special import ndtr

from model.moments import Moments
from model.processing.reconstruction import MODIFIED_PICKERING_RAD, design, stokes_moments
from model.sensor import aperture_factor, channel_moments, counts_per_radiance, electrons_per_radiance
from tests.model.sensors import sensor

FOUR = np.array(MODIFIED_PICKERING_RAD)


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


def test_dark_signal_is_not_in_the_mean():
    bright = channel_moments(_light(), angles_rad=FOUR, sensor=sensor(dark_current_e_per_s=1e7))
    dark = channel_moments(_light(), angles_rad=FOUR, sensor=sensor())
    np.testing.assert_array_equal(bright.mean_dn, dark.mean_dn)


def test_noise_factor_scales_the_temporal_noise_only():
    light = _light(cov=np.diag([0.5, 0.3, 0.2]))
    once, thrice = (
        channel_moments(light, angles_rad=FOUR, sensor=sensor(noise_factor=k, prnu=0.01)) for k in (1.0, 3.0)
    )
    np.testing.assert_allclose(thrice.temporal_var_dn2, 9.0 * once.temporal_var_dn2, rtol=1e-14)
    np.testing.assert_array_equal(thrice.scene_cov_dn2, once.scene_cov_dn2)
    np.testing.assert_array_equal(thrice.fixed_pattern_cov_dn2, once.fixed_pattern_cov_dn2)


def test_without_noise_factor_only_the_scene_is_left():
    light = _light(cov=np.diag([0.5, 0.3, 0.2]))
    found = channel_moments(light, angles_rad=FOUR, sensor=sensor(noise_factor=0.0))
    np.testing.assert_array_equal(pixel_cov_dn2(found), found.scene_cov_dn2)


def test_scene_covariance_comes_back_through_the_inverse():
    light = _light(cov=[[0.5, 0.1, 0.0], [0.1, 0.3, 0.05], [0.0, 0.05, 0.2]])
    found = channel_moments(light, angles_rad=FOUR, sensor=sensor())
    scale = 0.1 * electrons_per_radiance(sensor())
    stokes = stokes_moments(design(FOUR), Moments(mean=found.mean_dn, cov=found.scene_cov_dn2))
    np.testing.assert_allclose(stokes.mean / scale, light.mean, rtol=1e-13)
    np.testing.assert_allclose(stokes.cov / scale**2, light.cov, atol=1e-13)


def test_fixed_pattern_is_common_to_all_angles():
    found = channel_moments(_light(), angles_rad=FOUR, sensor=sensor(prnu=0.02, dsnu_e=30.0))
    s = found.mean_dn
    np.testing.assert_allclose(found.fixed_pattern_cov_dn2, 4e-4 * np.outer(s, s) + 9.0, rtol=1e-14)


def test_response_pattern_drops_out_of_dolp_at_first_order():
    found = channel_moments(_light(), angles_rad=FOUR, sensor=sensor(prnu=0.02))
    stokes = stokes_moments(design(FOUR), Moments(mean=found.mean_dn, cov=found.fixed_pattern_cov_dn2))
    s0, s1, s2 = stokes.mean
    q = np.hypot(s1, s2)
    gradient = np.array([-q / s0, s1 / q, s2 / q]) / s0
    assert abs(gradient @ stokes.cov @ gradient) < 1e-14


def test_flat_field_removes_the_response_pattern():
    found = channel_moments(_light(), angles_rad=FOUR, sensor=sensor(prnu=0.02), flat_fielded=True)
    np.testing.assert_array_equal(found.fixed_pattern_cov_dn2, 0.0)


def test_gain_drops_out_of_signal_to_noise_without_rounding():
    def ratio(gain):
        found = channel_moments(_light(), angles_rad=FOUR, sensor=sensor(gain_dn_per_e=gain))
        return found.mean_dn / np.sqrt(found.temporal_var_dn2 - 1.0 / 12.0)

    # Taking 1/12 off again cancels less than one digit.
    np.testing.assert_allclose(ratio(0.2), ratio(0.1), rtol=1e-13)


def test_too_little_noise_for_the_rounding_is_flagged():
    quiet = sensor(gain_dn_per_e=0.001, read_noise_e=20.0)
    assert any("not dithered" in text for text in channel_moments(_light(), angles_rad=FOUR, sensor=quiet).warnings)


def test_enough_noise_and_room_give_no_warning():
    assert channel_moments(_light(), angles_rad=FOUR, sensor=sensor()).warnings == ()


def test_saturation_of_the_converter_is_flagged():
    found = channel_moments(_light(), angles_rad=FOUR, sensor=sensor(gain_dn_per_e=0.5))
    assert found.saturation_probability[0] > 0.5
    assert any("saturation" in text for text in found.warnings)


def test_saturation_probability_is_normal_beyond_the_top():
    s = sensor(gain_dn_per_e=0.47)
    found = channel_moments(_light((30.0, 9.0, 0.0)), angles_rad=[0.0, 1.0, 2.0], sensor=s)
    sigma = np.sqrt(found.temporal_var_dn2[0] - 1.0 / 12.0)
    expected = ndtr((found.mean_dn[0] + 50.0 - 4095.5) / sigma)
    np.testing.assert_allclose(found.saturation_probability[0], expected, rtol=1e-10)


def test_saturation_of_the_well_is_flagged():
    found = channel_moments(_light(), angles_rad=FOUR, sensor=sensor(saturation_e=6000.0))
    assert found.saturation_probability[0] > 0.99


def test_zero_light_across_an_ideal_polarizer_is_allowed():
    found = channel_moments(_light((30.0, 30.0, 0.0)), angles_rad=FOUR, sensor=sensor())
    assert found.mean_dn[2] == 0.0


def test_light_that_is_more_than_polarized_is_refused():
    with pytest.raises(ValueError, match="negative light"):
        channel_moments(_light((30.0, 31.0, 0.0)), angles_rad=FOUR, sensor=sensor())


def test_regions_are_computed_together():
    light = Moments(mean=[[30.0, 9.0, 3.0], [10.0, 0.0, 1.0]], cov=np.zeros((3, 3)))
    found = channel_moments(light, angles_rad=FOUR, sensor=sensor(prnu=0.01))
    alone = channel_moments(_light((10.0, 0.0, 1.0)), angles_rad=FOUR, sensor=sensor(prnu=0.01))
    np.testing.assert_allclose(pixel_cov_dn2(found)[1], pixel_cov_dn2(alone), rtol=1e-14)


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


def test_counts_per_radiance_is_what_unpolarized_light_gives():
    one = sensor(tau_parallel=0.8, tau_perpendicular=0.1)
    light = Moments(mean=[1.0, 0.0, 0.0], cov=np.zeros((3, 3)))
    counts = channel_moments(light, angles_rad=[0.0, 1.0], sensor=one).mean_dn
    assert counts == pytest.approx(counts_per_radiance(one), rel=1e-12)
