import numpy as np
import pytest
from scipy.stats import kstest

from model.moments import Moments
from model.processing.dolp_interval import (
    aolp_limits_rad,
    dolp_intervals,
    is_polarized,
    joint_score,
    student_intervals,
    student_score,
)

DRAWS = 300
COVARIANCES = {"round": np.eye(2), "long": np.diag([1.0, 9.0]), "tilted": np.array([[4.0, 1.5], [1.5, 1.0]])}


def _vectors(cov, length, seed):
    draws = np.random.default_rng(seed)
    return np.array([length, 0.0]) + draws.normal(size=(DRAWS, 2)) @ np.linalg.cholesky(cov).T


@pytest.mark.parametrize("length", [0.0, 1.0, 4.0])
@pytest.mark.parametrize("kind", COVARIANCES)
def test_intervals_of_dolp_hold_the_truth_at_their_rate(kind, length):
    cov = COVARIANCES[kind]
    held = np.zeros(2)
    for vector in _vectors(cov, length, 7):
        held += [low <= length <= high for low, high in dolp_intervals(Moments(mean=vector, cov=cov))]
    for share, level in zip(held / DRAWS, (0.6827, 0.95), strict=True):
        # Three binomial errors below; above, six per cent more, for covariances that are not round.
        error = np.sqrt(level * (1.0 - level) / DRAWS)
        assert -3.0 * error < share - level < 0.06 + 3.0 * error


@pytest.mark.parametrize("length", [0.5, 1.5, 3.0, 20.0])
@pytest.mark.parametrize("kind", COVARIANCES)
def test_intervals_of_aolp_hold_the_truth_at_their_rate(kind, length):
    cov = COVARIANCES[kind]
    held = np.zeros(2)
    for vector in _vectors(cov, length, 10):
        off = -0.5 * np.arctan2(vector[1], vector[0])
        held += [low <= off <= high for low, high in aolp_limits_rad(Moments(mean=vector, cov=cov))]
    for share, level in zip(held / DRAWS, (0.6827, 0.95), strict=True):
        error = np.sqrt(level * (1.0 - level) / DRAWS)
        assert -3.0 * error < share - level < 0.06 + 3.0 * error


def test_an_axis_that_may_be_any_has_all_axes_in_its_interval():
    found = aolp_limits_rad(Moments(mean=np.array([1.0, 0.5]), cov=np.eye(2)))
    assert found == ((-np.pi / 2, np.pi / 2),) * 2


def test_errors_of_few_differences_make_intervals_wider_and_scores_smaller():
    draws = np.random.default_rng(11).normal(size=(4000, 4))
    means, errors = draws.mean(axis=1), draws.std(axis=1, ddof=1) / 2.0
    held = [
        [low <= 0.0 <= high for low, high in student_intervals(mean, error, 3.0)]
        for mean, error in zip(means, errors, strict=True)
    ]
    assert np.mean(held, axis=0) == pytest.approx([0.6827, 0.95], abs=0.022)
    assert kstest([student_score(one, 3.0) for one in means / errors], "norm").pvalue > 1e-3
    assert student_intervals(1.0, 1.0, np.inf) is None


def test_light_without_polarization_is_called_polarized_one_time_in_twenty():
    found = [
        is_polarized(Moments(mean=one, cov=COVARIANCES["tilted"])) for one in _vectors(COVARIANCES["tilted"], 0.0, 8)
    ]
    assert abs(np.mean(found) - 0.05) < 3.0 * np.sqrt(0.05 * 0.95 / DRAWS)


def test_the_joint_score_is_standard_normal_and_grows_with_the_distance():
    cov = COVARIANCES["tilted"]
    assert kstest([joint_score(one, cov) for one in _vectors(cov, 0.0, 9)], "norm").pvalue > 1e-3
    assert joint_score(np.array([50.0, 0.0]), cov) > 10.0
    assert joint_score(np.array([1.0, 0.0]), np.zeros((2, 2))) is None
