"""Bounds of what a leaking or turned polarizer, pictures that shift, and light that drifts change of a region.

Arguments and result of each are those of `model.effects.effect_models.EffectModel.bound`.
"""

import numpy as np

from model.effects.bound import NOTHING, UNKNOWN, Disturbance
from model.effects.light_limits import LightLimits
from model.effects.radiance_bounds import RegionBounds, share_of
from model.scene.lit_scene import LitScene


def leakage(scene: LitScene, region: RegionBounds, _light: LightLimits) -> Disturbance:
    """Return what a finite extinction ratio 1/e changes, being calibrated: counts and noise, no Stokes parameter.

    Notes
    -----
    Counts grow by at most 2 e of their mean. The inverse divides the noise of S0 by 1 + e and that of S1 and S2 by
    1 - e: with condition c of the noise's covariance, its share changes by at most 2 e (1 + e) sqrt(c) / (1 - e)^2,
    beside what 2 e more light brings of shot noise. Where the light is known the two covariances of noise are compared.
    Where angles scatter or pictures shift, c is that of the whole covariance. Drift, which mixes Stokes parameters by a
    share x, does so by 2 e / (1 - e) x more or less.
    """
    along, across = scene.sensor.tau_parallel, scene.sensor.tau_perpendicular
    if across == 0.0 and np.isinf(scene.readout.extinction_ratio):
        return NOTHING
    if not region.is_known:
        return UNKNOWN
    e, noise = across / along, scene.sensor.noise
    if e >= 0.5:
        return UNKNOWN
    mixed = 2.0 * e / (1.0 - e) * region.crosstalk
    share = max(_leaked_share(scene, region, e), 2.0 * e * (1.0 + 2.0 * e))
    session = scene.imperfections
    if not region.is_exact or session.polarizer_angle_std_rad > 0.0 or session.misregistration_pixels > 0.0:
        least, most = np.linalg.eigvalsh(region.noise_low)[0], np.linalg.eigvalsh(region.cov_high)[-1]
        turned = 2.0 * e * (1.0 + e) / (1.0 - e) ** 2 * np.sqrt(most / least) if least > 0.0 else np.inf
        more = np.full_like(region.signal_low, noise.noise_factor**2 * noise.gain_dn_per_e * e * region.s0_high)
        share = max(share, float(turned) + region.temporal_share(more) * (1.0 + e) / (1.0 - e))
    share += _of_scene(region, mixed) if mixed > 0.0 else 0.0
    return Disturbance(counts=2.0 * e, s0=mixed, polarised=mixed, share=share)


def polarizer_angle(scene: LitScene, region: RegionBounds, _light: LightLimits) -> Disturbance:
    """Return what angles that scatter by s change: exp(-2 s^2) of (S1, S2), and a variance of each channel.

    Notes
    -----
    Covariances of what differs over the region keep exp(-4 s^2) of their polarised part. The variance is at most
    Q^2 (1 - exp(-8 s^2)) / 2 + Q^2 (1 - exp(-4 s^2))^2 / 2 times the square of half the counts, Q^2 being the mean
    square of the polarised light, texture included.
    """
    std_rad, noise = scene.imperfections.polarizer_angle_std_rad, scene.sensor.noise
    if std_rad == 0.0:
        return NOTHING
    if not region.is_known:
        return UNKNOWN
    lost = -np.expm1(-2.0 * std_rad**2)
    polarised = lost * region.polarised_high / region.s0_low / (1.0 - lost)
    own = region.texture
    square = region.polarised_high**2 / (1.0 - lost) ** 2 + float(own[1, 1] + own[2, 2])
    factor = 0.5 * -np.expm1(-8.0 * std_rad**2) + 0.5 * np.expm1(-4.0 * std_rad**2) ** 2
    drifted = (1.0 + 0.5 * abs(scene.imperfections.drift)) ** 2
    variances = np.full_like(region.signal_low, 0.25 * drifted * square * factor)
    ratio = region.temporal_share(variances)
    share = ratio / (1.0 + ratio) if np.isfinite(ratio) else np.inf
    gain = np.full_like(
        region.signal_low, noise.gain_dn_per_e * noise.noise_factor**2 * 0.5 * region.s0_low * polarised
    )
    mixed = region.crosstalk * polarised
    polarised = polarised + mixed
    return Disturbance(
        s0=mixed, polarised=polarised, share=share + region.temporal_share(gain) + _of_scene(region, lost)
    )


