"""Line integrals along the borders of DoLP cones: where to put the panels, and which form to integrate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.processing.dolp_distribution.cone import Border, Directions, beyond, density, directions, nearness, within
from model.quadrature import integrate_panels

FloatArray = NDArray[np.float64]

_TOLERANCE = 1e-12
# From this distance (half its square) of the border from the mean on, the tail form is the smooth one.
_CLOSE = 0.5
_COARSE = np.linspace(-np.pi, np.pi, 33)
_GRADED = np.pi * 8.0 ** -np.arange(1.0, 16.0)
_HALF_WIDTHS = np.pi * 4.0 ** np.arange(-22.0, 1.0)
_CLOSELY_GRADED = np.pi * 1.5 ** -np.arange(1.0, 61.0)
# Height of the barrier between two peaks, as an exponent, below which they count as one.
_MERGED = 0.05
_STEPS = np.linspace(-1.0, 1.0, 9)
_REFINEMENTS = 10


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
    """Return the two places of a border that come nearest to the mean, their widths, and the least half square.

    The second is looked for on a grid graded towards the first: where a thin ellipse touches the border from
    within, the two lie as close together as the ellipse is thin.
    """
    grid = _starting_grid(border)
    first, reach = _lowest(grid, nearness(directions(border, grid)))
    first = _refined(border, first, reach)
    away = np.sort(
        np.concatenate([_turned_back(grid - first[:, None]), _close_grid(len(border.frame))], axis=1), axis=1
    )
    values = nearness(directions(border, first[:, None] + away))
    second, reach = _lowest(away, np.where(_barrier(away, values) > values + _MERGED, values, np.inf))
    second = _refined(border, first + second, np.minimum(reach, 0.5 * np.abs(second)))
    place = np.stack([first, second], axis=1)
    at_place = nearness(directions(border, place))
    return place, _widths(border, place, at_place), np.min(at_place, axis=1)


def _starting_grid(border: Border) -> FloatArray:
    """Return offsets over the full turn, graded towards every place where a narrow peak can be.

    That is the mean; the thin ends of the ellipse of (S1, S2) given S0; and where the long axis of the whole
    ellipsoid meets the border, for a covariance like a needle.
    """
    f = border.frame
    angle = np.arctan2(f.mean_2, f.mean_1)
    axis = [place - angle for place in _needle_ends(border)]
    centres = np.stack([np.zeros_like(angle), -angle, np.pi - angle, *axis], axis=1)
    graded = np.concatenate([-_GRADED, [0.0], _GRADED])
    around = (centres[:, :, None] + graded).reshape(angle.size, -1)
    uniform = np.broadcast_to(_COARSE, (angle.size, _COARSE.size))
    return np.sort(np.concatenate([_turned_back(around), uniform], axis=1), axis=1)


def _needle_ends(border: Border) -> tuple[FloatArray, FloatArray]:
    """Return beta where the line through the mean along the largest fluctuation meets the cone, or passes closest."""
    f, zero = border.frame, np.zeros_like(border.a)
    columns = [f.sigma_0, zero, zero, f.slope_1, f.radius_1, zero, f.slope_2, zero, f.radius_2]
    factor = np.stack(columns, axis=-1).reshape(-1, 3, 3)
    along_0, along_1, along_2 = np.linalg.svd(factor)[0][:, :, 0].T
    a2, b2 = border.a**2, border.b**2
    square = a2 * (along_1**2 + along_2**2) - b2 * along_0**2
    half = a2 * (f.mean_1 * along_1 + f.mean_2 * along_2) - b2 * f.mean_0 * along_0
    constant = -border.gap * (border.a * f.polarized + border.b * f.mean_0)
    turn = -half - np.copysign(np.sqrt(np.maximum(half**2 - square * constant, 0.0)), half)
    steps = [_ratio(turn, square), _ratio(constant, turn)]
    first, second = (
        np.arctan2(f.mean_2 + step * along_2, f.mean_1 + step * along_1)
        + np.where(f.mean_0 + step * along_0 < 0.0, np.pi, 0.0)
        for step in steps
    )
    return first, second


def _ratio(above: FloatArray, below: FloatArray) -> FloatArray:
    """Return above / below; 0 where the quotient is not finite."""
    tiny = np.abs(below) <= 1e-150 * np.abs(above)
    return np.where(tiny, 0.0, above / np.where(tiny | (below == 0.0), 1.0, below))


def _turned_back(offset: FloatArray) -> FloatArray:
    """Return the same directions with offsets from -pi to pi; those in range keep their digits."""
    return np.where(np.abs(offset) > np.pi, np.remainder(offset + np.pi, 2.0 * np.pi) - np.pi, offset)


def _lowest(grid: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the place of the lowest value on a sorted grid, and its distance to the next points."""
    index, row = np.argmin(values, axis=1), np.arange(grid.shape[0])
    place = grid[row, index]
    after = grid[row, np.minimum(index + 1, grid.shape[1] - 1)] - place
    before = place - grid[row, np.maximum(index - 1, 0)]
    return place, np.maximum(after, before)


def _close_grid(borders: int) -> FloatArray:
    """Return offsets from a place, graded so closely that a second minimum at any distance is not jumped over."""
    return np.broadcast_to(
        np.concatenate([-_CLOSELY_GRADED, [0.0], _CLOSELY_GRADED]), (borders, 2 * _CLOSELY_GRADED.size + 1)
    )


def _barrier(away: FloatArray, values: FloatArray) -> FloatArray:
    """Return the highest value on the way from the place at 0 to each point of a sorted grid."""
    right = np.maximum.accumulate(np.where(away >= 0.0, values, -np.inf), axis=1)
    left = np.maximum.accumulate(np.where(away <= 0.0, values, -np.inf)[:, ::-1], axis=1)[:, ::-1]
    return np.where(away >= 0.0, right, left)


def _refined(border: Border, place: FloatArray, reach: FloatArray) -> FloatArray:
    """Return the lowest place within reach, by grids of which each is four times finer."""
    row = np.arange(place.size)
    for _ in range(_REFINEMENTS):
        points = place[:, None] + reach[:, None] * _STEPS
        place = points[row, np.argmin(nearness(directions(border, points)), axis=1)]
        reach = 0.25 * reach
    return place


def _widths(border: Border, place: FloatArray, lowest: FloatArray) -> FloatArray:
    """Return the smallest distance from each place at which the integrand has fallen by about e^-1/2."""
    signed = np.concatenate([_HALF_WIDTHS, -_HALF_WIDTHS])
    points = (place[:, :, None] + signed).reshape(len(border.frame), -1)
    values = nearness(directions(border, points)).reshape(*place.shape, 2, _HALF_WIDTHS.size)
    fallen = np.any(values > lowest[:, :, None, None] + 0.5, axis=2)
    fallen[..., -1] = True
    return np.asarray(_HALF_WIDTHS[np.argmax(fallen, axis=-1)])


def _cuts(place: FloatArray, width: FloatArray) -> FloatArray:
    """Return panel ends: the full turn, graded by factors of 8 around both places."""
    growth = np.concatenate([[0.25, 1.0, 3.0], 8.0 ** np.arange(1.0, 17.0)])
    distance = np.minimum(width[:, :, None] * growth, np.pi)
    near = np.concatenate([place[:, :, None] - distance, place[:, :, None], place[:, :, None] + distance], axis=2)
    flat = near.reshape(place.shape[0], -1)
    uniform = np.broadcast_to(_COARSE[::8], (place.shape[0], _COARSE[::8].size))
    return np.sort(np.concatenate([_turned_back(flat), uniform], axis=1), axis=1)
