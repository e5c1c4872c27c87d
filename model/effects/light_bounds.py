"""Bounds of what parts of the light, the field and the band change of a region.

Arguments and result of each are those of `model.effects.effect_models.EffectModel.bound`.
"""

import numpy as np

from model.effects.bound import NOTHING, UNKNOWN, Disturbance
from model.effects.light_limits import LightLimits
from model.effects.radiance_bounds import RegionBounds
from model.effects.sun_light import SKY_ROOM
from model.scene.falloff import cosine_fourth
from model.scene.field_of_view import half_diagonal_rad
from model.scene.lit_scene import Air, LitScene

# Optical depth falls at most as this power of the wavelength: molecules have 4.1, no aerosol more.
_POWER = 4.2
# Least bound of skylight in daylight, over the light of the beam.
_LEAST_SKY = 0.1


def skylight(scene: LitScene, region: RegionBounds, light: LightLimits) -> Disturbance:
    """Return what the sky adds: the largest reflectance times all of its light (`model.effects.sun_light`)."""
    if scene.source not in ("total", "reflected", "reflected_sky") or light.sky == 0.0:
        return NOTHING
    return added(scene, region, light.sky, dolp=light.sky_polarised / light.sky if np.isfinite(light.sky) else 1.0)


def path_radiance(scene: LitScene, region: RegionBounds, light: LightLimits) -> Disturbance:
    """Return what the air adds between region and camera (`model.effects.air_bounds.path_bound`)."""
    return added(scene, region, light.path) if scene.source in ("total", "path") else NOTHING


def adjacency(scene: LitScene, region: RegionBounds, light: LightLimits) -> Disturbance:
    """Return what the surroundings add: their radiance beyond that of the mean ground, times what air scatters.

    The radiance is |A' - A| G / pi with G the irradiance of the ground, and of it T^b - T arrive, unpolarised.
    """
    return added(scene, region, light.adjacency, dolp=0.0) if scene.source in ("total", "path") else NOTHING


def field_of_view(scene: LitScene, region: RegionBounds, light: LightLimits) -> Disturbance:
    """Return the largest difference over the field from its middle, as a shift of the mean and as a spread.

    Notes
    -----
    The beam's light is known at the middle, the edges and the corners; it may go twice as far between, and its root
    mean square is at most the largest difference of these. The reflected sky changes by at most 2 (1 / m + 4 / mu) of
    itself per radian, m being the rms slope, the path by 2 / mu + 10.
    """
    if light.spread == 0.0:
        return NOTHING
    if not (region.is_known and light.spread < 1.0):
        return UNKNOWN
    moved = _moved(scene, region, light.spread, light.spread)
    spread = region.to_channels((light.deviation * region.s0_high) ** 2 * np.eye(3))
    return Disturbance(s0=moved.s0, polarised=moved.polarised, share=moved.share + region.spatial_share(spread))


def wavelengths(scene: LitScene, region: RegionBounds, light: LightLimits) -> Disturbance:
    """Return what one wavelength, the mean of the band, misses of sky, path and transmittance.

    Notes
    -----
    Light L of a depth tau ~ lambda^-4.2 changes by at most K per relative wavelength, K = 4.2 (1 + 2 tau / mu0 +
    2 tau / mu_v), and its curvature is at most K (K + 5). At the mean of the band the slope drops out
    (`model.atmosphere.spectral_rule`): with the variance v of the relative wavelength over the band K (K + 5) v / 2 of
    all that the air scatters, but of no more than there may be of it. The transmittance T of the air below the camera,
    of slant depth x, changes by 4.2 x per relative wavelength and its curvature is at most 4.2 x (4.2 x + 5); weighted
    by the beam, whose own slope is at most K, it misses 4.2 x (4.2 x + 5 + 2 K) v / 2 of what is reflected.
    """
    if region.region.surface is None or scene.air is None or scene.view is None:
        return NOTHING
    air = scene.air
    if air.table is not None:
        return NOTHING
    slant = 1.0 / np.cos(scene.view.zenith_rad)
    steepness = _steepness(air, light.depth, slant)
    way = _POWER * light.depth_below * slant
    variance = _relative_variance(air)
    scattered = min(region.counts_per_radiance * light.added / region.s0_low, 1.0) if region.is_known else 1.0
    missed = 0.5 * variance * steepness * (steepness + 5.0) * scattered
    missed += 0.5 * variance * way * (way + 5.0 + 2.0 * steepness)
    return _moved(scene, region, missed, missed) if missed < 1.0 and region.is_known else UNKNOWN


def falloff(scene: LitScene, region: RegionBounds, _light: LightLimits) -> Disturbance:
    """Return mean and variance of cos^4 over the region's part of the field: both are closed integrals.

    Notes
    -----
    A factor common to the Stokes vector with mean m and variance v leaves ratios of the mean alone; noise over light
    changes by at most 1 / m^2 - 1, and v S S' is added to the covariance.
    """
    part = region.region.part
    if part is None or not scene.imperfections.off_axis_falloff:
        return NOTHING
    if not region.is_known:
        return UNKNOWN
    found = cosine_fourth(part)
    apart = region.to_channels(found.var / found.mean**2 * 2.0 * region.s0_high**2 * np.eye(3))
    return Disturbance(factor=1.0 / found.mean - 1.0, share=found.mean**-4 - 1.0 + region.spatial_share(apart))


