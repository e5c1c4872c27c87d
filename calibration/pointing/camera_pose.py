"""Direction in which a camera looks, from several sources at once.

Axes of the world are east, north, up; those of the camera right, down, forward. The camera looks toward `azimuth_rad`,
clockwise from north, `elevation_rad` above the horizon, rolled by `roll_rad` counter-clockwise as it sees the scene.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.special import gammaincc

FloatArray = NDArray[np.float64]

# What is known of elevation and roll where no source says anything: they are between the poles.
_PRIOR_STD_RAD = np.radians([3600.0, 60.0, 60.0])
# Focal lengths, axis and distortion of a lens.
LENS_NUMBERS = 8
# Beyond this a direction counts as not determined.
UNKNOWN_STD_RAD = float(np.radians(20.0))
_STEP_RAD, _ITERATIONS, _STARTS = 1e-6, 60, 8
_SMALL_RAD, _MOST_DAMPING, _DESCENTS = 1e-7, 1e6, 3
# A source whose distance from the others is as rare as this contradicts them: a choice.
_RARE = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseSource:
    """Something that tells of the camera's direction.

    Attributes
    ----------
    name : str
        What it is, for messages.
    residual : callable
        (azimuth, elevation, roll) [rad] to what was measured less what it would then be, shape (k,).
    covariance : callable
        The same to the covariance of that, (k, k), the errors of the lens apart.
    by_lens : callable or None
        The same to the change of the residual by each number of the lens, (k, 8); None: it needs no lens.
    """

    name: str
    residual: Callable[[FloatArray], FloatArray]
    covariance: Callable[[FloatArray], FloatArray]
    by_lens: Callable[[FloatArray], FloatArray] | None = None


@dataclass(frozen=True, kw_only=True)
class Contradiction:
    """A source that lies farther from the others than their errors allow; or all of them, if none can be told alone."""

    name: str
    chi_square: float
    p_value: float


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraPose:
    """Direction of a camera.

    Attributes
    ----------
    angles_rad : (3,) array
        Azimuth, elevation, roll.
    covariance : (3, 3) array
        Of their errors, widened where the sources contradict one another [rad^2].
    by_lens : (3, 8) array
        Their change by each number of the lens, whose errors panels in the same picture share.
    lens_covariance : (8, 8) array
        Of those numbers.
    chi_square, freedom : float, int
        Of the sources about it.
    contradictions : tuple of Contradiction
        Sources that the others exclude.
    """

    angles_rad: FloatArray
    covariance: FloatArray
    by_lens: FloatArray
    lens_covariance: FloatArray
    chi_square: float
    freedom: int
    contradictions: tuple[Contradiction, ...]

    @property
    def own_covariance(self) -> FloatArray:
        """Covariance of their errors, those by the lens apart [rad^2]."""
        return np.asarray(self.covariance - self.by_lens @ self.lens_covariance @ self.by_lens.T)

    @property
    def std_rad(self) -> FloatArray:
        """Standard uncertainties of azimuth, elevation and roll [rad]."""
        return np.sqrt(np.diag(self.covariance))


def camera_axes(angles_rad: FloatArray) -> FloatArray:
    """Return right, down and forward of a camera as rows, in east, north, up: turns world into camera.

    Parameters
    ----------
    angles_rad
        Azimuth clockwise from north, elevation and roll, shape (3,) [rad].
    """
    (sin_a, sin_e, sin_r), (cos_a, cos_e, cos_r) = np.sin(angles_rad).tolist(), np.cos(angles_rad).tolist()
    level, down = np.array([cos_a, -sin_a, 0.0]), np.array([sin_e * sin_a, sin_e * cos_a, -cos_e])
    forward = (sin_a * cos_e, cos_a * cos_e, sin_e)
    return np.array([cos_r * level - sin_r * down, sin_r * level + cos_r * down, forward])


def direction(azimuth_rad: float, elevation_rad: float) -> FloatArray:
    """Return the unit vector of a direction in east, north, up.

    Parameters
    ----------
    azimuth_rad, elevation_rad
        Clockwise from north, and up from the horizon [rad].
    """
    level = np.cos(elevation_rad)
    return np.array([np.sin(azimuth_rad) * level, np.cos(azimuth_rad) * level, np.sin(elevation_rad)])


def wrapped_rad(angle_rad: FloatArray) -> FloatArray:
    """Return angles on the turn about 0.

    Parameters
    ----------
    angle_rad
        Any shape [rad].
    """
    return np.asarray((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)


def refraction_rad(elevation_rad: float) -> float:
    """Return by how much air lifts the sun at a geometric elevation, standard pressure (Saemundsson 1986) [rad].

    Parameters
    ----------
    elevation_rad
        Geometric elevation [rad]; below -0.5 deg it is taken as there.

    References
    ----------
    Saemundsson, Sky and Telescope 72 (1986) 70.
    """
    degrees = max(np.degrees(elevation_rad), -0.5)
    return float(np.radians(1.02 / 60.0 / np.tan(np.radians(degrees + 10.3 / (degrees + 5.11)))))


def fuse(sources: Sequence[PoseSource], lens_covariance: FloatArray | None = None) -> CameraPose:
    """Return the direction that fits all sources best, by weighted least squares.

    Parameters
    ----------
    sources : sequence of PoseSource
        Independent of one another but for the lens; one at least.
    lens_covariance : (8, 8) array or None
        Of the numbers of the lens that all of them use; None: none uses one, or it is exact.

    Notes
    -----
    Each source is held against the others alone as well: what lies farther from them than once in a thousand times
    contradicts. Sources none of which can be told alone may contradict together. Where
    they contradict, the covariance is widened by chi-square over its degrees of freedom.
    """
    lens = np.zeros((LENS_NUMBERS, LENS_NUMBERS)) if lens_covariance is None else lens_covariance
    fit = _fit(_Together(sources, lens))
    freedom = max(sum(len(one.residual(fit.angles)) for one in sources) - _determined(fit.covariance), 0)
    found = (_contradiction(one, sources, lens, fit.angles) for one in sources)
    contradictions = tuple(one for one in found if one is not None) or _all_of_them(sources, fit.chi_square, freedom)
    wider = max(1.0, fit.chi_square / freedom) if contradictions and freedom else 1.0
    return CameraPose(
        angles_rad=fit.angles,
        covariance=wider * fit.covariance,
        by_lens=fit.by_lens,
        lens_covariance=lens,
        chi_square=fit.chi_square,
        freedom=freedom,
        contradictions=contradictions,
    )


class _Together:
    """Sources as one: their residuals one below the other, with one covariance, as they share the lens."""

    def __init__(self, sources: Sequence[PoseSource], lens_covariance: FloatArray) -> None:
        self._sources, self.lens_covariance = sources, lens_covariance

    def residual(self, angles: FloatArray) -> FloatArray:
        return np.concatenate([one.residual(angles) for one in self._sources])

    def own_covariance(self, angles: FloatArray) -> FloatArray:
        return np.asarray(block_diag(*(one.covariance(angles) for one in self._sources)))

    def by_lens(self, angles: FloatArray) -> FloatArray:
        none = np.zeros(LENS_NUMBERS)
        parts = (
            np.tile(none, (len(one.residual(angles)), 1)) if one.by_lens is None else one.by_lens(angles)
            for one in self._sources
        )
        return np.concatenate(list(parts))

    def covariance(self, angles: FloatArray) -> FloatArray:
        by_lens = self.by_lens(angles)
        return np.asarray(self.own_covariance(angles) + by_lens @ self.lens_covariance @ by_lens.T)

    def slope(self, angles: FloatArray) -> FloatArray:
        steps = _STEP_RAD * np.eye(3)
        sides = [(self.residual(angles + step), self.residual(angles - step)) for step in steps]
        return np.column_stack([(above - below) / (2.0 * _STEP_RAD) for above, below in sides])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """Angles that fit, the covariance of their errors, their change by the lens, and chi-square."""

    angles: FloatArray
    covariance: FloatArray
    by_lens: FloatArray
    chi_square: float


def _determined(covariance: FloatArray) -> int:
    return int(np.sum(np.sqrt(np.diag(covariance)) < UNKNOWN_STD_RAD))


def _contradiction(
    source: PoseSource, sources: Sequence[PoseSource], lens: FloatArray, near: FloatArray
) -> Contradiction | None:
    others = [one for one in sources if one is not source]
    if not others:
        return None
    fit, alone = _fit(_Together(others, lens), near), _Together([source], lens)
    angles = fit.angles
    residual, slope = alone.residual(angles), alone.slope(angles)
    by_others = slope @ fit.covariance @ slope.T
    if float(np.sqrt(np.diag(by_others).max())) > UNKNOWN_STD_RAD:  # they say nothing of it
        return None
    by_lens = alone.by_lens(angles) + slope @ fit.by_lens  # what moves both the same way is no contradiction
    own = fit.covariance - fit.by_lens @ lens @ fit.by_lens.T
    spread = alone.own_covariance(angles) + slope @ own @ slope.T + by_lens @ lens @ by_lens.T
    chi_square = float(residual @ np.linalg.solve(spread, residual))
    p_value = float(gammaincc(0.5 * len(residual), 0.5 * chi_square))
    return Contradiction(name=source.name, chi_square=chi_square, p_value=p_value) if p_value < _RARE else None


def _all_of_them(sources: Sequence[PoseSource], chi_square: float, freedom: int) -> tuple[Contradiction, ...]:
    p_value = float(gammaincc(0.5 * freedom, 0.5 * chi_square)) if freedom else 1.0
    if p_value >= _RARE:
        return ()
    return (Contradiction(name=" and ".join(one.name for one in sources), chi_square=chi_square, p_value=p_value),)


def _fit(together: _Together, near: FloatArray | None = None) -> _Fit:
    grid = [np.array([2.0 * np.pi * k / _STARTS, e, 0.0]) for k in range(_STARTS) for e in (-0.6, 0.3)]
    grid.sort(key=lambda angles: _unlikely(together, angles))
    starts = grid[:_DESCENTS] if near is None else [near, *grid[:1]]
    return min((_descend(together, start) for start in starts), key=lambda found: _unlikely(together, found.angles))


def _unlikely(together: _Together, angles: FloatArray) -> float:
    """Return minus twice the logarithm of the likelihood, so that a source is not heeded less by being vaguer."""
    covariance = together.covariance(angles)
    return _cost(together, angles, _inverse(covariance)) + float(np.linalg.slogdet(covariance)[1])


def _descend(together: _Together, start: FloatArray) -> _Fit:
    """Return what damped Gauss-Newton steps from a start come to, weights renewed each time."""
    angles, damping = start.copy(), 1e-3
    for _ in range(_ITERATIONS):
        weight = _inverse(together.covariance(angles))
        normal, gradient = _normal(together, angles, weight)
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
        tried = angles - step
        tried[1] = np.clip(tried[1], -0.499 * np.pi, 0.499 * np.pi)
        if _cost(together, tried, weight) <= _cost(together, angles, weight):
            angles, damping = tried, max(0.1 * damping, 1e-12)
            if float(np.abs(step).max()) < _SMALL_RAD:
                break
        elif float(np.abs(step).max()) < _SMALL_RAD or damping > _MOST_DAMPING:
            break
        else:
            damping *= 10.0
    return _at_end(together, np.array([angles[0] % (2.0 * np.pi), angles[1], wrapped_rad(angles[2:])[0]]))


def _at_end(together: _Together, angles: FloatArray) -> _Fit:
    weight, residual = _inverse(together.covariance(angles)), together.residual(angles)
    covariance = _inverse(_normal(together, angles, weight)[0])
    return _Fit(
        angles=angles,
        covariance=covariance,
        by_lens=-covariance @ together.slope(angles).T @ weight @ together.by_lens(angles),
        chi_square=float(residual @ weight @ residual),
    )


def _inverse(matrix: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def _prior(angles: FloatArray) -> FloatArray:
    return np.array([0.0, angles[1], wrapped_rad(angles[2:])[0]]) / _PRIOR_STD_RAD


def _cost(together: _Together, angles: FloatArray, weight: FloatArray) -> float:
    residual, prior = together.residual(angles), _prior(angles)
    return float(prior @ prior + residual @ weight @ residual)


def _normal(together: _Together, angles: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    slope = together.slope(angles)
    normal = np.diag(1.0 / _PRIOR_STD_RAD**2) + slope.T @ weight @ slope
    return normal, _prior(angles) / _PRIOR_STD_RAD + slope.T @ weight @ together.residual(angles)
