"""Light of a region over the part of the field of view that it fills: mean and covariance over its pixels."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from math import isqrt
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments
from model.scene.aperture_radiance import ApertureLight
from model.scene.field_of_view import FieldPart, Tile, TileRule, middle, off_axis, tiles
from model.scene.hemisphere import Rules
from model.scene.view import View

FloatArray = NDArray[np.float64]
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
        What five directions (centre and the middles of the edges) say of the field: standard deviation over it and
        shift of its mean from the centre, largest component over S0; 0 for a point, not a number where it was not
        asked for.
    finer
        Tile to its light by the finest rules of the hemisphere integral that were tried, for those which showed what
        rules suffice for all.
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
        """Return the same light without what the sky or the path sends."""
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

    Parameters
    ----------
    lights_at
        Lights of views. It is told which rules suffice in the middle of the field, once that is known.
    view
        Of the camera's axis.
    part
        Part of the field; None for a point on the axis.
    per_side, rule
        As in `tiles`.
    negligible
        A field over which light varies by less than this share of S0 is taken as a point at its centre.

    Raises
    ------
    ValueError
        As `tiles`.

    References
    ----------
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
    return _over_tiles(lights_at, tiles(part, view, per_side=per_side, rule=rule), centre.rules, spread)


def lights_over_tiles(
    lights_at: Callable[[tuple[View, ...], Rules | None], tuple[ApertureLight, ...]],
    *,
    fields: Sequence[tuple[View, FieldPart | None]],
    per_side: int,
    rule: TileRule = "gauss-legendre",
) -> tuple[FieldLight, ...]:
    """Return the light of a region seen from several places, with rules that suffice in all corners and middles.

    Parameters
    ----------
    lights_at, per_side, rule
        As in `light_over_field`. No field is taken as a point.
    fields
        As in `lights_by_rules`.

    Raises
    ------
    ValueError
        As `tiles`.

    References
    ----------
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
    """Return which of so many tiles a side are the corners and the middle."""
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

    Parameters
    ----------
    lights_at, per_side, rule
        As in `light_over_field`. No field is taken as a point.
    rules
        As `known_rules` gives them.
    fields
        View of the camera's axis, and part of the field, of each; of one height.

    Raises
    ------
    ValueError
        As `tiles`.

    References
    ----------
    [MK14] eq. (8), (9).
    """
    seen = [_seen(view, part, per_side=per_side, rule=rule) for view, part in fields]
    lights = iter(lights_at(tuple(tile.view for one in seen for tile in one), rules))
    return tuple(
        FieldLight(
            lights=tuple(islice(lights, len(one))),
            weights=tuple(tile.weight for tile in one),
            spread=_unknown_spread(part),
        )
        for one, (_, part) in zip(seen, fields, strict=True)
    )


def known_rules(several: Sequence[FieldLight]) -> Rules:
    """Return rules by which a region in several neighbouring scenes can be computed: the finest of what suffices there.

    Parameters
    ----------
    several
        Its light, one or more, as `lights_over_tiles` gives it.
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


def _unknown_spread(part: FieldPart | None) -> float:
    """Spread of light that was not looked at in five directions."""
    return 0.0 if part is None else np.nan


def _over_tiles(
    lights_at: Callable[[tuple[View, ...], Rules | None], tuple[ApertureLight, ...]],
    found: tuple[Tile, ...],
    rules: Rules,
    spread: float,
) -> FieldLight:
    return FieldLight(
        lights=lights_at(tuple(tile.view for tile in found), rules),
        weights=tuple(tile.weight for tile in found),
        spread=spread,
    )


def _spread(centre: FloatArray, edges: list[FloatArray]) -> float:
    """Deviation over a field and shift of its mean, over S0; infinite with light at the edges alone."""
    left, right, bottom, top = edges
    deviation = np.sqrt(((right - left) ** 2 + (top - bottom) ** 2) / 12.0)
    shift = np.abs(left + right + bottom + top - 4.0 * centre) / 6.0
    largest = float(np.max(np.maximum(deviation, shift)))
    if largest == 0.0:
        return 0.0
    return largest / float(centre[0]) if centre[0] > 0.0 else np.inf
