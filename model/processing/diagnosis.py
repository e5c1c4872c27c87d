"""Diagnosis of a run from its own redundancy: each fault with its size, its error and its consequences.

`diagnose` puts the fit of `fault_fit` into terms, `consequence` says how far a fault moves the DoLP and the AoLP of a
region, and `region_residual` gives the error of a region's mean counts from the part that no light explains.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.fault_fit import (
    LEAST_SHARE_LEFT,
    PER_FRAME,
    SHARED,
    Cause,
    FrameFaults,
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


@dataclass(frozen=True, kw_only=True)
class Consequence:
    """What a fault does to the polarization of a region."""

    dolp_shift: float | None
    aolp_shift_rad: float | None


# Below this degree an angle of polarization has no meaning, and none of its changes.
_LEAST_DOLP = 1e-6


def consequence(
    system: ArrayLike, means: ArrayLike, parameters: FloatArray, *, light: float, slopes: ArrayLike | None = None
) -> Consequence:
    """Return what faults of a known size do to the polarization of a region.

    Parameters
    ----------
    system
        Rows of the frames as they are said to be, shape (N, 3).
    means
        Mean counts of the region behind each angle, dark level taken off, shape (N,) [DN].
    parameters
        Of single frames and the response, shape (P,).
    light
        Counts at which a curved response adds its share [DN].
    slopes
        Mean slopes of the region behind each angle, x and y, shape (N, 2) [DN/pixel]; shifts change no even region, and
        are left out without.
    """
    rows, counts = np.asarray(system, dtype=np.float64), np.asarray(means, dtype=np.float64)
    with_fault = np.linalg.pinv(rows) @ counts
    still = (
        counts
        if slopes is None
        else counts + np.sum(_shifts(parameters, len(counts)) * np.asarray(slopes, dtype=np.float64), axis=1)
    )
    without = stokes_without(rows, still, parameters, light=light)
    is_known = can_be_undone(parameters) and with_fault[0] > 0.0 and without[0] > 0.0
    if not is_known:
        return Consequence(dolp_shift=None, aolp_shift_rad=None)
    degrees = float(dolp(with_fault)), float(dolp(without))
    turned = float(aolp_rad(with_fault) - aolp_rad(without))
    return Consequence(
        dolp_shift=degrees[0] - degrees[1],
        aolp_shift_rad=(turned + np.pi / 2) % np.pi - np.pi / 2 if min(degrees) > _LEAST_DOLP else None,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class RegionResidual:
    """The mean counts of a region, and the covariance of what in them is no light."""

    means: FloatArray
    cov: FloatArray


# Blocks of a region, the largest first: neighbours share blur, mosaics and shading.
_SIDES_PIXELS = (32, 16, 8, 4, 2, 1)
_LEAST_BLOCKS = 12


def region_residual(plan: Design, pictures: FloatArray, inside: NDArray[np.bool_]) -> RegionResidual:
    """Return the mean of a region and the covariance of its residual, from blocks of the residual.

    Parameters
    ----------
    plan
        Of the frames.
    pictures
        Shape (N, H, W), dark level taken off.
    inside
        Usable pixels of the region, shape (H, W); one at least.

    Notes
    -----
    Texture cancels in the residual, so that its blocks and not those of the channels tell the error.
    """
    rows, columns = np.nonzero(inside)
    if not rows.size:
        raise ValueError("inside holds no pixel; at least one is needed")
    counts = pictures[:, rows, columns]
    onto = plan.null_basis @ plan.null_basis.T
    residual = onto @ counts
    scattered = [_scatter_of_mean(residual, rows // side, columns // side) for side in _SIDES_PIXELS]
    found = [cov for cov in scattered if cov is not None]
    widest = max(found, key=lambda cov: float(np.trace(cov)), default=np.zeros((len(counts),) * 2))
    return RegionResidual(means=np.asarray(counts.mean(axis=1)), cov=widest)


@dataclass(frozen=True, kw_only=True, eq=False)
class Term:
    """What a run says of one fault.

    Attributes
    ----------
    name, frame, unit
        Which fault, of which frame (None: of several), and the unit of its size.
    value, std_error
        Its size beside the causes named; of a shift, its length. None where it is not testable.
    is_testable, reason
        Whether the run determines it, and if not why.
    is_named
        Whether it is one of the causes that explain the run best.
    confused_with
        Names and frames of faults that would do the same to this run.
    parameters : (P,) array
        What it adds to the parameters of single frames.
    """

    name: str
    frame: int | None
    unit: str
    value: float | None
    std_error: float | None
    is_testable: bool
    reason: str
    is_named: bool
    confused_with: tuple[tuple[str, int | None], ...]
    parameters: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis:
    """What a run says of itself.

    Attributes
    ----------
    terms
        Faults, those named first, the strongest of them at the front.
    first
        Of them, or None where nothing was found.
    reason
        Why nothing is testable; empty otherwise.
    faults
        Of single frames, as the named terms make them.
    light
        Mean counts, to which a curved response refers [DN].
    """

    terms: tuple[Term, ...]
    first: Term | None
    reason: str
    faults: FrameFaults | None
    light: float


def diagnose(
    plan: Design,
    pictures: ArrayLike,
    usable: ArrayLike,
    *,
    angles_rad: ArrayLike,
    times: Sequence[float],
    step: float = 0.0,
) -> Diagnosis:
    """Return what a set of pictures says of its faults.

    Parameters
    ----------
    plan
        System matrix of the frames.
    pictures
        Counts, dark level taken off, shape (N, H, W).
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
    A dark level, a gain or a turn that is common to all frames is light that could have been, and cannot be seen.
    """
    images, good = np.asarray(pictures, dtype=np.float64), np.asarray(usable, dtype=np.bool_)
    light = float(images[:, good].mean()) if good.any() else 0.0
    if plan.redundancy == 0:
        return _untestable("three angles fit any frames: there is nothing to hold them against", light)
    if not light > 0.0:
        return _untestable("no usable pixel holds any light", light)
    causes = known_causes(np.asarray(angles_rad, dtype=np.float64), times, light=light)
    fit = fit_faults(plan.system, images, good, causes, light=light, step=step)
    if fit is None:
        return _untestable("too few usable pixels: residuals of a dozen tiles of 12 pixels are needed", light)
    others = (index for index in range(len(causes)) if index not in fit.named)
    terms = tuple(_term(fit, index) for index in (*fit.named, *others))
    return Diagnosis(
        terms=terms,
        first=terms[0] if fit.named else None,
        reason="",
        faults=frame_faults(fit.parameters, len(images)),
        light=light,
    )


def _shifts(parameters: FloatArray, frames: int) -> FloatArray:
    first = PER_FRAME.index("shift x") * frames
    return parameters[first : first + 2 * frames].reshape(2, frames).T


def stokes_without(system: FloatArray, means: FloatArray, parameters: FloatArray, *, light: float) -> FloatArray:
    """Return the Stokes parameters of mean counts with faults taken out, shape (3,); shifts are left."""
    faults = frame_faults(parameters, len(means))
    design, _ = corrected_system(system, faults)
    flat = np.repeat(means[:, None, None], 4, axis=2)
    return np.asarray(design.inverse @ corrected_pictures(flat, faults, light=light)[:, 0, 0])


def _scatter_of_mean(residual: FloatArray, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> FloatArray | None:
    """Return the covariance of the mean as blocks show it; None where there are too few of them."""
    _, block = np.unique(rows * (int(columns.max()) + 1) + columns, return_inverse=True)
    blocks = int(block.max()) + 1
    if blocks < _LEAST_BLOCKS:
        return None
    left = residual - residual.mean(axis=1, keepdims=True)
    sums = np.array([np.bincount(block, weights=one, minlength=blocks) for one in left])
    return np.asarray(sums @ sums.T * (blocks / (blocks - 1.0)) / residual.shape[1] ** 2)


def _untestable(reason: str, light: float) -> Diagnosis:
    return Diagnosis(terms=(), first=None, reason=reason, faults=None, light=light)


# Standard error, as a share of its size, of a fault too large to be undone and fitted about itself, and of others then.
_HARDLY_KNOWN = 0.5


def _term(fit: JointFit, index: int) -> Term:
    cause, is_named = fit.evidence.causes[index], index in fit.named
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
    return Term(
        name=cause.name,
        frame=cause.frame,
        unit=cause.unit,
        value=None if reason else size,
        std_error=None if reason else error,
        is_testable=not reason,
        reason=reason,
        is_named=is_named,
        confused_with=tuple((other.name, other.frame) for other in _confused(fit, index)),
        parameters=made,
    )


def _in_its_place(fit: JointFit, index: int) -> tuple[int, ...]:
    """Return the named causes with one cause put in the place of the one that is most like it."""
    if not fit.named:
        return (index,)
    alike = max(fit.named, key=lambda other: fit.weigher.correlation(index, other))
    return tuple(index if other == alike else other for other in fit.named)


def _why_not(fit: JointFit, index: int, is_determined: bool, error: float) -> str:
    cause = fit.evidence.causes[index]
    if cause.name in SHARED:
        left = share_left(fit.evidence, index)
        if left <= LEAST_SHARE_LEFT:
            return (
                f"polarization is too alike over the picture: {left:.1%} of what it does is not done by throughputs, "
                f"angles and dark levels, {LEAST_SHARE_LEFT:.0%} are needed"
            )
    if not is_determined:
        return (
            "nothing in these pictures tells it from what was named" if fit.named else "these pictures do not show it"
        )
    if not is_useful(cause, error):
        return "these pictures hardly determine it"
    return ""


# Correlation of what two causes do to a run, from which they are the same to it.
_SAME = 0.99


def _confused(fit: JointFit, index: int) -> list[Cause]:
    causes = fit.evidence.causes
    if index in fit.named:
        same = fit.stand_ins[index]
    else:
        same = {
            other for other in range(len(causes)) if other != index and fit.weigher.correlation(index, other) > _SAME
        }
    return [causes[other] for other in sorted(same)]
