"""Numbers of a study in the order of its cases, from its parts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.study.batch import BatchResult
from rigctl.study.kept_parts import DoneCases
from rigctl.study.study_case import Case, Wanted

FloatArray = NDArray[np.float64]
UNDONE = "not computed yet"


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyArrays:
    """Numbers of N cases.

    Attributes
    ----------
    regions, pairs : tuple of str
        Those of all scenes, each once, in the order of the scenes; a case whose scene has none of them holds NaN there.
    values : (N, R, Q) array
        Of the wanted columns.
    p_detection : (N, P, K) array
        At the rates of a sweep; without pairs where it is not wanted, as is the next.
    auc : (N, P) array
        Areas under the curves.
    roc : (N, 2, L) array or None
        Probability of detection on Stokes parameters and on counts, where it is wanted.
    seconds : (N,) array
        Time of each case; NaN where it is not done.
    is_new_sky : (N,) array
        Whether that time holds a sky.
    reasons : tuple of str
        Why a case has no numbers; empty where it has.
    """

    regions: tuple[str, ...]
    pairs: tuple[str, ...]
    values: FloatArray
    p_detection: FloatArray
    auc: FloatArray
    roc: FloatArray | None
    seconds: FloatArray
    is_new_sky: NDArray[np.bool_]
    reasons: tuple[str, ...]


def arrays_of(
    cases: Sequence[Case], hashes: Sequence[str], done: DoneCases, wanted: Wanted, *, rates: int, curve: int
) -> StudyArrays:
    """Return the numbers of all cases; those that are not done hold NaN.

    Parameters
    ----------
    cases, hashes : sequences
        The study's, N of each.
    done : DoneCases
        What was computed, of this study or of an earlier one in the same folder.
    wanted : Wanted
        What was asked for.
    rates, curve : int
        How many probabilities of false alarm there are for pairs, and for whole curves.
    """
    used = {done.places[one][0] for one in hashes if one in done.places}
    parts = [done.parts[k] for k in sorted(used)]
    regions = tuple(dict.fromkeys(name for part in parts for name in part.regions))
    pairs = tuple(dict.fromkeys(name for part in parts for name in part.pairs)) if wanted.detection else ()
    shape = len(cases)
    found = StudyArrays(
        regions=regions,
        pairs=pairs,
        values=np.full((shape, len(regions), len(wanted.columns)), np.nan),
        p_detection=np.full((shape, len(pairs), rates), np.nan),
        auc=np.full((shape, len(pairs)), np.nan),
        roc=None if wanted.roc is None else np.full((shape, 2, curve), np.nan),
        seconds=np.full(shape, np.nan),
        is_new_sky=np.zeros(shape, dtype=bool),
        reasons=tuple(_reason(done, one) for one in hashes),
    )
    places = [{name: k for k, name in enumerate(names)} for names in (regions, pairs)]
    for row, one in enumerate(hashes):
        if one in done.places:
            part, line = done.places[one]
            _fill(found, row, done.parts[part], line, *places)
    return found


def _reason(done: DoneCases, case: str) -> str:
    if case not in done.places:
        return UNDONE
    part, line = done.places[case]
    return done.parts[part].reasons[line]


def _fill(
    found: StudyArrays, row: int, part: BatchResult, line: int, regions: Mapping[str, int], pairs: Mapping[str, int]
) -> None:
    found.values[row, [regions[name] for name in part.regions]] = part.values[line]
    found.seconds[row], found.is_new_sky[row] = part.seconds[line], part.is_new_sky[line]
    if found.pairs and part.auc.size:
        there = [pairs[name] for name in part.pairs]
        found.p_detection[row, there], found.auc[row, there] = part.p_detection[line], part.auc[line]
    if found.roc is not None and part.roc.size:
        found.roc[row] = part.roc[line]
