"""The evidence for sets of causes, and the search for the best."""

from collections.abc import Iterable, Sequence
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from model.processing.diagnosis.evidence import Evidence

FloatArray = NDArray[np.float64]

# Scores are trusted to this share of their variance: regressors have noise of their own.
_SCORE_FLOOR = 0.01
# Faults are as large as is expected of rigs, or (the tail) some times that.
_TIMES_EXPECTED = (1.0, 6.0)
# Share of a regressor's size that is left after others of the same cause, below which it is one of them.
_NOTHING_LEFT = 1e-6
# Least eigenvalue of the correlations of regressors that are fitted together: below, two would only undo one another.
_ALIKE = 0.03


class Weigher:
    """Logarithms of the evidence of sets of causes: one whitening, many sets.

    Notes
    -----
    Sizes of faults are normal with the standard deviations that are expected of rigs, or several times these, so that a
    cause more, or one that would have to be absurdly large, costs what it should. The covariance of the right side is
    itself estimated: tails are those of Student's distribution.
    """

    def __init__(self, evidence: Evidence) -> None:
        whitener = _whitener(evidence.covariance)
        measured = whitener @ evidence.right
        self._rank = len(measured)
        self._widths = np.array([cause.directions.shape[1] for cause in evidence.causes])
        self._starts = np.cumsum(self._widths) - self._widths
        expected = np.column_stack([cause.directions * cause.expected for cause in evidence.causes])
        regressors = whitener @ (evidence.information @ expected)
        self._gram = regressors.T @ regressors
        self._along = regressors.T @ measured
        self._total = float(measured @ measured)
        self._freedom = float(max(evidence.freedom, 8.0))
        self._odds = np.array([cause.log_odds for cause in evidence.causes])
        self._per_cause = -float(np.log(len(evidence.causes)))
        self._close = _collinearity(self._gram, self._starts, self._widths)

    def log_evidence(self, chosen: Sequence[int], *, is_even: bool = False) -> float:
        """Return the logarithm of the evidence of a set, up to what all sets share."""
        if not chosen:
            return -0.5 * (self._freedom + self._rank) * float(np.log1p(self._total / self._freedom))
        return float(self.of_sets(np.array([chosen], dtype=np.intp), is_even=is_even)[0])

    def of_sets(self, sets: NDArray[np.intp], *, is_even: bool = False) -> FloatArray:
        """Return the logarithms of the evidence of sets, -inf where causes are too alike.

        Parameters
        ----------
        sets
            Numbers of causes, shape (M, K), K > 0.
        is_even
            As if every cause were met equally often: what the run itself says.
        """
        heights, widths = np.full(len(sets), -np.inf), self._widths[sets]
        for kind in np.unique(widths, axis=0):
            these = np.flatnonzero(np.all(widths == kind, axis=1))
            starts = self._starts[sets[these]]
            parts = [starts[:, at, None] + np.arange(width) for at, width in enumerate(kind)]
            columns = np.concatenate(parts, axis=1)
            close = self._close[columns[:, :, None], columns[:, None, :]]
            apart = np.linalg.eigvalsh(close)[:, 0] >= _ALIKE if sets.shape[1] > 1 else np.full(len(these), True)
            heights[these[apart]] = self._of_columns(columns[apart])
        odds = 0.0 if is_even else self._odds[sets].sum(axis=1)
        return np.asarray(heights + odds + sets.shape[1] * self._per_cause)

    def with_each(self, chosen: Sequence[int], others: NDArray[np.intp]) -> FloatArray:
        """Return the logarithm of the evidence of a set with each of some causes; -inf where they are too alike."""
        return self.of_sets(_each_with(chosen, others[:, None]))

    def _of_columns(self, columns: NDArray[np.intp]) -> FloatArray:
        gram, along = self._gram[columns[:, :, None], columns[:, None, :]], self._along[columns]
        heights = [self._of_sizes(gram * times**2, along * times) for times in _TIMES_EXPECTED]
        return np.asarray(np.logaddexp.reduce(heights, axis=0) - np.log(len(heights)))

    def _of_sizes(self, gram: FloatArray, along: FloatArray) -> FloatArray:
        normal = np.eye(gram.shape[1]) + gram
        explained = np.sum(along * np.linalg.solve(normal, along[:, :, None])[:, :, 0], axis=1)
        left = np.maximum(self._total - explained, 0.0)
        misfit = (self._freedom + self._rank) * np.log1p(left / self._freedom)
        return np.asarray(-0.5 * misfit - 0.5 * np.linalg.slogdet(normal)[1])

    def correlation(self, one: int, other: int) -> float:
        """Return how far two causes do the same to a run, from 0 to 1 (the largest canonical correlation)."""
        mine, its = (slice(self._starts[at], self._starts[at] + self._widths[at]) for at in (one, other))
        return min(float(np.linalg.norm(self._close[mine, its], 2)), 1.0)


def best_set(weigher: Weigher, candidates: NDArray[np.intp], *, most: int) -> tuple[int, ...]:
    """Return the causes that explain a run best.

    Parameters
    ----------
    weigher
        Of the run.
    candidates
        Numbers of the causes that may be named.
    most
        Causes named at most.

    Notes
    -----
    A cause is added while that raises the evidence, and each is exchanged for a better one as long as there is any. All
    pairs are tried against a single cause that does not stand alone, and against nothing: faults of frames that stand
    close to one another can hide each other.
    """
    chosen: tuple[int, ...] = ()
    best = weigher.log_evidence(chosen)
    while len(chosen) < most:
        larger, value = _grown(weigher, candidates, chosen)
        if len(larger) == 2 or (len(larger) == 1 < len(candidates) and value <= best):
            larger, value = max([(larger, value), _best_pair(weigher, candidates)], key=lambda found: found[1])
        larger, value = _exchanged(weigher, candidates, larger, value)
        if value <= best:
            break
        chosen, best = larger, value
    return chosen


