"""Sun, sky and air of a scene together."""

from dataclasses import dataclass

import numpy as np

from model.atmosphere.lighting.lighting import Lighting
from model.quadrature import gauss_legendre
from model.scene.diffuse_radiance import DiffuseRadiance
from model.scene.sky import Sky

# Largest zenith angle of the sun for which a plane-parallel atmosphere holds [rad].
LARGEST_SUN_ZENITH_RAD = float(np.radians(85.0))
_IRRADIANCE_NODES = 32


@dataclass(frozen=True, kw_only=True, eq=False)
class Illumination:
    """Sun, sky and air of a scene.

    Attributes
    ----------
    lighting
        Beam, transmittance and path.
    diffuse_radiance
        What shines on a panel but the beam.
    sky_irradiance
        Of the sky on level ground [W m-2].
    sun_zenith_rad, sun_azimuth_rad
        Where the sun is, azimuth clockwise from north [rad].
    """

    lighting: Lighting
    diffuse_radiance: DiffuseRadiance
    sky_irradiance: float
    sun_zenith_rad: float
    sun_azimuth_rad: float

    @property
    def direct_horizontal_irradiance(self) -> float:
        """Irradiance of the beam on level ground [W m-2]."""
        return self.lighting.direct_irradiance * float(np.cos(self.sun_zenith_rad))


def illuminate(
    lighting: Lighting,
    *,
    sun_zenith_rad: float,
    sun_azimuth_rad: float,
    ground_albedo: float,
    sky: Sky | None = None,
    sky_error: float = 0.0,
) -> Illumination:
    """Return the illumination of a scene.

    Parameters
    ----------
    lighting
        Light of this sun position in the sensor's band.
    sun_zenith_rad
        0 to 85 deg [rad].
    sun_azimuth_rad
        Clockwise from north [rad].
    ground_albedo
        Of the ground around, which a tilted panel sees, 0 to 1.
    sky
        What stands for the lighting's sky, a `model.scene.sampled_sky.SampledSky` of it for one; None for itself.
    sky_error
        Relative error of that stand-in.

    Raises
    ------
    ValueError
        The sun is too low, or the albedo outside its range.
    """
    require_sun_zenith(sun_zenith_rad)
    if not 0.0 <= ground_albedo <= 1.0:
        raise ValueError(f"ground_albedo = {ground_albedo!r}, allowed is 0 to 1")
    seen = lighting.sky if sky is None else sky
    from_sky = _sky_irradiance(seen)
    received = from_sky + lighting.direct_irradiance * float(np.cos(sun_zenith_rad))
    diffuse_radiance = DiffuseRadiance(
        sky=seen,
        sun_azimuth_rad=sun_azimuth_rad,
        ground_radiance=ground_albedo / np.pi * received,
        relative_error=sky_error,
    )
    return Illumination(
        lighting=lighting,
        diffuse_radiance=diffuse_radiance,
        sky_irradiance=from_sky,
        sun_zenith_rad=sun_zenith_rad,
        sun_azimuth_rad=sun_azimuth_rad,
    )


def require_sun_zenith(sun_zenith_rad: float) -> None:
    """Refuse a sun for which no atmosphere of this model holds.

    Parameters
    ----------
    sun_zenith_rad
        Zenith angle of the sun [rad].

    Raises
    ------
    ValueError
        It is not 0 to 85 deg.
    """
    if not 0.0 <= sun_zenith_rad <= LARGEST_SUN_ZENITH_RAD + 1e-12:
        raise ValueError(
            f"solar zenith = {np.degrees(sun_zenith_rad):.2f} deg, allowed is 0 to 85 deg: a plane-parallel atmosphere "
            "is wrong for a lower sun, and there is no beam below the horizon. Take another time"
        )


def _sky_irradiance(sky: Sky) -> float:
    """Irradiance of a sky on level ground, by Gauss nodes in zenith angle and even azimuths."""
    node, weight = gauss_legendre(_IRRADIANCE_NODES)
    zenith = 0.5 * np.pi * node
    azimuth = 2.0 * np.pi * (np.arange(_IRRADIANCE_NODES) + 0.5) / _IRRADIANCE_NODES
    s0 = sky(zenith_rad=zenith[:, np.newaxis], phi_rad=azimuth)[..., 0]
    # cos sin = sin(2 zenith) / 2, and half a right angle for the interval of the nodes.
    return float(0.5 * np.pi**2 * weight @ (np.mean(s0, axis=1) * np.sin(2.0 * zenith)))
