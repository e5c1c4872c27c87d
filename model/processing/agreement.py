"""Agreement of prediction and measurement: scores, propagation and update of inputs, trends.

Uncertain inputs reach a prediction by slopes, or by quadrature where its response is curved (`propagate`). What is
measured updates them (`update_inputs`), which also says how well the data tell one input from another. Many scores
are judged together by Holm's rule; trends are tested by a weighted line and by the correlation of ranks.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.numerics import gammaincc, ndtr

FloatArray = NDArray[np.float64]


def two_sided_p_value(z: ArrayLike) -> FloatArray:
    """Return the chance that a standard normal number is at least as far from 0 as `z`.

    Parameters
    ----------
    z
        Standard scores, any shape.
    """
    return np.asarray(2.0 * ndtr(-np.abs(np.asarray(z, dtype=np.float64))))


def holm_rejections(p_values: ArrayLike, *, alpha: float) -> NDArray[np.bool_]:
    """Return which hypotheses are rejected so that any false rejection at all has a chance of at most `alpha`.

    Parameters
    ----------
    p_values
        Shape (n,), each in [0, 1]; they may depend on each other in any way.
    alpha
        Chance of one or more false rejections, in (0, 1).

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
        raise ValueError(f"alpha is {alpha}; it has to lie between 0 and 1")
    if p.ndim != 1 or not np.all((p >= 0.0) & (p <= 1.0)):
        raise ValueError("p_values has to be one row of numbers from 0 to 1")
    order = np.argsort(p, kind="stable")
    passed = p[order] > alpha / np.arange(p.size, 0, -1)
    first_kept = int(np.argmax(passed)) if passed.any() else p.size
    rejected = np.zeros(p.size, dtype=np.bool_)
    rejected[order[:first_kept]] = True
    return rejected


def input_jacobian(
    function: Callable[[FloatArray], FloatArray], values: ArrayLike, deviations: ArrayLike, *, least: Sequence[float]
) -> FloatArray:
    """Return the derivatives of a function's results by its inputs, each taken over one standard uncertainty.

    Parameters
    ----------
    function
        Takes inputs, shape (k,), and returns results, shape (m,).
    values
        Where the inputs stand, shape (k,).
    deviations
        Standard uncertainty of each input, shape (k,); an input with 0 has the derivative 0.
    least
        Smallest value each input may take, for instance 0; -inf where there is none.

    Returns
    -------
    array of float64, shape (m, k)
        By central differences over one standard uncertainty to either side (less where `least` is near; to one side
        where an input stands on it).

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
    """Covariance of results by uncertain inputs.

    Attributes
    ----------
    effects
        Change of each result by one standard uncertainty of each input alone, shape (m, k).
    cov
        Covariance of the results about the results at the inputs' values, shape (m, m).
    curved
        Inputs, by position, whose response was found curved and taken by quadrature.
    limited
        Inputs whose response is curved, or not testable, but stands so near to a limit that slopes had to do.
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
    """Return the effect of each uncertain input on a function's results, and the covariance that all of them make.

    Parameters
    ----------
    function
        Takes inputs, shape (k,), and returns results, shape (m,); raises ValueError where inputs do not go together.
    values
        Where the inputs stand, shape (k,); there the results exist.
    cov
        Covariance of the inputs, shape (k, k); an input with variance 0 is exact.
    least, most
        Smallest and largest value that each input may take, shape (k,); infinite where there is none.
    fitted
        Inputs, by position, that were fitted to make up for others. What they make up for cancels at any distance, as
        their covariance, which is of first order, does not say: bends are seen of each of them alone.
    curvature_tolerance
        Share of a result's first-order standard uncertainty that the bend of one input's response may have, >= 0.
        With 0.1, what is neglected changes a standard uncertainty by at most 1 %.

    Raises
    ------
    ValueError
        The results exist on neither side of an input.

    Notes
    -----
    Slopes are central differences over one standard uncertainty. A curved input adds, to J cov J', the second moment of
    its own response by Gauss-Hermite quadrature less what its slope says of it: the bend's shift of the mean is in the
    covariance, since the results stay where they are. Inputs that are correlated with one another are moved together,
    along the principal axes of their covariance, once one of them is curved; how two axes bend together is not seen,
    nor how two independent inputs do. Where the results do not exist on one side of an input, the slope to the
    other side has to do, as beside a limit.

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


# Chance, at most, that some other input outranks the one that is to blame.
_CONFUSION = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class InputUpdate:
    """Update of k inputs, of each alone and of all together, by n residuals.

    Attributes
    ----------
    chi_square, degrees_of_freedom
        Residuals in the covariance of measurement and inputs together; their rank.
    score
        By input: how much better the residuals fit when that input is freed, as the root of the fall in chi-square with
        the sign of the move, shape (k,). Standard normal where model, measurement and uncertainties are right.
    move
        By input: how far it would have to move, in its own standard uncertainties, to remove what it can of the
        residuals, shape (k,); 0 where the data do not see it.
    chi_square_left
        By input: what is left of chi-square after that move, shape (k,).
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
        """Chance of residuals at least this large if everything stated is right."""
        return chi_square_tail(self.chi_square, self.degrees_of_freedom)

    def confused_with(self, position: int) -> tuple[int, ...]:
        """Return the inputs that the data cannot tell from one that is off by five standard uncertainties.

        They are the fewest whose absence brings the chance that any other outranks it to 5 % or below, by the sum of
        the pairwise chances.
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
    """Return how far each input would have to move to explain residuals, and an update of all of them.

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
        Inputs in the order of their scores; of those that act alike, the one that has to move least is first.

    Raises
    ------
    ValueError
        Shapes do not fit, or the covariances are all zero.

    Notes
    -----
    With u the inputs in standard uncertainties from their values, correlation R and effects A, residuals have the
    covariance V = C + A R A'. A single input moves along a = A R e_j: those that are correlated with it follow. Its
    score a'V^-1 r / (a'V^-1 a)^1/2 and move a'V^-1 r / (a'V^-1 a) are the generalised least squares of the residuals on
    a. The joint update is the Bayesian linear one: mean R A'V^-1 r, covariance R - R A'V^-1 A R; it is a fit, pulled to
    what was stated.

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
    """Return the chance that chi-square is at least as large; 1 without a degree of freedom.

    Parameters
    ----------
    chi_square
        Sum of squares, >= 0 but for rounding.
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
        Of what the line leaves.
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
        raise ValueError("a drift needs three numbers or more at different places, each with an error above 0")
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
    """Kendall's tau of a prediction and a measurement over the pairs whose order is known.

    Attributes
    ----------
    numbers
        How many numbers were ordered.
    pairs, known_pairs
        Pairs of them, and those that differ by more than their error on both sides.
    concordant
        Known pairs that are in the same order on both sides.
    tau
        Of all pairs, errors aside: (concordant - discordant) / pairs; a pair that is equal on a side is neither.
    p_value
        Chance of so large a tau, one-sided, if both orders had nothing to do with each other.
    """

    numbers: int
    pairs: int
    known_pairs: int
    concordant: int
    tau: float
    p_value: float

    @property
    def share_concordant(self) -> float | None:
        """Share of the known pairs that are in the same order; None where none is known."""
        return None if self.known_pairs == 0 else self.concordant / self.known_pairs


def rank_correlation(
    predicted: ArrayLike, measured: ArrayLike, *, predicted_cov: ArrayLike, measured_cov: ArrayLike, sigmas: float = 2.0
) -> RankCorrelation:
    """Return how well a prediction has the order of what was measured.

    Parameters
    ----------
    predicted, measured
        Shape (n,), n >= 2.
    predicted_cov, measured_cov
        Covariances, shape (n, n): what is common to two numbers does not blur their order.
    sigmas
        A pair is known on a side where it differs by more than so many standard errors of its difference, >= 0.

    Raises
    ------
    ValueError
        Shapes do not fit, or there are fewer than two numbers.

    Notes
    -----
    With up to seven numbers the p value counts all orders, without ties 1/n! at the least: three numbers in order have
    the chance 1/6, so "the trend" of three is weak evidence however small their errors are. Beyond, it is that of
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
    """Return the derivative of `function` by one input."""
    below = min(step, start[position] - least)
    above = below if below > 0.0 else step
    high, low = start.copy(), start.copy()
    high[position] += above
    low[position] -= below
    return np.asarray((function(high) - function(low)) / (above + below))


