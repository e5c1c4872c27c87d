"""How much each uncertain input matters to each number: Sobol's indices or Morris' elementary effects."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import sobol_indices

from rigctl.study.case_list import unit_draws
from rigctl.study.study_arrays import StudyArrays

FloatArray = NDArray[np.float64]

_LEVEL, _RESAMPLES = 0.95, 200
_VARIES = 1e-12


@dataclass(frozen=True, kw_only=True)
class Number:
    """A number of a study: QUANTITY_STATISTIC of a region of a scene."""

    scene: str
    region: str
    quantity: str


@dataclass(frozen=True, kw_only=True)
class SobolIndex:
    """Shares of a number's variance that one input makes.

    Attributes
    ----------
    number : Number
        The number.
    input : str
        Key of the input.
    first, total : float
        By this input alone, and with all that it makes together with others; NaN where `reason` says why.
    first_low, first_high, total_low, total_high : float
        95 % limits by bootstrap.
    reason : str
        Why there is none; empty where there is.
    """

    number: Number
    input: str
    first: float
    first_low: float
    first_high: float
    total: float
    total_low: float
    total_high: float
    reason: str


@dataclass(frozen=True, kw_only=True)
class MorrisEffect:
    """What steps of one input through half of its law do to a number.

    Attributes
    ----------
    number : Number
        The number.
    input : str
        Key of the input.
    mean, mean_error : float
        Mean of the effects and its standard error, in the number's unit.
    mean_size : float
        Mean of their sizes: 0 for an input that does not matter.
    deviation : float
        Of the effects: 0 where the number is linear in this input and no other changes that.
    reason : str
        Why there are none; empty where there are.
    """

    number: Number
    input: str
    mean: float
    mean_error: float
    mean_size: float
    deviation: float
    reason: str


def numbers_of(
    arrays: StudyArrays, scenes: Sequence[str], columns: Sequence[str]
) -> Iterator[tuple[Number, FloatArray]]:
    """Yield every number of every scene with its values over that scene's cases."""
    of_scene = len(arrays.values) // len(scenes)
    for k, scene in enumerate(scenes):
        values = arrays.values[k * of_scene : (k + 1) * of_scene]
        for r, region in enumerate(arrays.regions):
            for q, quantity in enumerate(columns):
                if not np.all(np.isnan(values[:, r, q])):
                    yield Number(scene=scene, region=region, quantity=quantity), values[:, r, q]


def sobol_of(number: Number, values: FloatArray, inputs: Sequence[str]) -> tuple[SobolIndex, ...]:
    """Return the indices of a number to each input.

    Parameters
    ----------
    number : Number
        Whose.
    values : (n (d + 2),) array
        In the order of `case_list.unit_draws`.
    inputs : sequence of str
        The d keys.

    References
    ----------
    Saltelli et al., Comput. Phys. Commun. 181 (2010) 259, doi:10.1016/j.cpc.2009.09.018, as scipy has it.
    """
    reason = _why_none(values)
    if reason:
        gone = dict.fromkeys(("first", "first_low", "first_high", "total", "total_low", "total_high"), math.nan)
        return tuple(SobolIndex(number=number, input=key, reason=reason, **gone) for key in inputs)
    blocks = values.reshape(len(inputs) + 2, 1, -1)
    # Of an input that changes nothing the indices are 0, without limits that could be found by drawing.
    acting = [k for k in range(len(inputs)) if np.any(blocks[2 + k] != blocks[0])]
    found = sobol_indices(
        func={"f_A": blocks[0], "f_B": blocks[1], "f_AB": blocks[2:][acting]},
        n=blocks.shape[-1],
        rng=np.random.default_rng(1),
    )
    spread = found.bootstrap(confidence_level=_LEVEL, n_resamples=_RESAMPLES)
    indices = np.zeros((len(inputs), 2, 3))
    for j, (one, limits) in enumerate(
        (
            (found.first_order, spread.first_order.confidence_interval),
            (found.total_order, spread.total_order.confidence_interval),
        )
    ):
        indices[acting, j] = np.stack([np.ravel(one), np.ravel(limits.low), np.ravel(limits.high)], axis=1)
    return tuple(_sobol_index(number, key, *indices[k].ravel().tolist()) for k, key in enumerate(inputs))


def _sobol_index(number: Number, key: str, *found: float) -> SobolIndex:
    first, first_low, first_high, total, total_low, total_high = found
    return SobolIndex(
        number=number,
        input=key,
        first=first,
        first_low=first_low,
        first_high=first_high,
        total=total,
        total_low=total_low,
        total_high=total_high,
        reason="",
    )


def morris_of(
    number: Number, values: FloatArray, inputs: Sequence[str], *, n: int, seed: int
) -> tuple[MorrisEffect, ...]:
    """Return the effects of each input on a number.

    Parameters
    ----------
    number : Number
        Whose.
    values : (n (d + 1),) array
        Along the paths of `case_list.unit_draws`.
    inputs : sequence of str
        The d keys.
    n, seed : int
        Of the study.

    References
    ----------
    Morris, Technometrics 33 (1991) 161, doi:10.1080/00401706.1991.10484804; sizes: Campolongo et al., Environ. Model.
    Softw. 22 (2007) 1509, doi:10.1016/j.envsoft.2006.10.004.
    """
    reason = _why_none(values)
    if reason:
        gone = dict.fromkeys(("mean", "mean_error", "mean_size", "deviation"), math.nan)
        return tuple(MorrisEffect(number=number, input=key, reason=reason, **gone) for key in inputs)
    steps = np.diff(unit_draws("morris", len(inputs), n, seed).reshape(n, len(inputs) + 1, -1), axis=1)
    changes = np.diff(values.reshape(n, len(inputs) + 1), axis=1)
    # One input steps at a time: the sign of its step turns a change into an effect.
    effects = np.einsum("ps,psk->pk", changes, np.sign(steps))
    deviations = np.std(effects, axis=0, ddof=1) if n > 1 else np.full(len(inputs), math.nan)
    return tuple(
        MorrisEffect(
            number=number,
            input=key,
            mean=float(np.mean(effects[:, k])),
            mean_error=float(deviations[k] / math.sqrt(n)),
            mean_size=float(np.mean(np.abs(effects[:, k]))),
            deviation=float(deviations[k]),
            reason="",
        )
        for k, key in enumerate(inputs)
    )


def _why_none(values: FloatArray) -> str:
    missing = int(np.count_nonzero(np.isnan(values)))
    if missing:
        return f"{missing} of {values.size} cases have no such number"
    if np.ptp(values) <= _VARIES * np.max(np.abs(values)):
        return "no input changes it"
    return ""
