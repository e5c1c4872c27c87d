"""Light that one panel reflects to cameras, of the beam and of diffuse radiance, by rules of a given order.

The lobe and the diffuse term are integrated apart. For the lobe the nodes lie over the slopes of the facets, so that a
narrow lobe has as many as a wide one; for the diffuse term they cover the sky evenly.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from model import geometry
from model.scene.diffuse_radiance import DiffuseRadiance, Nodes, hemisphere_nodes, nodes_toward
from model.scene.view import View
from model.stokes import rotate_frame
from model.surface.facet_quadrature import SLOPE_CUT, facet_nodes
from model.surface.pbrdf import Surface, evaluate
from model.surface.tilt import LocalGeometry, Tilt, local_geometry

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

# A camera closer than this to the panel's normal has no direction of its own in the panel's plane.
_OVERHEAD = 1e-9
# So many nodes at a time stay in the processor's cache, whoever sees them.
_BLOCK = 8192
# Few nodes are better spent where most facets are: slopes are taken up to so many standard deviations, and so many more
# for each order. With these the rules of order 6 to 12 miss a half to a tenth of what they miss up to seven.
_LEAST_CUT, _CUT_BY_ORDER = 2.9, 0.15
# What a panel does with light from its nodes is kept for other suns and heights: of many rules of few nodes, of few
# rules of many.
_FEW_NODES, _MANY_NODES = 1024, 4096


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rule:
    """Nodes of a quadrature, and what the panel does with their light, whatever that is.

    Attributes
    ----------
    nodes, camera
        Directions, and the camera to which each one's light goes, shape (R,).
    turn_rad
        From each one's own frame to that of the panel; None for a level panel.
    mueller
        Of the panel, shape (R, 3, 3) [sr-1].
    """

    nodes: Nodes
    camera: IntArray
    turn_rad: FloatArray | None
    mueller: FloatArray

    def sums(self, incident: FloatArray, cameras: int) -> FloatArray:
        """Return the sum of pBRDF times light times projected solid angle over the nodes of each camera, (V, 3)."""
        if self.turn_rad is not None:
            incident = rotate_frame(incident, self.turn_rad)
        reflected = np.einsum("rij,rj->ir", self.mueller, incident) * self.nodes.weight
        return np.stack([np.bincount(self.camera, one, minlength=cameras) for one in reflected], axis=-1)


class PanelLight:
    """A panel before V cameras; its reflections are in each camera's horizontal frame, without roll."""

    def __init__(self, *, surface: Surface, tilt: Tilt, views: Sequence[View]) -> None:
        """Set a panel before cameras.

        Raises
        ------
        ValueError
            The panel turns its back to a camera.
        """
        self._surface, self._tilt = surface, tilt
        # Height and roll of a camera are nothing to the panel.
        self._views = tuple(replace(view, height_m=0.0, roll_rad=0.0) for view in views)
        self._zenith_rad = np.array([view.zenith_rad for view in views])
        self._azimuth_rad = np.array([view.azimuth_rad for view in views])
        cameras = geometry.direction(zenith_rad=self._zenith_rad, azimuth_rad=self._azimuth_rad)
        self._theta_r_rad = geometry.angle_between_rad(tilt.normal, cameras)
        if np.any(self._theta_r_rad >= 0.5 * np.pi):
            raise ValueError(
                f"the panel turns its back to the camera: {np.degrees(np.max(self._theta_r_rad)):.4g} deg from its "
                "normal, allowed is below 90 deg"
            )
        self._axes = _panel_axes(tilt.normal, cameras, self._azimuth_rad)
        overhead = np.zeros(len(views))
        self._turn_rad = self._local(overhead, overhead, np.arange(len(views))).reflected_rotation_rad

    @property
    def is_level(self) -> bool:
        """True if the panel sees the sky alone, and no ground."""
        return self._tilt.tilt_rad == 0.0

    def sun(self, *, zenith_rad: float, azimuth_rad: float, irradiance: float) -> FloatArray:
        """Return the reflected beam, shape (V, 3) [W m-2 sr-1].

        Parameters
        ----------
        zenith_rad, azimuth_rad
            Where the sun is [rad].
        irradiance
            Of the beam on a plane normal to it [W m-2].

        Notes
        -----
        Dark where the sun is behind the panel.

        References
        ----------
        [MK14] eq. (2), without the transmittance of the path; the cosine is that on the panel.
        """
        camera = np.arange(self._theta_r_rad.size)
        local = self._local(np.full(camera.shape, zenith_rad), np.full(camera.shape, azimuth_rad), camera)
        mueller = self._mueller(local, specular=True) + self._mueller(local, specular=False)
        on_panel = irradiance * np.maximum(np.cos(local.theta_i_rad), 0.0)
        return self._to_cameras(on_panel[:, np.newaxis] * mueller[:, :, 0])

    def lobe(self, light: DiffuseRadiance, order: int) -> FloatArray:
        """Return the diffuse radiance that the lobe reflects, shape (V, 3) [W m-2 sr-1].

        Parameters
        ----------
        light
            The sky.
        order
            Nodes along one slope of each panel of facet slopes, half of it along the other; 2 or more.

        References
        ----------
        [MK14] eq. (3), over facet slopes: dOmega_sky = 4 cos(psi) dOmega_facet.
        """
        found = np.zeros((self._theta_r_rad.size, 3))
        for rule in self._rules(order, specular=True):
            incident = light.stokes(zenith_rad=rule.nodes.zenith_rad, azimuth_rad=rule.nodes.azimuth_rad)
            found += rule.sums(incident, len(found))
        return self._to_cameras(found)

    def diffuse(self, light: DiffuseRadiance, order: int) -> FloatArray:
        """Return the diffuse radiance that the diffuse term reflects, shape (V, 3) [W m-2 sr-1].

        Parameters
        ----------
        light
            The sky, and the ground that a tilted panel sees.
        order
            Nodes in zenith angle; twice as many in azimuth.

        References
        ----------
        [MK14] eq. (3).
        """
        found = np.zeros((self._theta_r_rad.size, 3))
        if self._surface.dhr is None:
            return found
        incident, start = light.on_nodes(self._tilt, order), 0
        for rule in self._rules(order, specular=False):
            at = np.arange(start, start + rule.camera.size) % len(incident)
            found += rule.sums(incident[at], len(found))
            start += rule.camera.size
        return self._to_cameras(found)

    def _rules(self, order: int, *, specular: bool) -> Iterable[_Rule]:
        """Nodes of the lobe or of the diffuse term, block by block, made where they are not kept."""
        nodes = order**2 * len(self._views)
        if nodes > _MANY_NODES:
            return self._lobe_rules(order) if specular else self._diffuse_rules(order)
        kept = _kept_of_few if nodes <= _FEW_NODES else _kept_of_many
        return kept(self._surface, self._tilt, self._views, order, specular)

    def made_rules(self, order: int, *, specular: bool) -> tuple[_Rule, ...]:
        """Return the nodes of the lobe or of the diffuse term, block by block."""
        return tuple(self._lobe_rules(order) if specular else self._diffuse_rules(order))

    def _lobe_rules(self, order: int) -> Iterator[_Rule]:
        slope_rms = self._surface.slope_rms
        facets = facet_nodes(
            self._theta_r_rad,
            slope_rms=slope_rms,
            shadowing=self._surface.shadowing,
            order=order,
            cut=min(_LEAST_CUT + _CUT_BY_ORDER * order, SLOPE_CUT),
        )
        parts = np.broadcast_arrays(facets.row[:, np.newaxis], facets.x, facets.y, facets.weight)
        camera, x, y, weight = (np.tile(part.ravel(), 2) for part in parts)
        y[y.size // 2 :] *= -1.0
        # The facets' weight holds the density of slopes, which is part of the pBRDF too: take it out.
        weight *= np.pi * slope_rms**2 * np.exp((x**2 + y**2) * (0.5 / slope_rms**2))
        for block in _blocks(x.size):
            nodes, seen_by = self._mirrored(x[block], y[block], weight[block], camera[block])
            yield self._rule(nodes, seen_by, specular=True)

    def _diffuse_rules(self, order: int) -> Iterator[_Rule]:
        """Every camera's nodes of the hemisphere, one camera after the other."""
        nodes = hemisphere_nodes(self._tilt, order)
        per_camera = nodes.weight.size
        for block in _blocks(len(self._views) * per_camera):
            seen_by, at = np.divmod(np.arange(block.start, block.stop), per_camera)
            yield self._rule(nodes.at(at), seen_by, specular=False)

    def _rule(self, nodes: Nodes, camera: IntArray, *, specular: bool) -> _Rule:
        local = self._local(nodes.zenith_rad, nodes.azimuth_rad, camera)
        turn_rad = None if self.is_level else local.incident_rotation_rad
        return _Rule(nodes=nodes, camera=camera, turn_rad=turn_rad, mueller=self._mueller(local, specular=specular))

    def _mirrored(self, x: FloatArray, y: FloatArray, weight: FloatArray, camera: IntArray) -> tuple[Nodes, IntArray]:
        """Directions that facets of slopes x, y mirror to a camera, of those before the panel; and to which camera."""
        cos_r, sin_r = np.cos(self._theta_r_rad)[camera], np.sin(self._theta_r_rad)[camera]
        seen, secant2 = cos_r + x * sin_r, 1.0 + x**2 + y**2
        twice = 2.0 * seen / secant2
        facing = twice > cos_r
        local = np.stack([twice * x - sin_r, twice * y, twice - cos_r], axis=-1)[facing]
        direction = np.einsum("rk,rkj->rj", local, self._axes[camera[facing]])
        solid_angle = (4.0 * seen / secant2**2 * weight)[facing]
        return nodes_toward(direction, solid_angle=solid_angle, cosine=local[:, 2]), camera[facing]

    def _mueller(self, local: LocalGeometry, *, specular: bool) -> FloatArray:
        """Lobe or diffuse term of the pBRDF alone, in the panel's frames."""
        return evaluate(
            local.theta_i_rad,
            local.theta_r_rad,
            local.phi_rad,
            lobe=self._surface.lobe,
            specular_weight=self._surface.specular_weight if specular else 0.0,
            diffuse=None if specular else self._surface.diffuse_term,
        )

    def _local(self, zenith_rad: FloatArray, azimuth_rad: FloatArray, camera: IntArray) -> LocalGeometry:
        """Angles about the panel's normal; of a level panel they are the world's, without turns."""
        if self.is_level:
            still = np.zeros(zenith_rad.shape)
            return LocalGeometry(
                theta_i_rad=zenith_rad,
                theta_r_rad=self._zenith_rad[camera],
                phi_rad=azimuth_rad - self._azimuth_rad[camera],
                incident_rotation_rad=still,
                reflected_rotation_rad=still,
            )
        return local_geometry(
            sun_zenith_rad=zenith_rad,
            sun_azimuth_rad=azimuth_rad,
            camera_zenith_rad=self._zenith_rad[camera],
            camera_azimuth_rad=self._azimuth_rad[camera],
            tilt=self._tilt,
        )

    def _to_cameras(self, stokes: FloatArray) -> FloatArray:
        """Turn from the panel's axis of the reflected ray to the true horizontal."""
        return rotate_frame(stokes, self._turn_rad)


def _made(surface: Surface, tilt: Tilt, views: tuple[View, ...], order: int, specular: bool) -> tuple[_Rule, ...]:
    return PanelLight(surface=surface, tilt=tilt, views=views).made_rules(order, specular=specular)


_kept_of_few, _kept_of_many = (lru_cache(maxsize=size)(_made) for size in (512, 128))


def _blocks(size: int) -> Iterator[slice]:
    for start in range(0, size, _BLOCK):
        yield slice(start, min(start + _BLOCK, size))


def _panel_axes(normal: FloatArray, cameras: FloatArray, camera_azimuth_rad: FloatArray) -> FloatArray:
    """Axes of each camera: toward it in the panel's plane, across, normal; shape (V, 3, 3), axes along the second."""
    along = cameras - (cameras @ normal)[:, np.newaxis] * normal
    # Facets have no preferred direction for a camera overhead, and any axis serves.
    level = geometry.horizontal_axis(camera_azimuth_rad, travels_to_target=False)
    level = level - (level @ normal)[:, np.newaxis] * normal
    along = np.where(np.linalg.norm(along, axis=-1, keepdims=True) < _OVERHEAD, level, along)
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    return np.stack([along, np.cross(normal, along), np.broadcast_to(normal, along.shape)], axis=1)
