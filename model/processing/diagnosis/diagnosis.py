"""Diagnosis of a run from its own redundancy: each fault with its size and error, and what explains it best."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.diagnosis.causes import SHARED, Cause, known_causes
from model.processing.diagnosis.correction import FrameFaults, can_be_undone, frame_faults
from model.processing.diagnosis.evidence import estimates, is_useful
from model.processing.diagnosis.joint_fit import LEAST_SHARE_LEFT, JointFit, fit_faults, share_left
from model.processing.reconstruction import Design

FloatArray = NDArray[np.float64]

# Correlation of what two causes do to a run, from which they are the same to it.
_SAME = 0.99
# Standard error, as a share of its size, of a fault too large to be undone and fitted about itself, and of others then.
_HARDLY_KNOWN = 0.5


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
    terms = tuple(_term(fit, index) for index in _in_order(fit))
    return Diagnosis(
        terms=terms,
        first=terms[0] if fit.named else None,
        reason="",
        faults=frame_faults(fit.parameters, len(images)),
        light=light,
    )


def _untestable(reason: str, light: float) -> Diagnosis:
    return Diagnosis(terms=(), first=None, reason=reason, faults=None, light=light)


def _in_order(fit: JointFit) -> list[int]:
    return [*fit.named, *(index for index in range(len(fit.evidence.causes)) if index not in fit.named)]


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


def _confused(fit: JointFit, index: int) -> list[Cause]:
    causes = fit.evidence.causes
    if index in fit.named:
        same = fit.stand_ins[index]
    else:
        same = {
            other for other in range(len(causes)) if other != index and fit.weigher.correlation(index, other) > _SAME
        }
    return [causes[other] for other in sorted(same)]
