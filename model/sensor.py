"""From radiance at the aperture to counts behind a polarizer: mean and covariance of each channel."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import constants
from scipy.special import ndtr

from model.moments import Moments
from model.stokes import analyzer_row

FloatArray = NDArray[np.float64]

# Variance of a rounding error, uniform over one count.
_QUANTISATION_VAR_DN2 = 1.0 / 12.0
# Below this noise rounding is not dithered: its mean is off by exp(-2 pi^2 sigma^2) / pi, 0.05 counts here.
_DITHER_LIMIT_DN = 0.3
# Above this chance of clipping the linear model no longer gives mean and variance.
_SATURATION_LIMIT = 1e-3


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """Noise figures of a sensor, as a photon-transfer calibration gives them.

    Parameters
    ----------
    gain_dn_per_e
        Counts per electron, > 0 (the K of EMVA 1288; the reciprocal of a manual's "electrons per count").
    read_noise_e
        Standard deviation of the read noise [e-], >= 0, without quantisation.
    dark_current_e_per_s
        Dark current [e-/s], >= 0.
    black_level_dn
        Count without light or dark current [DN].
    prnu
        Photo-response non-uniformity, standard deviation relative to the mean, >= 0.
    dsnu_e
        Standard deviation of the dark signal over pixels [e-], >= 0; 0 if a dark frame is taken off.
    noise_factor
        Kn, >= 0: multiplies the standard deviation of the temporal sensor noise, and nothing of the scene.
    saturation_e
        Full well [e-], > 0, or None if the converter clips first.

    Raises
    ------
    ValueError
        If a value is outside its range.

    References
    ----------
    [MK14] eq. (19), (32).
    """

    gain_dn_per_e: float
    read_noise_e: float
    dark_current_e_per_s: float
    black_level_dn: float
    prnu: float = 0.0
    dsnu_e: float = 0.0
    noise_factor: float = 1.0
    saturation_e: float | None = None

    def __post_init__(self) -> None:
        _require_positive(gain_dn_per_e=self.gain_dn_per_e)
        if self.saturation_e is not None:
            _require_positive(saturation_e=self.saturation_e)
        _require_not_negative(
            read_noise_e=self.read_noise_e,
            dark_current_e_per_s=self.dark_current_e_per_s,
            prnu=self.prnu,
            dsnu_e=self.dsnu_e,
            noise_factor=self.noise_factor,
        )
        if not np.isfinite(self.black_level_dn):
            raise ValueError(f"black_level_dn = {self.black_level_dn} DN is not finite")


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """Optics, exposure and detector behind a linear polarizer.

    Parameters
    ----------
    pixel_pitch_m
        Side of a square pixel [m], > 0.
    f_number
        Focal length over aperture diameter, > 0 (at least 0.5 with the sine condition).
    optics_transmittance
        Transmittance of lens and filter in the band, without the polarizer, in (0, 1].
    quantum_efficiency
        Electrons per photon in the band, in (0, 1].
    wavelength_m
        Effective wavelength of the band [m], > 0; `model.spectral_response` gives it, and the form for a band
        resolved into samples.
    exposure_s
        Exposure time of a frame [s], > 0.
    bit_depth
        Bits of a count, 1 to 32; the largest count is 2**bit_depth - 1.
    tau_parallel, tau_perpendicular
        Power transmittance of the polarizer along and across its axis,
        0 <= tau_perpendicular <= tau_parallel <= 1.
    noise
        Noise figures.
    aperture
        "thin-lens": solid angle factor sin^2 = 1 / (1 + 4 f#^2), the form of [MK14];
        "sine": 1 / (4 f#^2), a lens that meets the sine condition.
    field_angle_rad
        Angle of the chief ray from the axis [rad], |angle| < pi/2; irradiance falls as its cos^4.

    Raises
    ------
    ValueError
        If a value is outside its range.

    References
    ----------
    [MK14] eq. (14), (17).
    """

    pixel_pitch_m: float
    f_number: float
    optics_transmittance: float
    quantum_efficiency: float
    wavelength_m: float
    exposure_s: float
    bit_depth: int
    tau_parallel: float
    tau_perpendicular: float
    noise: SensorNoise
    aperture: Literal["thin-lens", "sine"] = "thin-lens"
    field_angle_rad: float = 0.0

    def __post_init__(self) -> None:
        _require_positive(
            pixel_pitch_m=self.pixel_pitch_m,
            f_number=self.f_number,
            wavelength_m=self.wavelength_m,
            exposure_s=self.exposure_s,
        )
        _require_fraction(optics_transmittance=self.optics_transmittance, quantum_efficiency=self.quantum_efficiency)
        if self.bit_depth not in range(1, 33):
            raise ValueError(f"bit_depth = {self.bit_depth}; allowed is 1 to 32 bits")
        analyzer_row(0.0, self.tau_parallel, self.tau_perpendicular)
        if not abs(self.field_angle_rad) < 0.5 * np.pi:
            raise ValueError(f"field_angle_rad = {self.field_angle_rad} rad; allowed is below pi/2 in size")
        aperture_factor(self)


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

    @property
    def moments_dn(self) -> Moments:
        """Mean and total covariance of the channels over pixels and frames [DN, DN^2]."""
        temporal = self.temporal_var_dn2[..., :, None] * np.eye(self.mean_dn.shape[-1])
        return Moments(mean=self.mean_dn, cov=self.scene_cov_dn2 + temporal + self.fixed_pattern_cov_dn2)


def aperture_factor(sensor: Sensor) -> float:
    """Return the squared sine of the half angle of the light cone at a pixel, times cos^4 of the field.

    Parameters
    ----------
    sensor
        Uses `f_number`, `aperture` and `field_angle_rad`.

    Returns
    -------
    float
        Image irradiance is pi times radiance times this, in (0, 1].

    Raises
    ------
    ValueError
        For an unknown form, or the sine condition below f/0.5.

    Notes
    -----
    The two forms differ by (1 + 4 f#^2) / (4 f#^2), 6 % at f/2.

    References
    ----------
    [MK14] eq. (17) for the thin lens; definition.
    """
    vignetting = float(np.cos(sensor.field_angle_rad)) ** 4
    if sensor.aperture == "thin-lens":
        return vignetting / (1.0 + 4.0 * sensor.f_number**2)
    if sensor.aperture != "sine":
        raise ValueError(f'aperture = {sensor.aperture!r}; allowed is "thin-lens" or "sine"')
    if sensor.f_number < 0.5:
        raise ValueError(f"f_number = {sensor.f_number}; with the sine condition at least 0.5 is allowed")
    return vignetting / (4.0 * sensor.f_number**2)


def photon_conversion(sensor: Sensor) -> float:
    """Return pi A t sin^2 / (h c): electrons per radiance and wavelength of a pixel with unit efficiency.

    Parameters
    ----------
    sensor
        Pixel, exposure and aperture.

    Returns
    -------
    float
        [e- per (W m-2 sr-1) m].

    References
    ----------
    [MK14] eq. (17), with pi.
    """
    irradiance = np.pi * aperture_factor(sensor)
    energy = irradiance * sensor.pixel_pitch_m**2 * sensor.exposure_s
    return float(energy / (constants.h * constants.c))


def electrons_per_radiance(sensor: Sensor) -> float:
    """Return the photo-electrons of a pixel and frame per unit of band radiance behind the polarizer.

    Parameters
    ----------
    sensor
        Optics, exposure and quantum efficiency; the polarizer is not in this factor.

    Returns
    -------
    float
        [e- per W m-2 sr-1]; linear in exposure, pixel area and quantum efficiency.

    Notes
    -----
    Differs from [MK14]: eq. (17) as printed lacks pi. With one effective wavelength the relative error is
    lambda_used / lambda_effective - 1, see `model.spectral_response`.

    References
    ----------
    [MK14] eq. (17).
    """
    efficiency = sensor.optics_transmittance * sensor.quantum_efficiency
    return photon_conversion(sensor) * efficiency * sensor.wavelength_m


def counts_per_radiance(sensor: Sensor) -> float:
    """Return the counts of a pixel and frame behind the polarizer per unit of unpolarized band radiance.

    Parameters
    ----------
    sensor
        Optics, exposure, polarizer, quantum efficiency and gain.

    Returns
    -------
    float
        [DN per W m-2 sr-1], > 0: the mean over polarizer angles, black level and dark signal taken off.

    References
    ----------
    [MK14] eq. (11), (17), (19).
    """
    transmitted = 0.5 * (sensor.tau_parallel + sensor.tau_perpendicular)
    return sensor.noise.gain_dn_per_e * electrons_per_radiance(sensor) * transmitted


def channel_moments(
    aperture: Moments, *, angles_rad: ArrayLike, sensor: Sensor, flat_fielded: bool = False
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

    Differs from [MK14]: eq. (19) is taken with the black level off and dark electrons in. PRNU and DSNU,
    which [MK14] has not, belong to a pixel, and in division of time the same pixel serves every angle.
    They are therefore fully correlated between angles: prnu^2 (s s' + Sigma_scene) + (gain dsnu)^2 1 1'.
    A PRNU pattern moves DoLP by nothing at first order; a DSNU pattern acts like an error of S0.

    References
    ----------
    [MK14] eq. (11)-(20), (32).
    """
    angles = np.atleast_1d(np.asarray(angles_rad, dtype=np.float64))
    rows = analyzer_row(angles, sensor.tau_parallel, sensor.tau_perpendicular)
    gain = sensor.noise.gain_dn_per_e
    to_dn = gain * electrons_per_radiance(sensor) * rows
    signal = np.einsum("ij,...j->...i", to_dn, aperture.mean)
    signal = _without_negative_rounding(signal, aperture.mean[..., :1] * to_dn[:, 0])
    scene = to_dn @ aperture.cov @ to_dn.T
    dark = gain * sensor.noise.dark_current_e_per_s * sensor.exposure_s
    unquantised = _unquantised_variance(signal, noise=sensor.noise, exposure_s=sensor.exposure_s)
    pattern = _fixed_pattern(signal, scene, sensor.noise, flat_fielded=flat_fielded)
    clipped = _saturation_probability(sensor, signal + dark, unquantised, scene + pattern)
    return ChannelMoments(
        mean_dn=signal,
        dark_signal_dn=dark,
        scene_cov_dn2=scene,
        temporal_var_dn2=temporal_variance_dn2(signal, noise=sensor.noise, exposure_s=sensor.exposure_s),
        fixed_pattern_cov_dn2=pattern,
        saturation_probability=clipped,
        warnings=_warnings(angles, np.sqrt(unquantised), clipped),
    )


def temporal_variance_dn2(signal_dn: ArrayLike, *, noise: SensorNoise, exposure_s: ArrayLike) -> FloatArray:
    """Return the variance of a pixel's counts from frame to frame of a constant scene.

    Parameters
    ----------
    signal_dn
        Mean signal, black level and dark signal taken off, any shape [DN].
    noise
        Noise figures.
    exposure_s
        Exposure time, broadcast against the signal [s].

    Returns
    -------
    ndarray
        Kn^2 (shot noise of light and dark electrons + read noise + 1/12) [DN^2].

    Notes
    -----
    Differs from [MK14]: the signal in eq. (19) is taken with the black level off and dark electrons in.

    References
    ----------
    [MK14] eq. (19), (32).
    """
    variance = _unquantised_variance(signal_dn, noise=noise, exposure_s=exposure_s)
    return np.asarray(noise.noise_factor**2 * (variance + _QUANTISATION_VAR_DN2))


def _unquantised_variance(signal_dn: ArrayLike, *, noise: SensorNoise, exposure_s: ArrayLike) -> FloatArray:
    gain = noise.gain_dn_per_e
    dark_dn = gain * noise.dark_current_e_per_s * np.asarray(exposure_s, dtype=np.float64)
    shot = gain * (np.asarray(signal_dn, dtype=np.float64) + dark_dn)
    return np.asarray(shot + (gain * noise.read_noise_e) ** 2)


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


def _saturation_probability(
    sensor: Sensor, level: FloatArray, unquantised_var: FloatArray, spatial_cov: FloatArray
) -> FloatArray:
    """Return the larger of the chances of clipping in the converter and in the pixel's well."""
    noise = sensor.noise
    spatial = np.diagonal(spatial_cov, axis1=-2, axis2=-1)
    top = 2.0**sensor.bit_depth - 0.5 - noise.black_level_dn
    clipped = _exceedance(level, top, unquantised_var + spatial)
    if noise.saturation_e is None:
        return clipped
    well = noise.gain_dn_per_e * noise.saturation_e
    in_well = unquantised_var - (noise.gain_dn_per_e * noise.read_noise_e) ** 2 + spatial
    return np.maximum(clipped, _exceedance(level, well, in_well))


def _exceedance(mean: FloatArray, limit: float, var: FloatArray) -> FloatArray:
    sigma = np.sqrt(np.maximum(var, 0.0))
    certain = (mean > limit).astype(np.float64)
    return np.where(sigma > 0.0, ndtr((mean - limit) / np.where(sigma > 0.0, sigma, 1.0)), certain)


def _warnings(angles_rad: FloatArray, sigma_dn: FloatArray, clipped: FloatArray) -> tuple[str, ...]:
    found = []
    if np.any(sigma_dn < _DITHER_LIMIT_DN):
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


def _require_positive(**values: float) -> None:
    for name, value in values.items():
        if not (value > 0.0 and np.isfinite(value)):
            raise ValueError(f"{name} = {value}; allowed is finite and above 0")


def _require_not_negative(**values: float) -> None:
    for name, value in values.items():
        if not (value >= 0.0 and np.isfinite(value)):
            raise ValueError(f"{name} = {value}; allowed is finite and at least 0")


def _require_fraction(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value <= 1.0:
            raise ValueError(f"{name} = {value}; allowed is above 0 and at most 1")
