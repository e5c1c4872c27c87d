import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.processing.reconstruction import FESSENKOV_RAD, MODIFIED_PICKERING_RAD, design, reconstruct
from model.processing.weighted_reconstruction import reconstruct_weighted, weighted_fit

SIX = np.pi * np.arange(6) / 6


def _textbook(system, channels, variances):
    """Aitken's formula as it stands in the books."""
    weighted = system.T / variances
    stokes = np.linalg.solve(weighted @ system, weighted @ channels)
    residual = channels - system @ stokes
    return stokes, residual @ (residual / variances)


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10_000), angles=st.sampled_from([MODIFIED_PICKERING_RAD, tuple(SIX)]))
def test_correction_form_is_generalised_least_squares(seed, angles):
    rng = np.random.default_rng(seed)
    plan = design(angles, 300.0)
    channels, variances = rng.uniform(10.0, 100.0, len(angles)), rng.uniform(0.1, 10.0, len(angles))
    stokes, chi_square = weighted_fit(plan, channels, variances)
    expected, expected_square = _textbook(plan.system, channels, variances)
    # Rounding of a 100-fold spread of weights.
    np.testing.assert_allclose(stokes, expected, atol=1e-11)
    np.testing.assert_allclose(chi_square, expected_square, rtol=1e-11)


def test_design_with_variances_is_the_same_estimate():
    variances = np.array([1.0, 2.0, 5.0, 0.5])
    channels = np.array([60.0, 55.0, 40.0, 46.0])
    plan = design(MODIFIED_PICKERING_RAD, variances=variances)
    stokes, _ = weighted_fit(design(MODIFIED_PICKERING_RAD), channels, variances)
    np.testing.assert_allclose(reconstruct(plan, channels), stokes, rtol=1e-13)


def test_equal_variances_are_ordinary_least_squares():
    plan = design(MODIFIED_PICKERING_RAD)
    channels = np.array([60.0, 55.0, 40.0, 46.0])
    stokes, _ = weighted_fit(plan, channels, 3.0)
    np.testing.assert_allclose(stokes, reconstruct(plan, channels), atol=1e-13)


def test_three_angles_leave_no_choice():
    plan = design(FESSENKOV_RAD)
    channels = np.array([60.0, 55.0, 40.0])
    found = reconstruct_weighted(plan, channels, gain_dn_per_e=0.5, floor_var_dn2=2.0)
    np.testing.assert_array_equal(found.stokes, reconstruct(plan, channels))
    assert found.p_value == 1.0


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10_000))
def test_weights_never_add_variance(seed):
    variances = np.random.default_rng(seed).uniform(0.01, 10.0, 6)
    plain, weighted = design(SIX).inverse, design(SIX, variances=variances).inverse
    gain = (plain * variances) @ plain.T - (weighted * variances) @ weighted.T
    assert np.min(np.linalg.eigvalsh(gain)) >= -1e-12


@pytest.mark.parametrize("floor", [0.0, 4.0])
def test_channel_without_counts_is_no_division_by_zero(floor):
    found = reconstruct_weighted(
        design(MODIFIED_PICKERING_RAD), [100.0, 50.0, 0.0, 50.0], gain_dn_per_e=1.0, floor_var_dn2=floor
    )
    np.testing.assert_allclose(found.stokes, [100.0, 100.0, 0.0], atol=1e-12)


def test_darkness_gives_zero():
    found = reconstruct_weighted(design(SIX), np.zeros((6, 2)), gain_dn_per_e=1.0, floor_var_dn2=0.0)
    np.testing.assert_array_equal(found.stokes, 0.0)
    np.testing.assert_array_equal(found.chi_square, 0.0)


def test_residual_is_chi_square_for_a_right_design():
    rng = np.random.default_rng(20)
    plan = design(SIX, 200.0)
    light = plan.system @ [2000.0, 700.0, -300.0]
    counts = rng.poisson(light[:, None], size=(6, 20_000)) + rng.normal(scale=5.0, size=(6, 20_000))
    found = reconstruct_weighted(plan, counts, gain_dn_per_e=1.0, floor_var_dn2=25.0)
    # Mean 3 and variance 6 of chi-square; 5 standard errors. Variances from the fit bias the mean by about 1 / N.
    assert abs(np.mean(found.chi_square) - 3.0) < 5.0 * np.sqrt(6.0 / 20_000) + 0.01
    assert abs(np.mean(found.p_value < 0.01) - 0.01) < 5.0 * np.sqrt(0.01 / 20_000)


def test_residual_finds_a_wrong_angle():
    plan = design(MODIFIED_PICKERING_RAD)
    wrong = design(np.add(MODIFIED_PICKERING_RAD, [0.0, 0.05, 0.0, 0.0]))
    counts = wrong.system @ [1e6, 6e5, 0.0]
    assert reconstruct_weighted(plan, counts, gain_dn_per_e=1.0, floor_var_dn2=0.0).p_value < 1e-6


def test_variance_gain_of_four_angles_under_shot_noise():
    # Ratio of the deviations of DoLP at 0.9 and the best angle: .565, three digits given.
    plan = design(MODIFIED_PICKERING_RAD)
    ratios = []
    for angle in np.linspace(0.0, np.pi / 4, 91):
        q = 0.9 * np.array([np.cos(2 * angle), np.sin(2 * angle)])
        light = plan.system @ [1.0, *q]
        weighted = design(MODIFIED_PICKERING_RAD, variances=light).inverse
        gradient = np.array([-0.9, *(q / 0.9)])
        var = [gradient @ (w * light) @ w.T @ gradient for w in (plan.inverse, weighted)]
        ratios.append(np.sqrt(var[1] / var[0]))
    assert min(ratios) == pytest.approx(0.565, abs=5e-4)
    assert max(ratios) <= 1.0 + 1e-12


def test_pixels_have_their_own_weights():
    rng = np.random.default_rng(3)
    plan = design(SIX)
    channels, variances = rng.uniform(10, 100, (6, 3, 4)), rng.uniform(1, 10, (6, 3, 4))
    stokes, chi_square = weighted_fit(plan, channels, variances)
    one, one_square = weighted_fit(plan, channels[:, 2, 1], variances[:, 2, 1])
    np.testing.assert_allclose(stokes[:, 2, 1], one, rtol=1e-13)
    np.testing.assert_allclose(chi_square[2, 1], one_square, rtol=1e-13)


def test_arguments_out_of_range_are_refused():
    plan = design(MODIFIED_PICKERING_RAD)
    with pytest.raises(ValueError, match="gain"):
        reconstruct_weighted(plan, np.ones(4), gain_dn_per_e=0.0, floor_var_dn2=1.0)
    with pytest.raises(ValueError, match="variances"):
        weighted_fit(plan, np.ones(4), np.array([1.0, 1.0, 1.0, 0.0]))
