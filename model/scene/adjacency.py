"""Light of near surroundings, unlike the ground's mean, that the air mixes into the line of sight."""

from dataclasses import replace

import numpy as np

from model.scene.aperture_radiance import ApertureLight
from model.scene.field_light import FieldLight
from model.scene.illumination import Illumination

# Share of the light that air takes out of a beam which it sends back: one half of what molecules scatter, some 0.15 of
# what aerosol does. The rest goes on forward, and that of the surroundings comes up.
BACKSCATTER = 0.3


def with_surroundings(
    light: FieldLight, illumination: Illumination, *, surround_albedo: float, ground_albedo: float
) -> FieldLight:
    """Return a region's light with that of its near surroundings mixed in on the way to the camera.

    Parameters
    ----------
    light
        Of the region; its path is that over ground of the mean albedo.
    illumination
        Sun, sky and air.
    surround_albedo
        Of the near surroundings, 0 to 1.
    ground_albedo
        That the path was computed with, 0 to 1.

    Notes
    -----
    The surroundings are Lambertian and wide beside the height of the camera; what they send up is taken as unpolarised,
    since it comes from all sides. With transmittance T of the line of sight T^b - T of it arrive, b = 0.3: that
    scattered forward. It can be negative: darker surroundings take away what the path holds already.

    References
    ----------
    Definition; for the split of direct and diffuse transmittance Kaufman, J. Geophys. Res. 84 (1979) 3165.
    """
    received = illumination.direct_horizontal_irradiance + illumination.sky_irradiance
    radiance = (surround_albedo - ground_albedo) / np.pi * received
    return replace(light, lights=tuple(_mixed(one, radiance) for one in light.lights))


def forward_scattered(transmittance: float) -> float:
    """Return the share of light from wide surroundings that is scattered into a line of sight, 0 to 1.

    Parameters
    ----------
    transmittance
        Of the line of sight, 0 to 1.

    References
    ----------
    As `with_surroundings`.
    """
    return float(transmittance**BACKSCATTER - transmittance)


def _mixed(light: ApertureLight, radiance: float) -> ApertureLight:
    added = np.array([radiance * forward_scattered(light.transmittance), 0.0, 0.0])
    return replace(light, path=light.path + added)
