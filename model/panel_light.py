"""What one panel reflects to one camera, of the beam and of the skylight, by quadrature rules of a given order.

The lobe and the diffuse term are integrated apart. For the lobe the nodes lie over the slopes of the facets, so that a
narrow lobe has as many as a wide one; for the diffuse term they cover the sky evenly.
"""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from model import geometry
from model.quadrature import gauss_legendre
from model.sky import Sky
from model.stokes import rotate_frame
from model.surface.facet_quadrature import facet_nodes
from model.surface.pbrdf import Surface, evaluate
from model.surface.tilt import LocalGeometry, Tilt, local_geometry
from model.view import View

FloatArray = NDArray[np.float64]

# A direction that rounding put this far below the horizon is on it.
_HORIZON = 1e-12
# A camera closer than this to the panel's normal has no direction of its own in the panel's plane.
_OVERHEAD = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Skylight:
    """All light on a target but the beam: the sky above the horizon, and a Lambertian ground below it.

    Attributes
    ----------
    sky
        The sky.
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
            nodes = _hemisphere(tilt, order)
            self._on_nodes[tilt, order] = self.stokes(zenith_rad=nodes.zenith_rad, azimuth_rad=nodes.azimuth_rad)
        return self._on_nodes[tilt, order]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Nodes:
    """Directions of the world, shape (R,), and their solid angles times the cosine on the panel [sr]."""

    zenith_rad: FloatArray
    azimuth_rad: FloatArray
    weight: FloatArray


class PanelLight:
    """A panel before a camera; its reflections are in the camera's horizontal frame, without roll."""

    def __init__(self, *, surface: Surface, tilt: Tilt, view: View) -> None:
        """Set a panel before a camera.

        Raises
        ------
        ValueError
            The panel turns its back to the camera.
        """
        self._surface, self._tilt, self._view = surface, tilt, view
        camera = geometry.direction(zenith_rad=view.zenith_rad, azimuth_rad=view.azimuth_rad)
        self._theta_r_rad = float(geometry.angle_between_rad(tilt.normal, camera))
        if self._theta_r_rad >= 0.5 * np.pi:
            raise ValueError(
                f"the panel turns its back to the camera: {np.degrees(self._theta_r_rad):.4g} deg from its normal, "
                "allowed is below 90 deg"
            )
        self._axes = _panel_axes(tilt.normal, camera, view.azimuth_rad)
        self._turn_rad = float(self._local(np.zeros(1), np.zeros(1)).reflected_rotation_rad[0])

    @property
    def view(self) -> View:
        """The camera."""
        return self._view

    @property
    def is_level(self) -> bool:
        """Whether the panel sees the sky alone, and no ground."""
        return self._tilt.tilt_rad == 0.0

    def sun(self, *, zenith_rad: float, azimuth_rad: float, irradiance: float) -> FloatArray:
        """Return the reflected beam, shape (3,) [W m-2 sr-1].

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
        local = self._local(np.array([zenith_rad]), np.array([azimuth_rad]))
        mueller = self._mueller(local, specular=True) + self._mueller(local, specular=False)
        on_panel = irradiance * max(float(np.cos(local.theta_i_rad[0])), 0.0)
        return self._to_camera(on_panel * mueller[0, :, 0])

    def lobe(self, light: Skylight, order: int) -> FloatArray:
        """Return the skylight that the lobe reflects, shape (3,) [W m-2 sr-1].

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
        surface = self._surface
        facets = facet_nodes(
            np.array([self._theta_r_rad]), slope_rms=surface.slope_rms, shadowing=surface.shadowing, order=order
        )
        x, y = (np.tile(part.ravel(), 2) for part in np.broadcast_arrays(facets.x, facets.y))
        y[y.size // 2 :] *= -1.0
        cos_r, sin_r = np.cos(self._theta_r_rad), np.sin(self._theta_r_rad)
        seen, secant2 = cos_r + x * sin_r, 1.0 + x**2 + y**2
        mirrored = (2.0 * seen / secant2)[:, np.newaxis] * np.stack([x, y, np.ones_like(x)], axis=-1)
        mirrored -= np.array([sin_r, 0.0, cos_r])
        # The facets' weight holds the density of slopes, which is part of the pBRDF too: take it out.
        density = np.exp((x**2 + y**2) * (-0.5 / surface.slope_rms**2)) / (np.pi * surface.slope_rms**2)
        solid_angle = 4.0 * seen / secant2**2 * np.tile(facets.weight.ravel(), 2) / density
        nodes = _facing(self._tilt, mirrored @ self._axes, solid_angle)
        incident = light.stokes(zenith_rad=nodes.zenith_rad, azimuth_rad=nodes.azimuth_rad)
        return self._sum(nodes, incident, specular=True)

    def diffuse(self, light: Skylight, order: int) -> FloatArray:
        """Return the skylight that the diffuse term reflects, shape (3,) [W m-2 sr-1].

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
        if self._surface.dhr is None:
            return np.zeros(3)
        return self._sum(_hemisphere(self._tilt, order), light.on_nodes(self._tilt, order), specular=False)

    def _sum(self, nodes: _Nodes, incident: FloatArray, *, specular: bool) -> FloatArray:
        """Sum of pBRDF times light times projected solid angle."""
        local = self._local(nodes.zenith_rad, nodes.azimuth_rad)
        if not self.is_level:
            incident = rotate_frame(incident, local.incident_rotation_rad)
        mueller = self._mueller(local, specular=specular)
        return self._to_camera(np.einsum("r,rij,rj->i", nodes.weight, mueller, incident))

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

    def _local(self, zenith_rad: FloatArray, azimuth_rad: FloatArray) -> LocalGeometry:
        """Angles about the panel's normal; of a level panel they are the world's, without turns."""
        if self.is_level:
            still = np.zeros(zenith_rad.shape)
            return LocalGeometry(
                theta_i_rad=zenith_rad,
                theta_r_rad=np.full(zenith_rad.shape, self._view.zenith_rad),
                phi_rad=azimuth_rad - self._view.azimuth_rad,
                incident_rotation_rad=still,
                reflected_rotation_rad=still,
            )
        return local_geometry(
            sun_zenith_rad=zenith_rad,
            sun_azimuth_rad=azimuth_rad,
            camera_zenith_rad=self._view.zenith_rad,
            camera_azimuth_rad=self._view.azimuth_rad,
            tilt=self._tilt,
        )

    def _to_camera(self, stokes: FloatArray) -> FloatArray:
        """Turn from the panel's axis of the reflected ray to the true horizontal."""
        return rotate_frame(stokes, self._turn_rad)


def _facing(tilt: Tilt, direction: FloatArray, solid_angle: FloatArray) -> _Nodes:
    """Those of some directions (R, 3) of the world that a panel faces, with their solid angles [sr]."""
    cos_i = direction @ tilt.normal
    facing = cos_i > 0.0
    east, north, up = direction[facing].T
    return _Nodes(
        zenith_rad=np.arctan2(np.hypot(east, north), up),
        azimuth_rad=np.arctan2(east, north),
        weight=(solid_angle * cos_i)[facing],
    )


@lru_cache(maxsize=64)
def _hemisphere(tilt: Tilt, order: int) -> _Nodes:
    """Directions over the hemisphere that a panel faces.

    Each half turn about the normal, uphill and downhill, has its own nodes, and each meridian is cut at the horizon,
    so that no rule reaches across an edge of the light.
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
    along = uphill / length if length > _OVERHEAD else level
    flat = geometry.direction(zenith_rad=theta, azimuth_rad=np.tile(around, 2)[:, np.newaxis])
    axes = np.stack([np.cross(along, tilt.normal), along, tilt.normal])
    kept = solid_angle > 0.0
    return _facing(tilt, flat[kept] @ axes, solid_angle[kept])


def _panel_axes(normal: FloatArray, camera: FloatArray, camera_azimuth_rad: float) -> FloatArray:
    """Rows: toward the camera in the panel's plane, across, normal."""
    along = camera - (camera @ normal) * normal
    if np.linalg.norm(along) < _OVERHEAD:
        # Facets have no preferred direction then, and any axis serves.
        level = geometry.horizontal_axis(camera_azimuth_rad, travels_to_target=False)
        along = level - (level @ normal) * normal
    along = along / np.linalg.norm(along)
    return np.stack([along, np.cross(normal, along), normal])
