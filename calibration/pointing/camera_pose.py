"""Direction in which a camera looks, from several sources at once.

Axes of the world are east, north, up; those of the camera right, down, forward. The camera looks toward `azimuth_rad`,
clockwise from north, `elevation_rad` above the horizon, rolled by `roll_rad` counter-clockwise as it sees the scene.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

FloatArray = NDArray[np.float64]

# What is known of elevation and roll where no source says anything: they are between the poles.
_PRIOR_STD_RAD = np.radians([3600.0, 60.0, 60.0])
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
        The same to the covariance of that, (k, k).
    """

    name: str
    residual: Callable[[FloatArray], FloatArray]
    covariance: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class Contradiction:
    """A source that lies farther from the others than their errors allow."""

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
    chi_square, freedom : float, int
        Of the sources about it.
    contradictions : tuple of Contradiction
        Sources that the others exclude.
    """

    angles_rad: FloatArray
    covariance: FloatArray
    chi_square: float
    freedom: int
    contradictions: tuple[Contradiction, ...]

    @property
    def std_rad(self) -> FloatArray:
        """Standard uncertainties of azimuth, elevation and roll [rad]."""
        return np.sqrt(np.diag(self.covariance))


def camera_axes(angles_rad: FloatArray) -> FloatArray:
    """Return right, down and forward of a camera as rows, in east, north, up: turns world into camera."""
    (sin_a, sin_e, sin_r), (cos_a, cos_e, cos_r) = np.sin(angles_rad).tolist(), np.cos(angles_rad).tolist()
    level, down = np.array([cos_a, -sin_a, 0.0]), np.array([sin_e * sin_a, sin_e * cos_a, -cos_e])
    forward = (sin_a * cos_e, cos_a * cos_e, sin_e)
    return np.array([cos_r * level - sin_r * down, sin_r * level + cos_r * down, forward])


def direction(azimuth_rad: float, elevation_rad: float) -> FloatArray:
    """Return the unit vector of a direction in east, north, up."""
    level = np.cos(elevation_rad)
    return np.array([np.sin(azimuth_rad) * level, np.cos(azimuth_rad) * level, np.sin(elevation_rad)])


def wrapped_rad(angle_rad: FloatArray) -> FloatArray:
    """Return angles on the turn about 0."""
    return np.asarray((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)


def refraction_rad(elevation_rad: float) -> float:
    """Return by how much air lifts the sun at a geometric elevation, standard pressure (Saemundsson 1986) [rad]."""
    degrees = max(np.degrees(elevation_rad), -0.5)
    return float(np.radians(1.02 / 60.0 / np.tan(np.radians(degrees + 10.3 / (degrees + 5.11)))))


def fuse(sources: Sequence[PoseSource]) -> CameraPose:
    """Return the direction that fits all sources best, by weighted least squares.

    Parameters
    ----------
    sources : sequence of PoseSource
        Independent of one another; one at least.

    Notes
    -----
    Each source is held against the others alone as well: what lies farther from them than once in a thousand times
    contradicts. Where sources contradict, the covariance is widened by chi-square over its degrees of freedom.
    """
    angles, covariance, chi_square = _fit(sources)
    freedom = max(sum(len(one.residual(angles)) for one in sources) - _determined(covariance), 0)
    contradictions = tuple(found for one in sources if (found := _contradiction(one, sources, angles)) is not None)
    if contradictions and freedom:
        covariance = covariance * max(1.0, chi_square / freedom)
    return CameraPose(
        angles_rad=angles,
        covariance=covariance,
        chi_square=chi_square,
        freedom=freedom,
        contradictions=contradictions,
    )


def _determined(covariance: FloatArray) -> int:
    return int(np.sum(np.sqrt(np.diag(covariance)) < UNKNOWN_STD_RAD))


def _contradiction(source: PoseSource, sources: Sequence[PoseSource], near: FloatArray) -> Contradiction | None:
    others = [one for one in sources if one is not source]
    if not others:
        return None
    angles, covariance, _ = _fit(others, near)
    residual, slope = source.residual(angles), _slope(source, angles)
    by_others = slope @ covariance @ slope.T
    if float(np.sqrt(np.diag(by_others).max())) > UNKNOWN_STD_RAD:  # they say nothing of it
        return None
    spread = source.covariance(angles) + by_others
    chi_square = float(residual @ np.linalg.solve(spread, residual))
    p_value = float(gammaincc(0.5 * len(residual), 0.5 * chi_square))
    return Contradiction(name=source.name, chi_square=chi_square, p_value=p_value) if p_value < _RARE else None


def _fit(sources: Sequence[PoseSource], near: FloatArray | None = None) -> tuple[FloatArray, FloatArray, float]:
    grid = [np.array([2.0 * np.pi * k / _STARTS, e, 0.0]) for k in range(_STARTS) for e in (-0.6, 0.3)]
    grid.sort(key=lambda angles: _unlikely(sources, angles))
    starts = grid[:_DESCENTS] if near is None else [near, *grid[:1]]
    return min((_descend(sources, start) for start in starts), key=lambda found: _unlikely(sources, found[0]))


def _unlikely(sources: Sequence[PoseSource], angles: FloatArray) -> float:
    """Return minus twice the logarithm of the likelihood, so that a source is not heeded less by being vaguer."""
    spreads = (one.covariance(angles) for one in sources)
    return _cost(sources, angles, _weights(sources, angles)) + sum(float(np.linalg.slogdet(c)[1]) for c in spreads)


def _descend(sources: Sequence[PoseSource], start: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return angles, covariance and chi-square by damped Gauss-Newton steps from a start, weights renewed each time."""
    angles, damping = start.copy(), 1e-3
    for _ in range(_ITERATIONS):
        weights = _weights(sources, angles)
        normal, gradient = _normal(sources, angles, weights)
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
        tried = angles - step
        tried[1] = np.clip(tried[1], -0.499 * np.pi, 0.499 * np.pi)
        if _cost(sources, tried, weights) <= _cost(sources, angles, weights):
            angles, damping = tried, max(0.1 * damping, 1e-12)
            if float(np.abs(step).max()) < _SMALL_RAD:
                break
        elif float(np.abs(step).max()) < _SMALL_RAD or damping > _MOST_DAMPING:
            break
        else:
            damping *= 10.0
    weights = _weights(sources, angles)
    normal, _ = _normal(sources, angles, weights)
    angles = np.array([angles[0] % (2.0 * np.pi), angles[1], wrapped_rad(angles[2:])[0]])
    residuals = (one.residual(angles) for one in sources)
    chi_square = float(sum(float(r @ w @ r) for r, w in zip(residuals, weights, strict=True)))
    return angles, np.asarray(np.linalg.inv(normal), dtype=np.float64), chi_square


