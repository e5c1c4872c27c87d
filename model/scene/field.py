"""Light of a region over the part of the field of view that it fills.

A wide region is seen at many angles. `light_over_field` looks at its centre and the middles of its edges; where they
differ, the region is cut into tiles, each with its own view of level ground (`tiles`), and mean and covariance over the
pixels are sums over the tiles. `cosine_fourth` is the falloff of a lens toward the corners, `before_lens` the
light of near surroundings that the air mixes into the line of sight.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from math import isqrt
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from model import stokes as geometry
from model.moments import Moments
from model.numerics import gauss_legendre
from model.scene.panel import ApertureLight, Rules, View
from model.scene.sky_light import Illumination
from model.sensor import Imperfections

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
    """One tile: direction of the camera from its ground, and its share of the field."""

    view: View
    weight: float


def tiles(part: FieldPart, view: View, *, per_side: int, rule: TileRule = "gauss-legendre") -> tuple[Tile, ...]:
    """Return the tiles of a part of the focal plane, each with the view of the level ground behind it.

    Tiles are even in the focal plane, that is in the tangent of the angle from the axis; where a field reaches farther
    than 45 deg from the axis, those of "gauss-legendre" are even in the logarithm of the tangent far out. The ground
    is level and the sun so far that it is in the same place for all tiles. Each tile's roll makes its frame that of the
    camera, whose polarizer stands in one place for all of them.

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
    """Return the tangents of the angles from the axis to the middle of a part of the field, to the right and up."""
    across, upward = (
        0.5 * float(np.tan(low) + np.tan(high))
        for low, high in ((part.left_rad, part.right_rad), (part.bottom_rad, part.top_rad))
    )
    return across, upward


def off_axis(view: View, *, right: float, up: float) -> View:
    """Return the view of the ground that a camera sees off its axis."""
    return views_off_axis(view, right=np.array([right]), up=np.array([up]))[0]


def views_off_axis(view: View, *, right: FloatArray, up: FloatArray) -> tuple[View, ...]:
    """Return the result of `off_axis` for several lines of sight."""
    toward = geometry.direction(zenith_rad=view.zenith_rad, azimuth_rad=view.azimuth_rad)
    level = geometry.horizontal_axis(view.azimuth_rad, travels_to_target=False)
    upright = np.cross(toward, level)
    camera_right = np.cos(view.roll_rad) * level + np.sin(view.roll_rad) * upright
    camera_up = np.cross(toward, camera_right)
    back = toward - right[:, np.newaxis] * camera_right - up[:, np.newaxis] * camera_up
    back = back / np.linalg.norm(back, axis=-1, keepdims=True)
    above = back[:, 2] <= 0.0
    if np.any(above):
        raise ValueError(
            f"field of view: it reaches above the horizon ({np.degrees(np.arctan(up[above][0])):.4g} deg above the "
            f"axis, which is {np.degrees(view.zenith_rad):.4g} deg from straight down)"
        )
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


def _nodes(per_side: int, rule: TileRule) -> tuple[FloatArray, FloatArray]:
    """Nodes in (0, 1) and weights that sum to 1."""
    if rule == "gauss-legendre":
        return gauss_legendre(per_side)
    if rule != "midpoint":
        raise ValueError(f"field of view: rule = {rule!r}; allowed are {', '.join(map(repr, TILE_RULES))}")
    return (np.arange(per_side) + 0.5) / per_side, np.full(per_side, 1.0 / per_side)


# cos^4 is smooth: 12 nodes along each side give 1e-12 up to 60 deg from the axis.
_NODES = 24


@dataclass(frozen=True, kw_only=True)
class Falloff:
    """Mean and variance over the pixels of the transmittance of the lens, which is 1 on its axis."""

    mean: float
    var: float


def cosine_fourth(part: FieldPart) -> Falloff:
    """Return mean and variance of cos^4 of the field angle over a rectangle of the focal plane.

    Pixels are even in the tangents x, y of the angles, and cos^4 = 1 / (1 + x^2 + y^2)^2. On a rectangle that holds the
    axis the mean is above 1 - 2 (x^2 + y^2) of its farthest corner, since (1 + t)^-2 >= 1 - 2 t.

    Definition (natural vignetting).
    """
    node, weight = gauss_legendre(_NODES)
    x, y = (
        np.tan(low) + node * (np.tan(high) - np.tan(low))
        for low, high in ((part.left_rad, part.right_rad), (part.bottom_rad, part.top_rad))
    )
    share = 1.0 / (1.0 + x[:, np.newaxis] ** 2 + y[np.newaxis, :] ** 2) ** 2
    mean = float(weight @ share @ weight)
    return Falloff(mean=mean, var=float(weight @ (share - mean) ** 2 @ weight))


