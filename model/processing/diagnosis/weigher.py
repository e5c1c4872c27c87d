"""The evidence for sets of causes, and the search for the best."""

from collections.abc import Sequence

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
        widths = [cause.directions.shape[1] for cause in evidence.causes]
        ends = np.cumsum(widths)
        self._columns = [np.arange(end - width, end) for end, width in zip(ends, widths, strict=True)]
        self._widths = np.array(widths)
        expected = np.column_stack([cause.directions * cause.expected for cause in evidence.causes])
        regressors = whitener @ (evidence.information @ expected)
        self._gram = regressors.T @ regressors
        self._along = regressors.T @ measured
        self._total = float(measured @ measured)
        self._freedom = float(max(evidence.freedom, 8.0))
        self._odds = np.array([cause.log_odds for cause in evidence.causes]) - np.log(len(evidence.causes))
        self._close = _collinearity(evidence, self._columns)

    def log_evidence(self, chosen: Sequence[int]) -> float:
        """Return the logarithm of the evidence of a set, up to what all sets share."""
        if not chosen:
            return -0.5 * (self._freedom + self._rank) * float(np.log1p(self._total / self._freedom))
        return float(self.with_each(chosen[:-1], np.array([chosen[-1]]))[0])

    def with_each(self, chosen: Sequence[int], others: NDArray[np.intp]) -> FloatArray:
        """Return the logarithm of the evidence of a set with each of some causes; -inf where they are too alike."""
        heights = np.empty(len(others))
        base = np.concatenate([np.empty(0, dtype=np.intp), *(self._columns[index] for index in chosen)]).astype(np.intp)
        for width in np.unique(self._widths[others]):
            these = np.flatnonzero(self._widths[others] == width)
            columns = np.array([np.concatenate([base, self._columns[others[at]]]) for at in these])
            heights[these] = self._of_columns(columns)
        heights += self._odds[others] + sum(self._odds[index] for index in chosen)
        heights[self._too_alike(chosen, others)] = -np.inf
        return heights

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

    def _too_alike(self, chosen: Sequence[int], others: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which of the others would make a set of regressors that are nearly sums of one another."""
        alike = np.zeros(len(others), dtype=np.bool_)
        if not chosen:
            return alike
        base = np.concatenate([self._columns[index] for index in chosen])
        for width in np.unique(self._widths[others]):
            these = np.flatnonzero(self._widths[others] == width)
            columns = np.array([np.concatenate([base, self._columns[others[at]]]) for at in these])
            least = np.linalg.eigvalsh(self._close[columns[:, :, None], columns[:, None, :]])[:, 0]
            alike[these] = least < _ALIKE
        return alike

    def in_place_of(
        self, chosen: tuple[int, ...], index: int, candidates: NDArray[np.intp], *, margin: float
    ) -> list[int]:
        """Return the causes that could stand in the place of one of a set, at a loss of evidence below a margin."""
        rest = tuple(other for other in chosen if other != index)
        others = np.setdiff1d(candidates, chosen)
        heights = self.with_each(rest, others) if others.size else np.empty(0)
        return [int(other) for other in others[heights > self.log_evidence((*rest, index)) - margin]]

    def correlation(self, one: int, other: int) -> float:
        """Return how far two causes do the same to a run, from 0 to 1 (the largest canonical correlation)."""
        mine, its = self._columns[one], self._columns[other]
        own, cross = self._gram[np.ix_(mine, mine)], self._gram[np.ix_(mine, its)]
        second = self._gram[np.ix_(its, its)]
        if not (np.all(np.diag(own) > 0.0) and np.all(np.diag(second) > 0.0)):
            return 0.0
        share = np.linalg.pinv(own) @ cross @ np.linalg.pinv(second) @ cross.T
        return float(np.sqrt(np.clip(np.max(np.linalg.eigvals(share).real), 0.0, 1.0)))


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
    pairs are tried against a single cause that does not stand alone.
    """
    chosen: tuple[int, ...] = ()
    best = weigher.log_evidence(chosen)
    while len(chosen) < most:
        larger, value = _grown(weigher, candidates, chosen)
        if len(larger) == 2:
            larger, value = max([(larger, value), _best_pair(weigher, candidates)], key=lambda found: found[1])
        larger, value = _exchanged(weigher, candidates, larger, value)
        if value <= best:
            break
        chosen, best = larger, value
    return chosen


def _grown(weigher: Weigher, candidates: NDArray[np.intp], chosen: tuple[int, ...]) -> tuple[tuple[int, ...], float]:
    others = np.setdiff1d(candidates, chosen)
    if not others.size:
        return chosen, -np.inf
    heights = weigher.with_each(chosen, others)
    top = int(np.argmax(heights))
    return (*chosen, int(others[top])), float(heights[top])


def _best_pair(weigher: Weigher, candidates: NDArray[np.intp]) -> tuple[tuple[int, ...], float]:
    pairs = (_grown(weigher, candidates[at + 1 :], (int(index),)) for at, index in enumerate(candidates[:-1]))
    return max(pairs, key=lambda found: found[1])


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


def _collinearity(evidence: Evidence, columns: Sequence[NDArray[np.intp]]) -> FloatArray:
    """Return the correlations of the regressors of all causes, those of one cause made independent."""
    stacked = np.column_stack([cause.directions for cause in evidence.causes])
    whole = stacked.T @ evidence.information @ stacked
    normal = 0.5 * (whole + whole.T)
    scaled = np.zeros_like(normal)
    for own in columns:
        values, vectors = np.linalg.eigh(normal[np.ix_(own, own)])
        kept = values > _NOTHING_LEFT * max(float(values[-1]), 0.0)
        root = (
            (vectors[:, kept] / np.sqrt(values[kept])) @ vectors[:, kept].T if kept.any() else np.zeros((len(own),) * 2)
        )
        scaled[np.ix_(own, own)] = root
    return np.asarray(scaled @ normal @ scaled)


def _whitener(covariance: FloatArray) -> FloatArray:
    size = np.sqrt(np.diag(covariance))
    size = np.where(size > 0.0, size, np.inf)
    held = np.isfinite(size)
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size) + _SCORE_FLOOR * np.diag(held))
    kept = values > 0.5 * _SCORE_FLOOR
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T / size)
