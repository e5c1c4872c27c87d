"""Limits of the light of a region, which bounds of effects are made of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.scene.scenario import RegionLight

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LightLimits:
    """Limits of a region's radiance [W m-2 sr-1].

    Attributes
    ----------
    beams
        Stokes radiance from the beam at directions of the field, shape (K, 3); of a given radiance that itself.
    s0_low, s0_high, polarised_low, polarised_high
        Of these.
    sky, path, adjacency
        Upper limits of what sky, path and surroundings add.
    sky_polarised
        Upper limit of the polarised light that the sky adds.
    sky_again, sky_again_polarised
        The same of light that was scattered more than once, and not only by the ground before; infinite where no
        useful limit is known.
    apart
        Largest difference of the beam's light from its middle, of directions at which it is known.
    spread
        Upper limit of the difference between a direction of the field and its middle, over S0.
    deviation
        Upper limit of the root of the mean square of that difference.
    depth, depth_below
        Largest optical depth in the band, of all air and of that below the camera.
    texture, field_cov
        Covariance of the texture and over the field, shape (3, 3), where they are known [(W m-2 sr-1)^2].
    """

    beams: FloatArray
    s0_low: float
    s0_high: float
    polarised_low: float
    polarised_high: float
    sky: float = 0.0
    sky_polarised: float = 0.0
    sky_again: float = np.inf
    sky_again_polarised: float = np.inf
    path: float = 0.0
    adjacency: float = 0.0
    apart: float = 0.0
    spread: float = 0.0
    deviation: float = 0.0
    depth: float = np.inf
    depth_below: float = np.inf
    texture: FloatArray | None = None
    field_cov: FloatArray | None = None

    @property
    def added(self) -> float:
        """Upper limit of all that comes beside the beam."""
        return self.sky + self.path + self.adjacency


def known_light(light: RegionLight, *, margin: float = 0.0) -> LightLimits:
    """Return the limits of a region whose light is known.

    Parameters
    ----------
    light
        Of the region.
    margin
        By which its radiance may be off, as a share: what was left out of it, 0 or more.
    """
    stokes = np.asarray(light.stokes_radiance, dtype=np.float64)
    s0, polarised = float(stokes[0]), float(np.hypot(stokes[1], stokes[2]))
    apart = margin * s0
    off = np.array([2.0 * apart, 0.0, 0.0])
    texture = light.texture_rms**2 * np.outer(stokes, stokes) + light.texture_cov
    return LightLimits(
        beams=np.stack([stokes - off, stokes + off]),
        s0_low=s0 - apart,
        s0_high=s0 + apart,
        polarised_low=max(polarised - apart, 0.0),
        polarised_high=polarised + apart,
        texture=(1.0 + margin) ** 2 * texture,
        field_cov=light.field_cov,
    )
