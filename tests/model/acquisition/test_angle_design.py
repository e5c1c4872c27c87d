import numpy as np
import pytest

from model.acquisition.angle_design import equispaced_rad, optimal_angles
from model.processing.reconstruction import design


@pytest.mark.parametrize("frames", [3, 4, 5, 12])
def test_equal_spacing_reaches_the_best_condition(frames):
    plan = design(equispaced_rad(frames, start_rad=0.3))
    np.testing.assert_allclose([plan.condition, plan.ewv], [np.sqrt(2.0), 20.0 / frames], rtol=1e-13)


def test_unknown_angle_of_polarization_gets_equal_spacing():
    found = optimal_angles(4, stokes_e=(1e4, 5e3, 0.0), floor_var_e2=0.0, aolp_known=False)
    np.testing.assert_array_equal(found.angles_rad, equispaced_rad(4))


def test_additive_noise_cannot_be_improved_on():
    found = optimal_angles(3, stokes_e=(1e4, 5e3, 0.0), floor_var_e2=1e12, aolp_known=True)
    # Shot noise is 1e-8 of the variance.
    assert found.variance_e2 == pytest.approx(1e12 * 20.0 / 3.0, rel=1e-6)


def test_known_light_under_shot_noise_is_better_with_turned_angles():
    light = (1e4, 6e3 * np.cos(np.deg2rad(40)), 6e3 * np.sin(np.deg2rad(40)))
    found = optimal_angles(3, stokes_e=light, floor_var_e2=0.0, aolp_known=True)
    assert found.variance_e2 < 0.97 * found.equispaced_variance_e2
    rows = design(found.angles_rad).system
    inverse = design(found.angles_rad, variances=rows @ light).inverse
    assert found.variance_e2 == pytest.approx(np.trace((inverse * (rows @ light)) @ inverse.T), rel=1e-12)


@pytest.mark.parametrize(
    ("frames", "light", "floor"),
    [(2, (1.0, 0.0, 0.0), 0.0), (3, (1.0, 2.0, 0.0), 0.0), (3, (1.0, 0.0, 0.0), -1.0), (3, (0.0, 0.0, 0.0), 1.0)],
)
def test_arguments_out_of_range_are_refused(frames, light, floor):
    with pytest.raises(ValueError, match=r"allowed|not positive"):
        optimal_angles(frames, stokes_e=light, floor_var_e2=floor, aolp_known=True)
