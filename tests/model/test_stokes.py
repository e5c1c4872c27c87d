import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.stokes import analyzer_row, aolp_rad, dolp, rotate_frame


def from_dolp(*, intensity, dolp_value, aolp_rad_value):
    along = [np.cos(2.0 * aolp_rad_value), np.sin(2.0 * aolp_rad_value)]
    return intensity * np.array([1.0, *np.multiply(dolp_value, along)])


@pytest.mark.parametrize(
    ("stokes", "angle_deg"),
    [((1, 1, 0), 0.0), ((1, 0, 1), 45.0), ((1, -1, 0), 90.0), ((1, 0, -1), 135.0), ((1, 1, -1e-300), 0.0)],
)
def test_angle_counts_from_horizontal_to_plus_45(stokes, angle_deg):
    np.testing.assert_allclose(aolp_rad(np.array(stokes, dtype=float)), np.deg2rad(angle_deg), atol=1e-15)


def test_angle_is_below_pi_for_a_tiny_negative_direction():
    assert aolp_rad([1.0, 1.0, -1e-17]) < np.pi


def test_dolp_above_one_is_kept():
    assert dolp([1.0, 3.0, 4.0]) == 5.0


def test_dolp_without_light_is_refused():
    with pytest.raises(ValueError, match="not positive in 1 of 2"):
        dolp([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def test_last_axis_must_be_three_long():
    with pytest.raises(ValueError, match="allowed is"):
        dolp([1.0, 0.0])


@pytest.mark.parametrize(
    ("angle_deg", "row"),
    [(0, (0.5, 0.5, 0)), (45, (0.5, 0, 0.5)), (90, (0.5, -0.5, 0)), (135, (0.5, 0, -0.5)), (180, (0.5, 0.5, 0))],
)
def test_ideal_analyzer(angle_deg, row):
    np.testing.assert_allclose(analyzer_row(np.deg2rad(angle_deg)), row, atol=1e-15)


def test_real_analyzer_passes_its_transmittances():
    row = analyzer_row(0.3, 0.8, 0.1)
    along = from_dolp(intensity=1.0, dolp_value=1.0, aolp_rad_value=0.3)
    across = from_dolp(intensity=1.0, dolp_value=1.0, aolp_rad_value=0.3 + np.pi / 2)
    np.testing.assert_allclose([row @ along, row @ across], [0.8, 0.1], rtol=1e-14)


@pytest.mark.parametrize("taus", [(0.5, 0.6), (1.1, 0.0), (0.5, -0.1), (np.nan, 0.0)])
def test_impossible_transmittances_are_refused(taus):
    with pytest.raises(ValueError, match="tau_perpendicular"):
        analyzer_row(0.0, *taus)


@settings(deadline=None)
@given(angle=st.floats(0.0, 3.1), turn=st.floats(-3.0, 3.0), degree=st.floats(0.01, 1.0))
def test_turned_axes_lower_the_angle_and_keep_the_degree(angle, turn, degree):
    turned = rotate_frame(from_dolp(intensity=2.0, dolp_value=degree, aolp_rad_value=angle), turn)
    np.testing.assert_allclose(dolp(turned), degree, rtol=1e-13)
    difference = aolp_rad(turned) - (angle - turn)
    np.testing.assert_allclose(np.sin(difference), 0.0, atol=1e-13)
