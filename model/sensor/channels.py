"""Mean and covariance of the counts behind a polarizer, from radiance at the aperture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import Moments
from model.sensor.electrons import electrons_per_radiance
from model.sensor.imperfections import PERFECT, Imperfections, angle_variance
from model.sensor.pixel_noise import saturation_probability, temporal_variance_dn2, unquantised_variance_dn2
from model.sensor.sensor import Sensor, SensorNoise
from model.stokes import analyzer_row

FloatArray = NDArray[np.float64]

# Below this noise rounding is not dithered: its mean is off by exp(-2 pi^2 sigma^2) / pi, 0.05 counts here.
_DITHER_LIMIT_DN = 0.3
# Above this chance of clipping the linear model no longer gives mean and variance.
_SATURATION_LIMIT = 1e-3


@dataclass(frozen=True, kw_only=True)
class ChannelMoments:
    """Moments of the counts behind each polarizer angle, per pixel.

    Parameters
    ----------
    mean_dn
        Mean signal, shape (..., N), black level and dark signal taken off [DN].
    dark_signal_dn
        What was taken off beside the black level: gain times dark electrons [DN].
    scene_cov_dn2
        Covariance from the scene, shape (..., N, N) [DN^2].
    temporal_var_dn2
        Variance from frame to frame of a constant scene, shape (..., N), independent between frames [DN^2].
    fixed_pattern_cov_dn2
        Covariance over pixels from PRNU and DSNU, shape (..., N, N) [DN^2].
    saturation_probability
        Chance that a pixel of the region is clipped, shape (..., N).
    warnings
        Where the Gaussian linear model is void, in words; empty if nowhere.
    """

    mean_dn: FloatArray
    dark_signal_dn: float
    scene_cov_dn2: FloatArray
    temporal_var_dn2: FloatArray
    fixed_pattern_cov_dn2: FloatArray
    saturation_probability: FloatArray
    warnings: tuple[str, ...]


def channel_moments(
    aperture: Moments,
    *,
    angles_rad: ArrayLike,
    sensor: Sensor,
    flat_fielded: bool = False,
    imperfections: Imperfections = PERFECT,
    smooth_cov: FloatArray | None = None,
) -> ChannelMoments:
    """Return mean and covariance of the counts behind a polarizer at each angle.

    Parameters
    ----------
    aperture
        Moments of the Stokes radiance at the aperture over the region, shape (..., 3)
        [W m-2 sr-1, in band]: light and scene texture, no sensor noise.
    angles_rad
        Angles of the polarizer axis, one per frame, shape (N,) [rad].
    sensor
        Optics, exposure, polarizer and noise.
    flat_fielded
        True if frames are divided by a flat field: PRNU is then zero.
    imperfections
        Of the session: angles that scatter, pictures that shift, light that drifts act here.
    smooth_cov
        The part of the aperture's covariance that varies so slowly over the picture that a shift leaves it alone;
        None for none of it.

    Returns
    -------
    ChannelMoments
        With the three sources of covariance apart.

    Raises
    ------
    ValueError
        If the mean light behind the polarizer is negative at an angle (DoLP of the aperture moments above 1).

    Notes
    -----
    The law of total covariance is exact here, since the variance of counts is linear in the light: the scene
    adds its own covariance and the temporal variance is taken at the mean.

    Angles that scatter weaken the mean of the polarised part by exp(-2 s^2) and add a variance from frame to frame,
    common to all pixels of a frame, which is counted with the temporal variance. Shifts take from the covariance of the
    texture between frames and leave its variances: what is common to all frames no longer is.

    Differs from [MK14]: eq. (19) is taken with the black level off and dark electrons in. PRNU and DSNU,
    which [MK14] has not, belong to a pixel, and in division of time the same pixel serves every angle.
    They are therefore fully correlated between angles: prnu^2 (s s' + Sigma_scene) + (gain dsnu)^2 1 1'.
    A PRNU pattern moves DoLP by nothing at first order; a DSNU pattern acts like an error of S0.

    References
    ----------
    [MK14] eq. (11)-(20), (32).
    """
    angles = np.atleast_1d(np.asarray(angles_rad, dtype=np.float64))
    to_dn = _counts_per_stokes(sensor, angles, imperfections)
    signal = np.einsum("ij,...j->...i", to_dn, aperture.mean)
    signal = _without_negative_rounding(signal, aperture.mean[..., :1] * to_dn[:, 0])
    scene = _scene_covariance(aperture.cov, smooth_cov, to_dn, imperfections)
    dark = sensor.noise.gain_dn_per_e * sensor.noise.dark_current_e_per_s * sensor.exposure_s
    unquantised = unquantised_variance_dn2(signal, noise=sensor.noise, exposure_s=sensor.exposure_s)
    pattern = _fixed_pattern(signal, scene, sensor.noise, flat_fielded=flat_fielded)
    temporal = temporal_variance_dn2(signal, noise=sensor.noise, exposure_s=sensor.exposure_s)
    temporal = temporal + _angle_variance_dn2(aperture, sensor, angles, imperfections)
    clipped = np.zeros_like(signal)
    if sensor.saturates:
        clipped = saturation_probability(sensor, signal + dark, unquantised, scene + pattern)
    return ChannelMoments(
        mean_dn=signal,
        dark_signal_dn=dark,
        scene_cov_dn2=scene,
        temporal_var_dn2=temporal,
        fixed_pattern_cov_dn2=pattern,
        saturation_probability=clipped,
        warnings=_warnings(angles, np.sqrt(unquantised) if sensor.noise.quantisation else None, clipped),
    )


def _counts_per_stokes(sensor: Sensor, angles_rad: FloatArray, imperfections: Imperfections) -> FloatArray:
    """Mean counts of each channel per Stokes radiance, shape (N, 3)."""
    rows = imperfections.analyzed(analyzer_row(angles_rad, sensor.tau_parallel, sensor.tau_perpendicular))
    return np.asarray(sensor.noise.gain_dn_per_e * electrons_per_radiance(sensor) * rows)


def _scene_covariance(
    cov: FloatArray, smooth_cov: FloatArray | None, to_dn: FloatArray, imperfections: Imperfections
) -> FloatArray:
    whole = to_dn @ cov @ to_dn.T
    if imperfections.misregistration_pixels == 0.0:
        return np.asarray(whole)
    smooth = np.zeros_like(whole) if smooth_cov is None else to_dn @ smooth_cov @ to_dn.T
    sharp, kept = whole - smooth, imperfections.kept_correlation
    own = np.eye(to_dn.shape[0])
    return np.asarray(smooth + sharp * (kept + (1.0 - kept) * own))


def _angle_variance_dn2(
    aperture: Moments, sensor: Sensor, angles_rad: FloatArray, imperfections: Imperfections
) -> FloatArray | float:
    if imperfections.polarizer_angle_std_rad == 0.0:
        return 0.0
    second = aperture.cov + aperture.mean[..., :, None] * aperture.mean[..., None, :]
    found = angle_variance(second, angles_rad=angles_rad, std_rad=imperfections.polarizer_angle_std_rad)
    half = 0.5 * (sensor.tau_parallel - sensor.tau_perpendicular)
    to_dn = sensor.noise.gain_dn_per_e * electrons_per_radiance(sensor) * half
    return np.asarray((to_dn * imperfections.light_factors(angles_rad.size)) ** 2 * found)


def _without_negative_rounding(signal: FloatArray, scale: FloatArray) -> FloatArray:
    """Set to zero what is negative by rounding (light across an ideal polarizer); refuse what is negative."""
    bound = 1e-12 * np.abs(scale)
    if np.any(signal < -bound):
        raise ValueError(
            f"aperture has a mean that gives negative light behind the polarizer ({np.min(signal):.3g} DN); "
            "allowed is DoLP <= 1 and S0 >= 0"
        )
    return np.where(signal < 0.0, 0.0, signal)


def _fixed_pattern(signal: FloatArray, scene: FloatArray, noise: SensorNoise, *, flat_fielded: bool) -> FloatArray:
    prnu = 0.0 if flat_fielded else noise.prnu
    # The response of a pixel multiplies its own share of the texture too, hence the scene's covariance.
    response = prnu**2 * (signal[..., :, None] * signal[..., None, :] + scene)
    return np.asarray(response + (noise.gain_dn_per_e * noise.dsnu_e) ** 2)


def _warnings(angles_rad: FloatArray, sigma_dn: FloatArray | None, clipped: FloatArray) -> tuple[str, ...]:
    found = []
    if sigma_dn is not None and np.any(sigma_dn < _DITHER_LIMIT_DN):
        where = _channels(angles_rad, sigma_dn < _DITHER_LIMIT_DN)
        found.append(
            f"noise before rounding is {np.min(sigma_dn):.3g} counts at {where}, below {_DITHER_LIMIT_DN}: "
            "rounding is not dithered and the Gaussian model is void"
        )
    if np.any(clipped > _SATURATION_LIMIT):
        where = _channels(angles_rad, clipped > _SATURATION_LIMIT)
        found.append(
            f"chance of saturation is {np.max(clipped):.3g} at {where}, above {_SATURATION_LIMIT:g}: "
            "the linear model is void"
        )
    return tuple(found)


def _channels(angles_rad: FloatArray, affected: NDArray[np.bool_]) -> str:
    any_pixel = affected.reshape(-1, angles_rad.size).any(axis=0)
    return ", ".join(f"{angle:.4g}" for angle in np.rad2deg(angles_rad[any_pixel])) + " deg"