def misregistration(scene: LitScene, region: RegionBounds, _light: LightLimits) -> Disturbance:
    """Return what shifts of the picture take from the correlation of texture between frames.

    Notes
    -----
    With kappa the correlation that is kept, (1 - kappa) of the covariance C of the channels goes over to its diagonal:
    the change lies between -(1 - kappa) C and (1 - kappa) diag C.
    """
    kept = scene.imperfections.kept_correlation
    if kept == 1.0 or not np.any(region.texture):
        return NOTHING
    if not region.is_known:
        return UNKNOWN
    channels = region.to_channels(region.texture)
    gained = region.spatial_share((1.0 - kept) * np.diag(np.diag(channels)), is_part=False)
    return Disturbance(share=gained * (1.0 + scene.sensor.noise.prnu**2) + (1.0 - kept))


def drift(scene: LitScene, region: RegionBounds, _light: LightLimits) -> Disturbance:
    """Return what light that drifts does to the Stokes parameters: W diag(f - 1) applied to the largest counts.

    Notes
    -----
    Each frame k has the factor f_k; the change of a Stokes parameter is at most sum |W_jk| |f_k - 1| I_k, and noise and
    texture change by at most |f_k - 1| and twice that of themselves.
    """
    if scene.imperfections.drift == 0.0:
        return NOTHING
    if not region.is_known:
        return UNKNOWN
    size = 0.5 * abs(scene.imperfections.drift)
    apart = np.abs(scene.imperfections.light_factors(region.signal_low.size) - 1.0) / (1.0 - size)
    most = np.abs(region.inverse) @ (apart * region.signal_high) / region.s0_low
    moved = float(np.hypot(most[1], most[2]))
    counts = np.full_like(region.signal_low, size)
    noise = scene.sensor.noise
    shot = noise.noise_factor**2 * noise.gain_dn_per_e * counts * region.signal_high / (1.0 - size)
    return Disturbance(
        s0=float(most[0]),
        polarised=moved,
        counts=2.0 * size,
        share=region.temporal_share(shot) + _of_scene(region, size / (1.0 - size)),
    )


def _of_scene(region: RegionBounds, change: float) -> float:
    """Share by which texture, pattern and spread over the field change where their amplitudes change by a share."""
    # Twice for the channels, of which each changes by its own share: |D C^(1/2)| is at most the largest share times it.
    widest = float(np.linalg.eigvalsh(region.cov_high)[-1])
    amplitude = np.sqrt(region.spatial_share(region.to_channels(4.0 * change**2 * widest * np.eye(3)), is_part=False))
    return float(2.0 * amplitude + amplitude**2)


def _leaked_share(scene: LitScene, region: RegionBounds, e: float) -> float:
    """Largest relative change of the noise's covariance, in Stokes parameters and in channels."""
    noise = scene.sensor.noise
    ideal = np.diag([1.0 + e, 1.0 - e, 1.0 - e]) @ region.inverse
    darker = e * (region.s0_high * 0.5) * np.ones_like(region.signal_low)
    fewer = region.variance_low - noise.noise_factor**2 * noise.gain_dn_per_e * np.minimum(
        darker * 2.0, region.signal_low
    )
    alone = ideal @ np.diag(fewer) @ ideal.T
    more, less = share_of(alone, region.noise_low), share_of(region.noise_low, alone)
    in_channels = share_of(np.diag(region.variance_low - fewer), np.diag(region.variance_low))
    wholly = ideal @ np.diag(region.variance_low) @ ideal.T
    larger = share_of(wholly, region.noise_low)
    lowest = 1.0 / less if less > 0.0 else 0.0
    return float(max(more - 1.0, larger - 1.0, 1.0 - lowest, in_channels))
