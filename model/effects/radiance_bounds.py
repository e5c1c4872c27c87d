"""Bounds of the radiance and the covariance of a region, known before anything is solved."""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from model.effects.light_limits import LightLimits
from model.processing.reconstruction import design
from model.scene.falloff import cosine_fourth
from model.scene.lit_scene import LitRegion, LitScene
from model.sensor.electrons import electrons_per_radiance
from model.sensor.pixel_noise import temporal_variance_dn2
from model.stokes import analyzer_row

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class RegionBounds:
    """Limits of one region, in counts [DN]; equal where its radiance is given.

    Attributes
    ----------
    s0_low, s0_high, polarised_low, polarised_high
        Mean of S0, and length of (S1, S2).
    signal_low, signal_high
        Mean of each channel, shape (N,).
    variance_low, variance_high
        Temporal variance of each channel at these signals, shape (N,) [DN^2].
    inverse
        From channels to Stokes parameters, shape (3, N).
    counts_per_radiance
        Stokes parameters in counts per Stokes radiance [DN per W m-2 sr-1].
    noise_low, noise_high
        Covariance of the Stokes parameters from temporal noise at these signals, shape (3, 3).
    texture
        Upper bound of the texture's covariance of the Stokes parameters, shape (3, 3).
    cov_high
        Upper bound of their whole covariance.
    own_high
        The same without what is a factor common to a pixel's Stokes vector, which its DoLP does not show.
    cycles
        Over which means are taken.
    crosstalk
        Share by which light that drifts through a cycle mixes the Stokes parameters at most.
    """

    region: LitRegion
    s0_low: float
    s0_high: float
    polarised_low: float
    polarised_high: float
    signal_low: FloatArray
    signal_high: FloatArray
    variance_low: FloatArray
    variance_high: FloatArray
    inverse: FloatArray
    counts_per_radiance: float
    noise_low: FloatArray
    noise_high: FloatArray
    texture: FloatArray
    cov_high: FloatArray
    own_high: FloatArray
    cycles: int
    crosstalk: float

    @property
    def is_known(self) -> bool:
        """True if there is light for certain, and not without limit."""
        return self.s0_low > 0.0 and bool(np.isfinite(self.s0_high))

    @property
    def is_exact(self) -> bool:
        """True if the limits are equal."""
        return self.s0_low == self.s0_high

    def to_channels(self, cov: FloatArray) -> FloatArray:
        """Return a covariance of Stokes parameters as one of channels, shape (N, N)."""
        system = np.linalg.pinv(self.inverse)
        return np.asarray(system @ cov @ system.T)

    @cached_property
    def share_of_noise(self) -> float:
        """Share of a temporal variance of 1 DN^2 of every channel; of another it is as much larger."""
        return self.temporal_share(np.ones_like(self.signal_low))

    @cached_property
    def share_of_light(self) -> float:
        """Ratio of a variance of 1 DN^2 of every Stokes parameter to the least noise of a mean over the cycles."""
        return self.spatial_share(self.to_channels(np.eye(3)), is_part=False)

    def temporal_share(self, variances: FloatArray, *, bright: bool = False) -> float:
        """Return the share of a part of the temporal variance, in any direction and channel.

        Parameters
        ----------
        variances
            Of the channels, shape (N,) [DN^2].
        bright
            Whether the share is largest where the light is.
        """
        if not np.any(variances):
            return 0.0
        whole, each = (self.noise_high, self.variance_high) if bright else (self.noise_low, self.variance_low)
        in_stokes = share_of(_of_channels(self.inverse, variances), whole)
        # Of channels that vary apart the largest ratio is that of one of them.
        if not np.all(np.isfinite(each)) or np.any((each <= 0.0) & (variances > 0.0)):
            return np.inf
        ratios = np.divide(variances, each, out=np.zeros_like(variances), where=variances > 0.0)
        return max(in_stokes, float(np.max(ratios)))

    def spatial_share(self, cov: FloatArray, *, is_part: bool = True) -> float:
        """Return the share of a part of the covariance over pixels, of channels, shape (N, N) [DN^2].

        Means over cycles have the least noise beside it, and so the largest share. A part of the whole has a share of
        r / (1 + r), r being its ratio to the rest; something that is no part has r.
        """
        in_stokes = share_of(self.inverse @ cov @ self.inverse.T, self.noise_low / self.cycles)
        ratio = max(in_stokes, share_of(cov, np.diag(self.variance_low) / self.cycles))
        return ratio / (1.0 + ratio) if is_part and np.isfinite(ratio) else ratio


