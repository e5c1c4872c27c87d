"""The posterior against closed forms, against its own prior, and under a model that is wrong."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from model.processing.posterior import NotConvergedError, Problem, block_p_values, infer

INFINITE = np.full(2, np.inf)
SLOPES = np.array([[1.0, 0.2], [0.3, 1.0], [0.5, -0.4], [0.0, 0.7]])


def linear_problem(**changes: object) -> Problem:
    """Four numbers that follow two inputs in a straight line."""
    problem = Problem(
        mean=np.array([1.0, -2.0]),
        cov=np.array([[0.04, 0.01], [0.01, 0.09]]),
        least=-INFINITE,
        most=INFINITE,
        model=lambda inputs: SLOPES @ inputs,
        data=np.array([0.75, -1.6, 1.4, -1.3]),
        noise_cov=np.diag([0.01, 0.02, 0.01, 0.03]) + 0.002,
    )
    return replace(problem, **changes)  # type: ignore[arg-type]


def test_the_posterior_of_a_linear_model_is_the_closed_form() -> None:
    problem = linear_problem()
    precision = np.linalg.inv(problem.cov) + SLOPES.T @ np.linalg.solve(problem.noise_cov, SLOPES)
    cov = np.linalg.inv(precision)
    mean = problem.mean + cov @ SLOPES.T @ np.linalg.solve(problem.noise_cov, problem.data - SLOPES @ problem.mean)
    found = infer(problem)
    error = np.sqrt(np.diag(cov)) / np.sqrt(1000.0)
    np.testing.assert_allclose(found.mean, mean, atol=4.0 * error.max())
    np.testing.assert_allclose(found.std, np.sqrt(np.diag(cov)), rtol=0.08)
    assert found.r_hat < 1.01
    assert found.steps > 50.0 * found.autocorrelation_steps


def test_an_input_that_must_not_be_negative_is_not() -> None:
    problem = linear_problem(mean=np.array([0.05, -2.0]), least=np.array([0.0, -np.inf]))
    found = infer(problem)
    assert found.inputs[:, 0].min() >= 0.0
    assert found.prior_mean[0] > 0.1


def test_a_curved_model_is_followed() -> None:
    # x^2 = 0.25 +- 0.02 with a prior about 0.6: the posterior is that of the root.
    problem = Problem(
        mean=np.array([0.6]),
        cov=np.array([[0.04]]),
        least=np.array([0.0]),
        most=np.array([np.inf]),
        model=lambda inputs: inputs**2,
        data=np.array([0.25]),
        noise_cov=np.array([[0.0004]]),
    )
    x = np.linspace(0.0, 1.5, 20001)
    density = np.exp(-0.5 * ((x - 0.6) / 0.2) ** 2 - 0.5 * ((x**2 - 0.25) / 0.02) ** 2)
    mean = np.sum(x * density) / density.sum()
    std = np.sqrt(np.sum((x - mean) ** 2 * density) / density.sum())
    found = infer(problem)
    assert found.mean[0] == pytest.approx(mean, abs=0.15 * std)
    assert found.std[0] == pytest.approx(std, rel=0.1)


def test_inputs_of_which_only_the_sum_is_known_are_named_together() -> None:
    problem = linear_problem(
        cov=np.diag([0.04, 0.04]),
        model=lambda u: np.array([u.sum()]),
        data=np.array([-1.0]),
        noise_cov=np.eye(1) * 1e-6,
    )
    found = infer(problem)
    assert found.together == ((0, 1),)
    assert np.all(found.gain_bits < 1.0)


def discrepant(data: np.ndarray) -> Problem:
    return linear_problem(data=data, noise_cov=1e-6 * np.eye(4), discrepancy=(np.eye(4),), discrepancy_median=(0.05,))


def test_a_model_that_misses_the_data_widens_the_posterior() -> None:
    right = SLOPES @ np.array([1.1, -2.1])
    close, far = (infer(discrepant(right + off * np.array([1.0, -1.0, -1.0, 1.0]))) for off in (0.01, 0.3))
    assert np.all(far.std > 2.0 * close.std)
    blocks = [np.arange(4)]
    problem = discrepant(right + 0.3 * np.array([1.0, -1.0, -1.0, 1.0]))
    assert block_p_values(problem, far, blocks, discrepancy=False)[0] < 1e-6
    assert block_p_values(problem, far, blocks, discrepancy=True)[0] > 0.05


def test_a_chain_that_does_not_find_both_ends_is_refused() -> None:
    # x^2 = 1 has two roots, between which no walker finds its way in so few steps.
    problem = Problem(
        mean=np.array([0.1]),
        cov=np.array([[1.0]]),
        least=np.array([-np.inf]),
        most=np.array([np.inf]),
        model=lambda inputs: inputs**2,
        data=np.array([1.0]),
        noise_cov=np.array([[1e-4]]),
    )
    with pytest.raises(NotConvergedError, match="the chain has not converged: after 250 steps"):
        infer(problem, most_steps=250)


def ranks(problem: Callable[[np.random.Generator], tuple[Problem, np.ndarray]], draws: int) -> np.ndarray:
    """Shares of the posterior below the truth, of truths that are drawn from the prior."""
    found = []
    for seed in range(draws):
        one, truth = problem(np.random.default_rng(seed))
        posterior = infer(one, seed=seed)
        found.append(np.mean(np.concatenate([posterior.inputs, posterior.scales], axis=1) < truth, axis=0))
    return np.array(found)


def drawn(draw: np.random.Generator) -> tuple[Problem, np.ndarray]:
    problem = discrepant(np.zeros(4))
    u, w = draw.standard_normal(2), draw.standard_normal(1)
    truth, scale = problem.inputs(u), problem.scales(w)
    data = SLOPES @ truth + np.linalg.cholesky(problem.total_cov(scale)) @ draw.standard_normal(4)
    return replace(problem, data=data), np.array([*truth, *scale])


@pytest.mark.slow
def test_ranks_of_drawn_truths_are_uniform() -> None:
    found = ranks(drawn, 40)
    for shares in found.T:
        counts = np.histogram(shares, bins=5, range=(0.0, 1.0))[0]
        # Chi-square of four degrees of freedom: 18.5 is passed in one case of a thousand.
        assert np.sum((counts - 8.0) ** 2 / 8.0) < 18.5
