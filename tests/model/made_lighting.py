"""Skies by formula, for tests that ask what is made of a sky and not how a sky comes about."""

from dataclasses import dataclass

import numpy as np

from model.atmosphere.sky import analytic_sky
from model.scene.sky_light import DiffuseRadiance, illuminate

SUN_AZIMUTH_RAD = np.radians(200.0)


def polarized_sky(*, sun_zenith_deg=50.0, dolp_max=0.3):
    def sky(*, zenith_rad, phi_rad):
        return analytic_sky(
            mu0=np.cos(np.radians(sun_zenith_deg)),
            zenith_radiance=20.0,
            dolp_max=dolp_max,
            zenith_rad=zenith_rad,
            phi_rad=phi_rad,
        )

    return sky


def even_sky(*, zenith_rad, phi_rad):
    zenith, _ = np.broadcast_arrays(zenith_rad, phi_rad)
    return np.stack([np.ones(zenith.shape), np.zeros(zenith.shape), np.zeros(zenith.shape)], axis=-1)


def skylight(sky=None, **changes):
    return DiffuseRadiance(sky=polarized_sky() if sky is None else sky, sun_azimuth_rad=SUN_AZIMUTH_RAD, **changes)


@dataclass(frozen=True, kw_only=True)
class MadeLighting:
    """A lighting whose air takes a tenth in a kilometre and adds polarized light."""

    direct_irradiance: float = 300.0

    def sky(self, *, zenith_rad, phi_rad):
        return polarized_sky()(zenith_rad=zenith_rad, phi_rad=phi_rad)

    def transmittance(self, *, height_m, zenith_rad):
        return np.exp(-1e-4 * height_m / np.cos(zenith_rad))

    def path(self, *, height_m, zenith_rad, phi_rad):
        zenith, phi = np.broadcast_arrays(zenith_rad, phi_rad)
        added = 20.0 * (1.0 - self.transmittance(height_m=height_m, zenith_rad=zenith))
        return np.stack([added, 0.1 * added * np.cos(phi), 0.05 * added * np.sin(phi)], axis=-1)


def illumination(*, zenith_deg=50.0, azimuth_deg=200.0, albedo=0.1, **more):
    return illuminate(
        MadeLighting(),
        sun_zenith_rad=np.radians(zenith_deg),
        sun_azimuth_rad=np.radians(azimuth_deg),
        ground_albedo=albedo,
        **more,
    )