# One plan asks for the bounds of effects in several groups: records are known by their identity.
@lru_cache(maxsize=32)
def radiance_bounds(scene: LitScene, region: LitRegion, light: LightLimits) -> RegionBounds:
    """Return the limits of a region.

    Parameters
    ----------
    scene
        All that the scene is.
    region
        One of its regions.
    light
        Limits of its radiance.

    Notes
    -----
    Light of sky and path adds to every channel, so that what the beam alone gives is a lower limit; noise grows with
    the light. Drift, falloff and scatter of angles widen the limits. Drift by d mixes Stokes parameters by W diag(f) M
    - 1, at most d / 2 times the condition of M.
    """
    sensor, readout, session = scene.sensor, scene.readout, scene.imperfections
    scale = sensor.noise.gain_dn_per_e * electrons_per_radiance(sensor) * sensor.tau_parallel
    least, most = (scale * factor for factor in _factors(scene, region))
    low, high = _signals(scene, light, least, most)
    plan = design(readout.angles_rad, readout.extinction_ratio)
    variance_low, variance_high = (
        temporal_variance_dn2(one, noise=sensor.noise, exposure_s=sensor.exposure_s) for one in (low, high)
    )
    noise_low, noise_high = (_of_channels(plan.inverse, one) for one in (variance_low, variance_high))
    s0_high = most * (light.s0_high + light.added)
    texture = _texture_high(region, light, s0_high=s0_high, scale=scale)
    over_field = _over_field(scene, region, light, s0_high=s0_high, scale=most)
    turned = noise_high + over_field + _scatter_high(scene, texture, plan.inverse, s0_high)
    apart = _apart_high(region, light, texture, s0_high=s0_high, scale=scale)
    return RegionBounds(
        region=region,
        s0_low=least * light.s0_low,
        s0_high=s0_high,
        polarised_low=least * session.kept_polarization * max(light.polarised_low - light.added, 0.0),
        polarised_high=min(most * (light.polarised_high + light.added), s0_high),
        signal_low=low,
        signal_high=high,
        variance_low=variance_low,
        variance_high=variance_high,
        inverse=plan.inverse,
        counts_per_radiance=scale,
        noise_low=noise_low,
        noise_high=noise_high,
        texture=texture,
        cov_high=turned + _with_light(scene, texture, plan.inverse, high, s0_high),
        own_high=turned + _with_light(scene, apart, plan.inverse, np.zeros_like(high), s0_high),
        cycles=readout.cycles,
        crosstalk=np.sqrt(2.0) * 0.5 * abs(session.drift) * plan.condition,
    )


def _factors(scene: LitScene, region: LitRegion) -> tuple[float, float]:
    """Least and largest share of the light on the axis that arrives, with drift and falloff."""
    session = scene.imperfections
    least, most = 1.0 - 0.5 * abs(session.drift), 1.0 + 0.5 * abs(session.drift)
    if session.off_axis_falloff and region.part is not None:
        least *= cosine_fourth(region.part).mean
    return least, most


def _signals(scene: LitScene, light: LightLimits, least: float, most: float) -> tuple[FloatArray, FloatArray]:
    """Least and largest mean of each channel, (N,) each, of so many counts per radiance."""
    sensor, kept = scene.sensor, scene.imperfections.kept_polarization
    rows = analyzer_row(scene.readout.angles_rad, 1.0, sensor.tau_perpendicular / sensor.tau_parallel)
    weakened = rows * np.array([1.0, kept, kept])
    beams = np.concatenate([light.beams @ rows.T, light.beams @ weakened.T])
    return least * np.maximum(beams.min(axis=0), 0.0), most * (beams.max(axis=0) + light.added)


def _of_channels(inverse: FloatArray, variances: FloatArray) -> FloatArray:
    """Covariance of the Stokes parameters of channels that vary apart; infinite where no limit of one is known."""
    if not np.all(np.isfinite(variances)):
        return np.full((3, 3), np.inf)
    return np.asarray(inverse @ np.diag(variances) @ inverse.T)


