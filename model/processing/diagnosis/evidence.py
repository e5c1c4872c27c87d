"""What a run says of all faults at once: sizes of some with their errors, and how sure each is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.processing.diagnosis.causes import SHARED, Cause
from model.processing.diagnosis.correction import can_be_undone
from model.special_functions import fdtrc

FloatArray = NDArray[np.float64]

# Errors of a fault that are this much larger than any rig's faults tell nothing.
_USELESS = 4.0
# Curvature, or exponent less 1, of a response whose counts are not light.
_BENT = 0.1
# Share of a regressor's size that is left after others, below which it is one of them.
_NOTHING_LEFT = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """What a run says of all faults: right side b = A x + noise.

    Attributes
    ----------
    causes
        All that are looked for.
    information, covariance : (P, P) array
        A, and the covariance of b.
    right : (P,) array
        b about no faults.
    freedom
        Number of independent parts that the covariance was made from.
    """

    causes: tuple[Cause, ...]
    information: FloatArray
    covariance: FloatArray
    right: FloatArray
    freedom: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimates:
    """Sizes of the faults of a set, together.

    Attributes
    ----------
    values : (Q,) array
        In the order of the causes; a shift has two.
    covariance : (Q, Q) array
        Of them.
    parts
        Which values are each cause's.
    is_determined
        False where the regressors of the set are not independent.
    """

    values: FloatArray
    covariance: FloatArray
    parts: tuple[slice, ...]
    is_determined: bool

    def size_of(self, which: int) -> tuple[float, float]:
        """Return a number with its error, or the length of a vector with the error along it."""
        part = self.parts[which]
        values, covariance = self.values[part], self.covariance[part, part]
        if len(values) == 1:
            return float(values[0]), _root(covariance[0, 0])
        length = float(np.linalg.norm(values))
        if not length > 0.0:
            return length, _root(np.max(np.diag(covariance)))
        along = values / length
        return length, _root(float(along @ covariance @ along))


def estimates(evidence: Evidence, chosen: Sequence[int]) -> Estimates:
    """Return the sizes of some causes, fitted together, the others being nothing.

    Parameters
    ----------
    evidence
        Of the run.
    chosen
        Numbers of causes.
    """
    directions, parts = _stacked(evidence.causes, chosen)
    normal = directions.T @ evidence.information @ directions
    size = np.sqrt(np.abs(np.diag(normal)))
    if not np.all(size > 0.0) or np.linalg.svd(normal / np.outer(size, size), compute_uv=False)[-1] < _NOTHING_LEFT:
        return _undetermined(directions.shape[1], parts)
    inverse = np.linalg.inv(normal / np.outer(size, size)) / np.outer(size, size)
    found = inverse @ (directions.T @ evidence.right)
    spread = inverse @ (directions.T @ evidence.covariance @ directions) @ inverse.T
    return Estimates(values=found, covariance=spread, parts=parts, is_determined=True)


def significances(evidence: Evidence, chosen: tuple[int, ...]) -> list[float]:
    """Return the chance of each estimate of a set, so far from nothing, were there nothing; 1 if hardly determined."""
    fitted = estimates(evidence, chosen)
    freedom = max(evidence.freedom - len(fitted.values) - 1, 1)
    return [
        float(fdtrc(part.stop - part.start, freedom, _statistic(fitted, which)))
        if is_useful(evidence.causes[index], fitted.size_of(which)[1])
        else 1.0
        for which, (index, part) in enumerate(zip(chosen, fitted.parts, strict=True))
    ]


def is_useful(cause: Cause, error: float) -> bool:
    """Return whether the error of a fault is below what tells nothing."""
    return error < _USELESS * float(cause.expected.max())


def _root(variance: float) -> float:
    """Return a standard error; infinite where rounding left no variance of a fault that is hardly there."""
    return float(np.sqrt(variance)) if variance >= 0.0 else np.inf


def _statistic(fitted: Estimates, which: int) -> float:
    """Return the square of an estimate in its errors, by its dimension."""
    part = fitted.parts[which]
    value, spread = fitted.values[part], fitted.covariance[part, part]
    if not fitted.is_determined or np.linalg.eigvalsh(spread)[0] <= 0.0:
        return 0.0
    return float(value @ np.linalg.solve(spread, value)) / len(value)


def by_size(evidence: Evidence, chosen: tuple[int, ...]) -> tuple[int, ...]:
    """Return the causes by how many of its errors each is off, the most first.

    Notes
    -----
    What is too large to be undone comes first, then a response far off a line, for all others were measured in counts
    that are not light; what is no fault comes last.
    """
    if not chosen:
        return ()
    fitted = estimates(evidence, chosen)

    def rank(at: int) -> tuple[bool, bool, bool, float]:
        cause = evidence.causes[chosen[at]]
        made = cause.directions @ fitted.values[fitted.parts[at]]
        is_bent = cause.name in SHARED and abs(fitted.size_of(at)[0]) > _BENT
        return not cause.is_fault, can_be_undone(made), not is_bent, -_statistic(fitted, at)

    return tuple(chosen[at] for at in sorted(range(len(chosen)), key=rank))


def _stacked(causes: Sequence[Cause], chosen: Sequence[int]) -> tuple[FloatArray, tuple[slice, ...]]:
    widths = [causes[index].directions.shape[1] for index in chosen]
    ends = np.cumsum(widths)
    parts = tuple(slice(int(end - width), int(end)) for end, width in zip(ends, widths, strict=True))
    return np.column_stack([causes[index].directions for index in chosen]), parts


def _undetermined(count: int, parts: tuple[slice, ...]) -> Estimates:
    return Estimates(
        values=np.zeros(count), covariance=np.full((count, count), np.inf), parts=parts, is_determined=False
    )
