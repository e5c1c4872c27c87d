"""Where disagreements point: a scale, the polarizer's axis, the degree of polarization, or the noise."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from model.quantities import is_counts
from rigctl.comparison.rows import Row

Cause = Literal["scale", "axis-offset", "axis-sense", "polarization", "noise", "not-normal"]

ADVICE: dict[Cause, str] = {
    "scale": "Counts and S0 are off by a common factor while DoLP and AoLP agree: look at the gain, the exposure, "
    "transmittance and quantum efficiency, or the radiance of the scene.",
    "axis-offset": "AoLP is off by the same angle everywhere while DoLP agrees: look at the offset of the polarizer's "
    "axis in the rig file.",
    "axis-sense": "AoLP is mirrored while DoLP agrees: look at the sense of rotation of the polarizer in the rig file "
    "(+1 or -1 as the camera sees it), or a mirrored picture.",
    "polarization": "The degree of polarization is off: look at the extinction ratio, at dark level that was not "
    "taken off, at drift of the light, or at the polarization of the scene.",
    "noise": "Means agree and deviations do not: look at the noise calibration, or at the texture of the scene.",
    "not-normal": "The pixels of a region do not scatter as one normal cloud, which the law of DoLP takes them for: "
    "look for an edge, shading or parts of different polarization in the region, or for counts of few steps.",
}


# Numbers that the law of DoLP gives.
_OF_LAW = ("dolp_pixels", "dolp_snr")


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """Where the disagreements point.

    Attributes
    ----------
    points_to : tuple of str
        Causes that would show as these rows do; empty where all rows agree.
    advice : tuple of str
        A sentence for each.
    """

    points_to: tuple[Cause, ...]
    advice: tuple[str, ...]


def diagnose(rows: Sequence[Row], *, is_of_law: bool = False) -> Diagnosis:
    """Return where the disagreeing rows point.

    Parameters
    ----------
    rows : sequence of Row
        With their decisions.
    is_of_law : bool
        DoLP of pixels was predicted from these very pixels, by a law alone.

    Notes
    -----
    What a cause cannot touch tells it apart: a scale leaves s1, s2, DoLP and AoLP alone, a turned axis leaves S0 and
    DoLP alone, and only noise leaves every mean alone.
    """
    off = {(row.quantity, row.statistic) for row in rows if row.agrees is False}
    means = {quantity for quantity, statistic in off if statistic == "mean"}
    causes: list[Cause] = []
    if "dolp" in means:
        causes.append("polarization")
    else:
        if means & {"aolp_deg", "s1n", "s2n"}:
            causes.append(_axis_cause(rows))
        if "s0" in means or (not causes and _any_count(means)):
            causes.append("scale")
    if off and not causes:
        causes.append("not-normal" if is_of_law and all(name in _OF_LAW for name, _ in off) else "noise")
    return Diagnosis(points_to=tuple(causes), advice=tuple(ADVICE[cause] for cause in causes))


def _any_count(quantities: set[str]) -> bool:
    return any(is_counts(quantity) or quantity in ("s1", "s2") for quantity in quantities)


def _axis_cause(rows: Sequence[Row]) -> Cause:
    """Return whether one turn, or one mirror, explains the angles of polarization of all regions."""
    angles = [row for row in rows if row.quantity == "aolp_deg" and row.statistic == "mean" and row.std_error]
    weights = np.array([1.0 / (row.std_error or 1.0) ** 2 for row in angles])
    predicted = np.deg2rad([2.0 * row.predicted for row in angles])
    measured = np.deg2rad([2.0 * row.measured for row in angles])
    turned, mirrored = _spread(measured - predicted, weights), _spread(measured + predicted, weights)
    return "axis-sense" if mirrored < turned else "axis-offset"


def _spread(angles_rad: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Return the weighted spread of angles on the circle: 0 where they are all one."""
    return 1.0 - float(abs(np.average(np.exp(1j * angles_rad), weights=weights)))
