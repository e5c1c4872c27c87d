"""Propagation of uncertain inputs to the covariance of results: by slopes, or by quadrature where curved."""

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
Results = Callable[[FloatArray], FloatArray]

# Gauss-Hermite rules for a normal input, in its standard uncertainties; the widest that the limits allow is taken.
_RULES = (5, 3)


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