def larger_set(weigher: Weigher, candidates: NDArray[np.intp], chosen: tuple[int, ...]) -> tuple[int, ...]:
    """Return the best set of one cause more, all pairs tried against a single cause; as given where there is none."""
    larger, value = _grown(weigher, candidates, chosen)
    if len(larger) == 2 and len(candidates) > 1:
        larger, value = max([(larger, value), _best_pair(weigher, candidates)], key=lambda found: found[1])
    return larger if np.isfinite(value) else chosen


def _grown(weigher: Weigher, candidates: NDArray[np.intp], chosen: tuple[int, ...]) -> tuple[tuple[int, ...], float]:
    others = np.setdiff1d(candidates, chosen)
    if not others.size:
        return chosen, -np.inf
    heights = weigher.with_each(chosen, others)
    top = int(np.argmax(heights))
    return (*chosen, int(others[top])), float(heights[top])


def _best_pair(weigher: Weigher, candidates: NDArray[np.intp]) -> tuple[tuple[int, ...], float]:
    pairs = _pairs(candidates)
    heights = weigher.of_sets(pairs)
    top = int(np.argmax(heights))
    return (int(pairs[top, 0]), int(pairs[top, 1])), float(heights[top])


def _exchanged(
    weigher: Weigher, candidates: NDArray[np.intp], chosen: tuple[int, ...], value: float
) -> tuple[tuple[int, ...], float]:
    for _ in range(3 * len(chosen)):
        sets = [
            _grown(weigher, np.setdiff1d(candidates, chosen), chosen[:at] + chosen[at + 1 :])
            for at in range(len(chosen))
        ]
        better, height = max(sets, key=lambda found: found[1])
        if height <= value + 1e-6:
            break
        chosen, value = better, height
    return chosen, value


def stand_ins(
    weigher: Weigher, named: tuple[int, ...], candidates: NDArray[np.intp], *, margin: float
) -> dict[int, set[int]]:
    """Return, for each cause of a set, those that could stand in its place, alone or with others.

    Parameters
    ----------
    weigher
        Of the run.
    named
        The set.
    candidates
        Numbers of the causes that may be named.
    margin
        Loss of evidence (natural logarithm) at which a set could be the right one.

    Notes
    -----
    One or two of the set are exchanged for one or two others; of two for two, each stands in for what it is most like.
    """
    found: dict[int, set[int]] = {index: set() for index in named}
    others = np.setdiff1d(candidates, named)
    if not others.size:
        return found
    least = weigher.log_evidence(named, is_even=True) - margin
    added = (others[:, None], _pairs(others))
    taken = [(1, added[0]), (2, added[0]), (2, added[1]), *([(1, added[1])] if len(named) == 1 else [])]
    for count, sets in taken:
        for leaving in combinations(named, count):
            staying = tuple(index for index in named if index not in leaving)
            alike = sets[weigher.of_sets(_each_with(staying, sets), is_even=True) > least] if sets.size else sets
            for arriving in alike.tolist():
                for index, other in _in_place_of(weigher, leaving, tuple(arriving)):
                    found[index].add(other)
    return found


def _in_place_of(weigher: Weigher, leaving: tuple[int, ...], arriving: tuple[int, ...]) -> Iterable[tuple[int, int]]:
    if len(leaving) != len(arriving):
        return product(leaving, arriving)
    ways = (tuple(zip(leaving, order, strict=True)) for order in permutations(arriving))
    return max(ways, key=lambda way: sum(weigher.correlation(*pair) for pair in way))


def _pairs(numbers: NDArray[np.intp]) -> NDArray[np.intp]:
    first, second = np.triu_indices(len(numbers), 1)
    return np.column_stack([numbers[first], numbers[second]])


def _each_with(chosen: Sequence[int], others: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return a set with each of some others, shape (M, K)."""
    same = np.tile(np.array(chosen, dtype=np.intp), (len(others), 1))
    return np.hstack([same, others])


def _collinearity(gram: FloatArray, starts: NDArray[np.intp], widths: NDArray[np.intp]) -> FloatArray:
    """Return the correlations of the regressors of all causes, those of one cause made independent."""
    scaled = np.zeros_like(gram)
    for start, width in zip(starts, widths, strict=True):
        own = slice(start, start + width)
        values, vectors = np.linalg.eigh(gram[own, own])
        kept = values > _NOTHING_LEFT * max(float(values[-1]), 0.0)
        scaled[own, own] = (vectors[:, kept] / np.sqrt(values[kept])) @ vectors[:, kept].T
    return np.asarray(scaled @ gram @ scaled)


def _whitener(covariance: FloatArray) -> FloatArray:
    size = np.sqrt(np.diag(covariance))
    size = np.where(size > 0.0, size, np.inf)
    held = np.isfinite(size)
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size) + _SCORE_FLOOR * np.diag(held))
    kept = values > 0.5 * _SCORE_FLOOR
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T / size)
