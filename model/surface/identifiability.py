"""Identifiability of parameters by a set of observations, in numbers and in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# A combination known no better than this share of its range is not known.
_VAGUE = 0.25
# Two parameters above this correlation are told apart badly.
_STRONG_CORRELATION = 0.95
# Shares of a vague combination that are worth a word, and of one that is not determined at all.
_NOTABLE = 0.2
_LOST = 1e-3
# Below this of the largest singular value a direction is nothing but rounding and difference quotients.
_RANK = 1e-7


@dataclass(frozen=True, kw_only=True, eq=False)
class Information:
    """First-order uncertainty of parameters.

    Parameters
    ----------
    standard_uncertainty
        Shape (P,); inf for a parameter on which some combination of observations leaves no hold at all.
    correlation
        Shape (P, P); between determined parameters, 0 elsewhere off the diagonal.
    singular_values
        Of the whitened derivatives by parameters in units of their range, descending, shape (P,): a combination
        with singular value s is known to 1 / s of the range.
    words
        What cannot be told apart; empty if all can.
    """

    standard_uncertainty: FloatArray
    correlation: FloatArray
    singular_values: FloatArray
    words: tuple[str, ...]


def information(jacobian: FloatArray, *, names: Sequence[str], ranges: FloatArray) -> Information:
    """Return what whitened derivatives say about the parameters.

    Parameters
    ----------
    jacobian
        Derivatives of residuals of unit variance by the parameters, shape (M, P).
    names
        Of the parameters.
    ranges
        Width of the range within which each was looked for, shape (P,), > 0.

    Returns
    -------
    Information
        Gauss-Newton uncertainties and words.

    References
    ----------
    Definition: inverse of J' J by singular values.
    """
    parameters = len(names)
    padded = np.vstack([jacobian * ranges, np.zeros((parameters, parameters))])
    _, singular, directions = np.linalg.svd(padded, full_matrices=False)
    held = singular > _RANK * max(float(singular[0]), np.finfo(float).tiny)
    lost = np.any(np.abs(directions[~held]) > _LOST, axis=0)
    root = directions[held] / singular[held, None]
    covariance = root.T @ root
    scaled = np.sqrt(np.diag(covariance))
    divisor = np.where(lost | (scaled == 0.0), np.inf, scaled)
    correlation = covariance / np.outer(divisor, divisor)
    np.fill_diagonal(correlation, 1.0)
    return Information(
        standard_uncertainty=np.where(lost, np.inf, scaled * ranges),
        correlation=correlation,
        singular_values=singular,
        words=(*_vague_words(singular, directions, held, names), *_correlation_words(correlation, names)),
    )


def _vague_words(
    singular: FloatArray, directions: FloatArray, held: NDArray[np.bool_], names: Sequence[str]
) -> list[str]:
    words = []
    for value, direction, hold in zip(singular, directions, held, strict=True):
        if value * _VAGUE >= 1.0:
            continue
        least = _NOTABLE if hold else _LOST
        parts = [name for name, share in zip(names, direction, strict=True) if abs(share) > least]
        subject = parts[0] if len(parts) == 1 else "a combination of " + " and ".join(parts)
        known = f"only to {100.0 / value:.0f} % of its range" if hold else "not at all"
        words.append(
            f"the observations determine {subject} {known}: hold {' or '.join(parts)} fixed, or add geometries "
            "(the lobe's flank, another angle of incidence, a direction away from the glint)"
        )
    return words


def _correlation_words(correlation: FloatArray, names: Sequence[str]) -> list[str]:
    return [
        f"{names[i]} and {names[j]} are told apart badly (correlation {correlation[i, j]:+.3f}): their errors "
        "compensate, only a combination of the two is known well"
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) > _STRONG_CORRELATION
    ]
