"""Posterior of the inputs of a model from measured numbers, when the model itself may be wrong.

The inputs have a normal prior, cut at their limits. Measured numbers differ from the model's by noise of known
covariance and by a discrepancy: a Gaussian process with a covariance of known shape (Kennedy and O'Hagan 2001). Its
scales are inferred with the inputs, so that a model that does not fit gives a wide posterior.

`infer` works in three steps:

1. Compute the model at first points: the prior mean, one standard deviation to both sides, draws from the prior and
   about the linear update.
2. Fit an emulator, a Gaussian process, through the points; draw from the posterior that it gives; compute the model at
   some of the draws. Repeat with these points added until the error of the emulator does not matter.
3. Run two ensembles of walkers (emcee) on the emulator until both agree, and check the emulator once more.

Inputs are handled as standard scores u: inputs are mean + root u, with the root of the prior covariance. Scales of the
discrepancy have scores w. The same seed and problem give the same posterior.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import chdtrc, ndtri
from scipy.stats import qmc

FloatArray = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

# Accepted shift of a posterior by the emulator, in standard deviations of the data: it adds 1 % to a width.
_EMULATOR_ERROR = 0.15
# The chain has to be this many autocorrelation times long (Goodman and Weare's advice in emcee), and R-hat this near 1.
_LEAST_TIMES, _MOST_R_HAT = 50.0, 1.01
_BLOCK_STEPS, _CHECK_STEPS = 250, 500
_LEAST_CHECKED = 16


class NotConvergedError(ValueError):
    """The chain, or the emulator, did not reach what a posterior needs within the work that was allowed."""


# Standard deviation of the logarithm of a scale: a factor of two.
_SCALE_SPREAD = 0.7


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """K inputs, N measured numbers, and the model between them.

    Parameters
    ----------
    mean, cov
        Of the normal prior of the inputs, shape (K,) and (K, K), positive definite.
    least, most
        Where the prior is cut, shape (K,); infinite where there is no limit.
    model
        Takes inputs, shape (K,), and returns the N numbers; raises ValueError where inputs do not go together.
    data
        Measured numbers, shape (N,).
    noise_cov
        Of all errors of `data` and `model` that are known, shape (N, N), positive definite.
    discrepancy
        Shapes of the model's discrepancy, each (N, N), for a scale of 1; every one has its own scale. Empty: the model
        is taken as right.
    discrepancy_median
        Prior median of each scale, > 0; in 19 of 20 cases a scale lies within a factor of four of it.
    """

    mean: FloatArray
    cov: FloatArray
    least: FloatArray
    most: FloatArray
    model: Callable[[FloatArray], FloatArray]
    data: FloatArray
    noise_cov: FloatArray
    discrepancy: Sequence[FloatArray] = ()
    discrepancy_median: Sequence[float] = ()

    @cached_property
    def root(self) -> FloatArray:
        """Lower triangular factor of the prior covariance: inputs are mean + root @ u with standard normal u."""
        return np.asarray(np.linalg.cholesky(self.cov))

    def inputs(self, u: FloatArray) -> FloatArray:
        """Return inputs at standard scores, shape (..., K)."""
        return np.asarray(self.mean + u @ self.root.T)

    def is_within(self, u: FloatArray) -> NDArray[np.bool_]:
        """Return whether the limits allow standard scores, shape (...)."""
        inputs = self.inputs(u)
        return np.asarray(np.all((inputs >= self.least) & (inputs <= self.most), axis=-1))

    def scales(self, w: FloatArray) -> FloatArray:
        """Return scales of the discrepancy at standard scores: log-normal laws about the stated medians."""
        return np.asarray(np.asarray(self.discrepancy_median) * np.exp(_SCALE_SPREAD * w))

    def total_cov(self, scales: FloatArray) -> FloatArray:
        """Return the covariance of the data about the model for scales of the discrepancy, shape (..., N, N)."""
        total = np.broadcast_to(self.noise_cov, (*scales.shape[:-1], *self.noise_cov.shape))
        for k, shape in enumerate(self.discrepancy):
            total = total + scales[..., k, None, None] ** 2 * shape
        return np.asarray(total)


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior:
    """Draws of a posterior and what they say, K inputs.

    Attributes
    ----------
    inputs, scales
        Draws, shape (D, K) and (D, number of scales), nearly independent.
    modelled
        What the emulator says at the draws, shape (D, N).
    prior_mean, prior_std, mean, std
        Of the inputs, shape (K,).
    gain_bits
        Information gained of each input, shape (K,): divergence of its posterior from its prior, both taken as normal.
    correlation
        Of the inputs in the posterior, shape (K, K).
    together
        Groups of inputs, by position, of which the data know only a combination.
    steps, autocorrelation_steps, r_hat
        Length of each ensemble after the burn-in; longest autocorrelation time and largest R-hat of any coordinate.
    model_calls, emulator_error
        Points at which the model was computed; error of the emulator at further draws of the posterior, as its root
        mean square in standard deviations of the data.
    impossible_share
        Share of the checked draws at which the model does not exist.
    """

    inputs: FloatArray
    scales: FloatArray
    modelled: FloatArray
    prior_mean: FloatArray
    prior_std: FloatArray
    steps: int
    autocorrelation_steps: float
    r_hat: float
    model_calls: int
    emulator_error: float
    emulator_cov: FloatArray = field(repr=False)
    impossible_share: float = 0.0

    @property
    def mean(self) -> FloatArray:
        """Mean of the inputs."""
        return np.asarray(self.inputs.mean(axis=0))

    @property
    def std(self) -> FloatArray:
        """Standard deviation of the inputs."""
        return np.asarray(self.inputs.std(axis=0, ddof=1))

    @property
    def gain_bits(self) -> FloatArray:
        """Information gained of each input [bit]."""
        ratio, shift = self.std / self.prior_std, (self.mean - self.prior_mean) / self.prior_std
        return np.asarray((0.5 * (ratio**2 + shift**2 - 1.0) - np.log(ratio)) / np.log(2.0))

    @property
    def correlation(self) -> FloatArray:
        """Correlation of the inputs."""
        return np.atleast_2d(np.corrcoef(self.inputs, rowvar=False))

    @property
    def together(self) -> tuple[tuple[int, ...], ...]:
        """Inputs that cannot be distinguished: a combination is known three times better than they are themselves."""
        values, vectors = np.linalg.eigh(self.correlation)
        known = self.std < _KNOWN * self.prior_std
        found: list[set[int]] = []
        for value, vector in zip(values, vectors.T, strict=True):
            members = {int(k) for k in np.flatnonzero(np.abs(vector) > _MEMBER)}
            if value < _DEGENERATE and len(members) > 1 and not all(known[k] for k in members):
                joined = [group for group in found if group & members]
                found = [group for group in found if group not in joined] + [members.union(*joined)]
        return tuple(tuple(sorted(group)) for group in found)


# Eigenvalue of the correlation below which a combination is known better, share of an input in it, and what is known.
_DEGENERATE, _MEMBER, _KNOWN = 0.1, 0.4, 0.3


def linear_update(slopes: FloatArray, residual: FloatArray, cov: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance of the linear-Gaussian posterior of standard normal scores.

    Parameters
    ----------
    slopes
        Change of the model by each score, shape (N, K).
    residual
        Data less model at scores of 0, shape (N,).
    cov
        Of the residual without the inputs, shape (N, N).

    References
    ----------
    Tarantola (2005), Inverse Problem Theory, section 3.2.
    """
    weighted = np.linalg.solve(cov, slopes)
    found = np.linalg.inv(np.eye(slopes.shape[1]) + slopes.T @ weighted)
    return found @ (weighted.T @ residual), np.asarray(found)