def may_be_small(scene: LitScene, *, depth: float, tolerance: float) -> bool:
    """Return whether field or band of a scene in daylight may be found small enough to be left out.

    Parameters
    ----------
    scene
        All that the scene is.
    depth
        Optical depth of its air, 0.05 or more.
    tolerance
        That the sum of what is left out may reach, 0.05 or less.

    Notes
    -----
    The bound of skylight is a tenth of the beam's light at the least there: 2.25 depth / mu0^2. With so much of it no
    bound of skylight is within the tolerance, and this is what the bounds of field and band come to at the least.
    """
    air, view = scene.air, scene.view
    if air is None or view is None:
        return True
    slant = 1.0 / np.cos(view.zenith_rad)
    steepness = _steepness(air, depth, slant)
    of_band = 0.5 * _relative_variance(air) * steepness * (steepness + 5.0) * _LEAST_SKY
    fields = [
        SKY_ROOM * _LEAST_SKY * 2.0 * (1.0 / one.surface.slope_rms + 4.0 * slant) * half_diagonal_rad(one.part)
        for one in scene.regions
        if one.surface is not None and one.part is not None
    ]
    return of_band <= tolerance or 0.0 < max(fields, default=0.0) <= tolerance


def _steepness(air: Air, depth: float, slant: float) -> float:
    """Most by which light that the air scatters changes per relative wavelength, over itself."""
    return float(_POWER * (1.0 + 2.0 * depth * (1.0 / np.cos(air.sun_zenith_rad) + slant)))


def _relative_variance(air: Air) -> float:
    """Variance over the band of the wavelength over its mean, by its inverse, as at the shortest wavelength."""
    shares, inverse = air.band.shares, 1.0 / air.band.wavelength_m
    mean = float(shares @ inverse / np.sum(shares))
    variance = float(shares @ (inverse / mean - 1.0) ** 2 / np.sum(shares))
    return variance * float((mean / np.min(inverse[shares > 0.0])) ** 2)


def added(scene: LitScene, region: RegionBounds, radiance: float, *, dolp: float = 1.0) -> Disturbance:
    """Return what light that is added changes.

    Parameters
    ----------
    scene, region
        A region, and where it is.
    radiance
        At most so much [W m-2 sr-1].
    dolp
        Share of it that may be polarised.
    """
    if radiance == 0.0:
        return NOTHING
    if not (region.is_known and np.isfinite(radiance)):
        return UNKNOWN
    share = region.counts_per_radiance * radiance / region.s0_low
    return _moved(scene, region, share, dolp * share) if share < 1.0 else UNKNOWN


def _moved(scene: LitScene, region: RegionBounds, s0: float, polarised: float) -> Disturbance:
    """Return a shift of the mean, with what it does to the shot noise and to the texture."""
    noise = scene.sensor.noise
    s0, polarised = s0 + region.crosstalk * max(s0, polarised), polarised + region.crosstalk * max(s0, polarised)
    counts = 0.5 * (s0 + polarised) * region.s0_high * 2.0
    variance = noise.noise_factor**2 * noise.gain_dn_per_e * counts
    share = _times(variance, region.share_of_noise) if noise.shot_noise else 0.0
    texture = _of_texture(scene, region, float(np.hypot(s0, polarised)))
    return Disturbance(
        s0=s0,
        polarised=polarised,
        share=share + texture + texture**2,
        share_of_dolp=share + texture / np.sqrt(region.cycles) + texture**2 / region.cycles,
    )


def _of_texture(scene: LitScene, region: RegionBounds, shift: float) -> float:
    """Amplitude b of what texture, pattern and spread over the field, which go with the light, change.

    A part v v' of a covariance C = N + v v' + ... that becomes (v + d) (v + d)' changes x'Cx by 2 (xv) (xd) + (xd)^2.
    With b the largest of |xd| over the root of x'Nx, and since 2 |xv| times that root is at most x'Cx, it is b + b^2 of
    x'Cx at most. N is the noise of a mean over cycles: of one cycle b is smaller by the root of their number. Over a
    field the light of each direction may change by all of the shift.
    """
    one, noise = region.region, scene.sensor.noise
    over_field = 0.0 if one.part is None else 1.0
    relative = noise.prnu + (1.0 + noise.prnu) * (one.texture_rms + max(one.texture_diagonal) + over_field)
    return _times(relative * shift * region.s0_high, float(np.sqrt(region.share_of_light))) if relative > 0.0 else 0.0


def _times(size: float, share: float) -> float:
    """Return so many times the share of a unit: none of nothing, and no limit where the size has none."""
    if size == 0.0:
        return 0.0
    return size * share if np.isfinite(size) else np.inf
