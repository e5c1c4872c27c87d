"""Performance of the RX detector between the regions of a predicted scene."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice, permutations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments
from model.prediction.prediction import RegionPrediction
from model.processing.detection import rx_roc
from model.processing.detection_distribution import condition_warnings

FloatArray = NDArray[np.float64]
# Target, background, and region to prediction.
PairCase = tuple[str, str, Mapping[str, RegionPrediction]]


@dataclass(frozen=True, kw_only=True)
class PairDetection:
    """RX detection of one region on another, by the exact distribution.

    Parameters
    ----------
    target, background
        Names.
    p_false_alarm, p_detection, p_miss
        Shape (K,); the last, 1 less the second, has its own digits where next to nothing is missed.
    auc
        Area under the whole curve.
    p_detection_error, auc_error
        Absolute errors of both, as the integral estimates them itself; shape (K,) and a number.
    warnings
        What limits the result.
    """

    target: str
    background: str
    p_false_alarm: FloatArray
    p_detection: FloatArray
    p_miss: FloatArray
    auc: float
    p_detection_error: FloatArray
    auc_error: float
    warnings: tuple[str, ...]


def pair_detections(
    predictions: Mapping[str, RegionPrediction], p_false_alarm: Sequence[float]
) -> tuple[PairDetection, ...]:
    """Return what the RX detector does for every ordered pair of regions, on Stokes parameters of one cycle.

    Parameters
    ----------
    predictions
        Region to prediction.
    p_false_alarm
        Shape (K,), each in (0, 1).

    Returns
    -------
    tuple of PairDetection
        Not a number, with the reason among its warnings, where a background's covariance is singular.

    References
    ----------
    [MK14] eq. (30), section IV-B.
    """
    return detections_of_sweep((predictions,), p_false_alarm)[0]


def detections_of_sweep(
    alternatives: Sequence[Mapping[str, RegionPrediction]], p_false_alarm: Sequence[float]
) -> tuple[tuple[PairDetection, ...], ...]:
    """Return what `pair_detections` does for each of several sets of predictions, in about the time of one.

    Parameters
    ----------
    alternatives
        Each from region to prediction, all with the same regions.
    p_false_alarm
        As in `pair_detections`.

    References
    ----------
    [MK14] eq. (30), section IV-B.
    """
    pairs = tuple(permutations(alternatives[0], 2)) if alternatives else ()
    return detections_of_pairs(pairs, alternatives, p_false_alarm)


def detections_of_pairs(
    pairs: Sequence[tuple[str, str]],
    alternatives: Sequence[Mapping[str, RegionPrediction]],
    p_false_alarm: Sequence[float],
    *,
    tolerance: float = 1e-10,
) -> tuple[tuple[PairDetection, ...], ...]:
    """Return what `pair_detection` does for each pair in each of several sets of predictions.

    Parameters
    ----------
    pairs
        Target and background.
    alternatives
        Each from region to prediction.
    p_false_alarm, tolerance
        As in `pair_detection`.

    References
    ----------
    [MK14] eq. (30), section IV-B.
    """
    cases = [(target, background, one) for one in alternatives for target, background in pairs]
    found = iter(detections_of_cases(cases, p_false_alarm, tolerance=tolerance))
    return tuple(tuple(islice(found, len(pairs))) for _ in alternatives)


def detections_of_cases(
    cases: Sequence[PairCase], p_false_alarm: Sequence[float], *, tolerance: float = 1e-10
) -> tuple[PairDetection, ...]:
    """Return what `pair_detection` does for each of several cases, together where all exist.

    Parameters
    ----------
    cases
        Target, background, and region to prediction of each.
    p_false_alarm, tolerance
        As in `pair_detection`.

    References
    ----------
    [MK14] eq. (30), section IV-B.
    """
    if len(cases) < 2:
        return tuple(pair_detection(*one, p_false_alarm, tolerance=tolerance) for one in cases)
    try:
        return _together(cases, p_false_alarm, tolerance=tolerance)
    except (ValueError, ArithmeticError):
        # One that cannot be had is refused together with all others: it is looked for in either half.
        half = len(cases) // 2
        parts = (detections_of_cases(some, p_false_alarm, tolerance=tolerance) for some in (cases[:half], cases[half:]))
        return tuple(one for part in parts for one in part)


def pair_detection(
    target: str,
    background: str,
    predictions: Mapping[str, RegionPrediction],
    p_false_alarm: Sequence[float],
    *,
    tolerance: float = 1e-10,
) -> PairDetection:
    """Return what the RX detector does for one region on another, on Stokes parameters of one cycle.

    Parameters
    ----------
    target, background
        Names of regions.
    predictions
        Region to prediction.
    p_false_alarm
        Shape (K,), each in (0, 1).
    tolerance
        Relative, of the tail that is integrated, 1e-12 to 0.01.

    References
    ----------
    [MK14] eq. (30), section IV-B.
    """
    try:
        return _together(((target, background, predictions),), p_false_alarm, tolerance=tolerance)[0]
    except (ValueError, ArithmeticError) as error:
        rates = np.asarray(p_false_alarm, dtype=np.float64)
        nothing = np.full(rates.shape, np.nan)
        return PairDetection(
            target=target,
            background=background,
            p_false_alarm=rates,
            p_detection=nothing,
            p_miss=nothing,
            auc=np.nan,
            p_detection_error=nothing,
            auc_error=np.nan,
            warnings=(
                f"{background} cannot be a background: {error}"
                if isinstance(error, ValueError)
                else f"{target} on {background}: {error}",
            ),
        )


def rocs_of_pair(
    target: str,
    background: str,
    alternatives: Sequence[Mapping[str, RegionPrediction]],
    p_false_alarm: Sequence[float] | FloatArray,
    *,
    kind: Literal["stokes", "intensity"],
    tolerance: float = 1e-10,
) -> tuple[PairDetection, ...]:
    """Return what `pair_detection` does, on Stokes parameters or on the counts behind each angle of the polarizer.

    Parameters
    ----------
    target, background
        Names of regions.
    alternatives
        One or more sets of predictions, each from region to prediction; all take about the time of one.
    p_false_alarm, tolerance
        As in `pair_detection`.
    kind
        "stokes", three components, or "intensity", one for each angle.

    References
    ----------
    [MK14] eq. (30), section IV-B: "multichannel intensity or Stokes parameters".
    """
    if kind == "intensity":
        alternatives = [
            {name: replace(one[name], stokes_dn=_counts(one[name])) for name in (target, background)}
            for one in alternatives
        ]
    rates = np.asarray(p_false_alarm).tolist()
    return detections_of_cases([(target, background, one) for one in alternatives], rates, tolerance=tolerance)


def _counts(prediction: RegionPrediction) -> Moments:
    """Return mean and covariance of the counts of single pixels of one cycle, [MK14] eq. (18), (20)."""
    channels = prediction.channels
    noise = np.diag(channels.temporal_var_dn2)
    return Moments(mean=channels.mean_dn, cov=channels.scene_cov_dn2 + channels.fixed_pattern_cov_dn2 + noise)


def _together(
    cases: Sequence[PairCase], p_false_alarm: Sequence[float], *, tolerance: float
) -> tuple[PairDetection, ...]:
    """Return detection of all cases by one integral; ValueError where a background's covariance is singular."""
    rates = np.asarray(p_false_alarm, dtype=np.float64)
    targets = [predictions[target].stokes_dn for target, _, predictions in cases]
    backgrounds = [predictions[background].stokes_dn for _, background, predictions in cases]
    moments = (
        np.stack([getattr(one, moment) for one in several])
        for several in (targets, backgrounds)
        for moment in ("mean", "cov")
    )
    curves = rx_roc(rates[:, np.newaxis], *moments, tolerance=tolerance)
    p_detection_error = curves.error * np.maximum(curves.p_detection, curves.p_miss)
    auc_error = curves.auc_error * np.minimum(curves.auc, 1.0 - curves.auc)
    return tuple(
        PairDetection(
            target=target,
            background=background,
            p_false_alarm=rates,
            p_detection=curves.p_detection[:, k],
            p_miss=curves.p_miss[:, k],
            auc=float(curves.auc[k]),
            p_detection_error=p_detection_error[:, k],
            auc_error=float(auc_error[k]),
            warnings=condition_warnings(curves.background_condition[k]),
        )
        for k, (target, background, _) in enumerate(cases)
    )
