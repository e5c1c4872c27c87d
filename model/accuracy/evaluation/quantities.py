"""Readings of a prediction, and their differences in the sense of a tolerance."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from model.prediction.pair_detection import PairDetection
from model.prediction.prediction import RegionPrediction
from model.prediction.quantity_table import CIRCULAR, SHARES
from model.scene.scenario import Scenario

# Of these S0 is the scale: each may be zero, and their sign is that of the frame.
_OF_S0 = frozenset({"s1", "s2"})


class Reading(NamedTuple):
    """One number of a prediction.

    Attributes
    ----------
    place
        A region, or "target on background".
    quantity, statistic
        As in `model.prediction.prediction.Quantities`; "radiance" and "p_detection" beside them.
    """

    place: str
    quantity: str
    statistic: str


class Value(NamedTuple):
    """A number and what its error is counted in: 1 for an absolute tolerance, its own size for a relative one."""

    number: float
    scale: float


Readings = Mapping[Reading, Value]


def readings(
    scenario: Scenario, predictions: Mapping[str, RegionPrediction], detections: tuple[PairDetection, ...]
) -> dict[Reading, Value]:
    """Return all that a tolerance speaks of.

    Parameters
    ----------
    scenario
        For the radiance at the aperture.
    predictions, detections
        What follows from it.

    Notes
    -----
    Absolute: means of DoLP, s1, s2; P_D and the area under its curve. Relative: radiance (S1 and S2 as shares of S0),
    counts, deviations, SNR. A number that does not exist has no reading.
    """
    found: dict[Reading, Value] = {}
    for region in scenario.regions:
        found |= _radiance(region.name, region.stokes_radiance)
    for name, prediction in predictions.items():
        found |= dict(_of_region(name, prediction))
    for pair in detections:
        found |= dict(_of_pair(pair))
    return {key: value for key, value in found.items() if np.isfinite(value.number)}


def signed_differences(one: Readings, other: Readings) -> dict[Reading, float]:
    """Return other minus one for each reading of one, in the units of a tolerance; infinite where other has none."""
    return {key: _change(value, other[key].number) if key in other else np.inf for key, value in one.items()}


def differences(one: Readings, other: Readings) -> dict[Reading, float]:
    """Return the size of `signed_differences`."""
    return {key: abs(change) for key, change in signed_differences(one, other).items()}


def _change(value: Value, number: float) -> float:
    apart = number - value.number
    if apart == 0.0:
        return 0.0
    return apart / value.scale if value.scale > 0.0 else np.inf


def _radiance(name: str, stokes: np.ndarray) -> dict[Reading, Value]:
    return {
        Reading(name, "radiance", f"s{k}"): Value(float(stokes[k]), abs(float(stokes[0]))) for k in range(stokes.size)
    }


def _of_region(name: str, prediction: RegionPrediction) -> Iterator[tuple[Reading, Value]]:
    s0 = abs(float(prediction.stokes_dn.mean[0]))
    for quantity, statistics in prediction.quantities.items():
        if quantity in CIRCULAR:
            continue
        for statistic, number in statistics.items():
            scale = abs(number)
            if statistic == "mean" and quantity in SHARES:
                scale = 1.0
            elif statistic == "mean" and quantity in _OF_S0:
                scale = s0
            yield Reading(name, quantity, statistic), Value(number, scale)


def _of_pair(pair: PairDetection) -> Iterator[tuple[Reading, Value]]:
    place = f"{pair.target} on {pair.background}"
    for rate, number in zip(pair.p_false_alarm, pair.p_detection, strict=True):
        yield Reading(place, "p_detection", f"{rate:g}"), Value(float(number), 1.0)
    yield Reading(place, "auc", "whole curve"), Value(pair.auc, 1.0)