Source = Literal["total", "reflected", "reflected_sun", "reflected_sky", "path"]
SOURCES: tuple[Source, ...] = get_args(Source)


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldLight:
    """Light of a region over the part of the field that it fills.

    Attributes
    ----------
    lights, weights
        Of the tiles; the weights sum to 1. One tile where the field is narrow.
    spread
        Standard deviation over the field and shift of its mean from the centre, the larger of both over S0, from five
        directions (centre and middles of the edges); 0 for a point, NaN if not requested.
    finer
        Light by the finest rules of the hemisphere integral, for the tiles on which the rules were chosen.
    """

    lights: tuple[ApertureLight, ...]
    weights: tuple[float, ...]
    spread: float
    finer: Mapping[int, ApertureLight] = field(default_factory=dict)

    @property
    def error(self) -> float:
        """Estimated error of each component of the mean, of the hemisphere integral [W m-2 sr-1]."""
        return float(np.array(self.weights) @ [light.error for light in self.lights])

    @property
    def transmittance(self) -> float:
        """Mean transmittance from the region to the camera."""
        return float(np.array(self.weights) @ [light.transmittance for light in self.lights])

    def mean(self, source: Source = "total") -> FloatArray:
        """Return the mean Stokes radiance of the tiles, shape (3,), [MK14] eq. (8)."""
        return np.asarray(np.array(self.weights) @ self._values(source))

    def with_parts(self, *, skylight: bool, path: bool) -> "FieldLight":
        """Return the same light without the reflected skylight or the light of the path."""
        lights = tuple(one.with_parts(skylight=skylight, path=path) for one in self.lights)
        finer = {place: one.with_parts(skylight=skylight, path=path) for place, one in self.finer.items()}
        return replace(self, lights=lights, finer=finer)

    def moments(
        self,
        source: Source = "total",
        *,
        texture_rms: float = 0.0,
        texture_diagonal: tuple[float, float, float] = (0.0, 0.0, 0.0),
        texture_cov: FloatArray,
    ) -> Moments:
        """Return mean and covariance of the Stokes radiance over the region's pixels.

        Parameters
        ----------
        source
            Which light: all, what the surface reflects, or what the air adds.
        texture_rms
            Relative deviation, from pixel to pixel, of a factor common to all that the surface reflects, >= 0.
        texture_diagonal
            Deviations of S0, S1 and S2 that are independent of one another, each as a share of the reflected S0, >= 0:
            the form of the paper.
        texture_cov
            Further covariance of the surface's texture, shape (3, 3) [(W m-2 sr-1)^2].

        Notes
        -----
        Light of the path has no texture. A common factor has a covariance of rank one, which leaves DoLP alone and
        hides no difference of polarization from a detector; independent deviations do both.

        References
        ----------
        [MK14] eq. (8)-(10). The tiles are nodes of a quadrature: their covariance is divided by 1, not by 1 - 1/K.
        Differs from [MK14]: texture need not be diagonal.
        """
        values, weights = self._values(source), np.array(self.weights)
        mean = weights @ values
        apart = values - mean
        geometry_cov = np.einsum("t,ti,tj->ij", weights, apart, apart)
        if source == "path":
            return Moments(mean=mean, cov=geometry_cov)
        reflected = values if source != "total" else self._values("reflected")
        texture = texture_rms**2 * np.einsum("t,ti,tj->ij", weights, reflected, reflected)
        texture += np.diag(np.square(texture_diagonal)) * float(weights @ reflected[:, 0] ** 2)
        return Moments(mean=mean, cov=geometry_cov + texture + texture_cov)

    def _values(self, source: Source) -> FloatArray:
        """Stokes radiance of each tile, shape (T, 3)."""
        if source not in SOURCES:
            raise ValueError(f"source = {source!r}; allowed are {', '.join(map(repr, SOURCES))}")
        return np.stack([getattr(light, source) for light in self.lights])


def light_over_field(
    lights_at: Callable[[tuple[View, ...], Rules | None], tuple[ApertureLight, ...]],
    *,
    view: View,
    part: FieldPart | None,
    per_side: int,
    rule: TileRule = "gauss-legendre",
    negligible: float = 1e-3,
) -> FieldLight:
    """Return the light of a region over the part of the field that it fills; one tile where that is narrow.

    [MK14] eq. (8), (9). For the decision: differences between the middles of opposite edges (standard deviation of a
    plane), and Simpson's rule (shift of the mean).
    """
    if part is None:
        return FieldLight(lights=lights_at((view,), None), weights=(1.0,), spread=0.0)
    across, upward = middle(part)
    (centre,) = lights_at((off_axis(view, right=across, up=upward),), None)
    edges = [(np.tan(x), upward) for x in (part.left_rad, part.right_rad)]
    edges += [(across, np.tan(y)) for y in (part.bottom_rad, part.top_rad)]
    at_edges = lights_at(tuple(off_axis(view, right=x, up=y) for x, y in edges), centre.rules)
    spread = _spread(centre.total, [light.total for light in at_edges])
    if spread < negligible:
        return FieldLight(lights=(centre,), weights=(1.0,), spread=spread)
    found = tiles(part, view, per_side=per_side, rule=rule)
    return FieldLight(
        lights=lights_at(tuple(tile.view for tile in found), centre.rules),
        weights=tuple(tile.weight for tile in found),
        spread=spread,
    )


