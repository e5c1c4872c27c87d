"""Bounds of what noise, pattern and texture add to the covariance of a region.

Arguments and result of each are those of `model.effects.effect_models.EffectModel.bound`.
"""

import numpy as np

from model.effects.bound import NOTHING, Disturbance
from model.effects.light_limits import LightLimits
from model.effects.radiance_bounds import RegionBounds
from model.scene.lit_scene import LitScene
from model.sensor.pixel_noise import saturation_probability

# The share that a factor common to a pixel's Stokes vector is of its DoLP, over the factor's root mean square: 2, and
# room for larger factors, up to a twentieth.
_OF_FACTOR, _LARGEST_FACTOR = 2.3, 0.05


def dark_current(scene: LitScene, region: RegionBounds, _light: LightLimits) -> Disturbance:
    """Return the share of dark electrons' shot noise: their mean is taken off, and they add to nothing else."""
    noise = scene.sensor.noise
    dark_dn = noise.gain_dn_per_e * noise.dark_current_e_per_s * scene.sensor.exposure_s
    variance = noise.noise_factor**2 * noise.gain_dn_per_e * dark_dn
    return _temporal(region, np.full_like(region.signal_low, variance))


def read_noise(scene: LitScene, region: RegionBounds, _light: LightLimits) -> Disturbance:
    """Return the share of the read noise."""
    noise = scene.sensor.noise
    variance = (noise.noise_factor * noise.gain_dn_per_e * noise.read_noise_e) ** 2
    return _temporal(region, np.full_like(region.signal_low, variance))


def quantisation(scene: LitScene, region: RegionBounds, _light: LightLimits) -> Disturbance:
    """Return the share of 1/12 DN^2."""
    noise = scene.sensor.noise
    return _temporal(region, np.full_like(region.signal_low, noise.noise_factor**2 / 12.0))


def shot_noise(scene: LitScene, region: RegionBounds, _light: LightLimits) -> Disturbance:
    """Return the share of the shot noise of light, which grows with the light: that at its upper limit.

    A covariance of the texture that does not depend on the light is counted beside it.
    """
    noise = scene.sensor.noise
    variance = noise.noise_factor**2 * noise.gain_dn_per_e * region.signal_high
    return Disturbance(share=region.temporal_share(variance, bright=True)) if np.any(variance) else NOTHING


def texture(scene: LitScene, region: RegionBounds, _light: LightLimits) -> Disturbance:
    """Return the share of the texture at the upper limit of the light, over the noise of a mean over the cycles."""
    if not np.any(region.texture):
        return NOTHING
    if not region.is_known:
        return Disturbance(share=np.inf)
    factor = 1.0 + scene.sensor.noise.prnu**2
    share = region.spatial_share(factor * region.to_channels(region.texture))
    one, is_still = region.region, scene.imperfections.misregistration_pixels == 0.0
    if one.radiance is None or not is_still or any(one.texture_diagonal) or one.texture_rms > _LARGEST_FACTOR:
        # Of a material the path has no texture, and pictures that shift differ in it: it is no common factor there.
        return Disturbance(share=share)
    own = region.counts_per_radiance**2 * one.texture_cov
    rest = region.spatial_share(factor * region.to_channels(own)) if np.any(own) else 0.0
    return Disturbance(share=share, share_of_dolp=min(rest + _OF_FACTOR * one.texture_rms, share))


def nonuniformity(scene: LitScene, region: RegionBounds, _light: LightLimits) -> Disturbance:
    """Return the share of PRNU and DSNU at the upper limit of the light, in the noise of a mean over the cycles."""
    noise = scene.sensor.noise
    if noise.prnu == 0.0 and noise.dsnu_e == 0.0:
        return NOTHING
    if not region.is_known:
        return Disturbance(share=np.inf)
    ones, gain = np.ones_like(region.signal_high), noise.gain_dn_per_e
    rest = noise.prnu**2 * region.to_channels(region.cov_high) + (gain * noise.dsnu_e) ** 2 * np.outer(ones, ones)
    share = region.spatial_share(noise.prnu**2 * np.outer(region.signal_high, region.signal_high) + rest)
    if noise.prnu > _LARGEST_FACTOR:
        return Disturbance(share=share)
    return Disturbance(share=share, share_of_dolp=min(region.spatial_share(rest) + _OF_FACTOR * noise.prnu, share))


def saturation(scene: LitScene, region: RegionBounds, _light: LightLimits) -> Disturbance:
    """Return the chance that a pixel is clipped: of so many pixels the linear model says nothing.

    No number of a prediction depends on it; it decides whether a warning is given.
    """
    if not region.is_known:
        return Disturbance(counts=1.0)
    noise = scene.sensor.noise
    dark_dn = noise.gain_dn_per_e * noise.dark_current_e_per_s * scene.sensor.exposure_s
    cov = region.to_channels(region.cov_high)
    chance = saturation_probability(scene.sensor, region.signal_high + dark_dn, region.variance_high, cov)
    return Disturbance(counts=float(np.max(chance)))


def _temporal(region: RegionBounds, variances: np.ndarray) -> Disturbance:
    return Disturbance(share=region.temporal_share(variances)) if np.any(variances) else NOTHING
