"""Mounting of a polarizer in its stage: sense of rotation and axis offset, from angles that are known two ways."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError

FloatArray = NDArray[np.float64]
Sense = Literal[1, -1]

_SENSES: tuple[Sense, ...] = (1, -1)
# One sense has to fit worse than the other by this much chi-squared: 5 standard errors.
_DECIDED = 25.0


@dataclass(frozen=True, kw_only=True)
class AxisCandidate:
    """Offset for one sense of rotation.

    Attributes
    ----------
    sense : {1, -1}
        polarizer angle = sense * stage angle + offset.
    offset_rad, std_error_rad : float
        In [0, pi), and its standard error, scatter included [rad].
    chi2 : float
        How badly the angles agree with it, in their own errors.
    """

    sense: Sense
    offset_rad: float
    std_error_rad: float
    chi2: float


@dataclass(frozen=True, kw_only=True)
class AxisFit:
    """Both senses of rotation.

    Attributes
    ----------
    best, other : AxisCandidate
        The better one first.
    is_decided : bool
        The other is ruled out.
    scatter_rad : float
        How far the directions lie from the better one, root mean square beyond their own errors [rad].
    """

    best: AxisCandidate
    other: AxisCandidate
    is_decided: bool
    scatter_rad: float


def fit_axis(
    *,
    axis_rad: FloatArray,
    stage_rad: FloatArray,
    std_error_rad: FloatArray,
    common_error_rad: float = 0.0,
    expected_rad: float | None = None,
    expected_error_rad: float = 0.0,
) -> AxisFit:
    """Return sense and offset from stage angles at which the direction of the transmission axis is known.

    Parameters
    ----------
    axis_rad, stage_rad : (n,) arrays
        Direction of the transmission axis in the picture, and stage angle at which the polarizer has it [rad]. Of a
        scan against a fixed reference: the reference's direction, and the stage angle of largest intensity.
    std_error_rad : (n,) array
        Standard error of their difference, > 0 [rad].
    common_error_rad : float
        Error of the directions that all share: how well the reference itself is known [rad].
    expected_rad, expected_error_rad : float
        The offset as one knows it beforehand, such as from a mark on the mount, and how well [rad].

    Raises
    ------
    CalibrationError
        There is no pair.

    Notes
    -----
    offset = axis - sense * stage. A single pair fits either sense. What decides is a second direction (not at
    90 deg to the first), or an offset that is roughly known and a reference that is not along or across it:
    with the reference at 0 or 90 deg to the axis of the stage's zero, both senses give one offset.

    The standard error grows with the scatter of the pairs where that is larger than their errors.
    """
    if len(axis_rad) == 0:
        raise CalibrationError("no angle is known in both the picture and the stage")
    fits = [
        _candidate(sense, axis_rad, stage_rad, std_error_rad, common_error_rad, expected_rad, expected_error_rad)
        for sense in _SENSES
    ]
    best, other = sorted(fits, key=lambda fit: fit.chi2)
    scale = max(1.0, best.chi2 / max(1, len(axis_rad) - 1))
    left_rad = half_turn(axis_rad - best.sense * stage_rad - best.offset_rad)
    beyond = float(np.mean(np.square(left_rad) - np.square(std_error_rad)))
    return AxisFit(
        best=best,
        other=other,
        is_decided=other.chi2 - best.chi2 > _DECIDED * scale,
        scatter_rad=float(np.sqrt(max(beyond, 0.0))),
    )


def _candidate(
    sense: Sense,
    axis_rad: FloatArray,
    stage_rad: FloatArray,
    std_error_rad: FloatArray,
    common_error_rad: float,
    expected_rad: float | None,
    expected_error_rad: float,
) -> AxisCandidate:
    offsets, weights = axis_rad - sense * stage_rad, std_error_rad**-2.0
    # Directions are the same modulo pi: their mean is taken on the circle of the doubled angle, then refined.
    start = 0.5 * float(np.angle(weights @ np.exp(2j * offsets)))
    difference = half_turn(offsets - start)
    offset = start + float(weights @ difference / weights.sum())
    chi2 = float(weights @ half_turn(offsets - offset) ** 2)
    scale = max(1.0, chi2 / max(1, len(offsets) - 1))
    variance = scale / float(weights.sum()) + common_error_rad**2
    if expected_rad is not None:
        chi2 += float(half_turn(np.array(offset - expected_rad))) ** 2 / (variance + expected_error_rad**2)
    return AxisCandidate(sense=sense, offset_rad=offset % np.pi, std_error_rad=float(np.sqrt(variance)), chi2=chi2)


def half_turn(angle_rad: FloatArray) -> FloatArray:
    """Return the difference of two directions, in [-pi/2, pi/2) [rad].

    Parameters
    ----------
    angle_rad
        Difference of two axes, any shape [rad].
    """
    wrapped: FloatArray = (angle_rad + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    return wrapped