def lights_over_tiles(
    lights_at: Callable[[tuple[View, ...], Rules | None], tuple[ApertureLight, ...]],
    *,
    fields: Sequence[tuple[View, FieldPart | None]],
    per_side: int,
    rule: TileRule = "gauss-legendre",
) -> tuple[FieldLight, ...]:
    """Return the light of a region seen from several places, with rules that suffice in all corners and middles.

    [MK14] eq. (8), (9).
    """
    seen = [_seen(view, part, per_side=per_side, rule=rule) for view, part in fields]
    corners = [_corners(isqrt(len(one))) for one in seen]
    views = tuple(one[k].view for one, chosen in zip(seen, corners, strict=True) for k in chosen)
    finest = lights_at(views, None)
    found = lights_by_rules(lights_at, finest[0].rules, fields=fields, per_side=per_side, rule=rule)
    looked_at = iter(finest)
    return tuple(
        replace(one, finer=dict(zip(chosen, islice(looked_at, len(chosen)), strict=True)))
        for one, chosen in zip(found, corners, strict=True)
    )


def _corners(side: int) -> list[int]:
    """Return the positions of the corner and middle tiles, for a number of tiles a side."""
    last, middle = side**2 - 1, (side // 2) * (side + 1)
    return sorted({0, side - 1, middle, last - side + 1, last})


def lights_by_rules(
    lights_at: Callable[[tuple[View, ...], Rules | None], tuple[ApertureLight, ...]],
    rules: Rules,
    *,
    fields: Sequence[tuple[View, FieldPart | None]],
    per_side: int,
    rule: TileRule = "gauss-legendre",
) -> tuple[FieldLight, ...]:
    """Return the light of a region seen from several places, all together, by rules known from a neighbouring scene.

    [MK14] eq. (8), (9).
    """
    seen = [_seen(view, part, per_side=per_side, rule=rule) for view, part in fields]
    lights = iter(lights_at(tuple(tile.view for one in seen for tile in one), rules))
    return tuple(
        FieldLight(
            lights=tuple(islice(lights, len(one))),
            weights=tuple(tile.weight for tile in one),
            spread=0.0 if part is None else np.nan,
        )
        for one, (_, part) in zip(seen, fields, strict=True)
    )


def known_rules(several: Sequence[FieldLight]) -> Rules:
    """Return rules by which a region in several neighbouring scenes can be computed: the finest of those that suffice.

    `several` is the light of the region in each scene, as `lights_over_tiles` gives it.
    """
    used = [one.lights[0].rules for one in several]
    return Rules(
        lobe=max(one.lobe for one in used),
        diffuse=max(one.diffuse for one in used),
        error=max(one.error for one in used),
    )


def _seen(view: View, part: FieldPart | None, *, per_side: int, rule: TileRule) -> tuple[Tile, ...]:
    """Tiles of a part of the field, one of a point."""
    return (Tile(view=view, weight=1.0),) if part is None else tiles(part, view, per_side=per_side, rule=rule)


def _spread(centre: FloatArray, edges: list[FloatArray]) -> float:
    """Deviation over a field and shift of its mean, over S0; infinite with light at the edges alone."""
    left, right, bottom, top = edges
    deviation = np.sqrt(((right - left) ** 2 + (top - bottom) ** 2) / 12.0)
    shift = np.abs(left + right + bottom + top - 4.0 * centre) / 6.0
    largest = float(np.max(np.maximum(deviation, shift)))
    if largest == 0.0:
        return 0.0
    return largest / float(centre[0]) if centre[0] > 0.0 else np.inf


# Share of the light that air takes out of a beam which it sends back: one half of what molecules scatter, some 0.15 of
# what aerosol does. The rest goes on forward, and that of the surroundings comes up.
BACKSCATTER = 0.3


def before_lens(
    light: FieldLight, illumination: Illumination, imperfections: Imperfections, *, ground_albedo: float
) -> FieldLight:
    """Return a region's light with that of its near surroundings mixed in on the way to the camera.

    The surroundings are Lambertian, and wide compared with the height of the camera. Their light is taken as
    unpolarised, since it comes from all sides. Where the line of sight has the transmittance T, a share T^b - T of it
    is scattered forward into the camera, b = 0.3. The added light is negative if the surroundings are darker than the
    ground that the path was computed with.

    Definition; for the split of direct and diffuse transmittance Kaufman, J. Geophys. Res. 84 (1979) 3165.
    """
    surround_albedo = imperfections.surround_albedo
    if surround_albedo is None:
        return light
    received = illumination.direct_horizontal_irradiance + illumination.sky_irradiance
    radiance = (surround_albedo - ground_albedo) / np.pi * received
    return replace(light, lights=tuple(_mixed(one, radiance) for one in light.lights))


def forward_scattered(transmittance: float) -> float:
    """Return the share of light from wide surroundings that is scattered into a line of sight, 0 to 1.

    As `before_lens`.
    """
    return float(transmittance**BACKSCATTER - transmittance)


def _mixed(light: ApertureLight, radiance: float) -> ApertureLight:
    added = np.array([radiance * forward_scattered(light.transmittance), 0.0, 0.0])
    return replace(light, path=light.path + added)
