"""Surfaces that do not lie level: angles to their own normal, and Stokes parameters back in the camera's axes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import geometry
from model.stokes import rotation
from model.surface.pbrdf import Surface, mueller

FloatArray = NDArray[np.float64]

# A ray closer than this to the panel's normal has no plane of its own on the panel; any one serves.
_ALONG_NORMAL = 1e-14


@dataclass(frozen=True, kw_only=True)
class Tilt:
    """Tilt of a plane panel.

    Parameters
    ----------
    tilt_rad
        Angle of its normal from up [rad], 0 (level) to pi/2 (a wall) and on to pi (a ceiling).
    azimuth_rad
        Azimuth to which its normal leans, clockwise from north [rad].

    Raises
    ------
    ValueError
        If an angle is outside its range.
    """

    tilt_rad: float
    azimuth_rad: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.tilt_rad <= np.pi:
            raise ValueError(f"tilt_rad = {self.tilt_rad} rad; allowed is 0 (level) to pi")
        if not np.isfinite(self.azimuth_rad):
            raise ValueError(f"azimuth_rad = {self.azimuth_rad} rad; allowed are finite angles")

    @property
    def normal(self) -> FloatArray:
        """Unit vector of the normal: east, north, up."""
        return geometry.direction(zenith_rad=self.tilt_rad, azimuth_rad=self.azimuth_rad)


@dataclass(frozen=True, kw_only=True)
class LocalGeometry:
    """Sun and camera as a tilted panel sees them.

    Parameters
    ----------
    theta_i_rad, theta_r_rad
        Angles of sun and camera from the panel's normal [rad]; beyond pi/2 the panel does not face them.
    phi_rad
        Relative azimuth about the panel's normal [rad], as `mueller` wants it.
    incident_rotation_rad
        Angle from the world's horizontal axis of the incident ray to the panel's [rad].
    reflected_rotation_rad
        Angle from the panel's axis of the reflected ray to the world's horizontal [rad].
    """

    theta_i_rad: FloatArray
    theta_r_rad: FloatArray
    phi_rad: FloatArray
    incident_rotation_rad: FloatArray
    reflected_rotation_rad: FloatArray


def local_geometry(
    *,
    sun_zenith_rad: ArrayLike,
    sun_azimuth_rad: ArrayLike,
    camera_zenith_rad: ArrayLike,
    camera_azimuth_rad: ArrayLike,
    tilt: Tilt,
) -> LocalGeometry:
    """Return the angles of sun and camera about a panel's normal and the turns of the Stokes axes.

    Parameters
    ----------
    sun_zenith_rad, sun_azimuth_rad
        Direction from the target to the sun or to a point of the sky [rad].
    camera_zenith_rad, camera_azimuth_rad
        Direction from the target to the camera [rad].
    tilt
        How the panel stands.

    Returns
    -------
    LocalGeometry
        The directions broadcast.

    Raises
    ------
    ValueError
        If an angle is not finite.
    """
    sun = geometry.direction(zenith_rad=sun_zenith_rad, azimuth_rad=sun_azimuth_rad)
    camera = geometry.direction(zenith_rad=camera_zenith_rad, azimuth_rad=camera_azimuth_rad)
    sun, camera = np.broadcast_arrays(sun, camera)
    world_i = np.broadcast_to(geometry.horizontal_axis(sun_azimuth_rad, travels_to_target=True), sun.shape)
    world_r = np.broadcast_to(geometry.horizontal_axis(camera_azimuth_rad, travels_to_target=False), sun.shape)
    panel_i = _panel_axis(tilt.normal, -sun, fallback=world_i)
    panel_r = _panel_axis(tilt.normal, camera, fallback=world_r)
    # The panel's azimuth directions of sun and camera, from their axes: defined even along the normal.
    toward_sun, toward_camera = np.cross(tilt.normal, panel_i), np.cross(panel_r, tilt.normal)
    turn = np.sum(tilt.normal * np.cross(toward_sun, toward_camera), axis=-1)
    return LocalGeometry(
        theta_i_rad=geometry.angle_between_rad(tilt.normal, sun),
        theta_r_rad=geometry.angle_between_rad(tilt.normal, camera),
        phi_rad=np.asarray(np.arctan2(turn, np.sum(toward_sun * toward_camera, axis=-1))),
        incident_rotation_rad=geometry.axis_rotation_rad(world_i, panel_i, travel=-sun),
        reflected_rotation_rad=geometry.axis_rotation_rad(panel_r, world_r, travel=camera),
    )


def tilted_mueller(
    *,
    sun_zenith_rad: ArrayLike,
    sun_azimuth_rad: ArrayLike,
    camera_zenith_rad: ArrayLike,
    camera_azimuth_rad: ArrayLike,
    camera_roll_rad: ArrayLike = 0.0,
    tilt: Tilt,
    surface: Surface,
) -> FloatArray:
    """Return the pBRDF of a tilted panel between the world's horizontal axes and the camera's.

    Parameters
    ----------
    sun_zenith_rad, sun_azimuth_rad
        Direction from the target to the sun or to a point of the sky [rad].
    camera_zenith_rad, camera_azimuth_rad
        Direction from the target to the camera [rad].
    camera_roll_rad
        Angle by which the camera's horizontal is turned counter-clockwise from the true horizontal, as the camera
        sees the scene [rad].
    tilt
        How the panel stands.
    surface
        What it is made of.

    Returns
    -------
    ndarray
        Shape (..., 3, 3) [sr^-1]. The irradiance that goes with it is that on the panel: cosine of the local
        theta_i, not of the sun's zenith angle. Zero where the panel does not face sun and camera both.

    Raises
    ------
    ValueError
        If an angle is not finite.

    Notes
    -----
    A level panel gives `mueller` itself. At the zenith or nadir the horizontal is that of the azimuth given.

    References
    ----------
    Definition; [MK14] eq. (11) for the camera's frame.
    """
    local = local_geometry(
        sun_zenith_rad=sun_zenith_rad,
        sun_azimuth_rad=sun_azimuth_rad,
        camera_zenith_rad=camera_zenith_rad,
        camera_azimuth_rad=camera_azimuth_rad,
        tilt=tilt,
    )
    own = mueller(local.theta_i_rad, local.theta_r_rad, local.phi_rad, surface=surface)
    roll = np.asarray(camera_roll_rad, dtype=np.float64)
    if not np.all(np.isfinite(roll)):
        raise ValueError("camera_roll_rad is not finite; allowed are finite angles [rad]")
    turned: FloatArray = rotation(local.reflected_rotation_rad + roll) @ own @ rotation(local.incident_rotation_rad)
    return turned


def _panel_axis(normal: FloatArray, travel: FloatArray, *, fallback: FloatArray) -> FloatArray:
    """unit(normal x k), the panel's own horizontal axis of each ray; `fallback` for a ray along the normal."""
    axis = np.cross(normal, travel)
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    lost = length < _ALONG_NORMAL
    return np.asarray(np.where(lost, fallback, axis / np.where(lost, 1.0, length)))
