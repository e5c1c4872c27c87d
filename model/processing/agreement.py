"""Agreement of prediction and measurement: scores, propagation and update of inputs, trends.

`propagate` takes uncertain inputs to a prediction by slopes, or by quadrature for curved responses. `update_inputs`
updates them by a measurement, and states how well the data separate the inputs. Many scores are judged together by
Holm's rule; trends are tested by a weighted line and by the correlation of ranks.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.numerics import gammaincc, ndtr

FloatArray = NDArray[np.float64]


def two_sided_p_value(z: ArrayLike) -> FloatArray:
    """Return the probability that a standard normal number is at least as far from 0 as `z`.

    Parameters
    ----------
    z
        Standard scores, any shape.
    """
    return np.asarray(2.0 * ndtr(-np.abs(np.asarray(z, dtype=np.float64))))


def holm_rejections(p_values: ArrayLike, *, alpha: float) -> NDArray[np.bool_]:
    """Return the rejected hypotheses; the probability of any false rejection is at most `alpha`.

    Parameters
    ----------
    p_values
        Shape (n,), each in [0, 1], with any dependence.
    alpha
        Probability of at least one false rejection, in (0, 1).

    Returns
    -------
    array of bool, shape (n,)
        True where the hypothesis is rejected.

    Raises
    ------
    ValueError
        A p value or `alpha` lies outside of its range.

    References
    ----------
    Holm, S. (1979), "A simple sequentially rejective multiple test procedure", Scandinavian Journal of
    Statistics 6, 65-70.
    """
    p = np.asarray(p_values, dtype=np.float64)
    if not 0.0 < alpha < 1.0:
        raise ValueError(f"alpha is {alpha}; allowed is between 0 and 1")
    if p.ndim != 1 or not np.all((p >= 0.0) & (p <= 1.0)):
        raise ValueError("p_values must be one row of numbers from 0 to 1")
    order = np.argsort(p, kind="stable")
    passed = p[order] > alpha / np.arange(p.size, 0, -1)
    first_kept = int(np.argmax(passed)) if passed.any() else p.size
    rejected = np.zeros(p.size, dtype=np.bool_)
    rejected[order[:first_kept]] = True
    return rejected


def input_jacobian(
    function: Callable[[FloatArray], FloatArray], values: ArrayLike, deviations: ArrayLike, *, least: Sequence[float]
) -> FloatArray:
    """Return the derivatives of a function's results with respect to its inputs, over one standard uncertainty.

    Parameters
    ----------
    function
        Takes inputs, shape (k,), and returns results, shape (m,).
    values
        Values of the inputs, shape (k,).
    deviations
        Standard uncertainty of each input, shape (k,); an input with 0 has the derivative 0.
    least
        Smallest value of each input, for instance 0; -inf without a limit.

    Returns
    -------
    array of float64, shape (m, k)
        Central differences over one standard uncertainty to either side; less near `least`, one-sided at it.

    References
    ----------
    JCGM 100:2008 (GUM), section 5.
    """
    start, steps = np.asarray(values, dtype=np.float64), np.asarray(deviations, dtype=np.float64)
    columns = [
        _slope(function, start, position=k, step=float(steps[k]), least=least[k])
        for k in range(start.size)
        if steps[k] > 0.0
    ]
    jacobian = np.zeros((function(start).size, start.size))
    if columns:
        jacobian[:, steps > 0.0] = np.stack(columns, axis=1)
    return jacobian


Results = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class Propagation:
    """Covariance of results due to uncertain inputs.

    Attributes
    ----------
    effects
        Change of each result by one standard uncertainty of each input alone, shape (m, k).
    cov
        Covariance of the results about the results at the inputs' values, shape (m, m).
    curved
        Indices of inputs with a curved response, propagated by quadrature.
    limited
        Inputs with a curved or untestable response too near to a limit, propagated by slopes.
    """

    effects: FloatArray
    cov: FloatArray
    curved: tuple[int, ...]
    limited: tuple[int, ...]


def propagate(
    function: Results,
    values: ArrayLike,
    cov: ArrayLike,
    *,
    least: ArrayLike,
    most: ArrayLike,
    fitted: Collection[int] = (),
    curvature_tolerance: float = 0.1,
) -> Propagation:
    """Return the effect of each uncertain input on a function's results, and their joint covariance.

    Parameters
    ----------
    function
        Takes inputs, shape (k,), and returns results, shape (m,); raises ValueError for impossible combinations.
    values
        Values of the inputs, shape (k,), at which the results exist.
    cov
        Covariance of the inputs, shape (k, k); an input with variance 0 is exact.
    least, most
        Smallest and largest value of each input, shape (k,); infinite without a limit.
    fitted
        Indices of inputs that were fitted to compensate others. The compensation is exact at any distance, unlike their
        first-order covariance, so curvature is tested for each alone.
    curvature_tolerance
        Largest neglected curvature of one input's response, as a share of the result's first-order standard
        uncertainty, >= 0. With 0.1, a standard uncertainty changes by at most 1 %.

    Raises
    ------
    ValueError
        The results exist on neither side of an input.

    Notes
    -----
    Slopes are central differences over one standard uncertainty. A curved input adds to J cov J' the second moment of
    its response, by Gauss-Hermite quadrature, less the linear part: the covariance includes the shift of the mean,
    since the results are not shifted. If an input is curved, inputs correlated with it are moved together along the
    principal axes of their covariance; joint curvature of two axes, or of two independent inputs, is neglected. If the
    results exist on only one side of an input, the one-sided slope is used, as at a limit.

    References
    ----------
    JCGM 100:2008 (GUM), section 5; JCGM 101:2008 for why a curved response needs more than a slope.
    """
    response = _Response(function, values, cov, least, most)
    linear = np.asarray(response.slopes @ response.cov @ response.slopes.T)
    spread = np.sqrt(np.diag(linear))
    bent = {k for k in response.uncertain if response.bends_more_than(k, curvature_tolerance * spread)}
    total, curved = linear, set[int]()
    for group in response.groups(fitted):
        for inputs, extra in response.extras(group, bent.intersection(group)):
            curved |= inputs
            total = total + extra
    limited = {*bent, *response.untested}.difference(curved)
    return Propagation(
        effects=response.effects, cov=total, curved=tuple(sorted(curved)), limited=tuple(sorted(limited))
    )


# Largest probability that another input outranks the true cause.
_CONFUSION = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class InputUpdate:
    """Update of k inputs, each alone and all together, by n residuals.

    Attributes
    ----------
    chi_square, degrees_of_freedom
        Residuals in the covariance of measurement and inputs together; their rank.
    score
        By input: square root of the decrease in chi-square if that input is free, with the sign of the move, shape
        (k,). Standard normal if model, measurement and uncertainties are right.
    move
        By input: move, in its own standard uncertainties, that minimises the residuals, shape (k,); 0 if the data do
        not depend on it.
    chi_square_left
        By input: chi-square after that move, shape (k,).
    seen
        By input: share of its stated variance that the data resolve, shape (k,), 0 (nothing) to 1.
    alike
        Correlation of the scores of any two inputs, shape (k, k).
    order
        Positions of the inputs from the first explanation to the last.
    joint_move, joint_std
        All inputs updated at once: mean and standard deviation afterwards, in the stated standard uncertainties, (k,).
    """

    chi_square: float
    degrees_of_freedom: int
    score: FloatArray
    move: FloatArray
    chi_square_left: FloatArray
    seen: FloatArray
    alike: FloatArray
    order: tuple[int, ...]
    joint_move: FloatArray
    joint_std: FloatArray

    @property
    def p_value(self) -> float:
        """Probability of residuals at least this large if all statements are right."""
        return chi_square_tail(self.chi_square, self.degrees_of_freedom)

    def confused_with(self, position: int) -> tuple[int, ...]:
        """Return the inputs that the data cannot distinguish from this one if it is wrong by five std.

        They are the smallest group without which the probability that another input outranks it is at most 5 %, by the
        sum of the pairwise probabilities.
        """
        others = np.array([k for k in range(self.score.size) if k != position], dtype=np.int64)
        chances = confusion(self.seen[position], self.alike[position, others])
        falling = np.argsort(-chances, kind="stable")
        left = np.cumsum(chances[falling][::-1])[::-1]
        return tuple(sorted(int(others[k]) for k, rest in zip(falling, left, strict=True) if rest > _CONFUSION))


# Relative eigenvalues of a covariance below this are rounding.
_RANK = 1e-12


def update_inputs(
    residual: ArrayLike, *, measurement_cov: ArrayLike, effects: ArrayLike, input_correlation: ArrayLike
) -> InputUpdate:
    """Return the move of each input that would explain residuals, and a joint update of all.

    Parameters
    ----------
    residual
        Measured less predicted, shape (n,).
    measurement_cov
        Covariance of the measurement, shape (n, n).
    effects
        Change of the prediction by one standard uncertainty of each input alone, shape (n, k).
    input_correlation
        Of the inputs, shape (k, k).

    Returns
    -------
    InputUpdate
        Inputs in the order of their scores; among similar ones the one with the smallest move is first.

    Raises
    ------
    ValueError
        Shapes do not fit, or the covariances are all zero.

    Notes
    -----
    With u the inputs in standard uncertainties from their values, correlation R and effects A, residuals have the
    covariance V = C + A R A'. A single input moves along a = A R e_j, and correlated inputs follow. Its score a'V^-1 r
    / (a'V^-1 a)^1/2 and move a'V^-1 r / (a'V^-1 a) are the generalised least squares of the residuals on a. The joint
    update is the Bayesian linear one: mean R A'V^-1 r, covariance R - R A'V^-1 A R; a fit, pulled towards the stated
    values.

    References
    ----------
    Definition: generalised least squares (Aitken 1936) and the linear-Gaussian posterior (Tarantola 2005, Inverse
    Problem Theory, section 3.2).
    """
    r, noise, a, correlation = (
        np.asarray(x, dtype=np.float64) for x in (residual, measurement_cov, effects, input_correlation)
    )
    _require_shapes(r, noise, a, correlation)
    inverse, rank = _pseudo_inverse(noise + a @ correlation @ a.T)
    along = a @ correlation
    pulls, seen = along.T @ (inverse @ r), np.einsum("nk,nm,mk->k", along, inverse, along)
    blind = seen <= _RANK
    size = np.sqrt(np.where(blind, 1.0, seen))
    score = np.where(blind, 0.0, pulls / size)
    chi_square = float(r @ inverse @ r)
    spread = along.T @ inverse @ along
    move = np.where(blind, 0.0, score / size)
    alike = np.where(blind[:, None] | blind[None, :], np.eye(blind.size), spread / np.outer(size, size))
    return InputUpdate(
        chi_square=chi_square,
        degrees_of_freedom=rank,
        score=score,
        move=move,
        chi_square_left=chi_square - score**2,
        seen=np.minimum(np.where(blind, 0.0, seen), 1.0),
        alike=alike,
        order=_ordered(score, move, alike),
        joint_move=pulls,
        joint_std=np.sqrt(np.maximum(np.diag(correlation) - seen, 0.0)),
    )


def chi_square_tail(chi_square: float, degrees_of_freedom: int) -> float:
    """Return the probability that chi-square is at least as large; 1 without degrees of freedom.

    Parameters
    ----------
    chi_square
        Sum of squares, >= 0 to rounding.
    degrees_of_freedom
        >= 0.
    """
    if degrees_of_freedom == 0:
        return 1.0
    return float(gammaincc(0.5 * degrees_of_freedom, 0.5 * max(chi_square, 0.0)))


def deviations_cov(std_errors: ArrayLike, correlation: ArrayLike) -> FloatArray:
    """Return the covariance of sample standard deviations of numbers that are correlated over the sample.

    Parameters
    ----------
    std_errors
        Of each deviation, shape (n,).
    correlation
        Of the numbers themselves, shape (n, n).

    Notes
    -----
    For Gaussian numbers, cov(s_i, s_j) is proportional to the square of their correlation.

    References
    ----------
    Anderson (2003), An Introduction to Multivariate Statistical Analysis, 3rd ed., section 3.3: moments of the Wishart
    distribution.
    """
    errors = np.asarray(std_errors, dtype=np.float64)
    return np.asarray(np.outer(errors, errors) * np.asarray(correlation, dtype=np.float64) ** 2)


@dataclass(frozen=True, kw_only=True)
class DriftLine:
    """A weighted straight line.

    Attributes
    ----------
    slope, std_error
        Per unit of the abscissa.
    chi_square, degrees_of_freedom
        Of the residuals.
    """

    slope: float
    std_error: float
    chi_square: float
    degrees_of_freedom: int


def drift_line(at: ArrayLike, values: ArrayLike, std_errors: ArrayLike) -> DriftLine:
    """Return the straight line through numbers that are weighted by their errors.

    Parameters
    ----------
    at
        Abscissa, such as a time, shape (n,), n >= 3, not all the same.
    values
        Shape (n,).
    std_errors
        Of the values, shape (n,), > 0, independent.

    Raises
    ------
    ValueError
        Fewer than three numbers, one abscissa for all, or an error that is not above 0.
    """
    x, y, s = (np.asarray(row, dtype=np.float64) for row in (at, values, std_errors))
    if x.size < 3 or np.ptp(x) == 0.0 or not np.all(s > 0.0):
        raise ValueError("a drift needs at least three numbers at different places, each with an error above 0")
    off = x - np.average(x, weights=s**-2.0)
    line, cov = np.polyfit(off, y, 1, w=1.0 / s, cov="unscaled")
    return DriftLine(
        slope=float(line[0]),
        std_error=float(np.sqrt(cov[0, 0])),
        chi_square=float(np.sum(((y - np.polyval(line, off)) / s) ** 2)),
        degrees_of_freedom=x.size - 2,
    )


@dataclass(frozen=True, kw_only=True)
class RankCorrelation:
    """Kendall's tau of a prediction and a measurement over the pairs of known order.

    Attributes
    ----------
    numbers
        Count of numbers.
    pairs, known_pairs
        Pairs of them, and those that differ by more than their error on both sides.
    concordant
        Known pairs that are in the same order on both sides.
    tau
        Of all pairs regardless of errors: (concordant - discordant) / pairs; a pair with equal numbers is neither.
    p_value
        One-sided probability of such a tau for independent orders.
    """

    numbers: int
    pairs: int
    known_pairs: int
    concordant: int
    tau: float
    p_value: float

    @property
    def share_concordant(self) -> float | None:
        """Share of the known pairs in the same order; None without known pairs."""
        return None if self.known_pairs == 0 else self.concordant / self.known_pairs


def rank_correlation(
    predicted: ArrayLike, measured: ArrayLike, *, predicted_cov: ArrayLike, measured_cov: ArrayLike, sigmas: float = 2.0
) -> RankCorrelation:
    """Return the agreement in order between a prediction and a measurement.

    Parameters
    ----------
    predicted, measured
        Shape (n,), n >= 2.
    predicted_cov, measured_cov
        Covariances, shape (n, n): common errors do not affect the order.
    sigmas
        A pair is known if it differs by more than this many standard errors, >= 0.

    Raises
    ------
    ValueError
        Shapes do not fit, or there are fewer than two numbers.

    Notes
    -----
    With up to seven numbers the p value counts all orders, at least 1/n! without ties: three numbers have the right
    order with probability 1/6, so their trend is weak evidence even with small errors. Beyond, it is that of
    `scipy.stats.kendalltau`: exact without ties, normal with them.

    References
    ----------
    Kendall, M. G. (1938), "A new measure of rank correlation", Biometrika 30, 81-93, doi:10.1093/biomet/30.1-2.81.
    """
    model, data = np.asarray(predicted, dtype=np.float64), np.asarray(measured, dtype=np.float64)
    if model.ndim != 1 or model.shape != data.shape or model.size < 2:
        raise ValueError(f"predicted {model.shape} and measured {data.shape}; allowed are two equal rows of 2 or more")
    first, second = np.triu_indices(model.size, k=1)
    steps = model[second] - model[first], data[second] - data[first]
    known = np.ones(first.size, dtype=np.bool_)
    for step, cov in zip(steps, (predicted_cov, measured_cov), strict=True):
        known &= np.abs(step) > sigmas * _step_errors(np.asarray(cov, dtype=np.float64), first, second)
    agreed = np.sign(steps[0]) * np.sign(steps[1])
    return RankCorrelation(
        numbers=int(model.size),
        pairs=int(first.size),
        known_pairs=int(known.sum()),
        concordant=int(np.sum(agreed[known] > 0.0)),
        tau=float(agreed.mean()),
        p_value=_p_value(model, data, float(agreed.sum())),
    )


def _slope(
    function: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    *,
    position: int,
    step: float,
    least: float,
) -> FloatArray:
    """Return the derivative of `function` with respect to one input."""
    below = min(step, start[position] - least)
    above = below if below > 0.0 else step
    high, low = start.copy(), start.copy()
    high[position] += above
    low[position] -= below
    return np.asarray((function(high) - function(low)) / (above + below))


# Gauss-Hermite rules for a normal input, in its standard uncertainties; the widest within the limits is used.
_RULES = (5, 3)


class _Response:
    """A function about the values of its inputs."""

    def __init__(self, function: Results, values: ArrayLike, cov: ArrayLike, least: ArrayLike, most: ArrayLike) -> None:
        self._function = function
        self._values = np.asarray(values, dtype=np.float64)
        self.cov = np.asarray(cov, dtype=np.float64)
        self._below = self._values - np.asarray(least, dtype=np.float64)
        self._above = np.asarray(most, dtype=np.float64) - self._values
        self._std = np.sqrt(np.diag(self.cov))
        self._centre = function(self._values)
        self.uncertain = [int(k) for k in np.flatnonzero(self._std > 0.0)]
        self.untested: list[int] = []
        self._bends: dict[int, FloatArray] = {}
        self.slopes = np.zeros((self._centre.size, self._values.size))
        for k in self.uncertain:
            self.slopes[:, k] = self._slope(k)

    @property
    def effects(self) -> FloatArray:
        """Change of the results by one standard uncertainty of each input."""
        return self.slopes * self._std

    def bends_more_than(self, k: int, allowed: FloatArray) -> bool:
        """Return whether the second-order part of an input's response exceeds the limit for any result."""
        # Ignore rounding of results that do not depend on the input.
        rounding = 1e-9 * np.abs(self._centre)
        return k in self._bends and bool(np.any(np.abs(self._bends[k]) > allowed + rounding))

    def groups(self, alone: Collection[int]) -> list[list[int]]:
        """Return the uncertain inputs except some, in groups of correlated ones."""
        tied = self.cov != 0.0
        tied[list(alone), :] = tied[:, list(alone)] = False
        found: list[list[int]] = []
        for k in self.uncertain:
            joined = [group for group in found if any(tied[k, other] for other in group)]
            found = [group for group in found if group not in joined]
            found.append(sorted([k, *(other for group in joined for other in group)]))
        return found

    def extras(self, group: list[int], bent: set[int]) -> list[tuple[set[int], FloatArray]]:
        """Return the contribution of a group's curved inputs, together if the limits allow it, else each alone."""
        tries = [(bent, self._extra_by_quadrature(group))] if bent else []
        if len(group) > 1 and tries and tries[0][1] is None:
            tries = [({k}, self._extra_by_quadrature([k])) for k in sorted(bent)]
        return [(inputs, extra) for inputs, extra in tries if extra is not None]

    def _extra_by_quadrature(self, group: list[int]) -> FloatArray | None:
        """Return the second moment of a response to correlated inputs less its linear part; None near limits.

        Along principal axes of their covariance the inputs are independent of one another.
        """
        variances, axes = np.linalg.eigh(self.cov[np.ix_(group, group)])
        total = np.zeros((self._centre.size, self._centre.size))
        for variance, axis in zip(variances, axes.T, strict=True):
            move = np.zeros(self._values.size)
            move[group] = np.sqrt(max(variance, 0.0)) * axis
            extra = self._extra_along(move)
            if extra is None:
                return None
            total += extra
        return total

    def _extra_along(self, move: FloatArray) -> FloatArray | None:
        """Return the second moment of the response along one axis less its linear part, by the widest possible rule."""
        for count in _RULES:
            nodes, weights = np.polynomial.hermite_e.hermegauss(count)
            reach = np.abs(move) * nodes.max()
            there = reach > 0.0
            if not np.all((reach < self._below)[there] & (reach < self._above)[there]):
                continue
            known = [one for one in (self._moved(node * move) for node in nodes) if one is not None]
            if len(known) == count:
                moment = (np.array(known).T * (weights / weights.sum())) @ np.array(known)
                effect = self.slopes @ move
                return np.asarray(moment - np.outer(effect, effect))
        return None

    def _slope(self, k: int) -> FloatArray:
        down, up = min(self._std[k], self._below[k]), min(self._std[k], self._above[k])
        high = self._off(k, up) if up > 0.0 else None
        low = self._off(k, -down) if down > 0.0 else None
        if high is not None and low is not None:
            if min(up, down) < self._std[k]:
                self.untested.append(k)
            else:
                self._bends[k] = 0.5 * (high + low)
            return np.asarray((high - low) / (up + down))
        self.untested.append(k)
        if high is not None:
            return np.asarray(high / up)
        if low is not None:
            return np.asarray(-low / down)
        raise ValueError(f"input {k} = {self._values[k]:g} may neither rise nor fall within its standard uncertainty")

    def _off(self, k: int, move: float) -> FloatArray | None:
        """Return the change of the results by a move of one input; None where they do not exist."""
        return self._moved(move * np.eye(self._values.size)[k])

    def _moved(self, move: FloatArray) -> FloatArray | None:
        try:
            return self._function(self._values + move) - self._centre
        except ValueError:
            return None


# Error of an input whose source a comparison should find, in its standard uncertainties.
MOVED = 5.0


def confusion(seen: float, alike: ArrayLike) -> FloatArray:
    """Return the probability that a correct input outranks an input that is wrong by five standard uncertainties.

    Scores g = 5 seen^1/2 + e and h = 5 alike seen^1/2 + f with standard normal e, f of correlation `alike`: h > g and
    -h > g are two half-planes.
    """
    correlation = np.clip(np.asarray(alike, dtype=np.float64), -1.0, 1.0)
    reach = MOVED * np.sqrt(seen)
    above = ndtr(-reach * np.sqrt(0.5 * (1.0 - correlation)))
    return np.asarray(above + ndtr(-reach * np.sqrt(0.5 * (1.0 + correlation))))


def _require_shapes(residual: FloatArray, noise: FloatArray, effects: FloatArray, correlation: FloatArray) -> None:
    n, k = effects.shape
    if residual.shape != (n,) or noise.shape != (n, n) or correlation.shape != (k, k):
        raise ValueError(
            f"residual {residual.shape}, measurement_cov {noise.shape} and input_correlation {correlation.shape} do "
            f"not fit effects {effects.shape}; allowed are (n,), (n, n), (k, k) and (n, k)"
        )


def _pseudo_inverse(cov: FloatArray) -> tuple[FloatArray, int]:
    """Return the pseudo-inverse of a covariance and its rank; scaled, since units differ."""
    scale = np.sqrt(np.diag(cov))
    if not np.any(scale > 0.0):
        raise ValueError("neither the measurement nor any input has an uncertainty; at least one result needs one")
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(cov / np.outer(scale, scale))
    kept = values > _RANK * values.max()
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    return inverse / np.outer(scale, scale), int(kept.sum())


# Scores of this correlation differ by less than a twentieth of their standard deviation.
_ALIKE = 0.999


def _ordered(score: FloatArray, move: FloatArray, alike: FloatArray) -> tuple[int, ...]:
    left = [int(k) for k in np.argsort(-np.abs(score), kind="stable")]
    found: list[int] = []
    while left:
        group = [k for k in left if abs(alike[left[0], k]) >= _ALIKE]
        first = min(group, key=lambda k: abs(move[k]))
        left.remove(first)
        found.append(first)
    return tuple(found)


def _step_errors(cov: FloatArray, first: NDArray[np.intp], second: NDArray[np.intp]) -> FloatArray:
    variances = np.diag(cov)
    return np.sqrt(np.maximum(variances[first] + variances[second] - 2.0 * cov[first, second], 0.0))


# All orders of up to this many numbers are counted.
_COUNTED = 7


def _p_value(model: FloatArray, data: FloatArray, total: float) -> float:
    n = model.size
    if np.ptp(model) == 0.0 or np.ptp(data) == 0.0:
        return 1.0
    if n > _COUNTED:
        from scipy.stats import kendalltau

        return float(kendalltau(model, data, alternative="greater").pvalue)
    signs = np.sign(model[:, None] - model[None, :])
    orders = np.array(list(permutations(range(n))))
    other = np.sign(data[:, None] - data[None, :])
    totals = np.array([np.sum(signs * other[np.ix_(order, order)]) for order in orders]) / 2.0
    return float(np.mean(totals >= total - 0.5))