def infer(
    problem: Problem,
    *,
    seed: int = 1,
    most_steps: int = 20_000,
    most_points: int = 800,
    tell: Progress = lambda *_: None,
) -> Posterior:
    """Return the posterior of the inputs of a problem.

    Parameters
    ----------
    problem
        Prior, data, model, and what is known of their errors.
    seed
        Of all draws.
    most_steps, most_points
        Longest chain of an ensemble, and most computations of the model.
    tell
        Called with the current work in words, the steps done, and the steps in all.

    Raises
    ------
    NotConvergedError
        The chain was not long enough, or no emulator reached the accuracy.
    ValueError
        The model does not exist at the prior mean.

    References
    ----------
    Kennedy and O'Hagan (2001), doi:10.1111/1467-9868.00294 (discrepancy); Foreman-Mackey et al. (2013),
    doi:10.1086/670067 (emcee); Gelman and Rubin (1992), doi:10.1214/ss/1177011136 (R-hat).
    """
    points = _Points(problem, tell, most_points)
    count, draws = problem.mean.size, _first_draws(problem, points, seed)
    for number in range(_MOST_CHAINS):
        emulator, error_cov, draws = _accurate_emulator(problem, points, draws, [seed, number])
        density = _Density(problem, emulator, error_cov)
        values, time, r_hat = _converged_chain(density, draws, [seed, number], most_steps, tell)
        # Draws half an autocorrelation time apart, in random order.
        thinned = values[:, :: max(1, int(0.5 * time))].reshape(-1, values.shape[-1])
        draws = np.random.default_rng([seed, 3]).permutation(thinned)[:_MOST_DRAWS]
        error, _, impossible = _checked(problem, emulator, points, draws)
        if error <= 2.0 * _EMULATOR_ERROR:
            break
    else:
        raise NotConvergedError(_inaccurate(error, points.count))
    prior = problem.inputs(_prior_scores(problem, np.random.default_rng(seed), _PRIOR_DRAWS))
    return Posterior(
        inputs=problem.inputs(draws[:, :count]),
        scales=problem.scales(draws[:, count:]),
        modelled=emulator(draws[:, :count]),
        prior_mean=prior.mean(axis=0),
        prior_std=prior.std(axis=0, ddof=1),
        steps=values.shape[1],
        autocorrelation_steps=time,
        r_hat=r_hat,
        model_calls=points.count,
        emulator_error=error,
        emulator_cov=error_cov,
        impossible_share=impossible,
    )