# Gauss-Hermite rules for a normal input, in its standard uncertainties; the widest that the limits allow is taken.
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
        """Return whether the second-order part of an input's response is above what is allowed, for any result."""
        # Rounding of results that do not depend on the input at all is no bend.
        rounding = 1e-9 * np.abs(self._centre)
        return k in self._bends and bool(np.any(np.abs(self._bends[k]) > allowed + rounding))

    def groups(self, alone: Collection[int]) -> list[list[int]]:
        """Return the uncertain inputs, those that are correlated with one another together, but for some."""
        tied = self.cov != 0.0
        tied[list(alone), :] = tied[:, list(alone)] = False
        found: list[list[int]] = []
        for k in self.uncertain:
            joined = [group for group in found if any(tied[k, other] for other in group)]
            found = [group for group in found if group not in joined]
            found.append(sorted([k, *(other for group in joined for other in group)]))
        return found

    def extras(self, group: list[int], bent: set[int]) -> list[tuple[set[int], FloatArray]]:
        """Return what the bent inputs of a group add, together where there is room for that, else each alone."""
        tries = [(bent, self._extra_by_quadrature(group))] if bent else []
        if len(group) > 1 and tries and tries[0][1] is None:
            tries = [({k}, self._extra_by_quadrature([k])) for k in sorted(bent)]
        return [(inputs, extra) for inputs, extra in tries if extra is not None]

    def _extra_by_quadrature(self, group: list[int]) -> FloatArray | None:
        """Return the second moment of what correlated inputs do less its linear part; None where limits are too near.

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
        """Return the second moment of the response along one axis less its linear part, by the widest rule there is."""
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


# An error of an input that a comparison has to find the source of, in standard uncertainties of that input.
MOVED = 5.0


def confusion(seen: float, alike: ArrayLike) -> FloatArray:
    """Return the chance that another input outranks one that is off by five of its standard uncertainties.

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
    """Return the inverse in the space that a covariance fills, and its rank; scaled, since units differ."""
    scale = np.sqrt(np.diag(cov))
    if not np.any(scale > 0.0):
        raise ValueError("neither the measurement nor any input has an uncertainty; at least one result needs one")
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(cov / np.outer(scale, scale))
    kept = values > _RANK * values.max()
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    return inverse / np.outer(scale, scale), int(kept.sum())


# Scores that go together like this differ by less than a twentieth of their standard deviation.
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


# All orders of so many numbers are counted, ties or not.
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
