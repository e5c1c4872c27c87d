"""A gain, or a lamp, that changed half-way through a sweep."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from calibration.estimate import percent_with_error
from calibration.flags import Flag
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.level_influence import LightInfluence
from calibration.sensor.level_names import describe_level
from calibration.sensor.outlying_points import PointInfluence

FloatArray = NDArray[np.float64]

_FALSE = 1e-3
# On either side of a step, so that it is none of single levels.
_LEAST_LEVELS = 3
_LEAST_FREEDOM = 3
# Chi-squared per degree of freedom that curve and step may leave.
_EXPLAINED = 4.0
# Smaller steps of the noise are left to its scatter.
_LEAST_STEP = 0.01
_SIGMA = 3.0


@dataclass(frozen=True, kw_only=True)
class Step:
    """A step of points that otherwise follow a smooth curve.

    Attributes
    ----------
    place : int
        First point behind it.
    relative, std_error : float
        Its height over the shape of a step, and its standard error.
    is_real : bool
        Higher than chance makes in the stated share of sets.
    """

    place: int
    relative: float
    std_error: float
    is_real: bool

    @property
    def height(self) -> str:
        """Height with its error, in percent."""
        return percent_with_error(self.relative, self.std_error)


def largest_step(
    design: FloatArray,
    values: FloatArray,
    variance: FloatArray,
    *,
    shape: FloatArray,
    least_share: float = 1.0,
    place: int | None = None,
) -> Step | None:
    """Return the step that explains most of what points are off a smooth curve by; None with too few points.

    Parameters
    ----------
    design : (n, p) array
        Columns of the smooth curve.
    values, variance : (n,) arrays
        Points in the order in which a step may have come, and the variance of each.
    shape : (n,) array
        What a step of 1 adds to the points behind it.
    least_share : float
        Share of the variances that is sampling, within (0, 1]; the rest may be the step itself.
    place : int or None
        Where the step is; None looks for it.

    Notes
    -----
    Each step is one more column of the linear model, and what it takes off chi-squared is known in closed form. The
    errors are by the scatter about curve and step, never less than by sampling.
    """
    n, n_terms = design.shape
    freedom = n - n_terms - 1
    places = range(_LEAST_LEVELS, n - _LEAST_LEVELS + 1) if place is None else range(place, place + 1)
    if freedom < _LEAST_FREEDOM or not len(places) or places[-1] >= n:
        return None
    root = 1.0 / np.sqrt(variance)
    basis = np.linalg.qr(design * root[:, None])[0]
    residual = values * root - basis @ (basis.T @ (values * root))
    steps = np.array([np.where(np.arange(n) >= at, shape, 0.0) * root for at in places])
    free = steps - (steps @ basis) @ basis.T
    norm = np.sum(np.square(free), axis=1)
    height = (free @ residual) / norm
    best = int(np.argmax(np.square(height) * norm))
    left = float(residual @ residual - height[best] ** 2 * norm[best])
    error = float(np.sqrt(max(left / freedom, least_share) / norm[best]))
    limit = -stdtrit(freedom, 0.5 * _FALSE / len(places))
    return Step(
        place=places[best],
        relative=float(height[best]),
        std_error=error,
        is_real=bool(abs(height[best]) > limit * error and left < _EXPLAINED * freedom),
    )


@dataclass(frozen=True, kw_only=True)
class GainChange:
    """A change of gain or lamp during the sweep.

    Attributes
    ----------
    by_noise, by_light, by_dark : Step or None
        The step of the variance against the mean, of the mean against the light, and of the variance of darks.
    gain_error : float
        Relative error that the gain has from it.
    """

    by_noise: Step | None
    by_light: Step | None
    by_dark: Step | None
    gain_error: float

    @property
    def is_of_gain(self) -> bool:
        """True where the noise itself shows it, that of flats or that of darks together with the light."""
        return is_large(self.by_noise) or (is_large(self.by_dark) and is_large(self.by_light))


def is_large(step: Step | None) -> bool:
    """Return whether there is a step, and a larger one than a lamp or a bend makes.

    Parameters
    ----------
    step : Step or None
        None where it is not known.
    """
    return step is not None and step.is_real and abs(step.relative) > _LEAST_STEP


def gain_change(
    noise: PointInfluence | None, light: LightInfluence | None, *, by_dark: Step | None
) -> GainChange | None:
    """Return the change of gain or lamp between two halves of a sweep, None where there is none.

    Parameters
    ----------
    noise : PointInfluence or None
        Variance against mean.
    light : LightInfluence or None
        Mean against light.
    by_dark : Step or None
        The largest step of the temporal variance of darks against their exposure.

    Notes
    -----
    Another gain changes mean over light and variance over mean by the same share, another light the first alone. Where
    the noise is too coarse to tell, the gain is uncertain by all that the light changed.
    """
    by_noise = None if noise is None else _step(noise, terms=2)
    by_light = None if light is None else _step(light.points, terms=3)
    if by_noise is not None and is_large(by_noise) and not _denied(by_noise, light):
        return GainChange(by_noise=by_noise, by_light=by_light, by_dark=by_dark, gain_error=abs(by_noise.relative))
    if by_light is None or not by_light.is_real or noise is None:
        return None
    there = _step(noise, terms=2, place=by_light.place)
    tells = there is not None and abs(there.relative - by_light.relative) > _SIGMA * there.std_error
    return GainChange(
        by_noise=there,
        by_light=by_light,
        by_dark=by_dark,
        gain_error=0.0 if tells else abs(by_light.relative),
    )


def _denied(by_noise: Step, light: LightInfluence | None) -> bool:
    """Return whether the mean over light shows no such step where the noise has one: a gain changes both."""
    there = None if light is None else _step(light.points, terms=3, place=by_noise.place)
    if there is None:
        return False
    apart = abs(there.relative - by_noise.relative)
    return apart > _SIGMA * float(np.hypot(there.std_error, by_noise.std_error))


def _step(points: PointInfluence, *, terms: int, place: int | None = None) -> Step | None:
    scaled = points.abscissa / points.abscissa.max()
    design = np.column_stack([scaled**power for power in range(1, terms + 1)])
    # Where single levels stand off, the scatter is that of the others, and no step explains them.
    variance = points.variance + np.square(points.scatter * points.model.scatter_shape)
    least = float(np.median(points.variance / variance))
    # Single points are noisy at faint levels, and a step of their own size would find itself there.
    shape = np.abs(points.abscissa * np.median(points.values / points.abscissa))
    return largest_step(design, points.values, variance, shape=shape, least_share=least, place=place)


def change_flag(change: GainChange, levels: Sequence[LevelStatistics]) -> Flag:
    """Return what is to be said of a change; it refuses the set where it is one of the gain.

    Parameters
    ----------
    change : GainChange
        The change.
    levels : sequence of LevelStatistics
        The levels that it was found in.
    """
    noise, light = change.by_noise, change.by_light
    of_noise = (
        "" if noise is None else f"variance over mean changes by {percent_with_error(noise.relative, noise.std_error)}"
    )
    of_light = "" if light is None else f"mean over light by {percent_with_error(light.relative, light.std_error)}"
    step = noise if is_large(noise) else light
    if change.is_of_gain and step is not None:
        found = [text for text in (of_noise, of_light) if text]
        if is_large(change.by_dark) and change.by_dark is not None:
            found.append(f"the variance of darks by {change.by_dark.height}")
        return Flag(
            name="gain_changed",
            message=f"from {describe_level(levels[step.place])} on {', '.join(found)} in one step"
            ": the gain of the camera changed during the sweep, and there is no single gain: keep automatic gain off "
            "and take all levels again",
            refuses=True,
        )
    where = describe_level(levels[light.place]) if light else ""
    verdict = (
        "the lamp changed; gain and noise stand, linearity is not known"
        if change.gain_error == 0.0
        else "lamp or gain changed, and the noise is too coarse to tell which: the error of the gain holds it, "
        "linearity is not known; take larger frames or more of them, with automatic gain off"
    )
    return Flag(
        name="light_or_gain_changed",
        message=f"from {where} on {of_light} in one step ({of_noise}): {verdict}",
    )