_MOST_TURNS, _MOST_CHAINS, _MOST_DRAWS, _PRIOR_DRAWS = 40, 5, 4000, 4096


def _prior_scores(problem: Problem, draw: np.random.Generator, count: int) -> FloatArray:
    """Return draws from the prior as standard scores, shape (count, K)."""
    found = np.empty((0, problem.mean.size))
    while found.shape[0] < count:
        tried = draw.standard_normal((2 * count, problem.mean.size))
        found = np.concatenate([found, tried[problem.is_within(tried)]])
    return found[:count]


class _Points:
    """Points at which the model was computed, as standard scores; not a number where it does not exist."""

    def __init__(self, problem: Problem, tell: Progress, most: int) -> None:
        self._problem, self._tell, self.most = problem, tell, most
        self.u = np.empty((0, problem.mean.size))
        self.z = np.empty((0, problem.data.size))

    @property
    def count(self) -> int:
        """Number of points."""
        return int(self.u.shape[0])

    @property
    def is_possible(self) -> NDArray[np.bool_]:
        """Whether the model exists at each."""
        return np.asarray(np.isfinite(self.z).all(axis=1))

    def compute(self, u: FloatArray) -> FloatArray:
        """Return the model at further points, and keep them."""
        z = np.full((len(u), self._problem.data.size), np.nan)
        for k in np.flatnonzero(self._problem.is_within(u)):
            with suppress(ValueError):
                z[k] = self._problem.model(self._problem.inputs(u[k]))
            self._tell("computing the model", self.count + int(k) + 1, self.most)
        self.u, self.z = np.concatenate([self.u, u]), np.concatenate([self.z, z])
        return z


