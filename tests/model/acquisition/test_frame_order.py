import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.acquisition import PATTERNS, least_drifting_order, mean_moves_rad, mean_places

ANGLES = np.radians([0.0, 45.0, 90.0, 135.0])


def sequence(angles, cycles, pattern):
    """Every frame's angle number, written out."""
    if pattern == "grouped":
        return [k for k in range(angles) for _ in range(cycles)]
    forth = list(range(angles))
    back = forth[::-1] if pattern == "palindrome" else forth
    return [k for cycle in range(cycles) for k in (back if cycle % 2 else forth)]


@given(angles=st.integers(1, 7), cycles=st.integers(1, 9), pattern=st.sampled_from(PATTERNS))
@settings(deadline=None, max_examples=60)
def test_mean_places_are_those_of_the_frames_written_out(angles, cycles, pattern):
    taken = np.array(sequence(angles, cycles, pattern))
    places = np.arange(taken.size) - 0.5 * (taken.size - 1)
    expected = [np.mean(places[taken == k]) for k in range(angles)]
    np.testing.assert_allclose(mean_places(angles, cycles=cycles, pattern=pattern), expected, atol=1e-12)


@given(cycles=st.integers(1, 9), pattern=st.sampled_from(PATTERNS), seed=st.integers(0, 99))
@settings(deadline=None, max_examples=60)
def test_mean_moves_are_those_of_the_frames_written_out(cycles, pattern, seed):
    angles = np.random.default_rng(seed).uniform(0.0, np.pi, 5)
    taken = np.array(sequence(5, cycles, pattern))
    moves = np.diff(angles[taken], prepend=angles[taken[0]])
    expected = [np.mean(moves[taken == k]) for k in range(5)]
    np.testing.assert_allclose(mean_moves_rad(angles, cycles=cycles, pattern=pattern), expected, atol=1e-12)


@pytest.mark.parametrize("frames", [3, 4, 5, 6])
def test_no_order_shows_less_false_polarization(frames):
    angles = np.pi * np.arange(frames) / frames
    best = least_drifting_order(angles)
    places = mean_places(frames, cycles=1, pattern="cycles")

    def false(order):
        return abs(np.exp(2j * order) @ places)

    rng = np.random.default_rng(1)
    assert false(best) <= min(false(rng.permutation(angles)) for _ in range(200)) + 1e-12


def test_of_four_angles_the_best_order_sets_those_across_side_by_side():
    np.testing.assert_allclose(np.degrees(least_drifting_order(ANGLES)), [0.0, 90.0, 45.0, 135.0])


@pytest.mark.parametrize("count", [2, 8])
def test_too_few_or_too_many_angles_are_refused(count):
    with pytest.raises(ValueError, match="3 to 7"):
        least_drifting_order(np.arange(count))


@pytest.mark.parametrize("change", [{"cycles": 0}, {"angles": 0}])
def test_no_frames_have_no_places(change):
    with pytest.raises(ValueError, match="1 or more of each"):
        mean_places(**({"angles": 4, "cycles": 1, "pattern": "cycles"} | change))
