"""Field of view: tiles of the focal plane, each with its own view of level ground."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from model import geometry
from model.quadrature import gauss_legendre
from model.scene.view import View

FloatArray = NDArray[np.float64]
TileRule = Literal["gauss-legendre", "midpoint"]
TILE_RULES: tuple[TileRule, ...] = get_args(TileRule)

# Tangent of the angle from the axis beyond which a field is wide.
_WIDE = 1.0


@dataclass(frozen=True, kw_only=True)
class FieldPart:
    """A rectangle of the focal plane by the angles of its edges from the camera's axis.

    Attributes
    ----------
    left_rad, right_rad
        To the right as the camera sees it [rad], left below right.
    bottom_rad, top_rad
        Upward [rad], bottom below top.

    Raises
    ------
    ValueError
        The edges are in the wrong order, or a right angle or more from the axis.
    """

    left_rad: float
    right_rad: float
    bottom_rad: float
    top_rad: float

    def __post_init__(self) -> None:
        for name, low, high in (
            ("left and right", self.left_rad, self.right_rad),
            ("bottom and top", self.bottom_rad, self.top_rad),
        ):
            if not -0.5 * np.pi < low < high < 0.5 * np.pi:
                raise ValueError(
                    f"field of view: {name} are {np.degrees(low):.6g} and {np.degrees(high):.6g} deg, but they must "
                    "rise and lie within 90 deg of the axis"
                )


def whole_field(*, width_rad: float, height_rad: float) -> FieldPart:
    """Return the part that is the whole field, even about the axis.

    Parameters
    ----------
    width_rad, height_rad
        Full angles, above 0 and below pi [rad].

    Raises
    ------
    ValueError
        An angle is outside its range.
    """
    return FieldPart(
        left_rad=-0.5 * width_rad, right_rad=0.5 * width_rad, bottom_rad=-0.5 * height_rad, top_rad=0.5 * height_rad
    )


def part_of_picture(
    *,
    left_pixel: float,
    right_pixel: float,
    top_pixel: float,
    bottom_pixel: float,
    picture: tuple[int, int],
    pixel_pitch_m: float,
    focal_length_m: float,
) -> FieldPart:
    """Return the part of the field that a rectangle of the picture shows, through a lens without distortion.

    Parameters
    ----------
    left_pixel, right_pixel, top_pixel, bottom_pixel
        Outer edges of the rectangle: x runs right, y down, (0, 0) is the centre of the top left pixel.
    picture
        Columns and rows; the axis meets the middle.
    pixel_pitch_m
        Side of a pixel [m].
    focal_length_m
        Of the lens [m].

    Raises
    ------
    ValueError
        The edges are in the wrong order.
    """
    columns, rows = picture
    scale = pixel_pitch_m / focal_length_m
    left, right = (np.arctan((x - 0.5 * (columns - 1)) * scale) for x in (left_pixel, right_pixel))
    bottom, top = (np.arctan((0.5 * (rows - 1) - y) * scale) for y in (bottom_pixel, top_pixel))
    return FieldPart(left_rad=float(left), right_rad=float(right), bottom_rad=float(bottom), top_rad=float(top))


@dataclass(frozen=True, kw_only=True)
class Tile:
    """One tile: how its ground sees the camera, and its share of the field."""

    view: View
    weight: float


def tiles(part: FieldPart, view: View, *, per_side: int, rule: TileRule = "gauss-legendre") -> tuple[Tile, ...]:
    """Return the tiles of a part of the focal plane, each with the view of the level ground behind it.

    Parameters
    ----------
    view
        Of the camera's axis.
    per_side
        Tiles along each side, 1 or more.
    rule
        "gauss-legendre", or "midpoint" as the paper has it.

    Raises
    ------
    ValueError
        A tile looks above the horizon, or an argument is outside its range.

    Notes
    -----
    Tiles are even in the focal plane, that is in the tangent of the angle from the axis; where a field reaches farther
    than 45 deg from the axis, those of "gauss-legendre" are even in the logarithm of the tangent far out. The ground
    is level and the sun so far that it is in the same place for all tiles. Each tile's roll makes its frame that of the
    camera, whose polarizer stands in one place for all of them.

    References
    ----------
    [MK14] Fig. 3, eq. (8).
    """
    if per_side < 1:
        raise ValueError(f"field of view: {per_side} tiles per side, allowed is 1 or more")
    right, across = _along(float(np.tan(part.left_rad)), float(np.tan(part.right_rad)), per_side, rule)
    up, upward = _along(float(np.tan(part.bottom_rad)), float(np.tan(part.top_rad)), per_side, rule)
    views = views_off_axis(view, right=np.tile(right, per_side), up=np.repeat(up, per_side))
    weights = np.outer(upward, across).ravel().tolist()
    return tuple(Tile(view=one, weight=weight) for one, weight in zip(views, weights, strict=True))


def _along(low: float, high: float, per_side: int, rule: TileRule) -> tuple[FloatArray, FloatArray]:
    """Tangents of the tiles along one side, and weights that sum to 1."""
    nodes, weights = _nodes(per_side, rule)
    if rule != "gauss-legendre" or max(-low, high) <= _WIDE:
        return low + nodes * (high - low), weights
    # In the tangent, light has singularities at +-i, near to a wide field; with tangent = sinh(u) they are far from it.
    start, stop = np.arcsinh(low), np.arcsinh(high)
    spread = start + nodes * (stop - start)
    stretched = weights * np.cosh(spread)
    return np.sinh(spread), stretched / np.sum(stretched)


def middle(part: FieldPart) -> tuple[float, float]:
    """Return the tangents of the angles from the axis to the middle of a part of the field, to the right and up.

    Parameters
    ----------
    part
        Limits of the part as angles from the axis [rad].
    """
    across, upward = (
        0.5 * float(np.tan(low) + np.tan(high))
        for low, high in ((part.left_rad, part.right_rad), (part.bottom_rad, part.top_rad))
    )
    return across, upward


def half_diagonal_rad(part: FieldPart) -> float:
    """Return half of the angle between opposite corners of a part, as in a plane [rad].

    Parameters
    ----------
    part
        Limits of the part as angles from the axis [rad].
    """
    return 0.5 * float(np.hypot(part.right_rad - part.left_rad, part.top_rad - part.bottom_rad))


def off_axis(view: View, *, right: float, up: float) -> View:
    """Return the view of the ground that a camera sees beside its axis.

    Parameters
    ----------
    view
        Of the axis.
    right, up
        Tangents of the angles from the axis, as the camera sees them.

    Raises
    ------
    ValueError
        That line of sight does not meet the ground.
    """
    return views_off_axis(view, right=np.array([right]), up=np.array([up]))[0]


def views_off_axis(view: View, *, right: FloatArray, up: FloatArray) -> tuple[View, ...]:
    """Return what `off_axis` does for each of several lines of sight.

    Parameters
    ----------
    view
        Of the axis.
    right, up
        Shape (K,).

    Raises
    ------
    ValueError
        As `off_axis`.
    """
    toward = geometry.direction(zenith_rad=view.zenith_rad, azimuth_rad=view.azimuth_rad)
    level = geometry.horizontal_axis(view.azimuth_rad, travels_to_target=False)
    upright = np.cross(toward, level)
    camera_right = np.cos(view.roll_rad) * level + np.sin(view.roll_rad) * upright
    camera_up = np.cross(toward, camera_right)
    back = toward - right[:, np.newaxis] * camera_right - up[:, np.newaxis] * camera_up
    back = back / np.linalg.norm(back, axis=-1, keepdims=True)
    _require_ground(view, back, up)
    azimuth = np.where(np.hypot(back[:, 0], back[:, 1]) > 0.0, np.arctan2(back[:, 0], back[:, 1]), view.azimuth_rad)
    seen_right = camera_right - (back @ camera_right)[:, np.newaxis] * back
    own_level = geometry.horizontal_axis(azimuth, travels_to_target=False)
    seen_right = seen_right / np.linalg.norm(seen_right, axis=-1, keepdims=True)
    roll = geometry.axis_rotation_rad(own_level, seen_right, travel=back)
    zenith = geometry.angle_between_rad(back, np.array([0.0, 0.0, 1.0]))
    return tuple(
        replace(view, zenith_rad=one, azimuth_rad=around, roll_rad=turn)
        for one, around, turn in zip(zenith.tolist(), azimuth.tolist(), roll.tolist(), strict=True)
    )


def _require_ground(view: View, back: FloatArray, up: FloatArray) -> None:
    above = back[:, 2] <= 0.0
    if np.any(above):
        raise ValueError(
            f"field of view: it reaches above the horizon ({np.degrees(np.arctan(up[above][0])):.4g} deg above the "
            f"axis, which is {np.degrees(view.zenith_rad):.4g} deg from straight down)"
        )


def _nodes(per_side: int, rule: TileRule) -> tuple[FloatArray, FloatArray]:
    """Nodes in (0, 1) and weights that sum to 1."""
    if rule == "gauss-legendre":
        return gauss_legendre(per_side)
    if rule != "midpoint":
        raise ValueError(f"field of view: rule = {rule!r}; allowed are {', '.join(map(repr, TILE_RULES))}")
    return (np.arange(per_side) + 0.5) / per_side, np.full(per_side, 1.0 / per_side)