def _first_draws(problem: Problem, points: _Points, seed: int) -> FloatArray:
    """Compute the first points; return draws from the linear update, with scales from their prior."""
    count = problem.mean.size
    steps = np.concatenate([np.zeros((1, count)), np.eye(count), -np.eye(count)])
    z = points.compute(steps)
    if not np.isfinite(z[0]).all():
        problem.model(problem.mean)  # raises an error that says why
    slopes = central_slopes(z[0], z[1 : count + 1], z[count + 1 :])
    cov = problem.total_cov(np.asarray(problem.discrepancy_median, dtype=np.float64))
    mean, cov = linear_update(slopes, problem.data - z[0], cov)
    root = np.linalg.cholesky(cov)
    number = int(2 ** np.ceil(np.log2(4 * count)))
    shares = qmc.Sobol(count, scramble=True, rng=np.random.default_rng(seed)).random(number)
    normal = ndtri(0.001 + 0.998 * shares)
    near = mean + _WIDER * normal[number // 2 :] @ root.T
    points.compute(np.concatenate([normal[: number // 2], np.clip(near, -_FAR, _FAR)]))
    draws = np.random.default_rng([seed, 1]).standard_normal((_GUESSED, count + len(problem.discrepancy)))
    draws[:, :count] = mean + draws[:, :count] @ root.T
    return draws


# Points are placed so much wider than the estimate, and no farther from the prior mean than this.
_WIDER, _FAR, _GUESSED = 1.5, 5.0, 2000


def central_slopes(centre: FloatArray, above: FloatArray, below: FloatArray) -> FloatArray:
    """Return slopes of a model by each input, shape (N, K); one-sided where the model is not a number on one side.

    Parameters
    ----------
    centre
        The model in the middle, shape (N,).
    above, below
        One step of each input to either side, shape (K, N).
    """
    up, down = above - centre, centre - below
    both = 0.5 * (up + down)
    found = np.where(np.isfinite(both), both, np.where(np.isfinite(up), up, down))
    return np.asarray(np.nan_to_num(found).T)


class _Emulator:
    """Gaussian process through points of the model: a polynomial trend, and one kernel for each of the numbers."""

    def __init__(self, points: _Points, lengths: FloatArray | None = None, *, is_fitted: bool = True) -> None:
        possible = points.is_possible
        self._all_u, self._possible = points.u, possible
        self._u, z = points.u[possible], points.z[possible]
        count = self._u.shape[1]
        terms = 1 + count + count * (count + 1) // 2
        self._is_square = self._u.shape[0] >= 2 * terms
        basis = self._basis(self._u)
        self._trend = np.linalg.lstsq(basis, z, rcond=None)[0]
        rest = z - basis @ self._trend
        self._size = np.maximum(np.sqrt(np.mean(rest**2, axis=0)), 1e-12)
        scaled = rest / self._size
        start = np.full((z.shape[1], count + 1), np.log(3.0)) if lengths is None else lengths
        if lengths is None:
            start[:, -1] = np.log(1e-6)
        fits = [_fitted_kernel(self._u, scaled[:, k], start[k], is_fitted=is_fitted) for k in range(z.shape[1])]
        self.lengths = np.array([fit[0] for fit in fits])
        self._inverse_lengths = np.exp(-self.lengths[:, :-1])
        self._weights = np.array([fit[1] for fit in fits])
        self._scaled_u = self._u * self._inverse_lengths[:, None, :]
        self._norm = np.sum(self._scaled_u**2, axis=-1)
        self.left_out = np.array([fit[2] for fit in fits]).T * self._size

    def __call__(self, u: FloatArray) -> FloatArray:
        """Return the numbers at standard scores, shape (W, N) for (W, K)."""
        at = u * self._inverse_lengths[:, None, :]
        apart = np.sum(at**2, axis=-1)[..., None] + self._norm[:, None, :] - 2.0 * at @ self._scaled_u.swapaxes(1, 2)
        kernel = np.exp(-0.5 * np.maximum(apart, 0.0))
        return np.asarray(self._basis(u) @ self._trend + (kernel @ self._weights[..., None])[..., 0].T * self._size)

    def exists(self, u: FloatArray) -> NDArray[np.bool_]:
        """Return whether the model is taken to exist: whether it does at the nearest point."""
        if self._possible.all():
            return np.ones(u.shape[0], dtype=np.bool_)
        apart = np.sum((u[:, None, :] - self._all_u) ** 2, axis=-1)
        return np.asarray(self._possible[np.argmin(apart, axis=1)])

    def _basis(self, u: FloatArray) -> FloatArray:
        ones = np.ones((u.shape[0], 1))
        if not self._is_square:
            return np.concatenate([ones, u], axis=1)
        first, second = np.triu_indices(u.shape[1])
        return np.concatenate([ones, u, u[:, first] * u[:, second]], axis=1)


# Logarithms of lengths [standard scores] and of the nugget.
_LENGTHS, _NUGGET = (np.log(0.3), np.log(100.0)), (np.log(1e-10), np.log(1e-1))


def _fitted_kernel(
    u: FloatArray, z: FloatArray, start: FloatArray, *, is_fitted: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the kernel of largest likelihood, its weights, and errors at each point if it is left out.

    The kernel is exp(-d^2/2) with a length for each input, and a nugget; its size is eliminated. Without a fit, lengths
    and nugget stay as given.

    References
    ----------
    Rasmussen and Williams (2006), Gaussian Processes for Machine Learning, eqs. (5.8), (5.9), (5.12).
    """
    squares = (u[:, None, :] - u) ** 2
    eye = np.eye(len(z))

    def kernel(p: FloatArray) -> FloatArray:
        return np.asarray(np.exp(-0.5 * (squares @ np.exp(-2.0 * p[:-1]))))

    def loss(p: FloatArray) -> tuple[float, FloatArray]:
        smooth = kernel(p)
        try:
            root = np.linalg.cholesky(smooth + np.exp(p[-1]) * eye)
        except np.linalg.LinAlgError:
            return 1e10, np.zeros_like(p)
        inverse = np.linalg.inv(smooth + np.exp(p[-1]) * eye)
        weights = inverse @ z
        variance = max(float(z @ weights) / len(z), 1e-300)
        value = 0.5 * len(z) * np.log(variance) + float(np.sum(np.log(np.diag(root))))
        pull = inverse - np.outer(weights, weights) / variance
        slope = [0.5 * np.sum(pull * smooth * squares[..., k]) * np.exp(-2.0 * p[k]) for k in range(u.shape[1])]
        return value, np.array([*slope, 0.5 * np.trace(pull) * np.exp(p[-1])])

    bounds = [_LENGTHS] * u.shape[1] + [_NUGGET]
    found = start
    if is_fitted:
        found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 40}).x
    inverse = np.linalg.inv(kernel(found) + np.exp(found[-1]) * eye)
    weights = inverse @ z
    return found, weights, weights / np.diag(inverse)


def _checked(
    problem: Problem, emulator: _Emulator, points: _Points, draws: FloatArray
) -> tuple[float, FloatArray, float]:
    """Compare the emulator with the model at the first of the draws, which become points.

    Returned are the error (root mean square over draws of its length in standard deviations of the data), the second
    moment of the error, and the share of the draws at which the model does not exist.
    """
    count = problem.mean.size
    chosen = draws[: max(_LEAST_CHECKED, 2 * count)]
    z = points.compute(chosen[:, :count])
    there = np.isfinite(z).all(axis=1)
    if not there.any():
        return np.inf, problem.noise_cov, 1.0
    off = z[there] - emulator(chosen[there, :count])
    # The noise at the smallest discrepancy that the draws have: there an error of the emulator matters most.
    scales = problem.scales(np.quantile(draws[:, count:], 0.25, axis=0))
    white = np.linalg.solve(np.linalg.cholesky(problem.total_cov(scales)), off.T)
    error = float(np.sqrt(np.mean(np.sum(white**2, axis=0))))
    return error, np.asarray(off.T @ off / len(off)), float(1.0 - there.mean())


def _accurate_emulator(
    problem: Problem, points: _Points, draws: FloatArray, seed: list[int]
) -> tuple[_Emulator, FloatArray, FloatArray]:
    """Return an emulator that is accurate where the posterior lies, its error covariance, and draws from there."""
    draw, lengths, error, error_cov = np.random.default_rng([*seed, 2]), None, np.inf, None
    for turn in range(_MOST_TURNS):
        emulator = _Emulator(points, lengths)
        lengths = emulator.lengths
        if error_cov is None:
            error_cov = np.asarray(emulator.left_out.T @ emulator.left_out / len(emulator.left_out))
        density = _Density(problem, emulator, error_cov)
        start = _possible(density, draws[: density.walkers], draw)
        chain = _moved(density, density.guess(draws), start, _CHECK_STEPS, np.random.RandomState([*seed, 3, turn]))
        draws = draw.permutation(chain[len(chain) // 2 :].reshape(-1, draws.shape[1]))
        error, error_cov, _ = _checked(problem, emulator, points, draws)
        if error <= _EMULATOR_ERROR:
            return _Emulator(points, lengths, is_fitted=False), error_cov, draws
        if points.count >= points.most:
            break
    raise NotConvergedError(_inaccurate(error, points.count))


def _inaccurate(error: float, count: int) -> str:
    return (
        f"no emulator of the model is accurate enough: after {count} computations of the model its error at draws of "
        f"the posterior is {error:.2g} standard deviations of the data, allowed is {2.0 * _EMULATOR_ERROR:g}; choose "
        "fewer inputs, or give them smaller uncertainties"
    )


class _Density:
    """Logarithm of the posterior density of standard scores of inputs and scales, less a constant."""

    def __init__(self, problem: Problem, emulator: _Emulator, error_cov: FloatArray) -> None:
        self._problem, self._emulator, self._error_cov = problem, emulator, error_cov
        # Even, and more than twice the coordinates.
        self.walkers = max(32, 2 * (problem.mean.size + len(problem.discrepancy)) + 4)

    def __call__(self, scores: FloatArray) -> FloatArray:
        """Return it at scores, shape (W,) for (W, K + number of scales)."""
        count = self._problem.mean.size
        u = scores[:, :count]
        found = np.full(len(scores), -np.inf)
        near = self._problem.is_within(u) & np.all(np.abs(scores) < _OUTERMOST, axis=1)
        near[near] = self._emulator.exists(u[near])
        if not near.any():
            return found
        off = self._problem.data - self._emulator(u[near])
        cov = self._problem.total_cov(self._problem.scales(scores[near, count:])) + self._error_cov
        root = np.asarray(np.linalg.cholesky(cov))
        white = np.linalg.solve(root, off[..., None])[..., 0]
        found[near] = -0.5 * np.sum(white**2, axis=1) - _log_size(root) - 0.5 * np.sum(scores[near] ** 2, axis=1)
        return found

    def guess(self, draws: FloatArray) -> "_Guess":
        """Return proposals from draws of an earlier estimate."""
        return _Guess(self._problem, self._emulator, self._error_cov, draws)


_OUTERMOST = 8.0


def _possible(density: _Density, scores: FloatArray, draw: np.random.Generator) -> FloatArray:
    """Return starts of walkers where the density exists; others are replaced by neighbours of those."""
    there = np.isfinite(density(scores))
    if not there.any():
        raise NotConvergedError("the model exists at no start of the chain; give the inputs smaller uncertainties")
    chosen = draw.choice(np.flatnonzero(there), size=int(np.sum(~there)))
    moved = scores.copy()
    moved[~there] = scores[chosen]
    tries = moved + np.where(there, 0.0, 1e-3)[:, None] * draw.standard_normal(scores.shape)
    return np.where(np.isfinite(density(tries))[:, None], tries, moved)


class _Guess:
    """Proposals that do not depend on where a walker is: scales from an estimate, inputs by the linear update.

    The narrower the discrepancy, the narrower the posterior of the inputs: a step that suits one does not suit another.
    Given the scales, the linear update about the estimate is nearly the posterior. Laws are Student's, for their tails.
    """

    def __init__(self, problem: Problem, emulator: _Emulator, error_cov: FloatArray, draws: FloatArray) -> None:
        self._problem, self._error_cov = problem, error_cov
        self._count = count = problem.mean.size
        u, w = draws[:, :count], draws[:, count:]
        self._w_mean = w.mean(axis=0)
        cov = np.atleast_2d(np.cov(w, rowvar=False)) if w.size else np.empty((0, 0))
        self._w_root = np.linalg.cholesky(cov + 1e-9 * np.eye(w.shape[1]))
        self._at, step = u.mean(axis=0), np.diag(u.std(axis=0))
        above, below = emulator(self._at + step), emulator(self._at - step)
        self._slopes = 0.5 * (above - below).T / np.diag(step)
        self._offset = problem.data - emulator(self._at[None])[0] + self._slopes @ self._at

    def __call__(self, at: FloatArray, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        """Return places, and the logarithm of the densities of the old ones over those of the new ones."""
        count = self._count
        of_w, of_u = (_student(random, (len(at), size)) for size in (at.shape[1] - count, count))
        w = self._w_mean + of_w @ self._w_root.T
        mean, root = self._update(w)
        offered = np.concatenate([mean + np.einsum("wij,wj->wi", root, of_u), w], axis=1)
        mean, old_root = self._update(at[:, count:])
        there = np.asarray(np.linalg.solve(old_root, (at[:, :count] - mean)[..., None]))[..., 0]
        old_w = np.linalg.solve(self._w_root, (at[:, count:] - self._w_mean).T).T if w.size else of_w
        old = _student_log(there) + _student_log(old_w) - _log_size(old_root)
        return offered, old - (_student_log(of_u) + _student_log(of_w) - _log_size(root))

    def _update(self, w: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and triangular root of the inputs' covariance for scales, by the linear update."""
        cov = self._problem.total_cov(self._problem.scales(w)) + self._error_cov
        weighted = np.linalg.solve(cov, np.broadcast_to(self._slopes, (len(w), *self._slopes.shape)))
        found = np.linalg.inv(np.eye(self._count) + self._slopes.T @ weighted)
        mean = np.einsum("wij,wnj,n->wi", found, weighted, self._offset)
        return mean, np.linalg.cholesky(found)


_FREEDOM = 8.0


def _student(random: np.random.RandomState, shape: tuple[int, int]) -> FloatArray:
    scale = np.sqrt(_FREEDOM / random.chisquare(_FREEDOM, size=(shape[0], 1)))
    return np.asarray(random.standard_normal(shape) * scale)


def _student_log(scores: FloatArray) -> FloatArray:
    """Return the logarithm of Student's density over coordinates, less a constant."""
    size = np.sum(scores**2, axis=1) / _FREEDOM
    return np.asarray(-0.5 * (_FREEDOM + scores.shape[1]) * np.log1p(size))


def _log_size(root: FloatArray) -> FloatArray:
    return np.asarray(np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1))


def _moved(
    density: _Density, guess: _Guess, start: FloatArray, steps: int, random: np.random.RandomState
) -> FloatArray:
    """Return the walkers after each of some steps, shape (steps, walkers, coordinates)."""
    import emcee

    # Not DESnookerMove: that of emcee 3.1.6 samples a variance of 0.64 where it is 1 (github.com/dfm/emcee/pull/531).
    moves = [(emcee.moves.DEMove(), 0.5), (emcee.moves.MHMove(guess), 0.5)]
    sampler = emcee.EnsembleSampler(*start.shape, density, vectorize=True, moves=moves)
    state = emcee.State(start, random_state=random.get_state())
    sampler.run_mcmc(state, steps, skip_initial_state_check=True)
    return np.asarray(sampler.get_chain())


def _converged_chain(
    density: _Density, draws: FloatArray, seed: list[int], most_steps: int, tell: Progress
) -> tuple[FloatArray, float, float]:
    """Move two ensembles, one from the draws and one from three times as wide, until they are converged.

    Returned are the walkers without the burn-in, shape (2, steps, walkers, coordinates), the longest autocorrelation
    time of any coordinate [steps], and the largest R-hat.
    """
    draw, guess, walkers = np.random.default_rng([*seed, 5]), density.guess(draws), density.walkers
    wide = draws.mean(axis=0) + 3.0 * (draws[walkers : 2 * walkers] - draws.mean(axis=0))
    at = np.array([_possible(density, one, draw) for one in (draws[:walkers], wide)])
    blocks: list[FloatArray] = []
    said = ""
    while (done := len(blocks) * _BLOCK_STEPS) < most_steps:
        randoms = [np.random.RandomState([*seed, 4, ensemble, len(blocks)]) for ensemble in (0, 1)]
        found = [_moved(density, guess, start, _BLOCK_STEPS, own) for start, own in zip(at, randoms, strict=True)]
        blocks.append(np.stack(found))
        at, done = blocks[-1][:, -1], done + _BLOCK_STEPS
        values = np.concatenate(blocks, axis=1)[:, done // 5 :]
        time, r_hat = _convergence(values)
        steps = values.shape[1]
        if steps >= _LEAST_TIMES * time and r_hat <= _MOST_R_HAT:
            return values, time, r_hat
        tell("moving the chain", done, max(done, int(min(most_steps, 1.25 * _LEAST_TIMES * time))))
        said = (
            f" after {done} steps it is {steps / time:.0f} autocorrelation times long (needed are {_LEAST_TIMES:g}) "
            f"and R-hat is {r_hat:.3f} (allowed is {_MOST_R_HAT:g});"
        )
    raise NotConvergedError(f"the chain has not converged:{said} allow more steps, or choose fewer inputs")


def _convergence(values: FloatArray) -> tuple[float, float]:
    """Return the longest autocorrelation time of any coordinate [steps], and the largest R-hat of four half chains."""
    from emcee.autocorr import integrated_time

    with np.errstate(invalid="ignore"):  # of a walker that never moved
        times = [integrated_time(ensemble, tol=0, quiet=True) for ensemble in values]
    half = values.shape[1] // 2
    parts = np.concatenate([values[:, :half], values[:, half : 2 * half]]).reshape(4, -1, values.shape[-1])
    within, between = parts.var(axis=1, ddof=1).mean(axis=0), parts.mean(axis=1).var(axis=0, ddof=1)
    return float(np.nan_to_num(np.max(times), nan=np.inf)), float(np.max(np.sqrt(1.0 + between / within)))


def block_p_values(
    problem: Problem, posterior: Posterior, blocks: Sequence[NDArray[np.intp]], *, discrepancy: bool
) -> FloatArray:
    """Return for each block of the data the posterior predictive chance of a chi-square as large as the measured one.

    Parameters
    ----------
    blocks
        Positions in the data, such as the numbers of one region.
    discrepancy
        Whether the discrepancy is part of what is predicted; without it a small chance says that the model is wrong.

    References
    ----------
    Gelman, Meng and Stern (1996), Statistica Sinica 6, 733: the chi-square discrepancy, whose law is known.
    """
    off = problem.data - posterior.modelled
    scales = posterior.scales if discrepancy else np.zeros_like(posterior.scales)
    cov = problem.total_cov(scales) + posterior.emulator_cov
    chances = []
    for block in blocks:
        own = np.linalg.solve(cov[:, block[:, None], block], off[:, block, None])[..., 0]
        chances.append(np.mean(chdtrc(block.size, np.sum(off[:, block] * own, axis=1))))
    return np.array(chances)


def discrepancy_moments(problem: Problem, posterior: Posterior) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of the model's discrepancy in each of the data, as the posterior has it."""
    if not problem.discrepancy:
        return np.zeros_like(problem.data), np.zeros_like(problem.data)
    off = problem.data - posterior.modelled
    total = problem.total_cov(posterior.scales)
    own = total - problem.noise_cov
    gain = np.linalg.solve(total + posterior.emulator_cov, own).swapaxes(1, 2)
    mean = (gain @ off[..., None])[..., 0]
    spread = np.diagonal(own - gain @ own, axis1=1, axis2=2).mean(axis=0) + mean.var(axis=0)
    return np.asarray(mean.mean(axis=0)), np.asarray(np.sqrt(np.maximum(spread, 0.0)))
