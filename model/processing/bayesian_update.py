"""Bayesian update of the inputs of a prediction by what was measured, and how well the data tell them apart."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.special_functions import gammaincc, ndtr

FloatArray = NDArray[np.float64]

# An error of an input that a comparison has to find the source of, in standard uncertainties of that input.
MOVED = 5.0
# Chance, at most, that some other input outranks the one that is to blame.
_CONFUSION = 0.05
# Relative eigenvalues of a covariance below this are rounding.
_RANK = 1e-12
# Scores that go together like this differ by less than a twentieth of their standard deviation.
_ALIKE = 0.999


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


def confusion(seen: float, alike: ArrayLike) -> FloatArray:
    """Return the chance that another input outranks one that is off by five of its standard uncertainties.

    Parameters
    ----------
    seen
        Share of its variance that the data resolve, 0 to 1.
    alike
        Correlation of its score with that of each other input, any shape.

    Notes
    -----
    Scores g = 5 seen^1/2 + e and h = 5 alike seen^1/2 + f with standard normal e, f of correlation `alike`: h > g and
    -h > g are two half-planes.
    """
    correlation = np.clip(np.asarray(alike, dtype=np.float64), -1.0, 1.0)
    reach = MOVED * np.sqrt(seen)
    above = ndtr(-reach * np.sqrt(0.5 * (1.0 - correlation)))
    return np.asarray(above + ndtr(-reach * np.sqrt(0.5 * (1.0 + correlation))))


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


def _ordered(score: FloatArray, move: FloatArray, alike: FloatArray) -> tuple[int, ...]:
    left = [int(k) for k in np.argsort(-np.abs(score), kind="stable")]
    found: list[int] = []
    while left:
        group = [k for k in left if abs(alike[left[0], k]) >= _ALIKE]
        first = min(group, key=lambda k: abs(move[k]))
        left.remove(first)
        found.append(first)
    return tuple(found)


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


def _require_shapes(residual: FloatArray, noise: FloatArray, effects: FloatArray, correlation: FloatArray) -> None:
    n, k = effects.shape
    if residual.shape != (n,) or noise.shape != (n, n) or correlation.shape != (k, k):
        raise ValueError(
            f"residual {residual.shape}, measurement_cov {noise.shape} and input_correlation {correlation.shape} do "
            f"not fit effects {effects.shape}; allowed are (n,), (n, n), (k, k) and (n, k)"
        )
