"""Line integrals along the borders of DoLP cones: where to put the panels, and which form to integrate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.processing.dolp_cone import Border, Directions, beyond, density, directions, nearness, within
from model.quadrature import integrate_panels

FloatArray = NDArray[np.float64]

_TOLERANCE = 1e-12
# From this distance (half its square) of the border from the mean on, the tail form is the smooth one.
_CLOSE = 0.5
_COARSE = np.linspace(-np.pi, np.pi, 33)
_GRADED = np.pi * 4.0 ** -np.arange(1.0, 23.0)


@dataclass(frozen=True, kw_only=True)
class BorderIntegrals:
    """Integrals along M borders, each of shape (M,).

    Parameters
    ----------
    turn
        1/(2 pi) integral of H dphi where `close`, of Hc dphi elsewhere.
    turn_size
        The same of the absolute value: cancellation is measured against it.
    density
        Density of DoLP (or of its inverse, where the border has b = 1) with S0 > 0.
    close
        Where the border passes within one standard deviation of the mean.
    """

    turn: FloatArray
    turn_size: FloatArray
    density: FloatArray
    close: NDArray[np.bool_]


def border_integrals(border: Border) -> BorderIntegrals:
    """Return the integrals along the borders of cones.

    Parameters
    ----------
    border
        M borders with radius_1 > 0.

    Returns
    -------
    BorderIntegrals
        To about 1e-12 of the integral of the absolute value, or the rounding of the covariance's thinnest axis.
    """
    place, width, lowest = _nearest_points(border)
    close = lowest < _CLOSE

    def integrand(index: NDArray[np.int64], offset: FloatArray) -> FloatArray:
        part = border[index]
        d = directions(part, offset)
        return np.stack([_turn(d, close[index]), density(part, d)])

    found = integrate_panels(integrand, cuts=_cuts(place, width), tolerance=_TOLERANCE, noise=_rounding_noise(border))
    turn, turn_size = found.value[:, 0] / (2.0 * np.pi), found.size[:, 0] / (2.0 * np.pi)
    return BorderIntegrals(turn=turn, turn_size=turn_size, density=found.value[:, 1], close=close)


def _turn(d: Directions, close: NDArray[np.bool_]) -> FloatArray:
    probability = beyond(d)
    probability[close] = within(_rows(d, close))
    return np.asarray(probability * d.turning)


def _rows(d: Directions, index: NDArray[np.bool_]) -> Directions:
    return Directions(**{name: getattr(d, name)[index] for name in d.__dataclass_fields__})


def _rounding_noise(border: Border) -> FloatArray:
    """Return the relative rounding error of the integrands: it grows with the thinness of the covariance."""
    f = border.frame
    span = (border.b * f.sigma_0 + border.a * np.hypot(f.slope_1, f.slope_2)) / np.hypot(border.a, border.b)
    ratio = span / np.maximum(f.radius_2, 1e-300)
    return np.asarray(1e-15 * (1.0 + np.minimum(ratio, 1e6)))


def _nearest_points(border: Border) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the two places of a border that come nearest to the mean, their widths, and the least half square."""
    grid = _starting_grid(border)
    values = nearness(directions(border, grid))
    place, reach = _two_minima(grid, values)
    for _ in range(10):
        place, reach = _refined(border, place, reach)
    at_place = nearness(directions(border, place))
    return place, _widths(border, place, at_place), np.min(at_place, axis=1)


def _starting_grid(border: Border) -> FloatArray:
    """Return offsets over the full turn, graded towards the mean and towards the thin ends of the ellipse."""
    f = border.frame
    angle = np.arctan2(f.mean_2, f.mean_1)
    centres = np.stack([np.zeros_like(angle), -angle, np.pi - angle], axis=1)
    graded = np.concatenate([-_GRADED, [0.0], _GRADED])
    around = (centres[:, :, None] + graded).reshape(angle.size, -1)
    wrapped = np.where(np.abs(around) > np.pi, np.remainder(around + np.pi, 2.0 * np.pi) - np.pi, around)
    uniform = np.broadcast_to(_COARSE, (angle.size, _COARSE.size))
    return np.sort(np.concatenate([wrapped, uniform], axis=1), axis=1)


def _two_minima(grid: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the places of the two lowest local minima on a circular grid, and their distance to the next points."""
    lower = (values <= np.roll(values, 1, axis=1)) & (values <= np.roll(values, -1, axis=1))
    ranked = np.argsort(np.where(lower, values, np.inf), axis=1, kind="stable")
    first = ranked[:, :1]
    apart = np.abs(np.arange(grid.shape[1]) - first) > 1
    second = np.argmin(np.where(lower & apart, values, np.inf), axis=1)[:, None]
    index = np.concatenate([first, second], axis=1)
    place = np.take_along_axis(grid, index, axis=1)
    after = np.take_along_axis(grid, np.minimum(index + 1, grid.shape[1] - 1), axis=1) - place
    before = place - np.take_along_axis(grid, np.maximum(index - 1, 0), axis=1)
    return place, np.maximum(after, before)


def _refined(border: Border, place: FloatArray, reach: FloatArray) -> tuple[FloatArray, FloatArray]:
    steps = np.linspace(-1.0, 1.0, 17)
    points = place[:, :, None] + reach[:, :, None] * steps
    values = nearness(directions(border, points.reshape(len(border.frame), -1))).reshape(points.shape)
    best = np.argmin(values, axis=2)[..., None]
    return np.take_along_axis(points, best, axis=2)[..., 0], 0.25 * reach


def _widths(border: Border, place: FloatArray, lowest: FloatArray) -> FloatArray:
    """Return the smallest distance from each place at which the integrand has fallen by about e^-1/2."""
    steps = np.concatenate([[np.pi], _GRADED])[::-1]
    signed = np.concatenate([steps, -steps])
    points = (place[:, :, None] + signed).reshape(len(border.frame), -1)
    values = nearness(directions(border, points)).reshape(*place.shape, 2, steps.size)
    fallen = np.any(values > lowest[:, :, None, None] + 0.5, axis=2)
    fallen[..., -1] = True
    return np.asarray(steps[np.argmax(fallen, axis=-1)])


def _cuts(place: FloatArray, width: FloatArray) -> FloatArray:
    """Return panel ends: the full turn, graded by factors of 8 around both places."""
    growth = np.concatenate([[0.25, 1.0, 3.0], 8.0 ** np.arange(1.0, 17.0)])
    distance = np.minimum(width[:, :, None] * growth, np.pi)
    near = np.concatenate([place[:, :, None] - distance, place[:, :, None], place[:, :, None] + distance], axis=2)
    flat = near.reshape(place.shape[0], -1)
    wrapped = np.where(np.abs(flat) > np.pi, np.remainder(flat + np.pi, 2.0 * np.pi) - np.pi, flat)
    uniform = np.broadcast_to(_COARSE[::8], (place.shape[0], _COARSE[::8].size))
    return np.sort(np.concatenate([wrapped, uniform], axis=1), axis=1)
