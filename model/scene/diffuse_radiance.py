"""Diffuse radiance that falls on a panel beside the beam, and quadrature over the directions from which it comes."""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from model import geometry
from model.quadrature import gauss_legendre
from model.scene.sky import Sky
from model.surface.tilt import Tilt

FloatArray = NDArray[np.float64]

# A direction that rounding put this far below the horizon is on it.
_HORIZON = 1e-12
# A panel whose normal is closer than this to the zenith has no uphill.
_LEVEL = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Nodes:
    """Directions of the world that a panel faces.

    Attributes
    ----------
    zenith_rad, azimuth_rad
        Shape (R,) [rad].
    weight
        Solid angles times the cosine on the panel, shape (R,) [sr].
    """

    zenith_rad: FloatArray
    azimuth_rad: FloatArray
    weight: FloatArray

    def at(self, chosen: NDArray[np.intp]) -> "Nodes":
        """Return some of the nodes, in an order of their own."""
        return Nodes(
            zenith_rad=self.zenith_rad[chosen], azimuth_rad=self.azimuth_rad[chosen], weight=self.weight[chosen]
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class DiffuseRadiance:
    """Downwelling diffuse radiance of the sky above the horizon, and that of a Lambertian ground below it.

    Attributes
    ----------
    sun_azimuth_rad
        Clockwise from north [rad].
    ground_radiance
        Unpolarized radiance of the ground around [W m-2 sr-1]; only a tilted panel sees it.
    relative_error
        Of the sky as it is given here, over its mean radiance.
    """

    sky: Sky
    sun_azimuth_rad: float
    ground_radiance: float = 0.0
    relative_error: float = 0.0
    # By tilt and order: what all views of all panels that lie alike see of it.
    _on_nodes: dict[tuple[Tilt, int], FloatArray] = field(default_factory=dict, init=False, repr=False)

    def stokes(self, *, zenith_rad: FloatArray, azimuth_rad: FloatArray) -> FloatArray:
        """Return the light from directions (R,) in each one's own frame, shape (R, 3) [W m-2 sr-1]."""
        found = np.zeros((zenith_rad.size, 3))
        above = np.cos(zenith_rad) >= -_HORIZON
        zenith = np.minimum(zenith_rad[above], 0.5 * np.pi)
        found[above] = self.sky(zenith_rad=zenith, phi_rad=self.sun_azimuth_rad - azimuth_rad[above])
        found[~above, 0] = self.ground_radiance
        return found

    def on_nodes(self, tilt: Tilt, order: int) -> FloatArray:
        """Return the light on the nodes of a panel's hemisphere, shape (R, 3) [W m-2 sr-1]; not to be written to."""
        if (tilt, order) not in self._on_nodes:
            nodes = hemisphere_nodes(tilt, order)
            self._on_nodes[tilt, order] = self.stokes(zenith_rad=nodes.zenith_rad, azimuth_rad=nodes.azimuth_rad)
        return self._on_nodes[tilt, order]


def nodes_toward(direction: FloatArray, *, solid_angle: FloatArray, cosine: FloatArray) -> Nodes:
    """Return nodes of directions that a panel faces.

    Parameters
    ----------
    direction
        Unit vectors: east, north, up; shape (R, 3).
    solid_angle
        Of each, shape (R,) [sr].
    cosine
        Of the angle from the panel's normal, shape (R,), above 0.
    """
    east, north, up = direction.T
    return Nodes(
        zenith_rad=np.arctan2(np.hypot(east, north), up),
        azimuth_rad=np.arctan2(east, north),
        weight=solid_angle * cosine,
    )


@lru_cache(maxsize=64)
def hemisphere_nodes(tilt: Tilt, order: int) -> Nodes:
    """Return directions over the hemisphere that a panel faces.

    Parameters
    ----------
    tilt
        How the panel stands.
    order
        Nodes of each stretch of a meridian, and of each half turn about the normal.

    Notes
    -----
    Each half turn about the normal, uphill and downhill, has its own nodes, and each meridian is cut at the horizon,
    so that no rule reaches across an edge of the light.

    References
    ----------
    Definition: Gauss-Legendre rules.
    """
    node, weight = gauss_legendre(order)
    around = np.concatenate([np.pi * (node - 0.5), np.pi * (node + 0.5)])
    share = np.pi * np.tile(weight, 2)
    # Where cos(theta) cos(tilt) + sin(theta) sin(tilt) cos(around) = 0.
    rise, run = float(np.cos(tilt.tilt_rad)), float(np.sin(tilt.tilt_rad)) * np.cos(around)
    horizon = np.arctan2(abs(rise), np.where(run * rise < 0.0, np.abs(run), 0.0))
    parts = [(np.zeros_like(horizon), horizon), (horizon, np.full_like(horizon, 0.5 * np.pi))]
    theta = np.concatenate([low[:, np.newaxis] + (high - low)[:, np.newaxis] * node for low, high in parts])
    ring = np.concatenate([(share * (high - low))[:, np.newaxis] * weight for low, high in parts])
    solid_angle = ring * np.sin(theta)
    uphill = np.array([0.0, 0.0, 1.0]) - rise * tilt.normal
    level = geometry.direction(zenith_rad=0.5 * np.pi, azimuth_rad=tilt.azimuth_rad)
    length = float(np.linalg.norm(uphill))
    along = uphill / length if length > _LEVEL else level
    flat = geometry.direction(zenith_rad=theta, azimuth_rad=np.tile(around, 2)[:, np.newaxis])
    axes = np.stack([np.cross(along, tilt.normal), along, tilt.normal])
    kept = solid_angle > 0.0
    return nodes_toward(flat[kept] @ axes, solid_angle=solid_angle[kept], cosine=np.cos(theta[kept]))
