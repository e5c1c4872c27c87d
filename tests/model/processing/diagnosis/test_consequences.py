import numpy as np
import pytest

from model.processing.diagnosis import consequence, region_residual, stokes_without
from model.processing.fault_fit import parameter_count, place
from model.processing.reconstruction import design

PLAN = design(np.radians([0.0, 45.0, 90.0, 135.0]))
STOKES = np.array([200.0, 40.0, -30.0])


def _parameters(kind: str, frame: int, size: float) -> np.ndarray:
    found = np.zeros(parameter_count(4))
    found[place(kind, frame, 4)] = size
    return found


def test_a_throughput_taken_out_gives_the_light_back() -> None:
    counts = PLAN.system @ STOKES * np.array([1.03, 1.0, 1.0, 1.0])
    np.testing.assert_allclose(
        stokes_without(PLAN.system, counts, _parameters("throughput", 0, 0.03), light=100.0), STOKES, rtol=1e-12
    )


def test_a_curved_response_taken_out_gives_the_light_back() -> None:
    straight = PLAN.system @ STOKES
    counts = straight - 0.05 * straight**2 / 100.0
    parameters = _parameters("response curvature", 0, -0.05)
    np.testing.assert_allclose(stokes_without(PLAN.system, counts, parameters, light=100.0), STOKES, rtol=1e-12)


def test_a_turned_angle_moves_the_polarization_by_what_it_says() -> None:
    turned = design(np.radians([0.0, 47.0, 90.0, 135.0]))
    counts = turned.system @ STOKES
    found = consequence(PLAN.system, counts, _parameters("angle", 1, np.radians(2.0)), light=100.0)
    wrong = PLAN.inverse @ counts
    assert found.dolp_shift == pytest.approx(np.hypot(*wrong[1:]) / wrong[0] - 0.25, abs=1e-12)
    assert found.aolp_shift_rad == pytest.approx(
        0.5 * (np.arctan2(wrong[2], wrong[1]) - np.arctan2(STOKES[2], STOKES[1])), abs=1e-12
    )


def test_a_shift_moves_the_polarization_of_a_slope_and_of_nothing_even() -> None:
    counts, moved = PLAN.system @ STOKES, _parameters("shift x", 2, 0.5)
    slopes = np.column_stack([np.full(4, 3.0), np.full(4, 7.0)])
    # A picture that walks to the right brings what was half a pixel to the left: less, where it rises to the right.
    counts_walked = counts - np.array([0.0, 0.0, 1.5, 0.0])
    wrong = PLAN.inverse @ counts_walked
    found = consequence(PLAN.system, counts_walked, moved, light=100.0, slopes=slopes)
    assert found.dolp_shift == pytest.approx(np.hypot(*wrong[1:]) / wrong[0] - 0.25, abs=1e-12)
    assert consequence(PLAN.system, counts, moved, light=100.0).dolp_shift == pytest.approx(0.0, abs=1e-15)


def test_light_without_polarization_has_no_angle_to_move() -> None:
    found = consequence(PLAN.system, np.full(4, 100.0), _parameters("dark level", 0, 0.0), light=100.0)
    assert found.dolp_shift == pytest.approx(0.0, abs=1e-15)
    assert found.aolp_shift_rad is None


def test_texture_that_cancels_in_the_residual_makes_no_error() -> None:
    draws = np.random.default_rng(4)
    texture = draws.uniform(0.5, 1.5, (64, 64))
    pictures = (PLAN.system @ STOKES)[:, None, None] * texture
    found = region_residual(PLAN, pictures, np.ones((64, 64), dtype=bool))
    assert np.max(np.abs(found.cov)) < 1e-20


def test_error_of_a_residual_is_that_of_its_noise() -> None:
    draws = np.random.default_rng(6)
    pictures = 100.0 + draws.normal(0.0, 2.0, (4, 96, 96))
    found = region_residual(PLAN, pictures, np.ones((96, 96), dtype=bool))
    # The widest of several estimates from a few dozen blocks: up to about half more than the truth.
    assert 1.0 <= np.trace(found.cov) / (4.0 / 96**2) < 2.0


@pytest.mark.parametrize(
    ("kind", "size"),
    [("response curvature", -0.54), ("response power law", -3.4), ("throughput", -1.4), ("angle", 20.0)],
)
def test_a_fault_too_large_to_be_undone_moves_the_polarization_by_nobody_knows_what(kind: str, size: float) -> None:
    counts = PLAN.system @ STOKES
    found = consequence(PLAN.system, counts, _parameters(kind, 0, size), light=100.0)
    assert found.dolp_shift is None
    assert found.aolp_shift_rad is None