def _weights(sources: Sequence[PoseSource], angles: FloatArray) -> list[FloatArray]:
    return [np.asarray(np.linalg.inv(one.covariance(angles)), dtype=np.float64) for one in sources]


def _prior(angles: FloatArray) -> FloatArray:
    return np.array([0.0, angles[1], wrapped_rad(angles[2:])[0]]) / _PRIOR_STD_RAD


def _cost(sources: Sequence[PoseSource], angles: FloatArray, weights: Sequence[FloatArray]) -> float:
    residuals = (one.residual(angles) for one in sources)
    prior = _prior(angles)
    return float(prior @ prior) + sum(float(r @ w @ r) for r, w in zip(residuals, weights, strict=True))


def _normal(
    sources: Sequence[PoseSource], angles: FloatArray, weights: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    normal, gradient = np.diag(1.0 / _PRIOR_STD_RAD**2), _prior(angles) / _PRIOR_STD_RAD
    for one, weight in zip(sources, weights, strict=True):
        slope = _slope(one, angles)
        normal = normal + slope.T @ weight @ slope
        gradient = gradient + slope.T @ weight @ one.residual(angles)
    return normal, gradient


def _slope(source: PoseSource, angles: FloatArray) -> FloatArray:
    steps = _STEP_RAD * np.eye(3)
    return np.column_stack(
        [(source.residual(angles + step) - source.residual(angles - step)) / (2.0 * _STEP_RAD) for step in steps]
    )