def share_of(part: FloatArray, whole: FloatArray) -> float:
    """Return the largest ratio of two quadratic forms along any direction; infinite where the whole has none of it.

    Parameters
    ----------
    part, whole
        Symmetric matrices of one shape (N, N) and unit, of no negative eigenvalue.

    References
    ----------
    Definition; the largest eigenvalue of L^-1 P L^-T, L being the Cholesky factor of the whole.
    """
    if not np.any(part):
        return 0.0
    if not np.all(np.isfinite(part)) or not np.all(np.isfinite(whole)):
        return np.inf
    try:
        root = np.linalg.cholesky(whole)
    except np.linalg.LinAlgError:
        return np.inf
    relative = np.linalg.solve(root, np.linalg.solve(root, part).T)
    return float(max(np.linalg.eigvalsh(relative)[-1], 0.0))


def _texture_high(region: LitRegion, light: LightLimits, *, s0_high: float, scale: float) -> FloatArray:
    """Upper bound of the texture's covariance, as it is known or as the light allows.

    A factor common to a vector R has the covariance t^2 R R', at most t^2 |R|^2 <= 2 t^2 S0^2 along any direction.
    """
    if light.texture is not None:
        return scale**2 * light.texture
    if not np.isfinite(s0_high):
        is_there = region.texture_rms > 0.0 or any(region.texture_diagonal) or bool(np.any(region.texture_cov))
        return np.full((3, 3), np.inf) if is_there else np.zeros((3, 3))
    common = 2.0 * (region.texture_rms * s0_high) ** 2 * np.eye(3)
    own = np.diag(np.square(region.texture_diagonal)) * s0_high**2
    return np.asarray(common + own + scale**2 * region.texture_cov)


def _over_field(scene: LitScene, region: LitRegion, light: LightLimits, *, s0_high: float, scale: float) -> FloatArray:
    """Upper bound of the covariance over the field of view, by geometry and by the lens."""
    if not np.isfinite(s0_high * light.deviation):
        return np.full((3, 3), np.inf)
    lens = scene.imperfections.off_axis_falloff and region.part is not None
    var = cosine_fourth(region.part).var if lens and region.part is not None else 0.0
    geometry = np.zeros((3, 3)) if light.field_cov is None else scale**2 * light.field_cov
    return np.asarray(geometry + s0_high**2 * (light.deviation + np.sqrt(2.0 * var)) ** 2 * np.eye(3))


def _apart_high(
    region: LitRegion, light: LightLimits, texture: FloatArray, *, s0_high: float, scale: float
) -> FloatArray:
    """Upper bound of the part of the texture that is no factor common to a pixel's Stokes vector.

    What path and surroundings add has no texture: the factor of the rest is off the whole by no more than they are.
    """
    if region.radiance is not None:
        return np.asarray(scale**2 * region.texture_cov + np.diag(np.square(region.texture_diagonal)) * s0_high**2)
    if light.texture is not None or not np.isfinite(s0_high):
        return texture
    untextured = 2.0 * (region.texture_rms * scale * (light.path + light.adjacency)) ** 2 * np.eye(3)
    return _texture_high(replace(region, texture_rms=0.0), light, s0_high=s0_high, scale=scale) + untextured


def _scatter_high(scene: LitScene, texture: FloatArray, inverse: FloatArray, s0_high: float) -> FloatArray:
    """Upper bound of the covariance from offsets of pixels, shifts and scatter of angles."""
    noise, session = scene.sensor.noise, scene.imperfections
    if not np.isfinite(s0_high):
        return np.full((3, 3), np.inf)
    frames = inverse.shape[1]
    turned = (2.0 * session.polarizer_angle_std_rad * s0_high) ** 2
    shifted = 0.0 if session.misregistration_pixels == 0.0 else float(np.trace(texture))
    offsets = (noise.gain_dn_per_e * noise.dsnu_e) ** 2 * np.ones((frames, frames))
    return np.asarray(inverse @ (offsets + (turned + shifted) * np.eye(frames)) @ inverse.T)


def _with_light(
    scene: LitScene, texture: FloatArray, inverse: FloatArray, high: FloatArray, s0_high: float
) -> FloatArray:
    """Upper bound of the covariance from texture and from what pixels differ by in their response."""
    if not np.isfinite(s0_high):
        return np.full((3, 3), np.inf)
    prnu, drifted = scene.sensor.noise.prnu, (1.0 + 2.0 * abs(scene.imperfections.drift)) ** 2
    return np.asarray(drifted * (1.0 + prnu**2) * texture + inverse @ (prnu**2 * np.outer(high, high)) @ inverse.T)
