"""Diagnosis of a run from its redundancy: faults with size, error and consequences.

`diagnose` turns the fit of `fault_fit` into terms, `consequence` gives the change of the DoLP and the AoLP of a region
by a fault, and `region_residual` the error of a region's mean counts from the residual that no light explains.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import Moments
from model.processing.fault_fit import (
    LEAST_SHARE_LEFT,
    PER_FRAME,
    SHARED,
    JointFit,
    can_be_undone,
    corrected_pictures,
    corrected_system,
    estimates,
    fit_faults,
    frame_faults,
    is_useful,
    known_causes,
    share_left,
)
from model.processing.reconstruction import Design
from model.stokes import aolp_rad, dolp

FloatArray = NDArray[np.float64]


# Degree below which an angle of polarization, and its change, is meaningless.
_LEAST_DOLP = 1e-6


def consequence(
    system: ArrayLike, means: ArrayLike, parameters: FloatArray, *, light: float, slopes: ArrayLike | None = None
) -> tuple[float | None, float | None]:
    """Return the change of DoLP and AoLP [rad] of a region due to faults of known size; None if unknown.

    Parameters
    ----------
    system
        Rows of the frames as stated, shape (N, 3).
    means
        Mean counts of the region behind each angle, dark level subtracted, shape (N,) [DN].
    parameters
        Of single frames and the response, shape (P,).
    light
        Counts for the share of a curved response [DN].
    slopes
        Mean slopes of the region behind each angle, x and y, shape (N, 2) [DN/pixel]; without them shifts are ignored.
    """
    rows, counts = np.asarray(system, dtype=np.float64), np.asarray(means, dtype=np.float64)
    frames, still = len(counts), counts
    if slopes is not None:
        first = PER_FRAME.index("shift x") * frames
        shifts = parameters[first : first + 2 * frames].reshape(2, frames).T
        still = counts + np.sum(shifts * np.asarray(slopes, dtype=np.float64), axis=1)
    with_fault = np.linalg.pinv(rows) @ counts
    faults = frame_faults(parameters, frames)
    design, _ = corrected_system(rows, faults)
    # Shifts do not change an even picture.
    even = np.repeat(still[:, None, None], 4, axis=2)
    without = design.inverse @ corrected_pictures(even, faults, light=light)[:, 0, 0]
    if not (can_be_undone(parameters) and with_fault[0] > 0.0 and without[0] > 0.0):
        return None, None
    degrees = float(dolp(with_fault)), float(dolp(without))
    turned = float(aolp_rad(with_fault) - aolp_rad(without))
    is_turned = min(degrees) > _LEAST_DOLP
    return degrees[0] - degrees[1], (turned + np.pi / 2) % np.pi - np.pi / 2 if is_turned else None


# Sides of the blocks of a region [pixel], the largest first: neighbours share blur, mosaics and shading.
_SIDES_PIXELS = (32, 16, 8, 4, 2, 1)
_LEAST_BLOCKS = 12


def region_residual(plan: Design, pictures: FloatArray, inside: NDArray[np.bool_]) -> Moments:
    """Return the mean counts of a region, and the covariance of the residual that no light explains.

    Parameters
    ----------
    plan
        Of the frames.
    pictures
        Shape (N, H, W), dark level subtracted.
    inside
        Usable pixels of the region, shape (H, W); at least one.

    Notes
    -----
    Texture cancels in the residual, so its blocks give the error, unlike those of the channels.
    """
    rows, columns = np.nonzero(inside)
    counts = pictures[:, rows, columns]
    residual = plan.null_basis @ plan.null_basis.T @ counts
    left = residual - residual.mean(axis=1, keepdims=True)
    widest = np.zeros((len(counts),) * 2)
    for side in _SIDES_PIXELS:
        _, block = np.unique(rows // side * (int(columns.max()) // side + 1) + columns // side, return_inverse=True)
        blocks = int(block.max()) + 1
        if blocks >= _LEAST_BLOCKS:
            sums = np.array([np.bincount(block, weights=one, minlength=blocks) for one in left])
            cov = np.asarray(sums @ sums.T * (blocks / (blocks - 1.0)) / residual.shape[1] ** 2)
            widest = max(widest, cov, key=np.trace)
    return Moments(mean=np.asarray(counts.mean(axis=1)), cov=widest)


@dataclass(frozen=True, kw_only=True, eq=False)
class Term:
    """One fault of a run."""

    name: str
    frame: int | None  #: None where it is of several
    unit: str
    value: float | None  #: its size in addition to the named causes; the length of a shift; None if not testable
    std_error: float | None
    reason: str  #: reason if it is not testable
    is_named: bool  #: True for the causes that explain the run best
    confused_with: tuple[tuple[str, int | None], ...]  #: names and frames of faults with the same effect on this run
    parameters: FloatArray  #: its contribution to the parameters of single frames, shape (P,)

    @property
    def is_testable(self) -> bool:
        """Return whether the run determines it."""
        return not self.reason


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis:
    """Faults of a run."""

    terms: tuple[Term, ...]  #: the named ones first, in order of strength
    reason: str  #: reason if nothing is testable
    light: float  #: mean counts, to which a curved response refers [DN]

    @property
    def first(self) -> Term | None:
        """The strongest of the named terms."""
        return self.terms[0] if self.terms and self.terms[0].is_named else None


def diagnose(
    plan: Design,
    pictures: ArrayLike,
    usable: ArrayLike,
    *,
    angles_rad: ArrayLike,
    times: Sequence[float],
    step: float = 0.0,
) -> Diagnosis:
    """Return the faults that a set of pictures shows.

    Parameters
    ----------
    plan
        System matrix of the frames.
    pictures
        Counts, dark level subtracted, shape (N, H, W).
    usable
        Pixels that are neither missing nor clipped in any frame, shape (H, W).
    angles_rad
        Angles over the whole turn, shape (N,) [rad].
    times
        Mean time of each frame, any unit.
    step
        Of the rounding, in the unit of the pictures; 0 where none is known.

    Notes
    -----
    A dark level, gain or turn common to all frames acts like light and is not found.
    """
    images, good = np.asarray(pictures, dtype=np.float64), np.asarray(usable, dtype=np.bool_)
    light = float(images[:, good].mean()) if good.any() else 0.0
    if plan.redundancy == 0:
        return _untestable("three angles fit any frames: there is no redundancy", light)
    if not light > 0.0:
        return _untestable("no usable pixel has light", light)
    causes = known_causes(np.asarray(angles_rad, dtype=np.float64), times, light=light)
    fit = fit_faults(plan.system, images, good, causes, light=light, step=step)
    if fit is None:
        return _untestable("too few usable pixels: residuals of a dozen tiles of 12 pixels are needed", light)
    others = (index for index in range(len(causes)) if index not in fit.named)
    terms = tuple(_term(fit, index) for index in (*fit.named, *others))
    return Diagnosis(
        terms=terms,
        reason="",
        light=light,
    )


def _untestable(reason: str, light: float) -> Diagnosis:
    return Diagnosis(terms=(), reason=reason, light=light)


# Correlation of effects from which a run cannot distinguish two causes.
_SAME = 0.99

# Relative standard error of a fault too large for a correction, and of the others then.
_HARDLY_KNOWN = 0.5


def _term(fit: JointFit, index: int) -> Term:
    causes, is_named = fit.evidence.causes, index in fit.named
    cause = causes[index]
    together = fit.named if is_named else (*fit.named, index)
    fitted = estimates(fit.evidence, together)
    if not fitted.is_determined:
        together = _in_its_place(fit, index)
        fitted = estimates(fit.evidence, together)
    part = fitted.parts[together.index(index)]
    size, error = fitted.size_of(together.index(index))
    reason = _why_not(fit, index, fitted.is_determined, error)
    made = cause.directions @ fitted.values[part]
    if not reason and not (can_be_undone(made) and can_be_undone(fit.parameters)):
        error = max(error, _HARDLY_KNOWN * abs(size))
    if is_named:
        confused = fit.stand_ins[index]
    else:
        others = (other for other in range(len(causes)) if other != index)
        confused = {other for other in others if fit.weigher.correlation(index, other) > _SAME}
    return Term(
        name=cause.name,
        frame=cause.frame,
        unit=cause.unit,
        value=None if reason else size,
        std_error=None if reason else error,
        reason=reason,
        is_named=is_named,
        confused_with=tuple((causes[other].name, causes[other].frame) for other in sorted(confused)),
        parameters=made,
    )


def _in_its_place(fit: JointFit, index: int) -> tuple[int, ...]:
    """Return the named causes with one of them replaced by a similar cause."""
    if not fit.named:
        return (index,)
    alike = max(fit.named, key=lambda other: fit.weigher.correlation(index, other))
    return tuple(index if other == alike else other for other in fit.named)


def _why_not(fit: JointFit, index: int, is_determined: bool, error: float) -> str:
    """Return the reason why a cause is not testable, empty if it is."""
    cause = fit.evidence.causes[index]
    if cause.name in SHARED:
        left = share_left(fit.evidence, index)
        if left <= LEAST_SHARE_LEFT:
            return (
                "polarization varies too little over the picture: throughputs, angles and dark levels explain all but "
                f"{left:.1%} of its effect, {LEAST_SHARE_LEFT:.0%} is needed"
            )
    if not is_determined:
        return (
            "these pictures cannot distinguish it from the named causes"
            if fit.named
            else "these pictures do not show it"
        )
    if not is_useful(cause, error):
        return "these pictures do not determine it well"
    return ""
